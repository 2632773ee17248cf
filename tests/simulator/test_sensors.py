"""What the simulated sensors make of a walk: noise, bias, rates, iron."""

import dataclasses

import numpy as np
import pytest
from support.simulated import perfect, still

from fbgraph.core.geometry import rotate
from fbgraph.core.units import STANDARD_GRAVITY_M_S2
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import Device, Environment, Inertial, SensorErrors, SimulateOptions


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
        steps = {
            "acc": 8 * STANDARD_GRAVITY_M_S2 / 2**15,
            "gyro": np.radians(2000) / 2**15,
            "mag": 0.3,
            "pressure": 0.0016,
        }
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
