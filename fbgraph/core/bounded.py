"""Opens what a user names and reads it once, never more of it than was agreed: files, pipes and .gz of any content."""

from __future__ import annotations

import gzip
import re
import stat
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from io import UnsupportedOperation
from lzma import LZMAError
from pathlib import Path
from typing import Protocol

from fbgraph.core.errors import ConfigError, DataError

MIB = 1 << 20
MOST_BYTES = 1 << 30
"""Of a log or a data set, unpacked: a phone's log of an hour at 1 kHz is two thirds of it."""
FREE_BYTES = 64 * MIB
MOST_GROWTH = 100
"""What unpacks to more than ``FREE_BYTES`` may grow so many times; noise never packs that well."""
PLACES_BYTES = 64 * MIB
"""Of truth, anchors and routes."""
MOST_PLACES = 2_000_000
"""Lines of them: 48 h at 10 Hz are fewer."""
RUN_BYTES = 256 * MIB
"""Of a file of a run: a week's breadcrumbs take half of it."""
CONFIG_BYTES = 1 << 16
"""Of a configuration or mapping file; every key of it takes a tenth."""
LONGEST_LINE = 1 << 16
"""Bytes, without its end. What runs on for longer is no row of a table."""
MOST_COLUMNS = 4096
BLOCK_BYTES = MIB
_SIZES = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


class Readable(Protocol):
    """Anything with bytes to read."""

    def read(self, size: int, /) -> bytes:
        """At most so many bytes; none at the end."""
        ...


@dataclass(frozen=True)
class Allowance:
    """How much of an input may be read.

    Attributes:
        most_bytes: after unpacking.
        growth: how many times its size a .gz may unpack to beyond ``FREE_BYTES``; None for any.
        remedy: what the user can do about it, for messages.
    """

    most_bytes: int
    growth: int | None = MOST_GROWTH
    remedy: str = ""

    @staticmethod
    def of(max_size: int | None) -> Allowance:
        """For a log or data set: what ``--max-size`` says, which is meant, or else what any walk keeps within."""
        if max_size is None:
            return Allowance(MOST_BYTES, MOST_GROWTH, "if it is a walk, --max-size SIZE allows more")
        return Allowance(max_size, None, "--max-size SIZE allows more")

    def less(self, taken: int) -> Allowance:
        """What is left of it."""
        return replace(self, most_bytes=max(self.most_bytes - taken, 0))

    def refuse(self, name: object, size: int, packed: int | None) -> None:
        """Refuse what has become too large.

        Args:
            name: of the input, for the message.
            size: how much of it there is, as far as known.
            packed: how many packed bytes that was so far; None if it is not packed.

        Raises:
            DataError: it is larger than allowed, or has grown by more.
        """
        remedy = f"; {self.remedy}" if self.remedy else ""
        if size > self.most_bytes:
            raise DataError(f"{name}: {_shown(size)} or more, the limit is {_shown(self.most_bytes)}{remedy}")
        if packed is not None and self.growth is not None and size > max(FREE_BYTES, self.growth * packed):
            raise DataError(
                f"{name}: {_shown(packed)} unpack to {_shown(size)} or more, the limit is {_shown(FREE_BYTES)} or "
                f"{self.growth} times as much as packed{remedy}"
            )


def parse_size(text: str, option: str = "--max-size") -> int:
    """Bytes of a size such as ``500M`` or ``2G``, which this option takes.

    Raises:
        ConfigError: it is none.
    """
    match = re.fullmatch(r"(\d{1,15}(?:\.\d{1,9})?)\s*([KMGT]?)(?:I?B)?", text.strip().upper(), re.ASCII)
    size = round(float(match[1]) * _SIZES[match[2]]) if match else 0
    if size < 1:
        raise ConfigError(f"{option} {text}: expected a size such as 500M or 2G")
    return size


def _shown(size: int) -> str:
    """A size with its unit."""
    unit, factor = next((unit, factor) for unit, factor in reversed(_SIZES.items()) if size >= factor or factor == 1)
    return f"{size / factor:.4g} {unit}{'iB' if unit else 'bytes'}"


def file_blocks(path: Path, allowed: Allowance, kind: str = "file") -> Iterator[bytes]:
    """The bytes of a file or pipe, unpacked if it is a .gz.

    Args:
        path: opened once and read from its beginning to its end.
        allowed: how much of it.
        kind: what it should be, for messages.

    Raises:
        DataError: no such file, a directory or device, unreadable, damaged, or more than allowed.
    """
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise DataError(f"{path}: is a directory, not a {kind}; name one file in it")
        if not (stat.S_ISREG(mode) or stat.S_ISFIFO(mode)):
            raise DataError(f"{path}: is a device or socket, not a {kind}")
        with open(path, "rb") as stream:
            yield from unpacked(stream, path, allowed, path.stat().st_size)
    except (OSError, ValueError) as error:  # a name with a NUL in it is a ValueError
        raise DataError(f"{path}: {getattr(error, 'strerror', None) or error}; check the path") from error


