"""Names propose, physics decides: from tables to the one layout by which a log is read.

A file, a folder and the first lines of a live walk are decided by the same rule; a live walk keeps what was decided.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fbgraph.columns.choosing import choose, has_values
from fbgraph.columns.clock_times import Clock, clock_ns
from fbgraph.columns.clocks import find_clock
from fbgraph.columns.column_names import guess_columns
from fbgraph.columns.guesses import Chosen, Guess, Pick
from fbgraph.columns.units import UNITS, shown
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.core.safe_text import short_name
from fbgraph.core.sensor_log import Stream
from fbgraph.physics.judge_sensors import judge_sensors
from fbgraph.physics.judgement import Judged, Judgement
from fbgraph.physics.likely_samples import likely
from fbgraph.physics.pieces import Pieces
from fbgraph.readers.canonical_csv import noted_preset
from fbgraph.readers.cleaning import are_repeated, kept
from fbgraph.readers.formats import format_of
from fbgraph.readers.layout import ANY, ClockLayout, Layout, StreamLayout, axes_of
from fbgraph.readers.reading import Reading
from fbgraph.tables.table import Table

SENSORS = ("acc", "gyro", "mag", "pressure")
_HANGS_NS = 1_000_000_000
_FEW_SAMPLES = 300  # of pieces of a log, from which nothing is told
_COMMON_SHARE = 0.01  # of rows, from which a shorter one is a habit of the logger, not a line cut short


def decide(tables: Sequence[Table], source: object, rate_hz: float | None = None) -> Reading:
    """How a log's tables are to be read.

    Args:
        tables: all of the log's.
        source: for messages.
        rate_hz: of the samples, where the user says so.

    Raises:
        DataError: no accelerometer with gravity, no gyroscope, or a clock that cannot be read; with what to do.
    """
    names = tuple(table.name for table in tables)
    guesses = tuple(guess_columns(table, names) for table in tables)
    chosen = choose(tables, guesses)
    picks = chosen.picks
    _require_inertial(tables, chosen, source)
    used = sorted({picks[name].table for name in (*SENSORS, "linear_acc", "gravity") if name in picks})
    labels = [table for i, table in enumerate(tables) if i not in used]
    widths = {i: row_widths(tables[i], guesses[i]) for i in used}
    whole = {i: tables[i] if tables[i].widths is None else tables[i].rows(tables[i].whole(widths[i])) for i in used}
    clocks = {i: find_clock(whole[i] if len(whole[i]) else tables[i], guesses[i], rate_hz, labels) for i in used}
    t_ns = {i: clock_ns(tables[i], clock) for i, clock in clocks.items()}
    samples = _looked_at({i: (tables[i], t_ns[i], widths[i]) for i in used}, picks)
    named = {name: UNITS[name][pick.unit] for name, pick in picks.items() if name in SENSORS and pick.unit}
    if "acc" not in samples:
        samples["acc"], named["acc"] = _restored(samples, picks), 1.0
    judged = judge_sensors(samples["acc"], samples["gyro"], samples.get("mag"), samples.get("pressure"), named)
    if judged.acc.gravity_removed:
        raise DataError(f"{source}: {_NO_GRAVITY}")
    layout = _layout(tables, chosen, judged, clocks, widths)
    for name in layout.streams.keys() & {"mag", "pressure"}:
        slow = layout.streams[name].model_copy(update={"repeats": are_repeated(samples[name].values)})
        layout = layout.model_copy(update={name: slow})
    texts = (
        *_unheaded(tables, guesses, used),
        *chosen.notes,
        *dict.fromkeys(clock.text for clock in clocks.values() if clock.text),
        *judged.texts,
    )
    return Reading(layout, guesses, chosen, judged, clocks, texts)


def with_expected(reading: Reading, tables: Sequence[Table]) -> Layout:
    """The layout with what is named but had no value yet, for rows still to come: a field, a pressure, an event.

    Their units and axes are taken as named, for there is nothing yet by which physics could decide.
    """
    layout, many = reading.layout, len(tables) > 1
    found: dict[str, object] = {}
    for pick, _ in reading.chosen.passed_over:
        name = pick.quantity
        if any(has_values(tables[pick.table], column) for column in pick.columns) or name in found:
            continue
        if name == "event" and layout.event is None:
            found[name] = (_table(tables, pick.table, many), _columns(tables, pick)[0])
        elif name in ("mag", "pressure") and getattr(layout, name) is None and pick.unit:
            judgement = Judgement(UNITS[name][pick.unit], shown(pick.unit), "name", False)
            found[name] = _stream(tables, pick, judgement, many).model_copy(update={"repeats": True})
    return layout.model_copy(update=found)


_NO_GRAVITY = (
    "the accelerometer has gravity removed, so that nothing tells which way is down: log it with gravity (phyphox: "
    "Accelerometer, not Linear; Sensor Logger: TotalAcceleration, or Gravity beside Accelerometer)"
)


def _require_inertial(tables: Sequence[Table], chosen: Chosen, source: object) -> None:
    """Refuse what is no log of a walk, and say what it lacks."""
    picks = chosen.picks
    if "acc" not in picks and not {"linear_acc", "gravity"} <= picks.keys():
        if "linear_acc" in picks:
            raise DataError(f"{source}: {_NO_GRAVITY}")
        if not any(table.headed for table in tables):
            raise DataError(
                f"{source}: no header names the columns: put one before the first row, such as "
                "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps, or say in a layout what they are (--layout FILE)"
            )
        raise DataError(f"{source}: no accelerometer: {_seen(tables)}; name its columns like ax_g,ay_g,az_g")
    if "gyro" not in picks:
        raise DataError(
            f"{source}: no gyroscope: {_seen(tables)}; a walk cannot be reconstructed without one: "
            "log it too, or name its columns like gx_dps,gy_dps,gz_dps"
        )


def _unheaded(tables: Sequence[Table], guesses: Sequence[Sequence[Guess]], used: Sequence[int]) -> list[str]:
    """What the columns of tables without a header are taken for."""
    said = []
    for i in used:
        if not tables[i].headed:
            best = {guess.column: guess for guess in reversed(guesses[i])}
            names = ",".join(_as_name(best[column]) for column in sorted(best))
            of = f"{short_name(tables[i].name)}: " if len(tables) > 1 else ""
            said.append(f"{of}no header: columns taken as {names}")
    return said


def _as_name(guess: Guess) -> str:
    letter = {"acc": "a", "gyro": "g", "mag": "m", "pressure": "p", "time": "t", "temperature": "temp"}
    name = f"{letter.get(guess.quantity, guess.quantity)}{guess.axis}"
    return f"{name}_{guess.unit}" if guess.unit else name


def _seen(tables: Sequence[Table]) -> str:
    """What columns there are."""
    names = [column.name for table in tables for column in table.columns if column.name]
    return f"the columns are {', '.join(names[:12])}{', …' if len(names) > 12 else ''}" if names else "no names"


def row_widths(table: Table, guesses: Sequence[Guess]) -> tuple[int, ...]:
    """How many fields rows of a table may have besides all: where many end early, between two sensors.

    A row of any other length was cut short, or lost a separator: its numbers may stand in the wrong columns.
    """
    if table.widths is None:
        return ()
    full = len(table.columns)
    best = {guess.column: guess for guess in reversed(guesses)}
    counts = np.bincount(table.widths, minlength=full + 1)
    return tuple(
        width
        for width in range(1, full)
        if counts[width] >= max(_COMMON_SHARE * len(table), 3) and _ends_a_sensor(best, width)
    )


def _ends_a_sensor(best: Mapping[int, Guess], width: int) -> bool:
    before, after = best.get(width - 1), best.get(width)
    if before is None or after is None:
        return True
    same = (before.quantity, before.sensor, before.grade) == (after.quantity, after.sensor, after.grade)
    return not (same and after.axis not in ("", "x"))


def _looked_at(
    tables: Mapping[int, tuple[Table, IntArray, Sequence[int]]], picks: Mapping[str, Pick]
) -> dict[str, Stream]:
    """What the picked sensors say, of a long log in pieces; of one that speaks seldom they tell too little.

    Args:
        tables: with the times of their rows, and how many fields those may have.
        picks: by quantity.
    """
    sensors = {name: pick for name, pick in picks.items() if name in (*SENSORS, "linear_acc", "gravity")}
    inertial = picks["acc"] if "acc" in picks else picks["linear_acc"]
    pieces = Pieces.of(tables[inertial.table][1])
    samples = {}
    if pieces is not None:
        seen = {}
        for i, (table, t_ns, widths) in tables.items():
            rows, moved_ns = pieces.rows(t_ns)
            seen[i] = table.rows(rows), moved_ns, widths
        samples = {name: _samples(name, *seen[pick.table], pick) for name, pick in sensors.items()}
    if not samples or min(len(t_ns) for t_ns, _ in samples.values()) < _FEW_SAMPLES:
        samples = {name: _samples(name, *tables[pick.table], pick) for name, pick in sensors.items()}
    first_ns = min((int(t_ns[0]) for t_ns, _ in samples.values() if len(t_ns)), default=0)
    return {name: Stream(np.asarray((t_ns - first_ns) * 1e-9), values) for name, (t_ns, values) in samples.items()}


def _samples(name: str, table: Table, t_ns: IntArray, widths: Sequence[int], pick: Pick) -> tuple[IntArray, FloatArray]:
    """What a pick's columns hold (N, D) and when, in order of time, with the signs that its app is known to need."""
    values = table.numbers(pick.columns)
    good = np.isfinite(values).all(axis=1) & (np.abs(t_ns) <= MAX_T_NS) & table.whole(widths)
    good &= likely(name, values, good)
    t, values = kept(good, t_ns, values)
    if (np.array(pick.signs) != 1).any():
        values = values * np.array(pick.signs)
    if len(t) and not (np.diff(t) > 0).all():
        t, first = np.unique(t, return_index=True)
        values = values[first]
    alive = _alive(t, values) if name in ("acc", "gyro", "mag") else np.ones(len(t), dtype=bool)
    if not alive.all():
        t, values = t[alive], values[alive]
    return t, values


