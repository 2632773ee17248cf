"""A table as somebody's logger wrote it: columns with names, perhaps units, of numbers or of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.core.geometry import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes:
        name: as written, without quotes and blanks around it; ``""`` if the table has no header.
        unit: what a row of units says under it; ``""`` if there is no such row.
        values: (N,) int64 if every field is a whole number, float64 (nan where a field is empty or says "no value") if
            nearly every filled field is a number, else object: text, None where empty.
        unreadable: filled fields of a column of numbers that are none; they are nan.
    """

    name: str
    unit: str
    values: NDArray[Any]
    unreadable: int = 0

    @property
    def is_text(self) -> bool:
        """Whether it holds words, dates or times of day rather than numbers."""
        return self.values.dtype == object


@dataclass(frozen=True)
class Table:
    """Rows of one kind, in the order in which they were written.

    Attributes:
        name: of the file inside its folder or zip, without folder and endings (``Accelerometer``); of the sensor where
            a file holds rows of several kinds.
        source: for messages: ``walk.zip/Accelerometer.csv``.
        columns: in the order of the file.
        headed: whether a header named them.
        how: how it was written, for people: ``semicolons, decimal comma, UTF-16``.
        widths: (N,) fields that each row really had, where some rows are shorter than the header; None otherwise.
        remarks: comment lines and lines before the header, without their marks; at most some hundred.
        counts: rows that are not here, by reason.
    """

    name: str
    source: str
    columns: tuple[Column, ...]
    headed: bool = True
    how: str = ""
    widths: IntArray | None = None
    remarks: tuple[str, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)

    def numbers(self, columns: Sequence[int]) -> FloatArray:
        """(N, D) numbers of some columns; nan where there is none.

        Args:
            columns: their places.
        """
        numbers = np.empty((len(self), len(columns)), order="F")  # many rows of few columns are asked row by row
        for k, i in enumerate(columns):
            values = self.columns[i].values
            numbers[:, k] = np.nan if values.dtype == object else values
        return numbers

    def whole(self, widths: Sequence[int]) -> BoolArray:
        """(N,) which rows have all fields, or as many as are allowed.

        Args:
            widths: other numbers of fields that a row may have.
        """
        if self.widths is None:
            return np.ones(len(self), dtype=bool)
        allowed: BoolArray = np.isin(self.widths, (len(self.columns), *widths))
        return allowed

    def rows(self, order: IntArray | BoolArray) -> Table:
        """Some of its rows, in another order.

        Args:
            order: places of the rows wanted, or whether each is.
        """
        columns = tuple(replace(column, values=column.values[order]) for column in self.columns)
        return replace(self, columns=columns, widths=None if self.widths is None else self.widths[order])

    def __len__(self) -> int:
        """Its rows."""
        return len(self.columns[0].values) if self.columns else 0
