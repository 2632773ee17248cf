"""What a field of a table says: a number, no value, or text. One definition for files and for lines that arrive."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_WORDS = ("nan", "-nan", "none", "null", "nil", "n/a", "na", "#n/a", "n.a.", "undefined", "(null)", "<null>", "nat")
NO_VALUE = frozenset(
    {"", "-", "--", "---", "?", "NaN", "-NaN", "1.#QNAN", "-1.#IND", "<NA>"}
    | {form for word in _WORDS for form in (word, word.upper(), word.capitalize())}
)
"""Fields with which loggers say that there is no value."""

_WHOLE = re.compile(r"[+-]?[0-9]+")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[+-]?inf(?:inity)?", re.IGNORECASE)
_TIME = re.compile(
    r"(?:\d{2,4}[-/.]\d{1,2}[-/.]\d{2,4})?(?:[T _]?\d{1,2}[:-]\d{2}(?:[:-]\d{2})?(?:[.,:]\d{1,9})?)?"
    r" ?(?:[APap][Mm]|Z|UTC|[+-]\d{2}:?\d{2})?",
    re.ASCII,
)
_NEARLY = 0.8  # of the filled fields of a column of numbers


@dataclass(frozen=True)
class Values:
    """A column's fields as numbers or text.

    Attributes:
        array: int64, float64 or object, as ``Column.values``.
        unreadable: filled fields that are no numbers, where it is one of numbers.
    """

    array: NDArray[Any]
    unreadable: int = 0


def number(text: str, decimal: str = ".") -> int | float | None:
    """A field's number, whole if it is written so; None if it is none, be it empty or text.

    ``1_000``, ``0x10`` and digits of other scripts are none; white space around it does not matter.
    """
    text = text.strip()
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    if _WHOLE.fullmatch(text):
        whole = int(text) if len(text) < 30 else None
        return whole if whole is not None and -(2**63) <= whole < 2**63 else float(text)
    return float(text) if _NUMBER.fullmatch(text) else None


def is_empty(text: str) -> bool:
    """Whether a field says that there is no value."""
    return text.strip() in NO_VALUE


def is_time(text: str) -> bool:
    """Whether a field is a date, a time of day, or both."""
    return len(text) > 4 and _TIME.fullmatch(text.strip()) is not None


def kind(fields: Sequence[str], decimal: str = ".") -> str:
    """Of a column of these fields: ``number``, ``text``, or ``""`` if all are empty."""
    filled = [field for field in fields if not is_empty(field)]
    if not filled:
        return ""
    numbers = sum(number(field, decimal) is not None for field in filled)
    return "number" if numbers >= _NEARLY * len(filled) else "text"


def nearly_all(numbers: int, filled: int) -> bool:
    """Whether a column with so many numbers in its filled fields is one of numbers."""
    return numbers >= _NEARLY * filled


def numbers_of(fields: Sequence[str | None], decimal: str = ".") -> Values:
    """Fields as numbers: int64 if all are whole, else float64, nan where there is none."""
    found = [None if field is None else number(field, decimal) for field in fields]
    unreadable = sum(
        value is None and field is not None and not is_empty(field) for value, field in zip(found, fields, strict=True)
    )
    if found and all(isinstance(value, int) for value in found):
        return Values(np.array(found, dtype=np.int64))
    return Values(np.array([np.nan if value is None else value for value in found], dtype=np.float64), unreadable)


def text_of_fields(fields: Sequence[str]) -> Values:
    """Fields as text, None where there is no value."""
    array = np.empty(len(fields), dtype=object)
    array[:] = [None if is_empty(field) else field.strip() for field in fields]
    return Values(array)
