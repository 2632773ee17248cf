"""Closures weighed by hand: which win, which lose, and a way back beside the way out."""

import math

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from fbgraph.estimators.closure_weights import WeighedClosures, beside_factor, weigh
from fbgraph.way_back.records import Closure


def chain(aside_m: float, drift_rad: float = 0.0) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Twenty metres out, and back ``aside_m`` to the left of it, by dead reckoning whose way back is turned too far."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    steps = [gtsam.Pose2(1.0, 0.0, 0.0)] * 20
    steps += [gtsam.Pose2(0.0, aside_m, math.pi + drift_rad)]
    steps += [gtsam.Pose2(1.0, 0.0, 0.0)] * 20
    pose = gtsam.Pose2()
    values.insert(X(0), pose)
    graph.push_back(gtsam.PriorFactorPose2(X(0), pose, gtsam.noiseModel.Isotropic.Sigma(3, 1e-3)))
    walks, turns = (gtsam.noiseModel.Diagonal.Sigmas(np.array([0.05, 0.02, yaw])) for yaw in (0.02, 0.4))
    for k, step in enumerate(steps, 1):
        pose = pose.compose(step)
        values.insert(X(k), pose)
        graph.push_back(gtsam.BetweenFactorPose2(X(k - 1), X(k), step, turns if k == 21 else walks))
    return graph, values


def ties(*pairs: tuple[int, int], across_m: float = 0.0) -> tuple[Closure, ...]:
    return tuple(Closure(i, j, 0.7, 0.7, 0.0, across_m) for i, j in pairs)


GOOD = ties(*((20 - m, 21 + m) for m in (5, 8, 11, 14, 17, 20)))


def test_good_ones_win_together_however_far_the_walk_has_drifted() -> None:
    """Each is off by up to 14 of its sigmas at first."""
    graph, values = chain(0.0, drift_rad=0.5)
    start = WeighedClosures(GOOD, np.ones(6))
    assert start.off(values).max() > 12.0
    state, solved = weigh(graph, values, GOOD, by_qr=False)
    assert state.weights.tolist() == [1.0] * 6
    assert state.off(solved).max() < 2.0
    assert solved.atPose2(X(41)).y() == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("by_qr", [False, True])
def test_a_bad_one_loses_and_takes_no_good_one_with_it(by_qr: bool) -> None:
    graph, values = chain(0.0)
    closures = (*GOOD[:3], *ties((2, 26)), *GOOD[3:])
    state, solved = weigh(graph, values, closures, by_qr)
    assert state.weights.tolist() == [1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0]
    assert solved.atPose2(X(41)).x() == pytest.approx(0.0, abs=0.2)
    residuals = state.residuals(solved)
    assert residuals.name == "closure"
    assert residuals.k.tolist() == [closure.j for closure in closures]
    assert residuals.whitened[3] > 15.0


@pytest.mark.parametrize("aside_m", [1.5, -2.0, 4.0])
def test_a_lane_beside_the_last_one_stays_beside_it(aside_m: float) -> None:
    graph, values = chain(aside_m)
    state, solved = weigh(graph, values, GOOD, by_qr=False)
    assert state.weights.tolist() == [1.0] * 6
    assert solved.atDouble(L(0)) == pytest.approx(aside_m, abs=0.4)
    assert solved.atPose2(X(41)).y() == pytest.approx(aside_m, abs=0.4)


def test_closures_hold_the_direction_of_a_lane_all_the_same() -> None:
    graph, values = chain(1.5, drift_rad=0.2)
    _, solved = weigh(graph, values, ties(*((c.i, c.j) for c in GOOD), across_m=1.5), by_qr=False)
    assert solved.atPose2(X(41)).y() == pytest.approx(1.5, abs=0.5)
    assert values.atPose2(X(41)).y() < -2.0


def test_its_factor_is_off_by_the_weighed_error_and_linear_in_what_lies_beside() -> None:
    values = gtsam.Values()
    values.insert(X(2), gtsam.Pose2(1.0, 2.0, 0.4))
    values.insert(X(9), gtsam.Pose2(1.0, 2.0, 0.4).compose(gtsam.Pose2(0.8, -0.3, 3.0)))
    values.insert(L(0), 0.2)
    closure = Closure(2, 9, 0.5, math.hypot(0.5, 0.4), along_m=0.3)
    factor = beside_factor(closure, 0.25, values)
    # along (0.8 - 0.3) / 0.5 = 1, across (-0.3 - 0.2) / 0.4 = -1.25, a quarter of their squares
    assert factor.error(values) == pytest.approx(0.25 * 0.5 * (1.0 + 1.25**2))
    h, base = 1e-6, factor.linearize(values)
    a, b = base.jacobian()
    for column in range(7):
        moved = gtsam.Values(values)
        delta = np.zeros(7)
        delta[column] = h
        # keys of a factor in the order in which it was made: the earlier breadcrumb, the later, beside
        moved.update(X(2), values.atPose2(X(2)).retract(delta[:3]))
        moved.update(X(9), values.atPose2(X(9)).retract(delta[3:6]))
        moved.update(L(0), 0.2 + delta[6])
        place = moved.atPose2(X(2)).between(moved.atPose2(X(9)))
        error = 0.5 * np.array([(place.x() - 0.3) / 0.5, (place.y() - moved.atDouble(L(0))) / 0.4])
        assert (error + b) / h == pytest.approx(a[:, column], abs=1e-4)
