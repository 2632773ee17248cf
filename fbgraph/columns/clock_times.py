"""Times of a table's rows in nanoseconds, once it is known what tells them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.columns.guesses import ClockKind
from fbgraph.columns.tick_counts import SharedTicks, shared_ticks, spread, unwrapped, wraps_of
from fbgraph.columns.time_texts import DAY_NS, UNREAD, dates_ns, stamps_ns, times_of_day_ns
from fbgraph.columns.units import UNITS
from fbgraph.core.geometry import IntArray
from fbgraph.core.nanoseconds import MAX_T_NS, to_ns
from fbgraph.tables.table import Table

COUNTS = (2.0**8, 2.0**16, 2.0**32)
"""After how many samples a counter may begin again."""
_TAIL = 20  # rows before those that have just come, by which a clock goes on
_MATLAB_1970, _SPREADSHEET_1970, _LATE_DAY = 719_529, 25_569, 500_000  # days since the year 0, since 1900


@dataclass(frozen=True)
class Clock:
    """What tells the time of a table's rows.

    Attributes:
        kind: ``ticks`` (a number), ``days`` (since the year 0 or 1900, as Matlab and spreadsheets count), ``stamps``
            (text with a date), ``date_and_time`` (two columns), ``time_of_day``, ``hms`` (columns of hours, minutes,
            seconds) or ``samples`` (a counter, or the rows if there is no column).
        columns: of the table.
        tick_ns: nanoseconds of one unit of a number, or from sample to sample.
        wrap: after so many ticks the counter began again, at least once; 0 if it never did.
        why: for people.
        text: what people must know: what was assumed; ``""`` if nothing was.
    """

    kind: ClockKind
    columns: tuple[int, ...]
    tick_ns: float
    wrap: float
    why: str
    text: str = ""


def clock_ns(table: Table, clock: Clock) -> IntArray:
    """Times (N,) of a table's rows in nanoseconds, in their order; beyond ``MAX_T_NS`` where a row has none.

    Counters that begin again go on; times of day go on after midnight. Rows that share a tick of a coarse clock, three
    or more on average, are spread over it.
    """
    if clock.kind == "samples" and not clock.columns:
        return np.round(np.arange(len(table)) * clock.tick_ns).astype(np.int64)
    t_ns = _times([table.columns[i].values for i in clock.columns], clock)
    return t_ns if clock.kind == "samples" else spread(t_ns)


def _times(values: Sequence[NDArray[Any]], clock: Clock) -> IntArray:
    """Times (N,) of the columns of a clock, not yet spread."""
    if clock.kind == "ticks":
        return to_ns(unwrapped(values[0], _spans(clock))[0], int(clock.tick_ns))
    if clock.kind == "days":
        first = np.where(values[0] > _LATE_DAY, _MATLAB_1970, _SPREADSHEET_1970)
        return to_ns(values[0] - first, DAY_NS)
    if clock.kind == "samples":
        counts = unwrapped(values[0], COUNTS)[0]
        there = np.isfinite(counts) & (np.abs(counts) * clock.tick_ns < MAX_T_NS)
        return np.where(there, np.round(np.where(there, counts, 0) * clock.tick_ns), MAX_T_NS + 1).astype(np.int64)
    if clock.kind == "stamps":
        return _read(stamps_ns(values[0]))
    if clock.kind == "date_and_time":
        days, (times, _) = dates_ns(values[0]), times_of_day_ns(values[1])
        return _read(np.where((days == UNREAD) | (times == UNREAD), UNREAD, days + times))
    if clock.kind == "hms":
        hours, minutes, seconds = (np.asarray(column, dtype=float) for column in values)
        return _going_on(to_ns((hours * 60 + minutes) * 60 + seconds, 1_000_000_000), DAY_NS)
    times, period = times_of_day_ns(values[0])
    return _going_on(_read(times), period)


class RunningClock:
    """The same times as ``clock_ns`` gives, for rows that arrive a few at a time.

    Of a coarse clock the first rows, if they hold three ticks or more, tell how many share one: later rows are spread
    over theirs as if it had as many.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._rows = 0
        self._last: list[NDArray[Any]] = []
        self._last_ns = np.empty(0, dtype=np.int64)
        self._shared: SharedTicks | None = None

    def ns(self, table: Table) -> IntArray:
        """Times (N,) of the rows that came after all others."""
        clock = self._clock
        if clock.kind == "samples" and not clock.columns:
            rows = self._rows + np.arange(len(table))
            self._rows += len(table)
            return np.round(rows * clock.tick_ns).astype(np.int64)
        values = [table.columns[i].values for i in clock.columns]
        begins = not self._last
        if self._last:
            values = [np.concatenate(pair) for pair in zip(self._last, values, strict=True)]
        t_ns, before = _times(values, clock), self._last_ns
        known = np.flatnonzero((np.abs(t_ns[: len(before)]) <= MAX_T_NS) & (np.abs(before) <= MAX_T_NS))
        if len(known):  # where the clock began again before these rows, they go on
            t_ns = np.where(np.abs(t_ns) <= MAX_T_NS, t_ns + (before[known[0]] - t_ns[known[0]]), t_ns)
        self._last, self._last_ns = [each[-_TAIL:] for each in values], t_ns[-_TAIL:]
        came_ns = t_ns[len(before) :]
        if begins and clock.kind != "samples":
            self._shared = shared_ticks(came_ns)
        return came_ns if self._shared is None else self._shared.spread(came_ns)


def _spans(clock: Clock) -> tuple[float, ...]:
    unit = next((unit for unit, tick in UNITS["time"].items() if tick == clock.tick_ns), "")
    return (clock.wrap,) if clock.wrap else wraps_of(unit)


def _read(t_ns: IntArray) -> IntArray:
    return np.where(t_ns == UNREAD, MAX_T_NS + 1, t_ns).astype(np.int64)


def _going_on(t_ns: IntArray, period_ns: int) -> IntArray:
    """Times that go on where they began again: a jump of more than half a period is a whole one."""
    good = np.abs(t_ns) <= MAX_T_NS
    turns = np.cumsum(np.round(np.diff(t_ns[good]) / period_ns)).astype(np.int64)
    gone_on = t_ns.copy()
    gone_on[np.flatnonzero(good)[1:]] -= turns * period_ns
    return gone_on
