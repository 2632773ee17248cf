"""What can be read of a log that cannot be smoothed: the sensors that are there, in SI."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fbgraph.columns.clock_times import Clock, clock_ns
from fbgraph.columns.clocks import find_clock
from fbgraph.columns.guesses import Chosen, Guess
from fbgraph.columns.units import UNITS
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.core.sensor_log import Stream
from fbgraph.physics.likely_samples import likely
from fbgraph.physics.sensor_units import judge_accelerometer
from fbgraph.readers.cleaning import RawLog
from fbgraph.tables.table import Table


@dataclass(frozen=True)
class Readable:
    """What can be read.

    Attributes:
        streams: by quantity, seconds since the first sample of all.
        clocks: by place of their table.
        hindrances: why no more can.
        unscaled: quantities that are not in SI, as their unit is not known.
    """

    streams: dict[str, Stream]
    clocks: dict[int, Clock] = field(default_factory=dict)
    hindrances: tuple[str, ...] = ()
    unscaled: frozenset[str] = frozenset()


_SENSORS = ("acc", "linear_acc", "gravity", "gyro", "mag", "pressure")


def readable_streams(
    tables: Sequence[Table], guesses: Sequence[Sequence[Guess]], chosen: Chosen, rate_hz: float | None
) -> Readable:
    """The sensors of tables, on one clock."""
    used = sorted({pick.table for name, pick in chosen.picks.items() if name in _SENSORS})
    clocks, hindrances = {}, []
    for i in used:
        others = [table for k, table in enumerate(tables) if k not in used]
        try:
            clocks[i] = find_clock(tables[i], guesses[i], rate_hz, others)
        except DataError as error:
            hindrances.append(str(error))
    found: dict[str, tuple[IntArray, Stream]] = {}
    unscaled: set[str] = set()
    for name in _SENSORS:
        pick = chosen.picks.get(name)
        if pick is None or pick.table not in clocks:
            continue
        t_ns, values = clock_ns(tables[pick.table], clocks[pick.table]), tables[pick.table].numbers(pick.columns)
        good = np.isfinite(values).all(axis=1) & (np.abs(t_ns) <= MAX_T_NS)
        good &= likely(name, values, good)
        t_ns, first = np.unique(t_ns[good], return_index=True)
        if len(t_ns) < 2:
            continue
        values = values[good][first] * np.array(pick.signs)
        scale = UNITS[name].get(pick.unit)
        raw = Stream(_seconds(t_ns, int(t_ns[0])), values)
        if name == "acc":
            scale = judge_accelerometer(raw, scale).scale
        if scale is None:
            hindrances.append(f"the unit of {name} is not named")
            unscaled.add(name)
        found[name] = (t_ns, Stream(raw.t_s, values * (scale or 1.0)))
    t0_ns = min((int(t_ns[0]) for t_ns, _ in found.values()), default=0)
    streams = {name: Stream(_seconds(t_ns, t0_ns), stream.values) for name, (t_ns, stream) in found.items()}
    return Readable(streams, clocks, tuple(hindrances), frozenset(unscaled))


def tagged_streams(raw: RawLog) -> dict[str, Stream]:
    """Sensors of a log of a tagged format, as it has them."""
    found = {}
    t0_ns = min((int(stream.t_ns.min()) for stream in raw.streams.values() if len(stream.t_ns)), default=0)
    for name, stream in raw.streams.items():
        values = stream.values.reshape(len(stream.t_ns), -1)
        good = np.isfinite(values).all(axis=1) & (np.abs(stream.t_ns) <= MAX_T_NS)
        good &= likely(name, values, good)
        t_ns, first = np.unique(stream.t_ns[good], return_index=True)
        values = values[good][first]
        if len(t_ns) > 1:
            found[name] = Stream(_seconds(t_ns, t0_ns), values)
    return found


def _seconds(t_ns: IntArray, t0_ns: int) -> FloatArray:
    return (t_ns - t0_ns).astype(float) / 1e9
