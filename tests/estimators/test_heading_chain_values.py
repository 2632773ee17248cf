"""Headings solved by themselves: against the graph, and on walks whose device's errors are known."""

import math
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, I, X
from support.factors import seed_of
from support.magnetised import LEVEL_UT, laps, magnetised

from fbgraph.core.aids import Aids
from fbgraph.core.config import GraphConfig
from fbgraph.core.errors import EstimationError
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.estimators.compass import iron_cost
from fbgraph.estimators.compass_factors import UNIT_UT
from fbgraph.estimators.factor_graph import build_graph
from fbgraph.estimators.heading_chain import HeadingChain, HeadingSolution, solve_heading
from fbgraph.estimators.pdr import calibrated_yaw_rad
from fbgraph.front_end.step_track import StepTrack

CONFIG = GraphConfig()


def solved(track: StepTrack, config: GraphConfig = CONFIG) -> HeadingSolution:
    return solve_heading(track, [(calibrated_yaw_rad(track), np.zeros(len(track)))], config)


def off_rad(found: HeadingSolution, yaw_rad: FloatArray) -> FloatArray:
    """(K,) error of the steps' directions."""
    return np.asarray(wrap_angle(found.yaw_rad[1:] - yaw_rad))


def test_the_graph_without_places_has_the_same_answer() -> None:
    """Noisy, with iron, a rest, a jump that is believed, and a gyroscope that shows too much."""
    yaw = laps(4)
    jumped = np.where(np.arange(240)[:, None] < 70, (1.0, -1.0), (-14.0, 11.0))
    track = magnetised(yaw, jumped, bias_rad_s=0.005, scale=0.01, noise_rad=0.03, jump=(71, -15.0, 12.0))
    rest: dict[str, Any] = {"rest_s": 4.0, "rest_rate_rad_s": 0.004, "rest_sigma_rad_s": 1e-3, "rest_drift_rad": 0.0}
    track = StepTrack([replace(step, **rest) if k == 30 else step for k, step in enumerate(track.steps)])
    found = solved(track)
    assert len(found.iron_ut) == 2
    graph, values = build_graph(track, seed_of(track, found.yaw_rad), found, CONFIG, Aids())
    rng = np.random.default_rng(1)
    for k in range(len(track)):  # from somewhere else
        values.update(X(k), values.atPose2(X(k)).compose(gtsam.Pose2(0.0, 0.0, 0.2 * rng.normal())))
        values.update(B(k), np.array([0.01, 0.02]))
    params = gtsam.LevenbergMarquardtParams()
    params.setRelativeErrorTol(1e-14)
    params.setAbsoluteErrorTol(1e-14)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    yaw_off = [wrap_angle(np.array(result.atPose2(X(k)).theta() - found.yaw_rad[k])) for k in range(len(track))]
    assert np.abs(yaw_off).max() < 1e-4
    bias = np.array([result.atVector(B(k)) for k in range(len(track))])
    assert np.allclose(bias[:, 0], found.bias_rad_s, atol=1e-5)
    assert np.allclose(bias[:, 1], found.gyro_scale, atol=1e-5)
    for j in (0, 1):
        assert np.allclose(UNIT_UT * result.atVector(I(j)), found.iron_ut[j], atol=2e-3)


@pytest.mark.parametrize("iron_ut", [(18.0, 0.0), (-6.0, 16.0), (28.0, 10.0), (0.0, 0.0)])
def test_a_walk_round_a_square_tells_the_iron_of_its_device(iron_ut: tuple[float, float]) -> None:
    yaw = laps(2)
    found = solved(magnetised(yaw, iron_ut))
    assert found.iron_ut.shape == (1, 3)
    assert found.iron_ut[0] == pytest.approx((*iron_ut, LEVEL_UT), abs=1.5)
    # all that is unlikely of this walk is that a device has so much
    assert found.cost == pytest.approx(iron_cost(found.iron_ut[0], CONFIG), abs=1.0)
    assert np.abs(off_rad(found, yaw)).max() < 0.08


def test_iron_that_turns_with_nobody_cannot_be_told_from_the_world() -> None:
    """Straight on, 2 µT across are a compass that errs by 0.1 rad: the prior takes them for none."""
    found = solved(magnetised(np.full(60, 0.3), (0.0, 2.0)))
    assert np.hypot(*found.iron_ut[0, :2]) < 0.5


def test_there_and_back_laps_tell_the_gyroscopes_scale_and_none_without_compass() -> None:
    yaw = np.concatenate((laps(6, side=6), laps(6, side=6, way=-1.0)))
    track = magnetised(yaw, scale=0.03)
    assert solved(track).gyro_scale == pytest.approx(0.03, abs=0.006)
    assert np.abs(off_rad(solved(track), yaw)).max() < 0.15
    dark = solved(magnetised(yaw, scale=0.03, compass=False))
    assert dark.gyro_scale == pytest.approx(0.0, abs=1e-6)
    assert len(dark.readings) == 0


