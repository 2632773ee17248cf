"""A way in words and tables, word for word."""

import csv
import io
import json
import math
from dataclasses import replace

import pytest

from fbgraph.core.errors import ConfigError
from fbgraph.core.verdict import Integrity, Reason
from fbgraph.way_back.gpx_geojson import DIRECTION_FORMATS, format_directions
from fbgraph.way_back.legs import Climb, Directions, Landmark, Leg
from fbgraph.way_back.texts import (
    arrival_text,
    as_csv,
    as_json,
    as_text,
    distance_text,
    heading_text,
    instruction,
    instructions,
    landmarks_at,
    turn_text,
)

EAST = Leg(
    points_m=((0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (20.0, 0.0, 3.0)),
    direction=(1.0, 0.0),
    length_m=20.0,
    climbs=(Climb(10.0, 2.0, 3.0),),
    landmarks=(Landmark("door", 0.5, 19.5), Landmark("stairs", 10.0, 10.0), Landmark("lamp", 19.25, 0.75)),
    sigma_along_m=1.24,
    sigma_across_m=0.5556,
)
NORTH = Leg(
    points_m=((20.0, 0.0, 3.0), (20.0, 8.0, 3.0)),
    direction=(0.0, 1.0),
    length_m=8.0,
    landmarks=(Landmark("lift", 8.0, 0.0),),
)
WAY = Directions("walk", (EAST, NORTH), pace_m=0.5, sigma_m=1.2)


@pytest.mark.parametrize(
    ("degrees", "text"),
    [
        (42.4, "bear left 40°"),
        (42.6, "turn left 45°"),
        (-42.6, "turn right 45°"),
        (122.4, "turn left 120°"),
        (122.6, "turn sharp left 125°"),
        (-157.4, "turn sharp right 155°"),
        (157.6, "turn around"),
        (-179.0, "turn around"),
        (32.6, "bear left 35°"),
    ],
)
def test_turns_in_words(degrees: float, text: str) -> None:
    assert turn_text(math.radians(degrees)) == text


@pytest.mark.parametrize(
    ("yaw_deg", "text"),
    [
        (0.0, "090° E"),
        (90.0, "000° N"),
        (180.0, "270° W"),
        (-90.0, "180° S"),
        (112.0, "338° N"),  # to the nearest of eight
        (113.0, "337° NW"),
        (45.0, "045° NE"),
        (-45.0, "135° SE"),
        (-136.0, "226° SW"),
    ],
)
def test_headings_in_words(yaw_deg: float, text: str) -> None:
    assert heading_text(math.radians(yaw_deg)) == text


def test_distances_in_words() -> None:
    assert distance_text(9.94, 0.5) == "9.9 m (20 steps)"
    assert distance_text(9.96, 0.5) == "10 m (20 steps)"
    assert distance_text(0.6, 0.5) == "0.6 m (1 step)"
    assert distance_text(12.4, 0.5, "steps") == "25 steps (12 m)"


def test_the_whole_way_in_sentences() -> None:
    assert instructions(WAY) == [
        "At “door”, face 090° E, then walk 20 m (40 steps), 3 m up between 10 m and 18 m, "
        "past “stairs” after 10 m (20 steps).",
        "At “lamp”, turn left 90°, then 8.0 m (16 steps) heading 000° N.",
        "You are at the end of the walk, at “lift”.",
    ]


def test_the_whole_way_back_in_steps() -> None:
    assert instructions(WAY.reversed(), "steps") == [
        "At “lift”, turn around: face 180° S, then walk 16 steps (8.0 m).",
        "At “lamp”, turn right 90°, then 40 steps (20 m) heading 270° W, 3 m down between steps 4 and 20, "
        "past “stairs” after 20 steps (10 m).",
        "You are back at the start, at “door”.",
    ]


def test_without_a_compass_no_heading_is_named() -> None:
    lost = replace(WAY, compass=False)
    assert instructions(lost)[0].startswith("At “door”, walk 20 m")
    assert instructions(lost)[1] == "At “lamp”, turn left 90°, then 8.0 m (16 steps)."
    assert instructions(lost.reversed())[0] == "At “lift”, turn around, then walk 8.0 m (16 steps)."


def test_a_landmark_is_at_a_corner_within_a_step_and_a_half() -> None:
    for after_m, at, past in ((0.75, True, False), (0.76, False, True)):
        leg = replace(EAST, landmarks=(Landmark("door", after_m, 20.0 - after_m),))
        way = replace(WAY, legs=(leg,))
        assert (landmarks_at(way, 0) == "“door”") == at
        assert ("past “door” after 0.8 m (2 steps)" in instructions(way)[0]) == past
        assert landmarks_at(way.reversed(), 1) == landmarks_at(way, 0)
        assert ("past “door” after 19 m (38 steps)" in instructions(way.reversed())[0]) == past


def test_landmarks_of_both_legs_at_a_corner_are_named_once() -> None:
    north = replace(NORTH, landmarks=(Landmark("lamp", 0.0, 8.0), Landmark("sign", 0.5, 7.5), *NORTH.landmarks))
    assert landmarks_at(replace(WAY, legs=(EAST, north)), 1) == "“lamp”, “sign”"
    short = Leg(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)), (1.0, 0.0), 1.0, (), (Landmark("mat", 0.5, 0.5),))
    way = Directions("short", (short,), 0.5)
    assert (landmarks_at(way, 0), landmarks_at(way, 1)) == ("“mat”", "")  # as near to both: where the leg begins


