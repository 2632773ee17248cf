"""A walk's lines on the flash, numbered, and sent over a link that may lose them. Runs on MicroPython and CPython."""

import os
from binascii import crc32

try:
    from typing import BinaryIO, Callable
except ImportError:  # MicroPython has no such module, and does not look at annotations
    pass

SEGMENT = 512  # lines in a file
RECENT = 64  # lines kept in memory besides
RESERVE = 48 * 1024  # bytes of flash that stay free
_FLUSH = 100  # lines
_AGAIN = 6  # lines sent again in a turn
_LONGEST = 512  # bytes of a line from the host


def sealed(mark: str, body: str) -> bytes:
    """A line of the protocol: mark, body, asterisk, low half of the body's CRC-32."""
    return ("%s%s*%04x\n" % (mark, body, crc32(body.encode()) & 0xFFFF)).encode()


def opened(line: bytes) -> tuple[str, str] | None:
    """Mark and body of a line from the host; None if it is garbled."""
    body, asterisk, checksum = line.strip()[1:].rpartition(b"*")
    if not asterisk or checksum != ("%04x" % (crc32(body) & 0xFFFF)).encode():
        return None
    try:
        return line.strip()[:1].decode(), body.decode()
    except UnicodeError:
        return None


class WalkFile:
    """The lines of one walk, in files of ``SEGMENT`` lines in a folder of its own.

    Attributes:
        walk: its name.
        count: lines written.
        acknowledged: lines that the host has stored.
        full: whether the flash took no more, so that lines are only sent.
    """

    def __init__(self, folder: str, walk: str, free_bytes: Callable[[], int]) -> None:
        """Begin a walk.

        Args:
            folder: of walks.
            walk: its name, four hexadecimal digits.
            free_bytes: tells how many bytes of flash are free.
        """
        self.walk, self.count, self.acknowledged, self.full = walk, 0, 0, False
        self._free_bytes = free_bytes
        self._folder = "%s/%s" % (folder, walk)
        for made in (folder, self._folder):
            try:
                os.mkdir(made)
            except OSError:
                pass
        self._file: BinaryIO | None = None
        self._first = 0  # the first line that is still on the flash
        self._kept = 0  # lines on the flash
        self._recent: list[bytes] = []
        self._reading: BinaryIO | None = None
        self._next = -1  # the line that reading would give next

    def append(self, line: str) -> None:
        """Write a line."""
        data = line.encode()
        if not self.full:
            try:
                self._write(data)
            except OSError:
                self.full = True
        self._recent.append(data)
        if len(self._recent) > RECENT:
            self._recent.pop(0)
        self.count += 1

    def _write(self, data: bytes) -> None:
        if self.count % SEGMENT == 0:
            self._make_room()
            if self.full:
                return
            self._close(self._file)
            self._file = open(self._name(self.count), "wb")
        if self._file is not None:
            self._file.write(data)
            self._file.write(b"\n")
            self._kept = self.count + 1
            if self.count % _FLUSH == 0:
                self._file.flush()

    def _make_room(self) -> None:
        """Let the oldest files go that the host has, if the flash is nearly full; or write no more."""
        while self._free_bytes() < RESERVE:
            if self._first + SEGMENT > min(self.acknowledged, self.count):
                self.full = True
                return
            self._close(self._reading)
            self._reading, self._next = None, -1
            os.remove(self._name(self._first))
            self._first += SEGMENT

    def line(self, number: int) -> bytes | None:
        """A line; None if it is no longer there."""
        back = self.count - number
        if 0 < back <= len(self._recent):
            return self._recent[-back]
        if not self._first <= number < self._kept:
            return None
        reading = self._reading
        if reading is None or self._next != number:
            self.flush()
            self._close(reading)
            reading = self._reading = open(self._name(number), "rb")
            for _ in range(number % SEGMENT):
                reading.readline()
        data = reading.readline()
        self._next = number + 1 if (number + 1) % SEGMENT else -1
        return data[:-1]

    def flush(self) -> None:
        """Bring what was written to the flash."""
        if self._file is not None:
            self._file.flush()

    def close(self) -> None:
        """Bring everything to the flash."""
        self._close(self._file)
        self._file = None

    def _name(self, number: int) -> str:
        return "%s/%05d.csv" % (self._folder, number // SEGMENT)

    def _close(self, file: BinaryIO | None) -> None:
        if file is not None:
            file.close()


class Link:
    """Bytes to and from the host; ``serial``, ``udp`` or ``tcp`` behind it."""

    def write(self, data: bytes) -> bool:
        """Send bytes; whether somebody may have got them."""
        raise NotImplementedError

    def read(self) -> bytes:
        """What came, without waiting."""
        raise NotImplementedError


class Sender:
    """Sends a walk's lines as they come, again what is asked for, and takes what the host says.

    Attributes:
        guidance: what the host said last: arrow, metres to it, metres left, text; None before.
        heard_us: when the host was last heard; -1 before.
        up: whether the last line found somebody.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._file: WalkFile | None = None
        self._rest = b""
        self._again: list[list[int]] = []
        self.guidance: tuple[str, int, int, str] | None = None
        self.heard_us = -1
        self.up = False

    def begin(self, file: WalkFile) -> None:
        """Send this walk from now on."""
        self._file, self._again, self.guidance = file, [], None

    def send_last(self) -> None:
        """Send the line that was written last."""
        file = self._file
        if file is not None:
            self._send(file, file.count - 1)

    def beacon(self) -> None:
        """Say how many lines there are."""
        if self._file is not None:
            self.up = self._link.write(sealed("@", "%s:%d" % (self._file.walk, self._file.count)))

    def turn(self, now_us: int) -> None:
        """Take what came, and send some of what is asked for."""
        *lines, self._rest = (self._rest + self._link.read()).split(b"\n")
        self._rest = self._rest[-_LONGEST:]
        for line in lines:
            found = opened(line)
            if found is not None:
                self.heard_us = now_us
                self._take(found[0], found[1])
        sent = 0
        file = self._file
        while file is not None and self._again and sent < _AGAIN:
            pair = self._again[0]
            if pair[0] > pair[1] or pair[0] >= file.count:
                self._again.pop(0)
                continue
            if not self._send(file, pair[0]):
                break
            pair[0] += 1
            sent += 1

    def _send(self, file: WalkFile, number: int) -> bool:
        line = file.line(number)
        if line is None:
            data = sealed("-", "%s:%d-%d" % (file.walk, number, number))
        else:
            data = sealed("$", "%s:%d,%s" % (file.walk, number, line.decode()))
        self.up = self._link.write(data)
        return self.up

    def _take(self, mark: str, body: str) -> None:
        if mark == "!":
            parts = body.split(",", 3)
            try:
                self.guidance = parts[0], int(parts[1]), int(parts[2]), parts[3]
            except (ValueError, IndexError):
                pass
            return
        walk, _, said = body.partition(":")
        if self._file is None or walk != self._file.walk:
            return
        try:
            if mark == "+":
                self._file.acknowledged = max(self._file.acknowledged, int(said))
            elif mark == "?":
                self._again = [[int(end) for end in part.split("-")] for part in said.split(";")]
        except ValueError:
            pass
