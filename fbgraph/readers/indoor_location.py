"""Indoor Location Competition 2.0 traces: ``ms \\t TYPE_… \\t values``, ``#`` comments, Unix milliseconds.

``TYPE_WAYPOINT`` lines are surveyed positions (metres, x East, y North). Calibrated streams are read; the uncalibrated
ones repeat them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fbgraph.checkpoints import checkpoints
from fbgraph.readers.base import RawLog, RawStream, open_text

NAME = "indoor_location"
DESCRIPTION = "Indoor Location Competition 2.0 traces (ms <tab> TYPE_ACCELEROMETER <tab> x <tab> y <tab> z)"
_TAGS = {
    "TYPE_ACCELEROMETER": ("acc", 3),
    "TYPE_GYROSCOPE": ("gyro", 3),
    "TYPE_MAGNETIC_FIELD": ("mag", 3),
    "TYPE_PRESSURE": ("pressure", 1),
    "TYPE_WAYPOINT": ("waypoint", 2),
}


def detects(head: str) -> bool:
    """Whether the beginning of a file is of this format."""
    return "\tTYPE_" in head


def read(path: Path) -> RawLog:
    """Read one trace.

    Raises:
        DataError: the file cannot be read.
    """
    raw = RawLog()
    rows: dict[str, list[tuple[int, list[float]]]] = {name: [] for name, _ in _TAGS.values()}
    bad = 0
    with open_text(path) as stream:
        for line in stream:
            t_ms, _, rest = line.partition("\t")
            tag, _, values = rest.partition("\t")
            if tag not in _TAGS:
                continue
            name, width = _TAGS[tag]
            try:
                row = (int(t_ms), [float(value) for value in values.split("\t")[:width]])
            except ValueError:
                bad += 1
                continue
            if len(row[1]) == width:
                rows[name].append(row)
            else:
                bad += 1
    if bad:
        raw.counts["lines_unreadable"] = bad
    for name, table in rows.items():
        if not table:
            continue
        t_ns = np.asarray([t for t, _ in table], dtype=np.int64) * 1_000_000
        values_si = np.asarray([v for _, v in table])
        if name == "waypoint":
            raw.truth = checkpoints(t_ns * 1e-9, *values_si.T, source=f"{path} (TYPE_WAYPOINT)")
        else:
            raw.streams[name] = RawStream(t_ns, values_si)
    return raw
