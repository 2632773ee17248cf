"""The lines that name a table's columns: one or two rows of names, perhaps a row of units, perhaps in a comment."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from fbgraph.tables.fields import is_empty, is_time, number

_UNIT_TEXT = """
    s sec secs second seconds ms msec millis milliseconds us usec micros microseconds ns nanoseconds min h hz khz
    g mg gal m/s2 m/s^2 m/s/s ms-2 m/s**2 m.s-2 mm/s2 dps mdps deg/s deg/sec d/s rad/s rads rad/sec rad.s-1 mrad/s
    ut nt gauss gs mgauss mga t mt hpa pa kpa mbar bar psi inhg mmhg c degc f degf k deg degree degrees rad m cm mm
    km m/s km/h kph mph % v mv ma lux lx db dbm lsb raw counts count unit units bool text string hh:mm:ss epoch unix utc
    iso yyyy-mm-dd - # n/a none int float
"""
_UNIT_WORDS = frozenset(_UNIT_TEXT.split())


@dataclass(frozen=True)
class Header:
    """What names a table's columns.

    Attributes:
        names: of the columns; none if there is no header.
        units: that a row below them gives; none if there is none.
        lines: which of the lines looked at they are.
        rows: fields of these lines: where they come again they are no data.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    lines: tuple[int, ...] = ()
    rows: frozenset[tuple[str, ...]] = frozenset()


def find_header(before: Sequence[list[str]], comments: Sequence[bool], width: int, data: Sequence[list[str]]) -> Header:
    """The header among the lines before the first row of data; an empty one if the data begin without.

    Args:
        before: fields of the lines before the first row.
        comments: which of the lines are comments; one that names the columns is a header all the same.
        width: columns of the data.
        data: some of its rows.
    """
    named = [i for i, row in enumerate(before) if _names(row, width, strict=comments[i])]
    plain = [i for i in named if not comments[i]]
    exact = [i for i in plain if abs(len(before[i]) - width) <= 1]
    last = (exact or plain or named or [-1])[-1]
    if last < 0:
        return Header()
    lines: list[int] = [last]
    units: tuple[str, ...] = ()
    above = _line_before(before, comments, last, width)
    if above is not None and _are_units(before[last]):
        units, lines, above = tuple(before[last]), [above, last], _line_before(before, comments, above, width)
    names = [_unmarked(field) if i == 0 and comments[lines[0]] else field for i, field in enumerate(before[lines[0]])]
    if above is not None and _are_groups(before[above], names):
        names, lines = _joined(before[above], names), [above, *lines]
    rows = frozenset(tuple(before[i]) for i in lines)
    while len(names) > width and not names[-1]:
        names.pop()
    if len(names) == width - 1 and _counts(data):
        names = ["", *names]
    return Header(tuple(names), units, tuple(lines), rows)


def _names(row: list[str], width: int, strict: bool) -> bool:
    """Whether fields may be names of so many columns."""
    filled = [field for field in row if not is_empty(field)]
    if len(filled) < 2 or len(filled) < 0.5 * width or any(number(field) is not None for field in filled[:2]):
        return False
    if strict and abs(len(row) - width) > 1:
        return False
    unlike = sum(number(field) is not None or is_time(field) or len(field) > 80 for field in filled)
    return unlike <= 0.2 * len(filled)


def _line_before(before: Sequence[list[str]], comments: Sequence[bool], i: int, width: int) -> int | None:
    """The line before this one that may be part of the same header."""
    for j in range(i - 1, -1, -1):
        if any(before[j]):
            fits = not comments[j] and _names(before[j], min(width, 2), strict=False)
            return j if fits and abs(len(before[j]) - len(before[i])) <= 1 else None
    return None


def _are_units(row: list[str]) -> bool:
    """Whether fields are units rather than names."""
    filled = [_plain(field) for field in row if not is_empty(field)]
    return bool(filled) and sum(field in _UNIT_WORDS for field in filled) >= 0.6 * len(filled)


def _plain(unit: str) -> str:
    unit = unit.lower().strip("[](){} ").replace("µ", "u").replace("μ", "u").replace("²", "2").replace("°", "deg")
    return re.sub(r"\s+", "", unit).replace("degdeg", "deg")


def _are_groups(row: list[str], names: list[str]) -> bool:
    """Whether fields stand above names that need them: names come twice, and what stands above spans several."""
    filled = [name for name in names if name]
    return len(set(filled)) < len(filled) and (len({*row} - {""}) < len(row))


def _joined(groups: list[str], names: list[str]) -> list[str]:
    """Names with what stands above them; what stands above several may be written above the first only."""
    spread, last = [], ""
    for i in range(len(names)):
        last = (groups[i] if i < len(groups) else "") or last
        spread.append(last)
    return [f"{group} {name}".strip() for group, name in zip(spread, names, strict=True)]


def _unmarked(name: str) -> str:
    return re.sub(r"^\s*(?:#|%|//)\s*", "", name)


def _counts(data: Sequence[list[str]]) -> bool:
    """Whether the first column is a count of rows, which some writers leave without a name."""
    first = [number(row[0]) for row in data if row]
    if len(first) < 2 or not all(isinstance(value, int) for value in first):
        return False
    steps = {b - a for a, b in pairwise(first) if isinstance(a, int) and isinstance(b, int)}
    return len(steps) == 1 and min(steps) >= 1
