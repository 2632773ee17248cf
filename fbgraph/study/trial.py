"""One trial of a data set: its table of sensors, ground truth, labels and the authors' outputs.

Names and units of the columns come from ``DatasetConfig``; what is left open is judged by magnitude, and times, gaps
and bad values are cleaned as in any log (``physics.judge_sensors``, ``readers.cleaning``).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fbgraph.columns.clock_times import Clock, clock_ns
from fbgraph.columns.clocks import find_clock
from fbgraph.columns.guesses import Guess
from fbgraph.columns.units import UNITS, plain_text, unit_of
from fbgraph.core.atmosphere import altitude_pressure_hpa
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.physics.judge_sensors import judge_sensors
from fbgraph.physics.likely_samples import likely
from fbgraph.readers.cleaning import LIMITS, RawLog, RawStream, assemble, drop_repeats
from fbgraph.study.column_names import ColumnsConfig, DatasetConfig
from fbgraph.tables.table import Column
from fbgraph.tables.table import Table as LogTable

if TYPE_CHECKING:
    import pandas as pd

FORMAT = "forestback"
LOGGED = ("pdr", "forestback")
"""The authors' methods whose output a table may hold."""
_NEEDED = (*(f"{sensor}_{axis}" for sensor in ("acc", "gyro") for axis in "xyz"), "truth_x", "truth_y")
_METRES = {"m": 1.0, "meter": 1.0, "meters": 1.0, "cm": 0.01, "mm": 0.001}
_ANGLES = {"deg": np.pi / 180.0, "degrees": np.pi / 180.0, "rad": 1.0, "radians": 1.0}
_CURRENTS = {"ma": 1.0, "a": 1000.0}
_NOTHING = {"", "0", "0.0", "none", "no", "false", "nan", "-", "n", "straight", "walk", "walking", "forward"}
_SIDES = ((r"^l|left", 1.0), (r"^r|right", -1.0))
_MOST_STEPS_HZ = 4.0
_HEADING_S = 0.25  # walking direction by the ground truth: from so long before to so long after
_STANDING_M = 0.02  # who moved less meanwhile has none


@dataclass(frozen=True)
class Path2D:
    """Where somebody was: ``t_s`` (N,) increasing, on the log's clock; ``x_m``, ``y_m``, ``heading_rad`` (N,).

    ``heading_rad`` is counter-clockwise from East and unwrapped; all nan where unknown.
    """

    t_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray

    @property
    def xy_m(self) -> FloatArray:
        """(N, 2)."""
        return np.column_stack((self.x_m, self.y_m))

    @property
    def distance_m(self) -> FloatArray:
        """(N,) walked up to each sample."""
        return np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(self.x_m), np.diff(self.y_m)))))


@dataclass(frozen=True)
class Turns:
    """Labelled turns: ``t_s`` (T,) their middles, ``side`` (T,) 1 left, -1 right, 0 not said."""

    t_s: FloatArray
    side: FloatArray


@dataclass(frozen=True)
class Trial:
    """One trial. Only ``log`` may be shown to an estimator.

    Attributes:
        log: what the sensors said.
        truth: where the person was.
        step_s: (S,) times of the labelled steps; None without such a column.
        turns: labelled turns; None without such a column.
        checkpoint_s, checkpoints: when each checkpoint was passed, and their names; empty without such a column.
        logged: the authors' own output, by ``LOGGED``, those that the table holds.
        logged_error_m: (N,) the error columns beside them.
        current_ma: (N,) what the device drew; empty if not logged.
        rows: of the table.
    """

    name: str
    log: SensorLog
    truth: Path2D
    step_s: FloatArray | None
    turns: Turns | None
    checkpoint_s: FloatArray
    checkpoints: tuple[str, ...]
    logged: dict[str, Path2D] = field(default_factory=dict)
    logged_error_m: dict[str, FloatArray] = field(default_factory=dict)
    current_ma: FloatArray = field(default_factory=lambda: np.empty(0))
    rows: int = 0


@dataclass(frozen=True)
class Table:
    """A trial's table as found: ``remark`` is what stood in ``#`` lines before its header."""

    name: str
    frame: pd.DataFrame
    remark: str


def _unit(text: str, quantity: str) -> str | None:
    """The unit that the rest of a column's name tells of a quantity, "" if there is no rest; None if it is no unit."""
    if not text:
        return ""
    sensor = quantity.removesuffix("_x").removesuffix("_y").removesuffix("_z")
    if sensor in UNITS:
        return unit_of(text, sensor) or None
    if quantity.endswith("heading"):
        return text if text in _ANGLES else None
    if quantity == "current":
        return text if text in _CURRENTS else None
    return text if text in _METRES and quantity not in ("trial", "step", "turn", "checkpoint") else None


