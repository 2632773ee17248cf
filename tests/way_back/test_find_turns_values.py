"""Turns of walks made by hand: where, how far, and what makes two of them one."""

import math

import numpy as np
import pytest
from support.trajectories import trajectory

from fbgraph.core.geometry import FloatArray
from fbgraph.way_back.turns import MIN_TURN_RAD, find_turns, leg_yaws


def yaws(*legs: tuple[float, int]) -> FloatArray:
    return np.concatenate([np.full(count, float(direction)) for direction, count in legs])


def turns_deg(*legs: tuple[float, int], lengths: dict[int, float] | None = None) -> list[tuple[int, float]]:
    """Breadcrumb and angle of the turns of a walk; some steps are shorter or longer than its paces."""
    yaw = yaws(*legs)
    step_m = np.full(len(yaw), 0.7)
    for k, length in (lengths or {}).items():
        step_m[k] *= length
    found = find_turns(trajectory(yaw, step_m))
    return [(turn.breadcrumb, round(math.degrees(turn.angle_rad), 3)) for turn in found]


def test_a_turn_is_where_the_direction_changes_and_left_is_positive() -> None:
    (turn,) = find_turns(trajectory(yaws((20.0, 12), (110.0, 20))))
    assert turn.breadcrumb == 12
    assert turn.t_s == pytest.approx(12 * 0.55)
    assert turn.angle_rad == pytest.approx(math.pi / 2)
    assert turns_deg((20.0, 12), (-70.0, 20)) == [(12, -90.0)]


def test_turns_come_in_the_order_of_the_walk() -> None:
    assert turns_deg((0.0, 10), (60.0, 15), (-20.0, 12), (-140.0, 9)) == [(10, 60.0), (25, -80.0), (37, -120.0)]


def test_thirty_degrees_make_a_turn() -> None:
    assert turns_deg((0.0, 20), (29.9, 20)) == []
    assert turns_deg((0.0, 20), (30.1, 20)) == [(20, 30.1)]
    assert math.degrees(MIN_TURN_RAD) == pytest.approx(30.0)
    walked = trajectory(yaws((0.0, 20), (40.0, 20)))
    assert find_turns(walked, math.radians(41.0)) == []
    assert len(find_turns(walked, math.radians(39.0))) == 1


def test_it_takes_three_steps_to_have_a_direction() -> None:
    assert turns_deg((0.0, 3), (90.0, 3)) == [(3, 90.0)]
    assert turns_deg((0.0, 3), (90.0, 2)) == []


def test_a_full_turn_is_none_and_angles_are_less_than_half_a_turn() -> None:
    assert turns_deg((0.0, 20), (360.0, 20)) == []
    assert turns_deg((170.0, 20), (260.0, 20)) == [(20, 90.0)]
    assert turns_deg((0.0, 20), (270.0, 20)) == [(20, -90.0)]


def test_two_turns_the_same_way_about_three_paces_are_one() -> None:
    ((at, angle),) = turns_deg((0.0, 20), (45.0, 3), (90.0, 20))
    assert 20 <= at <= 23
    assert angle == pytest.approx(90.0, abs=3.0)
    assert turns_deg((0.0, 20), (45.0, 4), (90.0, 20)) == [(20, 45.0), (24, 45.0)]


