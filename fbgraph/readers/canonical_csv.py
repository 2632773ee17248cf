"""Any log as a canonical M5StickC CSV: nothing is resampled, so that smoothing either gives the same walk."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.geometry import IntArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2

_COLUMNS = {"acc": (1, STANDARD_GRAVITY_M_S2), "gyro": (4, DEGREE_RAD), "mag": (7, 1.0), "pressure": (10, 1.0)}
_MS_NS = 1_000_000
_DIGITS = "%.9g"  # as many as a single-precision sensor value has


def write_canonical_csv(log: SensorLog, path: Path) -> int:
    """Write a log as CSV, one row for every moment at which any sensor was sampled; returns how many.

    A row holds what was sampled at that moment and leaves the rest empty. Times are the log's own clock, to the
    nanosecond as far as ``t0_s`` holds it; values have nine significant digits, in g, °/s, µT and hPa.

    Args:
        log: any log; its events go into the row nearest in time.
        path: the file.

    Raises:
        OSError: the file cannot be written.
    """
    import pandas as pd  # here, because it takes a second to import

    t0_ns = round(log.t0_s * 1e9)
    streams = {name: getattr(log, name) for name in _COLUMNS}
    stamps = {name: t0_ns + np.round(stream.t_s * 1e9).astype(np.int64) for name, stream in streams.items()}
    t_ns: IntArray = np.unique(np.concatenate(list(stamps.values())))
    names = CANONICAL.split(",")
    table = pd.DataFrame(np.full((len(t_ns), len(names)), np.nan), columns=names)
    for name, (first, unit) in _COLUMNS.items():
        rows, values = np.searchsorted(t_ns, stamps[name]), streams[name].values / unit
        for i in range(values.shape[1]):
            table.iloc[rows, first + i] = values[:, i]
    whole_ms = bool((t_ns % _MS_NS == 0).all())
    table[names[0]] = t_ns // _MS_NS if whole_ms else t_ns
    marks = np.full(len(t_ns), "", dtype=object)
    for event in log.events:
        nearest = int(np.abs(t_ns - (t0_ns + round(event.t_s * 1e9))).argmin())
        marks[nearest] = f"{marks[nearest]} {event.label}".strip()
    table["event"] = marks
    if not whole_ms:
        table = table.rename(columns={names[0]: "t_ns"})
    with open(path, "w", encoding="utf-8", newline="") as out:
        table.to_csv(out, index=False, float_format=_DIGITS, lineterminator="\n")
    return len(table)
