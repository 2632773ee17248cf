"""Numbers that count ticks: where they begin again, whether they grow, how a spreadsheet spoils them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.columns.units import UNITS
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.sampling import runs_of

_NEAR_STEPS = 100  # a counter that begins again left out fewer rows than this
_DAY_S, _WEEK_S = 86_400.0, 604_800.0
_FEW_DIGITS = 7  # of a spreadsheet's 1.73E+12
_COARSE_ROWS = 3.0


def wraps_of(unit: str) -> tuple[float, ...]:
    """After how many ticks a clock of a unit may begin again: 16 and 32 bits of any smaller tick, a day, a week."""
    tick = UNITS["time"].get(unit, 1.0)
    spans = {2.0**16, 2.0**32, 2.0**24}
    if unit in ("s", "ms"):  # micros() / 1e6
        spans |= {2.0**bits * UNITS["time"][other] / tick for bits in (16, 32) for other in ("ms", "us")}
    ticks = [tick] if unit else [1e9, 1e6, 1e3, 1.0]
    spans |= {seconds * 1e9 / each for seconds in (_DAY_S, _WEEK_S) for each in ticks}
    return tuple(sorted(spans))


@np.errstate(over="ignore")  # ticks that a garbled line made huge
def unwrapped(values: NDArray[Any], spans: Sequence[float]) -> tuple[FloatArray | IntArray, float]:
    """Ticks that go on where their counter began again, and after how many it did (0.0 if it never did).

    A counter begins again if it falls by nearly a whole span, so that the step over the end would be like the others;
    a clock that was restarted falls by any number.

    Args:
        values: (N,) in the order of the rows; nan stays.
        spans: after how many ticks it may.
    """
    there = np.isfinite(values)
    ticks = values if there.all() else values[there]
    if len(ticks) < 2:
        return values, 0.0
    steps = np.diff(ticks)
    shortest, longest = steps.min(), steps.max()
    most = max(_NEAR_STEPS * float(shortest), 0.4 * min(spans))
    if longest <= most and shortest >= -most:  # nothing to look at one by one
        return values, 0.0
    usual = step_of(ticks)
    large = np.flatnonzero(np.abs(steps) > max(_NEAR_STEPS * usual, 0.4 * min(spans)))
    if usual <= 0 or len(large) == 0 or len(large) > 10 + len(ticks) // 20:
        return values, 0.0
    shifts = np.zeros(len(steps), dtype=ticks.dtype)
    found = 0.0
    turns = 0
    for i in large.tolist():
        down = steps[i] < 0
        for span in (found,) if found else spans:
            over = span - abs(float(steps[i]))
            if abs(over) <= min(_NEAR_STEPS * usual, 0.05 * span) and (over > 0) and (down or turns > 0):
                shifts[i] = span if down else -span
                turns += 1 if down else -1
                found = span
                break
    if not found:
        return values, 0.0
    gone_on = values.copy()
    gone_on[np.flatnonzero(there)[1:]] += np.cumsum(shifts)
    return gone_on, found


def step_of(ticks: FloatArray | IntArray) -> float:
    """The usual step from row to row; where many rows share a tick, of a tick by its rows.

    Rows out of order do not disturb it.
    """
    steps = np.diff(ticks)
    if len(steps) == 0:
        return 0.0
    if (steps < 0).mean() > 0.05:
        steps = np.diff(np.sort(ticks))
    grows = int(np.count_nonzero(steps > 0))
    if not grows:
        return 0.0
    rows = len(ticks) / (grows + 1)
    some = runs_of(steps)
    usual = float(np.median(some[some > 0] if (some > 0).any() else steps[steps > 0]))
    return usual / rows if rows >= _COARSE_ROWS else usual


def distinct(values: NDArray[Any]) -> int:
    """How many different numbers there are; by sorting, as numpy's table of whole numbers is ten times as slow."""
    steps = np.diff(values)
    steps = steps if len(steps) == 0 or steps.min() >= 0 else np.diff(np.sort(values))
    return 1 + int(np.count_nonzero(steps)) if len(values) else 0


def progress(ticks: FloatArray | IntArray) -> bool:
    """Whether ticks grow: nearly always, or from end to end with rows out of order."""
    steps = np.diff(ticks)
    if np.count_nonzero(steps >= 0) >= 0.97 * len(steps):
        return True
    first, last = np.median(ticks[:9]), np.median(ticks[-9:])
    span = float(np.percentile(ticks, 99) - np.percentile(ticks, 1))
    return bool(span > 0 and (last - first) / span > 0.9 and (steps > 0).mean() > 0.5)


