"""Indoor Location Competition 2.0 traces: ``ms <tab> TYPE_… <tab> values``, ``#`` comments, Unix milliseconds.

``TYPE_WAYPOINT`` lines are surveyed positions (metres, x East, y North). Calibrated streams are read; the uncalibrated
ones repeat them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fbgraph.core.checkpoints import checkpoints
from fbgraph.readers.base import MAX_T_NS, RawLog, RawStream, open_text

NAME = "indoor_location"
PRESET = "phone"
DESCRIPTION = (
    "Indoor Location Competition 2.0 traces (ms <tab> TYPE_ACCELEROMETER <tab> x <tab> y <tab> z <tab> accuracy)"
)
EXAMPLE = """\
1574572467406\tTYPE_WAYPOINT\t208.86206\t216.74796
1574572467526\tTYPE_ACCELEROMETER\t-1.0474854\t0.93452454\t15.622391\t2
1574572467526\tTYPE_MAGNETIC_FIELD\t-21.97113\t-8.80127\t-16.664124\t3
1574572467526\tTYPE_GYROSCOPE\t-0.22131348\t0.23864746\t0.049453735\t3
"""
_TAGS = {  # stream, values, least number of fields: an accuracy follows vectors, a line without it may have been cut
    "TYPE_ACCELEROMETER": ("acc", 3, 4),
    "TYPE_GYROSCOPE": ("gyro", 3, 4),
    "TYPE_MAGNETIC_FIELD": ("mag", 3, 4),
    "TYPE_PRESSURE": ("pressure", 1, 1),
    "TYPE_WAYPOINT": ("waypoint", 2, 2),
}
_TICK_NS = 1_000_000


def detects(head: str) -> bool:
    """Whether the beginning of a file is of this format."""
    return "\tTYPE_" in head


def read(path: Path) -> RawLog:
    """Read one trace.

    Raises:
        DataError: the file cannot be read.
    """
    raw = RawLog()
    rows: dict[str, list[tuple[int, list[float]]]] = {name: [] for name, _, _ in _TAGS.values()}
    bad = 0
    with open_text(path) as stream:
        for line in stream:
            t_ms, _, rest = line.partition("\t")
            tag, _, values = rest.partition("\t")
            if tag not in _TAGS:
                continue
            name, width, least = _TAGS[tag]
            fields = values.split("\t")
            try:
                row = (int(t_ms), [float(value) for value in fields[:width]])
            except ValueError:
                bad += 1
                continue
            if len(fields) >= least and abs(row[0]) <= MAX_T_NS // _TICK_NS:
                rows[name].append(row)
            else:
                bad += 1
    if bad:
        raw.counts["lines_unreadable"] = bad
    for name, table in rows.items():
        if not table:
            continue
        t_ns = np.asarray([t for t, _ in table], dtype=np.int64) * _TICK_NS
        values_si = np.asarray([v for _, v in table])
        if name != "waypoint":
            raw.streams[name] = RawStream(t_ns, values_si)
        elif (known := np.isfinite(values_si).all(axis=1)).any():
            x_m, y_m = values_si[known].T
            raw.truth = checkpoints(t_ns[known] * 1e-9, x_m, y_m, source=f"{path} (TYPE_WAYPOINT)")
    return raw
