"""Sensors against one another, of logs made by hand: what is found, when, and how much it widens."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.random import default_rng
from support.results_by_hand import hand_log, hand_result, hand_signals

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.integrity.sensor_checks import (
    clock_set,
    cut_off_values,
    frozen_magnetometer,
    frozen_sensors,
    gravity_against_gyroscope,
    gravitys_size,
    level_blocks,
    limp_gyroscope,
    noisy_sensors,
    silent_sensors,
    sparse_samples,
    too_slow,
)
from fbgraph.run.walk_result import WalkResult

T_S = np.arange(0.0, 60.005, 0.01)


def moving(seed: int, size: float) -> FloatArray:
    """Slow movement of that size, and a little noise."""
    rng = default_rng(seed)
    waves = [
        np.sin(2.0 * np.pi * f * T_S + phase) for f, phase in zip((0.9, 1.8, 2.7), rng.uniform(0, 6, 3), strict=True)
    ]
    return size * np.column_stack(waves) + rng.normal(0.0, 0.01 * size, (len(T_S), 3))


def sane_log(**given: Any) -> SensorLog:
    """A minute of movement: 3 m/s² about gravity, 0.5 rad/s, 5 µT."""
    acc = moving(1, 3.0) + np.array([0.0, 0.0, 9.80665])
    streams = {"acc": Stream(T_S, acc), "gyro": Stream(T_S, moving(2, 0.5)), "mag": Stream(T_S, 40 + moving(3, 5.0))}
    return hand_log(**(streams | given))


def walk(log: SensorLog | None = None, **given: Any) -> WalkResult:
    """25 s of steps of half a metre, two a second, from 1 s on."""
    return hand_result(log=sane_log() if log is None else log, **given)


def levelled(forward_m_s2: float = 0.0, up_m_s2: float = 9.80665, tilt_rad_s: float = 0.2) -> Any:
    signals = hand_signals()
    count = len(signals)
    acc = np.tile([forward_m_s2, 0.0, up_m_s2], (count, 1))
    return replace(signals, acc_n_m_s2=acc, tilt_rate_rad_s=np.full(count, tilt_rad_s))


CHECKS = (
    *(frozen_sensors, frozen_magnetometer, silent_sensors, cut_off_values, noisy_sensors, sparse_samples, too_slow),
    clock_set,
)


@pytest.mark.parametrize("check", CHECKS)
def test_nothing_is_found_where_nothing_is_wrong(check: Any) -> None:
    assert check(walk()) == []


@pytest.mark.parametrize("check", [gravitys_size, gravity_against_gyroscope, limp_gyroscope])
def test_nothing_is_found_in_signals_that_are_level(check: Any) -> None:
    assert check(walk(signals=levelled())) == []


def held(stream: Stream, start_s: float, end_s: float) -> Stream:
    """The sample at ``start_s`` repeated until ``end_s``."""
    values = stream.values.copy()
    inside = (stream.t_s >= start_s - 1e-6) & (stream.t_s <= end_s + 1e-6)
    values[inside] = values[inside][0]
    return Stream(stream.t_s, values)


def test_a_gyroscope_that_hangs_is_named_with_its_time() -> None:
    log = sane_log()
    (found,) = frozen_sensors(walk(replace(log, gyro=held(log.gyro, 10.0, 14.0))))
    assert found.reason.kind == "gyroscope"
    assert "from 10.0 to 14.0 s, while the accelerometer moves" in found.reason.text
    assert found.reason.weight == pytest.approx(4.0)
    assert found.sigma_m is not None
    assert found.sigma_m[18] == 0.0  # at 10 s
    assert found.sigma_m[-1] == pytest.approx(16.0 * math.pi / 2.0 / math.sqrt(2.0))  # 16 m later nothing is known


def test_an_accelerometer_that_hangs_hides_what_was_walked() -> None:
    log = sane_log()
    (found,) = frozen_sensors(walk(replace(log, acc=held(log.acc, 10.0, 14.0))))
    assert found.reason.kind == "accelerometer"
    assert found.sigma_m is not None
    assert found.sigma_m[-1] == pytest.approx(1.5 * 4.0 / math.sqrt(2.0))


def test_a_short_hang_and_one_at_rest_are_none() -> None:
    log = sane_log()
    assert frozen_sensors(walk(replace(log, gyro=held(log.gyro, 10.0, 10.9)))) == []
    still = replace(log, acc=held(log.acc, 10.0, 14.0), gyro=held(log.gyro, 10.0, 14.0))
    assert frozen_sensors(walk(still)) == []
    stuck = replace(log, acc=held(log.acc, 10.0, 16.0), gyro=held(log.gyro, 10.0, 16.0))
    (found,) = frozen_sensors(walk(stuck))
    assert "moves" not in found.reason.text


def test_a_magnetometer_that_hangs_while_steps_are_taken_is_named() -> None:
    """Two steps a second, from 1 s on, until 26 s."""
    mag = sane_log().mag
    (found,) = frozen_magnetometer(walk(sane_log(mag=held(mag, 10.0, 16.0))))
    assert found.reason.kind == "magnetometer"
    assert "from 10.0 to 16.0 s, for 11 steps" in found.reason.text
    assert found.reason.weight == pytest.approx(2.0)
    assert found.sigma_m is not None
    assert (found.sigma_m[18], found.sigma_m[-1] > 5.0) == (0.0, True)
    assert frozen_magnetometer(walk(sane_log(mag=held(mag, 10.0, 12.9)))) == []
    assert frozen_magnetometer(walk(sane_log(mag=held(mag, 27.0, 55.0)))) == []  # nobody walks


def test_a_sensor_that_ends_before_the_others_cuts_the_walk() -> None:
    log = sane_log()
    (found,) = silent_sensors(walk(replace(log, gyro=log.gyro.between(0.0, 30.0))))
    assert "the gyroscope fell silent at 30 s, 30 s before the log ends" in found.reason.text
    assert silent_sensors(walk(replace(log, gyro=log.gyro.between(0.0, 57.5)))) == []
    (cut,) = silent_sensors(walk(replace(log, counts={"gyro_stray_time": 1000})))
    assert "accelerometer" in cut.reason.text
    assert "10 s before" in cut.reason.text


def test_values_that_pile_up_at_an_extreme() -> None:
    log = sane_log()
    clipped = replace(log, gyro=Stream(T_S, np.clip(log.gyro.values, -0.3, 0.3)))
    (found,) = cut_off_values(walk(clipped))
    assert "samples lie at 17.19 °/s, none beyond it" in found.reason.text
    few = log.acc.values.copy()
    few[:10, 0] = 90.0  # 0.17 %
    assert cut_off_values(walk(replace(log, acc=Stream(T_S, few)))) == []


def test_noise_from_sample_to_sample() -> None:
    log = sane_log()
    noise = default_rng(3).normal(0.0, 4.0, (len(T_S), 3))
    (found,) = noisy_sensors(walk(replace(log, acc=Stream(T_S, log.acc.values + noise))))
    assert found.reason.weight == pytest.approx(4.0 / 2.5, rel=0.05)
    assert noisy_sensors(walk(replace(log, acc=Stream(T_S, log.acc.values + 0.5 * noise)))) == []
    slow = Stream(T_S * 10.0, log.acc.values + noise)  # at 10 Hz a step does as much
    assert noisy_sensors(walk(replace(log, acc=slow))) == []


def test_samples_too_far_apart() -> None:
    log = sane_log()
    sparse = Stream(log.acc.t_s[::20], log.acc.values[::20])
    (found,) = sparse_samples(walk(replace(log, acc=sparse)))
    assert found.reason.text == "100 % of the time the accelerometer has fewer than 7 samples a second"
    assert sparse_samples(walk(replace(log, acc=Stream(log.acc.t_s[::10], log.acc.values[::10])))) == []


def test_a_clock_that_restarted() -> None:
    (found,) = clock_set(walk(sane_log(counts={"clock_restarts": 2})))
    assert found.reason.kind == "clock"
    assert "restarted 2 times" in found.reason.text
    (late,) = clock_set(walk(sane_log(counts={"acc_not_later": 50})))
    assert "samples of 0.5 s" in late.reason.text
    assert clock_set(walk(sane_log(counts={"acc_not_later": 30}))) == []


def test_gravity_has_one_size() -> None:
    (found,) = gravitys_size(walk(signals=levelled(up_m_s2=0.8 * 9.80665)))
    assert "a gravity of 7.85 m/s²" in found.reason.text
    assert found.reason.weight == pytest.approx(4.0)
    assert found.sigma_m is not None
    assert found.sigma_m[-1] == pytest.approx(25.0 * 0.25 * math.log(1 / 0.8) / math.sqrt(2.0))
    assert gravitys_size(walk(signals=levelled(up_m_s2=1.045 * 9.80665))) == []


def test_gravity_that_leaks_into_the_horizontal() -> None:
    """1.5 m/s² are asin(1.5 / 9.81) = 9° of tilt; 3 m/s² without a compass leave nothing to go by."""
    (found,) = gravity_against_gyroscope(walk(signals=levelled(1.5)))
    assert "by up to 9°" in found.reason.text
    assert not found.withhold
    assert gravity_against_gyroscope(walk(signals=levelled(0.9))) == []
    (lost,) = gravity_against_gyroscope(walk(signals=levelled(3.0)))
    assert lost.withhold
    compass = {"yaw_mag_rad": np.linspace(0.0, 3.0, 51), "yaw_gyro_rad": np.linspace(0.0, 3.0, 51)}
    compass |= {"yaw_s": np.arange(51.0) / 2.0}
    for level_m_s2, withheld in ((3.0, False), (4.5, True)):
        (held,) = gravity_against_gyroscope(walk(signals=levelled(level_m_s2), steps=compass))
        assert held.withhold == withheld


def test_level_blocks_are_means_of_two_seconds_after_levelling_has_settled() -> None:
    """And of those only what was walked: from 1 to 26 s, so that 24 to 26 s is the last one."""
    blocks = level_blocks(walk(signals=levelled(1.0)))
    assert blocks.t_s.tolist() == [*np.arange(7.0, 26.0, 2.0)]
    assert blocks.acc_m_s2[0].tolist() == pytest.approx([1.0, 0.0, 9.80665])


def test_a_gyroscope_that_does_not_move_while_steps_are_counted() -> None:
    (found,) = limp_gyroscope(walk(signals=levelled(tilt_rad_s=0.01)))
    assert found.withhold
    assert found.reason.weight == pytest.approx(5.0)
    assert limp_gyroscope(walk(signals=levelled(tilt_rad_s=0.06))) == []


@pytest.mark.parametrize(("every", "rate_hz"), [(7, 14.3), (9, 11.1), (20, 5.0)])
def test_samples_too_slow_for_steps_are_withheld(every: int, rate_hz: float) -> None:
    log = sane_log()
    found = too_slow(walk(replace(log, acc=Stream(log.acc.t_s[::every], log.acc.values[::every]))))
    assert [doubt.withhold for doubt in found] == [True] * (rate_hz < 12.5)
    if found:
        assert found[0].reason.text == f"the accelerometer runs at {rate_hz:.3g} Hz, too slow for steps"
        assert found[0].reason.weight == pytest.approx(125.0 / rate_hz, rel=0.01)
