# ruff: noqa: PD011  (``values`` of a Stream, not of a DataFrame)
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from fbgraph.core.checkpoints import read_checkpoints
from fbgraph.core.config import DeviceConfig
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.geometry import BoolArray, rotate, wrap_angle
from fbgraph.readers import read_log
from fbgraph.simulator.files import write_m5stickc_csv, write_truth_csv
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import ROUTE_NAMES, load_route
from fbgraph.simulator.simulate import (
    GRAVITY_M_S2,
    Device,
    Environment,
    Inertial,
    SensorErrors,
    SimulatedWalk,
    SimulateOptions,
    simulate,
)

METRONOME = Walker(alpha_m=0.7, beta_m_s=0.0, gamma_m=0.0, gait_variation=0.0)


def perfect(route: str = "square", **options: Any) -> SimulatedWalk:
    return simulate(load_route(route), SimulateOptions(noise=0.0, **options), seed=3)


def attitude(walk: SimulatedWalk) -> Rotation:
    return Rotation.from_quat(np.roll(walk.quat_wxyz, -1, axis=1))


def still(walk: SimulatedWalk) -> BoolArray:
    start_s = walk.checkpoints.t_s[0] - walk.log.t0_s
    return np.asarray(walk.log.acc.t_s < start_s)


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
        accel = attitude(walk).apply(walk.log.acc.values) - (0.0, 0.0, GRAVITY_M_S2)
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
        assert np.linalg.norm(walk.log.acc.values[rest], axis=1) == pytest.approx(GRAVITY_M_S2, abs=1e-9)
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


TURNS_DEG = {
    "obstacle": [-45, -90, 90],
    "square": [90, 90, 90],
    "straight": [],
    "eight": [-45, -90, -90, -45, 45, 90, 90, 45],
    "out-and-back": [90, -90, -90, 90, -180, -90, 90, 90, -90],
    "stairs": [90, -90, -180, 90, -90],
}


