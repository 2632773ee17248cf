"""Legs of a walk made by hand: lengths, climbs, landmarks, and how sure they are, computed on paper."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.by_hand import way_along

from fbgraph.core.config import GraphConfig
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.way_back.legs import Climb, Landmark, Leg, directions_of, leg_sigmas

EL = way_along((0.0, 0.0), (10.0, 0.0), (10.0, 6.0), t0_s=3.0)  # East, then North: 20 and 12 steps, two a second
GRAPH = GraphConfig()


def straight(z_m: FloatArray | None = None, steps: int = 40) -> Trajectory:
    way = way_along((0.0, 0.0), (0.5 * steps, 0.0))
    return way if z_m is None else replace(way, z_m=z_m)


def test_legs_lie_between_the_turns() -> None:
    way = directions_of(EL, name="el")
    assert (way.name, way.back, way.compass, way.sigma_m) == ("el", False, True, None)
    assert [leg.length_m for leg in way.legs] == pytest.approx([10.0, 6.0])
    assert [leg.yaw_rad for leg in way.legs] == pytest.approx([0.0, math.pi / 2])
    assert way.legs[0].points_m == tuple((0.5 * k, 0.0, 0.0) for k in range(21))
    assert way.legs[1].points_m[0] == (10.0, 0.0, 0.0)
    assert way.legs[1].points_m[-1] == (10.0, 6.0, 0.0)
    assert len(way.points_m) == len(set(way.points_m)) == 33
    assert way.length_m == pytest.approx(16.0)
    assert [way.remaining_m(i) for i in (0, 1)] == pytest.approx([6.0, 0.0])
    assert [way.turn_rad(i) for i in (0, 1)] == pytest.approx([0.0, math.pi / 2])


def test_the_way_back_is_the_same_legs_the_other_way() -> None:
    back = directions_of(EL).reversed()
    assert back.back
    assert [leg.length_m for leg in back.legs] == pytest.approx([6.0, 10.0])
    assert [leg.direction for leg in back.legs] == [pytest.approx((0.0, -1.0)), pytest.approx((-1.0, 0.0))]
    assert back.turn_rad(1) == pytest.approx(-math.pi / 2)
    assert back.remaining_m(0) == pytest.approx(10.0)
    assert back.points_m[0] == (10.0, 6.0, 0.0)
    assert back.points_m[-1] == (0.0, 0.0, 0.0)


def test_a_leg_turned_round_has_its_climbs_and_landmarks_turned_round() -> None:
    leg = Leg(
        points_m=((0.0, 0.0, 1.0), (5.0, 0.0, 3.5), (9.0, 0.0, 2.0)),
        direction=(0.6, -0.8),
        length_m=9.0,
        climbs=(Climb(1.0, 5.0, 2.5), Climb(6.0, 0.5, -1.5)),
        landmarks=(Landmark("door", 2.0, 7.0), Landmark("lift", 8.0, 1.0)),
        sigma_along_m=0.4,
        sigma_across_m=0.3,
    )
    back = leg.reversed()
    assert back.points_m == ((9.0, 0.0, 2.0), (5.0, 0.0, 3.5), (0.0, 0.0, 1.0))
    assert back.direction == (-0.6, 0.8)
    assert back.climbs == (Climb(0.5, 6.0, 1.5), Climb(5.0, 1.0, -2.5))
    assert back.landmarks == (Landmark("lift", 1.0, 8.0), Landmark("door", 7.0, 2.0))
    assert (back.length_m, back.sigma_along_m, back.sigma_across_m) == (9.0, 0.4, 0.3)
    assert (leg.rise_m, back.rise_m) == (1.0, -1.0)
    assert leg.yaw_rad == pytest.approx(math.atan2(-0.8, 0.6))
    assert back.reversed() == leg


def test_the_pace_is_the_median_step_unless_it_is_named() -> None:
    way = straight()
    x_m = way.x_m.copy()
    x_m[11:] += 5.0  # one long step
    assert directions_of(replace(way, x_m=x_m)).pace_m == pytest.approx(0.5)
    assert directions_of(way, pace_m=0.8).pace_m == 0.8
    assert directions_of(replace(way, x_m=np.zeros(41)), pace_m=0.8).pace_m == 0.8


@pytest.mark.parametrize("pace_m", [0.0, -1.0, math.inf, math.nan])
def test_a_pace_must_be_a_positive_number(pace_m: float) -> None:
    with pytest.raises(ConfigError, match="positive number"):
        directions_of(straight(), pace_m=pace_m)


def test_two_steps_make_a_way_and_one_does_not() -> None:
    assert directions_of(straight(steps=2)).length_m == pytest.approx(1.0)
    with pytest.raises(DataError, match=r"walk: 1 step\(s\) make no way"):
        directions_of(straight(steps=1))


def test_landmarks_are_where_their_time_was_walked() -> None:
    marks = [(10.25, "door"), (13.0, "corner"), (0.0, "early"), (15.0, "lift"), (99.0, "late")]
    first, second = directions_of(EL, marks).legs
    assert first.landmarks == (Landmark("early", 0.0, 10.0), Landmark("door", 7.25, 2.75))
    assert [mark.label for mark in second.landmarks] == ["corner", "lift", "late"]  # a corner is of the leg it begins
    assert [mark.after_m for mark in second.landmarks] == pytest.approx([0.0, 2.0, 6.0])
    assert [mark.before_m for mark in second.landmarks] == pytest.approx([6.0, 4.0, 0.0])


def test_stairs_are_where_their_middle_eight_tenths_are() -> None:
    z_m = np.interp(np.arange(41.0), (10, 30), (0.0, 4.0))  # 5 m to 15 m
    (climb,) = directions_of(straight(z_m)).legs[0].climbs
    assert climb.rise_m == pytest.approx(4.0)
    assert climb.after_m == pytest.approx(6.0, abs=1e-9)  # a tenth of 10 m behind their beginning
    assert climb.before_m == pytest.approx(6.0, abs=1e-9)


def test_a_climb_is_at_least_a_metre() -> None:
    for rise_m, count in ((0.99, 0), (1.01, 1), (-0.99, 0), (-1.01, 1)):
        z_m = np.interp(np.arange(41.0), (10, 30), (0.0, rise_m))
        assert len(directions_of(straight(z_m)).legs[0].climbs) == count


def test_up_and_down_are_two_climbs() -> None:
    z_m = np.interp(np.arange(41.0), (0, 20, 40), (1.0, 4.0, -1.0))
    up, down = directions_of(straight(z_m)).legs[0].climbs
    assert (up.rise_m, down.rise_m) == pytest.approx((3.0, -5.0))
    assert (up.after_m, down.before_m) == pytest.approx((1.0, 1.0), abs=0.51)
    assert (up.before_m, down.after_m) == pytest.approx((11.0, 11.0), abs=0.51)
    hollow = np.interp(np.arange(41.0), (0, 20, 40), (0.0, -2.0, 0.0))
    assert [climb.rise_m for climb in directions_of(straight(hollow)).legs[0].climbs] == pytest.approx([-2.0, 2.0])


def test_a_climb_within_a_step_is_a_ride() -> None:
    """No leg lifts its walker by three metres in a step; slopes before and after it are told by themselves."""
    (climb,) = directions_of(straight(np.where(np.arange(41) > 20, 3.0, 0.0))).legs[0].climbs
    assert (climb.after_m, climb.before_m) == pytest.approx((10.0, 9.5))
    assert (climb.rise_m, climb.ride) == (3.0, True)
    stairs = np.interp(np.arange(41), (0, 10, 20, 40), (0.0, -2.0, -2.0, -2.0))
    down, up = directions_of(straight(stairs + np.where(np.arange(41) > 30, 12.0, 0.0))).legs[0].climbs
    assert down.rise_m == pytest.approx(-2.0)
    assert not down.ride
    assert (up.after_m, up.rise_m, up.ride) == (15.0, 12.0, True)


def test_a_ride_seen_as_several_steps_is_one() -> None:
    z_m = np.interp(np.arange(41), (0, 20, 24, 40), (0.0, 0.0, 4.0, 4.0))
    (climb,) = directions_of(straight(z_m)).legs[0].climbs
    assert (climb.after_m, climb.before_m, climb.rise_m, climb.ride) == (10.0, 8.0, 4.0, True)
    (stairs,) = directions_of(straight(np.interp(np.arange(41), (0, 20, 32, 40), (0.0, 0.0, 4.0, 4.0)))).legs[0].climbs
    assert not stairs.ride


def test_a_climb_is_told_if_it_is_beyond_what_its_sigma_allows() -> None:
    z_m = np.interp(np.arange(41), (0, 20, 40), (0.0, 0.0, 2.0))
    for sigma_m, told in ((0.9, 1), (1.1, 0)):
        way = replace(straight(z_m), sigma_z_m=np.hypot(1.5, np.linspace(0.0, sigma_m, 41)))
        (leg,) = directions_of(way).legs
        assert leg.sigma_rise_m == pytest.approx(sigma_m)
        assert len(leg.climbs) == told
    assert directions_of(straight(z_m)).legs[0].sigma_rise_m is None


def covered(way: Trajectory, first: tuple[float, float], last: tuple[float, float], yaw_sigma: float) -> Trajectory:
    """Ellipses along the axes, growing linearly in sigma from (x, y) to (x, y)."""
    share = np.linspace(0.0, 1.0, len(way))
    cov = np.zeros((len(way), 3, 3))
    cov[:, 0, 0] = (first[0] + (last[0] - first[0]) * share) ** 2
    cov[:, 1, 1] = (first[1] + (last[1] - first[1]) * share) ** 2
    cov[:, 2, 2] = yaw_sigma**2
    return replace(way, cov_xy_yaw=cov)


TURN_M = 0.5 * math.sqrt(2.0 / 12.0)  # a turn is somewhere within a step of half a metre, at either end


def test_a_legs_doubt_is_that_of_its_steps() -> None:
    """40 steps of 0.5 m: 8 % each, 6 % of all; 5 cm sideways each, and a heading off by 0.02."""
    way = covered(straight(), (0.0, 0.0), (9.0, 9.0), 0.02)
    along, across = leg_sigmas(way, 0, 40, 0.0, GRAPH)
    assert along is not None
    assert across is not None
    steps_m, scale_m = 0.08 * 0.5 * math.sqrt(40), 0.06 * 20.0
    # the ellipses allow from 9 to 9 only: both ends are stretched to the difference
    assert along == pytest.approx(math.hypot(9.0, TURN_M))
    assert across == pytest.approx(9.0)
    wide = covered(straight(), (9.0, 9.0), (9.0, 9.0), 0.02)
    along, across = leg_sigmas(wide, 0, 40, 0.0, GRAPH)
    assert along == pytest.approx(math.hypot(steps_m, scale_m, TURN_M))
    assert across == pytest.approx(math.hypot(0.05 * math.sqrt(40), 20.0 * 0.02))


def test_it_lies_between_the_difference_and_the_sum_of_those_of_its_ends() -> None:
    small = covered(straight(), (0.1, 0.02), (0.3, 0.05), 0.02)
    assert leg_sigmas(small, 0, 40, 0.0, GRAPH) == pytest.approx((math.hypot(0.4, TURN_M), 0.07))
    shrinking = covered(straight(), (8.0, 5.0), (2.0, 1.0), 0.02)
    assert leg_sigmas(shrinking, 0, 40, 0.0, GRAPH) == pytest.approx((math.hypot(6.0, TURN_M), 4.0))


def test_along_and_across_are_those_of_the_leg_not_of_the_map() -> None:
    north = covered(way_along((0.0, 0.0), (0.0, 20.0)), (0.1, 0.02), (0.3, 0.05), 0.02)
    assert leg_sigmas(north, 0, 40, math.pi / 2, GRAPH) == pytest.approx((math.hypot(0.07, TURN_M), 0.4))
    cov = np.tile(np.array([[0.02, 0.015, 0.0], [0.015, 0.02, 0.0], [0.0, 0.0, 1e-4]]), (41, 1, 1))  # long North-East
    slanted = replace(straight(), cov_xy_yaw=cov)
    along, across = leg_sigmas(slanted, 0, 40, math.pi / 4, GRAPH)
    assert (along, across) == pytest.approx((math.hypot(2.0 * math.sqrt(0.035), TURN_M), 2.0 * math.sqrt(0.005)))


def test_what_a_slope_took_from_the_steps_is_half_in_doubt() -> None:
    """Ten steps shortened from 0.5 to 0.3 m: in doubt by half of 2 m, if they climb."""
    lengths = np.full(40, 0.5)
    lengths[10:20] = 0.3
    x_m = np.concatenate(([0.0], np.cumsum(lengths)))
    flat = covered(replace(straight(), x_m=x_m), (9.0, 9.0), (9.0, 9.0), 0.0)
    steps_m = 0.08 * math.sqrt(30 * 0.25 + 10 * 0.09)
    along, _ = leg_sigmas(flat, 0, 40, 0.0, GRAPH)
    assert along == pytest.approx(math.hypot(steps_m, 0.06 * 18.0, TURN_M))
    for rise_m, slope_m in ((0.029, 0.0), (0.031, 1.0), (-0.031, 1.0)):
        z_m = rise_m * np.clip(np.arange(41) - 10.0, 0.0, 10.0)
        along, _ = leg_sigmas(replace(flat, z_m=z_m), 0, 40, 0.0, GRAPH)
        assert along == pytest.approx(math.hypot(steps_m, 0.06 * 18.0, slope_m, TURN_M))
    longer = replace(flat, z_m=0.1 * np.arange(41.0))  # 30 steps climb too, but were not shortened
    assert leg_sigmas(longer, 0, 40, 0.0, GRAPH)[0] == pytest.approx(math.hypot(steps_m, 0.06 * 18.0, 1.0, TURN_M))


def test_only_the_legs_own_steps_count() -> None:
    cov = np.zeros((33, 3, 3))
    cov[:, 0, 0] = cov[:, 1, 1] = 81.0
    cov[:20, 2, 2], cov[20, 2, 2], cov[21:, 2, 2] = 0.04**2, 0.1**2, 0.02**2
    first, second = directions_of(replace(EL, cov_xy_yaw=cov), graph=GRAPH).legs
    assert first.sigma_along_m == pytest.approx(math.hypot(0.04 * math.sqrt(20), 0.6, TURN_M))
    assert first.sigma_across_m == pytest.approx(math.hypot(0.05 * math.sqrt(20), 0.5 * (19 * 0.04 + 0.1)))
    assert second.sigma_along_m == pytest.approx(math.hypot(0.04 * math.sqrt(12), 0.36, TURN_M))
    assert second.sigma_across_m == pytest.approx(math.hypot(0.05 * math.sqrt(12), 6.0 * 0.02))


def test_nothing_is_said_without_covariance_or_weights() -> None:
    way = covered(straight(), (0.1, 0.1), (0.3, 0.4), 0.02)
    assert leg_sigmas(way, 0, 40, 0.0, None) == (None, None)
    assert leg_sigmas(straight(), 0, 40, 0.0, GRAPH) == (None, None)
    assert way.cov_xy_yaw is not None
    for at in ((0, 0, 0), (40, 1, 1), (40, 0, 1), (0, 2, 2)):
        broken = way.cov_xy_yaw.copy()
        broken[at] = math.nan
        assert leg_sigmas(replace(way, cov_xy_yaw=broken), 0, 40, 0.0, GRAPH) == (None, None)
    unused = way.cov_xy_yaw.copy()
    unused[:, 0, 2] = math.nan  # between place and yaw: not in the run folder
    assert leg_sigmas(replace(way, cov_xy_yaw=unused), 0, 40, 0.0, GRAPH)[0] is not None


def test_the_ways_own_doubt_is_of_both_its_ends() -> None:
    way = directions_of(covered(straight(), (0.3, 0.4), (0.6, 0.8), 0.02))
    assert way.sigma_m == pytest.approx(0.5 + 1.0)
    assert directions_of(straight()).sigma_m is None
