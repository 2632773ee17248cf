"""A way on the map: longitude before latitude, and places where they are on Earth."""

import json
import math
from dataclasses import replace
from typing import Any

import gpxpy
import pytest

from fbgraph.core.errors import ConfigError
from fbgraph.core.georeference import Georeference
from fbgraph.way_back.gpx_geojson import as_geojson, as_gpx, format_directions
from fbgraph.way_back.legs import Directions, Landmark, Leg
from fbgraph.way_back.texts import instructions

ORIGIN = Georeference(60.0, 20.0)
EAST = Leg(
    points_m=((0.0, 0.0, 0.0), (60.0, 0.0, 1.0), (100.0, 0.0, 2.0)),
    direction=(1.0, 0.0),
    length_m=100.0,
    landmarks=(Landmark("door", 30.0, 70.0),),
)
NORTH = Leg(((100.0, 0.0, 2.0), (100.0, 200.0, 2.0)), (0.0, 1.0), 200.0, (), (Landmark("gate", 150.0, 50.0),))
WAY = Directions("walk", (EAST, NORTH), pace_m=0.5)

# WGS 84 at 60° N: radii of curvature of the meridian (M) and across it (N), by their formulae
E2, A_M = 0.00669437999014, 6378137.0
N_M = A_M / math.sqrt(1.0 - E2 * math.sin(math.radians(60.0)) ** 2)
M_M = N_M * (1.0 - E2) / (1.0 - E2 * math.sin(math.radians(60.0)) ** 2)


def lon_lat(x_m: float, y_m: float) -> list[Any]:
    """Longitude and latitude of a place near the origin, to a few centimetres."""
    lon_deg = 20.0 + math.degrees(x_m / (N_M * math.cos(math.radians(60.0))))
    return [pytest.approx(lon_deg, abs=1e-6), pytest.approx(60.0 + math.degrees(y_m / M_M), abs=1e-6)]


def features(way: Directions = WAY) -> list[dict[str, Any]]:
    collection = json.loads(as_geojson(way, ORIGIN))
    assert collection["type"] == "FeatureCollection"
    assert {feature["type"] for feature in collection["features"]} == {"Feature"}
    return list(collection["features"])


def test_geojson_draws_a_line_a_leg_where_it_is() -> None:
    first, second = (f for f in features() if f["properties"]["kind"] == "leg")
    assert first["geometry"]["type"] == "LineString"
    assert first["geometry"]["coordinates"] == [lon_lat(0, 0), lon_lat(60, 0), lon_lat(100, 0)]
    assert second["geometry"]["coordinates"] == [lon_lat(100, 0), lon_lat(100, 200)]
    assert [f["properties"]["leg"] for f in (first, second)] == [1, 2]
    assert [f["properties"]["instruction"] for f in (first, second)] == instructions(WAY)[:2]
    assert (second["properties"]["turn_deg"], second["properties"]["length_m"]) == (90.0, 200.0)
    assert "end_m" not in first["properties"]


def test_geojson_marks_ends_and_landmarks() -> None:
    points = [f for f in features() if f["geometry"]["type"] == "Point"]
    assert [(f["properties"]["kind"], f["geometry"]["coordinates"]) for f in points] == [
        ("start", lon_lat(0, 0)),
        ("arrival", lon_lat(100, 200)),
        ("landmark", lon_lat(30, 0)),
        ("landmark", lon_lat(100, 150)),
    ]
    assert [f["properties"].get("label") for f in points] == [None, None, "door", "gate"]
    assert points[0]["properties"]["instruction"] == instructions(WAY)[0]
    assert points[1]["properties"]["instruction"] == instructions(WAY)[-1]


def test_a_centimetre_is_kept() -> None:
    x = features()[0]["geometry"]["coordinates"][1]
    assert [round(value, 7) for value in x] == x
    assert abs(x[0] - 20.0 - math.degrees(60.0 / (N_M * 0.5))) < 2e-7


def test_landmarks_of_a_bent_leg_are_on_it() -> None:
    bent = Leg(((0.0, 0.0, 0.0), (40.0, 0.0, 9.0), (40.0, 60.0, 0.0)), (1.0, 0.0), 100.0, (), (Landmark("x", 70, 30),))
    assert features(Directions("bent", (bent,), 0.5))[-1]["geometry"]["coordinates"] == lon_lat(40, 30)


def test_gpx_holds_route_track_and_waypoints() -> None:
    document = gpxpy.parse(as_gpx(WAY, ORIGIN))
    assert (document.version, document.creator, document.name) == ("1.1", "fbgraph", "walk")
    (route,) = document.routes
    assert route.name == "walk, there"
    assert [[p.longitude, p.latitude] for p in route.points] == [lon_lat(0, 0), lon_lat(100, 0), lon_lat(100, 200)]
    assert [p.name for p in route.points] == ["1", "2", "3"]
    assert [p.description for p in route.points] == instructions(WAY)
    (segment,) = document.tracks[0].segments
    assert [[p.longitude, p.latitude] for p in segment.points] == [
        lon_lat(0, 0),
        lon_lat(60, 0),
        lon_lat(100, 0),
        lon_lat(100, 200),
    ]
    assert document.tracks[0].name == "walk, there"
    marks = [(mark.name, [mark.longitude, mark.latitude]) for mark in document.waypoints]
    assert marks == [("door", lon_lat(30, 0)), ("gate", lon_lat(100, 150))]


def test_the_way_back_begins_at_the_end() -> None:
    (route,) = gpxpy.parse(format_directions(WAY.reversed(), "gpx", "steps", ORIGIN)).routes
    assert route.name == "walk, back"
    assert [route.points[0].longitude, route.points[0].latitude] == lon_lat(100, 200)
    assert [p.description for p in route.points] == instructions(WAY.reversed(), "steps")
    start = json.loads(format_directions(WAY.reversed(), "geojson", "steps", ORIGIN))["features"][2]
    assert start["geometry"]["coordinates"] == lon_lat(100, 200)
    assert start["properties"]["instruction"] == instructions(WAY.reversed(), "steps")[0]


@pytest.mark.parametrize("kind", ["geojson", "gpx"])
def test_a_map_needs_an_origin_and_north(kind: str) -> None:
    with pytest.raises(ConfigError, match=f"{kind} needs latitude and longitude"):
        format_directions(WAY, kind)
    with pytest.raises(ConfigError, match=f"{kind}: the log has no magnetometer"):
        format_directions(replace(WAY, compass=False), kind, origin=ORIGIN)
