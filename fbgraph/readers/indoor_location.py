"""Indoor Location Competition 2.0 traces: ``ms <tab> TYPE_… <tab> values``, ``#`` comments, Unix milliseconds.

``TYPE_WAYPOINT`` lines are surveyed positions (metres, x East, y North). Calibrated streams are read; the uncalibrated
ones repeat them.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.readers.cleaning import RawLog, RawStream
from fbgraph.readers.formats import LogFormat
from fbgraph.tables.log_text import MOST_LINES, LogText, log_text

FORMAT = LogFormat(
    "indoor_location",
    "Indoor Location Competition 2.0 traces (ms <tab> TYPE_ACCELEROMETER <tab> x <tab> y <tab> z <tab> accuracy)",
    """\
1574572467406\tTYPE_WAYPOINT\t208.86206\t216.74796
1574572467526\tTYPE_ACCELEROMETER\t-1.0474854\t0.93452454\t15.622391\t2
1574572467526\tTYPE_MAGNETIC_FIELD\t-21.97113\t-8.80127\t-16.664124\t3
1574572467526\tTYPE_GYROSCOPE\t-0.22131348\t0.23864746\t0.049453735\t3
""",
    tested="real logs",
)
_TAGS = {  # stream, values, least number of fields: an accuracy follows vectors, a line without it may have been cut
    "TYPE_ACCELEROMETER": ("acc", 3, 4),
    "TYPE_GYROSCOPE": ("gyro", 3, 4),
    "TYPE_MAGNETIC_FIELD": ("mag", 3, 4),
    "TYPE_PRESSURE": ("pressure", 1, 1),
    "TYPE_WAYPOINT": ("waypoint", 2, 2),
}
_TICK_NS = 1_000_000
_RUN_ON = re.compile(r"(?<=.)(?=[0-9]{13}\tTYPE_)")  # the next record, where an end of line was lost
_WAYPOINT_SIGMA_M = 1.2  # tapped on a map of the floor by whoever walks past


def detects(head: str) -> bool:
    """Whether the beginning of a file is of this format."""
    return "\tTYPE_" in head


def read(source: Path | LogText) -> RawLog:
    """Read one trace.

    Raises:
        DataError: the file cannot be read.
    """
    raw = RawLog()
    text = log_text(source)
    text.require_rows(MOST_LINES)
    times, values, bad = _tables(text)
    if bad:
        raw.counts["lines_unreadable"] = bad
    for name, width, _ in _TAGS.values():
        if not times[name]:
            continue
        t_ns = np.array(times[name], dtype=np.int64) * _TICK_NS
        values_si = np.array(values[name], dtype=float).reshape(-1, width)
        if name != "waypoint":
            raw.streams[name] = RawStream(t_ns, values_si)
        elif (known := np.isfinite(values_si).all(axis=1)).any():
            x_m, y_m = values_si[known].T
            sigma_m = np.full(len(x_m), _WAYPOINT_SIGMA_M)
            name = f"{text.source} (TYPE_WAYPOINT)"
            raw.truth = checkpoints(t_ns[known] * 1e-9, x_m, y_m, sigma_m=sigma_m, source=name)
    return raw


def _records(lines: list[str]) -> Iterator[str]:
    """Lines; those that run on are two."""
    for line in lines:
        if line.count("\tTYPE_") > 1:
            yield from _RUN_ON.split(line)
        else:
            yield line


def _tables(text: LogText) -> tuple[dict[str, array[int]], dict[str, array[float]], int]:
    """Times and numbers by stream, row by row, and how many lines were unreadable."""
    times: dict[str, array[int]] = {name: array("q") for name, _, _ in _TAGS.values()}
    numbers: dict[str, array[float]] = {name: array("d") for name, _, _ in _TAGS.values()}
    bad = 0
    for lines in text.lines():
        for line in _records(lines):
            t_ms, _, rest = line.partition("\t")
            tag, _, values = rest.partition("\t")
            if tag not in _TAGS:
                continue
            name, width, least = _TAGS[tag]
            fields = values.split("\t")
            try:
                t, row = int(t_ms), [float(value) for value in fields[:width]]
            except ValueError:
                bad += 1
                continue
            if len(fields) >= least and abs(t) <= MAX_T_NS // _TICK_NS:
                times[name].append(t)
                numbers[name].extend(row)
            else:
                bad += 1
    return times, numbers, bad