def _alive(t_ns: IntArray, values: FloatArray) -> BoolArray:
    """Which samples a sensor measured that does not hang: one that repeats itself for a second tells nothing."""
    if len(values) < 2:
        return np.ones(len(values), dtype=bool)
    fresh = np.ones(len(values), dtype=bool)
    fresh[1:] = (values[1:] != values[:-1]).any(axis=1)
    first = np.flatnonzero(fresh)
    last = np.append(first[1:] - 1, len(values) - 1)
    hangs = t_ns[last] - t_ns[first] > _HANGS_NS
    return ~np.repeat(hangs, last - first + 1) if hangs.any() and not hangs.all() else np.ones(len(values), dtype=bool)


def _restored(samples: Mapping[str, Stream], picks: Mapping[str, Pick]) -> Stream:
    """The accelerometer with gravity, m/s²: what is left without it, and gravity at those moments."""
    linear, gravity = samples["linear_acc"], samples["gravity"]
    scales = {name: UNITS[name].get(picks[name].unit, 1.0) for name in ("linear_acc", "gravity")}
    down = np.column_stack([np.interp(linear.t_s, gravity.t_s, axis) for axis in gravity.values.T])
    return Stream(linear.t_s, linear.values * scales["linear_acc"] + down * scales["gravity"])


