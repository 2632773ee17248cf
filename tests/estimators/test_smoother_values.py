"""The batch smoother: covariances by hand, errors against their sigmas, closed forms and invariances."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest
from support.by_hand import HALF_A_METRE
from support.factors import Array, seed_of, walk_track

from fbgraph.core.aids import Aids
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import Config, GraphConfig, SolverConfig
from fbgraph.core.errors import EstimationError
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.altitude_chain import weather_sigma_m
from fbgraph.estimators.batch_smoother import body_to_world, smooth, tie_way_back
from fbgraph.estimators.estimates import Smoothed
from fbgraph.estimators.shared_errors import curvature_covariance, walk_covariance
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.records import Closure

SOLVER = SolverConfig()
QUIET = GraphConfig(sigma_length_scale=0.0, sigma_mount_rad=0.0)


def smoothed(
    track: StepTrack, yaw: Array, config: GraphConfig = QUIET, aids: Aids | None = None, bias: float = 0.0
) -> Smoothed:
    return smooth(track, seed_of(track, np.concatenate((yaw[:1], yaw)), bias), config, SOLVER, aids)


def covariance_of(trajectory: Trajectory) -> Array:
    assert trajectory.cov_xy_yaw is not None
    return trajectory.cov_xy_yaw


def test_a_covariance_of_the_body_turns_into_the_worlds() -> None:
    covariance = np.array([[[4.0, 0.0, 0.5], [0.0, 1.0, 0.0], [0.5, 0.0, 0.1]]])
    (turned,) = body_to_world(covariance, np.array([math.pi / 6]))
    c, s = math.sqrt(3) / 2, 0.5
    expected = [
        [4 * c * c + s * s, 3 * s * c, 0.5 * c],
        [3 * s * c, 4 * s * s + c * c, 0.5 * s],
        [0.5 * c, 0.5 * s, 0.1],
    ]
    assert np.allclose(turned, expected)


def test_the_errors_of_a_whole_walk_stretch_and_turn_it_about_its_start() -> None:
    config = GraphConfig(sigma_length_scale=0.1, sigma_mount_rad=0.2)
    covariance = walk_covariance(np.array([[1.0, 1.0, 0.3], [4.0, 5.0, 2.0]]), np.zeros(2), config)
    assert np.allclose(covariance[0], np.diag([0.0, 0.0, 0.04]))
    # r = (3, 4): scale moves it by (0.3, 0.4), the mount by (-0.8, 0.6) and its yaw by 0.2
    assert np.allclose(covariance[1], [[0.73, -0.36, -0.16], [-0.36, 0.52, 0.12], [-0.16, 0.12, 0.04]])


def test_a_turn_in_the_hand_turns_what_comes_after_it_about_the_breadcrumb_before() -> None:
    poses = np.array([[1.0, 1.0, 0.3], [4.0, 5.0, 2.0], [4.0, 7.0, 1.5]])
    quiet = GraphConfig(sigma_length_scale=0.0, sigma_mount_rad=0.3)
    turned = walk_covariance(poses, np.array([0.4, 0.0, 0.1]), quiet)
    assert np.allclose(turned[0], np.diag([0.0, 0.0, 0.25]))
    assert np.allclose(turned[1], 0.25 * np.array([[16.0, -12.0, -4.0], [-12.0, 9.0, 3.0], [-4.0, 3.0, 1.0]]))
    alone = walk_covariance(poses, np.array([0.4, 0.0, 0.0]), quiet)
    assert np.allclose(turned[2] - alone[2], 0.01 * np.array([[4.0, 0.0, -2.0], [0.0, 0.0, 0.0], [-2.0, 0.0, 1.0]]))


def test_the_whole_walks_errors_are_part_of_its_covariance_until_two_places_are_known() -> None:
    yaw = np.full(20, 0.4)
    track = walk_track(yaw, compass=yaw)
    loud = GraphConfig(sigma_length_scale=0.1, sigma_mount_rad=0.2)
    plain, more = (smoothed(track, yaw, config).trajectory for config in (QUIET, loud))
    poses = np.column_stack((plain.x_m, plain.y_m, plain.yaw_rad))
    bent_more, bent = (
        curvature_covariance(track.length_m, plain.yaw_rad, covariance_of(t)[:, 2, 2]) for t in (more, plain)
    )
    added = walk_covariance(poses, np.zeros(21), loud) + bent_more - bent
    assert np.allclose(covariance_of(more) - covariance_of(plain), added, atol=1e-9)
    one = checkpoints(np.array([0.0]), np.array([3.0]), np.array([4.0]))
    two = checkpoints(np.array([0.0, 10.0]), np.array([3.0, 15.0]), np.array([4.0, 9.0]))
    turning = QUIET.model_copy(update={"sigma_mount_rad": 0.2})
    for anchors, turned in ((one, 0.04), (two, 0.0)):
        plain, more = (smoothed(track, yaw, config, Aids(anchors)).trajectory for config in (QUIET, turning))
        assert np.allclose(covariance_of(more)[:, 2, 2] - covariance_of(plain)[:, 2, 2], turned, atol=1e-9)


def noisy_walk(rng: np.random.Generator, config: GraphConfig, steps: int) -> tuple[StepTrack, Array]:
    """A walk whose every error is drawn as the factors say; truth as (K+1, 5): x, y, z, yaw, bias."""
    dt_s, length_m, turn = 0.5, 0.7, 0.05
    truth = np.zeros((steps + 1, 5))
    truth[0, 3:] = 2.0, rng.normal(0.0, config.sigma_bias_rad_s)
    scale, rate_m_s, isobar_m = rng.normal(0.0, (config.sigma_gyro_scale, config.sigma_weather_m_s, 0.0))
    gyro, compass, altitude = np.zeros((3, steps + 1))
    a = math.exp(-length_m / config.mag_correlation_m)  # the compass errs as the place does
    error = rng.normal(0.0, config.sigma_mag_rad)
    for k in range(1, steps + 1):
        x_m, y_m, z_m, yaw, bias = truth[k - 1]
        bias += rng.normal(0.0, config.sigma_bias_walk_rad_s * math.sqrt(dt_s))
        yaw += turn
        along = length_m * (1.0 + rng.normal(0.0, config.sigma_length_rel))
        across = rng.normal(0.0, config.sigma_lateral_m)
        x_m += along * math.cos(yaw) - across * math.sin(yaw)
        y_m += along * math.sin(yaw) + across * math.cos(yaw)
        truth[k] = x_m, y_m, z_m + rng.normal(0.0, config.sigma_climb_m), yaw, bias
        gyro[k] = gyro[k - 1] + (turn + bias * dt_s) / (1.0 - scale) + rng.normal(0.0, config.sigma_yaw_step_rad)
        error = a * error + math.sqrt(1 - a * a) * rng.normal(0.0, config.sigma_mag_rad)
        compass[k] = yaw + error
        isobar_m += rate_m_s * dt_s + rng.normal(0.0, config.sigma_weather_m * math.sqrt(dt_s))
        altitude[k] = truth[k, 2] - isobar_m + rng.normal(0.0, config.sigma_altitude_m)
    track = walk_track(truth[1:, 3], compass=compass[1:], altitude_m=altitude[1:])
    start = replace(track.steps[0], altitude_m=0.0, yaw_gyro_rad=0.0, yaw_s=-0.25)
    walked = [replace(s, yaw_gyro_rad=float(g)) for s, g in zip(track.steps[1:], gyro[1:], strict=True)]
    return StepTrack([start, *walked]), truth


def test_errors_are_what_the_sigmas_say() -> None:
    """Normalised errors of 120 walks drawn from the model: rms 1 in every state, and 3 degrees of freedom in a pose."""
    drawn = {"sigma_mag_rad": 0.1, "mag_huber": 1e3, "mag_correlation_m": 2.0, "sigma_iron_ut": 1e-3}
    config = GraphConfig(**{**QUIET.model_dump(), **drawn})
    rng = np.random.default_rng(7)
    normalised, nees = [], []
    for _ in range(120):
        track, truth = noisy_walk(rng, config, steps=30)
        seed = seed_of(track, truth[:, 3])
        t = smooth(track, seed, config, SOLVER).trajectory
        assert t.sigma_z_m is not None
        assert t.sigma_bias_rad_s is not None
        k = 25
        error = np.array([t.x_m[k], t.y_m[k], t.z_m[k], t.yaw_rad[k], t.gyro_bias_rad_s[k]]) - truth[k]
        covariance = covariance_of(t)[k]
        x, y, yaw = np.sqrt(np.diag(covariance))
        normalised.append(error / [x, y, t.sigma_z_m[k], yaw, t.sigma_bias_rad_s[k]])
        pose = error[[0, 1, 3]]
        nees.append(pose @ np.linalg.solve(covariance, pose))
    rms = np.sqrt((np.array(normalised) ** 2).mean(axis=0))
    assert np.all((rms > 0.85) & (rms < 1.15)), rms
    assert 2.5 < np.mean(nees) < 3.5


def test_a_straight_walk_is_known_in_closed_form() -> None:
    """Without a compass: along, steps add up; across, 1e-3 of yaw and the gyroscope's random walk."""
    yaw = np.zeros(30)
    config = QUIET.model_copy(update={"sigma_bias_rad_s": 1e-6, "sigma_bias_walk_rad_s": 1e-6})
    result = smoothed(walk_track(yaw), yaw, config).trajectory
    assert np.allclose(result.xy_m, 0.7 * np.outer(np.arange(31), (1, 0)), atol=1e-6)
    k = np.arange(31)
    covariance = covariance_of(result)
    yaw_variance = 1e-6 + k * 0.02**2
    # along, a turned step falls short by L (1 - cos yaw), all of them the same way: E (1 - cos yaw)² = ¾ var²
    bent = (0.7 * np.sqrt(0.75) * np.cumsum(yaw_variance * (k > 0))) ** 2
    assert np.allclose(covariance[:, 0, 0], 1e-6 + k * (0.08 * 0.7) ** 2 + bent, rtol=1e-2)
    assert np.allclose(covariance[:, 2, 2], yaw_variance, rtol=1e-2)
    # y_k = Σ L yaw_j, yaw_j = yaw_0 + Σ w: the w of step i turns the k - i + 1 steps from it on
    across = 1e-6 + k * 0.05**2 + 0.49 * (k**2 * 1e-6 + 0.02**2 * k * (k + 1) * (2 * k + 1) / 6)
    assert np.allclose(covariance[:, 1, 1], across, rtol=1e-2)
    assert result.sigma_z_m is not None
    assert np.allclose(result.sigma_z_m**2, 1e-6 + k * 0.12**2, rtol=1e-6)


