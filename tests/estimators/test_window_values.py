"""The window of iSAM2 against the same graph solved at once: no factor is lost or counted twice when it moves."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, D, F, X, Z
from support.factors import Array, make_step, seed_of, values_at, walk_track
from support.windows import CONFIG, EXACT, batch_graph, next_node, walked

from fbgraph.core.aids import Aids, AnchorFrame
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import OnlineConfig, SolverConfig
from fbgraph.core.errors import EstimationError
from fbgraph.estimators.aid_factors import closure_factor, closure_prior
from fbgraph.estimators.batch_smoother import smooth
from fbgraph.estimators.factor_graph import GraphBuilder
from fbgraph.estimators.isam_window import IsamWindow
from fbgraph.estimators.node import Node
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.records import Closure

STEPS = 36  # the window moves at breadcrumbs 19 and 29, to 10 and 20


def zigzag(count: int = STEPS) -> tuple[StepTrack, Array]:
    """Seven steps there, seven back, and so on; noisy, so that a closure has something to pull at."""
    rng = np.random.default_rng(3)
    yaw = np.where((np.arange(count) // 7) % 2 == 0, 0.3, 0.3 - math.pi)
    compass, altitude = yaw + rng.normal(0, 0.1, count), 300 + rng.normal(0, 0.1, count)
    track = walk_track(yaw, compass=compass, bias_rad_s=0.004, altitude_m=altitude)
    noisy = [
        replace(
            step,
            length_m=0.7 + 0.1 * float(rng.normal()),
            yaw_gyro_rad=step.yaw_gyro_rad + 0.02 * float(rng.normal()),
        )
        for step in track.steps[1:]
    ]
    return StepTrack([track.steps[0], *noisy]), yaw


def state(x_m: float, y_m: float, yaw_rad: float, bias_rad_s: float) -> Array:
    return np.array([x_m, y_m, math.remainder(yaw_rad, 2 * math.pi), bias_rad_s])


def last_of(window: IsamWindow) -> Array:
    node = window.refresh()[-1]
    return state(node.x_m, node.y_m, node.yaw_rad, node.bias_rad_s)


def at_once(extra: Sequence[Any] = ()) -> Array:
    """The latest breadcrumb by Levenberg-Marquardt on the whole graph and these factors more."""
    track, yaw = zigzag()
    graph, values = batch_graph(track, np.concatenate((yaw[:1], yaw)))
    for factor in extra:
        graph.push_back(factor)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    pose = result.atPose2(X(STEPS))
    return state(pose.x(), pose.y(), pose.theta(), float(result.atVector(B(STEPS))[0]))


def test_without_closures_the_end_is_the_batch_smoothers() -> None:
    window = walked(zigzag()[0])
    assert (window.first, len(window.nodes)) == (20, 37)
    assert np.allclose(last_of(window), at_once(), atol=1.5e-3)


def test_all_of_a_window_that_never_moved_is_the_batch_smoothers() -> None:
    track, yaw = zigzag()
    window = walked(track, EXACT.model_copy(update={"window_steps": 100}))
    nodes = np.array([(n.x_m, n.y_m, n.yaw_rad, 100 * n.bias_rad_s) for n in window.refresh()])
    batch = smooth(track, seed_of(track, np.concatenate((yaw[:1], yaw))), CONFIG, SolverConfig()).trajectory
    turned = np.angle(np.exp(1j * (nodes[:, 2] - batch.yaw_rad)))
    assert window.first == 0
    # its compass was made step by step, and its iron may wander a little
    assert np.allclose(nodes[:, :2], batch.xy_m, atol=0.03)
    assert np.allclose(turned, 0.0, atol=6e-3)
    assert np.allclose(nodes[:, 3], 100 * batch.gyro_bias_rad_s, atol=0.02)
    assert np.allclose([n.z_m for n in window.nodes], batch.z_m, atol=0.01)


BOTH = {
    "both leave with the window": (Closure(6, 8, 0.1, 0.1), 12),
    "the later one is where the window begins": (Closure(4, 10, 0.1, 0.1), 12),
    "both stay in the window at first": (Closure(13, 15, 0.1, 0.1), 16),
    "the earlier one is where the window begins": (Closure(10, 18, 0.1, 0.1), 18),
    "both still in the window": (Closure(24, 32, 0.5, 0.5), 33),
}
FIXED = {
    "the window's edge comes between them": (Closure(2, 12, 0.1, 0.1), 13),
    "the earlier one had left before": (Closure(9, 19, 0.1, 0.1), 19),
    "the edge comes between them at the second move": (Closure(15, 27, 0.1, 0.1), 27),
}


@pytest.mark.parametrize(("closure", "when"), BOTH.values(), ids=BOTH)
def test_a_closure_inside_the_window_is_the_batch_graphs(closure: Closure, when: int) -> None:
    window = walked(zigzag()[0], closures={when: closure})
    expected = at_once([closure_factor(closure)])
    assert np.allclose(last_of(window), expected, atol=1.5e-3)
    assert np.abs(expected[:2] - at_once()[:2]).max() > 0.01  # it matters
    assert window.closures == [closure]


@pytest.mark.parametrize(("closure", "when"), FIXED.values(), ids=FIXED)
def test_a_closure_across_the_windows_edge_holds_to_the_place_as_it_was_left(closure: Closure, when: int) -> None:
    window = walked(zigzag()[0], closures={when: closure})
    left = window.nodes[closure.i]
    expected = at_once([closure_prior(closure, left.x_m, left.y_m, left.yaw_rad)])
    assert np.allclose(last_of(window), expected, atol=1.5e-3)
    assert np.abs(expected[:2] - at_once()[:2]).max() > 0.01


def test_a_closure_that_comes_after_both_have_left_changes_nothing_but_is_remembered() -> None:
    closure = Closure(3, 5, 0.1, 0.1)
    window = walked(zigzag()[0], closures={25: closure})
    assert np.array_equal(last_of(window), last_of(walked(zigzag()[0])))
    assert window.closures == [closure]


def test_closures_given_together_all_count() -> None:
    track, _ = zigzag()
    window = walked(track)
    two = [Closure(24, 32, 0.5, 0.5), Closure(23, 33, 0.5, 0.5)]
    window.close(two)
    assert np.allclose(last_of(window), at_once([closure_factor(c) for c in two]), atol=2e-3)


def test_the_window_holds_what_it_should_and_what_left_it_stays() -> None:
    track, _ = zigzag(60)
    window, builder = IsamWindow(EXACT, CONFIG, False), GraphBuilder(CONFIG, Aids(), compass=True)
    left: list[Node] = []
    for k, step in enumerate(track.steps):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        node = next_node(track, k, window.nodes)
        builder.add(step, node, window.nodes[-1] if k else None, graph, values)
        assert window.add(graph, values, node, step) == window.nodes[-1]
        assert window.first == max((k + 1) // 10 - 1, 0) * 10
        assert window.nodes[: len(left)] == left
        left = window.nodes[: window.first]
        window.refresh()
    assert len(left) == 50


def test_asking_changes_nothing() -> None:
    track, _ = zigzag()
    for online in (EXACT, OnlineConfig(window_steps=10)):
        plain, asked = (walked(track, online, {13: Closure(2, 12, 0.1, 0.1)}, None, ask) for ask in (False, True))
        assert plain.nodes == asked.nodes
        before = list(asked.nodes)
        seen = asked.glimpse()
        assert asked.nodes == before
        assert len(seen) == STEPS + 1 - asked.first
        tolerance = 1e-3 if online is EXACT else 0.1
        now = asked.refresh()[asked.first :]
        assert np.allclose([(n.x_m, n.y_m) for n in seen], [(n.x_m, n.y_m) for n in now], atol=tolerance)


def test_yaw_goes_on_unwrapped_round_and_round() -> None:
    yaw = np.linspace(0.0, 20.0, 60)
    window = walked(walk_track(yaw, compass=np.angle(np.exp(1j * yaw))))
    assert np.allclose([n.yaw_rad for n in window.refresh()[1:]], yaw, atol=0.02)
    assert np.allclose([n.yaw_rad for n in window.glimpse()], yaw[window.first - 1 :], atol=0.02)


@pytest.mark.parametrize("window_steps", [10, 100])
def test_anchors_are_the_batch_smoothers(window_steps: int) -> None:
    yaw = np.linspace(0.0, 2.0, 40)
    track = walk_track(yaw, compass=yaw + 0.05)
    path = np.cumsum(0.75 * np.column_stack((np.cos(yaw), np.sin(yaw))), axis=0)
    at = np.array([2, 12, 24, 36])
    anchors = checkpoints(track.t_s[at], path[at - 1, 0], path[at - 1, 1], sigma_m=np.full(4, 0.2))
    window = walked(track, EXACT.model_copy(update={"window_steps": window_steps}), aids=Aids(anchors))
    untold = AnchorFrame(0.0, 0.0, 0.0, (0.0, 0.0), free=False)
    graph, values = batch_graph(track, np.concatenate((yaw[:1], yaw)), Aids(anchors, frame=untold))
    graph.push_back(gtsam.PoseTranslationPrior2D(F(0), gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(2, 1e-3)))
    result = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    node, end = window.refresh()[-1], result.atPose2(X(len(track) - 1))
    assert (node.x_m, node.y_m) == pytest.approx((end.x(), end.y()), abs=0.03)
    assert node.yaw_rad == pytest.approx(end.theta(), abs=0.01)
    assert (node.x_m, node.y_m) == pytest.approx(tuple(path[-1]), abs=0.3)


def test_what_cannot_be_solved_is_an_estimation_error_that_says_where() -> None:
    track, _ = zigzag(3)
    window = walked(track)
    values = values_at(*[(0.0, 0.0, 0.0, 0.0, 0.0)] * 5)
    for k in range(4):
        for key in (X(k), Z(k), B(k), D(k)):
            values.erase(key)
    only_a_direction = gtsam.NonlinearFactorGraph()
    only_a_direction.push_back(gtsam.PoseRotationPrior2D(X(4), gtsam.Rot2(), gtsam.noiseModel.Isotropic.Sigma(1, 0.1)))
    with pytest.raises(EstimationError, match="iSAM2 failed at step 4: "):
        window.add(only_a_direction, values, Node(0.0, 0.0, 0.0, 0.0, 0.0), make_step())
    with pytest.raises(EstimationError, match="iSAM2 failed at a closure: "):
        walked(track).close([Closure(0, 9, 1.0, 1.0)])


@pytest.mark.parametrize("gap_at", [0, 5])
def test_the_isobar_leaves_and_enters_the_window_as_in_the_batch_smoother(gap_at: int) -> None:
    """A walk that rests for a minute while pressure changes by two metres: by Cholesky, and after a gap by QR."""
    track, yaw = zigzag()
    steps = [
        replace(
            s, t_s=s.t_s + 60.0 * (k >= 25), altitude_m=s.altitude_m + 2.0 * (k >= 25), chained=k != gap_at or k == 0
        )
        for k, s in enumerate(track.steps)
    ]
    track = StepTrack(steps)
    window = walked(track)
    graph, values = batch_graph(track, np.concatenate((yaw[:1], yaw)))
    params = gtsam.LevenbergMarquardtParams()
    params.setLinearSolverType("MULTIFRONTAL_QR")
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    batch = np.array([result.atDouble(D(k)) for k in range(len(track))])
    online = np.array([n.isobar_m for n in window.refresh()])
    assert np.ptp(batch) > 0.4
    assert np.allclose(online[window.first :], batch[window.first :], atol=0.04)
