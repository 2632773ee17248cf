"""Disturbances of simulated walks: what the sensors then say, and what is still true."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.simulated import METRONOME, attitude, perfect

from fbgraph.core.atmosphere import pressure_altitude_m
from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.core.units import STANDARD_GRAVITY_M_S2
from fbgraph.simulator import disturbances as done
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import Route, load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import Device, Environment, SimulateOptions


@pytest.fixture(scope="module")
def walk() -> SimulatedWalk:
    """A square of 40 m without errors, 50 Hz, no iron."""
    return perfect("square", walker=METRONOME, device=Device(rate_hz=50.0, tilt_deg=0.0), anomalies=0.0)


@pytest.fixture(scope="module")
def rested() -> SimulatedWalk:
    """Out 20 m, a rest of a minute, and on 20 m."""
    route = Route("rested", np.array([(0, 0, 0), (20, 0, 0), (40, 0, 0)], float), np.array([0, 60.0, 0]), tuple("123"))
    return simulate(route, SimulateOptions(walker=METRONOME, device=Device(rate_hz=50.0), noise=0.0), seed=1)


def added(before: SimulatedWalk, after: SimulatedWalk, sensor: str) -> FloatArray:
    first, second = (getattr(one.log, sensor) for one in (before, after))
    assert np.array_equal(first.t_s, second.t_s)
    return np.asarray(second.values - first.values)


def untouched(before: SimulatedWalk, after: SimulatedWalk, *but: str) -> bool:
    """Whether all else of log and truth is the same."""
    sensors = [sensor for sensor in done.SENSORS if sensor not in but]
    truth = [name for name in ("x_m", "y_m", "z_m", "yaw_rad", "device_m", "quat_wxyz") if name not in but]
    return not any(added(before, after, sensor).any() for sensor in sensors) and all(
        np.array_equal(getattr(before, name), getattr(after, name)) for name in truth
    )


def test_easing_is_half_done_in_the_middle_and_at_rest_at_both_ends() -> None:
    t_s = np.array([-1.0, 2.0, 3.0, 4.0, 9.0])
    assert done.ease(t_s, 2.0, 2.0) == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0])
    ends = done.ease(np.array([2.001, 3.999]), 2.0, 2.0)
    assert ends == pytest.approx([10 * 0.0005**3, 1 - 10 * 0.0005**3], abs=1e-11)
    rate = np.diff(done.ease(np.array([2.9995, 3.0005]), 2.0, 2.0))[0] / 0.001
    assert rate == pytest.approx(1.875 / 2.0, abs=1e-5)


class TestValues:
    def test_an_offset_has_a_time(self, walk: SimulatedWalk) -> None:
        iron = np.array([15.0, -10.0, 2.0])
        after = done.offset(walk, "mag", iron, 10.0, 20.0)
        t_s, by = walk.log.mag.t_s, added(walk, after, "mag")
        there = (t_s >= 10.0) & (t_s < 20.0)
        assert by[there] == pytest.approx(np.tile(iron, (there.sum(), 1)))
        assert not by[~there].any()
        assert untouched(walk, after, "mag")
        assert added(walk, done.offset(walk, "gyro", 0.1), "gyro") == pytest.approx(0.1)

    def test_axes_are_mixed_by_rows_of_the_matrix(self, walk: SimulatedWalk) -> None:
        cyclic = np.array([(0.0, 2.0, 0.0), (0.0, 0.0, 3.0), (1.0, 0.0, 0.0)])
        before, after = walk.log.gyro.values, done.mixed(walk, "gyro", cyclic).log.gyro.values
        assert after == pytest.approx(before[:, [1, 2, 0]] * (2.0, 3.0, 1.0))

    def test_a_frozen_sensor_repeats_the_sample_before(self, walk: SimulatedWalk) -> None:
        before, after = walk.log.acc, done.frozen(walk, "acc", 10.0, 12.0).log.acc
        there = (before.t_s >= 10.0) & (before.t_s < 12.0)
        last = before.values[np.flatnonzero(there)[0] - 1]
        assert there.sum() == 100
        assert np.array_equal(after.values[there], np.tile(last, (100, 1)))
        assert np.array_equal(after.values[~there], before.values[~there])

    def test_spikes_hit_a_share(self, walk: SimulatedWalk) -> None:
        by = added(walk, done.spikes(walk, "acc", 0.2, 30.0, np.random.default_rng(1)), "acc")
        hit = by.any(axis=1)
        assert hit.mean() == pytest.approx(0.2, abs=0.03)
        assert by[hit].std() == pytest.approx(30.0, rel=0.06)

    def test_a_device_may_lack_a_sensor(self, walk: SimulatedWalk) -> None:
        log = done.without(done.without(walk, "mag"), "pressure").log
        assert log.mag.values.shape == (0, 3)
        assert log.pressure.values.shape == (0, 1)
        assert len(log.acc) == len(walk.log.acc)

    def test_a_gap_takes_the_samples_of_all_sensors_and_leaves_the_clock(self, walk: SimulatedWalk) -> None:
        log = done.gap(walk, 10.0, 5.0).log
        for sensor in done.SENSORS:
            t_s = getattr(walk.log, sensor).t_s
            kept = (t_s < 10.0) | (t_s >= 15.0)
            assert np.array_equal(getattr(log, sensor).t_s, t_s[kept])
            assert np.array_equal(getattr(log, sensor).values, getattr(walk.log, sensor).values[kept])

    def test_a_clock_that_runs_wrong_tells_the_truth_its_own_time(self, walk: SimulatedWalk) -> None:
        after = done.clock_runs(walk, 1.2)
        assert after.log.acc.t_s == pytest.approx(1.2 * walk.log.acc.t_s)
        assert after.log.t0_s == walk.log.t0_s
        assert after.t_s == pytest.approx(1.2 * walk.t_s)
        assert after.steps.t_s == pytest.approx(1.2 * walk.steps.t_s)
        assert after.turns.t_s == pytest.approx(1.2 * walk.turns.t_s)
        passed_s = after.checkpoints.t_s - after.log.t0_s
        assert passed_s == pytest.approx(1.2 * (walk.checkpoints.t_s - walk.log.t0_s))
        assert np.interp(passed_s, after.t_s, after.x_m) == pytest.approx(walk.checkpoints.x_m, abs=1e-3)
        events = [event.t_s for event in walk.log.events]
        assert [event.t_s for event in after.log.events] == pytest.approx(1.2 * np.array(events))
        assert after.steps.length_m.sum() == walk.steps.length_m.sum()
        assert np.array_equal(after.x_m, walk.x_m)


class TestAir:
    def test_weather_rises_by_the_hour(self, walk: SimulatedWalk) -> None:
        after = done.weather(walk, 3.0)
        assert added(walk, after, "pressure")[:, 0] == pytest.approx(3.0 * walk.log.pressure.t_s / 3600.0)
        assert untouched(walk, after, "pressure")

    def test_doors(self, walk: SimulatedWalk) -> None:
        t_s = walk.log.pressure.t_s
        by = added(walk, done.door_pulses(walk, [10.0, 30.0], 0.8, 1.5), "pressure")[:, 0]
        there = ((t_s >= 10.0) & (t_s < 11.5)) | ((t_s >= 30.0) & (t_s < 31.5))
        assert by == pytest.approx(0.8 * there)

    def test_wind_has_a_size_and_a_memory(self) -> None:
        t_s = np.arange(0.0, 4000.0, 0.1)
        still = perfect()
        still = dataclasses.replace(
            still, log=dataclasses.replace(still.log, pressure=Stream(t_s, np.full((len(t_s), 1), 1000.0)))
        )
        gusts = done.wind(still, 0.3, 2.0, np.random.default_rng(3)).log.pressure.values[:, 0] - 1000.0
        assert gusts.std() == pytest.approx(0.3, rel=0.05)
        for lag_s in (1.0, 2.0, 4.0):
            lag = round(10 * lag_s)
            assert (gusts[lag:] * gusts[:-lag]).mean() / gusts.var() == pytest.approx(np.exp(-lag_s / 2.0), abs=0.05)

    def test_a_lift_goes_up_in_all_that_knows_of_it(self, rested: SimulatedWalk) -> None:
        at = rested.checkpoints.t_s[1] - rested.log.t0_s + 10.0
        after = done.lift(rested, 12.0, at, 8.0)
        rise = done.ease(after.t_s, at, 8.0) * 12.0
        assert after.z_m == pytest.approx(rested.z_m + rise)
        assert after.device_m[:, 2] == pytest.approx(rested.device_m[:, 2] + rise)
        assert after.checkpoints.z_m - rested.checkpoints.z_m == pytest.approx([0.0, 0.0, 12.0])
        assert (after.steps.xyz_m - rested.steps.xyz_m)[[0, -1]].ravel() == pytest.approx([0, 0, 0, 0, 0, 12.0])
        before_m, after_m = (pressure_altitude_m(one.log.pressure.values[:, 0]) for one in (rested, after))
        assert after_m - before_m == pytest.approx(12.0 * done.ease(rested.log.pressure.t_s, at, 8.0), abs=1e-6)
        push = attitude(rested).apply(added(rested, after, "acc"))
        assert np.abs(push[:, :2]).max() < 1e-9
        t_s = rested.log.acc.t_s
        speed = np.cumsum(push[:, 2]) / 50.0
        assert speed[-1] == pytest.approx(0.0, abs=1e-6)
        assert np.interp(at + 4.0, t_s, speed) == pytest.approx(12.0 / 8.0 * 1.875, rel=0.02)
        assert (np.cumsum(speed) / 50.0)[-1] == pytest.approx(12.0, rel=1e-3)
        assert untouched(rested, after, "acc", "pressure", "z_m", "device_m")


class TestMovement:
    def test_gestures_go_up_and_down(self, rested: SimulatedWalk) -> None:
        at = rested.checkpoints.t_s[1] - rested.log.t0_s + 5.0
        after = done.gestures(rested, [done.Burst(at, 5.0, 2.0, 0.03)])
        up = attitude(rested).apply(added(rested, after, "acc"))
        t_s = rested.log.acc.t_s
        assert np.abs(up[:, :2]).max() < 1e-9
        assert np.abs(up[(t_s < at) | (t_s > at + 5.0)]).max() < 1e-6
        middle = (t_s > at + 2.2) & (t_s < at + 2.8)
        assert np.abs(up[middle, 2]).max() == pytest.approx(0.03 * (4.0 * np.pi) ** 2, rel=0.02)
        assert untouched(rested, after, "acc")

    def test_vibration_has_a_size_in_every_axis(self, rested: SimulatedWalk) -> None:
        by = added(rested, done.vibration(rested, 10.0, 30.0, 1.5, 6.0, np.random.default_rng(2)), "acc")
        t_s = rested.log.acc.t_s
        there = (t_s >= 10.0) & (t_s < 40.0)
        assert by[there].std(axis=0) == pytest.approx([1.5, 1.5, 1.5], rel=0.1)
        assert not by[~there].any()
        power = np.abs(np.fft.rfft(by[there], axis=0)) ** 2
        hz = np.fft.rfftfreq(there.sum(), 1 / 50)
        assert power[(hz > 4.5) & (hz < 7.8)].sum() > 0.95 * power.sum()

    @pytest.mark.parametrize("angle", [0.5 * np.pi, -1.0])
    def test_a_device_turned_in_the_hand(self, walk: SimulatedWalk, angle: float) -> None:
        after = done.turned_in_hand(walk, angle, 20.0)
        t_s = walk.log.acc.t_s
        early, late = t_s < 19.9, t_s > 20.9
        relative = attitude(walk).inv() * attitude(after)
        assert np.abs(relative[np.flatnonzero(early)].magnitude()).max() < 1e-9
        assert relative[np.flatnonzero(late)].as_rotvec() == pytest.approx(np.tile((0.0, 0.0, angle), (late.sum(), 1)))
        for sensor in ("acc", "gyro"):
            before, now = (getattr(one.log, sensor).values for one in (walk, after))
            assert np.array_equal(now[early], before[early])
            assert Rotation.from_euler("z", angle).apply(now[late]) == pytest.approx(before[late])
        assert added(walk, after, "gyro")[:, 2].sum() / 50.0 == pytest.approx(angle, abs=2e-3)
        assert untouched(walk, after, "acc", "gyro", "mag", "quat_wxyz")

    def test_a_turned_device_sees_the_same_field(self) -> None:
        level = perfect(device=Device(tilt_deg=30.0), environment=Environment(irons_per_100m=0.0))
        after = done.turned_in_hand(level, 2.0, 15.0)
        rows = np.searchsorted(level.t_s, level.log.mag.t_s)
        seen = attitude(after)[rows].apply(after.log.mag.values)
        assert seen == pytest.approx(attitude(level)[rows].apply(level.log.mag.values), abs=1e-6)

    def test_up_is_where_gravity_pushes(self, rested: SimulatedWalk) -> None:
        still = rested.log.acc.t_s < 2.0
        up = done.up_b(rested, rested.log.acc.t_s[still])
        assert up == pytest.approx(rested.log.acc.values[still] / STANDARD_GRAVITY_M_S2, abs=0.01)
        assert up[0] == pytest.approx([0.0, np.sin(np.radians(20.0)), np.cos(np.radians(20.0))], abs=0.01)


class TestPlaces:
    def test_a_survey_tells_where_the_walker_was(self, walk: SimulatedWalk) -> None:
        errors = np.array([(0.0, 0.0), (1.0, -2.0)])
        at_s = walk.checkpoints.t_s[[1, 3]] - walk.log.t0_s
        there = np.column_stack((walk.checkpoints.x_m, walk.checkpoints.y_m))[[1, 3]]
        told = done.surveyed(walk, at_s, errors, lambda xy_m: 2.0 * xy_m + (100.0, 0.0), np.array([0.5, 3.0]))
        assert told.t_s == pytest.approx(walk.checkpoints.t_s[[1, 3]])
        assert told.xy_m == pytest.approx(2.0 * (there + errors) + (100.0, 0.0), abs=1e-3)
        assert told.sigma_m == pytest.approx([0.5, 3.0])

    def test_truth_in_another_frame(self, walk: SimulatedWalk) -> None:
        after = done.in_frame(walk, lambda xy_m: xy_m[:, ::-1] + (5.0, 0.0))
        assert after.x_m == pytest.approx(walk.y_m + 5.0)
        assert after.y_m == pytest.approx(walk.x_m)
        assert untouched(walk, after, "x_m", "y_m")


class TestGaits:
    ROUTE = Route("gaits", np.array([(0, 0, 0), (40, 0, 0), (80, 0, 0)], float), np.array([0, 1.0, 0]), tuple("123"))

    def walk(self, gait: Walker) -> SimulatedWalk:
        options = SimulateOptions(walker=Walker(gait_variation=0.0), gaits={1: gait}, noise=0.0)
        return simulate(self.ROUTE, options, seed=1)

    @staticmethod
    def halves(walk: SimulatedWalk, of: Callable[[FloatArray], FloatArray]) -> list[FloatArray]:
        """Something about the times well inside the two legs."""
        passed_s = walk.checkpoints.t_s - walk.log.t0_s
        return [of(np.array(span)) for span in ((passed_s[0] + 2, passed_s[1] - 2), (passed_s[1] + 3, passed_s[2] - 2))]

    def test_cadence_step_length_bounce_and_sway_change_at_a_stop(self) -> None:
        runner = Walker(cadence_hz=3.0, alpha_m=0.5, bounce_m_s2=5.4, sway_deg=1.25, gait_variation=0.0)
        walk = self.walk(runner)

        def steps(span: FloatArray) -> FloatArray:
            inside = (walk.steps.t_s > span[0]) & (walk.steps.t_s < span[1])
            return np.array([np.diff(walk.steps.t_s[inside]).mean(), walk.steps.length_m[inside].mean()])

        usual, run = self.halves(walk, steps)
        assert usual == pytest.approx([1 / 1.8, 0.71], rel=1e-6)
        assert run == pytest.approx([1 / 3.0, 0.5 + 0.2 * 3.0], rel=1e-6)

        def swinging(span: FloatArray) -> FloatArray:
            inside = (walk.log.acc.t_s > span[0]) & (walk.log.acc.t_s < span[1])
            force = attitude(walk)[np.flatnonzero(inside)].apply(walk.log.acc.values[inside])
            yaw = attitude(walk)[np.flatnonzero(inside)].as_euler("ZYX")[:, 0]
            return np.array([np.std(force[:, 2]), np.std(yaw)])

        usual, run = self.halves(walk, swinging)
        assert run[0] / usual[0] == pytest.approx(3.0, rel=0.05)
        assert run[1] / usual[1] == pytest.approx(0.5, rel=0.05)

    def test_the_usual_gait_changes_nothing(self) -> None:
        same = self.walk(Walker(gait_variation=0.0))
        plain = simulate(self.ROUTE, SimulateOptions(walker=Walker(gait_variation=0.0), noise=0.0), seed=1)
        assert untouched(plain, same)

    def test_a_gait_does_not_change_in_mid_stride(self) -> None:
        with pytest.raises(ConfigError, match="where the walker stands"):
            simulate(load_route("square"), SimulateOptions(gaits={1: Walker()}))
