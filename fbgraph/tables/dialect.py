"""How somebody's logger writes a table, found from its first lines: the same for a file and for lines that arrive.

The separator is found as CleverCSV does it (van den Burg, Nazábal and Sutton 2019): the one by which rows are of one
width and their fields numbers or times, rather than the most frequent character.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from fbgraph.core.bounded import MOST_COLUMNS
from fbgraph.tables.fields import is_empty, is_time, kind, number, numbers_of, text_of_fields
from fbgraph.tables.headers import Header, find_header
from fbgraph.tables.table import Column

LATEST_HEADER = 1100
"""Lines in which a table has to begin."""
SAMPLE_CHARS = 1 << 18
MONITOR_COLUMN = "serial monitor time"
"""The name of the column that a serial monitor's time before each line becomes."""
_USUAL = 0.25  # of the rows, that have a number of fields: what stands in a head is rarer
_JUDGED = 60  # rows from which separator and kinds are told
SEPARATORS = {",": 1.0, ";": 1.0, "\t": 1.0, "|": 0.3, " ": 0.6}
_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}
_MONITOR = re.compile(r"\[?((?:\d{4}-\d\d-\d\d[ T])?\d{1,2}:\d\d:\d\d(?:[.,]\d{1,6})?)(?:\] ?| -?> )", re.ASCII)
_COMMENT = re.compile(r"(?:#|%|//)")


