"""A layout applied to tables: samples in SI along the device's axes, as the cleaning takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fbgraph.columns.clock_times import Clock, RunningClock, clock_ns
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.readers.cleaning import LIMITS, RawLog, RawStream, drop_repeats, kept
from fbgraph.readers.layout import ANY, ClockLayout, Layout, StreamLayout
from fbgraph.readers.restarts import continue_restarts, little_disorder
from fbgraph.tables.table import Table

_SAID_SHARE = 0.01
"""Of rows or fields: when more are lost, it is said."""


@dataclass(frozen=True)
class Sampled:
    """Rows of one table by a layout.

    Attributes:
        t_ns: (N,).
        good: (N,) rows that can be used.
        values: (N, D) by sensor, SI.
        events: row and text, of all rows that have one.
        counts: rows that cannot be used, by reason.
    """

    t_ns: IntArray
    good: BoolArray
    values: dict[str, FloatArray]
    events: list[tuple[int, str]]
    counts: dict[str, int]


class LayoutReader:
    """Reads one table's rows by a layout as they come."""

    def __init__(self, layout: Layout, source: object) -> None:
        self._layout = layout
        self._source = source
        self._clock: RunningClock | None = None

    def read(self, table: Table) -> Sampled:
        """The samples of rows that come after all others.

        Raises:
            DataError: a column that the layout names is not there.
        """
        layout, source = self._layout, self._source
        if self._clock is None:
            self._clock = RunningClock(clock_of(table, layout, source))
        t_ns = self._clock.ns(table)
        whole, sound = _usable(table, layout, t_ns, list(layout.streams.items()), source)
        values = {}
        for name, stream in layout.streams.items():
            values[name] = stream_values(table, stream, source)
            if stream.gravity is not None:
                values[name] = values[name] + stream_values(table, stream.gravity, source) @ stream.rotation.T
        events = [] if layout.event is None else _texts(table, find_column(table, layout.event[1], source))
        counts = {"lines_unreadable": int((~whole).sum()), "rows_impossible": int((whole & ~sound).sum())}
        return Sampled(t_ns, whole & sound, values, events, {why: n for why, n in counts.items() if n})


@dataclass(frozen=True)
class _Timed:
    """A table with its times: ``t_ns`` (N,), ``good`` (N,) rows that can be used."""

    table: Table
    t_ns: IntArray
    good: BoolArray


def apply_layout(tables: Sequence[Table], layout: Layout, source: object) -> RawLog:
    """What a log's tables hold by a layout.

    Args:
        tables: of the log.
        layout: what was decided, or what the user says.
        source: for messages.

    Raises:
        DataError: a table or column that the layout names is not there.
    """
    raw = RawLog()
    timed: dict[int, _Timed] = {}
    wanted = {name: (find_table(tables, stream.table, source), stream) for name, stream in layout.streams.items()}
    for i in sorted({i for i, _ in wanted.values()}):
        of_table = [(name, stream) for name, (j, stream) in wanted.items() if j == i]
        timed[i] = _timed(tables[i], layout, of_table, raw, source)
    for name, (i, stream) in wanted.items():
        one = timed[i]
        rows = _filled(one, stream, source)
        t_ns = one.t_ns if rows is None else one.t_ns[rows]
        if not len(t_ns):
            continue
        values = stream_values(one.table, stream, source, rows)
        if stream.gravity is not None:
            values = values + _gravity(tables, layout, stream.gravity, t_ns, source) @ stream.rotation.T
            empty = np.asarray(np.isnan(values).all(axis=1))
            t_ns, values = kept(~empty, t_ns, values)
        raw.streams[name] = RawStream(t_ns, values)
        if name in ("mag", "pressure"):
            raw.streams[name] = drop_repeats(raw.streams[name], stream.repeats)
            if repeats := len(t_ns) - len(raw.streams[name].t_ns):
                raw.counts[f"{name}_repeats"] = repeats
    if layout.event is not None:
        i = find_table(tables, layout.event[0], source)
        if i in timed:
            raw.events = _events(timed[i], find_column(tables[i], layout.event[1], source))
    _tell_losses([one.table for one in timed.values()], raw)
    return raw


def find_table(tables: Sequence[Table], name: str, source: object) -> int:
    """Place of a table that a layout names.

    Raises:
        DataError: it is not there.
    """
    if name == ANY:
        return max(range(len(tables)), key=lambda i: len(tables[i]))
    for i, table in enumerate(tables):
        if table.name == name:
            return i
    there = ", ".join(table.name for table in tables[:12])
    raise DataError(f"{source}: the layout names a table {name!r}, there are {there}")


