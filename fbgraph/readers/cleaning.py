"""What all readers share: the raw shape they fill in, and the cleaning that turns it into a SensorLog."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.core.sampling import runs_of
from fbgraph.core.sensor_log import Event, SensorLog, Stream

if TYPE_CHECKING:
    from fbgraph.readers.reading import Reading

MIN_DURATION_S = 1.0
MIN_SAMPLES = 10
RESOLVED_HZ = 20.0  # slower than this, steps at 2 Hz are no longer well resolved
LONG_GAP_S = 1.0
STRAY_GAP_S, STRAY_SAMPLES = 2.0, 5  # fewer samples than this, further than this from all others: garbled times
_FAR_NS = 1_000_000_000
SPLIT_GAP_S = 172_800.0  # nobody's walk has such a hole: the clock was set, or two logs were joined
GRAVITY_M_S2 = (3.0, 30.0)  # where the median |acc| of a walk must lie, whatever the calibration

_SENSORS = {"acc": "accelerometer", "gyro": "gyroscope", "mag": "magnetometer", "pressure": "barometer"}
OPTIONAL_SENSORS = {
    "mag": ("magnetometer", "heading rests on the gyroscope alone and its start is arbitrary"),
    "pressure": ("barometer", "altitude stays at 0"),
}
"""What a walk can do without, and what it then lacks."""
LIMITS = {"acc": 160.0, "gyro": 37.0, "mag": 5000.0, "pressure": 1200.0}
"""Largest believable component, SI. ±16 g and ±2000 °/s are the widest ranges of phones and wearables."""
MIN_PRESSURE_HPA = 300.0
_SMALLEST_RAIL = {"acc": 18.5, "gyro": 4.2}  # just below ±2 g and ±250 °/s, the narrowest ranges


@dataclass(frozen=True)
class RawStream:
    """Samples as the file has them, in SI units, in file order: ``t_ns`` (N,) int64, ``values`` (N, D)."""

    t_ns: IntArray
    values: FloatArray


@dataclass
class RawLog:
    """What a reader found, before cleaning.

    ``truth`` is on the event clock, in seconds; ``gnss`` are the log's own fixes, as ``readers.places`` gives them.
    """

    streams: dict[str, RawStream] = field(default_factory=dict)
    events: list[tuple[int, str]] = field(default_factory=list)
    truth: Checkpoints | None = None
    gnss: Checkpoints | None = None
    notices: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class LogFile:
    """A log, and what else its file carried.

    Attributes:
        log: the walk.
        truth: surveyed places; only scoring may look at them.
        gnss: what a receiver found meanwhile, as ``readers.places`` gives it; anchors if the user wants, else truth.
        reading: how its tables were read; None where its format tells.
    """

    log: SensorLog
    truth: Checkpoints | None
    gnss: Checkpoints | None = None
    reading: Reading | None = None


def log_name(path: Path) -> str:
    """The file's name without ``.gz`` and without its last suffix; ``walk`` if that names no file of its own."""
    name = path.name.removesuffix(".gz")
    stem = Path(name).stem or name
    return stem if stem.strip(".") else "walk"


def assemble(raw: RawLog, path: Path, format_name: str, reading: Reading | None = None) -> LogFile:
    """Clean every stream and put them on one clock that starts at the first inertial sample.

    Rows that are not finite, beyond what the sensor can measure, out of order or far away in time from all others are
    dropped and counted, never fatal unless nothing usable is left. Samples at a sensor's full scale are only counted.

    Raises:
        DataError: no accelerometer or gyroscope, too few samples, a constant accelerometer or one without gravity,
            time going backwards, sensors that were not on at the same time.
    """
    counts = dict(raw.counts)
    notices = list(raw.notices)
    clean = {name: _clean(name, raw.streams[name], counts, path) for name in _SENSORS if name in raw.streams}
    for name in ("acc", "gyro"):
        if name not in clean or len(clean[name].t_ns) == 0:
            why = ", ".join(f"{number} {reason}" for reason, number in counts.items()) or "none in the file"
            raise DataError(
                f"{path}: no usable {_SENSORS[name]} samples ({why}); a walk cannot be reconstructed without them: "
                "check its columns and their unit"
            )
    clean = _same_time(clean, counts, notices)
    for name in ("acc", "gyro"):
        t_ns = clean[name].t_ns
        seconds = (int(t_ns[-1]) - int(t_ns[0])) * 1e-9 if len(t_ns) else 0.0
        if len(t_ns) < MIN_SAMPLES or seconds < MIN_DURATION_S:
            raise DataError(
                f"{path}: only {len(t_ns)} {_SENSORS[name]} samples over {seconds:.2f} s while the accelerometer ran; "
                "too short to hold a walk: record a longer one"
            )
    t0_ns = min(int(clean["acc"].t_ns[0]), int(clean["gyro"].t_ns[0]))
    end_ns = max(int(clean["acc"].t_ns[-1]), int(clean["gyro"].t_ns[-1]))
    times = {id(stream.t_ns): stream.t_ns for stream in clean.values()}  # sensors of one table share theirs
    t_s = {same: (t_ns - t0_ns) / 1e9 for same, t_ns in times.items()}
    streams = {name: Stream(t_s[id(raw.t_ns)], np.ascontiguousarray(raw.values)) for name, raw in clean.items()}
    _check(streams, counts, notices, path)
    events = sorted((t_ns, label) for t_ns, label in raw.events if t0_ns <= t_ns <= end_ns)
    log = SensorLog(
        name=log_name(path),
        format=format_name,
        t0_s=t0_ns / 1e9,
        events=tuple(Event((t_ns - t0_ns) / 1e9, label) for t_ns, label in events),
        notices=tuple(notices),
        counts=counts,
        reading={} if reading is None else reading.noted(),
        **streams,
    )
    return LogFile(log, raw.truth, raw.gnss, reading)