def test_a_square_is_a_square_and_its_yaw_unwrapped() -> None:
    yaw = np.repeat(np.radians([0.0, 90.0, 180.0, 270.0, 360.0]), 10)
    track = walk_track(yaw, compass=np.angle(np.exp(1j * yaw)))
    result = smoothed(track, yaw).trajectory
    corners = [(7, 0), (7, 7), (0, 7), (0, 0), (7, 0)]
    assert np.allclose(result.xy_m[[10, 20, 30, 40, 50]], corners, atol=1e-4)
    assert np.allclose(result.yaw_rad[1:], yaw, atol=1e-5)


def test_who_marks_time_stays_at_the_origin_and_keeps_altitude() -> None:
    yaw = np.linspace(0.0, 1.0, 8)
    track = walk_track(yaw, length_m=0.001, altitude_m=np.full(8, 300.0))
    result = smoothed(track, yaw).trajectory
    assert np.allclose(result.xy_m, 0.0, atol=0.008)
    assert np.allclose(result.z_m, 0.0, atol=1e-9)


def test_the_bias_is_what_the_gyroscope_adds_to_the_compass() -> None:
    yaw = np.zeros(200)
    track = walk_track(yaw, compass=yaw, bias_rad_s=0.006)
    config = QUIET.model_copy(update={"sigma_bias_rad_s": 0.1, "sigma_mag_rad": 0.01})
    result = smoothed(track, yaw, config).trajectory
    assert result.gyro_bias_rad_s[100] == pytest.approx(0.006, abs=3e-4)