def find_column(table: Table, name: str, source: object) -> int:
    """Place of a column that a layout names.

    Raises:
        DataError: it is not there.
    """
    if name.startswith("#") and name[1:].isdecimal() and 0 < int(name[1:]) <= len(table.columns):
        return int(name[1:]) - 1
    for i, column in enumerate(table.columns):
        if column.name == name:
            return i
    there = ", ".join(column.name or f"#{i + 1}" for i, column in enumerate(table.columns[:20]))
    raise DataError(f"{source}: the layout names a column {name!r}, {table.source} has {there}")


def stream_values(table: Table, stream: StreamLayout, source: object, rows: BoolArray | None = None) -> FloatArray:
    """(N, D) values of a sensor in SI, along the device's axes.

    Args:
        rows: which of the table's; None for all.
    """
    columns = _columns(table, stream, source)
    order, signs = range(len(columns)), np.ones(len(columns))
    if len(columns) == 3:  # no product of matrices: an empty field would empty all three
        order, signs = np.abs(stream.rotation).argmax(axis=1).tolist(), stream.rotation.sum(axis=1)
    values = np.empty((len(table) if rows is None else int(np.count_nonzero(rows)), len(columns)))
    with np.errstate(over="ignore"):  # garbled numbers
        for k, i in enumerate(order):
            np.multiply(columns[i] if rows is None else columns[i][rows], stream.scale * signs[k], out=values[:, k])
    return values


def _columns(table: Table, stream: StreamLayout, source: object) -> list[FloatArray | IntArray]:
    """The numbers of a sensor as the table has them; nan in a column of text."""
    found = [table.columns[find_column(table, name, source)] for name in stream.columns]
    return [np.full(len(table), np.nan) if column.is_text else column.values for column in found]


_COUNTED = ("ticks", "days", "hms", "samples")


def clock_of(table: Table, layout: Layout, source: object) -> Clock:
    """What a layout says tells the time of a table.

    Raises:
        DataError: nothing does.
    """
    clocks: list[ClockLayout] = [clock for clock in layout.clocks if clock.table in (table.name, ANY)]
    if not clocks:
        raise DataError(f"{source}: the layout says nothing of the time of {table.source}: give it a [[clocks]] entry")
    clock = clocks[0]
    columns = tuple(find_column(table, name, source) for name in clock.columns)
    for i, name in zip(columns, clock.columns, strict=True):
        if table.columns[i].is_text and clock.kind in _COUNTED:
            raise DataError(f"{source}: the layout takes {clock.kind} from {name!r}, which holds text; name its kind")
    return Clock(clock.kind, columns, clock.tick_ns, clock.wrap, "as laid out")


def _timed(
    table: Table, layout: Layout, streams: Sequence[tuple[str, StreamLayout]], raw: RawLog, source: object
) -> _Timed:
    """A table's times, and which of its rows are to be trusted; rows that came a little late are put in order."""
    t_ns = clock_ns(table, clock_of(table, layout, source))
    whole, sound = _usable(table, layout, t_ns, streams, source)
    _count(
        raw, "lines_unreadable", int(np.count_nonzero(~whole)) + sum(table.counts.get(why, 0) for why in _UNREADABLE)
    )
    _count(raw, "rows_impossible", int(np.count_nonzero(whole & ~sound)))
    for reason, number in table.counts.items():
        if reason not in _UNREADABLE:
            _count(raw, reason, number)
    good = whole & sound
    if good.all() and (np.diff(t_ns) > 0).all():
        return _Timed(table, t_ns, good)
    if little_disorder(t_ns[good]):
        order = np.argsort(np.where(good, t_ns, np.maximum.accumulate(np.where(good, t_ns, t_ns.min()))), kind="stable")
        _count(raw, "rows_reordered", int((np.diff(t_ns[good]) < 0).sum()))
        table, t_ns, good = table.rows(order), t_ns[order], good[order]
    went_on, restarts = continue_restarts(t_ns[good])
    if restarts:
        _count(raw, "clock_restarts", restarts)
        raw.notices.append(f"the device's clock restarted {restarts} times; later times go on from the last row")
        t_ns = t_ns.copy()
        t_ns[good] = went_on
    return _Timed(table, t_ns, good)


