"""Numbered lines: what a recorder's link loses is asked for again, so that ``raw.csv`` is the file on the device.

The protocol is told in ``scripts/recorder/README.md``. A line of a walk's file, numbered from 0, is sent as
``$WALK:NUMBER,LINE*SUM``; ``@WALK:COUNT*SUM`` says how many there are, ``-WALK:A-B*SUM`` which are gone. Back go
``?WALK:A-B;C-D*SUM``, lines to send again, and ``+WALK:COUNT*SUM``, how many are stored. WALK is four hexadecimal
digits, drawn when a walk begins; SUM is the low half of the CRC-32 of what stands between the mark and the asterisk.
What a device sends that numbers nothing is passed through as it is.
"""

from __future__ import annotations

import re
import time
from binascii import crc32
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fbgraph.readers.sources import Source

FIRST_LINE = "# fbgraph recorder 1 walk {walk}"
"""The first line of a recorder's file."""
END_LINE = b"# end"
"""Begins the last line of one."""
_WALK = re.compile(rb"# fbgraph recorder \d+ walk ([0-9a-f]{4})")
_GONE = re.compile(rb"# lines (\d+) to (\d+) never came")
_FRAME = re.compile(rb"([0-9a-f]{4}):(\d{1,9}),(.*)", re.DOTALL)
_COUNT = re.compile(rb"([0-9a-f]{4}):(\d{1,9})")
_RANGE = re.compile(rb"([0-9a-f]{4}):(\d{1,9})-(\d{1,9})")
_LONGEST = 1 << 16
_MOST_HELD = 1 << 16  # lines behind a gap; later ones are asked for again
_ASK_S, _PATIENCE_S, _ACKNOWLEDGE_S = 0.3, 1.0, 2.0
_RANGES, _LINES = 24, 400  # asked for at once
_FAREWELL_S = 2.5  # after a walk, in which the device may hear what it missed: a link loses lines
_GIVE_UP_S = 30.0  # of lines that came while those asked for did not
Tell = Callable[[str], None]


def sealed(mark: bytes, body: bytes) -> bytes:
    """A line of the protocol: a mark, what it says, and a sum by which a garbled line is known."""
    return b"%s%s*%04x\n" % (mark, body, crc32(body) & 0xFFFF)


def opened(line: bytes) -> tuple[bytes, bytes] | None:
    """Mark and body of a line; None if it is garbled, or none of the protocol."""
    line = line.strip()
    body, asterisk, checksum = line[1:].rpartition(b"*")
    if not asterisk or line[:1] not in (b"$", b"@", b"-", b"?", b"+", b"!"):
        return None
    return (line[:1], body) if checksum == b"%04x" % (crc32(body) & 0xFFFF) else None


def numbered(walk: str, number: int, line: bytes) -> bytes:
    """The line of a walk's file as it is sent."""
    return sealed(b"$", b"%s:%d,%s" % (walk.encode(), number, line))


def asked(body: bytes) -> tuple[str, list[tuple[int, int]]]:
    """The walk, and ranges of lines, both ends included, that a request asks for."""
    walk, _, ranges = body.partition(b":")
    ends = (part.partition(b"-") for part in ranges.split(b";"))
    return walk.decode("latin-1"), [(int(a), int(b)) for a, _, b in ends if a.isdigit() and b.isdigit()]


@dataclass
class Stored:
    """Which walk's lines are stored, and how many of them: the number of the next."""

    walk: str = ""
    count: int = 0


def stored_lines(raw_path: Path) -> Stored:
    """What ``raw.csv`` holds of the last recorder's walk in it."""
    found = Stored()
    if not raw_path.is_file():
        return found
    with open(raw_path, "rb") as raw:
        for line in raw:
            if match := _WALK.match(line):
                found = Stored(match[1].decode(), 1)
            elif match := _GONE.match(line):
                found.count = int(match[2]) + 1
            elif line.endswith(b"\n"):
                found.count += 1
    return found if found.walk else Stored()


