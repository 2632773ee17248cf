"""Altitude and stillness of the leveller on samples whose answer is known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.made_signals import G, pressures, resting, turned

from fbgraph.core.atmosphere import altitude_pressure_hpa
from fbgraph.core.config import AttitudeConfig, DeviceConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.leveller import Leveller

ALTITUDES_M = np.array([100.0, 101.0, 102.0, 103.0, 104.0, 105.0, 300.0, 107.0, 108.0, 109.0])


def level(log: SensorLog, **attitude: Any) -> LevelledSignals:
    leveller = Leveller(DeviceConfig(), AttitudeConfig(**attitude))
    return LevelledSignals.concatenate([leveller.feed(log), leveller.finish()])


def test_altitude_is_the_median_of_the_last_five_samples_held_until_the_next() -> None:
    barometer = pressures(altitude_pressure_hpa(ALTITUDES_M), every_s=0.2, first_s=0.505)
    signals = level(resting(3.0, pressure=barometer))
    assert np.isnan(signals.altitude_m[signals.t_s < 0.505]).all()
    # the first sample stands for the four before it; the outlier of 300 m never shows
    expected = [100.0, 100.0, 100.0, 101.0, 102.0, 103.0, 104.0, 105.0, 107.0, 108.0]
    for i, altitude_m in enumerate(expected):
        held = (signals.t_s >= 0.505 + 0.2 * i) & (signals.t_s < 0.505 + 0.2 * (i + 1))
        assert held.sum() == 20
        assert np.allclose(signals.altitude_m[held], altitude_m, atol=1e-6), i
    assert np.allclose(signals.altitude_m[signals.t_s > 2.5], 108.0)


def test_a_sample_counts_from_its_own_time_on() -> None:
    barometer = pressures(altitude_pressure_hpa(np.repeat([10.0, 20.0], [5, 3])), every_s=0.25, first_s=0.0)
    signals = level(resting(3.0, pressure=barometer))
    assert signals.altitude_m[np.searchsorted(signals.index, 174)] == pytest.approx(10.0)
    assert signals.altitude_m[np.searchsorted(signals.index, 175)] == pytest.approx(20.0)  # 1.75 s: three of five


def test_a_reading_does_not_hold_for_ever() -> None:
    signals = level(resting(30.0, pressure=pressures(altitude_pressure_hpa(np.full(8, 10.0)), every_s=0.5)))
    known = np.isfinite(signals.altitude_m)
    assert known[signals.t_s < 13.49].all()  # ten seconds after the last sample
    assert not known[signals.t_s > 13.51].any()


@pytest.mark.parametrize(("every_s", "frozen_s"), [(0.1, 8.0), (0.5, 20.0)])
def test_a_barometer_that_repeats_itself_to_the_last_digit_has_stopped(every_s: float, frozen_s: float) -> None:
    """After 8 s and 40 samples; before and after that it measures."""
    altitude_m: FloatArray = np.arange(round(80.0 / every_s), dtype=np.float64) * 1e-3
    begin, end = round(20.0 / every_s), round(60.0 / every_s)
    altitude_m[begin:end] = altitude_m[begin]
    log = resting(80.0, pressure=pressures(altitude_pressure_hpa(altitude_m), every_s=every_s))
    leveller = Leveller(DeviceConfig(), AttitudeConfig())
    parts = [leveller.feed(log.between(t_s, t_s + 0.7)) for t_s in np.arange(0.0, 81.0, 0.7)]
    signals = LevelledSignals.concatenate([*parts, leveller.finish()])
    silent = signals.t_s[np.isnan(signals.altitude_m)]
    assert silent[0] == pytest.approx(20.0 + frozen_s, abs=1.5 * every_s)
    assert silent[-1] == pytest.approx(60.0, abs=1.5 * every_s)
    assert len(silent) == pytest.approx(100.0 * (40.0 - frozen_s), abs=200.0 * every_s)
    whole = level(log)
    assert np.array_equal(whole.altitude_m, signals.altitude_m, equal_nan=True)


def shaken(duration_s: float, acc_m_s2: float = 0.0, gyro_rad_s: tuple[float, float, float] = (0, 0, 0)) -> SensorLog:
    """A device whose |acc| and angular rate swing with these amplitudes, three times in the window of 1.5 s."""
    t_s = np.arange(round(duration_s * 100) + 1) / 100.0
    swing = np.sin(4 * np.pi * t_s)
    log = turned(np.zeros_like, np.zeros_like, t_s, acc_up=G + acc_m_s2 * swing)
    return replace(log, gyro=Stream(t_s, np.outer(swing, gyro_rad_s)))


def still_after_a_window(log: SensorLog, **attitude: Any) -> bool:
    signals = level(log, **attitude)
    (answer,) = set(signals.still[200:].tolist())
    return bool(answer)


ROOT2 = np.sqrt(2.0)


@pytest.mark.parametrize(("amplitude", "still"), [(0.34 * ROOT2, True), (0.36 * ROOT2, False)])
def test_a_device_is_still_whose_specific_force_deviates_little(amplitude: float, still: bool) -> None:
    assert still_after_a_window(shaken(6.0, amplitude)) is still
    assert still_after_a_window(shaken(6.0, 2.0 * amplitude), still_acc_m_s2=0.7) is still


@pytest.mark.parametrize("axes", [(1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (0.36, 0.48, 0.8)])
@pytest.mark.parametrize(("sigma", "still"), [(0.117, True), (0.123, False)])
def test_and_whose_angular_rate_does_about_all_axes_together(
    axes: tuple[float, float, float], sigma: float, still: bool
) -> None:
    x, y, z = axes
    amplitude = sigma * ROOT2
    assert still_after_a_window(shaken(6.0, 0.0, (x * amplitude, y * amplitude, z * amplitude))) is still
    twice = (2 * x * amplitude, 2 * y * amplitude, 2 * z * amplitude)
    assert still_after_a_window(shaken(6.0, 0.0, twice), still_gyro_rad_s=0.24) is still


def test_a_constant_rate_is_a_bias_not_a_movement() -> None:
    log = resting(5.0)
    assert still_after_a_window(replace(log, gyro=Stream(log.gyro.t_s, log.gyro.values + 0.5)))


def test_stillness_is_known_once_the_window_is_full_and_again_once_it_is_past() -> None:
    log = resting(9.0)
    values = log.acc.values.copy()
    values[400:405, 2] += 20.0

    def stood(window_s: float) -> FloatArray:
        signals = level(replace(log, acc=Stream(log.acc.t_s, values)), still_window_s=window_s)
        return signals.index[np.flatnonzero(np.diff(signals.still.astype(int))) + 1].astype(float)

    # grid samples 1 … 150 fill the first window; what moved are samples 400 … 405, the last of them half a step of it
    assert stood(1.5).tolist() == [150, 400, 555]
    assert stood(1.0).tolist() == [100, 400, 505]