@dataclass(frozen=True)
class Rows:
    """What some lines hold.

    Attributes:
        columns: as of a ``Table``.
        widths: fields that each row has.
        counts: lines that are not here, by reason.
        remarks: the comments among them.
    """

    columns: tuple[Column, ...]
    widths: tuple[int, ...]
    counts: dict[str, int]
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Dialect:
    """How a table is written.

    Attributes:
        separator: between fields; ``" "`` is any run of blanks and tabs.
        decimal: ``.`` or ``,``.
        monitor: a serial monitor's time stands before each line; it becomes a first column.
        header: names, units and the lines that hold them.
        width: columns.
        kinds: of each column: ``number``, ``text``, or ``""`` while no row had a value in it.
        first_row: of the lines it was found from, where the rows begin.
        remarks: lines before the rows that are no header.
    """

    separator: str
    decimal: str
    monitor: bool
    header: Header
    width: int
    kinds: tuple[str, ...]
    first_row: int
    remarks: tuple[str, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of its columns."""
        names = self._all(self.header.names)
        return (MONITOR_COLUMN, *names[1:]) if self.monitor else names

    @cached_property
    def units(self) -> tuple[str, ...]:
        """That a row of units gives its columns."""
        return self._all(self.header.units)

    @property
    def how(self) -> str:
        """For people: ``semicolons, decimal comma``."""
        said = [_NAMES[self.separator]]
        said += ["decimal comma"] if self.decimal == "," else []
        said += ["a serial monitor's times"] if self.monitor else []
        said += [] if self.header.names else ["no header"]
        return ", ".join(said)

    def fields(self, line: str) -> list[str] | str:
        """The fields of a row, or why a line is none: ``blank``, ``comment``, ``headers_repeated``, ``rows_too_long``.

        Fields that are empty and stand after the last column do not count.
        """
        stripped = line.strip()
        if not stripped:
            return "blank"
        if _COMMENT.match(line.lstrip() if self.separator == " " else line):
            return "comment"
        found = split(line, self.separator, self.monitor)
        if tuple(found[self.monitor :]) in self.header.rows:
            return "headers_repeated"
        while len(found) > self.width and is_empty(found[-1]):
            found.pop()
        return found if len(found) <= self.width else "rows_too_long"

    def parse(self, lines: Sequence[str]) -> Rows:
        """The rows of some lines, without their ends; the same for the same line in whatever company it comes.

        Columns are of the kinds that they had when the dialect was found; one that was empty then is of text, or of
        numbers as long as it stays empty.
        Of a column of numbers with holes in it the whole numbers beyond 2^53 are rounded.
        """
        rows: list[list[str]] = []
        counts: Counter[str] = Counter()
        remarks = []
        texts = [kind != "number" for kind in self.kinds]
        for line in lines:
            found = self.fields(line)
            if isinstance(found, str):
                if found == "comment":
                    remarks.append(uncommented(line))
                elif found != "blank":
                    counts[found] += 1
            elif self.says_nothing(found, texts):
                counts["lines_unreadable"] += 1
            else:
                rows.append(found)
        widths = tuple(len(row) for row in rows)
        padded = [row + [""] * (self.width - len(row)) for row in rows]
        columns = []
        for i, fields in enumerate(zip(*padded, strict=True) if padded else [()] * self.width):
            empty = not self.kinds[i] and all(map(is_empty, fields))
            values = text_of_fields(fields) if texts[i] and not empty else numbers_of(fields, self.decimal)
            columns.append(Column(self.names[i], self.units[i], values.array, values.unreadable))
        return Rows(tuple(columns), widths, dict(counts), tuple(remarks))

    def learned(self, lines: Sequence[str]) -> Dialect:
        """The same with kinds of columns that were empty, as far as these lines fill them."""
        empty = [i for i, kind in enumerate(self.kinds) if not kind]
        rows = [row for row in map(self.fields, lines) if not isinstance(row, str)] if empty else []
        kinds = list(self.kinds)
        for i in empty:
            kinds[i] = kind([row[i] for row in rows if i < len(row)], self.decimal)
        return replace(self, kinds=tuple(kinds))

    def says_nothing(self, fields: Sequence[str], texts: Sequence[bool]) -> bool:
        """Whether a row has no number in any column of numbers, where there is one."""
        if all(texts):
            return False
        return all(text or number(field, self.decimal) is None for field, text in zip(fields, texts, strict=False))

    def _all(self, some: Sequence[str]) -> tuple[str, ...]:
        some = ["", *some] if self.monitor else some
        return (*some, *[""] * (self.width - len(some)))[: self.width]


def split(line: str, separator: str, monitor: bool = False) -> list[str]:
    """The fields of a line, without quotes and the white space around them."""
    first = []
    if monitor:
        match = _MONITOR.match(line)
        first, line = [match[1] if match else ""], line[match.end() :] if match else line
    if separator == " ":
        found = line.split()
    elif '"' in line:
        found = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    else:
        found = line.split(separator)
    return first + [field.strip().strip('"').strip() for field in found]


def uncommented(line: str) -> str:
    """A comment without its mark."""
    return _COMMENT.sub("", line.strip(), count=1).strip()


def find_dialect(lines: Sequence[str]) -> Dialect | None:
    """How the table is written that these lines begin; None if they are none.

    Args:
        lines: the first ones, without their ends; a thousand may come before the table does.
    """
    lines = _bounded(lines)
    told = re.fullmatch(r'\s*"?sep=(.)"?[,;\s]*', lines[0]) if lines else None
    start = 1 if told else 0
    judged = _some([line for line in lines[start:] if line.strip() and not _COMMENT.match(line)])
    monitor = sum(bool(_MONITOR.match(line)) for line in judged) > 0.7 * len(judged) > 0.0
    options = [told[1]] if told and told[1] in SEPARATORS else list(SEPARATORS)
    scored = [
        (
            _score([split(line, separator, monitor) for line in judged], decimal) * SEPARATORS[separator],
            separator,
            decimal,
        )
        for separator in options
        for decimal in (".", ",")
        if decimal == "." or separator != "," or any('"' in line for line in judged)
    ]
    for score, separator, decimal in sorted(scored, key=lambda each: -each[0]):
        if score > 0.0 and (found := _with(lines, start, judged, Writing(separator, decimal, monitor))):
            return found
    return None


class Writing(NamedTuple):
    """What fields are told by: ``separator``, ``decimal`` and ``monitor`` of a ``Dialect``."""

    separator: str
    decimal: str
    monitor: bool


def _with(lines: list[str], start: int, judged: list[str], writing: Writing) -> Dialect | None:
    """The dialect if fields are told so."""
    separator, decimal, monitor = writing
    rows = [split(line, separator, monitor) for line in judged]
    data = [row for row in rows if _is_data(row, decimal)]
    if 2 * len(data) < len(rows) - 1 and len({len(row) for row in rows}) == 1:  # mostly text; prose is no table
        data = rows[1:]
    width, usual = _width(data)
    if not 2 <= width <= MOST_COLUMNS:
        return None
    first = _first_row(lines[start:], writing, usual)
    above = [split(line, separator, monitor) for line in lines[start : start + first]]
    comments = [bool(_COMMENT.match(line)) for line in lines[start : start + first]]
    header = find_header([row[monitor:] for row in above], comments, width - monitor, data)
    if not header.names:
        later = [split(line, separator, monitor)[monitor:] for line in lines[start + first :]]
        header = _late_header(later, width - monitor, data)
    width = max(width, min(len(header.names) + monitor, MOST_COLUMNS))
    columns = [[row[i] for row in data if i < len(row)] for i in range(width)]
    remarks = [uncommented(line) for i, line in enumerate(lines[start : start + first]) if i not in header.lines]
    kinds = tuple(kind(column, decimal) for column in columns)
    said = tuple(remark for remark in remarks if remark)
    return Dialect(separator, decimal, monitor, header, width, kinds, start + first, said)


def _late_header(rows: Sequence[list[str]], width: int, data: Sequence[list[str]]) -> Header:
    """A header that comes after rows already, as a device that repeats it sends it to who listens late."""
    for row in rows:
        alike = len(row) == len({*row}) and len(row) - width in (0, 1) and width > 2
        if alike and (header := find_header([row], [False], width, data)).names:
            return replace(header, lines=())
    return Header()


def _bounded(lines: Sequence[str]) -> list[str]:
    """The first ones, no more of them than a table may begin late, or than can be looked at in no time."""
    kept, chars = [], 0
    for line in lines[:LATEST_HEADER]:
        kept.append(line)
        chars += len(line)
        if chars > SAMPLE_CHARS:
            break
    return kept


def _some(lines: list[str]) -> list[str]:
    """Lines to judge by: the first, some from the middle and the last; neighbours, for kinds of rows may alternate."""
    run = _JUDGED // 3
    middle = len(lines) // 2
    return lines if len(lines) <= _JUDGED else lines[:run] + lines[middle : middle + run] + lines[-run:]


def _score(rows: list[list[str]], decimal: str) -> float:
    """How much rows look like a table's: consistent widths times the share of fields that are numbers or times."""
    widths = Counter(len(row) for row in rows)
    pattern = sum(count * (width - 1) / width for width, count in widths.items() if width) / max(len(widths), 1)
    if not pattern:
        return 0.0
    fields = [field for row in rows for field in row]
    typed = sum(number(field, decimal) is not None or is_empty(field) or is_time(field) for field in fields)
    return pattern * (typed / max(len(fields), 1) + 1e-3)


def _is_data(row: list[str], decimal: str) -> bool:
    """Whether fields are those of a row of data: at least one number, and as many numbers and times as other text."""
    filled = [field for field in row if not is_empty(field)]
    numbers = sum(number(field, decimal) is not None for field in filled)
    typed = numbers + sum(is_time(field) for field in filled if number(field, decimal) is None)
    return len(row) >= 2 and numbers > 0 and typed >= 0.2 * len(filled)


def _width(data: list[list[str]]) -> tuple[int, set[int]]:
    """Columns of rows of data, and how many fields rows of it usually have."""
    full = Counter(len(row) - (len(row) > 2 and all(other[-1] == "" for other in data)) for row in data)
    usual = {width for width, count in full.items() if count >= _USUAL * len(data)}
    return max(usual, default=max(full, default=0)), usual | {width + 1 for width in usual}


def _first_row(lines: Sequence[str], writing: Writing, usual: set[int]) -> int:
    """Where the rows begin; behind all of them if none is one of data."""
    above: list[str] = []
    usual_line = 0
    for i, line in enumerate(lines):
        row = split(line, writing.separator, writing.monitor)
        named = len(row) == len(above) >= 3 and not _is_data(above, writing.decimal)
        if (len(row) in usual or named) and _is_data(row, writing.decimal) and not _COMMENT.match(line):
            return i
        above = row if any(row) else above
        if not usual_line and len(row) in usual and not _COMMENT.match(line):
            usual_line = i + 1
    return usual_line
