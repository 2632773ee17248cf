"""Times of a table's rows in nanoseconds, once it is known what tells them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.readers.cleaning import MAX_T_NS, to_ns
from fbgraph.readers.tick_counts import spread, unwrapped, wraps_of
from fbgraph.readers.time_texts import DAY_NS, UNREAD, dates_ns, stamps_ns, times_of_day_ns
from fbgraph.readers.units import UNITS
from fbgraph.tables.table import Table


@dataclass(frozen=True)
class Clock:
    """What tells the time of a table's rows.

    Attributes:
        kind: ``ticks`` (a number), ``stamps`` (text with a date), ``date_and_time`` (two columns), ``time_of_day``,
            ``hms`` (columns of hours, minutes, seconds) or ``samples`` (a counter, or the rows if there is no column).
        columns: of the table.
        tick_ns: nanoseconds of one unit of a number, or from sample to sample.
        wrap: after so many ticks the counter began again, at least once; 0 if it never did.
        why: for people.
        text: what people must know: what was assumed; ``""`` if nothing was.
    """

    kind: str
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
    values = [table.columns[i].values for i in clock.columns]
    if clock.kind == "ticks":
        t_ns = to_ns(unwrapped(values[0], _spans(clock))[0], int(clock.tick_ns))
    elif clock.kind == "samples":
        counts = unwrapped(values[0], (2.0**8, 2.0**16, 2.0**32))[0]
        there = np.isfinite(counts) & (np.abs(counts) * clock.tick_ns < MAX_T_NS)
        t_ns = np.where(there, np.round(np.where(there, counts, 0) * clock.tick_ns), MAX_T_NS + 1).astype(np.int64)
    elif clock.kind == "stamps":
        t_ns = _read(stamps_ns(values[0]))
    elif clock.kind == "date_and_time":
        days, (times, _) = dates_ns(values[0]), times_of_day_ns(values[1])
        t_ns = _read(np.where((days == UNREAD) | (times == UNREAD), UNREAD, days + times))
    elif clock.kind == "hms":
        hours, minutes, seconds = (np.asarray(column, dtype=float) for column in values)
        t_ns = _going_on(to_ns((hours * 60 + minutes) * 60 + seconds, 1_000_000_000), DAY_NS)
    else:
        times, period = times_of_day_ns(values[0])
        t_ns = _going_on(_read(times), period)
    return t_ns if clock.kind == "samples" else spread(t_ns)


class RunningClock:
    """The same times as ``clock_ns`` gives, for rows that arrive a few at a time.

    A coarse clock is spread only within the rows that come together.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._rows = 0
        self._last: FloatArray | IntArray = np.empty(0, dtype=np.int64)
        self._shift_ns = 0
        self._last_ns: int | None = None

    def ns(self, table: Table) -> IntArray:
        """Times (N,) of the rows that came after all others."""
        clock = self._clock
        if clock.kind == "samples" and not clock.columns:
            t_ns = np.round((self._rows + np.arange(len(table))) * clock.tick_ns).astype(np.int64)
            self._rows += len(table)
            return t_ns
        t_ns = clock_ns(table, clock)
        good = np.flatnonzero(np.abs(t_ns) <= MAX_T_NS)
        if len(good) == 0:
            return t_ns
        if period := self._period_ns(table):
            first = int(t_ns[good[0]])
            if self._last_ns is not None and first + self._shift_ns < self._last_ns - period // 2:
                self._shift_ns += period
            t_ns = np.where(np.abs(t_ns) <= MAX_T_NS, t_ns + self._shift_ns, t_ns)
        self._last_ns = int(t_ns[good[-1]])
        return t_ns

    def _period_ns(self, table: Table) -> int:
        """After how long the clock begins again, if what has just come is a beginning."""
        clock = self._clock
        if clock.kind in ("time_of_day", "hms"):
            return DAY_NS if clock.kind == "hms" else times_of_day_ns(table.columns[clock.columns[0]].values[:1])[1]
        if clock.kind not in ("ticks", "samples"):
            return 0
        values = table.columns[clock.columns[0]].values
        spans = _spans(clock) if clock.kind == "ticks" else (2.0**8, 2.0**16, 2.0**32)
        joined = np.concatenate((self._last, values))
        after = unwrapped(joined, spans)[1]
        before = unwrapped(values, spans)[1]
        self._last = joined[-50:]
        return round(after * clock.tick_ns) if after and not before else 0


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