def _plain(name: str) -> str:
    """A name in small letters and digits: ``Acc X (m/s²)`` is ``accxms2``."""
    return re.sub(r"[^a-z0-9]+", "", plain_text(name).lower())


def find_columns(names: list[str], columns: ColumnsConfig) -> dict[str, tuple[int, str]]:
    """Column and unit ("" if its name tells none) of every quantity that is there."""
    plain = {_plain(name): i for i, name in reversed(list(enumerate(names)))}
    found: dict[str, tuple[int, str]] = {}
    for quantity, aliases in columns:
        for alias in map(_plain, aliases):
            rests = {name.removeprefix(alias): i for name, i in plain.items() if name.startswith(alias)}
            told = {rest: unit for rest in rests if (unit := _unit(rest, quantity)) is not None}
            if told:
                shortest = min(told, key=len)
                found[quantity] = (rests[shortest], told[shortest])
                break
    return found


def read_trial(table: Table, config: DatasetConfig) -> Trial:
    """A table as a trial.

    Raises:
        DataError: columns are missing, or its sensors cannot have recorded a walk.
    """
    found = _needed_columns(table, config)
    quantities = _Quantities(table, found)
    log, t_s, notices = _log(table, found, quantities.numbers, config)
    there = np.isfinite(t_s)
    there[there] &= np.diff(np.maximum.accumulate(t_s[there]), prepend=-np.inf) > 0
    there &= np.isfinite(quantities.numbers("truth_x")) & np.isfinite(quantities.numbers("truth_y"))
    if there.sum() < 2:
        raise DataError(f"{table.name}: its ground truth holds no two places")
    truth = _path(quantities, "truth", t_s, there, config)
    if not np.isfinite(truth.heading_rad).all():
        truth = replace(truth, heading_rad=walking_direction(truth))
    logged = {
        method: _path(quantities, method, t_s, there, config)
        for method in LOGGED
        if f"{method}_x" in found and f"{method}_y" in found
    }
    logged = {method: track for method, track in logged.items() if len(track.t_s) > 1}
    step_s, remarks = _steps(quantities, t_s[there], there)
    turns = None
    if "turn" in found:
        turns = _turns(quantities.column("turn")[there], t_s[there], truth)
    passed: list[tuple[int, str]] = []
    if "checkpoint" in found:
        passed = [(start, label) for start, _, label in _runs(quantities.column("checkpoint")[there])]
    return Trial(
        name=table.name,
        log=replace(log, name=table.name, notices=(*log.notices, *notices, *remarks)),
        truth=truth,
        step_s=step_s,
        turns=turns,
        checkpoint_s=t_s[there][[row for row, _ in passed]],
        checkpoints=tuple(label for _, label in passed),
        logged=logged,
        logged_error_m={m: quantities.numbers(f"{m}_error")[there] for m in logged if f"{m}_error" in found},
        current_ma=_current_ma(quantities, config),
        rows=len(table.frame),
    )


@dataclass(frozen=True)
class _Quantities:
    """A table's columns by what they hold; ``found`` is by ``find_columns``."""

    table: Table
    found: dict[str, tuple[int, str]]

    def column(self, quantity: str) -> pd.Series:
        """As it stands in the table."""
        return self.table.frame.iloc[:, self.found[quantity][0]]

    def numbers(self, quantity: str) -> FloatArray:
        """(N,) its numbers, nan where there is none, in its own unit."""
        import pandas as pd

        column = pd.to_numeric(self.column(quantity), errors="coerce")
        return np.asarray(column.to_numpy(dtype=float))


def _needed_columns(table: Table, config: DatasetConfig) -> dict[str, tuple[int, str]]:
    """By ``find_columns``, with all that a trial needs.

    Raises:
        DataError: columns are missing.
    """
    names = list(table.frame.columns)
    found = find_columns(names, config.columns)
    if missing := [quantity for quantity in _NEEDED if quantity not in found]:
        raise DataError(
            f"{table.name}: no column for {', '.join(missing)}; found {', '.join(names)}. "
            f'Name them in a file for --mapping: [dataset.columns] {missing[0]} = "..."'
        )
    return found


