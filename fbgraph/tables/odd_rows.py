"""Rows that are not all alike: pandas reads them at once, and what it does not take for numbers is looked at again."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.tables.dialect import Dialect
from fbgraph.tables.fields import NO_VALUE, Values, is_empty, number, numbers_of
from fbgraph.tables.tidy_rows import TidyRows

if TYPE_CHECKING:
    import pandas as pd

_JUDGED = 2000  # fields of a column that is not all numbers


class OddRows:
    """Some rows of a table of which a few are short, or a few fields no numbers.

    Attributes:
        rows: as pandas reads them.
        values: of each column, once settled.
    """

    def __init__(self, rows: TidyRows, dialect: Dialect) -> None:
        self._dialect = dialect
        self.rows = rows
        self.values: list[Values] = []
        self._frame = self._read()

    def __len__(self) -> int:
        """How many there are."""
        return len(self._frame)

    def judged(self, i: int) -> tuple[int, int]:
        """How many fields of a column hold something, and how many of them are numbers; of some of its fields."""
        column = self._frame[i]
        if column.dtype.kind in "iuf":
            filled = int(column.notna().sum())
            return filled, filled
        return judged_texts(column.dropna(), len(column), self._dialect.decimal)

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
            elif again[i].dtype.kind in "if" and not any(map(_is_number_of_python, unreadable[i])):
                bad = int(texts[i].isin(unreadable[i]).sum())
                settled.append(Values(again[i].to_numpy(), bad))
            else:  # numbers of hundreds of digits; 1_2, to be left out of which pandas leaves out 12
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


def _is_number_of_python(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def judged_texts(fields: pd.Series[Any] | NDArray[Any], rows: int, decimal: str) -> tuple[int, int]:
    """How many of these fields hold something, and how many of them are numbers; told by some of many.

    Args:
        fields: that are not empty.
        rows: of their column.
        decimal: ``.`` or ``,``.
    """
    scale = max(rows // _JUDGED, 1)
    some = [field for field in map(str, fields[::scale]) if not is_empty(field)]
    numbers = sum(number(field, decimal) is not None for field in some)
    return scale * len(some), scale * numbers


def _as_objects(column: pd.Series[Any]) -> NDArray[Any]:
    """Text without white space around it, None where there is no value."""
    array: NDArray[Any] = np.full(len(column), None, dtype=object)
    there = column.notna().to_numpy()
    array[there] = [None if is_empty(field) else field.strip() for field in column[there].tolist()]
    return array
