"""SensorLog: what every reader delivers and every estimator starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fbgraph.core.geometry import FloatArray


@dataclass(frozen=True)
class Stream:
    """Samples of one sensor on its own clock and rate.

    Attributes:
        t_s: (N,) strictly increasing, seconds since the log's first inertial sample.
        values: (N, D), finite; D = 3 for vectors in the body frame, 1 for pressure.
    """

    t_s: FloatArray
    values: FloatArray

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def rate_hz(self) -> float:
        """Median sampling rate; nan with fewer than two samples."""
        return float(1.0 / np.median(np.diff(self.t_s))) if len(self) > 1 else float("nan")

    def between(self, start_s: float, end_s: float) -> Stream:
        """The samples with start_s <= t < end_s."""
        lo, hi = np.searchsorted(self.t_s, (start_s, end_s))
        return Stream(self.t_s[lo:hi], self.values[lo:hi])


def empty_stream(width: int) -> Stream:
    """A stream of ``width`` columns without samples: how an absent sensor is written."""
    return Stream(np.empty(0), np.empty((0, width)))


@dataclass(frozen=True)
class Event:
    """Something the log marked: a button, an annotation. ``t_s`` on the SensorLog's clock."""

    t_s: float
    label: str


@dataclass(frozen=True)
class SensorLog:
    """One walk as its sensors saw it. Never holds truth: that travels beside it in ``LogFile``.

    Attributes:
        name: short name of the log, for folders and titles.
        format: name of the reader.
        t0_s: what to add to any ``t_s`` to get the format's own event clock.
        acc: specific force in m/s², body frame (at rest it points up and measures +g).
        gyro: angular rate in rad/s, body frame.
        mag: magnetic field in µT, body frame; empty if the device has none.
        pressure: air pressure in hPa, (N, 1); empty if the device has none.
        events: in order of time.
        notices: what the reader wants the user to know (assumed units, missing sensors, ...).
        counts: rows read, dropped and repaired, by reason.
        reading: which columns of which tables were taken for what, for ``summary.json``; empty where the format tells.
    """

    name: str
    format: str
    t0_s: float
    acc: Stream
    gyro: Stream
    mag: Stream = field(default_factory=lambda: empty_stream(3))
    pressure: Stream = field(default_factory=lambda: empty_stream(1))
    events: tuple[Event, ...] = ()
    notices: tuple[str, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)
    reading: Mapping[str, Any] = field(default_factory=dict)

    @property
    def duration_s(self) -> float:
        """From the first to the last inertial sample."""
        start_s, end_s = self.span_s
        return end_s - start_s

    @property
    def span_s(self) -> tuple[float, float]:
        """When the first and the last inertial sample were taken."""
        return float(min(self.acc.t_s[0], self.gyro.t_s[0])), float(max(self.acc.t_s[-1], self.gyro.t_s[-1]))

    def between(self, start_s: float, end_s: float) -> SensorLog:
        """The piece with start_s <= t < end_s of every stream, on the same clock."""
        return replace(
            self,
            acc=self.acc.between(start_s, end_s),
            gyro=self.gyro.between(start_s, end_s),
            mag=self.mag.between(start_s, end_s),
            pressure=self.pressure.between(start_s, end_s),
            events=tuple(e for e in self.events if start_s <= e.t_s < end_s),
        )

    @staticmethod
    def concatenate(pieces: Sequence[SensorLog]) -> SensorLog:
        """Pieces in order of time as one; what else there is to know is the last one's."""

        def joined(name: str) -> Stream:
            streams = [getattr(piece, name) for piece in pieces]
            return Stream(np.concatenate([s.t_s for s in streams]), np.concatenate([s.values for s in streams]))

        return replace(
            pieces[-1],
            acc=joined("acc"),
            gyro=joined("gyro"),
            mag=joined("mag"),
            pressure=joined("pressure"),
            events=tuple(event for piece in pieces for event in piece.events),
        )
