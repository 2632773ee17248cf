"""Tables of places: the project's own CSV, and what phone apps and receivers write.

Own, on the log's clock: ``t_s,x_m,y_m[,z_m][,floor][,sigma_m]``, or ``lat_deg,lon_deg`` for ``x_m,y_m`` (metres are
then those East and North of the first row). The columns of the IPIN 2023 truth files
(``t_app_s,checkpoint,lat_deg,lon_deg,floor,east_m,north_m``) are understood too, and RIDI's ``time,pos_x,pos_y``.
``sigma_m`` is the standard deviation of a place on each axis; without it a place is taken as exact, one of IPIN as good
to half a metre.

Receivers': Sensor Logger's ``time`` (Unix time in ns), ``seconds_elapsed``, ``latitude``, ``longitude``,
``horizontalAccuracy``; phyphox's ``Time (s)``, ``Latitude (°)``, ``Longitude (°)``, ``Horizontal Accuracy (m)``; labels
by row of a log without clock, ``StartSampleID,Hour,Min,Sec,Lat,Lng``.
"""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import replace
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np

from fbgraph.core.checkpoints import IPIN_SIGMA_M, Checkpoints, Clock, checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.georeference import Georeference
from fbgraph.core.gnss_fixes import gnss_checkpoints
from fbgraph.core.place_clocks import EPOCH_S
from fbgraph.core.safe_text import short_name

if TYPE_CHECKING:
    import pandas as pd

_MOST_TOLD = 12  # names of columns, in a line
_ROLES = {
    "t_s": ("ts", "tapps"),
    "elapsed": ("secondselapsed", "elapseds"),
    "sample": ("startsampleid", "sampleid"),
    "x_m": ("xm", "eastm", "posx"),
    "y_m": ("ym", "northm", "posy"),
    "z_m": ("zm", "upm", "posz"),
    "floor": ("floor",),
    "sigma_m": ("sigmam",),
    "lat": ("latdeg", "latitude", "lat"),
    "lon": ("londeg", "longitude", "lon", "lng", "long"),
    "radius": ("horizontalaccuracy", "accuracy", "hacc", "accuracym", "horizontalaccuracym"),
    "hour": ("hour",),
    "minute": ("min", "minute"),
    "second": ("sec", "second"),
}
"""What a column is, by its name in small letters without blanks, underscores and unit."""
_BY_NAME = {name: role for role, names in _ROLES.items() for name in names}
_TIME = re.compile(r"(?:unix|epoch|utc)?(?:time|timestamp|datetime)(ns|us|ms|s)?")
_UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_MOST = {"lat": 90.0, "lon": 180.0}
_FARTHEST_M = 1e11  # any frame on Earth lies within, in any unit


def looks_like_places(names: list[str]) -> bool:
    """Whether columns of these names hold latitudes and longitudes."""
    return {"lat", "lon"} <= {_role(name)[0] for name in names}


def parse_places(text: str, source: str) -> Checkpoints:
    """Places of a table with a header, whatever separates its columns.

    Args:
        text: of the file.
        source: for messages.

    Raises:
        DataError: it is none, lacks columns, or holds a row that is not numbers.
    """
    import pandas as pd  # here, because it takes a second to import

    header = next((line for line in text.splitlines() if line.strip() and not line.startswith(("#", "sep="))), "")
    separator = max(",;\t", key=header.count)  # the first of equals
    start = text.find(header)
    decimal = "," if separator != "," and re.search(r"\d,\d", text[start : start + 4096]) else "."
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", pd.errors.ParserWarning)  # rows that end with a separator
            table = pd.read_csv(
                StringIO(text[start:]),
                sep=separator,
                decimal=decimal,
                comment="#",
                skipinitialspace=True,
                index_col=False,
            )
    except ValueError as error:  # pandas' parser and decoding errors are ValueErrors
        raise DataError(f"{source}: not a readable checkpoint CSV: {str(error).splitlines()[0]}") from error
    return places_of(table, source)


