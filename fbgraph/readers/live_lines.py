"""Lines of a device as they arrive: decided like a file, once, with cleaning that never needs the future.

Names propose and physics decides as for a file (``readers.decide``), from the lines that have come; until something is
decided, samples are held back. Fed the same lines in any chunks it delivers the same samples, so that saved raw lines
rebuild a walk exactly.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.sensor_log import Event, SensorLog, Stream, empty_stream
from fbgraph.readers.apply_layout import LayoutReader, find_column
from fbgraph.readers.canonical_csv import noted_preset
from fbgraph.readers.cleaning import LIMITS, MIN_PRESSURE_HPA
from fbgraph.readers.decide import decide, with_expected
from fbgraph.readers.formats import M5STICKC
from fbgraph.readers.layout import AXES, Layout
from fbgraph.readers.reading import Reading
from fbgraph.tables.dialect import LATEST_HEADER, Dialect, find_dialect
from fbgraph.tables.table import Table

_FIRST_LINES = 100  # a second or so; looked at again whenever half as many more have come
_STRAY_LINES = 512  # that are let go when no table has begun in many more
_MOVING_S, _WAIT_S = 20.0, 120.0  # of movement, and altogether, after which what is likeliest is taken
_MOVING_M_S2 = 0.5
_MOST_WAITING, _MOST_CHARS = 1 << 16, 1 << 25  # lines, and characters in them, that are held back at most
_BACK_NS = 1_000_000_000  # a jump back by more is a restarted clock, if time then runs on
_AHEAD_NS = 5_000_000_000  # a jump ahead by more is believed once time runs on from there
_CONFIRM_ROWS = 3
_RESTART_STEP_NS = 10_000_000
_WIDTHS = {"acc": 3, "gyro": 3, "mag": 3, "pressure": 1}
_Row = tuple[int, dict[str, list[float]], str]


class LiveReader:
    """Lines in, samples out.

    Attributes:
        reading: how they are read; None until that is decided.
        counts: lines and rows dropped or repaired, by reason.
        notices: what was assumed.
        undecided: why samples are held back; ``""`` if they are not, or if too few lines have come to say.
    """

    def __init__(self, name: str = "live", layout: Layout | None = None) -> None:
        """A walk of which no line has come.

        Args:
            name: of the walk.
            layout: how its lines are to be read; decided if None.
        """
        self._name = name
        self._layout = layout
        self._waiting: list[str] = []
        self._chars = 0
        self._look_at = _FIRST_LINES
        self._dialect: Dialect | None = None
        self._samples_of: LayoutReader | None = None
        self._last_ns: int | None = None
        self._shift_ns = 0  # what restarted clocks lost
        self._held: list[_Row] = []
        self._last_event = (-2, "")
        self._rows = 0
        self._last_values: dict[str, tuple[int, list[float]]] = {}  # of slow sensors, and in which second
        self._t0_ns: int | None = None
        self.reading: Reading | None = None
        self.counts: Counter[str] = Counter()
        self.notices: list[str] = []
        self.undecided = ""

    @property
    def t0_s(self) -> float:
        """The device's clock at the first sample, seconds; 0 before it."""
        return (self._t0_ns or 0) / 1e9

    @property
    def format(self) -> str:
        """Name of the format, as far as known."""
        return M5STICKC.name if self.reading is None else self.reading.layout.app

    def push(self, lines: Sequence[str]) -> SensorLog:
        """Take complete lines (with or without line ends); return the samples that they complete."""
        kept = [line for line in (raw.rstrip("\r\n") for raw in lines) if line]
        self.counts["lines"] += len(lines)
        if self.reading is not None:
            return self._as_log(self._samples(kept))
        parts: list[list[_Row]] = []
        for line in kept:
            self._waiting.append(line)
            if self.reading is None and (len(self._waiting) >= self._look_at or self._are_too_long(line)):
                self._look()
                if self.reading is not None:  # from these lines alone, however many came at once
                    parts, self._waiting = [self._samples(self._waiting)], []
        if self.reading is None:
            return self._as_log([])
        parts.append(self._samples(self._waiting))
        self._waiting = []
        return self._as_log([row for part in parts for row in part])

    def finish(self) -> SensorLog:
        """What was held back; rows with a doubtful time are given up.

        Raises:
            DataError: no line named an accelerometer, or what they name is no log of a walk.
        """
        accepted: list[_Row] = []
        if self.reading is None:
            try:
                self._decide(self._waiting, last=True)
            except DataError:
                self._let_go(_STRAY_LINES, last=True)
                if self.reading is None:
                    raise
            accepted, self._waiting = self._samples(self._waiting), []
        self.counts["rows_odd_time"] += len(self._held)
        self._held = []
        return self._as_log(accepted)

    def told(self) -> str:
        """In a sentence, how lines are read; ``""`` while that is not decided."""
        if self.reading is None:
            return ""
        told = []
        for name, stream in self.reading.layout.streams.items():
            axes = "" if stream.axes == AXES else f" (axes {', '.join(stream.axes)})"
            told.append(f"{name} {'/'.join(stream.columns)} in {stream.unit or 'SI'}{axes}")
        return "; ".join(told)

    def _are_too_long(self, line: str) -> bool:
        """Whether the lines held back, with this new one, are more text than any log's would be."""
        self._chars += len(line)
        return self._chars > _MOST_CHARS

    def _look(self) -> None:
        """Look at the lines waiting, and again when there are half as many more, unless they have told enough."""
        lines = len(self._waiting)
        self._look_at = lines + lines // 2
        try:
            self._decide(self._waiting, last=lines >= _MOST_WAITING)
        except DataError as error:
            self.undecided = str(error).removeprefix(f"{self._name}: ")
            if lines > 2 * LATEST_HEADER or self._chars > _MOST_CHARS:
                self._let_go(LATEST_HEADER, last=False)
                self._look_at = len(self._waiting) + _STRAY_LINES

    def _let_go(self, most: int, last: bool) -> None:
        """Let the first lines go, of a device that boots or a stray sender, until a table begins in the others."""
        while self.reading is None and (len(self._waiting) > most or self._chars > _MOST_CHARS):
            self.counts["lines_before_header"] += min(_STRAY_LINES, len(self._waiting))
            del self._waiting[:_STRAY_LINES]
            self._chars = sum(map(len, self._waiting))
            with suppress(DataError):
                self._decide(self._waiting, last)

    def _decide(self, lines: list[str], last: bool) -> None:
        """Decide how lines are read, if these tell enough, or no more will come."""
        dialect = find_dialect(lines)
        if dialect is None:
            raise DataError(f"{self._name}: no line names accelerometer columns; the header should be like {_HEADER}")
        dialect = dialect.learned(lines[dialect.first_row :])
        table = _table(dialect, lines[dialect.first_row :], self._name)
        if len(table) < 2:
            raise DataError(f"{self._name}: no rows of numbers under the header {','.join(dialect.names)[:80]}")
        if self._layout is not None:
            reading = Reading.as_told([table], self._layout)
        else:
            reading = decide([table], self._name)
            layout = with_expected(reading, [table])
            if preset := noted_preset(dialect.remarks):
                layout = layout.model_copy(update={"preset": preset})
            reading = replace(reading, layout=layout)
        sampled = LayoutReader(reading.layout, self._name).read(table)
        if not (last or reading.sure or _told_enough(sampled.t_ns[sampled.good], sampled.values["acc"][sampled.good])):
            self.undecided = reading.judged.undecided or "what its sensors show is not sure yet"
            return
        self.undecided = ""
        self.counts["lines_before_header"] += sum(1 for remark in dialect.remarks if remark)
        self._dialect, self.reading = _settled(dialect, reading.layout, table, self._name), reading
        self._samples_of = LayoutReader(reading.layout, self._name)
        self.notices += reading.notices
        del self._waiting[: dialect.first_row]

    def _samples(self, lines: list[str]) -> list[_Row]:
        accepted: list[_Row] = []
        if self._dialect is not None and self._samples_of is not None and lines:
            table = _table(self._dialect, lines, self._name)
            self.counts.update(table.counts)
            if len(table):
                sampled = self._samples_of.read(table)
                self.counts.update(sampled.counts)
                rows = np.flatnonzero(sampled.good)
                labels = self._begun(sampled.events)
                columns = {sensor: values[rows].tolist() for sensor, values in sampled.values.items()}
                accepted = self._in_time(
                    [
                        (t_ns, {sensor: values[i] for sensor, values in columns.items()}, labels.get(int(rows[i]), ""))
                        for i, t_ns in enumerate(sampled.t_ns[rows].tolist())
                    ]
                )
                self._rows += len(table)
        return accepted

    def _begun(self, events: Sequence[tuple[int, str]]) -> dict[int, str]:
        """Events where they begin: a button held down fills many rows."""
        begun = {}
        for row, text in events:
            if text != "0" and self._last_event != (self._rows + row - 1, text):
                begun[row] = text
            self._last_event = (self._rows + row, text)
        return begun

    def _in_time(self, rows: Sequence[_Row]) -> list[_Row]:
        """Rows in increasing time. One that jumps waits until others follow it, or until time goes on without it."""
        accepted = []
        for row in rows:
            t_ns, last = row[0], self._last_ns
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

    def _accept(self, row: _Row) -> _Row:
        self._last_ns = row[0] + self._shift_ns
        return self._last_ns, row[1], row[2]

    def _as_log(self, rows: list[_Row]) -> SensorLog:
        if rows and self._t0_ns is None:
            self._t0_ns = rows[0][0]
        t0_ns = self._t0_ns or 0
        events = tuple(Event((t_ns - t0_ns) / 1e9, label) for t_ns, _, label in rows if label)
        acc, gyro, mag, pressure = (self._stream(name, width, rows, t0_ns) for name, width in _WIDTHS.items())
        return SensorLog(self._name, self.format, self.t0_s, acc, gyro, mag, pressure, events)

    def _stream(self, name: str, width: int, rows: list[_Row], t0_ns: int) -> Stream:
        """The samples of one sensor; a slow one that repeats its last value says nothing new."""
        found = [(t_ns, values[name]) for t_ns, values, _ in rows if name in values]
        if not found:
            return empty_stream(width)
        t_ns = np.array([t_ns for t_ns, _ in found], dtype=np.int64)
        values: FloatArray = np.array([value for _, value in found], dtype=float).reshape(len(found), width)
        good = (np.abs(values) <= LIMITS[name]).all(axis=1)  # nan is not
        if name == "pressure":
            good &= values[:, 0] >= MIN_PRESSURE_HPA
        t_ns, values = t_ns[good], values[good]
        if name in ("mag", "pressure") and self._repeats(name) and len(values):
            second, last = self._last_values.get(name, (0, [np.nan] * width))
            changed = (np.diff(values, axis=0, prepend=[last]) != 0).any(axis=1)
            changed |= np.diff(t_ns // 1_000_000_000, prepend=second) != 0  # as ``cleaning.drop_repeats``
            self._last_values[name] = int(t_ns[-1]) // 1_000_000_000, values[-1].tolist()
            t_ns, values = t_ns[changed], values[changed]
        return Stream((t_ns - t0_ns) / 1e9, values)

    def _repeats(self, name: str) -> bool:
        """Whether a sensor repeats its last value in every row; of one that had none yet, nothing else is known."""
        stream = None if self.reading is None else self.reading.layout.streams.get(name)
        return stream is not None and stream.repeats is not False


_HEADER = M5STICKC.example.partition("\n")[0]


def _table(dialect: Dialect, lines: Sequence[str], name: str) -> Table:
    """Some lines as a table."""
    rows = dialect.parse(lines)
    widths = np.array(rows.widths, dtype=np.int64) if any(width != dialect.width for width in rows.widths) else None
    headed = bool(dialect.header.names)
    return Table(name, name, rows.columns, headed, dialect.how, widths, rows.remarks, rows.counts)


def _settled(dialect: Dialect, layout: Layout, table: Table, name: str) -> Dialect:
    """The dialect with columns that had no value yet as numbers where a sensor is to come in them; marks are text."""
    measured = [column for stream in layout.streams.values() for column in stream.columns]
    numbers = {find_column(table, column, name) for column in measured}
    mark = None if layout.event is None else find_column(table, layout.event[1], name)
    kinds = ["number" if i in numbers else kind or "text" for i, kind in enumerate(dialect.kinds)]
    return replace(dialect, kinds=tuple("text" if i == mark else kind for i, kind in enumerate(kinds)))


def _told_enough(t_ns: IntArray, acc: FloatArray) -> bool:
    """Whether somebody has moved for so long, or all has taken so long, that the likeliest is taken."""
    there = np.isfinite(acc).all(axis=1)
    t_ns, norm = t_ns[there], np.linalg.norm(acc[there], axis=1)
    if len(t_ns) < 2:
        return False
    steps = np.diff(t_ns, prepend=t_ns[:1])
    second = np.cumsum(np.where((steps > 0) & (steps <= _AHEAD_NS), steps, 0)) // 1_000_000_000
    if second[-1] >= _WAIT_S:
        return True
    first = np.flatnonzero(np.diff(second, prepend=-1))
    moving = sum(part.std() > _MOVING_M_S2 for part in np.split(norm, first[1:]))
    return bool(moving >= _MOVING_S)
