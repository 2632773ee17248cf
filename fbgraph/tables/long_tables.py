"""Tables in which each row names the sensor that it is from: a table a sensor."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fbgraph.core.geometry import BoolArray
from fbgraph.tables.table import Column, Table

_SAYS_WHAT = re.compile(r"(?:sensor|measurement|stream|data|record|message|msg)?[ _-]?(?:name|type|id)?|topic|tag|kind")
_MOST_SENSORS = 40


def by_sensor(table: Table) -> tuple[Table, ...]:
    """The tables that a table in long format holds; the table itself if it is in none."""
    for i, column in enumerate(table.columns):
        if column.is_text and column.name and _SAYS_WHAT.fullmatch(column.name.strip().lower()):
            sensors = list(dict.fromkeys(column.values.tolist()))
            if 2 <= len(sensors) <= min(_MOST_SENSORS, len(table) // 2) and None not in sensors:
                others = (*table.columns[:i], *table.columns[i + 1 :])
                return tuple(_of(table, str(name), others, column.values == name) for name in sensors)
    return (table,)


def _of(table: Table, name: str, columns: Sequence[Column], rows: BoolArray) -> Table:
    """The rows of one sensor, without the columns that it leaves empty."""
    own = [replace(column, values=column.values[rows], unreadable=0) for column in columns]
    own = [column for column in own if _filled(column)]
    widths = None if table.widths is None else table.widths[rows]
    return replace(table, name=name, columns=tuple(own), widths=widths, how=f"{table.how}, a row a sensor")


def _filled(column: Column) -> bool:
    if column.is_text:
        return any(value is not None for value in column.values)
    return not bool(np.isnan(column.values).all())
