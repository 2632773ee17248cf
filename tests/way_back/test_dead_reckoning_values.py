"""Dead reckoning beside the way out: how far the wearer is from it, step by step, by formulae of a line or two."""

import math
from typing import Any

import numpy as np
import pytest

from fbgraph.core.config import ReturnConfig
from fbgraph.way_back.matcher import RouteMatcher
from fbgraph.way_back.records import Match
from fbgraph.way_back.way_out import Outbound

NORTH, WEST, SOUTH = math.pi / 2, math.pi, -math.pi / 2
RELYING_ON_STEPS: dict[str, Any] = {"sigma_pull_m": 1e6, "drift_m": 1e-6}


def made(**config: Any) -> RouteMatcher:
    """A straight way of 60 m East, walked in steps of half a metre."""
    at_m, unknown = 0.5 * np.arange(121.0), np.full(121, math.nan)
    return RouteMatcher(
        Outbound(at_m, at_m, at_m, at_m, np.zeros(121), unknown, unknown, unknown), ReturnConfig(**config)
    )


def step(matcher: RouteMatcher, length_m: float, yaw_rad: float, gap_s: float = 0.0) -> Match:
    return matcher.advance(length_m, length_m, yaw_rad, (math.nan, math.nan), math.nan, gap_s)


def left_after_m(step_m: float, gap_s: float = 0.0, **config: Any) -> float:
    """How far to the North the wearer gets before being off the route."""
    matcher = made(**(RELYING_ON_STEPS | config))
    for count in range(1, 200):
        if step(matcher, step_m, NORTH, gap_s if count == 1 else 0.0).off_route:
            return step_m * count
    raise AssertionError("never off the route")


def test_half_a_metre_is_in_doubt_at_the_turn_back() -> None:
    assert left_after_m(0.06) == pytest.approx(3.54)  # the first beyond 2.5 m + 2 · 0.5 m


@pytest.mark.parametrize(("gap_s", "sigma_m"), [(1.0, 1.0), (3.0, 3.0), (20.0, 20.0), (60.0, 20.0)])
def test_a_silence_adds_a_metre_a_second_up_to_twenty(gap_s: float, sigma_m: float) -> None:
    bound_m = 2.5 + 2.0 * math.sqrt(0.25 + sigma_m**2)
    step_m = bound_m / 50.5
    assert left_after_m(step_m, gap_s) == pytest.approx(51 * step_m)


def test_the_drift_of_a_step_is_by_its_length() -> None:
    for step_m in (0.1, 0.3):
        expected = next(n for n in range(1, 200) if n * step_m > 2.5 + 2.0 * math.sqrt(0.25 + 0.04 * n * step_m))
        assert left_after_m(step_m, drift_m=0.2) == pytest.approx(expected * step_m)


def test_the_route_pulls_by_the_share_of_what_is_in_doubt() -> None:
    """Six half metres South; each time the place is drawn back by v / (v + 2.5²), and so is its variance v."""
    matcher, variance, off_m = made(), 0.25, 0.0
    for _ in range(6):
        variance += 0.12**2 * 0.5
        off_m += 0.5
        assert step(matcher, 0.5, SOUTH).cross_m == pytest.approx(off_m, abs=1e-9)
        gain = variance / (variance + 2.5**2)
        off_m *= 1.0 - gain
        variance *= 1.0 - gain


@pytest.mark.parametrize("off_deg", [15.0, -15.0])
def test_directions_are_turned_into_the_routes_within_twenty_five_metres(off_deg: float) -> None:
    """Of what a direction is off, each half metre takes a fiftieth."""
    matcher, off_m, off_rad = made(**RELYING_ON_STEPS), 0.0, math.radians(off_deg)
    for _ in range(38):
        match = step(matcher, 0.5, WEST + math.radians(off_deg))
        off_m += 0.5 * math.sin(off_rad)
        off_rad *= 1.0 - 0.5 / 25.0
        assert match.cross_m == pytest.approx(off_m, abs=1e-6)


@pytest.mark.parametrize(("off_deg", "turned"), [(18.0, True), (-18.0, True), (22.0, False), (-22.0, False)])
def test_more_than_twenty_degrees_are_no_drift(off_deg: float, turned: bool) -> None:
    matcher = made(**RELYING_ON_STEPS)
    straight_m = [0.5 * (i + 1) * math.sin(math.radians(off_deg)) for i in range(8)]
    found_m = [step(matcher, 0.5, WEST + math.radians(off_deg)).cross_m for _ in range(8)]
    assert (abs(found_m[-1] - straight_m[-1]) > 0.05) == turned


def test_the_route_is_met_again_after_two_metres_and_a_half_along_it() -> None:
    matcher = made(**RELYING_ON_STEPS)
    for yaw_rad, count in ((WEST, 20), (NORTH, 14), (SOUTH, 14)):
        off = [step(matcher, 0.5, yaw_rad).off_route for _ in range(count)]
    assert off[-1]
    assert [step(matcher, 0.3, WEST).off_route for _ in range(10)] == [True] * 8 + [False] * 2


def test_the_side_and_bearing_of_a_near_route_are_told_too() -> None:
    matcher = made(**RELYING_ON_STEPS)
    for _ in range(20):
        step(matcher, 0.5, WEST)
    for _ in range(4):
        match = step(matcher, 0.5, SOUTH)
    assert not match.off_route
    assert match.cross_m == pytest.approx(2.0, abs=1e-6)
    assert abs(match.bearing_rad) == pytest.approx(math.pi, abs=0.15)  # straight behind
    turned = step(matcher, 1e-6, WEST)
    assert turned.bearing_rad == pytest.approx(-math.pi / 2, abs=0.15)  # North is to the right of who faces West
