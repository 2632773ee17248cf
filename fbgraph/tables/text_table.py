"""The table of a text file: pandas reads its rows at once, and what it does not take for numbers is looked at again."""

from __future__ import annotations

import csv
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.core.bounded import MOST_COLUMNS
from fbgraph.core.errors import DataError
from fbgraph.tables.dialect import LATEST_HEADER, SAMPLE_CHARS, Dialect, find_dialect
from fbgraph.tables.fields import NO_VALUE, Values, is_empty, nearly_all, number, numbers_of
from fbgraph.tables.log_text import LogText
from fbgraph.tables.table import Column, Table
from fbgraph.tables.tidy_rows import MOST_REMARKS, TidyRows, tidy

if TYPE_CHECKING:
    import pandas as pd

MOST_ROWS = 10_000_000
"""A day at 100 Hz: four sensors of a row take half a kilobyte while they are read, and as much again to be smoothed."""
MOST_FIELDS = 250_000_000
"""Of a table, all of which are eight bytes of memory: a day at 100 Hz of two dozen columns."""
_CHUNK_BYTES = 1 << 26
_JUDGED = 2000  # fields of a column that is not all numbers


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
    text.require_rows(MOST_ROWS)
    if text.rows * dialect.width > MOST_FIELDS and not text.any_rows:
        raise DataError(
            f"{source}: {text.rows} rows of {dialect.width} columns, the limit is {MOST_FIELDS} fields; "
            "if it is a walk, --max-size SIZE allows more"
        )
    tidied = [tidy(data, dialect) for data in _pieces(text, dialect.first_row)]
    if not any(rows.data for rows in tidied):
        return None
    parts = [_Part(rows, dialect) for rows in tidied]
    numbers = [_is_of_numbers(parts, i, dialect.kinds[i]) for i in range(dialect.width)]
    for part in parts:
        part.settle(numbers)
    counts = sum((part.rows.counts for part in parts), Counter({"lines_too_long": text.too_long}))
    remarks = [*dialect.remarks, *chain.from_iterable(part.rows.remarks for part in parts)]
    short = any(part.rows.widths is not None for part in parts)
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


def _pieces(text: LogText, skip: int) -> Iterator[bytes]:
    """Bytes of whole lines, many at once, from the line ``skip`` on."""
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
            yield b"".join(held)
            held, size = [], 0
    yield b"".join(held)