def climbing(after_m: float, before_m: float, rise_m: float = 3.0) -> str:
    leg = replace(EAST, landmarks=(), climbs=(Climb(after_m, before_m, rise_m),))
    return instruction(leg, None, 0.5, back=False, compass=False)


def test_climbs_in_words() -> None:
    assert climbing(3.9, 4.0) == "Walk 20 m (40 steps), 3 m up."  # more than six tenths of the leg
    assert climbing(4.1, 4.0) == "Walk 20 m (40 steps), 3 m up between 4.1 m and 16 m."
    assert climbing(0.74, 9.0, -3.0) == "Walk 20 m (40 steps), 3 m down on the first 10 m (21 steps)."
    assert climbing(0.76, 9.0) == "Walk 20 m (40 steps), 3 m up between 0.8 m and 11 m."
    assert climbing(9.0, 0.74) == "Walk 20 m (40 steps), 3 m up on the last 10 m (21 steps)."
    assert climbing(9.0, 0.76) == "Walk 20 m (40 steps), 3 m up between 9.0 m and 19 m."


@pytest.mark.parametrize(
    ("after_m", "before_m", "where"),
    [
        (0.7, 19.0, "first"),
        (0.0, 0.5, "first"),  # of a leg that is hardly more than the lift
        (10.0, 9.5, "after 10 m (20 steps)"),
        (19.0, 0.7, "at its end"),
    ],
)
def test_a_lift_is_taken_where_it_is(after_m: float, before_m: float, where: str) -> None:
    for rise_m, way in ((12.2, "12 m up"), (-3.0, "3 m down")):
        leg = replace(EAST, landmarks=(), climbs=(Climb(after_m, before_m, rise_m, ride=True),))
        said = instruction(leg, None, 0.5, back=False, compass=False)
        assert said == f"Walk 20 m (40 steps), {where} take the lift (or escalator) {way}."


def test_a_rise_that_may_be_none_is_not_told() -> None:
    points = tuple((0.5 * i, 0.0, 0.05 * i) for i in range(41))
    leg = replace(EAST, landmarks=(), climbs=(), points_m=points)
    assert "2 m up" in instruction(replace(leg, sigma_rise_m=0.9), None, 0.5, back=False, compass=False)
    assert "up" not in instruction(replace(leg, sigma_rise_m=1.1), None, 0.5, back=False, compass=False)


