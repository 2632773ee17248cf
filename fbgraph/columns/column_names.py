"""What the columns of a table may be, by their names, units and place: proposals, which physics later tries."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from fbgraph.columns.app_layouts import AppLayout, app_layout_of, meaning_of
from fbgraph.columns.guesses import Guess
from fbgraph.columns.name_meaning import TRUTH, VECTORS, contradicts, grade_of, quantities, sensor_of
from fbgraph.columns.name_words import words_of
from fbgraph.columns.time_texts import kind_of_text
from fbgraph.columns.units import shown, unit_of
from fbgraph.core.bounded import MOST_COLUMNS
from fbgraph.core.safe_text import short_name
from fbgraph.tables.table import Column, Table

CANONICAL = "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa,temp_c,event"
"""The columns of the CSV that fbgraph writes."""
_PLACE, _SURE = 0.8, 0.9


def guess_columns(table: Table, names: Sequence[str] = ()) -> tuple[Guess, ...]:
    """What each column of a table may be, the likeliest first; every column has at least one guess.

    Args:
        table: of any logger.
        names: of all tables that came with it.
    """
    if not table.headed:
        guesses = list(_headless(table))
    else:
        layout = app_layout_of(table)
        place = _quantity_of_table(table.name)
        guesses = [guess for i in range(len(table.columns)) for guess in _guess(table, i, layout, place)]
        guesses = _counted_axes(table, guesses)
        guesses = _among_others(table, guesses)
    found = {guess.column for guess in guesses}
    guesses += [_unknown(i, "its name says nothing known") for i in range(len(table.columns)) if i not in found]
    return tuple(sorted(guesses, key=lambda guess: (-guess.weight, guess.column)))


def _unknown(column: int, why: str, weight: float = 0.1) -> Guess:
    return Guess(column, "unknown", "", "", "", weight, why)


def _guess(table: Table, i: int, layout: AppLayout | None, place: tuple[str, str]) -> Iterator[Guess]:
    column = table.columns[i]
    name = short_name(column.name)
    if layout and (found := meaning_of(layout, table.name, column.name)):
        meaning, axis = found
        unit = unit_of(words_of(column.name).unit or column.unit, meaning.quantity) or meaning.unit
        sensor = "" if meaning.axis else sensor_of(words_of(column.name), meaning.quantity)
        why = f"{layout.app} writes so"
        yield Guess(i, meaning.quantity, axis or meaning.axis, unit, sensor, meaning.weight, why, meaning.grade)
        return
    words = words_of(column.name)
    written = words.unit or column.unit
    kind = kind_of_text(column.values) if column.is_text else ""
    if kind and "location" not in words.roles:
        quantity = {"stamp": "time"}.get(kind, kind)
        weight = _SURE if {"time", "date", "second"} & set(words.roles) else 0.6
        yield Guess(i, quantity, "", "", "", weight, f"its texts are like {short_name(_first_text(column))}")
        return
    for quantity, weight, why in quantities(words, written, place):
        unit = unit_of(written, quantity) or (_unit_of_time(column.name) if quantity == "time" else "")
        fits = (
            unit
            or quantity in ("unknown", "orientation")
            or not written
            or (column.unit and not words.unit)
            or not contradicts(written, quantity)
        )
        axis = words.axis if quantity in VECTORS or quantity in TRUTH.values() else ""
        yield Guess(
            i,
            quantity,
            axis,
            unit,
            sensor_of(words, quantity),
            round(min(1.0, weight * (1.05 if unit else 1.0) * (1.0 if fits else 0.2)), 3),
            f"{why.format(name=name)}{f', in {shown(unit)}' if unit else ''}",
            grade_of(words, quantity) or (place[1] if quantity == place[0] else ""),
        )


def _unit_of_time(name: str) -> str:
    """A unit that stands first or alone: ``millis``, ``seconds_elapsed``."""
    for word in re.findall(r"[^\W_]+", name):
        if len(word) > 1 and (unit := unit_of(word, "time")) and unit not in ("min", "h", "day"):
            return unit
    return ""


def _quantity_of_table(name: str) -> tuple[str, str]:
    """The sensor that a table is named after, and its grade; empty if it is named after none or several."""
    words = words_of(name)
    roles = set(words.roles)
    if roles & {"location", "lat"}:
        return "location", ""
    meant = quantities(replace(words, axis="x", unit=""), "", ("", ""))
    quantity = next((quantity for quantity, _, _ in meant), "")
    if words.letters or quantity not in (*VECTORS, "pressure", "orientation"):
        return "", ""
    return quantity, grade_of(words, quantity)


def _headless(table: Table) -> Iterator[Guess]:
    """Columns without names: time and the axes of the sensor after which the table is named."""
    place, grade = _quantity_of_table(table.name)
    wanted = 3 if place in VECTORS else 1 if place == "pressure" else 0
    if not wanted:
        yield from _canonical(table)
    if not wanted or not wanted + 1 <= len(table.columns) <= wanted + 2:
        return
    why = f"no header: column {{}} of a table named {short_name(table.name)}"
    yield Guess(0, "time", "", "", "", _PLACE, why.format(1))
    for i in range(wanted):
        axis = "xyz"[i] if wanted == 3 else ""
        yield Guess(i + 1, place, axis, "", "", _PLACE, why.format(i + 2), grade)
    if len(table.columns) == wanted + 2:
        yield Guess(wanted + 1, "accuracy", "", "", "", 0.5, why.format(wanted + 2))


def _canonical(table: Table) -> Iterator[Guess]:
    """The columns of the M5StickC's own CSV without its header, if their number and values are those of it."""
    names, columns = CANONICAL.split(","), table.columns
    if not 11 <= len(columns) <= 13 or columns[0].values.dtype.kind != "i":
        return
    if any(column.is_text for column in columns[1:11]) or not _near_an_atmosphere(columns[10]):
        return
    if len(columns) == 12 and columns[11].is_text:
        names.remove("temp_c")
    named = replace(table, headed=True, columns=tuple(map(_renamed, columns, names)))
    why = f"no header: columns taken as {CANONICAL}"
    yield from (replace(guess, why=why, weight=min(guess.weight, 0.7)) for guess in guess_columns(named))


