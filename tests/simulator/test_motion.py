"""The simulated motion: a walker, and a device that moves with him."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.simulated import METRONOME, attitude, perfect, still

from fbgraph.core.config import DeviceConfig
from fbgraph.core.geometry import rotate, wrap_angle
from fbgraph.core.units import STANDARD_GRAVITY_M_S2
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import ROUTE_NAMES, load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import Device, SimulateOptions


class TestMotion:
    @pytest.mark.parametrize("shake_s", [0.0, 12.0])
    def test_gyroscope_integrates_to_the_attitude(self, shake_s: float) -> None:
        walk = perfect("out-and-back", walker=Walker(shake_s=shake_s), device=Device(rate_hz=200))
        truth, gyro, dt = attitude(walk), walk.log.gyro.values, 1 / 200
        turn = truth[0]
        for increment in Rotation.from_rotvec((gyro[1:] + gyro[:-1]) / 2 * dt):
            turn = turn * increment
        assert np.degrees((turn.inv() * truth[-1]).magnitude()) < (0.05 if shake_s == 0 else 1.0)
        assert wrap_angle(np.array([walk.yaw_rad[-1] - walk.yaw_rad[0] - np.pi]))[0] == pytest.approx(0.0)

    def test_accelerometer_is_the_second_derivative_of_the_motion(self) -> None:
        walk = perfect("stairs", device=Device(rate_hz=200))
        accel = attitude(walk).apply(walk.log.acc.values) - (0.0, 0.0, STANDARD_GRAVITY_M_S2)
        p = walk.device_m
        second = (16 * (p[1:-3] + p[3:-1]) - 30 * p[2:-2] - p[:-4] - p[4:]) * 200**2 / 12
        assert np.percentile(np.abs(second - accel[2:-2]), 98) < 1e-3
        assert np.abs(second - accel[2:-2]).max() < 0.1  # where the jerk jumps, between two steps
        velocity = np.cumsum(accel, axis=0) / 200
        place = np.cumsum(velocity, axis=0) / 200
        assert np.abs(place - walk.device_m).max() < 0.05

    def test_device_moves_about_the_walker(self) -> None:
        walk = perfect()
        offset = walk.device_m - np.column_stack((walk.x_m, walk.y_m, walk.z_m))
        assert np.abs(offset).max() < 0.05
        assert np.abs(offset[still(walk)]).max() < 1e-12
        norm = np.linalg.norm(walk.log.acc.values, axis=1)
        assert 1.0 < norm[800:2500].std() < 2.0  # the hand-held walks of RIDI: 1.35 to 1.37
        assert 11.5 < np.percentile(norm, 99) < 15.0

    def test_truth_is_smooth(self) -> None:
        walk = perfect("out-and-back")
        xyz_m = np.column_stack((walk.x_m, walk.y_m, walk.z_m))
        accel = np.diff(xyz_m, 2, axis=0) * 100**2
        assert np.abs(accel).max() < 8.0
        assert np.abs(np.diff(accel, axis=0)).max() < 1.0  # no jump of acceleration from one sample to the next
        velocity = np.gradient(xyz_m[:, :2], 0.01, axis=0)
        moving = np.hypot(*velocity.T) > 0.5
        direction = np.arctan2(velocity[moving, 1], velocity[moving, 0])
        assert np.degrees(np.abs(wrap_angle(direction - walk.yaw_rad[moving]))).max() < 12.0

    def test_at_rest(self) -> None:
        walk = perfect()
        rest = still(walk)
        assert rest.sum() == 300
        assert np.linalg.norm(walk.log.acc.values[rest], axis=1) == pytest.approx(STANDARD_GRAVITY_M_S2, abs=1e-9)
        assert np.linalg.norm(walk.log.mag.values, axis=1) == pytest.approx(45.0)
        assert np.abs(walk.log.gyro.values[rest]).max() < 0.1

    def test_metronome_stands_perfectly_still(self) -> None:
        walk = perfect(walker=METRONOME)
        assert np.abs(walk.log.gyro.values[still(walk)]).max() < 1e-12

    @pytest.mark.parametrize("tilt_deg", [0.0, 20.0, 45.0])
    def test_default_mount_points_forward(self, tilt_deg: float) -> None:
        walk = perfect(walker=METRONOME, device=Device(tilt_deg=tilt_deg))
        forward = rotate(walk.quat_wxyz, np.array(DeviceConfig().mount))
        off = wrap_angle(np.arctan2(forward[:, 1], forward[:, 0]) - walk.yaw_rad)
        assert abs(np.degrees(off.mean())) < 0.2
        assert np.degrees(np.abs(off)).max() < 5.0

    def test_mount_yaw_turns_the_device_to_the_left(self) -> None:
        walk = perfect(walker=METRONOME, device=Device(mount_yaw_deg=30.0, tilt_deg=0.0))
        top = rotate(walk.quat_wxyz[:1], np.array([0.0, 1.0, 0.0]))[0]
        assert np.degrees(np.arctan2(top[1], top[0])) == pytest.approx(30.0)

    def test_shaking_comes_before_the_walk_and_leaves_no_trace(self) -> None:
        walk = perfect(walker=Walker(shake_s=20.0))
        assert walk.checkpoints.t_s[0] - walk.log.t0_s == 23.0
        shaking = walk.t_s < 20.0
        assert np.degrees(walk.log.gyro.values[shaking].std(axis=0)).min() > 80.0
        assert np.linalg.norm(walk.log.acc.values[shaking], axis=1).std() > 2.0
        assert np.ptp(walk.yaw_rad[shaking]) == pytest.approx(4 * np.pi)
        assert len(walk.turns.t_s) == 3


class TestSteps:
    def test_constant_steps(self) -> None:
        walk = simulate(load_route("straight", scale=1.4), SimulateOptions(walker=METRONOME, noise=0.0))
        assert walk.steps.length_m == pytest.approx(np.full(100, 0.7))
        assert walk.x_m[-1] == pytest.approx(70.0)
        assert np.diff(walk.steps.t_s)[:-1] == pytest.approx(1 / 1.8)

    @pytest.mark.parametrize("route", ROUTE_NAMES)
    def test_steps_add_up(self, route: str) -> None:
        walk = perfect(route)
        xy_m = np.column_stack((walk.x_m, walk.y_m))
        walked_m = np.hypot(*np.diff(xy_m, axis=0).T).sum()
        assert walk.steps.length_m.sum() == pytest.approx(walked_m, rel=0.003)
        assert 0.93 * load_route(route).length_m < walked_m < load_route(route).length_m + 0.1
        for column, truth in enumerate((walk.x_m, walk.y_m, walk.z_m)):
            assert np.interp(walk.steps.t_s, walk.t_s, truth) == pytest.approx(walk.steps.xyz_m[:, column], abs=1e-3)

    def test_lengths_follow_the_model(self) -> None:
        walker = Walker(length_sigma=0.0, person_sigma=0.0)
        walk = perfect("straight", walker=walker)
        cadence = 1.0 / np.diff(walk.steps.t_s)
        assert np.std(cadence[:-2]) > 0.02
        assert walk.steps.length_m[1:-2] == pytest.approx(0.35 + 0.20 * cadence[:-2], abs=1e-9)

    def test_stairs_shorten_the_step(self) -> None:
        walk = perfect("stairs", walker=dataclasses.replace(Walker(), gait_variation=0.0))
        dt, dz = np.diff(walk.steps.t_s), np.diff(walk.steps.xyz_m[:, 2])
        length = walk.steps.length_m[1:]
        on_stairs = np.isclose(np.abs(dz), length * 3.0 / 5.4, rtol=0.02)
        assert on_stairs.sum() > 25
        flat = 0.35 + 0.20 / dt[on_stairs]
        slope = np.abs(dz[on_stairs]) / dt[on_stairs] / (flat / dt[on_stairs])
        as_model = np.isclose(length[on_stairs], flat - 1.75 * slope, rtol=0.02)
        assert np.mean(as_model) > 0.9  # not the steps on and off the flight
        assert walk.z_m.min() == pytest.approx(-3.0, abs=1e-6)

    def test_variation(self) -> None:
        walk = simulate(load_route("straight", laps=40), SimulateOptions(noise=0.0), seed=2)
        cadence = 1.0 / np.diff(walk.steps.t_s)
        usual = (cadence > 1.6) & (np.roll(cadence, 1) > 1.6) & (np.roll(cadence, -1) > 1.6)
        assert np.std(np.log(cadence[usual])) == pytest.approx(0.025, rel=0.15)
        relative = walk.steps.length_m[1:] / (0.35 + 0.20 * cadence)
        assert np.std(relative[usual]) == pytest.approx(0.03, rel=0.15)

    def test_extreme_walkers_still_arrive(self) -> None:
        for walker in (Walker(gait_variation=30.0), Walker(start_hold_s=0.0, end_hold_s=0.0), Walker(cadence_hz=4.0)):
            walk = simulate(load_route("eight"), SimulateOptions(walker=walker, noise=20.0), seed=1)
            assert (walk.steps.length_m > 0).all()
            assert (np.diff(walk.steps.t_s) > 0).all()
            assert np.hypot(walk.x_m[-1], walk.y_m[-1]) < 1e-6
            assert np.isfinite(walk.log.acc.values).all()

    def test_slower_in_turns(self) -> None:
        walk = perfect("square", walker=METRONOME)
        nearest = np.searchsorted(walk.steps.t_s, walk.turns.t_s)
        assert (np.diff(walk.steps.t_s)[nearest - 1] > 1.1 / 1.8).all()
