"""Which column of a table tells time, and its times as nanoseconds.

A clock is a number that counts ticks, a date and time of day, or a count of samples of a known rate. Names propose and
the steps decide: what a column calls itself is believed if its rows then come at a rate that sensors have.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fbgraph.columns.app_layouts import flat_name
from fbgraph.columns.clock_times import COUNTS, Clock, clock_ns
from fbgraph.columns.guesses import ClockKind, Guess
from fbgraph.columns.tick_counts import damage, distinct, progress, step_of, unwrapped, wraps_of
from fbgraph.columns.time_texts import kind_of_text
from fbgraph.columns.units import UNITS, shown
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.core.safe_text import short_name
from fbgraph.core.sampling import runs_of
from fbgraph.tables.table import Table

ASSUMED_RATE_HZ = 50.0
_INERTIAL_HZ, _ANY_HZ = (2.0, 5000.0), (1e-3, 5000.0)
_TICKS = ("s", "ms", "us", "ns", "100us", "day")
_EPOCH_S = (946_684_800.0, 4_102_444_800.0)  # 2000 to 2100
_HMS = ("hour|hours|hh|h|std|stunde|hr", "minute|minutes|min|mins|mm|mi", "second|seconds|sec|secs|ss|s|sek")
_FEW_ROWS = 20
_GROWS = 0.99  # of the steps of a counter


@dataclass(frozen=True)
class _Trial:
    """A clock that a column may be, and how good it is; or why it is none."""

    clock: Clock | None
    rank: tuple[float, ...] = ()
    fault: str = ""
    column: int = -1


def find_clock(
    table: Table, guesses: Sequence[Guess], rate_hz: float | None = None, labels: Sequence[Table] = ()
) -> Clock:
    """What tells the time of a table's rows.

    Args:
        table: with two rows or more.
        guesses: what ``guess_columns`` says of it.
        rate_hz: of the samples, if the user gave it: it goes before every clock of the table.
        labels: tables beside that may say at which sample (``StartSampleID``) which time was.

    Raises:
        DataError: a column looks like time but cannot be read as one, and no other can; with what is wrong.
    """
    counter = _counter(table, guesses)
    columns = () if counter is None else (counter,)
    source = f"counted by {_name(table, counter)}" if counter is not None else "evenly spaced rows"
    if rate_hz is not None:
        return Clock("samples", columns, 1e9 / rate_hz, 0, source, f"{source}, {rate_hz:g} Hz as given")
    trials = list(_trials(table, guesses))
    good = [trial for trial in trials if trial.clock]
    if good:
        best = max(good, key=lambda trial: trial.rank).clock
        assert best is not None
        return best
    if counter is not None and (rate := labelled_rate_hz(table.columns[counter].name, labels)):
        text = f"no time column: {source}, {rate:.4g} Hz by the labels beside"
        return Clock("samples", columns, 1e9 / rate, 0, source, text)
    if trials:
        raise DataError(
            f"{table.source}: column {_name(table, trials[0].column)} {trials[0].fault}; mend it, name the clock in a "
            "layout (--layout FILE), or give the rate of the samples (--rate HZ)"
        )
    if (unread := _looks_like_time(table, guesses)) is not None:
        raise DataError(
            f"{table.source}: column {_name(table, unread)} grows like a clock but its name does not say so: name it "
            "like t_ms, say in a layout what it is (--layout FILE), or give the rate of the samples (--rate HZ)"
        )
    text = f"no time column: {source}, {ASSUMED_RATE_HZ:g} Hz assumed; give the true rate with --rate HZ"
    return Clock("samples", columns, 1e9 / ASSUMED_RATE_HZ, 0, source, text)


def labelled_rate_hz(counter: str, labels: Sequence[Table]) -> float | None:
    """The rate of samples, where a table beside says at which sample which time was; None if none does.

    Args:
        counter: the name of the column that counts samples.
        labels: tables with a column that ends in that name (``StartSampleID``) and a time.
    """
    wanted = flat_name(counter).replace("_", "")
    for table in labels:
        for i, column in enumerate(table.columns):
            name = flat_name(column.name).replace("_", "")
            if not wanted or column.is_text or name == wanted or not name.endswith(wanted) or len(table) < 3:
                continue
            times = [trial.clock for trial in _hms_trials(table) if trial.clock]
            if times and i not in times[0].columns:
                t_s = clock_ns(table, times[0]) * 1e-9
                samples = np.asarray(column.values, dtype=float)
                rate = float((samples[-1] - samples[0]) / max(t_s[-1] - t_s[0], 1e-9))
                if _INERTIAL_HZ[0] <= rate <= _INERTIAL_HZ[1]:
                    return rate
    return None


def _trials(table: Table, guesses: Sequence[Guess]) -> list[_Trial]:
    """Every column that may be time, tried."""
    hms = _hms_trials(table)
    parts = {i for trial in hms if trial.clock for i in trial.clock.columns}
    trials = list(hms)
    top: dict[int, float] = {}
    for guess in guesses:
        top[guess.column] = max(top.get(guess.column, 0.0), guess.weight)
    times = [g for g in guesses if g.quantity in ("time", "time_of_day", "date") and g.column not in parts]
    dates = [g for g in times if table.columns[g.column].is_text and _text_kind(table, g.column) == "date"]
    for guess in times:
        if guess.weight < top[guess.column]:
            continue
        column = table.columns[guess.column]
        kind = _text_kind(table, guess.column) if column.is_text else "number"
        if kind == "number":
            trials.append(_try_number(table, guess, _is_inertial(guesses)))
        elif kind == "stamp":
            trials.append(_try_text(table, Clock("stamps", (guess.column,), 1.0, 0, guess.why), guess))
        elif kind == "time_of_day":
            if dates:
                columns = (dates[0].column, guess.column)
                clock = Clock("date_and_time", columns, 1.0, 0, f"{dates[0].why}, {guess.why}")
                trials.append(_try_text(table, clock, guess))
            trials.append(_try_text(table, Clock("time_of_day", (guess.column,), 1.0, 0, guess.why), guess))
        elif guess.quantity == "time":
            first = next((str(value) for value in column.values if value), "")
            fault = f"holds no times that can be read (it begins {short_name(first)!r})" if first else "is empty"
            trials.append(_Trial(None, fault=fault, column=guess.column))
    return trials


def _text_kind(table: Table, column: int) -> str:
    return kind_of_text(table.columns[column].values)


def _is_inertial(guesses: Sequence[Guess]) -> bool:
    return any(guess.quantity in ("acc", "gyro", "linear_acc") and guess.weight > 0.3 for guess in guesses)


def _rank(t: FloatArray | IntArray, number: bool, weight: float, kind: str) -> tuple[float, ...]:
    """Fine clocks before coarse ones, numbers before texts, sure names before others, date and time before a time."""
    rows = max(len(t), 1)
    fine = distinct(t) / rows
    return (fine > 0.34, min(round(fine, 1), 0.9), weight > 0.4, number, weight, kind == "date_and_time", fine)


def _try_number(table: Table, guess: Guess, inertial: bool) -> _Trial:
    """A column of numbers as a clock."""
    name = _name(table, guess.column)
    values = table.columns[guess.column].values
    there = np.isfinite(values)
    values = values if there.all() else values[there]

    def none(fault: str) -> _Trial:
        return _Trial(None, fault=fault, column=guess.column)

    if len(values) == 0:
        return none("is empty")
    if fault := damage(values):
        return none(fault)
    t, wrap = unwrapped(values, wraps_of(guess.unit))
    if len(values) > 1 and t.max() == t.min():
        return none(f"is always {values[0]:g}: it tells no time")
    if len(values) > _FEW_ROWS and not progress(t):
        how = "goes backwards" if (np.diff(t) < 0).mean() > 0.5 else "does not grow"
        return none(f"{how} from row to row: it tells no time")
    step = step_of(t)
    if not guess.unit and len(values) > _FEW_ROWS and values.dtype.kind == "i" and (np.diff(t) == 1).mean() > 0.97:
        return none("grows by 1 from row to row, like a counter of samples: its unit is unknown")
    unit, text = _tick(name, guess.unit, float(np.median(runs_of(t))), step, inertial and len(values) > _FEW_ROWS)
    if not unit:
        return none(text)
    if wrap:
        text = f"{text}; " if text else ""
        text += f"column {name} begins again after {wrap:.10g}: its times go on"
    kind: ClockKind = "days" if unit == "day" else "ticks"
    clock = Clock(kind, (guess.column,), UNITS["time"][unit], wrap, f"{guess.why}, counts {shown(unit)}", text)
    return _Trial(clock, _rank(t, True, guess.weight, "ticks"), column=guess.column)


def _tick(name: str, unit: str, middle: float, step: float, inertial: bool) -> tuple[str, str]:
    """The unit of a clock's numbers, and what to say of it; ``""`` and why not, if there is none.

    Args:
        name: of the column, for messages.
        unit: that it names.
        middle: of its values.
        step: from row to row.
        inertial: whether its rows are many and of an accelerometer or gyroscope.
    """
    low, high = _INERTIAL_HZ if inertial else _ANY_HZ

    def rate(tick: str) -> float:
        return 1e9 / (step * UNITS["time"][tick]) if step > 0 else 1.0

    def is_epoch(tick: str) -> bool:
        return _EPOCH_S[0] < middle * UNITS["time"][tick] * 1e-9 < _EPOCH_S[1]

    if unit and low <= rate(unit) <= high:
        return unit, ""
    fits = [tick for tick in ("s", "ms", "us", "ns") if is_epoch(tick) and low <= rate(tick) <= high]
    if not fits and (2e4 < middle < 1e5 or 7e5 < middle < 8e5):  # days since 1900 or the year 0
        fits = [tick for tick in ("day",) if 2.0 <= rate(tick) <= 2000.0]
    if not fits:
        bounds = (2.0, 2000.0) if inertial else (0.02, 20.0)
        fits = [tick for tick in ("s", "ms", "us", "ns") if bounds[0] < rate(tick) <= bounds[1]]
    if not fits:  # places as often as samples
        fits = [tick for tick in ("s", "ms", "us", "ns") if 2.0 < rate(tick) <= 2000.0]
    if not fits:
        seen = f"{shown(unit)} would be {rate(unit):.3g} Hz" if unit else "no unit makes a rate of sensors of that"
        return "", f"grows by {step:.6g} from row to row: {seen}"
    tick = fits[0]
    if unit:
        seen = f"{rate(unit):.3g} Hz in the {shown(unit)} that it names"
        return tick, f"{name}: steps of {step:.6g} are {seen}: taken as {shown(tick)} ({rate(tick):.4g} Hz)"
    how = "since 1970" if is_epoch(tick) else f"steps of {step:.6g}"
    return tick, f"{name}: no unit in its name, {how}: taken as {shown(tick)} ({rate(tick):.4g} Hz)"


def _try_text(table: Table, clock: Clock, guess: Guess) -> _Trial:
    t_ns = clock_ns(table, clock)
    good = t_ns[np.abs(t_ns) <= MAX_T_NS]
    if len(good) < len(t_ns) / 2:
        return _Trial(None, fault="holds texts that are mostly no times", column=guess.column)
    if len(good) > 1 and good.max() == good.min():
        return _Trial(None, fault="always says the same time", column=guess.column)
    if len(good) > _FEW_ROWS and not progress(good):
        return _Trial(None, fault="does not grow from row to row: it tells no time", column=guess.column)
    raw = replace(clock, text=_coarse_text(table, clock))
    values = [table.columns[i].values for i in clock.columns]
    distinct = np.unique(np.array([str(value) for value in values[-1]]), return_inverse=True)[1]
    return _Trial(raw, _rank(distinct, False, guess.weight, clock.kind), column=guess.column)


def _coarse_text(table: Table, clock: Clock) -> str:
    values = table.columns[clock.columns[-1]].values
    distinct = len({str(value) for value in values})
    if len(values) < 3 * distinct:
        return ""
    many = len(values) / distinct
    return f"{_name(table, clock.columns[-1])}: {many:.3g} rows show the same time: spread evenly over it"


def _hms_trials(table: Table) -> list[_Trial]:
    """Hours, minutes and seconds in columns of their own."""
    names = [flat_name(column.name) for column in table.columns]
    found = [[i for i, name in enumerate(names) if re.fullmatch(pattern, name)] for pattern in _HMS]
    if not all(found) or any(table.columns[places[0]].is_text for places in found):
        return []
    clock = Clock("hms", tuple(places[0] for places in found), 1.0, 0, "hours, minutes and seconds in three columns")
    t_ns = clock_ns(table, clock)
    if len(t_ns) > 1 and t_ns.max() == t_ns.min():
        return []
    return [_Trial(clock, _rank(t_ns, True, 0.7, "hms"), column=clock.columns[0])]


def _counter(table: Table, guesses: Sequence[Guess]) -> int | None:
    """The column that counts samples: whole numbers that grow, but for a line or two that were garbled."""
    for guess in guesses:
        if guess.quantity == "counter" and guess.weight > 0.4:
            values = table.columns[guess.column].values
            there = values[np.isfinite(values)] if values.dtype.kind in "if" else values[:0]
            if len(there) > 1 and (there == np.rint(there)).all():
                steps = np.diff(unwrapped(there, COUNTS)[0])
                if (steps > 0).mean() >= _GROWS and np.median(steps) < 10:
                    return guess.column
    return None


def _looks_like_time(table: Table, guesses: Sequence[Guess]) -> int | None:
    """A column of unknown meaning that grows all the time, in steps unlike a counter's."""
    unknown = {guess.column for guess in guesses if guess.quantity == "unknown"}
    known = {guess.column for guess in guesses if guess.quantity != "unknown" and guess.weight > 0.3}
    for i in sorted(unknown - known):
        values = table.columns[i].values
        if values.dtype == object:
            if kind_of_text(values):
                return i
            continue
        values = values[np.isfinite(values)]
        steps = np.diff(values)
        if len(steps) >= _FEW_ROWS and (steps > 0).mean() > 0.99 and not (steps == 1).mean() > 0.9:
            return i
    return None


def _name(table: Table, column: int) -> str:
    return short_name(table.columns[column].name) or f"{column + 1}"