class TestRoutes:
    @pytest.mark.parametrize("route", ROUTE_NAMES)
    def test_turns(self, route: str) -> None:
        walk = perfect(route)
        assert np.degrees(walk.turns.angle_rad) == pytest.approx(TURNS_DEG[route])
        assert (np.diff(walk.turns.t_s) > 0).all()
        assert np.degrees(walk.yaw_rad[-1] - walk.yaw_rad[0]) == pytest.approx(sum(TURNS_DEG[route]), abs=1e-6)
        assert np.interp(walk.turns.t_s, walk.t_s, walk.x_m) == pytest.approx(walk.turns.x_m, abs=1e-3)

    @pytest.mark.parametrize("route", ROUTE_NAMES)
    def test_starts_at_the_origin_and_ends_at_its_end(self, route: str) -> None:
        walk = perfect(route)
        end = load_route(route).waypoints_m[-1]
        assert (walk.x_m[0], walk.y_m[0], walk.z_m[0]) == (0.0, 0.0, 0.0)
        assert (walk.x_m[-1], walk.y_m[-1], walk.z_m[-1]) == pytest.approx(tuple(end), abs=1e-6)
        assert load_route(route).closed == (route not in ("straight", "obstacle"))

    def test_obstacle_is_as_in_the_paper(self) -> None:
        walks = [simulate(load_route("obstacle"), SimulateOptions(noise=0.0), seed) for seed in range(36)]
        seconds = [walk.checkpoints.t_s[-1] - walk.checkpoints.t_s[0] for walk in walks]
        assert np.mean(seconds) == pytest.approx(11.8, abs=0.2)  # 42,474 samples in 36 trials
        assert walks[0].labels == ("A", "B", "C", "D", "E")
        assert [event.label for event in walks[0].log.events] == list("ABCDE")

    def test_laps(self) -> None:
        walk = simulate(load_route("square", laps=3), SimulateOptions(noise=0.0))
        assert np.degrees(walk.turns.angle_rad) == pytest.approx([90] * 11)
        assert np.hypot(walk.x_m[-1], walk.y_m[-1]) < 1e-6
        assert len(walk.checkpoints) == 13
        to_and_fro = simulate(load_route("straight", laps=2), SimulateOptions(noise=0.0))
        assert np.abs(np.degrees(to_and_fro.turns.angle_rad)) == pytest.approx([180])
        assert to_and_fro.x_m[-1] == pytest.approx(0.0, abs=1e-6)

    def test_duration(self) -> None:
        walk = simulate(load_route("square"), SimulateOptions(noise=0.0, duration_s=300.0))
        assert walk.log.duration_s == pytest.approx(300.0, abs=17.0)
        assert np.hypot(walk.x_m[-1], walk.y_m[-1]) < 1e-6
        assert simulate(load_route("square"), SimulateOptions(duration_s=1.0)).log.duration_s > 30.0

    def test_pause_at_the_far_end(self) -> None:
        walk = perfect("out-and-back")
        standing = np.hypot(np.gradient(walk.x_m), np.gradient(walk.y_m)) < 1e-9
        far = (walk.x_m > 31.9) & standing
        assert 30.0 < far.sum() / 100 < 33.0
        rest = far & (walk.t_s > walk.t_s[far][0] + 1.0) & (walk.t_s < walk.t_s[far][0] + 29.0)
        assert np.linalg.norm(walk.log.acc.values[rest], axis=1) == pytest.approx(GRAVITY_M_S2, abs=1e-9)

    def test_file(self, tmp_path: Path) -> None:
        path = tmp_path / "garden.csv"
        path.write_text("# my garden\nx_m, y_m, pause_s\n5,5,4\n15,5,2\n15,12,0\n")
        route = load_route(str(path))
        assert route.waypoints_m.tolist() == [[0, 0, 0], [10, 0, 0], [10, 7, 0]]
        walk = simulate(route, SimulateOptions(noise=0.0))
        assert walk.log.name == "garden-0"
        assert walk.steps.t_s[0] > 7.0
        assert np.degrees(walk.turns.angle_rad) == pytest.approx([90])
        assert (walk.checkpoints.x_m[1], walk.checkpoints.y_m[1]) == pytest.approx((10.0, 0.0))

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "not a readable route"),
            ("x_m,y_m\n", "no waypoint"),
            ("x_m,y_m\n0,0\n", "at least two"),
            ("x,y\n0,0\n1,1\n", "no column x_m, y_m"),
            ("x_m,y_m,speed\n0,0,1\n5,0,1\n", "unknown column speed"),
            ("x_m,y_m\n0,0\n5,five\n", "row 2 after the header: y_m is not a number"),
            ("x_m,y_m\n0,0\n5,\n", "row 2 after the header: y_m"),
            ("x_m,y_m\n0,0\n5,0\n5,0\n", "waypoints 2 and 3"),
            ("x_m,y_m,z_m\n0,0,0\n1,0,9\n", "too steep"),
            ("x_m,y_m,pause_s\n0,0,-1\n5,0,0\n", "negative pause"),
            ("x_m,y_m\n0,0\ninf,0\n", "not a number"),
        ],
    )
    def test_bad_files(self, tmp_path: Path, text: str, message: str) -> None:
        path = tmp_path / "route.csv"
        path.write_text(text)
        with pytest.raises(DataError, match=message) as caught:
            load_route(str(path))
        assert str(path) in str(caught.value)

    def test_binary_file(self, tmp_path: Path) -> None:
        path = tmp_path / "route.csv"
        path.write_bytes(bytes(range(256)))
        with pytest.raises(DataError, match=r"route\.csv"):
            load_route(str(path))


class TestOptions:
    def test_unknown_route(self) -> None:
        with pytest.raises(ConfigError, match="neither obstacle, square"):
            load_route("labyrinth")

    @pytest.mark.parametrize("kwargs", [{"laps": 0}, {"scale": 0.0}, {"scale": float("nan")}])
    def test_impossible_routes(self, kwargs: dict[str, Any]) -> None:
        with pytest.raises(ConfigError):
            load_route("square", **kwargs)

    @pytest.mark.parametrize(
        ("section", "kwargs"),
        [
            (Walker, {"cadence_hz": 0.0}),
            (Walker, {"cadence_hz": float("nan")}),
            (Walker, {"gait_variation": -1.0}),
            (Walker, {"alpha_m": -0.4}),
            (Walker, {"gamma_m": 1.0}),
            (Walker, {"shake_s": 1.0}),
            (Device, {"tilt_deg": 90.0}),
            (Device, {"rate_hz": 1000.0}),
            (Device, {"mag_rate_hz": 0.0}),
            (SensorErrors, {"mag_noise_ut": -1.0}),
            (Environment, {"pressure_hpa": 100800.0}),
            (SimulateOptions, {"noise": -1.0}),
            (SimulateOptions, {"anomalies": float("inf")}),
            (SimulateOptions, {"duration_s": 0.0}),
        ],
    )
    def test_impossible_options(self, section: type, kwargs: dict[str, float]) -> None:
        with pytest.raises(ConfigError):
            section(**kwargs)

    def test_too_long(self) -> None:
        with pytest.raises(ConfigError, match="at most a day"):
            simulate(load_route("square"), SimulateOptions(duration_s=1e6))

    def test_negative_seed(self) -> None:
        with pytest.raises(ConfigError, match="seed"):
            simulate(load_route("square"), seed=-1)


