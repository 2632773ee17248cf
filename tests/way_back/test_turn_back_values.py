"""When a walk has turned back: half-metre steps along a line and back, each limit on both of its sides."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.by_hand import HALF_A_METRE, steps_of, way_along

from fbgraph.core.config import ReturnConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.records import Crumb, TurnBack
from fbgraph.way_back.turn_back import TurnBackDetector, find_turn_back, reversal

OUT, STEP_M = 60, 0.5  # 30 m out


def there_and_back(
    back: int = 40,
    aside_m: float = 0.0,
    off_deg: float = 0.0,
    rise_m: float = 0.0,
    wrong: int = 0,
    slope: float = 0.0,
    lost_m: float = 0.0,
) -> list[Crumb]:
    """East for 30 m, then West in a lane ``aside_m`` away, facing ``off_deg`` aside, ``rise_m`` higher.

    The whole way has a slope; at the turn some metres may be lost to the count.

    The first ``wrong`` steps of the way back are made facing 55° aside.
    """
    found = []
    for k in range(OUT + back + 1):
        yaw = math.pi + math.radians(55.0 if k <= OUT + wrong else off_deg) if k > OUT else 0.0
        x_m = STEP_M * k if k <= OUT else STEP_M * (2 * OUT - k) - lost_m
        y_m, z_m = (aside_m, rise_m) if k > OUT else (0.0, 0.0)
        found.append(Crumb(0.5 * k, x_m, y_m, z_m + slope * x_m, yaw, STEP_M * k))
    return found


def noticed(crumbs: list[Crumb], retraced_m: float = 12.0) -> TurnBack | None:
    detector = TurnBackDetector(retraced_m)
    return next((found for crumb in crumbs if (found := detector.advance(crumb))), None)


@pytest.mark.parametrize("retraced_m", [8.0, 12.0])
def test_it_is_known_once_so_much_was_walked_back(retraced_m: float) -> None:
    found = noticed(there_and_back(), retraced_m)
    assert found is not None
    assert OUT - 4 <= found.breadcrumb <= OUT
    assert found.t_s == 0.5 * found.breadcrumb
    walked_back_m = STEP_M * (found.known_s / 0.5 - found.breadcrumb)
    assert retraced_m <= walked_back_m <= retraced_m + 1.0
    assert noticed(there_and_back(back=int(2 * retraced_m) - 8), retraced_m) is None


def test_the_way_out_must_be_as_long_as_what_is_walked_back() -> None:
    crumbs = there_and_back()
    for first in (OUT - 30, OUT - 16):
        part = [Crumb(c.t_s, c.x_m, c.y_m, c.z_m, c.yaw_rad, c.walked_m - STEP_M * first) for c in crumbs[first:]]
        assert (noticed(part) is not None) == (first == OUT - 30)


def in_field(crumbs: list[Crumb], other: bool = False, device_ut: float = 0.0) -> list[Crumb]:
    """The same in a field that varies along x; ``other`` on the way back, where the device adds its own."""
    found = []
    for k, c in enumerate(crumbs):
        added_ut = device_ut if k > OUT else 0.0
        along = c.x_m / 1.1 - (c.x_m / 7.0) ** 2 if other and k > OUT else c.x_m / 2.0 + (c.x_m / 11.0) ** 2
        down, level, across = (6.0 * np.sin(along + np.arange(3.0))).tolist()
        found.append(replace(c, down_ut=40.0 + down, level_ut=20.0 + level + added_ut, across_ut=across + added_ut))
    return found


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_without_a_field_a_way_a_metre_beside_is_another(side: float) -> None:
    assert noticed(there_and_back(aside_m=0.9 * side)) is not None
    assert noticed(there_and_back(aside_m=1.2 * side)) is None


@pytest.mark.parametrize("aside_m", [1.5, -1.5, 3.0, -3.0])
def test_the_field_tells_a_corridor_from_a_lane(aside_m: float) -> None:
    """The same field on the way back, or another."""
    crumbs = there_and_back(aside_m=aside_m)
    assert noticed(in_field(crumbs)) is not None
    assert noticed(in_field(crumbs, other=True)) is None


def test_twelve_metres_beside_is_another_way_whatever_the_field() -> None:
    assert noticed(in_field(there_and_back(aside_m=12.0))) is None


def test_what_the_device_adds_to_the_horizontal_field_is_no_difference() -> None:
    assert noticed(in_field(there_and_back(aside_m=2.0), device_ut=15.0)) is not None


def test_a_field_that_hardly_varies_says_little() -> None:
    """A lane beside stays as likely as it was: half a microtesla is the sensor's noise."""
    for aside_m, there in ((0.5, True), (2.5, False)):
        quiet = [
            replace(c, down_ut=40.0, level_ut=20.0, across_ut=0.1 * (k % 3))
            for k, c in enumerate(there_and_back(aside_m=aside_m))
        ]
        assert (noticed(quiet) is not None) == there


def test_who_drifts_away_at_last_has_left_the_way_out() -> None:
    for last_m, there in ((1.0, True), (4.0, False)):
        crumbs = [replace(c, y_m=last_m if k > OUT + 14 else 0.0) for k, c in enumerate(there_and_back(back=24))]
        assert (noticed(crumbs) is not None) == there


