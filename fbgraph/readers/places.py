"""Files of known places, as truth or as anchors: tables, GPX, TUM, and logs that carry their truth."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from fbgraph.columns.column_names import names_accelerometer
from fbgraph.core.bounded import PLACES_BYTES, Allowance, require_table, small_file
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.gnss_fixes import gnss_checkpoints
from fbgraph.readers.place_tables import parse_places
from fbgraph.readers.tagged import tagged_reader
from fbgraph.tables.encoding import as_utf_8, is_binary, without_marks
from fbgraph.tables.log_text import text_of
from fbgraph.tables.members import members

if TYPE_CHECKING:
    from gpxpy.gpx import GPX, GPXRoutePoint, GPXTrackPoint, GPXWaypoint

_KIND = "checkpoint CSV"
_MOST_GPX_POINTS = 200_000
"""Two days at one a second; gpxpy takes some kilobytes for each."""
_LOCATION_FILES = ("location.csv", "gps_label.csv")
_HEAD_CHARS = 20_000


def read_checkpoints(path: str | Path) -> Checkpoints:
    """Read a file of places: CSV, Sensor Logger's or phyphox's Location file, GPX, TUM, or a log that carries truth.

    Places of a receiver are in metres East and North of the first that may be believed, with their own sigma. Where the
    file's clock may be another than the log's, ``Checkpoints.clock`` says so; ``core.place_clocks`` settles that.

    Raises:
        DataError: it cannot be read, lacks columns, or holds a row that is not numbers; a GPX without times; a log
            without truth.
    """
    path = Path(path)
    data = small_file(path, PLACES_BYTES, _KIND)
    if is_binary(data):
        raise DataError(f"{path}: not a readable {_KIND}: it is binary")
    return _parsed(as_utf_8(b"".join(without_marks((data,))))[0].decode(), path)


def gnss_of(log: Path) -> Checkpoints | None:
    """What a receiver found during a walk: the Location file in a log's folder or zip, or beside a log's one file.

    Args:
        log: a folder, a .zip, or a file.

    Raises:
        DataError: there is such a file, and it cannot be used.
    """
    found = members(log, wanted=_is_location, allowed=Allowance(PLACES_BYTES))
    if found.many:
        ranked = sorted(found, key=lambda member: _rank(member.source))
        return _parsed(b"".join(ranked[0].text.pieces).decode(), Path(ranked[0].source)) if ranked else None
    try:
        beside = [file for file in sorted(log.parent.iterdir()) if _is_location(file.name) and file != log]
    except OSError:
        return None
    return read_checkpoints(min(beside, key=_rank)) if beside else None


def _is_location(name: str) -> bool:
    return PurePosixPath(name).name.lower() in _LOCATION_FILES


def _rank(name: str | Path) -> int:
    return _LOCATION_FILES.index(PurePosixPath(name).name.lower())


def _parsed(text: str, path: Path) -> Checkpoints:
    """Places of a file's text."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise DataError(f"{path}: not a readable {_KIND}: No columns to parse from file")
    if text.lstrip().startswith("<"):
        return _from_gpx(text, path)
    require_table(text.encode(), path, _KIND)
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    if re.fullmatch(r"(?:[-+.\deE]+\s+){7}[-+.\deE]+\s*", first):
        return _from_tum(text, path)
    if (truth := _of_a_log(text, path)) is not None:
        return truth
    return parse_places(text, str(path))


def _of_a_log(text: str, path: Path) -> Checkpoints | None:
    """Truth that a log carries; None if this is no log."""
    reader = tagged_reader(text[:_HEAD_CHARS])
    if reader is not None:
        truth: Checkpoints | None = reader.read(text_of([text.encode()], path)).truth
    else:
        header = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
        if not names_accelerometer(re.split(r"[,;\t]", header)):
            return None
        places = re.search(r"pos_?x|x_m|lat", header, re.IGNORECASE)  # in columns beside a walk's sensors
        truth = parse_places(text, str(path)) if places else None
    if truth is None:
        raise DataError(f"{path}: a log that carries no truth; name a file of places")
    return truth


def _from_tum(text: str, path: Path) -> Checkpoints:
    """Places of a trajectory as ``evo`` and others write it: ``t x y z qx qy qz qw``, in metres."""
    rows = []
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            row = [float(field) for field in line.split()[:4]]
        except ValueError:
            row = []
        if len(row) < 4 or not np.isfinite(row).all():
            raise DataError(f"{path}: line {number}: not t x y z qx qy qz qw")
        rows.append(row)
    t_s, x_m, y_m, z_m = np.array(rows).T
    return replace(checkpoints(t_s, x_m, y_m, z_m, source=str(path)), clock="own")


def _from_gpx(text: str, path: Path) -> Checkpoints:
    """Track points, route points and waypoints of a GPX file that have a time (UTC)."""
    if "<gpx" not in text[:_HEAD_CHARS]:
        raise DataError(f"{path}: XML, but no GPX; places are read from CSV, GPX and TUM")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise DataError(f"{path}: it declares a DOCTYPE or ENTITY, which no GPX needs; export it again")
    if (count := len(re.findall(r"<(?:trkpt|wpt|rtept)\b", text))) > _MOST_GPX_POINTS:
        raise DataError(f"{path}: {count} points, the limit of a GPX is {_MOST_GPX_POINTS}")
    import gpxpy  # here, because only GPX needs it

    try:
        gpx: GPX = gpxpy.parse(text)
    except (gpxpy.gpx.GPXException, ValueError, TypeError) as error:
        raise DataError(f"{path}: not a readable GPX: {str(error).splitlines()[0]}") from error
    points: list[GPXTrackPoint | GPXWaypoint | GPXRoutePoint] = [
        *(point for track in gpx.tracks for segment in track.segments for point in segment.points),
        *gpx.waypoints,
        *(point for route in gpx.routes for point in route.points),
    ]
    timed = [(point.time.timestamp(), point.latitude, point.longitude) for point in points if point.time is not None]
    if not timed:
        raise DataError(f"{path}: none of its {len(points)} points has a time; export it with times")
    t_s, lat_deg, lon_deg = np.array(timed, dtype=float).T
    places = gnss_checkpoints(t_s, lat_deg, lon_deg, None, str(path))
    if untimed := len(points) - len(timed):
        said = f"{path}: {untimed} of {len(points)} points have no time; left out"
        places = replace(places, notices=(said, *places.notices))
    return replace(places, clock="own")
