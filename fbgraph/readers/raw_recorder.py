"""The raw lines of a live walk: kept on disk before anything is made of them, and read back."""

from __future__ import annotations

import os
import time
from codecs import BOM_UTF8
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.readers.cleaning import OPTIONAL_SENSORS
from fbgraph.readers.layout import Layout
from fbgraph.readers.live_lines import LiveReader

_TAIL_BYTES, _BLOCK_BYTES = 1 << 16, 1 << 21
_LONGEST_LINE = 1 << 16  # bytes; what runs on for longer is no line of a log
_SYNC_S = 0.5


class LineCutter:
    """Bytes in any pieces in, complete lines out; lines end with LF, CR LF or CR.

    Attributes:
        too_long: lines that were left out because they ran on for more than 64 KiB.
    """

    def __init__(self) -> None:
        self._rest = bytearray()
        self._skipping = False
        self.too_long = 0

    def push(self, data: bytes) -> list[str]:
        """Take the next bytes; return the lines that they complete, without their ends."""
        if not data:
            return []
        self._rest += data
        held = b""
        if self._rest.endswith(b"\r"):  # the LF of a CR LF may come with the next piece
            held = b"\r"
            del self._rest[-1:]
        *lines, rest = bytes(self._rest).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
        self._rest = bytearray(rest + held)
        if lines and self._skipping:
            lines, self._skipping = lines[1:], False
        if len(rest) > _LONGEST_LINE:
            self.too_long += not self._skipping
            self._rest, self._skipping = bytearray(held), True
        kept = [line for line in lines if len(line) <= _LONGEST_LINE]
        self.too_long += len(lines) - len(kept)
        return [_text(line) for line in kept]

    def finish(self) -> list[str]:
        """The last line, if it is complete but for the LF that might have followed its CR."""
        return self.push(b"\n") if self._rest.endswith(b"\r") else []


def _text(line: bytes) -> str:
    """A line as a file's reader takes it: UTF-8, or latin-1 where it is none; without a mark and zeros."""
    line = line.translate(None, b"\0").removeprefix(BOM_UTF8)
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("latin-1")


class RawRecorder:
    """Appends what a device sends to a file as it comes, and brings it to the disk at least once a second."""

    def __init__(self, path: Path) -> None:
        """Open the file, or begin it.

        Raises:
            OSError: it cannot be written.
        """
        self._file = open(path, "ab", buffering=0)  # noqa: SIM115  closed by ``close``
        self._synced_s = time.monotonic()
        self._dirty = False

    def __enter__(self) -> RawRecorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def write(self, data: bytes) -> None:
        """Store bytes; without any, only see to it that what was stored before is on the disk in time.

        Raises:
            OSError: the disk is full, or gone.
        """
        view = memoryview(data)
        while len(view):
            view = view[self._file.write(view) :]
            self._dirty = True
        if self._dirty and time.monotonic() - self._synced_s >= _SYNC_S:
            self._sync()

    def close(self) -> None:
        """Bring everything to the disk."""
        if not self._file.closed:
            self._sync()
            self._file.close()

    def _sync(self) -> None:
        os.fsync(self._file.fileno())
        self._synced_s, self._dirty = time.monotonic(), False


def saved_log(raw_path: Path, layout: Layout | None = None) -> SensorLog:
    """The samples of saved raw lines, exactly as the online smoother was given them.

    Args:
        raw_path: of the lines.
        layout: that the online smoother was told; decided from the lines, as it did, if None.

    Raises:
        DataError: no usable samples.
    """
    reader = LiveReader(raw_path.parent.name, layout)
    parts = [reader.push(block) for block in saved_lines(raw_path)]
    parts.append(reader.finish())
    log = SensorLog.concatenate(parts)
    if min(len(log.acc), len(log.gyro)) < 2:
        raise DataError(f"{raw_path}: no usable accelerometer and gyroscope samples arrived")
    counts = {reason: number for reason, number in reader.counts.items() if number}
    missing = [
        f"no {sensor}: {cost}" for name, (sensor, cost) in OPTIONAL_SENSORS.items() if len(getattr(log, name)) == 0
    ]
    return replace(
        log,
        name=raw_path.parent.name,
        format=reader.format,
        reading={} if reader.reading is None else reader.reading.noted(),
        t0_s=reader.t0_s,
        notices=(*reader.notices, *missing),
        counts=counts,
    )


def cut_torn_line(raw_path: Path) -> None:
    """Take off what a crash left of a last line, before others are added.

    Raises:
        ConfigError: nothing can be written there.
    """
    try:
        with open(raw_path, "rb+") as raw:
            size = whole = raw.seek(0, os.SEEK_END)
            tail = b""
            while whole and not {*tail} & {*b"\r\n"}:
                whole = max(whole - _TAIL_BYTES, 0)
                raw.seek(whole)
                tail = raw.read(_TAIL_BYTES)
            whole += max(tail.rfind(b"\n"), tail.rfind(b"\r")) + 1
            if whole < size:
                raw.truncate(whole)
    except OSError as error:
        raise ConfigError(f"{raw_path}: cannot write there: {error.strerror or error}") from error


def saved_lines(raw_path: Path) -> Iterator[list[str]]:
    """Blocks of complete lines; one torn by a crash is left out."""
    cutter = LineCutter()
    with open(raw_path, "rb") as raw:
        while data := raw.read(_BLOCK_BYTES):
            yield cutter.push(data)
    yield cutter.finish()