def same(first: SimulatedWalk, second: SimulatedWalk) -> bool:
    streams = ("acc", "gyro", "mag", "pressure")
    return all(
        np.array_equal(getattr(first.log, s).values, getattr(second.log, s).values)
        and np.array_equal(getattr(first.log, s).t_s, getattr(second.log, s).t_s)
        for s in streams
    )


class TestSensors:
    def test_seeds(self) -> None:
        route = load_route("square")
        assert same(simulate(route, seed=1), simulate(route, seed=1))
        assert not same(simulate(route, seed=1), simulate(route, seed=2))

    def test_noise_leaves_the_walk_alone(self) -> None:
        noisy, clean = simulate(load_route("square"), seed=3), perfect()
        assert np.array_equal(noisy.device_m, clean.device_m)
        assert noisy.log.acc.values.shape[0] <= len(noisy.t_s)

    def test_resolution(self) -> None:
        log = simulate(load_route("obstacle"), seed=1).log
        steps = {"acc": 8 * GRAVITY_M_S2 / 2**15, "gyro": np.radians(2000) / 2**15, "mag": 0.3, "pressure": 0.0016}
        for name, step in steps.items():
            counts = getattr(log, name).values / step
            assert np.abs(counts - np.round(counts)).max() < 1e-4
        assert (np.abs(log.acc.t_s * 1000 - np.round(log.acc.t_s * 1000)) < 1e-6).all()

    def test_saturation(self) -> None:
        quiet = Inertial(noise=0.0, bias=0.0, bias_walk=0.0, scale=0.0, full_scale=10.0)
        options = SimulateOptions(errors=SensorErrors(acc=quiet, gyro=dataclasses.replace(quiet, full_scale=0.2)))
        log = simulate(load_route("square"), options, seed=1).log
        assert log.acc.values.max() == pytest.approx(10.0, abs=1e-3)
        assert log.gyro.values.min() == -0.2
        clean = simulate(load_route("square"), dataclasses.replace(options, noise=0.0), seed=1).log
        assert np.abs(clean.gyro.values).max() > 0.2

    def test_noise_statistics(self) -> None:
        walker = Walker(start_hold_s=300.0, tremor_deg=0.0)
        walks = [simulate(load_route("obstacle"), SimulateOptions(walker=walker, anomalies=0.0), s) for s in range(12)]
        errors, log = SensorErrors(), walks[0].log
        rest = still(walks[0])
        for stream, spec in ((log.acc, errors.acc), (log.gyro, errors.gyro)):
            sigma = np.hypot(spec.noise, spec.full_scale / 2**15 / 12**0.5)  # and rounding
            assert np.diff(stream.values[rest], axis=0).std() / 2**0.5 == pytest.approx(sigma, rel=0.02)
        assert np.diff(log.mag.values[log.mag.t_s < 300], axis=0).std() / 2**0.5 == pytest.approx(0.41, rel=0.05)
        hold = log.pressure.values[log.pressure.t_s < 300]
        assert np.diff(hold, axis=0).std() / 2**0.5 == pytest.approx(0.013, rel=0.05)
        biases = [walk.log.gyro.values[still(walk)].mean(axis=0) for walk in walks]
        assert np.std(biases) == pytest.approx(errors.gyro.bias, rel=0.35)  # 36 draws: 12 % is one sigma
        intervals_ms = np.diff(log.acc.t_s) * 1000
        assert np.median(intervals_ms) == pytest.approx(10.0)
        assert 1.2 < intervals_ms[intervals_ms < 15].std() < 1.8  # two jitters of 1 ms, and rounding
        rows = sum(walk.log.counts["rows"] for walk in walks)
        assert sum(walk.log.counts["missing"] for walk in walks) / rows == pytest.approx(0.0005, rel=0.3)

    def test_bias_walks(self) -> None:
        spec = Inertial(noise=0.0, bias=0.0, bias_walk=0.01, scale=0.0, full_scale=100.0)
        walker = Walker(start_hold_s=100.0, tremor_deg=0.0)
        options = SimulateOptions(walker=walker, errors=SensorErrors(gyro=spec))
        ends = [simulate(load_route("obstacle"), options, seed).log.gyro.values[9900] for seed in range(12)]
        assert np.std(ends) == pytest.approx(0.01 * 99.0**0.5, rel=0.4)

    def test_rates(self) -> None:
        log = simulate(load_route("square"), SimulateOptions(duration_s=120.0), seed=1).log
        for stream, rate_hz in ((log.acc, 100.0), (log.mag, 22.0), (log.pressure, 12.0)):
            assert (len(stream) - 1) / np.ptp(stream.t_s) == pytest.approx(rate_hz, rel=0.02)
            assert (np.diff(stream.t_s) > 0).all()
        assert np.isin(log.mag.t_s, log.acc.t_s).all()
        assert log.acc.t_s[0] == 0.0

    def test_slow_rates_and_odd_ones(self) -> None:
        log = simulate(load_route("square"), SimulateOptions(device=Device(rate_hz=30.0, mag_rate_hz=50.0)), seed=1).log
        assert len(log.mag) == len(log.acc)
        assert log.acc.rate_hz == pytest.approx(30.0, rel=0.05)

    def test_earth_field(self) -> None:
        walk = perfect(environment=Environment(declination_deg=10.0, dip_deg=50.0))
        rows = np.searchsorted(walk.t_s, walk.log.mag.t_s)
        mag_n = rotate(walk.quat_wxyz[rows], walk.log.mag.values)
        level = 45.0 * np.cos(np.radians(50))
        east, north = level * np.sin(np.radians(10)), level * np.cos(np.radians(10))
        assert mag_n == pytest.approx(np.tile([east, north, -45.0 * np.sin(np.radians(50))], (len(mag_n), 1)))

    def test_barometer(self) -> None:
        log = perfect("stairs").log
        pressure = log.pressure.values[:, 0]
        assert pressure[0] == pytest.approx(1008.0)
        assert pressure.max() - pressure[0] == pytest.approx(3.0 * 0.1197, rel=0.02)  # 0.12 hPa a metre at 1008 hPa

    def test_iron_stays_where_it_is(self) -> None:
        """What iron adds is the same, in the world frame, each time the same place is passed."""
        errors = SensorErrors(mag_noise_ut=0.0, hard_iron_ut=0.0, mag_step_ut=0.0)
        route = load_route("out-and-back")
        walks = [simulate(route, SimulateOptions(errors=errors, anomalies=a), seed=4) for a in (1.0, 0.0, 2.0)]
        with_iron, without, twice = (walk.log.mag for walk in walks)
        log, truth = walks[0].log, walks[0]
        quat = np.column_stack([np.interp(log.mag.t_s, truth.t_s, q) for q in truth.quat_wxyz.T])
        added = rotate(quat, with_iron.values - without.values)
        assert twice.values - without.values == pytest.approx(2 * (with_iron.values - without.values))
        assert 4.0 < np.abs(added[:, :2]).max() < 25.0
        x_m = np.interp(log.mag.t_s, truth.t_s, truth.x_m)
        y_m = np.interp(log.mag.t_s, truth.t_s, truth.y_m)
        walking = np.append(np.hypot(np.diff(x_m), np.diff(y_m)) > 0.02, False)
        far_s = log.mag.t_s[np.argmax(x_m)]
        out, back = walking & (log.mag.t_s < far_s), walking & (log.mag.t_s > far_s + 29)
        apart = np.hypot(x_m[out][:, None] - x_m[back], y_m[out][:, None] - y_m[back])
        near = apart.argmin(axis=1)
        same_place = apart.min(axis=1) < 0.02
        assert same_place.sum() > 100
        difference = added[out][same_place] - added[back][near[same_place]]
        assert np.abs(difference).max() < 1.5
        assert np.std(added) > 3 * np.std(difference)

    def test_iron_bends_the_compass(self) -> None:
        worst = []
        for seed in range(6):
            walk = simulate(load_route("square"), seed=seed)
            quat = np.column_stack([np.interp(walk.log.mag.t_s, walk.t_s, q) for q in walk.quat_wxyz.T])
            mag_n = rotate(quat, walk.log.mag.values)
            worst.append(np.degrees(np.abs(np.arctan2(-mag_n[:, 0], mag_n[:, 1]))).max())
        assert 5.0 < np.median(worst) < 45.0