def test_a_slope_of_a_metre_all_along_is_told_too() -> None:
    for rise_m, text in ((0.99, ""), (1.01, ", 1 m up"), (-1.01, ", 1 m down")):
        leg = Leg(((0.0, 0.0, 0.0), (20.0, 0.0, rise_m)), (1.0, 0.0), 20.0)
        assert instruction(leg, None, 0.5, back=False, compass=False) == f"Walk 20 m (40 steps){text}."
    flat = replace(EAST, landmarks=(), climbs=(Climb(1.0, 12.0, 2.0), Climb(12.0, 1.0, -2.0)))
    assert "2 m up between 1.0 m and 8.0 m, 2 m down between 12 m and 19 m." in instruction(flat, 0.0, 0.5)


def test_the_page_for_reading() -> None:
    assert as_text(WAY) == (
        "Way of walk: 28 m (56 steps), 1 turn. A step is 0.50 m.\n"
        "\n"
        f"  1. {instructions(WAY)[0]}\n"
        "     8.0 m (16 steps) left. This leg: ±1.2 m in length, ±0.6 m sideways.\n"
        "\n"
        f"  2. {instructions(WAY)[1]}\n"
        "\n"
        "  3. You are at the end of the walk, at “lift”. If you do not see it, look within 2 m.\n"
    )


def test_the_page_of_the_way_back() -> None:
    page = as_text(replace(WAY.reversed(), sigma_m=0.4), "steps").splitlines()
    assert page[0] == "Way back of walk: 56 steps (28 m), 1 turn. A step is 0.50 m."
    assert page[3] == "     40 steps (20 m) left."
    assert page[6] == "     This leg: ±1.2 m in length, ±0.6 m sideways."
    assert page[-1].endswith("look within 1 m.")
    unsure = as_text(replace(WAY, legs=(EAST,), sigma_m=None))
    assert "0 turns" in unsure
    assert "look within" not in unsure


def test_who_has_walked_home_already_is_told_so() -> None:
    """Nearer than two metres, or than two sigma; on the same floor; on the way back only."""

    def page(apart_m: float, sigma_m: float | None, back: bool = True, higher_m: float = 0.9) -> str:
        leg = Leg(((apart_m, 0.0, higher_m), (9.0, 9.0, 0.0), (0.0, 0.0, 0.0)), (1.0, 0.0), 25.0)
        return as_text(Directions("loop", (leg,), 0.5, sigma_m, back=back))

    assert "The walk ended 1.9 m from its start: this is all of it once more, backwards." in page(1.9, None)
    assert "once more" not in page(2.1, None)
    assert "The walk ended 2.9 m" in page(2.9, 1.5)
    assert "once more" not in page(3.1, 1.5)
    assert "once more" not in page(1.0, 1.5, back=False)
    assert "once more" not in page(1.0, 1.5, higher_m=-3.0)