def test_a_turned_compass_turns_the_walk_and_its_ellipses() -> None:
    yaw, turn = np.linspace(0.0, 4.0, 40), 0.8
    plain = smoothed(walk_track(yaw, compass=yaw), yaw).trajectory
    turned = smoothed(walk_track(yaw + turn, compass=yaw + turn), yaw + turn).trajectory
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert np.allclose(turned.xy_m, plain.xy_m @ rotation[:2, :2].T, atol=1e-5)
    assert np.allclose(covariance_of(turned), rotation @ covariance_of(plain) @ rotation.T, atol=1e-5)


def test_later_is_the_same() -> None:
    yaw = np.linspace(0.0, 4.0, 40)
    track = walk_track(yaw, compass=yaw, bias_rad_s=0.01)
    later = StepTrack([replace(s, t_s=s.t_s + 1e4, yaw_s=s.yaw_s + 1e4) for s in track.steps])
    a, b = smoothed(track, yaw).trajectory, smoothed(later, yaw).trajectory
    assert np.allclose(a.xy_m, b.xy_m, atol=1e-6)
    assert np.allclose(b.t_s - a.t_s, 1e4)


def test_the_solver_says_what_it_did() -> None:
    yaw = np.linspace(0.0, 4.0, 40)
    track = walk_track(yaw, compass=yaw, altitude_m=np.full(40, 300.0))
    before = threading.stack_size()
    closures = (Closure(3, 30, 1.0, 1.0),)
    result = smooth(track, seed_of(track, np.zeros(41)), QUIET, SOLVER, None, closures)
    assert threading.stack_size() == before
    assert (
        result.factors == 6 + 40 * 7 + 2
    )  # start, iron; length, heading, bias, climb, weather, compass, barometer; closure, aside
    assert result.closures == closures
    assert result.iterations == len(result.errors) - 1 >= 2
    assert np.all(np.diff(result.errors) <= 1e-6)  # the weights of a second pass are of another linearisation
    free = smooth(track, seed_of(track, np.zeros(41)), QUIET, SOLVER)
    assert free.errors[0] == pytest.approx(free.errors[-1], rel=1e-3)  # headings are solved before
    few = smooth(track, seed_of(track, np.zeros(41)), QUIET, SolverConfig(max_iterations=1))
    assert few.iterations == 1


