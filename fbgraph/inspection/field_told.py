"""The magnetic field: how strong, how steep, how much iron goes with the device, and whether it is Earth's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fbgraph.core.earth_field import EarthField
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.physics.magnetometer_axes import see_field
from fbgraph.physics.sensor_axes import Turning, vote

_EARTH_UT = (22.0, 67.0)  # on the ground, anywhere
_NEAR_UT, _NEAR_DEG = 10.0, 12.0  # of Earth's field at a place, what buildings add
_TURNED_RAD = np.pi  # in all, so that what turns with the device can be told from what does not


def field_told(streams: Mapping[str, Stream], expected: EarthField | None) -> dict[str, Any] | None:
    """What the magnetometer sees; None without one.

    Args:
        streams: SI, in the device's axes.
        expected: Earth's field where the log was recorded, None if nobody knows where that is.
    """
    mag, acc, gyro = (streams.get(name) for name in ("mag", "acc", "gyro"))
    if mag is None or len(mag) < 2:
        return None
    size = np.linalg.norm(mag.values, axis=1)
    low, strength, high = (round(float(value), 2) for value in np.percentile(size, (5, 50, 95)))
    told: dict[str, Any] = {"strength_ut": strength, "strength_5_to_95_ut": [low, high]}
    told["dip_deg"] = None if acc is None or not len(acc) else _dip_deg(mag, acc)
    iron = None if acc is None or gyro is None else _iron_ut(acc, gyro, mag)
    told["hard_iron_level_ut"] = None if iron is None else [round(value, 1) + 0.0 for value in iron.tolist()]
    told["expected"] = None if expected is None else expected.text
    told["is_earths"], told["why"] = _is_earths(strength, told["dip_deg"], expected)
    return told


def _dip_deg(mag: Stream, acc: Stream) -> float:
    """Below the horizon, by the acceleration averaged over two seconds around each sample."""
    each = max(round(2.0 * acc.rate_hz), 1)
    cumulated = np.concatenate((np.zeros((1, 3)), np.cumsum(acc.values, axis=0)))
    middle = np.searchsorted(acc.t_s, mag.t_s)
    lo, hi = np.maximum(middle - each // 2, 0), np.minimum(middle + each // 2 + 1, len(acc))
    up = cumulated[hi] - cumulated[np.minimum(lo, hi - 1)]
    norm = np.linalg.norm(up, axis=1) * np.linalg.norm(mag.values, axis=1)
    sine = -(up * mag.values).sum(axis=1) / np.maximum(norm, 1e-12)
    return round(float(np.degrees(np.arcsin(np.clip(np.median(sine), -1.0, 1.0)))), 1)


def _iron_ut(acc: Stream, gyro: Stream, mag: Stream) -> FloatArray | None:
    """(3,) what stays in the device's axes while it turns, its level part; None if it hardly turns.

    Walkers turn about the vertical, and such turns say nothing of what points up or down.
    """
    if len(acc) < 2 or len(gyro) < 2:
        return None
    turned_rad = float(np.linalg.norm(gyro.values[1:], axis=1) @ np.diff(gyro.t_s))
    turning = Turning.of(acc, gyro, mag)
    if turned_rad < _TURNED_RAD or turning.field(1.0) is None:
        return None
    iron, up = see_field(turning, 1.0, vote(turning, 1.0), acc, mag).offset, acc.values.mean(axis=0)
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    return np.asarray(iron - up * (up @ iron))


def _is_earths(strength_ut: float, dip_deg: float | None, expected: EarthField | None) -> tuple[bool, str]:
    low, high = _EARTH_UT
    if expected is None:
        if low <= strength_ut <= high:
            return True, f"as strong as Earth's, {low:g} to {high:g} µT; where this was is not known"
        return False, f"Earth's is {low:g} to {high:g} µT: uncalibrated, in another unit, or iron goes with the device"
    off_ut = strength_ut - expected.strength_ut
    off_deg = 0.0 if dip_deg is None else dip_deg - float(np.degrees(expected.dip_rad))
    if abs(off_ut) <= _NEAR_UT and abs(off_deg) <= _NEAR_DEG:
        return True, "as Earth's is there"
    return False, f"{off_ut:+.1f} µT and {off_deg:+.1f}° from Earth's there: iron in the building or in the device"
