"""What the graph knows of places: its start, anchors, a closed end, closures; computed on paper."""

import math
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, F, X, Z
from support.factors import (
    NAN,
    factors_of,
    graph_of,
    is_robust,
    make_step,
    seed_of,
    sigmas_of,
    stand,
    the_factor,
    values_at,
    walk_track,
)

from fbgraph.core.aids import Aids, AnchorFrame
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.config import GraphConfig
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.aid_factors import (
    anchor_factor,
    closed_walk_factor,
    closure_factor,
    closure_prior,
    framed_anchor_factor,
)
from fbgraph.estimators.factor_graph import build_graph
from fbgraph.estimators.heading_chain import HeadingSolution, solve_heading
from fbgraph.estimators.node import Node
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.records import Closure

CONFIG = GraphConfig(sigma_anchor_m=0.4, sigma_closure_m=1.2, sigma_bias_rad_s=0.008)
CLOSURE = Closure(i=1, j=3, sigma_along_m=0.8, sigma_across_m=0.6, along_m=0.25)


def places(*rows: tuple[float, float, float], sigma_m: float = NAN) -> Checkpoints:
    t_s, x_m, y_m = np.array(rows).T
    return checkpoints(t_s, x_m, y_m, sigma_m=np.full(len(rows), sigma_m))


ONE, TWO = places((0.0, 0.0, 0.0)), places((0.0, 0.0, 0.0), (9.0, 5.0, 5.0))


def start_sigmas(aids: Aids, compass: bool) -> tuple[list[float], list[float]]:
    graph = graph_of([stand(), make_step()], CONFIG, aids, compass)
    place = the_factor(graph, "PoseTranslationPrior2D", X(0))
    return sigmas_of(place), sigmas_of(the_factor(graph, "PoseRotationPrior2D", X(0)))


def test_the_first_breadcrumb_is_the_origin_and_a_compass_tells_its_direction() -> None:
    assert start_sigmas(Aids(), compass=True) == ([1e-3, 1e-3], [100.0])
    assert start_sigmas(Aids(closed_walk=True), compass=True) == ([1e-3, 1e-3], [100.0])


def test_without_a_compass_the_first_direction_is_the_reference() -> None:
    assert start_sigmas(Aids(), compass=False) == ([1e-3, 1e-3], [1e-3])


def test_anchors_change_nothing_about_that_for_they_have_a_frame_of_their_own() -> None:
    for anchors in (ONE, TWO):
        assert start_sigmas(Aids(anchors), compass=False) == ([1e-3, 1e-3], [1e-3])
        assert start_sigmas(Aids(anchors), compass=True) == ([1e-3, 1e-3], [100.0])


def test_the_start_is_at_zero_and_faces_where_it_is_said_to() -> None:
    graph = graph_of([stand()], CONFIG, compass=False, nodes=[Node(3.0, 4.0, 5.0, 0.7, 0.001)])
    values = values_at((0.3, -0.2, 0.1, 0.9, 0.002))
    assert np.allclose(the_factor(graph, "PoseTranslationPrior2D", X(0)).unwhitenedError(values), [0.3, -0.2])
    assert the_factor(graph, "PoseRotationPrior2D", X(0)).unwhitenedError(values) == pytest.approx([0.2])
    altitude, bias = the_factor(graph, "PriorFactorDouble", Z(0)), the_factor(graph, "PriorFactorVector", B(0))
    assert altitude.unwhitenedError(values) == pytest.approx([0.1])
    values.erase(B(0))
    values.insert(B(0), np.array([0.002, 0.01]))
    assert bias.unwhitenedError(values) == pytest.approx([0.002, 0.01])
    assert (sigmas_of(altitude), sigmas_of(bias)) == ([1e-3], [0.008, CONFIG.sigma_gyro_scale])
    assert graph.size() == 5


def anchor_at(anchors: Checkpoints, length_m: float) -> Any:
    return anchor_factor(anchors, 1, 4, make_step(length_m=length_m), CONFIG)