def kept(rows: BoolArray, t_ns: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """These rows of both; both themselves if it is all, for copies of long logs take their time."""
    return (t_ns, values) if rows.all() else (t_ns[rows], values[rows])


def _count(counts: dict[str, int], reason: str, number: int) -> None:
    """Add to a count; reasons that never occur are not listed."""
    if number:
        counts[reason] = counts.get(reason, 0) + int(number)


def _clean(name: str, raw: RawStream, counts: dict[str, int], path: Path) -> RawStream:
    """Drop what no sensor can have said and what is out of order: increasing times, finite values."""
    t_ns, values = raw.t_ns, raw.values.reshape(len(raw.t_ns), -1)
    if _is_clean(name, t_ns, values):
        return RawStream(t_ns, values)
    largest = np.abs(values).max(axis=1)  # nan if any is nan
    finite = np.isfinite(largest)
    believable = largest <= LIMITS[name]
    if name == "pressure":
        believable &= values[:, 0] >= MIN_PRESSURE_HPA
    datable = (t_ns >= -MAX_T_NS) & (t_ns <= MAX_T_NS)
    _count(counts, f"{name}_not_finite", (~finite).sum())
    _count(counts, f"{name}_out_of_range", (finite & ~believable).sum())
    _count(counts, f"{name}_impossible_time", (finite & believable & ~datable).sum())
    keep = finite & believable & datable
    t_ns, values = kept(keep, t_ns, values)

    same_t = np.flatnonzero(np.diff(t_ns) == 0)
    again = same_t[(values[same_t] == values[same_t + 1]).all(axis=1)]
    _count(counts, f"{name}_duplicate", len(again))
    if len(again):
        t_ns, values = np.delete(t_ns, again), np.delete(values, again, axis=0)
    if len(t_ns) == 0:
        return RawStream(t_ns, values)

    spread_ns = _spread(t_ns)
    _count(counts, f"{name}_time_shared", (spread_ns != t_ns).sum())
    later = _increasing(spread_ns)
    if name in ("acc", "gyro") and later.mean() < 0.5:
        back = int(np.flatnonzero(np.diff(spread_ns) <= 0)[0])
        raise DataError(
            f"{path}: time goes backwards or stands still in most rows (first at {_SENSORS[name]} sample {back + 2}); "
            "check the time column"
        )
    _count(counts, f"{name}_not_later", (~later).sum())
    return RawStream(*kept(later, spread_ns, values))


def _is_clean(name: str, t_ns: IntArray, values: FloatArray) -> bool:
    """Whether nothing is to be dropped: told by extremes, which are nan if any value is."""
    lowest = MIN_PRESSURE_HPA if name == "pressure" else -LIMITS[name]
    if len(t_ns) < 2 or not (lowest <= values.min() and values.max() <= LIMITS[name]):
        return False
    return bool(t_ns[0] >= -MAX_T_NS and t_ns[-1] <= MAX_T_NS and (t_ns[1:] > t_ns[:-1]).all())


def _spread(t_ns: IntArray) -> IntArray:
    """Spread samples that share a time evenly over the step before it.

    Stamps given on arrival (TCP, BLE) or in whole seconds repeat, with different samples behind them; keeping one of
    each would lose a fifth of such logs. Nothing is moved where that would mean more than 1 kHz.
    """
    if (np.diff(t_ns) != 0).all():
        return t_ns
    first = np.flatnonzero(np.concatenate(([True], np.diff(t_ns) != 0)))
    sizes = np.diff(np.append(first, len(t_ns)))
    gaps = np.diff(t_ns[first], prepend=t_ns[0])  # no gap before the first: it stays as it is
    ahead = gaps[gaps > 0]
    if len(ahead) == 0:
        return t_ns
    spacing = np.minimum(gaps // sizes, int(np.median(ahead)))
    spacing[spacing < 1_000_000] = 0
    to_last = np.repeat(first + sizes - 1, sizes) - np.arange(len(t_ns))
    spread: IntArray = t_ns - to_last * np.repeat(spacing, sizes)
    return spread


def _increasing(t_ns: IntArray) -> BoolArray:
    """Which samples to keep so that time increases and as few as possible are dropped.

    Comparing with the latest time so far would let one time garbled into the future drop everything after it. So: a
    longest increasing subsequence, searched only among the samples that are out of order with any other.
    """
    keep = np.ones(len(t_ns), dtype=bool)
    last, this, following = t_ns[:-2], t_ns[1:-1], t_ns[2:]
    astray = (this < last - _FAR_NS) | (this > following + _FAR_NS)
    keep[1:-1] = ~(astray & (last < following))  # single garbled times, the usual case, would put all else in dispute
    rest = np.flatnonzero(keep)
    t = t_ns[rest]
    agreed = np.ones(len(t), dtype=bool)
    agreed[1:] &= t[1:] > np.maximum.accumulate(t)[:-1]
    agreed[:-1] &= t[:-1] < np.minimum.accumulate(t[::-1])[::-1][1:]
    disputed = rest[~agreed]
    keep[disputed] = False
    lowest_end: list[int] = []  # by length: the smallest time a subsequence of that length can end in, and where
    end_at: list[int] = []
    before: list[int] = []
    for i, end in enumerate(t_ns[disputed].tolist()):
        length = bisect_left(lowest_end, end)
        before.append(end_at[length - 1] if length else -1)
        lowest_end[length : length + 1] = [end]
        end_at[length : length + 1] = [i]
    i = end_at[-1] if end_at else -1
    while i >= 0:
        keep[disputed[i]] = True
        i = before[i]
    return keep


def _same_time(clean: dict[str, RawStream], counts: dict[str, int], notices: list[str]) -> dict[str, RawStream]:
    """Cut every stream to the time in which the accelerometer really ran.

    A time garbled into the past or future at an end of the log, or a clock that was set during it (1970, then today),
    is in order but far from everything else. Of such islands the one with most samples is the log.
    """
    t_ns = clean["acc"].t_ns
    islands = np.split(t_ns, np.flatnonzero(np.diff(t_ns) > STRAY_GAP_S * 1e9) + 1)
    groups: list[list[IntArray]] = []
    for island in [i for i in islands if len(i) >= STRAY_SAMPLES] or islands:
        if groups and island[0] - groups[-1][-1][-1] <= SPLIT_GAP_S * 1e9:
            groups[-1].append(island)
        else:
            groups.append([island])
    log = max(groups, key=lambda group: sum(map(len, group)))
    if len(groups) > 1:
        notices.append(f"time jumps by more than {SPLIT_GAP_S / 3600:.0f} h; kept the longest of {len(groups)} pieces")
    cut = {}
    for name, stream in clean.items():
        margin_ns = 0 if name == "acc" else int(STRAY_GAP_S * 1e9)
        first_ns, last_ns = log[0][0] - margin_ns, log[-1][-1] + margin_ns
        if len(stream.t_ns) and first_ns <= stream.t_ns[0] and stream.t_ns[-1] <= last_ns:
            cut[name] = stream
            continue
        within = (stream.t_ns >= first_ns) & (stream.t_ns <= last_ns)
        _count(counts, f"{name}_stray_time", (~within).sum())
        cut[name] = RawStream(*kept(within, stream.t_ns, stream.values))
    return cut


def _check(streams: dict[str, Stream], counts: dict[str, int], notices: list[str], path: Path) -> None:
    """Refuse signals that cannot be a walk, remove sensors that say nothing, and tell the user the rest."""
    acc, gyro = streams["acc"], streams["gyro"]
    if _never_changes(acc.values):
        raise DataError(f"{path}: the accelerometer never changes; the sensor was stuck or not recording")
    gravity = float(np.median(np.linalg.norm(runs_of(acc.values), axis=1)))
    if not GRAVITY_M_S2[0] <= gravity <= GRAVITY_M_S2[1]:
        raise DataError(
            f"{path}: the accelerometer's median magnitude is {gravity:.2f} m/s² where gravity alone is 9.8; "
            "its unit is wrong, or the log has gravity removed (record the raw accelerometer)"
        )
    if _never_changes(gyro.values):
        notices.append("the gyroscope never changes: it was stuck or switched off, turns are not seen")
    if counts.get("acc_time_shared", 0) > 0.01 * len(acc):
        notices.append(
            f"{counts['acc_time_shared']} samples came with the time of another; spread over the step before"
        )
    same_times = acc.t_s is gyro.t_s or np.array_equal(acc.t_s, gyro.t_s)
    for name in ("acc",) if same_times else ("acc", "gyro"):
        stream, sensor = streams[name], _SENSORS[name]
        gaps_s = np.diff(stream.t_s)
        slow = 2 * np.count_nonzero(gaps_s > 1.0 / RESOLVED_HZ) >= len(gaps_s)
        if slow and stream.rate_hz < RESOLVED_HZ:
            notices.append(f"the {sensor} runs at {stream.rate_hz:.1f} Hz; steps need {RESOLVED_HZ:.0f} Hz or more")
        if gaps_s.max() > LONG_GAP_S:
            longest = int(gaps_s.argmax())
            notices.append(
                f"{(gaps_s > LONG_GAP_S).sum()} gaps of more than {LONG_GAP_S:.0f} s in the {sensor}, "
                f"the longest {gaps_s[longest]:.1f} s at {stream.t_s[longest]:.1f} s"
            )
    for name, scale, unit in (("acc", 1.0, "m/s²"), ("gyro", 180.0 / np.pi, "°/s")):
        stream, sensor = streams[name], _SENSORS[name]
        rail, at_rail = saturated(name, stream.values)
        _count(counts, f"{name}_saturated", at_rail)
        if at_rail:
            notices.append(
                f"{at_rail} samples at the {sensor}'s limit of {rail * scale:.4g} {unit}: too little is seen"
            )
    for name, (sensor, cost) in OPTIONAL_SENSORS.items():
        if name not in streams:
            notices.append(f"no {sensor}: {cost}")
        elif len(streams[name]) < MIN_SAMPLES or _never_changes(streams[name].values):
            notices.append(f"{sensor} not used, it has {len(streams[name])} samples or never changes: {cost}")
            del streams[name]


def saturated(name: str, values: FloatArray) -> tuple[float, int]:
    """The full scale a sensor ran into, and how many samples are there; (0, 0) if it never did.

    A rail shows as the exact extreme of an axis, at or above the narrowest full scale, that occurs three times or more
    and more often than anything in the 2 % below it.
    """
    rail, at_rail = 0.0, np.zeros(len(values), dtype=bool)
    if max(values.max(), -values.min()) < _SMALLEST_RAIL[name]:
        return 0.0, 0
    for axis, sign in ((axis, sign) for sign in (1.0, -1.0) for axis in values.T):
        extreme = sign * float(axis.max() if sign > 0.0 else axis.min())
        if extreme < _SMALLEST_RAIL[name]:
            continue
        axis = sign * axis
        there = axis == extreme
        if there.sum() >= max(3, (axis >= 0.98 * extreme).sum() / 2):
            rail = max(rail, extreme)
            at_rail |= there
    return rail, int(at_rail.sum())


def _never_changes(values: FloatArray) -> bool:
    """Whether all samples (N, D) are the same; a few tell that they are not."""
    return bool((values[:9] == values[0]).all() and (values == values[0]).all())


def are_repeated(values: FloatArray) -> bool:
    """Whether most samples (N, D) repeat the one before: their sensor was asked more often than it measures."""
    return len(values) > 1 and bool((values[1:] == values[:-1]).all(axis=1).sum() >= 0.5 * len(values))


def drop_repeats(stream: RawStream, repeated: bool | None = None) -> RawStream:
    """One sample per measurement of a sensor that was asked more often than it measures.

    Where most samples repeat the one before, only changes are kept, and one sample a second so that a constant
    pressure does not look like a dead sensor.

    Args:
        stream: of one sensor.
        repeated: whether to; told by the samples if None.
    """
    if not (are_repeated(stream.values) if repeated is None else repeated):
        return stream
    changed = np.ones(len(stream.t_ns), dtype=bool)
    changed[1:] = (stream.values[1:] != stream.values[:-1]).any(axis=1)
    changed[1:] |= np.diff(stream.t_ns // 1_000_000_000) != 0
    return RawStream(stream.t_ns[changed], stream.values[changed])
