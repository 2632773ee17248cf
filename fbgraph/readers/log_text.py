"""The text of a log: read once, bounded, in pieces of whole lines that readers go through as often as they need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fbgraph.core.bounded import Allowance, WholeLines, file_blocks


@dataclass(frozen=True)
class LogText:
    """A log's text, as latin-1, which every byte decodes to; lines end with LF.

    Attributes:
        source: where it came from.
        pieces: of whole lines; the last may lack its end.
        too_long: lines that are not in it because they ran on for more than 64 KiB.
    """

    source: Path
    pieces: tuple[str, ...]
    too_long: int = 0

    def head(self, chars: int) -> str:
        """Its first so many characters."""
        text, at = "", 0
        while len(text) < chars and at < len(self.pieces):
            text += self.pieces[at][: chars - len(text)]
            at += 1
        return text

    def lines(self) -> Iterator[list[str]]:
        """Its lines without their ends, in order, a piece at a time; some may be empty."""
        for piece in self.pieces:
            yield piece.split("\n")  # not splitlines, which also breaks at control characters


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
    lines = WholeLines()
    blocks = file_blocks(source, Allowance.of(max_size), "log file")
    return LogText(source, tuple(piece.decode("latin-1") for piece in lines.pieces(blocks)), lines.too_long)