def test_an_anchor_is_a_place_and_half_a_step_uncertain() -> None:
    factor = anchor_at(places((1.0, 9.0, 9.0), (2.0, 5.0, -3.0)), length_m=0.6)
    assert tuple(factor.keys()) == (X(4),)
    assert sigmas_of(factor) == pytest.approx([0.5, 0.5])  # hypot(0.4, 0.6 / 2)
    values = gtsam.Values()
    values.insert(X(4), gtsam.Pose2(5.5, -3.0, 1.0))
    assert np.allclose(factor.unwhitenedError(values), [0.5, 0.0])
    # Huber of 1.345 over both axes: 3 m and 4 m are 10 sigma
    far = gtsam.Values()
    far.insert(X(4), gtsam.Pose2(8.0, 1.0, 1.0))
    assert factor.error(far) == pytest.approx(1.345 * (10 - 0.6725))


def test_an_anchor_may_bring_its_own_sigma() -> None:
    factor = anchor_at(places((1.0, 9.0, 9.0), (2.0, 5.0, -3.0), sigma_m=0.05), length_m=0.24)
    assert sigmas_of(factor) == pytest.approx([0.13, 0.13])  # hypot(0.05, 0.12)


def test_a_closed_walk_ends_at_the_start() -> None:
    factor = closed_walk_factor(3, CONFIG)
    assert tuple(factor.keys()) == (X(3),)
    assert sigmas_of(factor) == [1.2, 1.2]
    assert not is_robust(factor)
    values = gtsam.Values()
    values.insert(X(3), gtsam.Pose2(0.6, -1.2, 2.0))
    assert factor.error(values) == pytest.approx(0.5 * (0.25 + 1.0))


def test_a_closure_sees_the_later_breadcrumb_along_the_earlier_ones_direction_facing_back() -> None:
    factor = closure_factor(CLOSURE)
    assert tuple(factor.keys()) == (X(1), X(3))
    assert sigmas_of(factor) == [0.8, 0.6, 100.0]
    values = gtsam.Values()
    values.insert(X(1), gtsam.Pose2(2.0, 3.0, math.pi / 2))
    values.insert(X(3), gtsam.Pose2(2.0, 3.25, -math.pi / 2))  # a quarter of a metre further on
    assert factor.error(values) == pytest.approx(0.0, abs=1e-12)
    values.update(X(3), gtsam.Pose2(2.0, 5.65, -math.pi / 2))  # 2.4 m beyond that: 3 sigma along
    # Cauchy of 1: ½ ln(1 + d²)
    assert factor.error(values) == pytest.approx(0.5 * math.log(10.0))
    values.update(X(3), gtsam.Pose2(0.8, 3.25, -math.pi / 2))  # 1.2 m to the left: 2 sigma across
    assert factor.error(values) == pytest.approx(0.5 * math.log(5.0))


def test_a_closure_to_a_fixed_breadcrumb_is_a_wider_place() -> None:
    factor = closure_prior(CLOSURE, 2.0, 3.0, math.pi / 2)
    assert tuple(factor.keys()) == (X(3),)
    sigma = 1.5 * 1.0 / math.sqrt(2.0)  # hypot(0.8, 0.6) = 1 over both axes
    assert sigmas_of(factor) == pytest.approx([sigma, sigma])
    values = gtsam.Values()
    values.insert(X(3), gtsam.Pose2(2.0, 3.25, 0.3))
    assert factor.error(values) == pytest.approx(0.0, abs=1e-12)
    values.update(X(3), gtsam.Pose2(2.0 - 3 * sigma, 3.25, 0.3))
    assert factor.error(values) == pytest.approx(0.5 * math.log(10.0))


def heading_at(track: StepTrack, seed: Trajectory) -> HeadingSolution:
    return solve_heading(track, [(seed.yaw_rad, seed.gyro_bias_rad_s)], CONFIG)


def whole(aids: Aids, compass: bool = False) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    yaw = np.zeros(5)
    track = walk_track(yaw, compass=yaw if compass else None)
    seed = seed_of(track, np.full(6, 0.2), 0.003)
    return build_graph(track, seed, heading_at(track, seed), CONFIG, aids)


def built(aids: Aids, compass: bool = False) -> gtsam.NonlinearFactorGraph:
    return whole(aids, compass)[0]