class TestFiles:
    def test_m5stickc_csv(self, tmp_path: Path) -> None:
        log = simulate(load_route("obstacle"), seed=2).log
        write_m5stickc_csv(log, tmp_path / "walk.csv")
        table = pd.read_csv(tmp_path / "walk.csv")
        assert ",".join(table.columns) == (
            "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa,temp_c,event"
        )
        assert table["t_ms"].dtype == np.int64
        assert table["t_ms"].to_numpy() / 1000 == pytest.approx(log.acc.t_s + log.t0_s)
        acc, gyro, mag = (
            table[list(names)].to_numpy()
            for names in (("ax_g", "ay_g", "az_g"), ("gx_dps", "gy_dps", "gz_dps"), ("mx_ut", "my_ut", "mz_ut"))
        )
        assert acc * GRAVITY_M_S2 == pytest.approx(log.acc.values, abs=1e-5)
        assert np.radians(gyro) == pytest.approx(log.gyro.values, abs=1e-7)
        assert mag[~np.isnan(mag[:, 0])] == pytest.approx(log.mag.values, abs=1e-4)
        assert table["p_hpa"].dropna().to_numpy() == pytest.approx(log.pressure.values[:, 0], abs=1e-5)
        assert table["event"].dropna().tolist() == ["A", "B", "C", "D", "E"]

    @pytest.mark.parametrize("noise", [0.0, 1.0])
    def test_reads_back(self, tmp_path: Path, noise: float) -> None:
        log = simulate(load_route("obstacle"), SimulateOptions(noise=noise), seed=2).log
        write_m5stickc_csv(log, tmp_path / "walk.csv")
        back = read_log(tmp_path / "walk.csv").log
        assert back.format == log.format
        assert back.t0_s == pytest.approx(log.t0_s)
        assert back.acc.t_s == pytest.approx(log.acc.t_s)
        assert back.acc.values == pytest.approx(log.acc.values, abs=1e-5)
        assert back.gyro.values == pytest.approx(log.gyro.values, abs=1e-7)
        assert [event.label for event in back.events] == list("ABCDE")
        assert [event.t_s for event in back.events] == pytest.approx([event.t_s for event in log.events])

    def test_odd_labels_and_clocks(self, tmp_path: Path) -> None:
        walk = simulate(load_route("obstacle"), SimulateOptions(noise=0.0, device=Device(rate_hz=60.0)))
        first, *others = walk.log.events
        log = dataclasses.replace(walk.log, events=(dataclasses.replace(first, label='the "door", left'), *others))
        write_m5stickc_csv(log, tmp_path / "walk.csv")
        table = pd.read_csv(tmp_path / "walk.csv")
        assert table["event"].dropna().iloc[0] == "the 'door', left"
        assert table["t_ms"].to_numpy() / 1000 == pytest.approx(log.acc.t_s + log.t0_s, abs=1e-6)
        late = dataclasses.replace(log.gyro, t_s=log.gyro.t_s + 0.001)
        with pytest.raises(DataError, match="clocks of their own"):
            write_m5stickc_csv(dataclasses.replace(log, gyro=late), tmp_path / "other.csv")

    def test_truth_csv(self, tmp_path: Path) -> None:
        walk = simulate(load_route("stairs"), seed=2)
        write_truth_csv(walk, tmp_path / "truth.csv")
        places = read_checkpoints(tmp_path / "truth.csv")
        assert (np.diff(places.t_s) >= 0).all()
        t_s = places.t_s - walk.log.t0_s
        for found, truth in ((places.x_m, walk.x_m), (places.y_m, walk.y_m), (places.z_m, walk.z_m)):
            assert found == pytest.approx(np.interp(t_s, walk.t_s, truth), abs=2e-3)
        table = pd.read_csv(tmp_path / "truth.csv")
        steps, turns = table.dropna(subset="step"), table.dropna(subset="turn_rad")
        assert steps["step"].tolist() == list(range(1, len(walk.steps.t_s) + 1))
        assert steps["length_m"].to_numpy() == pytest.approx(walk.steps.length_m, abs=1e-4)
        assert turns["turn_rad"].to_numpy() == pytest.approx(walk.turns.angle_rad, abs=1e-6)

    def test_checkpoints_are_on_the_event_clock(self) -> None:
        walk = simulate(load_route("square"), SimulateOptions(device=Device(clock_start_s=77.0)), seed=1)
        assert walk.log.t0_s == 77.0
        assert walk.checkpoints.t_s[0] == pytest.approx(80.0)
        t_s = walk.checkpoints.t_s - 77.0
        assert np.interp(t_s, walk.t_s, walk.x_m) == pytest.approx(walk.checkpoints.x_m, abs=1e-3)
        corners = load_route("square").waypoints_m[:, :2]
        assert np.hypot(*(walk.checkpoints.xy_m - corners).T).max() < 0.45
        assert [event.t_s for event in walk.log.events] == pytest.approx(t_s, abs=0.02)
