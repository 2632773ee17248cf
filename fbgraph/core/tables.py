"""Tables of numbers in text files, read so that what is wrong with one is told by its line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fbgraph.core.bounded import RUN_BYTES, small_file
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.core.nanoseconds import MAX_T_NS

_LARGEST = 1e15
"""Metres, seconds: light takes a month for as many."""


@dataclass(frozen=True)
class NumberTable:
    """Numbers, and where they stood.

    Attributes:
        path: the file.
        values: (N, C).
        line: (N,) number of each row's line in the file, the first of which is 1.
    """

    path: Path
    values: FloatArray
    line: IntArray

    def refuse(self, bad: BoolArray, why: str) -> None:
        """Refuse the table if a row is bad.

        Args:
            bad: (N,) which rows are.
            why: what is wrong with them.

        Raises:
            DataError: naming the first one's line.
        """
        if bad.any():
            raise DataError(f"{self.path}: line {self.line[int(np.argmax(bad))]}: {why}")

    def refuse_infinite(self, columns: slice = slice(None)) -> None:
        """Refuse nan, infinity and what is beyond all that is measured in these columns.

        Raises:
            DataError: naming the first such line.
        """
        largest: FloatArray = np.abs(self.values[:, columns]).max(axis=1)
        self.refuse(~np.isfinite(largest), "not all of its numbers are finite")
        self.refuse(largest > _LARGEST, f"a number of it is beyond {_LARGEST:g}")

    def refuse_unordered(self, t_s: FloatArray) -> None:
        """Refuse times that do not increase from row to row, or that no clock shows.

        Raises:
            DataError: naming the first such line.
        """
        self.refuse(np.diff(t_s, prepend=-np.inf) <= 0.0, "its time is not later than that of the line before")
        self.refuse(np.abs(t_s) * 1e9 > MAX_T_NS, "its time is none that a clock shows")


def read_text(path: Path, kind: str) -> str:
    """The text of a file of a run; its lines end with LF.

    Args:
        path: the file.
        kind: what it should be, for the message.

    Raises:
        DataError: it cannot be read, is larger than any such file, or is not text.
    """
    try:
        text = small_file(path, RUN_BYTES, kind).decode("utf-8")
    except ValueError as error:
        raise DataError(f"{path}: not readable as {kind}: {error}") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_numbers(path: Path, kind: str, columns: str, separator: str | None = None, header: str = "") -> NumberTable:
    """Read rows of numbers; empty lines and those that begin with ``#`` are left out.

    Args:
        path: the file.
        kind: what it should be, for messages.
        columns: names of the columns, put together as a row is.
        separator: between numbers; None for white space.
        header: the first line, if there is to be one.

    Raises:
        DataError: no such file, another header, no row, or a row that is not one number a column.
    """
    lines = read_text(path, kind).split("\n")
    first = 0
    if header:
        if lines[0].strip() != header:
            raise DataError(f"{path}: not readable as {kind}: its header is not {header}")
        first = 1
    count, rows, numbers = len(columns.split(separator)), [], []
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        row = _numbers(line, separator)
        if len(row) != count:
            raise DataError(f"{path}: line {number}: expected {count} numbers ({columns}), found {line.strip()[:80]!r}")
        rows.append(row)
        numbers.append(number)
    if not rows:
        raise DataError(f"{path}: not readable as {kind}: no row in it")
    return NumberTable(path, np.array(rows), np.array(numbers))


def _numbers(line: str, separator: str | None) -> list[float]:
    """The numbers of a line, none if one of them is not a number as files write it."""
    if "_" in line or not line.isascii():  # Python would take 1_000
        return []
    try:
        return [float(cell) for cell in line.split(separator)]
    except ValueError:
        return []
