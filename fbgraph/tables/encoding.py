"""Bytes of any encoding in, UTF-8 out, in pieces: UTF-8 with or without BOM, UTF-16, and line by line latin-1."""

from __future__ import annotations

import codecs
from collections.abc import Iterable, Iterator
from itertools import chain

_HEAD = 4096
_MARKS = ((codecs.BOM_UTF8, ""), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))
_CONTROLS = bytes(sorted(set(range(32)) - set(b"\t\n\v\f\r\x1b\0")))


def utf_16(head: bytes) -> str:
    """Which UTF-16 text of this beginning is in: ``utf-16-le``, ``utf-16-be``; ``""`` for none.

    Told by its mark, or by the zero byte of nearly every character: a log is mostly ASCII.
    """
    for mark, encoding in _MARKS:
        if head.startswith(mark):
            return encoding
    pairs = min(len(head), _HEAD) // 2
    even, odd = head[0 : 2 * pairs : 2].count(0), head[1 : 2 * pairs : 2].count(0)
    if pairs >= 8 and max(even, odd) > 0.7 * pairs and min(even, odd) < 0.05 * pairs:
        return "utf-16-le" if odd > even else "utf-16-be"
    return ""


def is_binary(head: bytes) -> bool:
    """Whether something of this beginning is no text; a few garbled bytes make none of it."""
    head = head[:_HEAD]
    if not head or utf_16(head):
        return False
    strange = head.count(0) + len(head) - len(head.translate(None, _CONTROLS))
    return strange > 0.05 * len(head)


def without_marks(blocks: Iterable[bytes]) -> Iterator[bytes]:
    """The same text in UTF-8, or in what single bytes say; without a mark at its beginning, and without zero bytes.

    A card that lost its power leaves blocks of zeros; they are not text.
    """
    rest = iter(blocks)
    head = b""
    for block in rest:
        head += block
        if len(head) >= _HEAD:
            break
    encoding = utf_16(head)
    head = next((head.removeprefix(mark) for mark, _ in _MARKS if head.startswith(mark)), head)
    if encoding:
        decoder = codecs.getincrementaldecoder(encoding)("replace")
        for block in chain((head,), rest):
            yield decoder.decode(block).replace("\0", "").encode("utf-8", "replace")
        yield decoder.decode(b"", final=True).encode("utf-8", "replace")
        return
    for block in chain((head,), rest):
        yield block.translate(None, b"\0") if 0 in block else block


def as_utf_8(piece: bytes) -> tuple[bytes, int]:
    """Whole lines as UTF-8, and how many of them were not: these are taken for latin-1, one by one.

    A garbled byte costs its own line's characters only, and a line reads the same wherever it is cut from.
    """
    if piece.isascii():
        return piece, 0
    try:
        piece.decode("utf-8")
    except UnicodeDecodeError:
        lines, strange = piece.split(b"\n"), 0
        for i, line in enumerate(lines):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError:
                lines[i] = line.decode("latin-1").encode("utf-8")
                strange += 1
        return b"\n".join(lines), strange
    return piece, 0
