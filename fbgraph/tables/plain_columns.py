"""Columns of rows that are all alike, parsed by Arrow as they are written; nothing at all if a single one is not.

Arrow refuses rows of another width and takes a column for numbers only if every field is one, so that what it reads
needs no other proof. Numbers are rounded correctly, as ``tables.fields.number`` rounds them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.tables.fields import is_empty

_EMPTY = ["", " ", "-", "nan", "NaN", "null", "None", "N/A"]  # the usual ones of NO_VALUE: each costs a little a field
_HEX = (b"0x", b"0X")  # to Arrow a whole number


def plain_columns(
    pieces: Sequence[bytes], separator: str, decimal: str, kinds: Sequence[str]
) -> list[NDArray[Any]] | None:
    """The columns of some rows: int64 or float64 (nan where empty), else text (None where empty).

    Whole numbers with a plus sign are float64, ``nan(…)`` is a hole.

    Args:
        pieces: of whole lines, without quotes and comments; the last may lack its end.
        separator: between fields.
        decimal: ``.`` or ``,``.
        kinds: of each column, as of a ``Dialect``.

    Returns:
        None if a row has another number of fields, a column of kind ``number`` holds anything else, or one of no kind
        what is neither a number nor plain text.
    """
    import pyarrow as pa  # here, because it takes its time to import
    from pyarrow import csv

    if any(map(_may_hold_hex, pieces)):
        return None
    names = [str(i) for i in range(len(kinds))]
    try:
        table = csv.read_csv(
            _Pieces(pieces),
            csv.ReadOptions(use_threads=False, column_names=names, block_size=max(map(len, pieces), default=0) or 1),
            csv.ParseOptions(delimiter=separator, quote_char=False),
            csv.ConvertOptions(
                check_utf8=False,
                column_types={name: pa.string() for name, kind in zip(names, kinds, strict=True) if kind == "text"},
                null_values=_EMPTY,
                true_values=[],
                false_values=[],
                strings_can_be_null=True,
                decimal_point=decimal,
            ),
        )
    except pa.ArrowException:
        return None
    numbers = (pa.int64(), pa.float64(), pa.null())
    for column, kind in zip(table.columns, kinds, strict=True):
        if column.type not in numbers and (kind == "number" or column.type != pa.string()):
            return None
    return [_text(column.to_pylist()) if column.type == pa.string() else _numbers(column) for column in table.columns]


def _may_hold_hex(piece: bytes) -> bool:
    if not piece or np.frombuffer(piece, dtype=np.uint8).max() < ord("X"):  # nothing but numbers, as a rule
        return False
    return any(mark[1:] in piece and mark in piece for mark in _HEX)  # one byte is found fast


def _numbers(column: Any) -> NDArray[Any]:
    if column.null_count == len(column):
        return np.full(len(column), np.nan)
    array: NDArray[Any] = column.to_numpy()
    return array if array.flags.writeable else array.copy()


def _text(fields: Sequence[str | None]) -> NDArray[Any]:
    array: NDArray[Any] = np.full(len(fields), None, dtype=object)
    array[:] = [None if field is None or is_empty(field) else field.strip() for field in fields]
    return array


class _Pieces:
    """A file for Arrow to read: a piece each time, so that none is copied."""

    closed = False

    def __init__(self, pieces: Sequence[bytes]) -> None:
        self._pieces: Iterator[bytes] = iter([piece for piece in pieces if piece])

    def read(self, size: int = -1, /) -> bytes:
        """The next piece; no bytes at the end."""
        return next(self._pieces, b"") if size else b""

    def readable(self) -> bool:
        return True

    def close(self) -> None:
        self.closed = True