def places_of(table: pd.DataFrame, source: str) -> Checkpoints:
    """Places of a table that was read already.

    Args:
        table: its columns by name, units in brackets behind them if there are any.
        source: for messages.

    Raises:
        DataError: it lacks columns, or holds a row that is not numbers.
    """
    roles: dict[str, str] = {}
    unit = ""
    for name in map(str, table.columns):
        role, of_time = _role(name)
        if role and role not in roles:
            roles[role] = name
            unit = of_time if role == "time" else unit
    metres = {"x_m", "y_m"} <= set(roles)
    clocks = [role for role in ("t_s", "time", "elapsed", "sample") if role in roles]
    missing = [] if clocks else ["t_s"]
    if not metres and not {"lat", "lon"} <= set(roles):
        missing += [name for name in ("x_m", "y_m") if name not in roles]
    if missing:
        found = [short_name(str(name)) for name in table.columns[:_MOST_TOLD]]
        raise DataError(
            f"{source}: no column {', '.join(missing)} (found {', '.join(found)}"
            f"{', …' if len(table.columns) > _MOST_TOLD else ''}); "
            "a checkpoint file needs t_s,x_m,y_m[,z_m][,floor][,sigma_m], or lat_deg,lon_deg for x_m,y_m; a receiver's "
            "time,latitude,longitude[,horizontalAccuracy]"
        )
    if len(table) == 0:
        raise DataError(f"{source}: a header and no checkpoint")
    received = not metres and ("radius" in roles or "t_s" not in roles)
    return (_fixes if received else _surveyed)(table, roles, unit, source)


def _role(name: str) -> tuple[str, str]:
    """What a column is, and the unit of a time if its name tells it; empty if it is nothing."""
    bare, unit = name.strip(), ""
    if match := re.fullmatch(r"(.*?)\s*[(\[](.*?)[)\]]", bare):
        bare, unit = match[1], match[2].strip()
    key = re.sub(r"[\s_\"]", "", bare).lower()
    if key in _BY_NAME:
        return _BY_NAME[key], ""
    if match := _TIME.fullmatch(key):
        return "time", match[1] or (unit if unit in _UNITS_S else "")
    return "", ""


def _numbers(table: pd.DataFrame, name: str) -> FloatArray:
    """A column as numbers, nan where it is none."""
    import pandas as pd

    return np.asarray(pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float))


def _surveyed(table: pd.DataFrame, roles: dict[str, str], unit: str, source: str) -> Checkpoints:
    """Places that somebody measured: every row counts, and one that is not numbers is refused."""
    metres = {"x_m", "y_m"} <= set(roles)
    t_s, clock, elapsed_s = _times(table, roles, unit, source)
    columns: dict[str, FloatArray] = {
        role: _numbers(table, roles[role])
        for role in ("x_m", "y_m", "lat", "lon", "z_m", "floor", "sigma_m")
        if role in roles
    }
    needed = {"t_s": t_s, **{role: columns[role] for role in (("x_m", "y_m") if metres else ("lat", "lon"))}}
    for role, values in needed.items():
        if not np.isfinite(values).all():
            name = roles.get(role) or next(roles[name] for name in ("time", "elapsed", "sample") if name in roles)
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise DataError(f"{source}: row {row + 1} after the header: {name} is not a number")
    for role, most in _MOST.items():
        outside = np.flatnonzero(np.abs(columns.get(role, np.empty(0))) > most)
        if len(outside):
            row, value = int(outside[0]), columns[role][outside[0]]
            raise DataError(
                f"{source}: row {row + 1} after the header: {roles[role]} {value:g} is not within ±{most:g}"
            )
    if roles.get("t_s", "").strip() == "t_app_s" and "sigma_m" not in columns:
        columns["sigma_m"] = np.full(len(table), IPIN_SIGMA_M)
    lat_deg, lon_deg = columns.pop("lat", np.empty(0)), columns.pop("lon", np.empty(0))
    where, lat_lon_deg = None, None
    if len(lat_deg) and len(lon_deg) and np.isfinite((lat_deg[0], lon_deg[0])).all():
        where = Georeference(float(lat_deg[0]), float(lon_deg[0]))
        if metres:
            east_m, north_m = float(columns["x_m"][0]), float(columns["y_m"][0])
            if math.hypot(east_m, north_m) > _FARTHEST_M:
                raise DataError(f"{source}: row 1 after the header: a place {east_m:g}, {north_m:g} m is none on Earth")
            where = where.moved(-east_m, -north_m)
        else:
            lat_lon_deg = np.column_stack((lat_deg, lon_deg))
            columns["x_m"], columns["y_m"] = where.local_m(lat_lon_deg).T
    places = checkpoints(t_s, **columns, source=source, georeference=where, lat_lon_deg=lat_lon_deg)
    order = np.argsort(t_s, kind="stable")
    return replace(places, clock=clock, elapsed_s=None if elapsed_s is None else elapsed_s[order])


