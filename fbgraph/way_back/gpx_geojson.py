"""A way on the map: GeoJSON (RFC 7946) and GPX 1.1, both in WGS 84 and so only with a known origin.

Heights are left out: the barometer knows those above the start, both formats mean those above sea or ellipsoid.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from fbgraph.core.errors import ConfigError
from fbgraph.core.georeference import Georeference
from fbgraph.core.safe_text import for_json, for_xml
from fbgraph.way_back.legs import Directions
from fbgraph.way_back.texts import Units, arrival_text, as_csv, as_json, as_text, instructions, leg_rows

DIRECTION_FORMATS = ("text", "json", "geojson", "gpx", "csv")


def format_directions(
    way: Directions, format_: str, units: Units = "metric", origin: Georeference | None = None
) -> str:
    """A way in one of ``DIRECTION_FORMATS``.

    Raises:
        ConfigError: a map without an origin, or no such format.
    """
    if format_ in ("geojson", "gpx"):
        origin = require_map(format_, origin, way.compass)
        return as_gpx(way, origin, units) if format_ == "gpx" else as_geojson(way, origin, units)
    if format_ not in DIRECTION_FORMATS:
        raise ConfigError(f"unknown format {format_!r}: expected one of {', '.join(DIRECTION_FORMATS)}")
    return {"text": as_text, "json": as_json, "csv": as_csv}[format_](way, units)


def require_map(format_: str, origin: Georeference | None, compass: bool) -> Georeference:
    """The origin of what goes on a map.

    Args:
        format_: of the map.
        origin: latitude and longitude, if known.
        compass: whether it is known where North is.

    Raises:
        ConfigError: one of both is not.
    """
    if origin is None:
        raise ConfigError(
            f"{format_} needs latitude and longitude, and this run does not know its own: "
            "name those of its start with --origin LAT,LON"
        )
    if not compass:
        raise ConfigError(f"{format_}: the log has no magnetometer, so where North is nobody knows")
    return origin


def as_geojson(way: Directions, origin: Georeference, units: Units = "metric") -> str:
    """A line a leg with what the JSON says of it, and a point for each end and landmark."""
    features = []
    for row, leg in zip(leg_rows(way, units), way.legs, strict=True):
        del row["end_m"]  # the line says it
        features.append(feature("LineString", lon_lat(origin, leg.points_m), {"kind": "leg", **row}))
    for kind, point in (("start", way.points_m[0]), ("arrival", way.points_m[-1])):
        text = arrival_text(way) if kind == "arrival" else instructions(way, units)[0]
        properties: dict[str, Any] = {"kind": kind, "instruction": text}
        if kind == "start" and way.caution:
            properties["caution"] = " ".join(way.caution)
        features.append(feature("Point", lon_lat(origin, [point])[0], properties))
    for label, place in _landmarks(way):
        features.append(feature("Point", lon_lat(origin, [place])[0], {"kind": "landmark", "label": label}))
    document = json.dumps({"type": "FeatureCollection", "features": features}, indent=1, ensure_ascii=False)
    return for_json(document) + "\n"


def as_gpx(way: Directions, origin: Georeference, units: Units = "metric") -> str:
    """A route with an instruction a point, a track of every breadcrumb, and waypoints for landmarks."""
    from gpxpy import gpx as xml  # here, because only GPX needs it

    document = xml.GPX()
    document.creator, document.name = "fbgraph", for_xml(way.name)
    if way.caution:
        document.description = for_xml(" ".join(way.caution))
    corners = [leg.points_m[0] for leg in way.legs] + [way.points_m[-1]]
    route = xml.GPXRoute(name=f"{document.name}, {'back' if way.back else 'there'}")
    for number, (text, (lon, lat)) in enumerate(
        zip(instructions(way, units), lon_lat(origin, corners), strict=True), start=1
    ):
        route.points.append(xml.GPXRoutePoint(lat, lon, name=str(number), description=text))
    document.routes.append(route)
    track = xml.GPXTrack(name=route.name)
    track.segments.append(
        xml.GPXTrackSegment([xml.GPXTrackPoint(lat, lon) for lon, lat in lon_lat(origin, way.points_m)])
    )
    document.tracks.append(track)
    for label, place in _landmarks(way):
        lon, lat = lon_lat(origin, [place])[0]
        document.waypoints.append(xml.GPXWaypoint(lat, lon, name=for_xml(label)))
    return str(document.to_xml("1.1")) + "\n"


def lon_lat(origin: Georeference, points_m: Iterable[tuple[float, ...]]) -> list[list[float]]:
    """[longitude, latitude] of world places, to a centimetre."""
    lat_lon_deg = origin.geodetic_deg(np.array([point[:2] for point in points_m]))
    return [[round(lon_deg, 7), round(lat_deg, 7)] for lat_deg, lon_deg in lat_lon_deg.tolist()]


def _landmarks(way: Directions) -> list[tuple[str, tuple[float, float]]]:
    """Label and place of every landmark of the way."""
    found: list[tuple[str, tuple[float, float]]] = []
    for leg in way.legs:
        points = np.array(leg.points_m)
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))))
        for mark in leg.landmarks:
            x_m, y_m = (float(np.interp(mark.after_m, along, points[:, axis])) for axis in (0, 1))
            found.append((mark.label, (x_m, y_m)))
    return found


def feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    """A GeoJSON feature."""
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}