def unpacked(stream: Readable, name: object, allowed: Allowance, expected: int = 0) -> Iterator[bytes]:
    """The bytes of a stream, unpacked if they are those of a .gz.

    Args:
        stream: read once.
        name: for messages.
        allowed: how much of it.
        expected: how many bytes it is known to hold; too many are refused before they are read.

    Raises:
        DataError: a damaged or truncated .gz or entry of a zip, or more than allowed.
    """
    source, packed, size = _Counted(stream), False, 0
    try:
        packed = source.begins(b"\x1f\x8b")
        reader: Readable = gzip.GzipFile(mode="rb", fileobj=source) if packed else source
        if not packed:
            allowed.refuse(name, expected, None)
        while block := reader.read(BLOCK_BYTES):
            size += len(block)
            allowed.refuse(name, size, source.taken if packed else None)
            yield block
    except (EOFError, zlib.error, LZMAError, gzip.BadGzipFile) as error:
        what = "the .gz is " if packed else ""  # else an entry of a zip
        raise DataError(f"{name}: {what}truncated or damaged ({error}); copy it again") from error


class _Counted:
    """A stream whose beginning was looked at, and which counts what was taken from it."""

    def __init__(self, stream: Readable) -> None:
        self._stream = stream
        self._head = b""
        self.taken = 0

    def begins(self, magic: bytes) -> bool:
        """Whether its first bytes are these."""
        while len(self._head) < len(magic) and (more := self._stream.read(len(magic) - len(self._head))):
            self._head += more
        return self._head == magic

    def read(self, size: int = BLOCK_BYTES) -> bytes:
        """The next bytes."""
        data = self._head + self._stream.read(max(size - len(self._head), 0))
        self._head = b""
        self.taken += len(data)
        return data

    def seek(self, offset: int, /) -> int:
        """What gzip asks for and never calls while it only reads on.

        Raises:
            UnsupportedOperation: always; a pipe is read once.
        """
        raise UnsupportedOperation(f"seek to {offset}")


def small_file(path: Path, most_bytes: int, kind: str) -> bytes:
    """All of a file or pipe that has no reason to be large.

    Raises:
        DataError: as ``file_blocks``.
    """
    return b"".join(file_blocks(path, Allowance(most_bytes), kind))


def table_of_places(path: Path, kind: str) -> bytes:
    """The bytes of a table of truth, anchors or a route.

    Args:
        path: of the file or pipe.
        kind: what it should be, for messages.

    Raises:
        DataError: it cannot be read, or is larger, longer or wider than any such table.
    """
    data = small_file(path, PLACES_BYTES, kind)
    require_table(data, path, kind)
    return data


def require_table(data: bytes, path: Path, kind: str) -> None:
    """Refuse what is longer or wider than any table of places; arguments as ``table_of_places``.

    Raises:
        DataError: it is.
    """
    if (rows := data.count(b"\n")) > MOST_PLACES:
        raise DataError(f"{path}: {rows} lines, the limit of a {kind} is {MOST_PLACES}")
    for line in data.split(b"\n"):
        if len(line) > LONGEST_LINE or (len(line) >= MOST_COLUMNS and line.count(b",") >= MOST_COLUMNS):
            raise DataError(
                f"{path}: a line of {len(line)} bytes and {line.count(b',') + 1} columns; "
                f"the limits of a {kind} are {LONGEST_LINE} and {MOST_COLUMNS}"
            )


class WholeLines:
    """Blocks of bytes in, pieces of whole lines out; their ends become LF, and lines too long to be rows are left out.

    Attributes:
        too_long: how many were left out because they ran on for more than 64 KiB.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._return_held = False
        self._skipping = False
        self.too_long = 0

    def pieces(self, blocks: Iterable[bytes]) -> Iterator[bytes]:
        """All of them; the last line may lack its end."""
        for block in blocks:
            if piece := self._push(block):
                yield piece
        if self._return_held:
            self._return_held = False
            if piece := self._push(b"\n"):
                yield piece
        if self._rest:
            yield self._rest
            self._rest = b""

    def _push(self, block: bytes) -> bytes:
        if self._return_held:
            block = b"\r" + block
        self._return_held = block.endswith(b"\r")  # the LF of a CR LF may come with the next block
        if b"\r" in block:
            block = block[: len(block) - self._return_held].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        if self._skipping:
            end = block.find(b"\n") + 1
            if end == 0:
                return b""
            block, self._skipping = block[end:], False
        end = block.rfind(b"\n") + 1
        if end:
            whole, self._rest = b"".join((self._rest, memoryview(block)[:end])), block[end:]
        else:
            whole, self._rest = b"", self._rest + block
        if len(self._rest) > LONGEST_LINE:
            self._rest, self._skipping = b"", True
            self.too_long += 1
        return self._without_long(whole)

    def _without_long(self, whole: bytes) -> bytes:
        """Nothing is looked at twice where every 32 KiB hold the end of a line, as they do in a log."""
        half = LONGEST_LINE // 2
        if all(whole.find(b"\n", at, at + half) >= 0 for at in range(0, len(whole), half)):
            return whole
        lines = whole.split(b"\n")
        kept = [line for line in lines if len(line) <= LONGEST_LINE]
        self.too_long += len(lines) - len(kept)
        return b"\n".join(kept)