class _Part:
    """Some rows of a table.

    Attributes:
        rows: as pandas reads them.
        values: of each column, once settled.
    """

    def __init__(self, rows: TidyRows, dialect: Dialect) -> None:
        self._dialect = dialect
        self.rows = rows
        self.values: list[Values] = []
        self._frame = self._read()

    @property
    def widths(self) -> NDArray[np.int64]:
        """(N,) fields of each row."""
        every = np.full(len(self._frame), self._dialect.width, dtype=np.int64)
        return every if self.rows.widths is None else self.rows.widths

    def judged(self, i: int) -> tuple[int, int]:
        """How many fields of a column hold something, and how many of them are numbers; of some of its fields."""
        column = self._frame[i]
        if column.dtype.kind in "iuf":
            filled = int(column.notna().sum())
            return filled, filled
        some = [str(field) for field in column.dropna().iloc[:: max(len(column) // _JUDGED, 1)]]
        some = [field for field in some if not is_empty(field)]
        numbers = sum(number(field, self._dialect.decimal) is not None for field in some)
        scale = max(len(column) // _JUDGED, 1)
        return scale * len(some), scale * numbers

    def settle(self, numbers: Sequence[bool]) -> None:
        """Make each column one of numbers or of text, and leave out rows in which no number is."""
        self.values = self._settled(numbers)
        says = np.zeros(len(self._frame), dtype=bool) if any(numbers) else np.ones(len(self._frame), dtype=bool)
        for values, of_numbers in zip(self.values, numbers, strict=True):
            if of_numbers and not says.all():
                says |= ~np.isnan(values.array)
        if not says.all():
            self.rows = self.rows.without(~says)
            self._frame = self._read()
            self.values = self._settled(numbers)

    def _settled(self, numbers: Sequence[bool]) -> list[Values]:
        kinds = [column.dtype.kind for _, column in self._frame.items()]
        strange = [i for i, kind in enumerate(kinds) if numbers[i] and kind not in "if"]
        written = [i for i, kind in enumerate(kinds) if not numbers[i] and self._frame[i].dtype != "str"]
        texts = self._read(sorted({*strange, *written}), text=True) if strange or written else self._frame
        unreadable = {i: self._unreadable(texts[i]) for i in strange}
        again = self._read(strange, unreadable) if strange else self._frame
        settled = []
        for i, of_numbers in enumerate(numbers):
            if not of_numbers:
                settled.append(Values(_as_objects(texts[i] if i in written else self._frame[i])))
            elif i not in unreadable:
                settled.append(Values(self._frame[i].to_numpy()))
            elif again[i].dtype.kind in "if":
                bad = int(texts[i].isin(unreadable[i]).sum())
                settled.append(Values(again[i].to_numpy(), bad))
            else:  # numbers of hundreds of digits
                settled.append(numbers_of(_as_objects(texts[i]).tolist(), self._dialect.decimal))
        return settled

    def _unreadable(self, texts: pd.Series[Any]) -> set[str]:
        """The fields of a column that are no numbers."""
        import pandas as pd

        fields = texts.dropna()
        if self._dialect.decimal == ",":
            odd = pd.to_numeric(fields.str.replace(",", "."), errors="coerce").isna()
            fields = fields[odd | fields.str.contains(".", regex=False)]
        else:
            fields = fields[pd.to_numeric(fields, errors="coerce").isna()]
        return {field for field in fields.unique() if number(field, self._dialect.decimal) is None}

    def _read(
        self, columns: Sequence[int] | None = None, empty: Mapping[int, set[str]] | None = None, text: bool = False
    ) -> pd.DataFrame:
        """The rows, or some of their columns.

        Args:
            columns: which; None for all.
            empty: fields to take for empty, by column.
            text: whether all fields are to be as they are written.
        """
        import pandas as pd  # here, because it takes a second to import

        options: dict[str, Any] = {
            "sep": self.rows.separator,
            "header": None,
            "names": list(range(self._dialect.width)),
            "index_col": False,
            "dtype": str if text else None,
            "decimal": self._dialect.decimal,
            "quoting": csv.QUOTE_NONE,
            "keep_default_na": False,
            "na_values": list(NO_VALUE) if empty is None else {i: [*NO_VALUE, *empty[i]] for i in empty},
            "skipinitialspace": True,
            "skip_blank_lines": False,
        }
        frame: pd.DataFrame
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pd.errors.DtypeWarning)  # told apart below
            try:
                wanted = None if columns is None else list(columns)
                frame = pd.read_csv(BytesIO(self.rows.data), usecols=wanted, iterator=False, **options)
            except pd.errors.ParserError:  # no row of these has the last columns: pandas minds if only some are wanted
                frame = pd.read_csv(BytesIO(self.rows.data), iterator=False, **options)
                frame = frame if columns is None else frame[list(columns)]
        return frame


def _is_of_numbers(parts: Sequence[_Part], i: int, first: str) -> bool:
    """Whether a column is one of numbers; lines that are no rows may add text to one that was at first."""
    filled, numbers = np.sum([part.judged(i) for part in parts], axis=0).tolist()
    return nearly_all(numbers, filled) or (first == "number" and 2 * numbers >= filled)


def _as_objects(column: pd.Series[Any]) -> NDArray[Any]:
    """Text without white space around it, None where there is no value."""
    array: NDArray[Any] = np.full(len(column), None, dtype=object)
    there = column.notna().to_numpy()
    array[there] = [None if is_empty(field) else field.strip() for field in column[there].tolist()]
    return array


def _column(parts: Sequence[_Part], i: int, dialect: Dialect) -> Column:
    values = [part.values[i] for part in parts]
    filled = [each.array for each in values if len(each.array)] or [values[0].array]
    array = filled[0] if len(filled) == 1 else np.concatenate(filled)
    return Column(dialect.names[i], dialect.units[i], array, sum(each.unreadable for each in values))
