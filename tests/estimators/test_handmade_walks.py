"""PDR, EKF and smoother on steps made by hand: closed forms, invariances, factors against numerical derivatives."""

import math
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, X
from support.by_hand import hand_step

from fbgraph.core.aids import Aids
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import Config, GraphConfig, StepLengthConfig
from fbgraph.core.geometry import wrap_angle
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.batch_smoother import body_to_world, smooth
from fbgraph.estimators.compass import iron_sigma_ut
from fbgraph.estimators.ekf import run_ekf
from fbgraph.estimators.factor_graph import heading_factor
from fbgraph.estimators.gyroscope import GyroTurn
from fbgraph.estimators.node import Node
from fbgraph.estimators.pdr import dead_reckon
from fbgraph.front_end.step_track import StepTrack

CONFIG = Config(graph=GraphConfig(sigma_bias_rad_s=0.008))  # biased gyroscopes
L = 0.7
PDR_CONFIG = StepLengthConfig(constant_m=L)


def make_track(
    yaw_rad: np.ndarray, bias_rad_s: float = 0.0, compass: bool = True, rest: bool = False, dt_s: float = 0.5
) -> StepTrack:
    """A walker who makes one step of 0.7 m in each direction given, with a perfect compass and a biased gyroscope."""
    steps = []
    for k, yaw in enumerate(np.concatenate((yaw_rad[:1], yaw_rad))):
        t_s = k * dt_s
        yaw_s = t_s - dt_s / 2 if k else dt_s / 2
        heard = {"yaw_mag_rad": float(wrap_angle(np.asarray(yaw))), "mag_norm_ut": 45.0, "mag_dip_rad": 1.0}
        rested = {"rest_rate_rad_s": bias_rad_s, "rest_sigma_rad_s": 1e-4, "rest_s": 5.0, "rest_drift_rad": 0.0}
        given = {"t_s": t_s, "start_s": max(t_s - dt_s, 0.0), "length_m": L if k else 0.0, "frequency_hz": 1 / dt_s}
        given |= {"yaw_s": yaw_s, "yaw_gyro_rad": float(yaw) + 1.234 + bias_rad_s * yaw_s, "altitude_m": 100.0}
        given |= (heard if compass and k else {}) | (rested if rest and k == 1 else {})
        steps.append(hand_step(**given))
    return StepTrack(steps)


def run_all(track: StepTrack) -> dict[str, Trajectory]:
    ekf = run_ekf(track, CONFIG.ekf)
    return {
        "pdr": dead_reckon(track, PDR_CONFIG),
        "ekf": ekf,
        "smoothed": smooth(track, ekf, CONFIG.graph, CONFIG.solver).trajectory,
    }


SQUARE = np.repeat(np.radians([0.0, 90.0, 180.0, 270.0]), 20)
WALKS = {
    "straight": np.full(40, 0.3),
    "square": SQUARE,
    "circles": np.linspace(0, 6 * np.pi, 120),
    "across the wrap": np.full(30, np.pi),
}


@pytest.mark.parametrize("yaw", WALKS.values(), ids=WALKS.keys())
@pytest.mark.parametrize("name", ["pdr", "ekf", "smoothed"])
def test_a_perfect_walk_is_reconstructed_exactly(yaw: np.ndarray, name: str) -> None:
    estimate = run_all(make_track(yaw, rest=True))[name]
    assert np.allclose(estimate.x_m[1:], np.cumsum(L * np.cos(yaw)), atol=0.02)
    assert np.allclose(estimate.y_m[1:], np.cumsum(L * np.sin(yaw)), atol=0.02)
    assert estimate.x_m[0] == pytest.approx(0.0, abs=1e-9)
    assert np.allclose(estimate.z_m, 0.0, atol=1e-6)


@pytest.mark.parametrize("name", ["pdr", "ekf", "smoothed"])
def test_a_turned_world_gives_the_turned_walk(name: str) -> None:
    turn = 2.0
    a, b = (
        run_all(make_track(SQUARE, 0.004, rest=True))[name],
        run_all(make_track(SQUARE + turn, 0.004, rest=True))[name],
    )
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    assert np.allclose(a.xy_m @ rotation.T, b.xy_m, atol=1e-3)