@pytest.mark.parametrize(("paces", "count"), [(3.4, 1), (3.6, 2)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_limit_between_one_and_two_is_three_and_a_half_paces(paces: float, count: int, side: float) -> None:
    lengths = dict.fromkeys((20, 21, 22), paces / 3.0)
    assert len(turns_deg((0.0, 20), (45.0 * side, 3), (90.0 * side, 20), lengths=lengths)) == count


@pytest.mark.parametrize(("paces", "count"), [(2.4, 1), (2.6, 2)])
def test_turning_about_in_two_needs_two_and_a_half_paces(paces: float, count: int) -> None:
    lengths = dict.fromkeys((20, 21, 22), paces / 3.0)
    assert len(turns_deg((0.0, 20), (90.0, 3), (180.0, 20), lengths=lengths)) == count
    assert len(turns_deg((0.0, 20), (-90.0, 3), (-179.0, 20), lengths=lengths)) == count


def test_turning_about_is_more_than_a_hundred_and_fifty_degrees() -> None:
    """A leg of three paces is too short for two turns of 74° each, long enough for two of 77°."""
    assert len(turns_deg((0.0, 20), (74.0, 3), (148.0, 20))) == 1
    assert len(turns_deg((0.0, 20), (77.0, 3), (154.0, 20))) == 2


@pytest.mark.parametrize(("paces", "count"), [(1.4, 0), (1.6, 2)])
def test_a_leg_aside_of_less_than_a_pace_and_a_half_is_a_stumble(paces: float, count: int) -> None:
    lengths = dict.fromkeys((20, 21, 22), paces / 3.0)
    assert len(turns_deg((0.0, 20), (60.0, 3), (0.0, 20), lengths=lengths)) == count


def test_of_two_turns_too_near_the_weaker_goes() -> None:
    ((at, angle),) = turns_deg((0.0, 20), (35.0, 3), (110.0, 20))
    assert at == 23
    assert angle == pytest.approx(110.0, abs=3.0)
    ((at, angle),) = turns_deg((0.0, 20), (75.0, 3), (110.0, 20))
    assert at == 20
    assert angle == pytest.approx(110.0, abs=3.0)


def test_bends_that_do_not_add_up_to_a_turn_are_left_out_one_by_one() -> None:
    assert turns_deg((0.0, 20), (20.0, 20), (0.0, 20)) == []
    assert turns_deg((0.0, 20), (90.0, 20), (115.0, 20))[0][0] == 20
    assert len(turns_deg((0.0, 20), (90.0, 20), (115.0, 20))) == 1


def test_a_walker_who_sways_needs_more_evidence() -> None:
    """Three steps 40° aside pay for themselves where steps sway by 3°, and not where they sway by 15°."""
    for sway_deg, expected in ((3.0, 2), (15.0, 0)):
        yaw = yaws((0.0, 20), (40.0, 3), (0.0, 20))
        yaw = yaw + sway_deg * np.where(np.arange(len(yaw)) % 4 < 2, 1.0, -1.0)
        assert len(find_turns(trajectory(yaw))) == expected


def changes(first: int, angle_deg: float, last: int, sway_deg: float = 0.0) -> list[int]:
    """Where the direction changes at all, of a walker who sways from step to step."""
    yaw = yaws((0.0, first), (angle_deg, last))
    yaw = yaw + sway_deg * np.where(np.arange(len(yaw)) % 2 == 0, 1.0, -1.0)
    return [turn.breadcrumb for turn in find_turns(trajectory(yaw), math.radians(0.5))]


def test_a_change_pays_three_variances_times_the_logarithm_of_the_count() -> None:
    """Of 20 and 20 steps a change by a saves 10 a² of the squares: √(3 · 3² · ln 40 / 10) = 3.16°."""
    assert changes(20, 3.10, 20) == []
    assert changes(20, 3.25, 20) == [20]
    assert changes(20, -3.25, 20) == [20]
    # of 60 and 20 steps it saves 15 a²: √(27 · ln 80 / 15) = 2.81°
    assert changes(60, 2.72, 20) == []
    assert changes(60, 2.90, 20) == [60]


def test_the_variance_is_that_of_the_change_from_step_to_step() -> None:
    """Swaying by 4° to either side is 8° from step to step: sigma 8 / (0.6745 √2) = 8.39°, to pay 8.82°."""
    assert changes(20, 8.6, 20, 4.0) == []
    assert len(changes(20, 9.1, 20, 4.0)) == 1


def test_directions_of_legs_leave_out_two_steps_at_each_turn() -> None:
    yaw = yaws((0.0, 10))
    yaw[[8, 9]] = 45.0  # already turning
    walked = trajectory(np.concatenate((yaw, yaws((60.0, 2), (90.0, 8)))))
    assert np.degrees(leg_yaws(walked, [0, 10, 20])) == pytest.approx([0.0, 90.0])


def test_the_ends_of_the_walk_are_not_left_out() -> None:
    yaw = yaws((0.0, 10))
    yaw[:2] = 90.0
    expected = math.degrees(math.atan2(2.0, 6.0))  # two steps North, six East
    walked = trajectory(np.concatenate((yaw, yaws((90.0, 8), (0.0, 2)))))
    first, last = np.degrees(leg_yaws(walked, [0, 10, 20]))
    assert first == pytest.approx(expected)
    assert last == pytest.approx(90.0 - expected)


def test_of_a_short_leg_at_least_a_step_is_left() -> None:
    walked = trajectory(yaws((0.0, 10), (50.0, 1), (80.0, 1), (120.0, 1), (170.0, 10)))
    assert math.degrees(leg_yaws(walked, [0, 10, 13, 23])[1]) == pytest.approx(80.0)
    assert math.degrees(leg_yaws(walked, [0, 10, 12, 23])[1]) == pytest.approx(65.0)
