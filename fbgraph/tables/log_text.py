"""The text of a log: read once, bounded, in pieces of whole lines that readers go through as often as they need."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np

from fbgraph.core.bounded import Allowance, WholeLines, file_blocks
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import BoolArray
from fbgraph.tables.encoding import as_utf_8, is_binary, utf_16, without_marks

MOST_LINES = 20_000_000
"""Of a phone's log, which has one for each sample of each sensor: eleven hours of five sensors at 100 Hz."""


@dataclass(frozen=True)
class LogText:
    """A log's text; lines end with LF.

    Attributes:
        source: where it came from.
        pieces: of whole lines, UTF-8; the last may lack its end.
        too_long: lines that are not in it because they ran on for more than 64 KiB.
        any_rows: whether more of them were allowed than any walk has.
        encoding: that it was in: ``UTF-8``, ``UTF-16``, or ``latin-1`` if some of its lines were.
        binary: whether it is no text.
    """

    source: Path
    pieces: tuple[bytes, ...]
    too_long: int = 0
    any_rows: bool = False
    encoding: str = "UTF-8"
    binary: bool = False

    @property
    def size(self) -> int:
        """Its bytes."""
        return sum(map(len, self.pieces))

    @cached_property
    def lines_at_most(self) -> int:
        """How many lines it has, or one too many: known sooner than how many of them are empty."""
        return 1 + sum(int(np.count_nonzero(_ends(piece))) for piece in self.pieces)

    @cached_property
    def rows(self) -> int:
        """Lines that are not empty."""
        return sum(map(_rows, self.pieces))

    def require_rows(self, most: int) -> None:
        """Refuse a log of so many rows that their numbers take much more memory than its text.

        Raises:
            DataError: there are more.
        """
        if self.lines_at_most > most and self.rows > most and not self.any_rows:
            raise DataError(
                f"{self.source}: {self.rows} rows, the limit is {most}; if it is a walk, --max-size SIZE allows more"
            )

    def head(self, chars: int) -> str:
        """Its first so many characters."""
        text, at = "", 0
        while len(text) < chars and at < len(self.pieces):
            wanted = chars - len(text)
            text += self.pieces[at][: 4 * wanted].decode("utf-8", "ignore")[:wanted]  # four bytes a character at most
            at += 1
        return text

    def lines(self) -> Iterator[list[str]]:
        """Its lines without their ends, in order, a piece at a time; some may be empty."""
        for piece in self.pieces:
            yield piece.decode("utf-8").split("\n")  # not splitlines, which also breaks at control characters


def log_text(source: Path | LogText, max_size: int | None = None) -> LogText:
    """The text of a log.

    Args:
        source: a file or pipe, gzipped or not; text that was read before is handed back.
        max_size: bytes of text that are read at most; None for what any walk keeps within.

    Raises:
        DataError: no such file, a directory or device, unreadable, damaged, or larger than allowed.
    """
    if isinstance(source, LogText):
        return source
    return text_of(file_blocks(source, Allowance.of(max_size), "log file"), source, any_rows=max_size is not None)


def text_of(blocks: Iterable[bytes], source: Path, any_rows: bool = False) -> LogText:
    """The text that blocks of bytes hold, in whatever encoding.

    Args:
        blocks: read once.
        source: for messages.
        any_rows: whether the user allowed more rows than any walk has.
    """
    blocks = iter(blocks)
    first = next(blocks, b"")
    lines = WholeLines()
    pieces, strange = [], 0
    for raw in lines.pieces(without_marks(chain((first,), blocks))):
        piece, odd = as_utf_8(raw)
        pieces.append(piece)
        strange += odd
    encoding = "UTF-16" if utf_16(first) else "latin-1" if strange else "UTF-8"
    return LogText(source, tuple(pieces), lines.too_long, any_rows, encoding, is_binary(first))


def _ends(piece: bytes) -> BoolArray:
    ends: BoolArray = np.frombuffer(piece, dtype=np.uint8) == ord("\n")
    return ends


def _rows(piece: bytes) -> int:
    """Lines that are not empty, of a piece that begins with a line."""
    ends = _ends(piece)
    return int(np.count_nonzero(ends[1:] & ~ends[:-1])) + (not ends[-1])
