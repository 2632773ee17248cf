"""The legs of a walk and of the way back along them, and how they are told."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.trajectories import trajectory, wobbly

from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.pipeline import reconstruct
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.way_back.legs import directions_of
from fbgraph.way_back.texts import distance_text, heading_text, instructions, turn_text

CONFIG = load_config("m5stickc")


def test_words_are_those_of_people() -> None:
    assert [turn_text(math.radians(angle)) for angle in (85.0, -37.0, 141.0, -175.0)] == [
        "turn left 85°",
        "bear right 35°",
        "turn sharp left 140°",
        "turn around",
    ]
    assert [heading_text(math.radians(90.0 - h)) for h in (0.0, 210.0, 359.6, 45.0)] == [
        "000° N",
        "210° SW",
        "000° N",
        "045° NE",
    ]
    assert distance_text(23.3, 0.69) == "23 m (34 steps)"
    assert distance_text(0.7, 0.69, "steps") == "1 step (0.7 m)"


def test_a_climb_is_told_where_it_is() -> None:
    stairs = np.interp(np.arange(61), (20, 35), (0.0, -6.0))
    slope = np.interp(np.arange(61), (0, 60), (0.0, 4.0))
    hill = np.interp(np.arange(61), (0, 30, 60), (0.0, 5.0, 0.0))
    for z_m, there, back in (
        (stairs, "6 m down between 15 m and 24 m", "6 m up between 18 m and 27 m"),
        (slope, "4 m up.", "4 m down."),
        (hill, "5 m up between 2.1 m and 19 m, 5 m down between 23 m and 40 m", "5 m up between 2.1 m and 19 m"),
        (0.9 * slope / 4.0, "heading 090° E.", "heading"),
    ):
        found = directions_of(trajectory(np.zeros(60), z_m=z_m))
        if "heading" in there:
            assert "up" not in instructions(found)[0]
        else:
            assert there in instructions(found)[0]
            assert back in instructions(found.reversed())[0]


def test_legs_are_as_uncertain_as_they_say() -> None:
    """Error of a leg between the true corners over its sigma, rms, both axes; across is given as a bound."""
    ratios = []
    for seed in range(12):
        walk = simulate(load_route("square"), seed=seed)
        found = directions_of(reconstruct(walk.log, CONFIG).smoothed.trajectory, graph=CONFIG.graph)
        corners = np.column_stack((walk.turns.x_m, walk.turns.y_m))
        corners = np.vstack(((walk.x_m[0], walk.y_m[0]), corners, (walk.x_m[-1], walk.y_m[-1])))
        for leg, true in zip(found.legs, np.diff(corners, axis=0), strict=True):
            assert leg.sigma_along_m is not None
            assert leg.sigma_across_m is not None
            error = np.subtract(leg.points_m[-1], leg.points_m[0])[:2] - true
            across = error @ (-leg.direction[1], leg.direction[0])
            ratios.append((error @ leg.direction / leg.sigma_along_m, across / leg.sigma_across_m))
    along, across = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert 0.7 < along < 1.4
    assert 0.4 < across < 1.2


YAWS = st.lists(st.floats(-400.0, 400.0), min_size=2, max_size=60).map(np.array)
EVENTS = st.lists(st.tuples(st.floats(-5.0, 40.0), st.text(min_size=1, max_size=3)), max_size=8)


@settings(max_examples=150, deadline=None)
@given(yaw_deg=YAWS, events=EVENTS, data=st.data())
def test_back_and_back_again_is_the_way_itself(
    yaw_deg: np.ndarray, events: list[tuple[float, str]], data: st.DataObject
) -> None:
    count = len(yaw_deg)
    step_m = np.array(data.draw(st.lists(st.floats(0.05, 1.2), min_size=count, max_size=count)))
    z_m = np.array(data.draw(st.lists(st.floats(-8.0, 8.0), min_size=count + 1, max_size=count + 1)))
    walked = trajectory(yaw_deg, step_m, z_m)
    there = directions_of(walked, events)
    back = there.reversed()
    assert back.reversed() == there
    assert back != there
    assert back.points_m == there.points_m[::-1]
    assert np.array_equal(there.points_m, np.column_stack((walked.xy_m, walked.z_m)))
    assert there.length_m == back.length_m == pytest.approx(walked.distance_m[-1])
    assert sorted(mark.label for leg in back.legs for mark in leg.landmarks) == sorted(label for _, label in events)
    for leg, same in zip(there.legs, reversed(back.legs), strict=True):
        assert leg.length_m == same.length_m
        assert leg.rise_m == -same.rise_m
        for mark in leg.landmarks:
            assert mark.after_m + mark.before_m == pytest.approx(leg.length_m)
    assert len(instructions(back)) == len(back.legs) + 1


def test_a_left_turn_is_a_right_turn_on_the_way_back_and_directions_are_opposite() -> None:
    there = directions_of(trajectory(wobbly((0.0, 10), (90.0, 20))))
    back = there.reversed()
    assert there.turn_rad(1) == pytest.approx(math.pi / 2, abs=0.1)
    assert back.turn_rad(1) == pytest.approx(-there.turn_rad(1))
    assert back.legs[0].yaw_rad == pytest.approx(-math.pi / 2, abs=0.1)
    assert instructions(there)[0].startswith("Face 0")
    assert instructions(back)[0].startswith("Turn around: face 18")


def test_a_way_needs_steps_and_a_pace() -> None:
    with pytest.raises(DataError, match="two"):
        directions_of(trajectory(np.zeros(1)))
    with pytest.raises(DataError, match="never moves"):
        directions_of(trajectory(np.zeros(5), step_m=0.0))
    with pytest.raises(ConfigError, match="pace"):
        directions_of(trajectory(np.zeros(5)), pace_m=0.0)
