"""GeoJSON (RFC 7946): the walk as a line, and a point for each breadcrumb, with its sigma, and each event.

Heights are properties: a third coordinate would be one above the ellipsoid, which nobody knows.
"""

from __future__ import annotations

import json
from typing import Any, BinaryIO

from fbgraph.core.safe_text import for_json
from fbgraph.exports.exported_walk import ExportedWalk
from fbgraph.way_back.gpx_geojson import feature

DESCRIPTION = "a line, and a point a breadcrumb with its standard deviations; for QGIS, geojson.io, leaflet"
SUFFIX, BINARY, ON_EARTH = ".geojson", False, True


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it."""
    origin, way = walk.on_map
    lon_lat = walk.lon_lat(way, origin).tolist()
    line: dict[str, Any] = {"kind": "walk", "name": walk.name, "estimator": walk.estimator}
    line["distance_m"] = round(float(way.distance_m[-1]), 3)
    if walk.caution:
        line["caution"] = " ".join(walk.caution)
    features = [feature("LineString", lon_lat, line)]
    for place, state in zip(lon_lat, walk.states(way), strict=True):
        features.append(feature("Point", place, {"kind": "breadcrumb", **state, **_time(walk, state["t_s"])}))
    for t_s, label, place in walk.marks(way, origin):
        about = {"kind": "event", "label": label, "t_s": round(t_s, 6), **_time(walk, t_s)}
        features.append(feature("Point", place, about))
    document = json.dumps({"type": "FeatureCollection", "features": features}, indent=1, ensure_ascii=False)
    out.write((for_json(document) + "\n").encode())
    return [] if walk.barometer else ["no barometer: heights are left out"]


def _time(walk: ExportedWalk, t_s: float) -> dict[str, str]:
    moment = walk.moment(t_s)
    return {} if moment is None else {"time": moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")}