_UNREADABLE = ("lines_unreadable", "rows_too_long")


def _count(raw: RawLog, reason: str, number: int) -> None:
    if number:
        raw.counts[reason] = raw.counts.get(reason, 0) + number


def _gravity(
    tables: Sequence[Table], layout: Layout, stream: StreamLayout, t_ns: IntArray, source: object
) -> FloatArray:
    """(N, 3) gravity at some moments, in the columns' own axes."""
    table = tables[find_table(tables, stream.table, source)]
    values = table.numbers([find_column(table, name, source) for name in stream.columns]) * stream.scale
    its_ns = clock_ns(table, clock_of(table, layout, source))
    good = np.isfinite(values).all(axis=1) & (np.abs(its_ns) <= MAX_T_NS)
    if not good.any():
        return np.full((len(t_ns), 3), np.nan)
    its_s, at_s = (its_ns[good] - its_ns[good][0]) * 1e-9, (t_ns - its_ns[good][0]) * 1e-9
    order = np.argsort(its_s, kind="stable")
    return np.column_stack([np.interp(at_s, its_s[order], axis[order]) for axis in values[good].T])


def _usable(
    table: Table, layout: Layout, t_ns: IntArray, streams: Sequence[tuple[str, StreamLayout]], source: object
) -> tuple[BoolArray, BoolArray]:
    """(N,) rows that have their fields, and (N,) rows whose numbers are possible.

    A row with an acceleration or rate that no such sensor can give, or with an impossible time, is corrupted: its other
    numbers are not to be trusted either.
    """
    sound: BoolArray = np.abs(t_ns) <= MAX_T_NS
    for name, stream in streams:
        if name in ("acc", "gyro"):
            for values in _columns(table, stream, source):
                with np.errstate(over="ignore"):
                    if not _within(values, stream.scale, LIMITS[name]):
                        sound &= ~(np.abs(values * stream.scale) > LIMITS[name])
    return table.whole(layout.row_widths), sound


def _within(values: FloatArray | IntArray, scale: float, limit: float) -> bool:
    """Whether every field is filled, and none is beyond a limit."""
    return len(values) > 0 and bool(values.max() * scale <= limit and values.min() * scale >= -limit)


def _filled(timed: _Timed, stream: StreamLayout, source: object) -> BoolArray | None:
    """(N,) rows that can be used and have a value of a sensor; None if all have."""
    empty: BoolArray = np.ones(len(timed.good), dtype=bool)
    for values in _columns(timed.table, stream, source):
        empty = empty & np.isnan(values)
        if not empty.any():
            return None if timed.good.all() else timed.good
    return timed.good & ~empty


def _texts(table: Table, column: int) -> list[tuple[int, str]]:
    """Rows of a column that hold something, as text."""
    values = table.columns[column].values
    filled = np.flatnonzero(values.astype(bool) if values.dtype == object else np.isfinite(values))
    texts = (
        (row, str(values[row]).strip() if values.dtype == object else f"{values[row]:g}") for row in filled.tolist()
    )
    return [(row, text) for row, text in texts if text]


def _events(timed: _Timed, column: int) -> list[tuple[int, str]]:
    """Events where they begin: a button held down fills many rows."""
    begun, last = [], (-2, "")
    for row, text in _texts(timed.table, column):
        if timed.good[row] and text != "0" and last != (row - 1, text):
            begun.append((int(timed.t_ns[row]), text))
        last = (row, text)
    return begun


def _tell_losses(tables: Sequence[Table], raw: RawLog) -> None:
    """Say it where more than one row or field in a hundred was lost."""
    rows = sum(map(len, tables))
    lost = {why: raw.counts[why] for why in ("lines_unreadable", "rows_impossible") if raw.counts.get(why)}
    if sum(lost.values()) > _SAID_SHARE * max(rows, 1):
        said = " and ".join(f"{number} {_SAID[why]}" for why, number in lost.items())
        raw.notices.append(f"of {rows + raw.counts.get('rows_too_long', 0)} rows, {said} are left out")
    for table in tables:
        for column in table.columns:
            if column.unreadable > _SAID_SHARE * max(len(table), 1):
                raw.notices.append(f"{column.unreadable} fields of column {column.name} are no numbers: left out")


_SAID = {"lines_unreadable": "that cannot be read", "rows_impossible": "with impossible numbers"}
