"""What each table and column was taken for, and why; what was left out, by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fbgraph.columns.column_names import guess_columns
from fbgraph.columns.guesses import Chosen, Guess
from fbgraph.columns.units import shown
from fbgraph.readers.apply_layout import find_column, find_table
from fbgraph.readers.layout import ANY, Layout
from fbgraph.readers.reading import Reading
from fbgraph.tables.table import Table

Used = dict[tuple[int, int], str]
"""What columns are used for, by place of table and column."""
_AXES = "xyz"
_SCORED = ("truth_", "lat", "lon", "height", "accuracy")


def guesses_of(tables: Sequence[Table], reading: Reading | None) -> tuple[tuple[Guess, ...], ...]:
    """What columns may be by their names; of a log that is laid out, too."""
    if reading is not None and any(reading.guesses):
        return reading.guesses
    names = tuple(table.name for table in tables)
    return tuple(guess_columns(table, names) for table in tables)


def used_by_reading(tables: Sequence[Table], reading: Reading, source: object) -> Used:
    """What a log was read from, its truth and fixes included."""
    scored = {name: pick for name, pick in reading.chosen.picks.items() if name.startswith(_SCORED)}
    return used_by_choice(Chosen(scored)) | _used_by_layout(tables, reading.layout, source)


def _used_by_layout(tables: Sequence[Table], layout: Layout, source: object) -> Used:
    used: Used = {}
    for name, stream in layout.streams.items():
        for quantity, part in ((name, stream), ("gravity", stream.gravity)):
            if part is not None:
                i = find_table(tables, part.table, source)
                for k, column in enumerate(part.columns):
                    axis = f" {_AXES[k]}" if len(part.columns) == 3 else ""
                    used[i, find_column(tables[i], column, source)] = f"{quantity}{axis}"
    if layout.event is not None:
        i = find_table(tables, layout.event[0], source)
        used[i, find_column(tables[i], layout.event[1], source)] = "event"
    sampled = {i for i, _ in used}
    for clock in layout.clocks:
        for i in [find_table(tables, ANY, source)] if clock.table == ANY else range(len(tables)):
            if i in sampled and clock.table in (ANY, tables[i].name):
                for column in clock.columns:
                    used[i, find_column(tables[i], column, source)] = "time"
    return used


def used_by_choice(chosen: Chosen) -> Used:
    """What would be used of a log that cannot be read as a whole."""
    used: Used = {}
    for quantity, pick in chosen.picks.items():
        for k, column in enumerate(pick.columns):
            used[pick.table, column] = f"{quantity} {_AXES[k]}" if len(pick.columns) == 3 else quantity
    return used


def tables_told(
    tables: Sequence[Table], guesses: Sequence[Sequence[Guess]], chosen: Chosen, used: Used
) -> list[dict[str, Any]]:
    """Each table: how it was written, and each column: what it was taken for and why, and whether it is used."""
    return [
        {
            "name": table.name,
            "source": table.source,
            "how": table.how,
            "rows": len(table),
            "columns": [_column(table, i, k, guesses[i], chosen, used) for k in range(len(table.columns))],
        }
        for i, table in enumerate(tables)
    ]


def _column(table: Table, i: int, k: int, guesses: Sequence[Guess], chosen: Chosen, used: Used) -> dict[str, Any]:
    column = table.columns[k]
    mine = [guess for guess in guesses if guess.column == k]
    best = max(mine, key=lambda guess: guess.weight, default=None)
    known = best is not None and best.quantity != "unknown"
    taken = used.get((i, k))
    if best is not None and known:
        meant, unit, why = f"{best.quantity} {best.axis}".strip(), shown(best.unit), best.why
    else:
        meant, unit, why = "unknown", "", "its name says nothing that is known"
    told: dict[str, Any] = {
        "name": column.name or f"#{k + 1}",
        "taken_for": meant if taken is None else taken,
        "unit": unit,
        "why": why,
        "used": taken is not None,
    }
    if taken is None:
        passed = next((reason for pick, reason in chosen.passed_over if pick.table == i and k in pick.columns), "")
        told["ignored_because"] = passed or ("no use is made of it" if known else "it is not known what it is")
    if column.unreadable:
        told["fields_unreadable"] = column.unreadable
    return told
