"""Which of the columns that may be a sensor are used, and why the others are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fbgraph.columns.app_layouts import app_layout_of, signs_of
from fbgraph.columns.guesses import Chosen, Guess, Pick
from fbgraph.columns.name_meaning import VECTORS
from fbgraph.columns.units import shown
from fbgraph.core.safe_text import short_name
from fbgraph.tables.table import Table

GNSS = ("lat", "lon", "height", "accuracy")
TRUTH = ("truth_x", "truth_y", "truth_z")
_SINGLES = ("pressure", "temperature", "altitude", "event", "counter")
_GRADES = {"": 3, "filtered": 2, "uncalibrated": 1, "raw": 0}
_LEAST = 0.25  # a guess of less weight than this is used for nothing


@dataclass
class _Choice:
    tables: Sequence[Table]
    picks: dict[str, Pick] = field(default_factory=dict)
    passed_over: list[tuple[Pick, str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def name(self, pick: Pick) -> str:
        table = self.tables[pick.table]
        names = "/".join(short_name(table.columns[i].name) or f"column {i + 1}" for i in pick.columns)
        return f"{short_name(table.name)}: {names}" if len(self.tables) > 1 else names


def choose(tables: Sequence[Table], guesses: Sequence[Sequence[Guess]]) -> Chosen:
    """Which columns are used for each quantity.

    Columns without values are passed over; a scaled sensor beats counts, a calibrated one an uncalibrated, one with
    gravity one without, the named device of the accelerometer every other.

    Args:
        tables: of one log.
        guesses: what ``guess_columns`` says of each.
    """
    choice = _Choice(tables)
    found = [pick for i in range(len(tables)) for pick in _vectors(tables, i, guesses[i])]
    found = _settled(choice, found)
    acc = _best_of(choice, found, "acc", "")
    if acc is not None and acc.grade and _restored(choice, found):
        choice.passed_over.append((choice.picks.pop("acc"), f"{acc.grade}; linear acceleration with gravity is not"))
        acc = None
    if acc is None:
        for quantity in ("linear_acc", "gravity"):
            acc = _best_of(choice, found, quantity, "") or acc
    else:
        for pick in found:
            if pick.quantity == "linear_acc":
                choice.passed_over.append((pick, "gravity is removed from it"))
            elif pick.quantity == "gravity":
                choice.passed_over.append((pick, "an accelerometer with gravity is there"))
    for quantity in ("gyro", "mag"):
        _best_of(choice, found, quantity, acc.sensor if acc else "")
    for quantity in _SINGLES:
        _best_single(choice, guesses, quantity)
    for together in (GNSS, TRUTH):
        _best_group(choice, guesses, together)
    used = {pick.table for pick in choice.picks.values()}
    apps = dict.fromkeys(layout.app for i in sorted(used) if (layout := app_layout_of(tables[i])))
    return Chosen(choice.picks, tuple(choice.passed_over), tuple(choice.notes), tuple(apps))


def _vectors(tables: Sequence[Table], i: int, guesses: Sequence[Guess]) -> list[Pick]:
    """Every three columns of a table that may be the axes of one sensor."""
    table = tables[i]
    axes: dict[tuple[str, str, str], dict[str, list[Guess]]] = {}
    for guess in guesses:
        if guess.quantity in VECTORS and guess.axis and guess.weight >= _LEAST:
            key = (guess.quantity, guess.sensor, guess.grade)
            axes.setdefault(key, {}).setdefault(guess.axis, []).append(guess)
    layout = app_layout_of(table) if table.headed else None
    picks = []
    for (quantity, sensor, grade), by_axis in axes.items():
        if len(by_axis) < 3:
            continue
        for k in range(min(map(len, by_axis.values()))):  # the same names twice: a second sensor
            three = [sorted(by_axis[axis], key=lambda guess: guess.column)[k] for axis in "xyz"]
            units = {guess.unit for guess in three}
            picks.append(
                Pick(
                    quantity,
                    i,
                    tuple(guess.column for guess in three),
                    units.pop() if len(units) == 1 else "",
                    sensor,
                    grade,
                    signs_of(layout, quantity, tables),
                    min(guess.weight for guess in three),
                    three[0].why,
                )
            )
    return picks


def _settled(choice: _Choice, found: list[Pick]) -> list[Pick]:
    """Without picks that hold no values, and each column for the one quantity that it likeliest is."""
    taken: set[tuple[int, int]] = set()
    kept = []
    for pick in sorted(found, key=lambda pick: -pick.weight):
        columns = {(pick.table, column) for column in pick.columns}
        if columns & taken:
            continue
        if not all(has_values(choice.tables[pick.table], column) for column in pick.columns):
            choice.passed_over.append((pick, "it holds no values"))
            continue
        taken |= columns
        kept.append(pick)
    return sorted(kept, key=lambda pick: (pick.table, pick.columns))


def _best_of(choice: _Choice, found: Sequence[Pick], quantity: str, sensor: str) -> Pick | None:
    """The best of the picks of a quantity; the others are passed over with the reason."""
    same = [pick for pick in found if pick.quantity == quantity]
    if not same:
        return None

    def rank(pick: Pick) -> tuple[float, ...]:
        whole = {other.quantity for other in found if (other.table, other.sensor) == (pick.table, pick.sensor)}
        scaled = pick.grade != "raw"
        return (
            scaled,
            pick.sensor == sensor or quantity == "acc",
            round(pick.weight, 1),
            _GRADES[pick.grade],
            len(whole & {"acc", "gyro"}),
            bool(pick.unit),
            -pick.table,
            -min(pick.columns),
        )

    best, *others = sorted(same, key=rank, reverse=True)
    choice.picks[quantity] = best
    for other in others:
        choice.passed_over.append((other, _reason(choice, best, other)))
    rivals = [other for other in others if other.grade == best.grade]
    if rivals and quantity in ("acc", "gyro"):
        names = ", ".join(choice.name(rival) for rival in rivals[:3])
        more = f" and {len(rivals) - 3} more" if len(rivals) > 3 else ""
        what = "several logs" if any(_same_columns(choice, best, rival) for rival in rivals) else "several sensors"
        choice.notes.append(f"{what} ({quantity}): {choice.name(best)} is used, not {names}{more}")
    return best


def _same_columns(choice: _Choice, one: Pick, other: Pick) -> bool:
    """Whether two picks are of two tables with the same columns: two walks rather than two devices."""
    names = [[column.name for column in choice.tables[pick.table].columns] for pick in (one, other)]
    return one.table != other.table and names[0] == names[1] and len(names[0]) > 5


def _restored(choice: _Choice, found: Sequence[Pick]) -> bool:
    """Whether acceleration without gravity and a gravity of as many rows are there, in known units."""
    rows = {
        pick.quantity: len(choice.tables[pick.table])
        for pick in found
        if pick.quantity in ("linear_acc", "gravity") and pick.unit and not pick.grade
    }
    return len(rows) == 2 and rows["gravity"] > 0.9 * rows["linear_acc"]


def _reason(choice: _Choice, best: Pick, other: Pick) -> str:
    if other.grade == "raw" and best.grade != "raw":
        return f"raw counts; {choice.name(best)} has a unit"
    if _GRADES[other.grade] < _GRADES[best.grade]:
        return f"{other.grade}; {choice.name(best)} is not"
    if other.weight < best.weight - 0.05:
        return f"{choice.name(best)} says more surely what it is"
    return f"another sensor; {choice.name(best)} is used"


def _best_single(choice: _Choice, guesses: Sequence[Sequence[Guess]], quantity: str) -> None:
    found = [
        Pick(quantity, i, (guess.column,), guess.unit, guess.sensor, guess.grade, (1,), guess.weight, guess.why)
        for i, of_table in enumerate(guesses)
        for guess in of_table
        if guess.quantity == quantity and guess.weight >= _LEAST and _is_top(guess, of_table)
    ]
    there = []
    for pick in found:
        if has_values(choice.tables[pick.table], pick.columns[0]):
            there.append(pick)
        else:
            choice.passed_over.append((pick, "it holds no values"))
    if not there:
        return
    home = choice.picks.get("acc")

    def rank(pick: Pick) -> tuple[float, ...]:
        beside = home is not None and pick.table == home.table
        return (_GRADES[pick.grade], bool(pick.unit), pick.weight, beside, -pick.table, -pick.columns[0])

    best, *others = sorted(there, key=rank, reverse=True)
    choice.picks[quantity] = best
    for other in others:
        choice.passed_over.append((other, f"{choice.name(best)} is used"))


def _is_top(guess: Guess, guesses: Sequence[Guess]) -> bool:
    return all(other.weight <= guess.weight for other in guesses if other.column == guess.column)


def _best_group(choice: _Choice, guesses: Sequence[Sequence[Guess]], together: tuple[str, ...]) -> None:
    """Columns that belong together (latitude and longitude), from the one table that has the first two with values."""
    for i, of_table in enumerate(guesses):
        best: dict[str, Guess] = {}
        for guess in of_table:
            there = guess.quantity in together and guess.weight >= _LEAST and _is_top(guess, of_table)
            if there and has_values(choice.tables[i], guess.column):
                best.setdefault(guess.quantity, guess)
        if set(together[:2]) <= best.keys():
            for quantity, guess in best.items():
                pick = Pick(quantity, i, (guess.column,), guess.unit, "", "", (1,), guess.weight, guess.why)
                if quantity in choice.picks:
                    choice.passed_over.append((pick, f"{choice.name(choice.picks[quantity])} is used"))
                else:
                    choice.picks[quantity] = pick


def has_values(table: Table, column: int) -> bool:
    """Whether any row of a column is filled (with a number, or with text in a column of text)."""
    values = table.columns[column].values
    if values.dtype == object:
        return any(value is not None and str(value).strip() for value in values)
    return any(bool(np.isfinite(some).any()) for some in (values[:1000], values))


def described(pick: Pick, tables: Sequence[Table]) -> str:
    """A pick for people: ``acc from Accelerometer: X/Y/Z in m/s²``."""
    unit = f" in {shown(pick.unit)}" if pick.unit else ""
    return f"{pick.quantity} from {_Choice(tables).name(replace(pick))}{unit}"
