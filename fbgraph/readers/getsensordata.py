"""GetSensorData logs (LOPSI, CAR-CSIC), as used by the IPIN competitions; latin-1, ``%`` comments.

The log's own header says which clock is which: SensorTimestamp is exact for intervals, AppTimestamp is the clock of
POSI. Sensor times are brought to the app clock by each sensor's median offset. One constant is enough: over the
3–5 minutes of the IPIN 2023 logs the offsets of accelerometer, gyroscope and magnetometer stay within 3 ms from end to
end, while single app times are up to 60 ms late. (Only the barometer's steps, by up to 45 ms, once in some logs.)
"""

from __future__ import annotations

from array import array
from contextlib import suppress
from pathlib import Path

import numpy as np

from fbgraph.core.checkpoints import IPIN_SIGMA_M, Checkpoints, checkpoints
from fbgraph.core.georeference import Georeference
from fbgraph.core.nanoseconds import to_ns
from fbgraph.readers.cleaning import RawLog, RawStream
from fbgraph.readers.formats import LogFormat
from fbgraph.tables.log_text import MOST_LINES, LogText, log_text

FORMAT = LogFormat(
    "getsensordata",
    "GetSensorData app, IPIN competition logs (ACCE;app s;sensor s;x;y;z;accuracy)",
    """\
ACCE;0.0542;65093.5471;-1.01514;8.26000;6.21535;3
GYRO;0.0553;65093.5561;-0.70433;-0.48197;-0.01649;3
MAGN;0.0563;65093.5602;-2.40000;-34.08000;-45.66000;0
PRES;0.1198;65093.6620;976.2273;3
POSI;61.4235;1;49.461316433032;11.110964442580;0;100
""",
    tested="real logs",
)
_TAGS = {"ACCE": ("acc", 3), "GYRO": ("gyro", 3), "MAGN": ("mag", 3), "PRES": ("pressure", 1)}
_MAX_DRIFT_S = 0.02


def detects(head: str) -> bool:
    """Whether the beginning of a file is of this format."""
    if "GetSensorData" in head:
        return True
    return any(line.startswith(tuple(f"{tag};" for tag in _TAGS)) for line in head.splitlines())


def read(source: Path | LogText) -> RawLog:
    """Read one log.

    Raises:
        DataError: the file cannot be read.
    """
    raw = RawLog()
    text = log_text(source)
    text.require_rows(MOST_LINES)
    tables, places, bad = _tables(text)
    for tag, (name, width) in _TAGS.items():
        table = np.array(tables[tag], dtype=float).reshape(-1, 2 + width)
        dated = np.isfinite(table[:, :2]).all(axis=1)
        bad += int((~dated).sum())
        if not dated.any():
            continue
        app_s, sensor_s, values = table[dated, 0], table[dated, 1], table[dated, 2:]
        with np.errstate(over="ignore", invalid="ignore"):  # garbled times; impossible ones are dropped with the rest
            offset_s = app_s - sensor_s
            tenth = -(-len(offset_s) // 10)
            drift_s = float(np.median(offset_s[-tenth:]) - np.median(offset_s[:tenth]))
            t_s = sensor_s + np.median(offset_s)
        if name != "pressure" and abs(drift_s) > _MAX_DRIFT_S:
            raw.notices.append(
                f"{tag}: the sensor clock moves {drift_s * 1e3:.0f} ms against the app clock; "
                "checkpoint times are that uncertain"
            )
        raw.streams[name] = RawStream(to_ns(t_s, 1_000_000_000), values)
    if bad:
        raw.counts["lines_unreadable"] = bad
    raw.truth = _truth(places, text.source)
    return raw


def _tables(text: LogText) -> tuple[dict[str, array[float]], array[float], int]:
    """Numbers of the sensors' lines, and of the POSI lines, row by row; how many lines were unreadable."""
    tables: dict[str, array[float]] = {tag: array("d") for tag in _TAGS}
    places = array("d")
    bad = 0
    for lines in text.lines():
        for line in lines:
            tag, _, rest = line.partition(";")
            if tag in _TAGS:
                width, fields = _TAGS[tag][1], rest.split(";")
                try:
                    fields[2 + width]  # the accuracy: a line without it may have been cut in the middle of a number
                    tables[tag].extend([float(value) for value in fields[: 2 + width]])
                except (ValueError, IndexError):
                    bad += 1
            elif tag == "POSI":
                with suppress(ValueError, IndexError):
                    fields = rest.split(";")
                    places.extend([float(fields[i]) for i in (0, 2, 3, 4)])
    return tables, places, bad


def _truth(places: array[float], path: Path) -> Checkpoints | None:
    """POSI lines (time, latitude, longitude, floor) as checkpoints, metres East and North of the first, if any."""
    table = np.array(places, dtype=float).reshape(-1, 4)
    table = table[np.isfinite(table).all(axis=1) & (np.abs(table[:, 1]) <= 90.0)]
    if len(table) == 0:
        return None
    t_s, lat_deg, lon_deg, floor = table.T
    first = Georeference(float(lat_deg[0]), float(lon_deg[0]))
    lat_lon_deg = np.column_stack((lat_deg, lon_deg))
    x_m, y_m = first.local_m(lat_lon_deg).T
    source = f"{path} (POSI)"
    sigma_m = np.full(len(t_s), IPIN_SIGMA_M)
    return checkpoints(
        t_s, x_m, y_m, floor=floor, sigma_m=sigma_m, source=source, georeference=first, lat_lon_deg=lat_lon_deg
    )
