"""Rows as pandas takes them: comments, repeated headers, quotes and what else is no row are taken out of the text."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fbgraph.core.geometry import BoolArray, IntArray
from fbgraph.tables.dialect import Dialect, uncommented

MOST_REMARKS = 200
_FEW = 10  # rows; of fewer none is given up
_INNER = "\x1f"  # between fields where a quoted one holds the separator
_MARKS = (b"#", b"%", b"//")
_BLANK_LINES = re.compile(rb"\n\n+")
_BLANKS = re.compile(rb"[ \t]+")
_ENDS = re.compile(rb"^ | $", re.MULTILINE)


@dataclass
class TidyRows:
    """Whole rows and nothing else.

    Attributes:
        data: lines, each with its end.
        separator: between their fields.
        widths: (N,) fields that each row has; None if it has all.
        counts: lines left out, by reason.
        remarks: comments.
    """

    data: bytes
    separator: str
    widths: IntArray | None = None
    counts: Counter[str] = field(default_factory=Counter)
    remarks: list[str] = field(default_factory=list)

    def without(self, rows: BoolArray) -> TidyRows:
        """The same without these rows, which are counted as unreadable."""
        lines = self.data.split(b"\n")[:-1]
        kept = [line for line, out in zip(lines, rows.tolist(), strict=True) if not out]
        counts = self.counts + Counter({"lines_unreadable": len(lines) - len(kept)})
        widths = None if self.widths is None else self.widths[~rows]
        return TidyRows(b"".join(line + b"\n" for line in kept), self.separator, widths, counts, self.remarks)


def as_they_are(pieces: Sequence[bytes], dialect: Dialect) -> bool:
    """Whether the lines may all be rows that need no ``tidy``, or else show it by a field that is no number."""
    if dialect.monitor or dialect.separator == " " or any(b'"' in piece for piece in pieces):
        return False
    if dialect.kinds[0] == "number":  # no comment or header begins with one
        return True
    return not any(_has_others(piece, dialect) for piece in pieces)


def tidy(data: bytes, dialect: Dialect) -> TidyRows:
    """The rows of some whole lines; as they are written where all are alike."""
    separator = dialect.separator.encode()
    cut = _cut_short(data, dialect)
    counts: Counter[str] = Counter({"lines_cut_short": 1} if cut else {})
    data = data[: len(data) - len(cut)]
    if b"\n\n" in data or data.startswith(b"\n"):  # a card filled with line ends holds millions
        data = _BLANK_LINES.sub(b"\n", data).lstrip(b"\n")
    if data and not data.endswith(b"\n"):
        data += b"\n"
    plain = data.translate(None, b'"') if b'"' in data else data
    if separator == b" ":
        plain = _BLANKS.sub(b" ", plain) if b"  " in plain or b"\t" in plain else plain
        plain = _ENDS.sub(b"", plain)
    if not dialect.monitor and not _has_others(plain, dialect):
        if _all_alike(plain, separator, dialect.width):
            return TidyRows(plain, dialect.separator, counts=counts)
        bare = plain.replace(separator + b"\n", b"\n")  # a comma after the last field
        trailing = separator != b" " and len(plain) - len(bare) == plain.count(b"\n")
        if trailing and _all_alike(bare, separator, dialect.width):
            return TidyRows(bare, dialect.separator, counts=counts)
    return _line_by_line(data, plain, dialect, counts)


def _cut_short(data: bytes, dialect: Dialect) -> bytes:
    """The last line, if it has neither its end nor all of its fields: its last number may have been cut too."""
    line = data[data.rfind(b"\n") + 1 :] if data.count(b"\n", 0, 1 << 16) >= _FEW else b""
    found = dialect.fields(line.decode("utf-8")) if line else []
    return line if isinstance(found, list) and 0 < len(found) < dialect.width else b""


def _has_others(plain: bytes, dialect: Dialect) -> bool:
    """Whether some lines may be no rows but comments or headers."""
    if any(mark[:1] in plain and (plain.startswith(mark) or b"\n" + mark in plain) for mark in _MARKS):
        return True
    return any(_rare(name) in plain and name in plain for name in _telling(dialect))


def _rare(name: bytes) -> bytes:
    """A character of a name that numbers have not; one is found faster than many."""
    return name.translate(None, b"0123456789+-. eEnaifNAIF")[:1] or name


def _telling(dialect: Dialect) -> list[bytes]:
    """A name of each row of the header, by which one that comes again is told."""
    return [max(row, key=len).encode() for row in dialect.header.rows]


def _all_alike(plain: bytes, separator: bytes, width: int) -> bool:
    """Whether each line has so many fields."""
    ends = plain.translate(None, bytes(set(range(256)) - set(separator + b"\n")))
    row = separator * (width - 1) + b"\n"
    return ends == row * (len(ends) // len(row))


def _line_by_line(data: bytes, plain: bytes, dialect: Dialect, counts: Counter[str]) -> TidyRows:
    """Rows of lines of which some are none, or are longer or shorter than others."""
    separator, width, telling = dialect.separator.encode(), dialect.width, _telling(dialect)
    kept: list[bytes | list[str]] = []
    widths: list[int] = []
    remarks: list[str] = []
    inner = dialect.separator
    for line, written in zip(plain.split(b"\n"), data.split(b"\n"), strict=True):
        has = line.count(separator) + 1
        easy = 1 < has <= width and line[0] not in b"#%/ \t" and not dialect.monitor and b'"' not in written
        if easy and not any(name in line for name in telling):
            kept.append(line)
            widths.append(has)
            continue
        found = dialect.fields(written.decode("utf-8"))
        if isinstance(found, list):
            kept.append(found)
            widths.append(len(found))
            inner = _INNER if any(dialect.separator in field for field in found) else inner
        elif found == "comment":
            remarks += [uncommented(written.decode("utf-8"))][: MOST_REMARKS - len(remarks)]
        elif found != "blank":
            counts[found] += 1
    lines = [
        line.replace(separator, inner.encode()) if isinstance(line, bytes) else inner.join(line).encode("utf-8")
        for line in kept
    ]
    given = np.array(widths, dtype=np.int64)
    rows = b"".join(line + b"\n" for line in lines)
    return TidyRows(rows, inner, given if (given < width).any() else None, counts, remarks)