def _path(quantities: _Quantities, prefix: str, t_s: FloatArray, there: BoolArray, config: DatasetConfig) -> Path2D:
    """The places in the columns of this prefix, of the rows that are there; North up."""
    found, numbers = quantities.found, quantities.numbers
    x, y = (numbers(f"{prefix}_{axis}") * _METRES.get(found[f"{prefix}_{axis}"][1], 1.0) for axis in "xy")
    heading = np.full(len(t_s), np.nan)
    if f"{prefix}_heading" in found:
        heading = _radians(numbers(f"{prefix}_heading"), found[f"{prefix}_heading"][1] or config.units.heading)
    known = there & np.isfinite(x) & np.isfinite(y)
    turn = np.radians(config.map_yaw_deg)
    place = (x[known] + 1j * y[known]) * np.exp(1j * turn)
    heading = heading[known] + turn
    heading = np.unwrap(heading) if np.isfinite(heading).all() else np.full(len(heading), np.nan)
    return Path2D(t_s[known], place.real, place.imag, heading)


def _steps(quantities: _Quantities, t_s: FloatArray, there: BoolArray) -> tuple[FloatArray | None, list[str]]:
    """Times of the labelled steps, None without any that can be used; and a notice of those that cannot.

    ``t_s`` (M,) are the times of the rows that are there.
    """
    if "step" not in quantities.found:
        return None, []
    step_s = t_s[_step_rows(quantities.numbers("step")[there])]
    if len(step_s) > _MOST_STEPS_HZ * float(np.ptp(t_s)):
        name = quantities.column("step").name
        return None, [f"{name} marks {len(step_s)} rows, more than steps can be: not used"]
    return step_s, []


def _current_ma(quantities: _Quantities, config: DatasetConfig) -> FloatArray:
    """What the device drew, where it was logged; a unit that is not said is judged by magnitude."""
    current = np.empty(0)
    if "current" in quantities.found:
        current = quantities.numbers("current")
        current = current[np.isfinite(current)]
        unit = quantities.found["current"][1] or config.units.current
        if len(current):
            current = current * (_CURRENTS[unit] if unit else 1.0 if np.median(current) > 2.0 else 1000.0)
    return current


def _log(
    table: Table, found: dict[str, tuple[int, str]], numbers: Any, config: DatasetConfig
) -> tuple[SensorLog, FloatArray, list[str]]:
    """The sensors as a cleaned log, the time of every row on its clock (nan if impossible), and what was assumed."""
    notices: list[str] = []
    sensors = [s for s in ("acc", "gyro", "mag") if all(f"{s}_{axis}" in found for axis in "xyz")]
    values = {s: np.column_stack([numbers(f"{s}_{axis}") for axis in "xyz"]) for s in sensors}
    units = {s: found[f"{s}_x"][1] for s in sensors}
    if "pressure" in found:
        units["pressure"] = found["pressure"][1]
        values["pressure"] = numbers("pressure")[:, None]
    elif "altitude" in found:
        altitude_m = numbers("altitude") * _METRES.get(found["altitude"][1], 1.0)
        units["pressure"] = "hpa"
        values["pressure"] = altitude_pressure_hpa(altitude_m[:, None])
    named = {}
    for quantity, unit in units.items():
        if known := unit or getattr(config.units, quantity):
            named[quantity] = UNITS[quantity][unit_of(known, quantity)]
    t_ns, told = _times(table, found, numbers, config)
    notices += told
    streams = {sensor: _stream(sensor, t_ns, readings) for sensor, readings in values.items()}
    judged = judge_sensors(streams["acc"], streams["gyro"], streams.get("mag"), streams.get("pressure"), named)
    readings: dict[str, FloatArray] = {}
    for sensor, raw_values in values.items():
        judgement = getattr(judged, sensor)
        if judgement is not None and np.isfinite(judgement.scale):
            with np.errstate(over="ignore"):  # garbled numbers
                scaled = raw_values * judgement.scale
            # no product of matrices: an empty field would empty all three
            order, signs = np.abs(judgement.axes).argmax(axis=1), judgement.axes.sum(axis=1)
            readings[sensor] = scaled if sensor == "pressure" else scaled[:, order] * signs
    good = np.abs(t_ns) <= MAX_T_NS
    for sensor in ("acc", "gyro"):
        good &= ~(np.abs(readings[sensor]) > LIMITS[sensor]).any(axis=1)
    raw = RawLog(notices=list(judged.texts), counts={"rows_impossible": int((~good).sum())} if not good.all() else {})
    for sensor, array in readings.items():
        seen = good & ~np.isnan(array).all(axis=1)
        if seen.any():
            stream = RawStream(t_ns[seen], array[seen])
            raw.streams[sensor] = drop_repeats(stream) if sensor in ("mag", "pressure") else stream
    log = assemble(raw, Path(table.name), FORMAT).log
    t_s = np.where(t_ns <= MAX_T_NS, (t_ns - round(log.t0_s * 1e9)) / 1e9, np.nan)
    return log, t_s, notices


