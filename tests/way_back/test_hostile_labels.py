"""Landmarks and names that would be markup, formula or escape in the formats of directions."""

import csv
import io
import json
from xml.etree import ElementTree

import gpxpy
import pytest
from support.hostile import TEXTS, unseen

from fbgraph.core.georeference import Georeference
from fbgraph.core.safe_text import for_csv, short_name, visible
from fbgraph.way_back.gpx_geojson import DIRECTION_FORMATS, as_geojson, as_gpx, format_directions
from fbgraph.way_back.legs import Directions, Landmark, Leg
from fbgraph.way_back.texts import as_csv, as_json, as_text

ORIGIN = Georeference(60.0, 20.0)


def way(text: str) -> Directions:
    """100 m East past a landmark of this name, in a walk of this name."""
    points = ((0.0, 0.0, 0.0), (100.0, 0.0, 0.0))
    return Directions(text, (Leg(points, (1.0, 0.0), 100.0, (), (Landmark(text, 30.0, 70.0),)),), pace_m=0.5)


@pytest.mark.parametrize("text", TEXTS)
def test_a_sentence_shows_the_name_in_one_line(text: str) -> None:
    lines = as_text(way(text)).split("\n")
    assert lines[0] == f"Way of {short_name(text)}: 100 m (200 steps), 0 turns. A step is 0.50 m."
    assert (
        lines[2] == f"  1. Face 090° E, then walk 100 m (200 steps), past “{short_name(text)}” after 30 m (60 steps)."
    )
    assert len(lines) == 6


@pytest.mark.parametrize("text", TEXTS)
def test_json_and_geojson_keep_the_true_text(text: str) -> None:
    said = json.loads(as_json(way(text)))
    assert said["name"] == text
    assert said["legs"][0]["landmarks"] == [{"label": text, "after_m": 30.0}]
    features = json.loads(as_geojson(way(text), ORIGIN))["features"]
    assert [f["properties"]["label"] for f in features if f["properties"]["kind"] == "landmark"] == [text]


@pytest.mark.parametrize("text", TEXTS)
def test_gpx_is_well_formed_and_shows_the_name(text: str) -> None:
    document = as_gpx(way(text), ORIGIN)
    read = gpxpy.parse(document)
    # XML makes one space of white space, which gpxpy strips at the ends
    assert read.name == visible(text).strip()
    assert [point.name for point in read.waypoints] == [visible(text).strip()]
    assert read.routes[0].points[0].description is not None
    assert {element.tag.rpartition("}")[2] for element in ElementTree.fromstring(document.encode()).iter()} == {
        *("gpx", "metadata", "name", "wpt", "rte", "rtept", "desc", "trk", "trkseg", "trkpt")
    }


@pytest.mark.parametrize("text", TEXTS)
def test_csv_runs_nothing(text: str) -> None:
    [row] = csv.DictReader(io.StringIO(as_csv(way(text)), newline=""))
    assert row["landmarks"] == for_csv(f"{text} after 30.0 m")
    assert all(cell[:1] not in tuple("=+@\t\r") for cell in row.values())
    assert row["end_x_m"] == "100.0"


def test_numbers_in_a_csv_stay_numbers() -> None:
    points = ((0.0, 0.0, 0.0), (-100.0, 0.0, 0.0))
    west = Directions("w", (Leg(points, (-1.0, 0.0), 100.0),), pace_m=0.5)
    [row] = csv.DictReader(io.StringIO(as_csv(west)))
    assert row["end_x_m"] == "-100.0"


@pytest.mark.parametrize("format_", DIRECTION_FORMATS)
@pytest.mark.parametrize("text", TEXTS)
def test_no_format_holds_anything_that_a_terminal_obeys(text: str, format_: str) -> None:
    document = format_directions(way(text), format_, "metric", ORIGIN)
    assert unseen(document) == set()
    document.encode()
