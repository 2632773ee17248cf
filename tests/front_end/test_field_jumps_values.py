"""Jumps of the magnetometer's zero: between two samples, in the device's frame, whatever the device does."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support.made_signals import FIELD_N, pieces, same_signals, turned

from fbgraph.core.config import AttitudeConfig, DeviceConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.front_end.field_jumps import FieldJumps
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.leveller import Leveller

T_S = np.arange(0.0, 20.0, 0.05)
JUMP = np.array([16.0, -9.0, 4.0])
"""Ahead, to the left, up; µT."""


def turning(t_s: FloatArray) -> FloatArray:
    """Of a device that turns by 20° a second."""
    return np.asarray(np.radians(20.0) * t_s)


def in_world(vector: FloatArray, yaw_rad: FloatArray) -> FloatArray:
    """(N, 3) what a device that points along ``yaw_rad`` carries."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y, z = vector
    return np.column_stack((cos * x - sin * y, sin * x + cos * y, np.full(len(yaw_rad), z)))


def field(yaw_rad: FloatArray, at_s: float = 10.0, noise_ut: float = 0.3) -> FloatArray:
    """The Earth's, and from ``at_s`` on what jumped."""
    noise = np.random.default_rng(2).normal(0.0, noise_ut, (len(T_S), 3))
    return np.asarray(FIELD_N + noise + in_world(JUMP, yaw_rad) * (at_s <= T_S)[:, None])


def jumps_of(field_ut: FloatArray, yaw_rad: FloatArray, every: int = len(T_S)) -> FloatArray:
    found, jumps = [], FieldJumps()
    for lo in range(0, len(T_S), every):
        found.append(jumps.push(T_S[lo : lo + every], field_ut[lo : lo + every], yaw_rad[lo : lo + every]))
    return np.concatenate(found)


@pytest.mark.parametrize("yaw", [np.zeros_like, turning], ids=["still", "turning"])
def test_a_jump_between_two_samples_is_found_in_the_devices_frame(yaw: Callable[[FloatArray], FloatArray]) -> None:
    yaw_rad = yaw(T_S)
    (found,) = jumps_of(field(yaw_rad), yaw_rad)
    assert found[0] == pytest.approx(10.6, abs=0.051)  # certain once it has stayed
    assert found[1:] == pytest.approx(JUMP[:2], abs=1.5)


@pytest.mark.parametrize("every", [1, 7, 30])
def test_any_pieces_give_the_same_jumps(every: int) -> None:
    yaw_rad = turning(T_S)
    whole = jumps_of(field(yaw_rad), yaw_rad)
    assert np.array_equal(jumps_of(field(yaw_rad), yaw_rad, every), whole)


def test_two_jumps_are_two() -> None:
    yaw_rad = np.zeros(len(T_S))
    field_ut = field(yaw_rad, 5.0) - JUMP * (T_S >= 12.0)[:, None]
    found = jumps_of(field_ut, yaw_rad)
    assert found[:, 1] == pytest.approx([16.0, -16.0], abs=1.5)


def test_iron_that_is_passed_within_a_metre_is_no_jump() -> None:
    """A dipole's field, of 60 µT where it is nearest, at 1.4 m/s: it changes within half a second and goes again."""
    along = 1.4 * (T_S - 10.0)
    near = 60.0 * (1.0 / np.hypot(along, 0.8)) ** 3 * 0.8**3
    field_ut = FIELD_N + np.column_stack((near, 0.5 * near, np.zeros(len(T_S))))
    assert len(jumps_of(np.asarray(field_ut), np.zeros(len(T_S)))) == 0


def test_a_spike_is_no_jump_nor_is_a_small_one_nor_one_in_noise() -> None:
    yaw_rad = np.zeros(len(T_S))
    spike = FIELD_N + np.zeros((len(T_S), 3))
    spike[200] += 50.0
    assert len(jumps_of(spike, yaw_rad)) == 0
    little = FIELD_N + (T_S >= 10.0)[:, None] * np.array([3.0, 3.0, 0.0])
    assert len(jumps_of(np.asarray(little), yaw_rad)) == 0
    assert len(jumps_of(field(yaw_rad, noise_ut=4.0), yaw_rad)) == 0


def test_what_turns_with_the_world_is_not_the_devices() -> None:
    """A field that jumps and then stays in the world, while the device turns by 120° a second: somebody else's."""
    yaw_rad = np.radians(200.0) * T_S
    field_ut = FIELD_N + (T_S >= 10.0)[:, None] * np.array([16.0, -9.0, 0.0])
    assert len(jumps_of(np.asarray(field_ut), yaw_rad)) == 0


def test_few_samples_tell_nothing() -> None:
    slow = slice(None, None, 8)  # 2.5 Hz
    jumps = FieldJumps()
    assert len(jumps.push(T_S[slow], field(np.zeros(len(T_S)))[slow], np.zeros(len(T_S))[slow])) == 0


def jumping_log() -> SensorLog:
    """A device that turns by 10° a second, and whose magnetometer, at 20 Hz, is calibrated anew at 12 s."""
    t_s = np.arange(2001) / 100.0
    log = turned(lambda t: np.radians(10.0) * t, lambda t: np.full(len(t), np.radians(10.0)), t_s, tilt_rad=0.3)
    mag = Stream(log.mag.t_s[::5], log.mag.values[::5] + [11.0, 14.0, 0.0] * (log.mag.t_s[::5] >= 12.0)[:, None])
    return replace(log, mag=mag)


def levelled_in(edges_s: FloatArray) -> LevelledSignals:
    leveller = Leveller(DeviceConfig(), AttitudeConfig())
    parts = [leveller.feed(piece) for piece in pieces(jumping_log(), edges_s)]
    return LevelledSignals.concatenate([*parts, leveller.finish()])


def test_the_leveller_says_the_jump_as_the_compass_sees_it() -> None:
    """In the frame of L (cos m, -sin m): what it showed after the jump less what it would have shown."""
    signals = levelled_in(np.empty(0))
    (at,) = np.flatnonzero(signals.field_jump_ut.any(axis=1))
    assert signals.t_s[at] == pytest.approx(12.6, abs=0.1)
    level = signals.mag_norm_ut * np.cos(signals.mag_dip_rad)
    shown = np.column_stack((level * np.cos(signals.yaw_mag_rad), -level * np.sin(signals.yaw_mag_rad)))
    before, after = (int(np.searchsorted(signals.t_s, t)) for t in (11.93, 12.02))
    turned_rad = signals.yaw_gyro_rad[after] - signals.yaw_gyro_rad[before]
    u, v = shown[before]  # the Earth's field turns back in a device that turns
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    expected = shown[after] - (c * u + s * v, c * v - s * u)
    assert signals.field_jump_ut[at] == pytest.approx(expected, abs=0.7)
    assert np.hypot(*expected) > 14.0


@pytest.mark.parametrize("every_s", [0.031, 0.5, 7.0])
def test_any_chunks_level_the_jump_to_the_same_bits(every_s: float) -> None:
    assert same_signals(levelled_in(np.arange(0.0, 21.0, every_s)), levelled_in(np.empty(0)))
