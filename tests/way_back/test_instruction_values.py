"""What the wearer is told next, on both sides of every threshold."""

import math

import pytest
from support.by_hand import match_at

from fbgraph.way_back.guide import next_instruction

LEFT, RIGHT = math.radians(90.0), math.radians(-90.0)


def told(turn: tuple[float, float] | None = None, remaining_m: float = 30.0, wrong_way_m: float = 0.0) -> str:
    return next_instruction(match_at(), turn, remaining_m, wrong_way_m, False)


def test_a_turn_is_announced_from_fifteen_metres_on() -> None:
    assert told((14.9, LEFT)) == "straight on for 15 m"
    assert told((15.0, LEFT)) == "turn left 90° in 15 m"
    assert told((14.0, LEFT)) == "straight on for 16 m"
    assert told((16.0, RIGHT)) == "turn right 90° in 14 m"


def test_a_turn_is_now_within_a_metre_and_a_half() -> None:
    assert told((28.6, LEFT)) == "turn left 90° now"
    assert told((28.5, LEFT)) == "turn left 90° in 2 m"
    assert told((28.4, RIGHT)) == "turn right 90° in 2 m"


def test_without_a_turn_the_start_is_what_is_ahead() -> None:
    assert told(None, 12.4) == "straight on for 12 m"
    assert told(None, 12.6) == "straight on for 13 m"


def test_two_metres_the_wrong_way_are_said() -> None:
    assert told(None, 30.0, 1.99) == "straight on for 30 m"
    assert told(None, 30.0, 2.0) == "turn around"


@pytest.mark.parametrize(
    ("bearing_deg", "side"),
    [
        (0.0, "ahead"),
        (44.0, "ahead"),
        (-44.0, "ahead"),
        (46.0, "to your left"),
        (-46.0, "to your right"),
        (134.0, "to your left"),
        (-134.0, "to your right"),
        (136.0, "behind you"),
        (-136.0, "behind you"),
    ],
)
def test_who_is_off_the_route_is_told_on_which_side_it_lies(bearing_deg: float, side: str) -> None:
    for cross_m in (6.4, -6.4):
        off = match_at(off_route=True, cross_m=cross_m, bearing_rad=math.radians(bearing_deg))
        assert next_instruction(off, (29.0, LEFT), 30.0, 9.0, True) == f"off route: the route is 6 m {side}"


def test_arriving_comes_before_turning_around_and_that_before_turns() -> None:
    assert next_instruction(match_at(), (29.0, LEFT), 30.0, 9.0, True) == "you are back at the start"
    assert next_instruction(match_at(), (29.0, LEFT), 30.0, 9.0, False) == "turn around"