def test_another_floor_is_another_way() -> None:
    assert noticed(there_and_back(rise_m=1.1)) is not None
    assert noticed(there_and_back(rise_m=-1.1)) is not None
    assert noticed(there_and_back(rise_m=1.3)) is None


def test_who_walks_back_faces_back() -> None:
    for off_deg, there in ((14.0, True), (-14.0, True), (24.0, False), (-24.0, False), (180.0, False)):
        assert (noticed(there_and_back(off_deg=off_deg)) is not None) == there


def test_few_steps_may_face_elsewhere() -> None:
    assert [noticed(there_and_back(back=24, wrong=wrong)) is not None for wrong in (1, 2, 5, 8)] == [
        True,
        True,
        False,
        False,
    ]


def test_on_a_slope_the_same_place_is_at_the_same_height() -> None:
    assert noticed(there_and_back(slope=0.4)) is not None
    assert noticed(there_and_back(slope=0.4, rise_m=3.0)) is None
    assert noticed(there_and_back(slope=-0.4, rise_m=-3.0)) is None


def test_a_few_metres_may_be_lost_in_turning() -> None:
    assert [noticed(there_and_back(lost_m=lost_m)) is not None for lost_m in (3.0, 8.0, 29.0)] == [True, True, False]


@pytest.mark.parametrize(
    ("corners", "rise_m"),
    [
        (((0.0, 0.0), (30.0, 0.0), (30.0, 3.0), (5.0, 3.0)), 0.0),
        (((0.0, 0.0), (0.0, 30.0), (3.0, 30.0), (3.0, 5.0)), 0.0),
        (((0.0, 0.0), (30.0, 0.0), (5.0, 0.0)), 2.0),
    ],
)
def test_another_lane_or_floor_of_a_whole_walk_is_another_way(
    corners: tuple[tuple[float, float], ...], rise_m: float
) -> None:
    way = way_along(*corners)
    way = replace(way, z_m=np.where(np.arange(len(way)) > OUT, rise_m, 0.0))
    track = StepTrack(steps_of(way))
    assert find_turn_back(way, track, HALF_A_METRE, ReturnConfig()) is None
    on_the_way = way_along(corners[0], corners[1], (corners[-1][0] * (corners[1][0] > 0), 5.0 * (corners[1][1] > 0)))
    assert find_turn_back(on_the_way, StepTrack(steps_of(on_the_way)), HALF_A_METRE, ReturnConfig()) is not None


def test_going_on_is_not_turning_back() -> None:
    assert noticed([Crumb(0.5 * k, 0.5 * k, 0.0, 0.0, 0.0, 0.5 * k) for k in range(150)]) is None


def test_a_whole_walk_is_searched_with_its_own_columns() -> None:
    way = way_along((0.0, 0.0), (30.0, 0.0), (10.0, 0.0), t0_s=7.0)
    track = StepTrack(steps_of(way))
    found = find_turn_back(way, track, HALF_A_METRE, ReturnConfig())
    by_crumb = noticed(there_and_back(), ReturnConfig().retraced_m)
    assert found is not None
    assert by_crumb is not None
    assert found == TurnBack(by_crumb.breadcrumb, by_crumb.t_s + 7.0, by_crumb.known_s + 7.0)
    far = ReturnConfig(retraced_m=25.0)
    assert find_turn_back(way, track, HALF_A_METRE, far) is None


def columns(back: int, aside_m: float = 0.0, scale: float = 1.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    crumbs = there_and_back(back, aside_m)
    xyz = np.array([(c.x_m, c.y_m, c.z_m) for c in crumbs])
    return scale * xyz, np.array([c.yaw_rad for c in crumbs]), scale * np.array([c.walked_m for c in crumbs])


@pytest.mark.parametrize("back", [3, 5, 10, 20, 29])
def test_who_says_so_late_turned_where_the_way_reverses(back: int) -> None:
    assert reversal(*columns(back), 1.5) == OUT


@pytest.mark.parametrize("back", [0, 1, 2, 40])
def test_who_says_so_at_once_or_much_later_begins_there(back: int) -> None:
    assert reversal(*columns(back), 1.5) == OUT + back


@pytest.mark.parametrize("back", [31, 32, 33])
def test_nobody_looks_further_back_than_fifteen_metres(back: int) -> None:
    assert reversal(*columns(back), 1.5) == OUT + back - 30


def test_a_metre_and_a_fifth_back_may_be_a_reversal() -> None:
    assert reversal(*columns(5, scale=0.49), 1.5) == OUT  # steps of 0.245 m
    assert reversal(*columns(5, scale=0.47), 1.5) == OUT + 5


def test_a_way_apart_is_no_reversal() -> None:
    assert reversal(*columns(10, 1.4), 1.5) < OUT + 10
    assert reversal(*columns(10, 1.8), 1.5) == OUT + 10


def test_who_has_just_left_the_way_out_has_not_reversed() -> None:
    """Its last two metres and a half count two thirds, whatever the mean."""
    for aside_m, there in ((2.2, True), (2.4, False)):
        xyz_m, yaw_rad, walked_m = columns(12)
        xyz_m[-5:, 1] = aside_m
        assert (reversal(xyz_m, yaw_rad, walked_m, 1.5) < OUT + 12) == there
