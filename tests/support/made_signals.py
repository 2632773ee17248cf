"""Sensor logs and levelled signals made of formulae, so that what must come out can be told on paper."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.front_end.levelled_signals import LevelledSignals

G = 9.81
FIELD_N = np.array([0.0, 20.0, -43.0])
"""µT: magnetic North is North, the dip atan(43 / 20)."""


def levelled(count: int, first: int = 0, rate_hz: float = 100.0, **given: Any) -> LevelledSignals:
    """Signals of a device that hangs still, moved by nothing but what is given; numbers become columns."""
    index = np.arange(first, first + count, dtype=np.int64) if "index" not in given else given.pop("index")
    columns: dict[str, Any] = dict.fromkeys(("mount_up_rad", "tilt_rate_rad_s", "yaw_gyro_rad"), 0.0)
    columns |= dict.fromkeys(("yaw_mag_rad", "mag_norm_ut", "mag_dip_rad", "altitude_m"), np.nan)
    columns |= {"acc_norm_m_s2": G, "still": False} | given
    level = {"forward_m_s2": 0.0, "left_m_s2": 0.0, "up_m_s2": G}
    acc_n = np.column_stack([np.broadcast_to(columns.pop(name, still), count) for name, still in level.items()])
    columns = {name: np.array(np.broadcast_to(value, count)) for name, value in columns.items()}
    jumps = np.zeros((count, 2))
    return LevelledSignals(index=index, t_s=index / rate_hz, acc_n_m_s2=acc_n, field_jump_ut=jumps, **columns)


def same_signals(a: LevelledSignals, b: LevelledSignals) -> bool:
    """Whether they are equal to the last bit."""
    names = [f.name for f in fields(LevelledSignals)]
    return all(np.array_equal(getattr(a, n), getattr(b, n), equal_nan=n != "still") for n in names)


def about_z(angle_rad: FloatArray) -> FloatArray:
    """(N, 3, 3) rotations of the body by these angles about the vertical."""
    c, s, matrix = np.cos(angle_rad), np.sin(angle_rad), np.zeros((len(angle_rad), 3, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = c
    matrix[:, 1, 0], matrix[:, 0, 1], matrix[:, 2, 2] = s, -s, 1.0
    return matrix


def turned(
    yaw_rad: Callable[[FloatArray], FloatArray],
    rate_rad_s: Callable[[FloatArray], FloatArray],
    t_s: FloatArray,
    field_n: FloatArray | None = FIELD_N,
    tilt_rad: float = 0.0,
    acc_up: FloatArray | float = G,
    acc_level: FloatArray | float = 0.0,
    **streams: Any,
) -> SensorLog:
    """The log of a device that turns about the vertical: its y axis starts North, tilted up by ``tilt_rad``.

    ``acc_level`` is (N, 2), forward and left of the device as it points.
    """
    c, s = np.cos(tilt_rad), np.sin(tilt_rad)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    nRb = about_z(yaw_rad(t_s)) @ tilt
    ahead, left = np.broadcast_to(acc_level, (len(t_s), 2)).T
    cos, sin = np.cos(yaw_rad(t_s)), np.sin(yaw_rad(t_s))  # ahead is North where the yaw is 0
    level = np.column_stack((-ahead * sin - left * cos, ahead * cos - left * sin))
    up = np.column_stack((level, np.broadcast_to(acc_up, len(t_s))))
    spin = np.column_stack((np.zeros((len(t_s), 2)), rate_rad_s(t_s)))
    known: dict[str, Any] = {
        name: Stream(t_s, np.einsum("nji,nj->ni", nRb, v)) for name, v in (("acc", up), ("gyro", spin))
    }
    if field_n is not None:
        known["mag"] = Stream(t_s, np.einsum("nji,j->ni", nRb, field_n))
    return SensorLog("made", "made", 0.0, **(known | streams))


def resting(duration_s: float, rate_hz: float = 100.0, **streams: Any) -> SensorLog:
    """A device that lies still, its y axis to the North."""
    t_s = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    return turned(np.zeros_like, np.zeros_like, t_s, **streams)


def pressures(values: Sequence[float] | FloatArray, every_s: float = 0.1, first_s: float = 0.0) -> Stream:
    """A barometer."""
    t_s: FloatArray = np.arange(len(values), dtype=np.float64) * every_s + first_s
    return Stream(t_s, np.array(values, dtype=float)[:, None])


def pieces(log: SensorLog, edges_s: Sequence[float] | FloatArray) -> list[SensorLog]:
    """The log cut at these times."""
    bounds = [-np.inf, *np.asarray(edges_s, dtype=float).tolist(), np.inf]
    return [log.between(lo, hi) for lo, hi in itertools.pairwise(bounds)]


def without(stream: Stream, start_s: float, end_s: float) -> Stream:
    """The stream, silent in between."""
    keep = (stream.t_s <= start_s) | (stream.t_s >= end_s)
    return Stream(stream.t_s[keep], stream.values[keep])
