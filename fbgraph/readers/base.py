"""What all readers share: the raw shape they fill in, and the cleaning that turns it into a SensorLog."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

import numpy as np

from fbgraph.checkpoints import Checkpoints
from fbgraph.errors import DataError
from fbgraph.geometry import FloatArray, IntArray
from fbgraph.log import Event, SensorLog, Stream

MIN_DURATION_S = 1.0
_STREAMS = {  # name: columns, largest believable magnitude (SI)
    "acc": (3, 320.0),
    "gyro": (3, 70.0),
    "mag": (3, 5000.0),
    "pressure": (1, 1200.0),
}
MIN_PRESSURE_HPA = 300.0


@dataclass(frozen=True)
class RawStream:
    """Samples as the file has them, in SI units, in file order: ``t_ns`` (N,) int64, ``values`` (N, D)."""

    t_ns: IntArray
    values: FloatArray


@dataclass
class RawLog:
    """What a reader found, before cleaning. ``truth`` is on the event clock, in seconds."""

    streams: dict[str, RawStream] = field(default_factory=dict)
    events: list[tuple[int, str]] = field(default_factory=list)
    truth: Checkpoints | None = None
    notices: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class LogFile:
    """A log, and the truth that its file also carried. Only scoring may look at the truth."""

    log: SensorLog
    truth: Checkpoints | None


@contextmanager
def open_text(path: Path) -> Iterator[IO[str]]:
    """Open a log, gzipped or not, as latin-1 text (which every byte decodes to).

    Raises:
        DataError: the path is a directory, cannot be opened, or is a damaged or truncated .gz.
    """
    if path.is_dir():
        raise DataError(f"{path}: is a directory, not a log file")
    try:
        with open(path, "rb") as peek:
            gzipped = peek.read(2) == b"\x1f\x8b"
        opener = gzip.open if gzipped else open
        with opener(path, "rt", encoding="latin-1", newline=None) as stream:
            yield stream
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise DataError(f"{path}: the .gz is truncated or damaged ({error}); copy it again") from error
    except OSError as error:
        raise DataError(f"{path}: {error.strerror or error}") from error


def log_name(path: Path) -> str:
    """The file's name without ``.gz`` and without its last suffix."""
    name = path.name.removesuffix(".gz")
    return Path(name).stem or name


def assemble(raw: RawLog, path: Path, format_name: str) -> LogFile:
    """Clean every stream and put them on one clock that starts at the first inertial sample.

    Rows that are not finite, beyond what the sensor can measure, or not later than the row before are dropped and
    counted, never fatal unless nothing usable is left.

    Raises:
        DataError: no accelerometer or gyroscope, too few samples, a constant accelerometer, time going backwards.
    """
    counts = dict(raw.counts)
    notices = list(raw.notices)
    clean = {name: _clean(name, raw.streams[name], counts, path) for name in _STREAMS if name in raw.streams}
    for name, sensor in (("acc", "accelerometer"), ("gyro", "gyroscope")):
        if name not in clean or len(clean[name][0]) == 0:
            raise DataError(f"{path}: no usable {sensor} samples; a walk cannot be reconstructed without them")
    t0_ns = min(int(clean["acc"][0][0]), int(clean["gyro"][0][0]))
    streams = {name: Stream((t_ns - t0_ns) * 1e-9, values) for name, (t_ns, values) in clean.items()}
    acc = streams["acc"]
    if len(acc) < 10 or acc.t_s[-1] - acc.t_s[0] < MIN_DURATION_S:
        raise DataError(
            f"{path}: only {len(acc)} accelerometer samples over {acc.t_s[-1] - acc.t_s[0]:.2f} s; "
            "too short to hold a walk"
        )
    if np.ptp(acc.values, axis=0).max() == 0.0:
        raise DataError(f"{path}: the accelerometer never changes; the sensor was stuck or not recording")
    for name, sensor, cost in (
        ("mag", "magnetometer", "heading rests on the gyroscope alone and its start is arbitrary"),
        ("pressure", "barometer", "altitude stays at 0"),
    ):
        if name not in streams or len(streams[name]) == 0:
            notices.append(f"no {sensor}: {cost}")
            streams.pop(name, None)
    log = SensorLog(
        name=log_name(path),
        format=format_name,
        t0_s=t0_ns * 1e-9,
        events=tuple(Event((t_ns - t0_ns) * 1e-9, label) for t_ns, label in sorted(raw.events)),
        notices=tuple(notices),
        counts=counts,
        **streams,
    )
    return LogFile(log, raw.truth)


def _clean(name: str, raw: RawStream, counts: dict[str, int], path: Path) -> tuple[IntArray, FloatArray]:
    """Drop what no sensor can have said; returns increasing times and finite values."""
    width, largest = _STREAMS[name]
    t_ns, values = raw.t_ns, raw.values.reshape(len(raw.t_ns), width)

    def count(reason: str, number: int) -> None:
        if number:
            counts[f"{name}_{reason}"] = counts.get(f"{name}_{reason}", 0) + number

    finite = np.isfinite(values).all(axis=1)
    count("not_finite", int((~finite).sum()))
    with np.errstate(invalid="ignore"):
        believable = (np.abs(values) <= largest).all(axis=1)
        if name == "pressure":
            believable &= (values >= MIN_PRESSURE_HPA).all(axis=1)
    count("out_of_range", int((finite & ~believable).sum()))
    keep = finite & believable
    t_ns, values = t_ns[keep], values[keep]
    if len(t_ns) == 0:
        return t_ns, values
    later = np.concatenate(([True], t_ns[1:] > np.maximum.accumulate(t_ns)[:-1]))
    if name == "acc" and len(t_ns) > 2 and later.mean() < 0.5:
        back = int(np.flatnonzero(~later)[0])
        raise DataError(
            f"{path}: time goes backwards or stands still in most rows (first at accelerometer sample {back + 1}); "
            "check the time column"
        )
    count("not_later", int((~later).sum()))
    return t_ns[later], values[later]
