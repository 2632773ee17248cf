"""The leveller on turns, tilts, fields and silences whose answer is known."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.made_signals import FIELD_N, G, pieces, resting, same_signals, turned, without

from fbgraph.core.config import AttitudeConfig, DeviceConfig
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.leveller import Leveller

CONFIG = AttitudeConfig()
T_S = np.arange(1001) / 100.0


def level(
    logs: SensorLog | Sequence[SensorLog], device: DeviceConfig | None = None, **attitude: Any
) -> LevelledSignals:
    leveller = Leveller(device or DeviceConfig(), AttitudeConfig(**attitude))
    parts = [leveller.feed(piece) for piece in ([logs] if isinstance(logs, SensorLog) else logs)]
    return LevelledSignals.concatenate([*parts, leveller.finish()])


def spinning(rate_rad_s: float, start_rad: float = 0.0, t_s: FloatArray = T_S, **given: Any) -> SensorLog:
    return turned(lambda t: start_rad + rate_rad_s * t, lambda t: np.full(len(t), rate_rad_s), t_s, **given)


def test_the_grid_runs_from_the_first_full_interval_to_the_last_sample() -> None:
    log = resting(2.0)
    late = replace(log, gyro=without(log.gyro, -1.0, 0.305))
    signals = level(late)
    assert signals.index.tolist() == list(range(32, 201))  # the gyroscope begins at 0.31 s
    assert np.array_equal(signals.t_s, signals.index * 0.01)


def test_a_grid_sample_is_the_mean_of_the_interval_before_it() -> None:
    t_s = np.arange(0, 10.001, 0.004)
    signals = level(spinning(0.0, t_s=t_s, acc_up=G + 0.01 * t_s))
    assert np.allclose(signals.acc_norm_m_s2, G + 0.01 * (signals.t_s - 0.005), atol=1e-9)


def test_the_gyroscope_keeps_its_integral_at_any_rate_and_jitter() -> None:
    """Trapezoids between samples, no matter where the grid cuts them."""
    rng = np.random.default_rng(2)
    t_s = np.concatenate(([0.0], np.cumsum(rng.uniform(0.002, 0.06, 400))))
    rate = rng.normal(0.0, 1.0, len(t_s))
    log = replace(
        spinning(0.0, t_s=t_s, field_n=None),
        gyro=Stream(t_s, np.column_stack((np.zeros((len(t_s), 2)), rate))),
    )
    signals = level(log)
    angle = np.concatenate(([0.0], np.cumsum(np.diff(t_s) * (rate[1:] + rate[:-1]) / 2)))

    def exact(at_s: float) -> float:
        i = int(np.searchsorted(t_s, at_s, side="right")) - 1
        i = min(i, len(t_s) - 2)
        slope = (angle[i + 1] - angle[i]) / (t_s[i + 1] - t_s[i])  # the grid interpolates the integral
        return float(angle[i] + slope * (at_s - t_s[i]))

    expected = [exact(at) - exact(float(signals.t_s[0])) for at in signals.t_s.tolist()]
    assert np.allclose(signals.yaw_gyro_rad - signals.yaw_gyro_rad[0], expected, atol=1e-4)
    assert signals.yaw_gyro_rad[-1] - signals.yaw_gyro_rad[0] == pytest.approx(expected[-1], abs=1e-5)


def test_yaw_is_counter_clockwise_and_goes_on_beyond_the_circle() -> None:
    signals = level(spinning(1.5))
    assert np.allclose(np.diff(signals.yaw_gyro_rad), 0.015, atol=1e-5)
    assert signals.yaw_gyro_rad[-1] - signals.yaw_gyro_rad[0] == pytest.approx(1.5 * (len(signals) - 1) / 100, abs=1e-3)


@pytest.mark.parametrize("start_rad", [0.0, 0.7, 2.5, -2.0])
@pytest.mark.parametrize("tilt_rad", [0.0, 0.8])
def test_the_compass_is_the_walking_direction_from_east(start_rad: float, tilt_rad: float) -> None:
    """The top edge of a phone lying flat or held up points North, then turned by ``start_rad``."""
    signals = level(spinning(0.0, start_rad, tilt_rad=tilt_rad))
    expected = math.remainder(math.pi / 2 + start_rad, 2 * math.pi)
    assert np.allclose(signals.yaw_mag_rad, expected, atol=1e-3)


def test_the_compass_follows_a_turn() -> None:
    signals = level(spinning(0.9))
    assert np.allclose(wrap_angle(signals.yaw_mag_rad - (math.pi / 2 + 0.9 * signals.t_s)), 0.0, atol=5e-3)
    assert np.abs(signals.yaw_mag_rad).max() <= math.pi


def test_the_mount_says_which_axis_walks_ahead() -> None:
    for mount, yaw in (((1.0, 0.0, 0.0), 0.0), ((-3.0, 0.0, 0.0), math.pi), ((0.0, -1.0, 0.0), -math.pi / 2)):
        signals = level(resting(3.0), DeviceConfig(mount=mount))
        assert np.allclose(wrap_angle(signals.yaw_mag_rad - yaw), 0.0, atol=1e-6)


def test_declination_to_the_east_turns_the_compass_clockwise() -> None:
    signals = level(resting(3.0), DeviceConfig(declination_deg=10.0))
    assert np.allclose(signals.yaw_mag_rad, math.radians(80.0), atol=1e-6)


def test_strength_and_dip_are_the_fields_whatever_the_tilt() -> None:
    for tilt_rad in (0.0, 0.6):
        signals = level(spinning(0.4, tilt_rad=tilt_rad))
        assert np.allclose(signals.mag_norm_ut, math.hypot(20.0, 43.0), atol=1e-3)
        assert np.allclose(signals.mag_dip_rad, math.atan2(43.0, 20.0), atol=2e-3)
    upwards = level(spinning(0.0, field_n=FIELD_N * (1, 1, -1)))
    assert np.allclose(upwards.mag_dip_rad, -math.atan2(43.0, 20.0), atol=1e-6)


def test_accelerations_are_forward_left_and_up_as_one_walks() -> None:
    log = spinning(0.0, 0.7)  # walks towards 0.7 + 90°
    push = np.zeros_like(log.acc.values)
    push[500:505] = (-1.0, 2.0, 0.5)  # body x is the walker's right
    signals = level(replace(log, acc=Stream(log.acc.t_s, log.acc.values + push)))
    at = int(np.searchsorted(signals.index, 503))
    assert np.allclose(signals.acc_n_m_s2[at], (2.0, 1.0, G + 0.5), atol=0.05)
    assert np.allclose(signals.acc_n_m_s2[: at - 5], (0.0, 0.0, G), atol=1e-9)


def test_turning_is_no_tilting() -> None:
    assert np.allclose(level(spinning(2.0)).tilt_rate_rad_s, 0.0, atol=1e-3)
    log = resting(10.0)
    tilting = np.zeros_like(log.gyro.values)
    tilting[500:520] = (0.3, 0.4, 0.0)
    signals = level(replace(log, gyro=Stream(log.gyro.t_s, tilting)))
    at = np.searchsorted(signals.index, np.arange(502, 515))
    assert np.allclose(signals.tilt_rate_rad_s[at], 0.5, atol=0.03)


def test_the_gyroscopes_bias_stays_in_its_yaw() -> None:
    """vqf learns it at rest and takes it out; the estimators want it back in."""
    log = resting(40.0)
    biased = replace(log, gyro=Stream(log.gyro.t_s, log.gyro.values + np.array((0.0, 0.0, 0.01))))
    signals = level(biased)
    assert signals.yaw_gyro_rad[-1] - signals.yaw_gyro_rad[0] == pytest.approx(
        0.01 * (len(signals) - 1) / 100, rel=0.01
    )
    assert np.allclose(signals.yaw_gyro_rad, 0.01 * signals.t_s - 1e-4, atol=1e-3)


def test_nothing_is_integrated_across_a_gap() -> None:
    log = spinning(0.5)
    acc, gyro = without(log.acc, 4.0, 6.0), without(log.gyro, 4.0, 6.0)
    for cut in (replace(log, gyro=gyro), replace(log, acc=acc), replace(log, acc=acc, gyro=gyro)):
        signals = level(cut)
        assert not ((signals.t_s > 4.005) & (signals.t_s < 6.005)).any()
        before, after = np.searchsorted(signals.t_s, 5.0) - 1, np.searchsorted(signals.t_s, 5.0)
        assert signals.index[before] in (399, 400)
        assert signals.index[after] in (601, 602)
        assert signals.yaw_gyro_rad[after] - signals.yaw_gyro_rad[before] == pytest.approx(0.005, abs=1e-3)


def test_an_interval_that_a_gap_touches_is_left_out() -> None:
    """The last sample before it is at 3.993 s, the first after it at 6.003 s."""
    log = spinning(0.5, t_s=T_S + 0.003)
    for cut in (replace(log, acc=without(log.acc, 4.0, 6.0)), replace(log, gyro=without(log.gyro, 4.0, 6.0))):
        index = level(cut).index
        assert index[index < 500][-1] == 399
        assert index[index > 500][0] == 602


def test_a_short_silence_is_bridged() -> None:
    log = spinning(0.5)
    cut = replace(log, acc=without(log.acc, 4.0, 4.45), gyro=without(log.gyro, 4.0, 4.45))
    signals = level(cut)
    assert np.array_equal(np.diff(signals.index), np.ones(len(signals) - 1))
    assert np.allclose(np.diff(signals.yaw_gyro_rad), 0.005, atol=1e-3)


def test_a_longer_max_gap_bridges_more() -> None:
    log = spinning(0.5)
    cut = replace(log, acc=without(log.acc, 4.0, 4.45), gyro=without(log.gyro, 4.0, 4.45))
    assert np.diff(level(cut, max_gap_s=0.4).index).max() > 40


def test_the_field_is_linear_between_samples_and_unknown_beyond_them() -> None:
    north_ut = np.array([20.0, 24.0, 20.0, 40.0])
    mag = Stream(np.array([1.0, 1.4, 1.8, 2.5]), np.outer(north_ut, (0.0, 1.0, 0.0)))
    signals = level(resting(4.0, mag=mag))
    norm = dict(zip(signals.index.tolist(), signals.mag_norm_ut.tolist(), strict=True))
    assert norm[110] == pytest.approx(21.0)
    assert norm[170] == pytest.approx(21.0)
    assert math.isnan(norm[99])
    assert math.isnan(norm[200])  # a silence of 0.7 s
    assert math.isnan(norm[251])
    assert np.array_equal(np.isnan(signals.yaw_mag_rad), np.isnan(signals.mag_norm_ut))
    assert np.array_equal(np.isnan(signals.mag_dip_rad), np.isnan(signals.mag_norm_ut))


def test_what_waits_for_the_magnetometer_comes_no_later_than_a_gap() -> None:
    log = resting(3.0)
    leveller = Leveller(DeviceConfig(), CONFIG)
    behind = replace(log, mag=without(log.mag, 2.705, 9.0))
    assert leveller.feed(behind).index[-1] == 269  # 2.70 s is the magnetometer's last; rounding keeps it back
    assert leveller.finish().index[-1] == 300
    silent = Leveller(DeviceConfig(), CONFIG)
    assert silent.feed(spinning(0.0, t_s=np.arange(301) / 100, field_n=None)).index[-1] == 249


def random_cuts(end_s: float, mean_s: float, seed: int) -> FloatArray:
    return np.cumsum(np.random.default_rng(seed).exponential(mean_s, int(3 * end_s / mean_s)))


@pytest.mark.parametrize("edges_s", [np.arange(0.0, 10.0, 1.0), random_cuts(10, 0.05, 1), random_cuts(10, 0.7, 2)])
def test_any_chunks_give_the_same_bits(edges_s: FloatArray) -> None:
    rng = np.random.default_rng(5)
    t_s = np.concatenate(([0.0], np.cumsum(rng.uniform(0.005, 0.03, 550))))
    log = turned(lambda t: np.sin(2 * t), lambda t: 2 * np.cos(2 * t), t_s, tilt_rad=0.3, acc_up=G + np.sin(9 * t_s))
    baro = Stream(np.arange(0.03, 10.0, 0.21), 1000 + rng.normal(0, 0.1, 48)[:, None])
    log = replace(log, pressure=baro, acc=without(log.acc, 3.0, 4.2), mag=without(log.mag, 6.0, 7.0))
    whole = level(log)
    assert same_signals(level(pieces(log, edges_s)), whole)
    assert len(whole) > 500


def test_a_log_in_which_nothing_moves_for_long_is_level() -> None:
    signals = level(resting(5.0))
    assert np.allclose(signals.acc_n_m_s2, (0.0, 0.0, G))
    assert np.allclose(signals.yaw_gyro_rad, 0.0)
    assert np.isnan(signals.altitude_m).all()
    assert len(level(replace(resting(5.0), gyro=Stream(np.empty(0), np.empty((0, 3)))))) == 0