@pytest.mark.parametrize("name", ["pdr", "ekf", "smoothed"])
def test_a_later_start_changes_only_times(name: str) -> None:
    track = make_track(SQUARE, 0.002, rest=True)
    later = StepTrack(
        [replace(s, t_s=s.t_s + 1000, start_s=s.start_s + 1000, yaw_s=s.yaw_s + 1000) for s in track.steps]
    )
    a, b = run_all(track)[name], run_all(later)[name]
    assert np.allclose(a.xy_m, b.xy_m, atol=1e-6)
    assert np.allclose(a.t_s + 1000, b.t_s)


@pytest.mark.parametrize("rest", [True, False])
def test_the_gyro_bias_is_found(rest: bool) -> None:
    bias = np.radians(0.4)
    trajectories = run_all(make_track(np.repeat(SQUARE, 3), bias, rest=rest))
    assert trajectories["smoothed"].gyro_bias_rad_s[-1] == pytest.approx(bias, abs=np.radians(0.08))
    assert trajectories["ekf"].gyro_bias_rad_s[-1] == pytest.approx(bias, abs=np.radians(0.15))


def test_without_a_compass_the_walk_keeps_its_shape() -> None:
    for name, estimate in run_all(make_track(SQUARE, compass=False)).items():
        assert np.hypot(estimate.x_m[-1], estimate.y_m[-1]) < 0.1, name
        assert np.allclose(estimate.yaw_rad[-1] - estimate.yaw_rad[1], 1.5 * np.pi, atol=0.02), name


def test_one_disturbed_stretch_does_not_bend_the_smoothed_walk() -> None:
    yaw = np.full(100, 0.0)
    track = make_track(yaw, rest=True)
    disturbed = [
        replace(s, yaw_mag_rad=float(wrap_angle(np.asarray(s.yaw_mag_rad + 1.2)))) if 40 <= k < 55 else s
        for k, s in enumerate(track.steps)
    ]
    estimates = run_all(StepTrack(disturbed))
    assert abs(estimates["smoothed"].y_m[-1]) < 0.09 * 70
    assert abs(estimates["smoothed"].y_m[-1]) < abs(estimates["ekf"].y_m).max() + 6


def test_anchors_and_a_closed_end_pull_the_walk() -> None:
    track = make_track(np.full(60, 0.0), compass=False)
    seed = run_ekf(track, CONFIG.ekf)
    biased = make_track(SQUARE, 0.01)
    told = Aids(closed_walk=True)
    closed = smooth(biased, run_ekf(biased, CONFIG.ekf), CONFIG.graph, CONFIG.solver, told).trajectory
    assert np.hypot(closed.x_m[-1], closed.y_m[-1]) < 0.5
    # anchors in another frame: turned by 90°, moved, and 10 % longer
    anchors = checkpoints(
        np.array([0.0, 15.0, 30.0]),
        np.array([5.0, 5.0, 5.0]),
        np.array([-3.0, 20.1, 43.2]),
        sigma_m=np.full(3, 0.1),
    )
    anchored = smooth(track, seed, CONFIG.graph, CONFIG.solver, Aids(anchors)).trajectory
    assert np.allclose(anchored.at(anchors.t_s)[:, :2], anchors.xy_m, atol=0.6)
    assert anchored.cov_xy_yaw is not None
    assert np.sqrt(anchored.cov_xy_yaw[:, 0, 0]).max() < 1.5


def test_a_gap_leaves_room_for_what_was_not_seen() -> None:
    track = make_track(np.full(40, 0.0))
    broken = [
        replace(s, chained=k != 20, t_s=s.t_s + 10 * (k >= 20), yaw_s=s.yaw_s + 10 * (k >= 20))
        for k, s in enumerate(track.steps)
    ]
    smoothed = run_all(StepTrack(broken))["smoothed"]
    assert smoothed.cov_xy_yaw is not None
    sigma = np.sqrt(smoothed.cov_xy_yaw[:, 0, 0])
    assert sigma[20] > sigma[19] + 5.0


def test_covariance_grows_along_an_unaided_walk() -> None:
    smoothed = run_all(make_track(np.full(80, 0.0)))["smoothed"]
    assert smoothed.cov_xy_yaw is not None
    assert (np.diff(np.trace(smoothed.cov_xy_yaw[:, :2, :2], axis1=1, axis2=2)) > 0).all()


def test_body_to_world_turns_ellipses() -> None:
    covariance = np.diag([4.0, 1.0, 0.1])[None]
    assert np.allclose(body_to_world(covariance, np.array([np.pi / 2]))[0], np.diag([1.0, 4.0, 0.1]))


