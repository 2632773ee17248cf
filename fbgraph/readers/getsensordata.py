"""GetSensorData logs (LOPSI, CAR-CSIC), as used by the IPIN competitions.

Lines ``ACCE;AppTimestamp;SensorTimestamp;x;y;z;accuracy`` (likewise GYRO, MAGN, ``PRES;…;hPa;accuracy``) and the
surveyed ``POSI;AppTimestamp;n;lat;lon;floor;building``; latin-1, ``%`` comments. The log's own header says which clock
is which: SensorTimestamp is exact for intervals, AppTimestamp is the clock of POSI. Sensor times are brought to the app
clock by each sensor's median offset.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pymap3d

from fbgraph.checkpoints import Checkpoints, checkpoints
from fbgraph.readers.base import RawLog, RawStream, open_text

NAME = "getsensordata"
DESCRIPTION = "GetSensorData app, IPIN competition logs (ACCE;…  GYRO;…  POSI;…)"
_TAGS = {"ACCE": ("acc", 3), "GYRO": ("gyro", 3), "MAGN": ("mag", 3), "PRES": ("pressure", 1)}


def detects(head: str) -> bool:
    """Whether the beginning of a file is of this format."""
    if "GetSensorData" in head:
        return True
    return any(line.startswith(tuple(f"{tag};" for tag in _TAGS)) for line in head.splitlines())


def read(path: Path) -> RawLog:
    """Read one log.

    Raises:
        DataError: the file cannot be read.
    """
    raw = RawLog()
    rows: dict[str, list[list[str]]] = {tag: [] for tag in (*_TAGS, "POSI")}
    bad = 0
    with open_text(path) as stream:
        for line in stream:
            tag, _, rest = line.partition(";")
            if tag in rows:
                rows[tag].append(rest.rstrip().split(";"))
    for tag, (name, width) in _TAGS.items():
        table = []
        for fields in rows[tag]:
            try:
                table.append([float(value) for value in fields[: 2 + width]])
            except ValueError:
                table.append([])
        whole = [row for row in table if len(row) == 2 + width and np.isfinite(row[:2]).all()]
        bad += len(table) - len(whole)
        if whole:
            array = np.asarray(whole)
            app_s, sensor_s = array[:, 0], array[:, 1]
            offset_s = np.median(app_s - sensor_s)
            raw.streams[name] = RawStream(np.round((sensor_s + offset_s) * 1e9).astype(np.int64), array[:, 2:])
    if bad:
        raw.counts["lines_unreadable"] = bad
    raw.truth = _truth(rows["POSI"], path)
    return raw


def _truth(rows: list[list[str]], path: Path) -> Checkpoints | None:
    """POSI lines as checkpoints, metres East and North of the first; None if there are none."""
    table = []
    for fields in rows:
        try:
            table.append([float(fields[i]) for i in (0, 2, 3, 4)])
        except (ValueError, IndexError):
            continue
    if not table:
        return None
    t_s, lat_deg, lon_deg, floor = np.asarray(table).T
    east_m, north_m, _ = pymap3d.geodetic2enu(lat_deg, lon_deg, 0.0, lat_deg[0], lon_deg[0], 0.0)
    return checkpoints(t_s, np.asarray(east_m), np.asarray(north_m), floor=floor, source=f"{path} (POSI)")