def test_a_whole_walks_graph_has_each_anchor_at_the_breadcrumb_nearest_in_time() -> None:
    # breadcrumbs at 0, 0.5, 1, 1.5, 2, 2.5 s
    graph = built(Aids(places((0.2, 1.0, 0.0), (1.3, 2.0, 0.0), (9.0, 3.0, 0.0))))
    robust = [f for k in range(6) for f in factors_of(graph, "BetweenFactorPose2", F(0), X(k))]
    assert all(is_robust(f) for f in robust)
    assert [tuple(f.keys()) for f in robust] == [(F(0), X(0)), (F(0), X(3)), (F(0), X(5))]
    values = values_at(*[(0.0, 0.0, 0.0, 0.0, 0.0)] * 6)
    values.insert(F(0), gtsam.Pose2())
    # counted from the first of them
    assert [f.unwhitenedError(values)[0] for f in robust] == [0.0, -1.0, -2.0]
    assert sigmas_of(robust[0]) == pytest.approx([0.4, 0.4, 100.0])  # the standing start has no length
    assert sigmas_of(robust[1]) == pytest.approx([math.hypot(0.4, 0.35)] * 2 + [100.0])


def test_an_anchor_of_a_turned_frame_counts_in_that_frame() -> None:
    frame = AnchorFrame(3.0, 4.0, math.pi / 2, (100.0, 200.0), free=True)
    factor = framed_anchor_factor(places((1.0, 102.0, 201.0)), 0, 4, make_step(length_m=0.6), frame, CONFIG)
    values = gtsam.Values()
    values.insert(F(0), gtsam.Pose2(3.0, 4.0, math.pi / 2))
    values.insert(X(4), gtsam.Pose2(2.0, 6.0, 0.7))  # (2, 1) from the centre, turned by a quarter
    assert np.allclose(factor.unwhitenedError(values)[:2], 0.0)
    assert sigmas_of(factor) == pytest.approx([0.5, 0.5, 100.0])


def test_a_frame_lies_at_the_first_anchor_and_is_usually_not_turned() -> None:
    graph, values = whole(Aids(places((1.1, 50.0, 60.0), (1.6, 51.0, 60.0))), compass=True)
    place = values.atPose2(X(2))
    assert (values.atPose2(F(0)).x(), values.atPose2(F(0)).y(), values.atPose2(F(0)).theta()) == pytest.approx(
        (place.x(), place.y(), 0.0)
    )
    turn = the_factor(graph, "PoseRotationPrior2D", F(0))
    assert (sigmas_of(turn), is_robust(turn)) == ([0.2], True)
    turned = gtsam.Values()
    turned.insert(F(0), gtsam.Pose2(0.0, 0.0, 0.6))
    assert turn.error(turned) == pytest.approx(0.5 * math.log(10.0))  # Cauchy, three sigma


def test_without_a_compass_a_frame_may_be_turned_by_any_angle_but_one_anchor_tells_none() -> None:
    for anchors, sigma in ((TWO, 100.0), (ONE, 1e-3)):
        turn = the_factor(built(Aids(anchors)), "PoseRotationPrior2D", F(0))
        assert (sigmas_of(turn), is_robust(turn)) == ([sigma], False)


def test_a_whole_walks_graph_has_its_closed_end() -> None:
    graph = built(Aids(closed_walk=True))
    assert len(factors_of(graph, "PoseTranslationPrior2D", X(5))) == 1
    assert factors_of(built(Aids()), "PoseTranslationPrior2D", X(5)) == []


def test_a_whole_walks_graph_starts_at_its_seed() -> None:
    yaw = np.zeros(5)
    track = walk_track(yaw)
    seed = seed_of(track, np.linspace(0.2, 0.7, 6), 0.003)
    _, values = build_graph(track, seed, heading_at(track, seed), CONFIG, Aids())
    for k in range(6):
        pose = values.atPose2(X(k))
        assert (pose.x(), pose.y(), pose.theta()) == pytest.approx((seed.x_m[k], seed.y_m[k], seed.yaw_rad[k]))
        assert (values.atDouble(Z(k)), values.atVector(B(k))[0]) == (0.0, pytest.approx(0.003))


def test_the_first_step_tells_whether_there_is_a_compass() -> None:
    free = [sigmas_of(the_factor(built(Aids(), compass), "PoseRotationPrior2D", X(0))) for compass in (True, False)]
    assert free == [[100.0], [1e-3]]
