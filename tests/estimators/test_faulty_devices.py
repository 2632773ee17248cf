"""Simulated walks of a wearable with a fault of its own: found out, within its sigma, offline and live."""

from dataclasses import replace

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.geometry import wrap_angle
from fbgraph.estimators.batch_smoother import smooth
from fbgraph.estimators.ekf import run_ekf
from fbgraph.estimators.estimates import Smoothed
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.front_end.detect_steps import detect_steps
from fbgraph.front_end.step_track import StepTrack
from fbgraph.simulator.disturbances import mixed, offset
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import Device, SimulateOptions

CONFIG = load_config("m5stickc")


def square(laps: int = 2, seed: int = 4) -> SimulatedWalk:
    return simulate(load_route("square", laps=laps), SimulateOptions(), seed=seed)


def smoothed(walk: SimulatedWalk) -> tuple[Smoothed, StepTrack]:
    track = detect_steps(walk.log, CONFIG)[0]
    return smooth(track, run_ekf(track, CONFIG.ekf), CONFIG.graph, CONFIG.solver), track


def end_off(found: Smoothed, walk: SimulatedWalk) -> float:
    """How far the end is from where the walker was, in its own standard deviations."""
    t = found.trajectory
    assert t.cov_xy_yaw is not None
    places = walk.checkpoints
    true_m = places.xy_m[-1] - places.xy_m[0]
    off_m = t.at(places.t_s[-1:] - walk.log.t0_s)[0, :2] - true_m
    return float(np.sqrt(off_m @ np.linalg.solve(t.cov_xy_yaw[-1, :2, :2], off_m)))


def iron_off(found: Smoothed, j: int, true_ut: tuple[float, float]) -> float:
    """The same of the iron of a stretch; every magnetometer has 1 µT more of its own that nobody told."""
    assert found.device is not None
    sigma_ut = np.hypot(found.device.iron_sigma_ut[j, :2], 1.0)
    return float(np.abs((found.device.iron_ut[j, :2] - true_ut) / sigma_ut).max())


# to the right of the device and ahead of it; the compass's own axes are turned by 90 degrees, and it is tilted by 20
@pytest.mark.parametrize(
    ("iron_ut", "seen_ut"),
    [((25.0, 0.0, 0.0), (-25.0, 0.0)), ((0.0, 25.0, 0.0), (0.0, -23.5)), ((-15.0, 0.0, 0.0), (15.0, 0.0))],
)
def test_iron_in_the_device_is_found_while_walking(
    iron_ut: tuple[float, float, float], seen_ut: tuple[float, float]
) -> None:
    walk = offset(square(), "mag", np.array(iron_ut))
    smoother = OnlineSmoother(CONFIG)
    smoother.feed(walk.log)
    live = smoother.estimate()
    found = smoother.finish()
    assert iron_off(found, 0, seen_ut) < 4.0
    assert end_off(found, walk) < 4.0
    assert np.hypot(*(live.xy_m[-1] - found.trajectory.xy_m[len(live) - 1])) < 0.3


def test_a_calibration_on_the_way_is_found() -> None:
    walk = square()
    walk = offset(walk, "mag", np.array([20.0, 0.0, 0.0]), since_s=0.5 * walk.log.duration_s)
    found, track = smoothed(walk)
    (k,) = np.flatnonzero(track.jump_x_ut)
    assert (track.jump_x_ut[k], track.jump_y_ut[k]) == pytest.approx((-20.0, 0.0), abs=2.0)
    assert abs(track.t_s[k] - 0.5 * walk.log.duration_s) < 1.5
    assert found.device is not None
    assert found.device.stretch_starts.tolist() == [0, k]
    assert iron_off(found, 0, (0.0, 0.0)) < 4.0
    assert iron_off(found, 1, (-20.0, 0.0)) < 4.0
    assert end_off(found, walk) < 4.0


def test_after_twenty_minutes_of_rest_the_walk_goes_on_in_the_same_direction() -> None:
    plan = load_route("square", laps=2)
    pause_s = plan.pause_s.copy()
    pause_s[len(pause_s) // 2] = 1200.0
    walk = simulate(replace(plan, pause_s=pause_s), SimulateOptions(device=Device(rate_hz=50.0)), seed=4)
    found, track = smoothed(walk)
    k = int(np.argmax(track.rest_s))
    assert track.rest_s[k] == pytest.approx(1195.0, abs=10.0)
    assert end_off(found, walk) < 4.0
    # the turn between the steps before and after it, by the walker's own
    true_rad, shown_rad = (
        float(np.subtract(*at[::-1]))
        for at in (
            np.interp(track.yaw_s[k - 1 : k + 1], walk.t_s, walk.yaw_rad),
            found.trajectory.yaw_rad[k - 1 : k + 1],
        )
    )
    assert abs(float(wrap_angle(np.array(shown_rad - true_rad)))) < 4.0 * np.hypot(0.05, track.rest_drift_sigma_rad[k])


def test_a_gyroscope_that_shows_too_much_of_every_turn() -> None:
    walk = mixed(square(laps=3), "gyro", 1.03 * np.eye(3))
    found, _ = smoothed(walk)
    assert found.device is not None
    assert abs(found.device.gyro_scale - 0.03) < 4.0 * found.device.gyro_scale_sigma
    assert end_off(found, walk) < 4.0