def _renamed(column: Column, name: str) -> Column:
    return replace(column, name=name)


def _counted_axes(table: Table, guesses: list[Guess]) -> list[Guess]:
    """Axes that are counted (``acc[0]``, ``acc[1]``, ``acc[2]``) as x, y, z."""
    counted: dict[tuple[str, str, str], list[tuple[int, int]]] = {}
    for k, guess in enumerate(guesses):
        words = words_of(table.columns[guess.column].name)
        if guess.quantity in VECTORS and not guess.axis and words.digits:
            stem = re.sub(r"\d+(\D*)$", r"\1", table.columns[guess.column].name)
            counted.setdefault((guess.quantity, guess.unit, stem), []).append((int(words.digits[-1]), k))
    for same in counted.values():
        numbers = sorted(number for number, _ in same)
        if numbers in ([0, 1, 2], [1, 2, 3]):
            for number, k in same:
                words = words_of(table.columns[guesses[k].column].name)
                sensor = sensor_of(replace(words, digits=words.digits[:-1]), guesses[k].quantity)
                guesses[k] = replace(guesses[k], axis="xyz"[number - numbers[0]], sensor=sensor)
    return guesses


def _among_others(table: Table, guesses: list[Guess]) -> list[Guess]:
    """The same guesses, weighed by what else the table holds: three axes make a sensor; r, p, y are angles."""
    guesses = [_relabelled(table, guess, guesses) for guess in guesses]
    axes = Counter((g.quantity, g.sensor, g.grade) for g in guesses if g.axis)
    has_gyro = any(g.quantity == "gyro" and not _is_g(table, g) for g in guesses)
    angles = {"r", "p", "y"} <= {column.name.strip().lower() for column in table.columns}
    weighed = []
    for guess in guesses:
        weight = guess.weight
        if guess.quantity in VECTORS and axes[guess.quantity, guess.sensor, guess.grade] < 3:
            weight *= 0.4
        if guess.quantity in ("gyro", "gravity") and has_gyro and _is_g(table, guess) and not guess.unit:
            weight = 0.6 if guess.quantity == "gravity" else 0.3
        if guess.quantity == "pressure" and guess.weight <= 0.5:
            weight = 0.1 if angles else 0.6 if _near_an_atmosphere(table.columns[guess.column]) else 0.2
        weighed.append(replace(guess, weight=round(weight, 3)))
    return weighed


def _relabelled(table: Table, guess: Guess, guesses: Sequence[Guess]) -> Guess:
    """A vector without an axis is none; acceleration beside one that includes gravity has none."""
    if guess.quantity in VECTORS and not guess.axis:
        return replace(guess, quantity="unknown", unit="", why=f"{guess.why}, without an axis")
    if guess.quantity == "acc" and "include" not in _roles(table, guess):
        including = any(other.quantity == "acc" and "include" in _roles(table, other) for other in guesses)
        return replace(guess, quantity="linear_acc") if including else guess
    return guess


def _roles(table: Table, guess: Guess) -> tuple[str, ...]:
    return words_of(table.columns[guess.column].name).roles


def _is_g(table: Table, guess: Guess) -> bool:
    """Whether nothing but the letter g says what a column is."""
    return re.match(r"g[ _]?[xyz]", table.columns[guess.column].name.lower()) is not None


def _near_an_atmosphere(column: Column) -> bool:
    """Whether values are an air pressure in some unit."""
    if column.is_text or not len(column.values):
        return False
    values = column.values[np.isfinite(column.values)] if column.values.dtype.kind == "f" else column.values
    middle = float(np.median(values)) if len(values) else 0.0
    return any(low < middle < high for low, high in ((300, 1150), (30_000, 115_000), (30, 115)))


def _first_text(column: Column) -> str:
    return next((str(value) for value in column.values if value), "")


def names_accelerometer(names: Sequence[str]) -> bool:
    """Whether fields of a line name the axes of an accelerometer.

    Args:
        names: in any order, among others.
    """
    nothing = np.empty(0)
    table = Table("", "", tuple(Column(name.strip().strip('"'), "", nothing) for name in names[:MOST_COLUMNS]))
    axes = {guess.axis for guess in guess_columns(table) if guess.quantity == "acc"}
    return {"x", "y", "z"} <= axes
