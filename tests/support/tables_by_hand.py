"""Tables built from a header, with values that grow (a clock) or do not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.columns.column_names import guess_columns
from fbgraph.columns.guesses import Guess
from fbgraph.tables.table import Column, Table

ROWS = 200


def table_of(
    header: str | Sequence[str],
    values: Mapping[str, Any] | None = None,
    name: str = "walk",
    units: Sequence[str] = (),
    separator: str = ";",
) -> Table:
    """A table with these columns; ``values`` by column's name, noise elsewhere."""
    names = [each.strip() for each in (header.split(separator) if isinstance(header, str) else header)]
    given = values or {}
    rows = len(next(iter(given.values()))) if given else ROWS
    noise = np.random.default_rng(1).normal(size=(rows, len(names)))
    columns = [
        Column(each, units[i] if units else "", _array(given[each]) if each in given else noise[:, i])
        for i, each in enumerate(names)
    ]
    return Table(name, f"{name}.csv", tuple(columns))


def _array(values: Any) -> NDArray[Any]:
    array = np.asarray(values)
    return array.astype(object) if array.dtype.kind in "US" else array


def best(table: Table) -> dict[str, Guess]:
    """The likeliest guess of each column, by its name."""
    found: dict[str, Guess] = {}
    for guess in guess_columns(table):
        found.setdefault(table.columns[guess.column].name, guess)
    return found


def said(guess: Guess) -> str:
    """A guess in short: ``acc.x[g]``."""
    axis = f".{guess.axis}" if guess.axis and guess.quantity not in ("truth_x", "truth_y", "truth_z", "unknown") else ""
    return f"{guess.quantity}{axis}{f'[{guess.unit}]' if guess.unit else ''}"
