"""A way on the map: GeoJSON (RFC 7946) and GPX 1.1, both in WGS 84 and so only with a known origin.

Heights are left out: the barometer knows those above the start, both formats mean those above sea or ellipsoid.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fbgraph.errors import ConfigError, DataError
from fbgraph.guidance import Way
from fbgraph.way_texts import Units, arrival_text, as_csv, as_json, as_text, instructions, leg_rows

WAY_FORMATS = ("text", "json", "geojson", "gpx", "csv")


@dataclass(frozen=True)
class Origin:
    """Where the world frame lies: its origin in degrees, its x axis ``rotation_deg`` counter-clockwise from East.

    Raises:
        ConfigError: no such place on Earth.
    """

    lat_deg: float
    lon_deg: float
    rotation_deg: float = 0.0

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) <= 90 and abs(self.lon_deg) <= 180 and math.isfinite(self.rotation_deg)):
            raise ConfigError(f"origin {self.lat_deg:g},{self.lon_deg:g}: no such latitude and longitude in degrees")

    def lon_lat(self, points_m: Iterable[tuple[float, ...]]) -> list[list[float]]:
        """[longitude, latitude] of world places, to a centimetre."""
        from pymap3d import enu2geodetic  # here, because it is needed by maps alone

        east, north = np.array([point[:2] for point in points_m]).T
        turned = (east + 1j * north) * np.exp(1j * math.radians(self.rotation_deg))
        lat, lon, _ = enu2geodetic(turned.real, turned.imag, np.zeros(len(turned)), self.lat_deg, self.lon_deg, 0.0)
        return np.round(np.column_stack((lon, lat)), 7).tolist()  # type: ignore[no-any-return]


def parse_origin(text: str) -> Origin:
    """An origin from ``LAT,LON``.

    Raises:
        ConfigError: anything else.
    """
    try:
        lat, lon = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--origin {text}: expected LAT,LON in degrees, for example 48.1374,11.5755") from None
    return Origin(lat, lon)


def georeference(summary: dict[str, Any], source: str) -> Origin | None:
    """The origin that a run's summary names under ``georeference``, or None.

    Raises:
        DataError: one that cannot be read, naming ``source``.
    """
    entry = summary.get("georeference")
    if entry is None:
        return None
    try:
        return Origin(float(entry["lat_deg"]), float(entry["lon_deg"]), float(entry.get("rotation_deg") or 0.0))
    except (TypeError, KeyError, ValueError, AttributeError, ConfigError) as error:
        raise DataError(f"{source}: its georeference is not lat_deg and lon_deg in degrees") from error


def format_way(way: Way, format_: str, units: Units = "metric", origin: Origin | None = None) -> str:
    """A way in one of ``WAY_FORMATS``.

    Raises:
        ConfigError: a map without an origin, or no such format.
    """
    if format_ in ("geojson", "gpx"):
        if origin is None:
            raise ConfigError(
                f"{format_} needs latitude and longitude, and this run does not know its own: "
                "name those of its start with --origin LAT,LON"
            )
        if not way.compass:
            raise ConfigError(f"{format_}: the log has no magnetometer, so where North is nobody knows")
        return as_gpx(way, origin, units) if format_ == "gpx" else as_geojson(way, origin, units)
    if format_ not in WAY_FORMATS:
        raise ConfigError(f"unknown format {format_!r}: expected one of {', '.join(WAY_FORMATS)}")
    return {"text": as_text, "json": as_json, "csv": as_csv}[format_](way, units)


def as_geojson(way: Way, origin: Origin, units: Units = "metric") -> str:
    """A line a leg with what the JSON says of it, and a point for each end and landmark."""
    features = []
    for row, leg in zip(leg_rows(way, units), way.legs, strict=True):
        del row["end_m"]  # the line says it
        features.append(_feature("LineString", origin.lon_lat(leg.points_m), {"kind": "leg", **row}))
    for kind, point in (("start", way.points_m[0]), ("arrival", way.points_m[-1])):
        text = arrival_text(way) if kind == "arrival" else instructions(way, units)[0]
        features.append(_feature("Point", origin.lon_lat([point])[0], {"kind": kind, "instruction": text}))
    for label, place in _landmarks(way):
        features.append(_feature("Point", origin.lon_lat([place])[0], {"kind": "landmark", "label": label}))
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1, ensure_ascii=False) + "\n"


def as_gpx(way: Way, origin: Origin, units: Units = "metric") -> str:
    """A route with an instruction a point, a track of every breadcrumb, and waypoints for landmarks."""
    from gpxpy import gpx as xml  # here, because only GPX needs it

    document = xml.GPX()
    document.creator, document.name = "fbgraph", way.name
    corners = [leg.points_m[0] for leg in way.legs] + [way.points_m[-1]]
    route = xml.GPXRoute(name=f"{way.name}, {'back' if way.back else 'there'}")
    for number, (text, (lon, lat)) in enumerate(
        zip(instructions(way, units), origin.lon_lat(corners), strict=True), start=1
    ):
        route.points.append(xml.GPXRoutePoint(lat, lon, name=str(number), description=text))
    document.routes.append(route)
    track = xml.GPXTrack(name=route.name)
    track.segments.append(
        xml.GPXTrackSegment([xml.GPXTrackPoint(lat, lon) for lon, lat in origin.lon_lat(way.points_m)])
    )
    document.tracks.append(track)
    for label, place in _landmarks(way):
        lon, lat = origin.lon_lat([place])[0]
        document.waypoints.append(xml.GPXWaypoint(lat, lon, name=label))
    return str(document.to_xml("1.1")) + "\n"


def _landmarks(way: Way) -> list[tuple[str, tuple[float, float]]]:
    """Label and place of every landmark of the way."""
    found: list[tuple[str, tuple[float, float]]] = []
    for leg in way.legs:
        points = np.array(leg.points_m)
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points[:, :2], axis=0).T))))
        for mark in leg.landmarks:
            x_m, y_m = (float(np.interp(mark.after_m, along, points[:, axis])) for axis in (0, 1))
            found.append((mark.label, (x_m, y_m)))
    return found


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}
