"""The table of a text file: Arrow parses rows that are all alike as they are written.

Of any others pandas reads what ``tidy`` makes of them, and what it does not take for numbers is looked at again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.core.bounded import MOST_COLUMNS
from fbgraph.core.errors import DataError
from fbgraph.tables.dialect import LATEST_HEADER, SAMPLE_CHARS, Dialect, find_dialect
from fbgraph.tables.fields import Values, nearly_all
from fbgraph.tables.log_text import LogText
from fbgraph.tables.odd_rows import OddRows, judged_texts
from fbgraph.tables.plain_columns import plain_columns
from fbgraph.tables.table import Column, Table
from fbgraph.tables.tidy_rows import MOST_REMARKS, TidyRows, as_they_are, tidy

MOST_ROWS = 10_000_000
"""A day at 100 Hz: four sensors of a row take half a kilobyte while they are read, and as much again to be smoothed."""
MOST_FIELDS = 250_000_000
"""Of a table, all of which are eight bytes of memory: a day at 100 Hz of two dozen columns."""
_CHUNK_BYTES = 1 << 26


def read_table(text: LogText, name: str, source: str) -> Table | None:
    """The table that a text holds; None if it is none.

    Args:
        text: of one file.
        name: of the table.
        source: for messages.

    Raises:
        DataError: more rows or columns than any walk has.
    """
    first = text.head(2 * SAMPLE_CHARS).split("\n")[:LATEST_HEADER]
    dialect = find_dialect(first)
    widest = max((line.count(",") + 1 for line in first), default=0)
    if widest > MOST_COLUMNS:
        raise DataError(f"{source}: a line of {widest} columns, of which a log has {MOST_COLUMNS} at most")
    if dialect is None:
        return None
    if text.size > min(MOST_FIELDS, MOST_ROWS * dialect.width):  # a field takes a byte at least
        _require_bounds(text, dialect, source)
    parts = []
    for pieces in _chunks(text, dialect.first_row):
        parts.append(_Part(pieces, dialect))
        if parts[-1].rows is not None:  # not all are whole
            _require_bounds(text, dialect, source)
    if not any(len(part) for part in parts):
        return None
    numbers = [_is_of_numbers(parts, i, dialect.kinds[i]) for i in range(dialect.width)]
    for part in parts:
        part.settle(numbers)
    tidied = [part.rows for part in parts if part.rows is not None]
    counts = sum((rows.counts for rows in tidied), Counter({"lines_too_long": text.too_long}))
    remarks = [*dialect.remarks, *chain.from_iterable(rows.remarks for rows in tidied)]
    short = any(rows.widths is not None for rows in tidied)
    return Table(
        name,
        source,
        tuple(_column(parts, i, dialect) for i in range(dialect.width)),
        bool(dialect.header.names),
        dialect.how + (f", {text.encoding}" if text.encoding != "UTF-8" else ""),
        np.concatenate([part.widths for part in parts]) if short else None,
        tuple(remarks[:MOST_REMARKS]),
        {reason: count for reason, count in counts.items() if count},
    )


def _require_bounds(text: LogText, dialect: Dialect, source: str) -> None:
    """Refuse more rows or fields than any walk has."""
    text.require_rows(MOST_ROWS)
    if text.lines_at_most * dialect.width > MOST_FIELDS < text.rows * dialect.width and not text.any_rows:
        raise DataError(
            f"{source}: {text.rows} rows of {dialect.width} columns, the limit is {MOST_FIELDS} fields; "
            "if it is a walk, --max-size SIZE allows more"
        )


def _chunks(text: LogText, skip: int) -> Iterator[list[bytes]]:
    """Pieces of whole lines, many at once, from the line ``skip`` on."""
    held: list[bytes] = []
    size = 0
    for piece in text.pieces:
        at = 0
        while skip and at < len(piece):
            at = (piece.find(b"\n", at) + 1) or len(piece)
            skip -= 1
        held.append(piece[at:] if at else piece)
        size += len(piece)
        if size >= _CHUNK_BYTES:
            yield held
            held, size = [], 0
    yield held


class _Part:
    """Some rows of a table.

    Attributes:
        rows: what was made of the lines; None while they are read as they are written.
        values: of each column, once settled.
    """

    def __init__(self, pieces: list[bytes], dialect: Dialect) -> None:
        self._pieces = pieces
        self._dialect = dialect
        self.rows: TidyRows | None = None
        self.values: list[Values] = []
        self._plain = self._parsed(pieces, dialect.separator) if as_they_are(pieces, dialect) else None
        if self._plain is None:
            self.rows = tidy(b"".join(pieces), dialect)
            alike = self.rows.widths is None
            self._plain = self._parsed([self.rows.data], self.rows.separator) if alike else None

    def _parsed(self, pieces: list[bytes], separator: str) -> list[NDArray[Any]] | None:
        return plain_columns(pieces, separator, self._dialect.decimal, self._dialect.kinds)

    @cached_property
    def _odd(self) -> OddRows:
        if self.rows is None:
            self.rows = tidy(b"".join(self._pieces), self._dialect)
        return OddRows(self.rows, self._dialect)

    def __len__(self) -> int:
        if self._plain is not None:
            return len(self._plain[0])
        return len(self._odd) if self.rows is not None and self.rows.data else 0

    @property
    def widths(self) -> NDArray[np.int64]:
        """(N,) fields of each row."""
        every = np.full(len(self), self._dialect.width, dtype=np.int64)
        return every if self.rows is None or self.rows.widths is None else self.rows.widths

    def is_of_numbers(self, i: int) -> bool:
        """Whether every filled field of a column is a number, as far as that is known without a look at each."""
        return self._plain is not None and self._plain[i].dtype != object

    def judged(self, i: int) -> tuple[int, int]:
        """How many fields of a column hold something, and how many of them are numbers; of some of its fields."""
        if self._plain is None:
            return self._odd.judged(i)
        column = self._plain[i]
        if column.dtype == object:
            return judged_texts(column[column.astype(bool)], len(column), self._dialect.decimal)
        filled = int(np.count_nonzero(~np.isnan(column)))
        return filled, filled

    def settle(self, numbers: Sequence[bool]) -> None:
        """Make each column one of numbers or of text, and leave out rows in which no number is."""
        arrays = None if self._plain is None else _settled(self._plain, numbers)
        if arrays is not None:
            self.values = [Values(array) for array in arrays]
        else:
            self._plain = None
            self._odd.settle(numbers)
            self.rows, self.values = self._odd.rows, self._odd.values


def _settled(columns: Sequence[NDArray[Any]], numbers: Sequence[bool]) -> list[NDArray[Any]] | None:
    """These columns if each is what it is to be, and every row says something; else None."""
    settled = []
    silent: Any = any(numbers)
    for column, of_numbers in zip(columns, numbers, strict=True):
        if of_numbers == (column.dtype == object):
            if of_numbers or not np.isnan(column).all():
                return None
            column = np.full(len(column), None, dtype=object)
        settled.append(column)
        if of_numbers and np.any(silent):
            silent = silent & np.isnan(column)
    return None if np.any(silent) else settled


def _is_of_numbers(parts: Sequence[_Part], i: int, first: str) -> bool:
    """Whether a column is one of numbers; lines that are no rows may add text to one that was at first."""
    if all(part.is_of_numbers(i) for part in parts):
        return True
    filled, numbers = np.sum([part.judged(i) for part in parts], axis=0).tolist()
    return nearly_all(numbers, filled) or (first == "number" and 2 * numbers >= filled)


def _column(parts: Sequence[_Part], i: int, dialect: Dialect) -> Column:
    values = [part.values[i] for part in parts]
    filled = [each.array for each in values if len(each.array)] or [values[0].array]
    array = filled[0] if len(filled) == 1 else np.concatenate(filled)
    return Column(dialect.names[i], dialect.units[i], array, sum(each.unreadable for each in values))
