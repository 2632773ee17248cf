"""GetSensorData logs (LOPSI, CAR-CSIC), as used by the IPIN competitions; latin-1, ``%`` comments.

The log's own header says which clock is which: SensorTimestamp is exact for intervals, AppTimestamp is the clock of
POSI. Sensor times are brought to the app clock by each sensor's median offset. One constant is enough: over the
3–5 minutes of the IPIN 2023 logs the offsets of accelerometer, gyroscope and magnetometer stay within 3 ms from end to
end, while single app times are up to 60 ms late. (Only the barometer's steps, by up to 45 ms, once in some logs.)
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.georeference import Georeference
from fbgraph.readers.base import RawLog, RawStream, open_text, to_ns

NAME = "getsensordata"
PRESET = "phone"
DESCRIPTION = "GetSensorData app, IPIN competition logs (ACCE;app s;sensor s;x;y;z;accuracy)"
EXAMPLE = """\
ACCE;0.0542;65093.5471;-1.01514;8.26000;6.21535;3
GYRO;0.0553;65093.5561;-0.70433;-0.48197;-0.01649;3
MAGN;0.0563;65093.5602;-2.40000;-34.08000;-45.66000;0
PRES;0.1198;65093.6620;976.2273;3
POSI;61.4235;1;49.461316433032;11.110964442580;0;100
"""
_TAGS = {"ACCE": ("acc", 3), "GYRO": ("gyro", 3), "MAGN": ("mag", 3), "PRES": ("pressure", 1)}
_MAX_DRIFT_S = 0.02


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
                rows[tag].append(rest.split(";"))
    for tag, (name, width) in _TAGS.items():
        table = []
        for fields in rows[tag]:
            try:
                fields[2 + width]  # the accuracy: a line without it may have been cut in the middle of a number
                table.append([float(value) for value in fields[: 2 + width]])
            except (ValueError, IndexError):
                bad += 1
        array = np.asarray(table).reshape(-1, 2 + width)
        dated = np.isfinite(array[:, :2]).all(axis=1)
        bad += int((~dated).sum())
        if not dated.any():
            continue
        app_s, sensor_s, values = array[dated, 0], array[dated, 1], array[dated, 2:]
        offset_s = app_s - sensor_s
        tenth = -(-len(offset_s) // 10)
        drift_s = float(np.median(offset_s[-tenth:]) - np.median(offset_s[:tenth]))
        if name != "pressure" and abs(drift_s) > _MAX_DRIFT_S:
            raw.notices.append(
                f"{tag}: the sensor clock moves {drift_s * 1e3:.0f} ms against the app clock; "
                "checkpoint times are that uncertain"
            )
        raw.streams[name] = RawStream(to_ns(sensor_s + np.median(offset_s), 1_000_000_000), values)
    if bad:
        raw.counts["lines_unreadable"] = bad
    raw.truth = _truth(rows["POSI"], path)
    return raw


def _truth(rows: list[list[str]], path: Path) -> Checkpoints | None:
    """POSI lines as checkpoints, metres East and North of the first; None if there are none."""
    table = []
    for fields in rows:
        try:
            row = [float(fields[i]) for i in (0, 2, 3, 4)]
        except (ValueError, IndexError):
            continue
        if np.isfinite(row).all() and abs(row[1]) <= 90.0:
            table.append(row)
    if not table:
        return None
    t_s, lat_deg, lon_deg, floor = np.asarray(table).T
    first = Georeference(float(lat_deg[0]), float(lon_deg[0]))
    x_m, y_m = first.local_m(np.column_stack((lat_deg, lon_deg))).T
    return checkpoints(t_s, x_m, y_m, floor=floor, source=f"{path} (POSI)", georeference=first)