def _times(
    table: Table, found: dict[str, tuple[int, str]], numbers: Any, config: DatasetConfig
) -> tuple[IntArray, list[str]]:
    """(N,) nanoseconds of every row, beyond ``MAX_T_NS`` if it has none, and what was assumed."""
    if "time" not in found:
        t_ns = np.round(np.arange(len(table.frame)) * (1e9 / config.rate_hz)).astype(np.int64)
        return t_ns, [f"no time column: {config.rate_hz:g} rows a second"]
    column, unit = found["time"]
    known = unit or unit_of(config.units.time, "time")
    times = LogTable(table.name, table.name, (Column(str(table.frame.columns[column]), "", numbers("time")),))
    clock = find_clock(times, [Guess(0, "time", "", known, "", 1.0, "as mapped")])
    if known:
        clock = Clock("ticks", (0,), UNITS["time"][known], 0, "as mapped")
    return clock_ns(times, clock), [clock.text] if clock.text else []


def _stream(name: str, t_ns: IntArray, values: FloatArray) -> Stream:
    """What a sensor says, in order of time, without numbers that a garbled line made huge."""
    good = np.isfinite(values).all(axis=1) & (np.abs(t_ns) <= MAX_T_NS)
    good &= likely(name, values, good)
    t, first = np.unique(t_ns[good], return_index=True)
    t_s: FloatArray = (t - t[:1]) / 1e9
    return Stream(t_s, values[good][first])


def _radians(angle: FloatArray, unit: str) -> FloatArray:
    if not unit:
        unit = "deg" if np.nanmax(np.abs(angle), initial=0.0) > 2.5 * np.pi else "rad"
    return angle * _ANGLES[unit]


def walking_direction(path: Path2D) -> FloatArray:
    """(N,) by the places just before and after, unwrapped; who stands faces the way of the nearest movement."""
    before_s, after_s = path.t_s - _HEADING_S, path.t_s + _HEADING_S
    dx, dy = (np.interp(after_s, path.t_s, p) - np.interp(before_s, path.t_s, p) for p in (path.x_m, path.y_m))
    moving = np.flatnonzero(np.hypot(dx, dy) > _STANDING_M)
    if len(moving) == 0:
        return np.zeros(len(path.t_s))
    heading = np.unwrap(np.arctan2(dy[moving], dx[moving]))
    after = np.clip(np.searchsorted(moving, np.arange(len(dx))), 0, len(moving) - 1)
    return np.asarray(heading[after])


def _runs(column: pd.Series) -> list[tuple[int, int, str]]:
    """First row, row after the last, and label of every run of equal labels that mean something."""
    labels = ["" if label != label else str(label).strip() for label in column.tolist()]  # nan is not itself
    labels = [label.removesuffix(".0") for label in labels]
    starts = [i for i in range(len(labels)) if i == 0 or labels[i] != labels[i - 1]]
    return [
        (start, end, labels[start])
        for start, end in zip(starts, [*starts[1:], len(labels)], strict=True)
        if labels[start].lower() not in _NOTHING
    ]


def _step_rows(values: FloatArray) -> BoolArray:
    """Where a step is: a mark, or a count that goes up."""
    values = np.nan_to_num(values)
    rises = np.diff(values, prepend=values[:1]) > 0
    counted = values.max(initial=0.0) > 1.0 and (np.diff(values) >= 0).all()
    return np.asarray(rises if counted else (values != 0) & (np.diff(values, prepend=0.0) != 0))


def _turns(column: pd.Series, t_s: FloatArray, truth: Path2D) -> Turns:
    """Labelled turns; where a label does not tell the side, the ground truth does."""
    middles, sides = [], []
    for start, end, label in _runs(column):
        middle = (t_s[start] + t_s[end - 1]) / 2.0
        side = next((sign for word, sign in _SIDES if re.search(word, label.lower())), 0.0)
        before, after = np.interp((middle - 1.0, middle + 1.0), truth.t_s, truth.heading_rad)
        middles.append(middle)
        sides.append(side or float(np.sign(after - before)))
    return Turns(np.array(middles), np.array(sides))
