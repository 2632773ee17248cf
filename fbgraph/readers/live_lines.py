"""Lines of an M5StickC as they arrive: the file reader's columns, with cleaning that never needs the future.

Fed the same lines in any chunks it delivers the same samples, so that saved raw lines rebuild a walk exactly.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Event, SensorLog, Stream, empty_stream
from fbgraph.readers.cleaning import LIMITS, MIN_PRESSURE_HPA
from fbgraph.readers.csv_columns import CANONICAL, Columns, Rows
from fbgraph.readers.m5stickc import find_columns

_SETTLE_LINES = 100  # a second or so: from these the units of columns that do not name theirs are told
_HEADER_LINES = 50  # as many lines as a header may be late
_BACK_NS = 1_000_000_000  # a jump back by more is a restarted clock, if time then runs on
_AHEAD_NS = 5_000_000_000  # a jump ahead by more is believed once time runs on from there
_CONFIRM_ROWS = 3
_RESTART_STEP_NS = 10_000_000
_WIDTHS = {"acc": 3, "gyro": 3, "mag": 3, "pressure": 1}


class LiveReader:
    """Lines in, samples out.

    Attributes:
        header: the line that names the columns; None until known.
        counts: lines and rows dropped or repaired, by reason.
        notices: what was assumed.
    """

    def __init__(self, name: str = "live") -> None:
        self._name = name
        self._columns: Columns | None = None
        self._waiting: list[str] = []
        self._settled = False
        self._rows_seen = 0
        self._last_ns: int | None = None
        self._shift_ns = 0  # what restarted clocks lost
        self._held: list[tuple[int, dict[str, list[float]], str]] = []
        self._last_values: dict[str, list[float]] = {}
        self._polled: set[str] = set()  # slow sensors that repeat their last value in every row
        self._t0_ns: int | None = None
        self.header: str | None = None
        self.counts: Counter[str] = Counter()
        self.notices: list[str] = []

    @property
    def t0_s(self) -> float:
        """The device's clock at the first sample, seconds; 0 before it."""
        return (self._t0_ns or 0) / 1e9

    def push(self, lines: Sequence[str]) -> SensorLog:
        """Take complete lines (with or without line ends); return the samples that they complete."""
        kept = [line for line in (raw.rstrip("\r\n") for raw in lines) if line and line[0] != "#"]
        self.counts["lines"] += len(lines)
        if self._settled:
            return self._samples(kept)
        self._waiting += kept
        while len(self._waiting) >= _SETTLE_LINES:
            if find_columns(self._waiting[:_HEADER_LINES]) is not None:
                return self._settle()
            self._give_up(_HEADER_LINES)
        return self._samples([])

    def finish(self) -> SensorLog:
        """What was held back; rows with a doubtful time are given up.

        Raises:
            DataError: no line named an accelerometer.
        """
        while not self._settled and len(self._waiting) > _HEADER_LINES:
            if find_columns(self._waiting[:_HEADER_LINES]) is not None:
                break
            self._give_up(_HEADER_LINES)
        piece = self._settle() if not self._settled else self._samples([])
        self.counts["rows_odd_time"] += len(self._held)
        self._held = []
        return piece

    def _give_up(self, lines: int) -> None:
        """The first lines waiting name nothing: a device that boots, a stray sender."""
        self.counts["lines_before_header"] += lines
        del self._waiting[:lines]

    def _settle(self) -> SensorLog:
        self._columns = find_columns(self._waiting[:_HEADER_LINES])
        if self._columns is None:
            raise DataError(f"{self._name}: no line names accelerometer columns; the header should be like {CANONICAL}")
        self.header = ",".join(self._columns.names)
        first = [line for line in self._waiting if line != self.header]
        self._columns, notices = self._columns.settled(self._columns.parse(first))
        self.notices += notices
        values = self._columns.parse(first).values
        for name in {"mag", "pressure"} & values.keys():
            there = values[name][np.isfinite(values[name]).all(axis=1)]
            if len(there) > 1 and (np.diff(there, axis=0) == 0).all(axis=1).mean() >= 0.5:
                self._polled.add(name)
        waiting, self._waiting, self._settled = self._waiting, [], True
        return self._samples(waiting)

    def _samples(self, lines: list[str]) -> SensorLog:
        accepted: list[tuple[int, dict[str, list[float]], str]] = []
        if self._columns is not None and lines:
            data = [line for line in lines if line != self.header]
            rows = self._columns.convert(self._columns.parse(data, self._rows_seen))
            self._rows_seen += len(data)
            self.counts.update(rows.counts)
            accepted = self._in_time(rows)
        return self._as_log(accepted)

    def _in_time(self, rows: Rows) -> list[tuple[int, dict[str, list[float]], str]]:
        """Rows in increasing time. One that jumps waits until others follow it, or until time goes on without it."""
        labels = dict(rows.events)
        columns = {sensor: values.tolist() for sensor, values in rows.values.items()}
        accepted = []
        for i, t_ns in enumerate(rows.t.tolist()):
            row = (t_ns, {sensor: values[i] for sensor, values in columns.items()}, labels.get(i, ""))
            last = self._last_ns
            if last is None or 0 < t_ns + self._shift_ns - last <= _AHEAD_NS:
                self.counts["rows_odd_time"] += len(self._held)
                self._held = []
                accepted.append(self._accept(row))
            elif -_BACK_NS <= t_ns + self._shift_ns - last <= 0:
                self.counts["rows_not_later"] += 1
            else:
                if self._held and not 0 < t_ns - self._held[-1][0] <= _AHEAD_NS:
                    self.counts["rows_odd_time"] += len(self._held)
                    self._held = []
                self._held.append(row)
                if len(self._held) >= _CONFIRM_ROWS:
                    if self._held[0][0] + self._shift_ns < last:
                        self._shift_ns = last + _RESTART_STEP_NS - self._held[0][0]
                        self.counts["clock_restarts"] += 1
                    else:
                        self.counts["silences"] += 1
                    accepted += [self._accept(held) for held in self._held]
                    self._held = []
        return accepted

    def _accept(self, row: tuple[int, dict[str, list[float]], str]) -> tuple[int, dict[str, list[float]], str]:
        self._last_ns = row[0] + self._shift_ns
        return self._last_ns, row[1], row[2]

    def _as_log(self, rows: list[tuple[int, dict[str, list[float]], str]]) -> SensorLog:
        if rows and self._t0_ns is None:
            self._t0_ns = rows[0][0]
        t0_ns = self._t0_ns or 0
        events = tuple(Event((t_ns - t0_ns) / 1e9, label) for t_ns, _, label in rows if label)
        acc, gyro, mag, pressure = (self._stream(name, width, rows, t0_ns) for name, width in _WIDTHS.items())
        return SensorLog(self._name, "m5stickc", self.t0_s, acc, gyro, mag, pressure, events)

    def _stream(self, name: str, width: int, rows: list[tuple[int, dict[str, list[float]], str]], t0_ns: int) -> Stream:
        """The samples of one sensor; a slow one that repeats its last value says nothing new."""
        found = [(t_ns, values[name]) for t_ns, values, _ in rows if name in values]
        if not found:
            return empty_stream(width)
        t_s = (np.array([t_ns for t_ns, _ in found], dtype=np.int64) - t0_ns) / 1e9
        values: FloatArray = np.array([value for _, value in found], dtype=float).reshape(len(found), width)
        good = (np.abs(values) <= LIMITS[name]).all(axis=1)  # nan is not
        if name == "pressure":
            good &= values[:, 0] >= MIN_PRESSURE_HPA
        t_s, values = t_s[good], values[good]
        if name in self._polled and len(values):
            previous = np.array([self._last_values.get(name, [np.nan] * width)])
            changed = (np.diff(np.concatenate((previous, values)), axis=0) != 0).any(axis=1)
            self._last_values[name] = values[-1].tolist()
            t_s, values = t_s[changed], values[changed]
        return Stream(t_s, values)
