"""The raw lines of a live walk, read back."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from fbgraph.core.errors import DataError
from fbgraph.core.log import SensorLog
from fbgraph.readers.base import OPTIONAL_SENSORS
from fbgraph.readers.live_lines import LiveReader

_TAIL_BYTES, _BLOCK_BYTES = 1 << 16, 1 << 21


def saved_log(raw_path: Path) -> SensorLog:
    """The samples of saved raw lines, exactly as the online smoother was given them.

    Raises:
        DataError: no usable samples.
    """
    reader = LiveReader(raw_path.parent.name)
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
        format="m5stickc",
        t0_s=reader.t0_s,
        notices=(*reader.notices, *missing),
        counts=counts,
    )


def cut_torn_line(raw_path: Path) -> None:
    """Take off what a crash left of a last line, before others are added."""
    with open(raw_path, "rb+") as raw:
        size = raw.seek(0, os.SEEK_END)
        tail = b""
        while size and b"\n" not in tail:
            size = max(size - _TAIL_BYTES, 0)
            raw.seek(size)
            tail = raw.read(_TAIL_BYTES)
        raw.truncate(size + tail.rfind(b"\n") + 1)


def saved_lines(raw_path: Path) -> Iterator[list[str]]:
    """Blocks of complete lines; one torn by a crash is left out."""
    with open(raw_path, "rb") as raw:
        while lines := raw.readlines(_BLOCK_BYTES):
            yield [line[:-1].decode("latin-1") for line in lines if line.endswith(b"\n")]