def _layout(
    tables: Sequence[Table],
    chosen: Chosen,
    judged: Judged,
    clocks: Mapping[int, Clock],
    widths: Mapping[int, tuple[int, ...]],
) -> Layout:
    """What was decided, as a layout."""
    picks, judgements = chosen.picks, vars(judged)
    many = len(tables) > 1
    streams: dict[str, StreamLayout] = {}
    for name in SENSORS:
        judgement: Judgement | None = judgements[name]
        source = "linear_acc" if name == "acc" and "acc" not in picks else name
        if judgement is None or source not in picks or not np.isfinite(judgement.scale):
            continue
        streams[name] = _stream(tables, picks[source], judgement, many)
        if source == "linear_acc":
            gravity = _stream(tables, picks["gravity"], None, many)
            scale = UNITS["linear_acc"].get(picks[source].unit, 1.0) * judgement.scale
            streams[name] = streams[name].model_copy(update={"gravity": gravity, "scale": scale})
    event = picks.get("event")
    about = format_of(chosen.apps, tables)
    return Layout(
        app=about.name,
        preset=noted_preset(remark for table in tables for remark in table.remarks) or about.preset,
        row_widths=tuple(sorted(set().union(*widths.values()))),
        event=None if event is None else (_table(tables, event.table, many), _columns(tables, event)[0]),
        acc=streams["acc"],
        gyro=streams["gyro"],
        mag=streams.get("mag"),
        pressure=streams.get("pressure"),
        clocks=tuple(_clock(tables, i, clock, many) for i, clock in clocks.items()),
    )


def _stream(tables: Sequence[Table], pick: Pick, judgement: Judgement | None, many: bool) -> StreamLayout:
    single = len(pick.columns) == 1
    axes = np.eye(3) if judgement is None or single else judgement.axes
    signed = axes if single else axes @ np.diag(pick.signs)
    return StreamLayout(
        table=_table(tables, pick.table, many),
        columns=_columns(tables, pick),
        unit=shown(pick.unit) if judgement is None else judgement.unit,
        scale=UNITS[pick.quantity].get(pick.unit, 1.0) if judgement is None else judgement.scale,
        axes=axes_of(signed),
    )


def _clock(tables: Sequence[Table], i: int, clock: Clock, many: bool) -> ClockLayout:
    return ClockLayout(
        table=_table(tables, i, many),
        columns=tuple(_column(tables[i], column) for column in clock.columns),
        kind=clock.kind,
        tick_ns=clock.tick_ns,
        wrap=int(clock.wrap),
    )


def _table(tables: Sequence[Table], i: int, many: bool) -> str:
    return tables[i].name if many else ANY


def _columns(tables: Sequence[Table], pick: Pick) -> tuple[str, ...]:
    return tuple(_column(tables[pick.table], i) for i in pick.columns)


def _column(table: Table, i: int) -> str:
    """A column as a layout names it: by its place where its name does not tell it from the others."""
    name = table.columns[i].name
    return name if name and [column.name for column in table.columns].count(name) == 1 else f"#{i + 1}"