def test_a_seed_that_is_no_place_is_an_estimation_error() -> None:
    track = walk_track(np.zeros(5))
    with pytest.raises(EstimationError, match="the smoother"):
        smooth(track, seed_of(track, np.full(6, np.nan)), QUIET, SOLVER)


def test_a_way_back_is_tied_and_a_way_out_left_as_it_is() -> None:
    """Back on the same corridor with a drifting gyroscope: tied, the end is at the start again."""
    config, bias = Config(step_length=HALF_A_METRE), 0.002
    # turns to the right by more than half a circle in one step, which unwraps to the left
    yaw = np.repeat([0.0, 1.5, 1.5 - 3.5, 1.5 - math.pi, -math.pi], (60, 60, 1, 59, 60))
    track = walk_track(yaw, bias_rad_s=bias)
    facing = np.concatenate((yaw[:1], yaw))
    alone = smooth(track, seed_of(track, facing), config.graph, SOLVER)
    tied, turned = tie_way_back(alone, track, seed_of(track, facing), config)
    assert turned is not None
    assert abs(turned.breadcrumb - 120) <= 4
    assert len(tied.closures) >= 2
    assert all(abs(c.i + c.j - 240) <= 6 for c in tied.closures)
    off = [float(np.hypot(*s.trajectory.xy_m[-1])) for s in (alone, tied)]
    assert off[1] < 1.0 < off[0]
    assert math.cos(tied.trajectory.yaw_rad[-1]) < -0.95
    out = walk_track(yaw[:120])
    only = smooth(out, seed_of(out, facing[:121]), config.graph, SOLVER)
    assert tie_way_back(only, out, seed_of(out, facing[:121]), config) == (only, None)


def test_the_weather_that_cannot_be_seen_is_added_to_sigma_z() -> None:
    """1 hPa an hour or so: 2 mm/s for as long as it lasts; none where no barometer is."""
    t_s = 100.0 + np.array([0.0, 600.0, 36_000.0, 1e7])
    config = GraphConfig(sigma_weather_m_s=0.002, weather_turns_s=36_000.0)
    expected = [0.0, 72.0 * (1.0 - math.exp(-1.0 / 60.0)), 72.0 * (1.0 - math.exp(-1.0)), 72.0]
    assert weather_sigma_m(t_s, config) == pytest.approx(expected)
    yaw = np.zeros(200)
    track = walk_track(yaw, altitude_m=np.full(200, 300.0))
    none, some = (
        smoothed(track, yaw, QUIET.model_copy(update={"sigma_weather_m_s": rate})).trajectory.sigma_z_m
        for rate in (0.0, 0.01)
    )
    assert none is not None
    assert some is not None
    assert np.allclose(some**2 - none**2, (0.01 * track.t_s) ** 2, rtol=0.01, atol=1e-6)


def test_what_pressure_does_during_a_long_rest_is_the_weather() -> None:
    """Ten minutes between two steps and two metres more: a sigma of 0.49 m for the weather, of 0.12 m for a step."""
    yaw = np.zeros(60)
    altitude = np.where(np.arange(60) < 30, 300.0, 302.0)
    track = walk_track(yaw, altitude_m=altitude)
    late = [
        replace(s, t_s=s.t_s + 600.0 * (k > 30), yaw_s=s.yaw_s + 600.0 * (k > 30)) for k, s in enumerate(track.steps)
    ]
    config = QUIET.model_copy(update={"sigma_altitude_m": 0.05})
    rested = smoothed(StepTrack(late), yaw, config).trajectory
    assert abs(rested.z_m[-1] - rested.z_m[20]) < 0.5
    assert rested.sigma_z_m is not None
    assert rested.sigma_z_m[-1] > 0.4
    walked = smoothed(track, yaw, config).trajectory
    assert walked.z_m[-1] == pytest.approx(2.0, abs=0.3)