def test_json_holds_every_value() -> None:
    found = json.loads(as_json(WAY))
    first, second = found.pop("legs")
    assert found == {
        "name": "walk",
        "back": False,
        "length_m": 28.0,
        "pace_m": 0.5,
        "steps": 56,
        "sigma_m": 1.2,
        "start_m": [0.0, 0.0, 0.0],
        "arrival": "You are at the end of the walk, at “lift”.",
        "integrity": {"verdict": "sound", "widened": 1.0, "reasons": []},
        "left_out": [],
    }
    assert first == {
        "leg": 1,
        "instruction": instructions(WAY)[0],
        "turn_deg": None,
        "heading_deg": 90.0,
        "length_m": 20.0,
        "steps": 40,
        "rise_m": 3.0,
        "climbs": [{"after_m": 10.0, "before_m": 2.0, "rise_m": 3.0, "lift": False}],
        "remaining_m": 8.0,
        "sigma_along_m": 1.24,
        "sigma_across_m": 0.556,
        "landmarks": [
            {"label": "door", "after_m": 0.5},
            {"label": "stairs", "after_m": 10.0},
            {"label": "lamp", "after_m": 19.25},
        ],
        "end_m": [20.0, 0.0, 3.0],
    }
    assert (second["turn_deg"], second["heading_deg"], second["remaining_m"]) == (90.0, 0.0, 0.0)
    assert (second["sigma_along_m"], second["sigma_across_m"], second["rise_m"]) == (None, None, 0.0)
    back = json.loads(as_json(replace(WAY.reversed(), compass=False, sigma_m=None)))
    assert (back["back"], back["sigma_m"], back["start_m"]) == (True, None, [20.0, 8.0, 3.0])
    assert [leg["heading_deg"] for leg in back["legs"]] == [None, None]
    assert back["legs"][1]["turn_deg"] == -90.0
    assert "-0.0" not in as_json(WAY.reversed())


def test_csv_holds_a_row_a_leg() -> None:
    assert as_csv(WAY).splitlines()[0] == (
        "leg,instruction,turn_deg,heading_deg,length_m,steps,rise_m,remaining_m,"
        "sigma_along_m,sigma_across_m,landmarks,end_x_m,end_y_m,end_z_m"
    )
    first, second = csv.DictReader(io.StringIO(as_csv(WAY)))
    assert first["landmarks"] == "door after 0.5 m; stairs after 10.0 m; lamp after 19.2 m"
    assert [first[f"end_{axis}_m"] for axis in "xyz"] == ["20.0", "0.0", "3.0"]
    assert [second[f"end_{axis}_m"] for axis in "xyz"] == ["20.0", "8.0", "3.0"]
    assert (first["turn_deg"], second["turn_deg"], second["steps"]) == ("", "90.0", "16")
    assert (first["sigma_along_m"], first["sigma_across_m"]) == ("1.24", "0.556")
    assert second["instruction"] == instructions(WAY)[1]
    assert list(csv.DictReader(io.StringIO(as_csv(WAY, "steps"))))[1]["instruction"] == instructions(WAY, "steps")[1]


def test_formats_are_asked_for_by_name() -> None:
    assert DIRECTION_FORMATS == ("text", "json", "geojson", "gpx", "csv")
    assert format_directions(WAY, "text", "steps") == as_text(WAY, "steps")
    assert format_directions(WAY, "json", "steps") == as_json(WAY, "steps")
    assert format_directions(WAY, "csv", "steps") == as_csv(WAY, "steps")
    with pytest.raises(ConfigError, match="unknown format 'pdf': expected one of text, json, geojson, gpx, csv"):
        format_directions(WAY, "pdf")


def test_the_arrival_names_what_is_there() -> None:
    assert arrival_text(WAY.reversed()) == "You are back at the start, at “door”."
    assert arrival_text(replace(WAY, legs=(replace(EAST, landmarks=()),))) == "You are at the end of the walk."


def test_a_doubtful_way_says_so_before_its_directions() -> None:
    """Whatever a log has written into the reason is shown, never interpreted."""
    reason = Reason("compass_turns", 2.0, "compass and gyroscope turn opposite ways\x1b[2J", "check their axes")
    doubtful = replace(WAY, integrity=Integrity("doubtful", (reason,), 3.0))
    lines = as_text(doubtful).splitlines()
    assert lines[0] == "Do not rely on this way: its position is doubtful."
    assert lines[1] == "compass and gyroscope turn opposite ways\\x1b[2J: check their axes."
    assert lines[3:] == as_text(WAY).splitlines()
    assert json.loads(as_json(doubtful))["integrity"]["reasons"][0]["advice"] == "check their axes"
    assert WAY.caution == ()
    assert doubtful.reversed().caution == doubtful.caution