class NumberedLines:
    """Lines of a link in, whole lines in order out; and what to ask for.

    Attributes:
        stored: of the walk that is being sent.
        numbers: whether the device numbers its lines.
        ended: the device said that its walk is over, and all of it is here.
        again: lines that came only when they were asked for.
        garbled: lines left out because their sum was wrong.
    """

    def __init__(self, tell: Tell = lambda text: None, stored: Stored | None = None) -> None:
        """Nothing has come, or, of a walk that is gone on with, what is stored."""
        self._tell = tell
        self.stored = stored or Stored()
        self._rest = b""
        self._held: dict[int, bytes] = {}
        self._known = self.stored.count  # lines that the device has
        self._heard_s = self._asked_s = self._came_s = self._told_s = -1e9
        self._asked: set[int] = set()
        self._waits, self._waited_s = False, 0.0  # for what was asked for, while other lines came
        self.numbers = False
        self.ended = False
        self.again = self.garbled = 0

    def push(self, data: bytes, now_s: float) -> bytes:
        """Take bytes; return those to store: whole lines in order where they are numbered, else the same bytes."""
        if not self.numbers and not self._rest and not any(mark in data for mark in (b"$", b"@")):
            return data
        *lines, self._rest = (self._rest + data).split(b"\n")
        out = [self._line(line, now_s) for line in lines]
        if not self.numbers and (self._rest[:1] not in (b"$", b"@") or len(self._rest) > _LONGEST):
            out.append(self._rest)
            self._rest = b""
        elif len(self._rest) > _LONGEST:
            self._rest = b""
        return b"".join(out)

    def requests(self, now_s: float) -> list[bytes]:
        """Lines to send to the device now."""
        if not self.numbers:
            return []
        lines = []
        comes = bool(self._asked) and now_s - self._came_s < _PATIENCE_S  # asking again would only double it
        if now_s - self._asked_s >= _ASK_S and not comes and (missing := self._missing()):
            self._asked_s = self._came_s = now_s
            self._waits = True
            self._asked = {number for a, b in missing for number in range(a, b + 1)}
            ranges = b";".join(b"%d-%d" % pair for pair in missing)
            lines.append(sealed(b"?", b"%s:%s" % (self.stored.walk.encode(), ranges)))
        if now_s - self._told_s >= (_ASK_S if self.ended else _ACKNOWLEDGE_S):
            self._told_s = now_s
            lines.append(sealed(b"+", b"%s:%d" % (self.stored.walk.encode(), self.stored.count)))
        return lines

    def finish(self) -> bytes:
        """What was held behind a gap that nothing filled, the gap noted; or what was left of a last line."""
        if not self.numbers:
            return self._rest
        return self._leave()

    def _missing(self) -> list[tuple[int, int]]:
        """Ranges of lines that the device has and nobody here, the first ones."""
        ranges: list[tuple[int, int]] = []
        lines, number = 0, self.stored.count
        for held in [*sorted(self._held), self._known]:
            if held > number:
                last = min(held - 1, number + _LINES - lines - 1)
                ranges.append((number, last))
                lines += last - number + 1
            number = held + 1
            if len(ranges) == _RANGES or lines >= _LINES:
                break
        return ranges

    def _line(self, line: bytes, now_s: float) -> bytes:
        found = opened(line) if line[:1] in (b"$", b"@", b"-") else None
        if found is None:
            if line[:1] in (b"$", b"@") and (self.numbers or _FRAME.match(line[1:])):
                self.garbled += 1
                return b""
            return b"" if self.numbers else line + b"\n"  # a device that boots chatters
        mark, body = found
        if self._waits:
            self._waited_s += min(now_s - self._heard_s, 1.0)
        self._heard_s = now_s
        if mark == b"$" and (match := _FRAME.fullmatch(body)):
            return self._of(match[1].decode()) + self._take(int(match[2]), match[3])
        if mark == b"@" and (match := _COUNT.fullmatch(body)):
            out = self._of(match[1].decode())
            self._known = max(self._known, int(match[2]))
            return out + self._give_up()
        match = _RANGE.fullmatch(body) if mark == b"-" else None
        if match and match[1].decode() == self.stored.walk and int(match[2]) <= self.stored.count <= int(match[3]):
            return self._skip(int(match[3]) + 1)
        return b""

    def _of(self, walk: str) -> bytes:
        """Begin with another walk, if it is another; what was held of the one before it."""
        self.numbers = True
        if walk == self.stored.walk:
            return b""
        out = self._leave()
        if self.stored.walk:
            self._tell("the device began a new file; its lines follow those of the one before")
        self.stored, self._known, self.ended = Stored(walk), 0, False
        self._asked, self._waits, self._waited_s = set(), False, 0.0
        return out

    def _leave(self) -> bytes:
        """All that is held, and a note of each gap in it and of what the device has besides."""
        parts = []
        while self._held:
            parts.append(self._skip())
        if self._known > self.stored.count:
            parts.append(self._skip(self._known))
        return b"".join(parts)

    def _take(self, number: int, line: bytes) -> bytes:
        self._known = max(self._known, number + 1)
        if number < self.stored.count or number in self._held:
            return b""
        if len(self._held) < _MOST_HELD or number == self.stored.count:
            self._held[number] = line
        if number in self._asked:
            self._asked.discard(number)
            self._came_s = self._heard_s
            self.again += 1
        return self._in_order() or self._give_up()

    def _in_order(self) -> bytes:
        """The lines that follow what is stored."""
        lines = []
        while (line := self._held.pop(self.stored.count, None)) is not None:
            lines.append(line + b"\n")
            self.stored.count += 1
            self.ended = line.startswith(END_LINE)
        if lines:
            self._waits, self._waited_s = False, 0.0
        return b"".join(lines)

    def _give_up(self) -> bytes:
        """Go on without lines that were asked for and did not come while others did."""
        return self._skip() if self._held and self._waited_s >= _GIVE_UP_S else b""

    def _skip(self, until: int | None = None) -> bytes:
        """Leave a gap, up to a line or the first that is held, noted in a line of its own."""
        first = self.stored.count
        until = min(self._held) if until is None else until
        self._held = {number: line for number, line in self._held.items() if number >= until}
        self._tell(f"lines {first} to {until - 1} never came; they may still be on the device")
        self.stored.count, self._waits, self._waited_s = until, False, 0.0
        return b"# lines %d to %d never came\n" % (first, until - 1) + self._in_order()


def in_order(source: Source, raw_path: Path, tell: Tell) -> Iterator[bytes]:
    """A source's bytes as they are to be stored, until it ends, or the device says that its walk is over.

    Args:
        source: of a device that numbers its lines, or not.
        raw_path: where its lines are stored; read for what is there when the first byte is asked for.
        tell: called with what was lost for good, and at the end with what was not.
    """
    lines = NumberedLines(tell, stored_lines(raw_path))
    ended_s: float | None = None
    for data in source:
        yield lines.push(data, time.monotonic())
        for request in lines.requests(time.monotonic()):
            source.send(request)
        if lines.ended and ended_s is None:
            tell("the device ended the walk")
        ended_s = (ended_s or time.monotonic()) if lines.ended else None
        if ended_s is not None and time.monotonic() - ended_s > _FAREWELL_S:
            break
    yield lines.finish()
    if lines.again or lines.garbled:
        tell(f"{lines.again} lines came when they were asked for again, {lines.garbled} were garbled on the way")