def test_the_heading_factor_is_the_ekf_prediction_with_its_derivatives() -> None:
    node, previous = Node(1.0, 2.0, 0.0, 3.0, 0.01), Node(0.4, 1.5, 0.0, 2.8, 0.0)
    sigma, dt_s, increment = 0.02, 0.6, 0.35
    factor = heading_factor(1, GyroTurn(increment, dt_s, sigma, 1e-4), node, previous)

    def error(yaw_0: float, yaw_1: float, bias: float, x_1: float = 1.0) -> float:
        values = gtsam.Values()
        values.insert(X(0), gtsam.Pose2(0.4, 1.5, yaw_0))
        values.insert(X(1), gtsam.Pose2(x_1, 2.0, yaw_1))
        values.insert(B(1), np.array([bias, 0.0]))
        return math.sqrt(2 * factor.error(values)) * sigma

    # far from the linearisation point too: the factor is linear in yaw and bias, across the wrap as well
    for yaw_0, yaw_1, bias in ((2.8, 3.0, 0.01), (2.0, 3.9, -0.3), (4.0, 2.2, 0.5)):
        assert error(yaw_0, yaw_1, bias) == pytest.approx(abs((yaw_1 - yaw_0) + bias * dt_s - increment), abs=1e-9)
    h = 1e-6
    base = (2.8, 3.1, 0.2)
    assert (error(2.8 + h, 3.1, 0.2) - error(*base)) / h == pytest.approx(-1.0, abs=1e-4)
    assert (error(2.8, 3.1 + h, 0.2) - error(*base)) / h == pytest.approx(1.0, abs=1e-4)
    assert (error(2.8, 3.1, 0.2 + h) - error(*base)) / h == pytest.approx(dt_s, abs=1e-4)
    assert error(*base, x_1=50.0) == pytest.approx(error(*base))


def test_residuals_and_weights_add_up_to_the_graph_error() -> None:
    """The loss of every factor, rebuilt from its residual and weight, is all of the error that the solver reports."""
    yaw = np.concatenate((np.zeros(30), np.full(30, math.pi / 2)))
    track = make_track(yaw, bias_rad_s=0.01, rest=True)
    bent = np.where((np.arange(61) > 10) & (np.arange(61) < 20), track.yaw_mag_rad + 1.4, track.yaw_mag_rad)
    steps = [replace(step, yaw_mag_rad=float(m)) for step, m in zip(track.steps, bent, strict=True)]
    track = StepTrack(steps)
    anchors = checkpoints(track.t_s[[0, 30, 60]], np.array((0.0, 21.0, 33.0)), np.array((0.0, 0.0, 21.0)))
    smoothed = smooth(track, run_ekf(track, CONFIG.ekf), CONFIG.graph, CONFIG.solver, Aids(anchors))
    total = 0.0
    for kind in smoothed.residuals:
        away = np.abs(kind.whitened)
        # Huber: r²/2 up to c, c (r - c/2) beyond, with weight c / r; the compass's weights are the graph's own
        lost = np.zeros(len(away)) if kind.name in {"compass", "field_strength"} else 1.0 - kind.weight
        total += float((kind.weight * away**2 / 2 * (1.0 + lost)).sum())
    assert smoothed.device is not None
    iron_ut, graph = smoothed.device.iron_ut[0], CONFIG.graph
    total += 0.5 * float((iron_ut[:2] ** 2).sum()) / iron_sigma_ut(iron_ut, graph) ** 2
    total += 0.5 * ((iron_ut[2] - 45.0 * math.cos(1.0)) / graph.sigma_field_ut) ** 2
    total += 0.5 * (smoothed.device.gyro_scale / graph.sigma_gyro_scale) ** 2
    assert smoothed.aids.frame is not None
    total += 0.5 * math.log1p((smoothed.aids.frame.turn_rad / 0.2) ** 2)  # the anchors' frame turned, Cauchy
    assert total == pytest.approx(smoothed.errors[-1], rel=1e-3)
    assert smoothed.errors[-1] < smoothed.errors[0]
    by_name = {kind.name: kind for kind in smoothed.residuals}
    doubted = by_name["compass"].k[by_name["compass"].weight < 0.5]
    assert set(doubted) >= set(range(12, 19))
    assert doubted.min() > 8
    assert doubted.max() < 22
    assert by_name["anchor"].weight.argmin() == 2  # the one that lies 12 m beside the walk