def test_the_bias_is_found_with_a_compass_and_taken_from_a_rest_without() -> None:
    yaw = np.concatenate((laps(1), laps(1, way=-1.0)))
    sure = CONFIG.model_copy(update={"sigma_mag_rad": 0.02, "sigma_yaw_step_rad": 1e-3})
    assert solved(magnetised(yaw, bias_rad_s=0.006), sure).bias_rad_s[-1] == pytest.approx(0.006, abs=2e-4)
    rest: dict[str, Any] = {"rest_s": 1e-9, "rest_rate_rad_s": 0.006, "rest_sigma_rad_s": 1e-4, "rest_drift_rad": 0.0}
    dark = solved(magnetised(yaw, bias_rad_s=0.006, compass=False, **rest))
    assert dark.bias_rad_s[-1] == pytest.approx(0.006, abs=1e-4)
    assert np.abs(off_rad(dark, yaw - yaw[0])).max() < 0.01


def test_a_turned_world_gives_the_turned_headings() -> None:
    yaw, turn = laps(1), 2.0
    plain = solved(magnetised(yaw, (7.0, 4.0), noise_rad=0.05))
    track = magnetised(yaw, (7.0, 4.0), noise_rad=0.05)
    turned = solved(StepTrack([replace(step, yaw_mag_rad=step.yaw_mag_rad + turn) for step in track.steps]))
    assert np.allclose(wrap_angle(turned.yaw_rad - plain.yaw_rad - turn), 0.0, atol=1e-4)
    assert np.allclose(turned.bias_rad_s, plain.bias_rad_s, atol=1e-6)
    # the walker's frame is turned as well: the same iron points elsewhere
    assert np.hypot(*turned.iron_ut[0, :2]) == pytest.approx(np.hypot(*plain.iron_ut[0, :2]), abs=1e-3)


def jumping(shown: bool) -> StepTrack:
    """A walk in the middle of which the magnetometer's zero jumps by (15, -10) µT, or only seems to."""
    yaw = laps(2)
    iron_ut = np.where(np.arange(len(yaw))[:, None] >= 59, (15.0, -10.0), (0.0, 0.0)) * float(shown)
    return magnetised(yaw, iron_ut, jump=(60, 15.0, -10.0))


def test_a_jump_that_explains_the_walk_is_believed() -> None:
    found = solved(jumping(shown=True))
    assert found.jumps_ut.tolist() == [[15.0, -10.0, 0.0]]
    assert np.flatnonzero(np.diff(found.stretch)).tolist() == [59]
    assert found.iron_ut[1] - found.iron_ut[0] == pytest.approx((15.0, -10.0, 0.0), abs=0.5)
    assert found.iron_ut[0, :2] == pytest.approx((0.0, 0.0), abs=1.0)
    assert np.abs(off_rad(found, laps(2))).max() < 0.05


def test_a_jump_that_explains_nothing_is_not() -> None:
    found = solved(jumping(shown=False))
    assert (len(found.jumps_ut), len(found.iron_ut)) == (0, 1)
    assert not found.stretch.any()
    assert np.abs(off_rad(found, laps(2))).max() < 0.02


def test_the_cost_falls_and_ends_where_nothing_moves() -> None:
    track = magnetised(laps(2), (18.0, 3.0), noise_rad=0.03)
    chain = HeadingChain(track, CONFIG, jumps=True)
    start = chain.start(calibrated_yaw_rad(track), np.zeros(len(track)), np.array([[0.0, 0.0, LEVEL_UT]]))
    costs = [chain.improved(start, count).cost for count in (2, 4, 8, 40)]
    assert costs == sorted(costs, reverse=True)
    done = chain.improved(start, 40)
    again = chain.improved(done, 1)
    assert np.allclose(again.yaw_rad, done.yaw_rad, atol=1e-4)
    assert again.cost == pytest.approx(done.cost, rel=1e-6)


def test_a_seed_may_have_turned_the_other_way_round() -> None:
    """Wrapped or not, a seed means the turns nearest to the gyroscope's."""
    yaw = laps(3)
    track = magnetised(yaw)
    wrapped = np.asarray(wrap_angle(calibrated_yaw_rad(track)))
    found = solve_heading(track, [(wrapped, np.zeros(len(track)))], CONFIG)
    assert found.yaw_rad[-1] - found.yaw_rad[1] == pytest.approx(yaw[-1] - yaw[0], abs=0.01)


def test_a_seed_that_is_no_number_is_an_estimation_error() -> None:
    track = magnetised(laps(1))
    with pytest.raises(EstimationError, match="the smoother failed at the headings"):
        solve_heading(track, [(np.full(len(track), math.nan), np.zeros(len(track)))], CONFIG)
