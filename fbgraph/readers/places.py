"""Files of known places, as truth or as anchors: tables, GPX, TUM, and logs that carry their truth."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile, ZipFile

import numpy as np

from fbgraph.columns.column_names import names_accelerometer
from fbgraph.core.bounded import PLACES_BYTES, require_table, small_file
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.gnss_fixes import gnss_checkpoints
from fbgraph.readers.place_tables import parse_places
from fbgraph.readers.tagged import tagged_reader
from fbgraph.tables.log_text import text_of

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
    return _parsed(small_file(path, PLACES_BYTES, _KIND), path)


def gnss_of(log: Path) -> Checkpoints | None:
    """What a receiver found during a walk: the Location file in a log's folder or zip, or beside a log's one file.

    Args:
        log: a folder, a .zip, or a file.

    Raises:
        DataError: there is such a file, and it cannot be used.
    """
    if log.is_file() and log.suffix.lower() == ".zip":
        return _in_zip(log)
    folder = log if log.is_dir() else log.parent
    try:
        inside = sorted(folder.iterdir())
        if log.is_dir():
            inside += sorted(file for one in inside if one.is_dir() for file in one.iterdir())
    except OSError:
        return None
    files = [file for name in _LOCATION_FILES for file in inside if file.name.lower() == name and file != log]
    return read_checkpoints(files[0]) if files else None


def _in_zip(log: Path) -> Checkpoints | None:
    """The Location file of a zip, at most one folder deep."""
    try:
        with ZipFile(log) as archive:
            for name in _LOCATION_FILES:
                for member in archive.infolist():
                    parts = member.filename.lower().split("/")
                    if parts[-1] != name or len(parts) > 2:
                        continue
                    with archive.open(member) as stream:
                        data = stream.read(PLACES_BYTES + 1)
                    if len(data) > PLACES_BYTES:
                        raise DataError(f"{log}/{member.filename}: larger than any file of places")
                    return _parsed(data, log / member.filename)
    except (BadZipFile, OSError, RuntimeError, NotImplementedError) as error:  # encrypted; a method nobody knows
        raise DataError(f"{log}: cannot be unpacked ({error}); copy it again") from error
    return None


def _parsed(data: bytes, path: Path) -> Checkpoints:
    """Places of a file's bytes."""
    text = _decoded(data, path)
    if text.lstrip().startswith("<"):
        return _from_gpx(text, path)
    require_table(data, path, _KIND)
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    if re.fullmatch(r"(?:[-+.\deE]+\s+){7}[-+.\deE]+\s*", first):
        return _from_tum(text, path)
    if (truth := _of_a_log(text, path)) is not None:
        return truth
    return parse_places(text, str(path))


def _decoded(data: bytes, path: Path) -> str:
    """Text of UTF-8 or UTF-16; where it is neither, latin-1, which every byte decodes to."""
    try:
        text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if not text.strip() or "\x00" in text:
        what = "No columns to parse from file" if not text.strip() else "it is binary"
        raise DataError(f"{path}: not a readable checkpoint CSV: {what}")
    return text.replace("\r\n", "\n").replace("\r", "\n")


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