def damage(values: NDArray[Any]) -> str:
    """How a spreadsheet spoilt large times, for people; ``""`` if it did not.

    ``1730000000018`` shown as ``1.73E+12`` and saved so has lost its digits.
    """
    if len(values) < 3 or (values.min() > -1e8 and values.max() < 1e8):
        return ""
    ticks = np.abs(values.astype(float))
    middle = np.quantile(ticks, 0.5, method="lower")  # the mean of two may be beyond any number
    if middle < 1e8 or not _are_short(runs_of(ticks)) or not _are_short(ticks):
        return ""
    if distinct(ticks) > len(ticks) / 5:
        return ""
    return (
        f"lost its last digits (it begins {values[0]:.6g}, as a spreadsheet shows large numbers): export the log again "
        "without opening it in a spreadsheet"
    )


def _are_short(ticks: FloatArray) -> bool:
    """Whether nearly all have no more digits than a spreadsheet shows."""
    digits = np.floor(np.log10(np.maximum(ticks, 1.0)))
    lost = 10.0 ** np.maximum(digits - (_FEW_DIGITS - 1), 0)
    short = np.abs(np.round(ticks / lost) * lost - ticks) < 1e-12 * ticks
    return bool(short.mean() >= 0.99)


def spread(t_ns: IntArray) -> IntArray:
    """Times (N,) of a coarse clock, with the rows of each tick spread evenly over it; fine ones as they are.

    Of the first tick the last rows were seen, of the last the first.
    """
    if len(t_ns) < 2 or len(t_ns) < _COARSE_ROWS * (1 + np.count_nonzero(t_ns[1:] != t_ns[:-1])):
        return t_ns
    starts = np.flatnonzero(np.diff(t_ns, prepend=t_ns[0] - 1))
    if len(t_ns) < _COARSE_ROWS * len(starts) or len(starts) < 3:
        return t_ns
    counts = np.diff(np.append(starts, len(t_ns)))
    ticks = np.diff(t_ns[starts])
    usual_ns = int(np.median(ticks[ticks > 0])) if (ticks > 0).any() else 0
    lengths = np.append(np.clip(ticks, 0, usual_ns), usual_ns)
    usual_rows = int(np.median(counts))
    rows, before = counts.copy(), np.zeros(len(counts), dtype=np.int64)
    rows[[0, -1]] = np.maximum(counts[[0, -1]], usual_rows)
    before[0] = rows[0] - counts[0]
    place = np.arange(len(t_ns)) - np.repeat(starts, counts) + np.repeat(before, counts)
    within: IntArray = (np.repeat(lengths, counts) * place) // np.repeat(rows, counts)
    return t_ns + within


class SharedTicks:
    """Spreads the rows of each tick of a coarse clock over it as they arrive.

    Args:
        rows: that a tick usually has.
        tick_ns: from tick to tick.
        first: rows of the first tick, of which the last were seen.
    """

    def __init__(self, rows: int, tick_ns: int, first: int) -> None:
        self._rows = rows
        self._tick_ns = tick_ns
        self._row = max(rows - first, 0)
        self._now: int | None = None

    def spread(self, t_ns: IntArray) -> IntArray:
        """Times (N,) of the rows that came after all others; one too many for its tick still comes before the next."""
        spread_ns = []
        for now in t_ns.tolist():
            if self._now is not None and now != self._now:
                self._row = 0
            self._now = now
            spread_ns.append(now + self._tick_ns * self._row // max(self._rows, self._row + 1))
            self._row += 1
        return np.array(spread_ns, dtype=np.int64)


def shared_ticks(t_ns: IntArray) -> SharedTicks | None:
    """How rows share the ticks of a coarse clock, of which these times (N,) are the first; None if it is fine."""
    starts = np.flatnonzero(np.diff(t_ns, prepend=t_ns[:1] - 1))
    if len(starts) < 3 or len(t_ns) < _COARSE_ROWS * len(starts):
        return None
    counts, ticks = np.diff(starts), np.diff(t_ns[starts])
    usual = int(np.median(counts[1:]))
    return SharedTicks(usual, int(np.median(ticks[ticks > 0])) if (ticks > 0).any() else 0, int(counts[0]))