def _fixes(table: pd.DataFrame, roles: dict[str, str], unit: str, source: str) -> Checkpoints:
    """Places that a receiver found: what cannot be believed is left out."""
    t_s, clock, elapsed_s = _times(table, roles, unit, source)
    lat_deg, lon_deg = (_numbers(table, roles[role]) for role in ("lat", "lon"))
    radius_m = _numbers(table, roles["radius"]) if "radius" in roles else None
    sample, rate_hz = t_s, np.nan
    if clock == "samples" and {"hour", "minute", "second"} <= set(roles):
        clock_s = sum(
            _numbers(table, roles[role]) * length_s
            for role, length_s in (("hour", 3600.0), ("minute", 60.0), ("second", 1.0))
        )
        t_s = np.unwrap(np.asarray(clock_s, dtype=float), period=86400.0)
        rate_hz = _rows_a_second(sample, t_s)
    kept = gnss_checkpoints(t_s, lat_deg, lon_deg, radius_m, source, sample if clock == "samples" else elapsed_s)
    if clock == "samples":
        assert kept.elapsed_s is not None
        return replace(kept, t_s=kept.elapsed_s, elapsed_s=None, clock=clock, rate_hz=rate_hz)
    return replace(kept, clock=clock)


def _rows_a_second(sample: FloatArray, t_s: FloatArray) -> float:
    """Rows of the log a second, on the average by their times of day; nan if those do not tell."""
    known = np.isfinite(sample) & np.isfinite(t_s)
    if known.sum() < 2 or np.ptp(t_s[known]) <= 0.0:
        return float("nan")
    return float(np.ptp(sample[known]) / np.ptp(t_s[known]))


def _times(
    table: pd.DataFrame, roles: dict[str, str], unit: str, source: str
) -> tuple[FloatArray, Clock, FloatArray | None]:
    """Times in seconds, what they count, and the seconds since the recording's start beside them, if there are any."""
    elapsed_s = _numbers(table, roles["elapsed"]) if "elapsed" in roles else None
    if "t_s" in roles:
        return _numbers(table, roles["t_s"]), "log", None
    if "time" in roles:
        return _own_clock(table, roles["time"], unit, elapsed_s, source), "own", elapsed_s
    if elapsed_s is not None:
        return elapsed_s, "elapsed", None
    return _numbers(table, roles["sample"]), "samples", None


def _own_clock(table: pd.DataFrame, name: str, unit: str, elapsed_s: FloatArray | None, source: str) -> FloatArray:
    """A column named time, in seconds.

    Its unit is that of its name; else the one that makes it Unix time; else the one that agrees with the seconds beside
    it, or with which places are nearest to a second apart.
    """
    import pandas as pd

    ticks = _numbers(table, name)
    if not np.isfinite(ticks).any():
        dates = pd.to_datetime(table[name].astype(str), errors="coerce", utc=True, format="ISO8601")
        if dates.isna().all():
            raise DataError(
                f"{source}: column {name} holds neither numbers nor times like 2025-12-22T06:42:30Z "
                f"(it begins {str(table[name].iloc[0])[:40]!r})"
            )
        seconds = (dates - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=1)
        return np.asarray(seconds.to_numpy(dtype=float))
    if unit:
        return np.asarray(ticks * _UNITS_S[unit])
    middle = float(np.nanmedian(ticks))
    for tick_s in (1.0, 1e-3, 1e-6, 1e-9):
        if EPOCH_S[0] <= middle * tick_s <= EPOCH_S[1]:
            return np.asarray(ticks * tick_s)
    with np.errstate(invalid="ignore", over="ignore"):  # infinite times are told where all are looked at
        steps = np.abs(np.diff(ticks))
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    aim_s = 1.0
    if elapsed_s is not None and (between := np.abs(np.diff(elapsed_s)[steps > 0.0])).any():
        aim_s = float(np.median(between)) or 1.0
    tick_s = min((1.0, 1e-3, 1e-6, 1e-9), key=lambda tick_s: abs(np.log(step * tick_s / aim_s)))
    return np.asarray(ticks * tick_s)
