"""The way back matched to a straight way out: distances, sides and limits that can be told on paper."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from fbgraph.core.config import ReturnConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.way_back.matcher import RouteMatcher
from fbgraph.way_back.records import Match
from fbgraph.way_back.way_out import Outbound

EAST, NORTH, WEST, SOUTH = 0.0, math.pi / 2, math.pi, -math.pi / 2
NO_FIELD = (math.nan, math.nan)
RELYING_ON_STEPS: dict[str, Any] = {"sigma_pull_m": 1e6, "drift_m": 1e-6}  # dead reckoning as if it never drifted


def outbound(steps: int = 120, heading_rad: float = EAST, **columns: FloatArray) -> Outbound:
    """A straight way out in steps of half a metre."""
    at_m = 0.5 * np.arange(steps + 1.0)
    unknown = np.full(steps + 1, math.nan)
    usual: dict[str, FloatArray] = {
        "t_s": 0.5 * np.arange(steps + 1.0),
        "route_m": at_m,
        "level_m": at_m,
        "x_m": at_m * math.cos(heading_rad),
        "y_m": at_m * math.sin(heading_rad),
        "mag_up_ut": unknown,
        "mag_level_ut": unknown,
        "altitude_m": unknown,
    }
    return Outbound(**(usual | columns))


def walked(matcher: RouteMatcher, *legs: tuple[float, int], length_m: float = 0.5) -> list[Match]:
    """Matches of so many steps in each direction."""
    return [
        matcher.advance(length_m, length_m, yaw_rad, NO_FIELD, math.nan)
        for yaw_rad, count in legs
        for _ in range(count)
    ]


def made(out: Outbound | None = None, **config: Any) -> RouteMatcher:
    return RouteMatcher(out or outbound(), ReturnConfig(**config))


@pytest.mark.parametrize("heading_rad", [EAST, NORTH, 2.5, -1.0])
def test_walking_back_brings_the_start_nearer_by_every_step(heading_rad: float) -> None:
    matches = walked(made(outbound(heading_rad=heading_rad)), (heading_rad + math.pi, 110))
    steps_m = np.diff([match.route_m for match in matches])
    assert matches[0].route_m == pytest.approx(59.5, abs=1.0)
    assert steps_m[:90] == pytest.approx(-0.5, abs=0.1)
    assert matches[-1].route_m == pytest.approx(5.0, abs=1.0)
    for match in matches:
        assert match.facing_back
        assert not match.off_route
        assert match.breadcrumb == pytest.approx(2.0 * match.route_m, abs=0.51)
        assert match.cross_m == pytest.approx(0.0, abs=1e-6)


def test_walking_out_again_is_not_facing_back() -> None:
    matches = walked(made(), (WEST, 40), (EAST, 20))
    assert [match.facing_back for match in matches] == [True] * 40 + [False] * 20
    assert matches[-1].route_m - matches[39].route_m == pytest.approx(10.0, abs=1.0)


@pytest.mark.parametrize(("yaw_rad", "side"), [(SOUTH, 1.0), (NORTH, -1.0)])
def test_left_is_left_as_seen_walking_back(yaw_rad: float, side: float) -> None:
    """The way back leads West: South of it is to the left."""
    matches = walked(made(**RELYING_ON_STEPS), (WEST, 20), (yaw_rad, 6))
    assert [match.cross_m for match in matches[20:]] == pytest.approx([side * 0.5 * i for i in range(1, 7)], abs=0.02)


def test_the_corridor_ends_at_its_width_and_two_sigma_of_place() -> None:
    """Half a metre of doubt at the turn-back: 2.5 m + 2 · 0.5 m."""
    for yaw_rad in (NORTH, SOUTH):
        matches = walked(made(**RELYING_ON_STEPS), (yaw_rad, 12), length_m=0.4)
        assert [match.off_route for match in matches] == [0.4 * i > 3.5 for i in range(1, 13)]
    narrow = walked(made(corridor_m=1.0, **RELYING_ON_STEPS), (NORTH, 8), length_m=0.4)
    assert [match.off_route for match in narrow] == [0.4 * i > 2.0 for i in range(1, 9)]


def test_doubt_grows_with_the_square_root_of_the_distance() -> None:
    """After s metres the corridor ends at 2.5 m + 2 √(0.25 + 0.5² s): at 7 m it is 5.5 m, at 5.2 m 4.99 m."""
    matches = walked(made(sigma_pull_m=1e6, drift_m=0.5), (NORTH, 12), length_m=0.4)
    expected = [0.4 * i > 2.5 + 2.0 * math.sqrt(0.25 + 0.25 * 0.4 * i) for i in range(1, 13)]
    assert [match.off_route for match in matches] == expected
    assert expected == [False] * 12
    more = walked(made(sigma_pull_m=1e6, drift_m=0.5), (NORTH, 20), length_m=0.4)
    assert [match.off_route for match in more].index(True) == 12


def test_who_is_off_the_route_is_told_how_far_and_where_it_lies() -> None:
    matches = walked(made(**RELYING_ON_STEPS), (WEST, 40), (NORTH, 20))
    off = [match for match in matches if match.off_route]
    assert len(off) == 13  # from 4 m on
    for i, match in enumerate(off):
        assert match.cross_m == pytest.approx(-(4.0 + 0.5 * i), abs=0.05)
        assert abs(match.bearing_rad) > 3.0  # behind who walks away from it
    along = walked(made(**RELYING_ON_STEPS), (WEST, 40), (NORTH, 12), (WEST, 4))[-1]
    assert along.off_route
    assert along.bearing_rad == pytest.approx(math.pi / 2, abs=0.1)  # to the left: South of who walks West
    mirrored = walked(made(**RELYING_ON_STEPS), (WEST, 40), (SOUTH, 12), (WEST, 4))[-1]
    assert mirrored.bearing_rad == pytest.approx(-math.pi / 2, abs=0.1)
    assert mirrored.cross_m == pytest.approx(6.0, abs=0.1)


def test_the_route_is_met_again_after_two_metres_and_a_half_along_it() -> None:
    legs = ((WEST, 40), (NORTH, 12), (SOUTH, 12), (WEST, 10))
    matches = walked(made(**RELYING_ON_STEPS), *legs)
    assert [match.off_route for match in matches[63:]] == [True] * 5 + [False] * 6
    assert matches[-1].route_m == pytest.approx(60.0 - 0.5 * 50, abs=1.5)


def test_a_shortcut_meets_the_route_where_it_is_met() -> None:
    legs = ((WEST, 20), (NORTH, 12), (WEST, 40), (SOUTH, 12), (WEST, 16))
    matches = walked(made(**RELYING_ON_STEPS), *legs)
    assert matches[60].off_route
    assert not matches[-1].off_route
    assert matches[-1].route_m == pytest.approx(60.0 - 0.5 * 76, abs=1.5)


def test_how_far_it_was_followed_counts_from_where_doubt_ends() -> None:
    matches = walked(made(closure_doubt_m=5.0), (WEST, 10), (EAST, 2), (WEST, 3))
    expected = [0.5 * i for i in range(1, 11)] + [0.0, 0.0] + [0.5, 1.0, 1.5]
    assert [match.steady_m for match in matches] == pytest.approx(expected)
    unsure = walked(made(closure_doubt_m=0.05), (WEST, 10))
    assert [match.steady_m for match in unsure] == [0.0] * 10


def test_fifty_degrees_aside_are_no_longer_along() -> None:
    for degrees, steady in ((48.0, True), (-48.0, True), (52.0, False), (-52.0, False)):
        matches = walked(made(closure_doubt_m=5.0, **RELYING_ON_STEPS), (WEST, 10), (WEST + math.radians(degrees), 1))
        assert (matches[-1].steady_m > 0.0) == steady


def test_doubt_along_the_route_grows_over_a_silence() -> None:
    matcher = made()
    before = walked(matcher, (WEST, 40))[-1]
    after = matcher.advance(0.5, 0.5, WEST, NO_FIELD, math.nan, 1.5)
    assert after.sigma_m == pytest.approx(math.hypot(before.sigma_m, 1.5), abs=0.35)
    longer = made()
    walked(longer, (WEST, 40))
    assert longer.advance(0.5, 0.5, WEST, NO_FIELD, math.nan, 6.0).sigma_m > 2.5


def test_the_drift_of_a_gyroscope_is_followed_up_to_twenty_degrees() -> None:
    """Directions that are 15° off all along the way back are taken for straight; 40° are not."""
    matches = walked(made(), (WEST + math.radians(15.0), 100))
    assert not [match for match in matches if match.off_route]
    assert abs(matches[-1].cross_m) < 2.0
    assert matches[-1].route_m == pytest.approx(60.0 - 50.0, abs=2.0)
    assert [match for match in walked(made(), (WEST + math.radians(40.0), 60)) if match.off_route]


def field_of_route(steps: int = 120) -> tuple[FloatArray, FloatArray]:
    """A field of its own every metre: what steps 1, 2, … going out say, the middle of each."""
    middle_m = 0.5 * (np.arange(steps + 1) - 0.5)
    return 40.0 + 6.0 * np.sin(middle_m / 1.3), 20.0 + 6.0 * np.cos(middle_m / 1.7)


def walked_with_field(
    skipped: int = 0, shift_ut: Sequence[float] = (0.0, 0.0), heights: bool = False, **config: Any
) -> list[tuple[float, Match]]:
    """Half the way back, some steps of it never seen, and where each step really ended."""
    up, level = field_of_route()
    heights_m = np.interp(np.arange(121), (40, 80), (0.0, 6.0)) if heights else np.full(121, math.nan)
    unknown = np.full(121, math.nan)
    out = outbound(altitude_m=heights_m, mag_up_ut=unknown if heights else up, mag_level_ut=level)
    matcher, found = made(out, **config), []
    for k in range(120, 30, -1):  # the step from breadcrumb k to k - 1 is what step k was
        if 110 >= k > 110 - skipped:
            continue
        field = NO_FIELD if heights else (float(up[k]) + shift_ut[0], float(level[k]) + shift_ut[1])
        match = matcher.advance(0.5, 0.5, WEST, field, float(heights_m[k]))
        found.append((0.5 * (k - 1), match))
    return found


def test_the_field_says_where_on_the_route_it_is() -> None:
    for true_m, match in walked_with_field()[10:]:
        assert match.route_m == pytest.approx(true_m, abs=0.2)
        assert match.sigma_m < 0.5


def test_steps_that_were_missed_are_found_missing_by_the_field() -> None:
    """Two metres walked unseen: without a field they stay unknown, with one they do not."""
    for true_m, match in walked_with_field(4)[-10:]:
        assert match.route_m == pytest.approx(true_m, abs=0.1)
    blind = walked(made(), (WEST, 86))[-1]
    assert blind.route_m - 15.0 == pytest.approx(2.0, abs=1.0)


def test_the_devices_own_horizontal_field_is_learnt() -> None:
    """A device turned about adds another constant to the horizontal field; the vertical one knows no such excuse."""
    for true_m, match in walked_with_field(shift_ut=(0.0, 8.0))[30:]:
        assert match.route_m == pytest.approx(true_m, abs=0.25)


def test_the_horizontal_field_alone_says_where_it_is_once_the_devices_own_is_learnt() -> None:
    """Sixty steps to learn 8 µT; then two metres are walked unseen."""
    _, level = field_of_route()
    matcher = made(outbound(mag_up_ut=np.full(121, 40.0), mag_level_ut=level))
    for k in [*range(120, 60, -1), *range(56, 20, -1)]:
        match = matcher.advance(0.5, 0.5, WEST, (40.0, float(level[k]) + 8.0), math.nan)
    assert match.route_m == pytest.approx(10.0, abs=0.3)
    assert match.sigma_m < 0.8


RAMP = 0.5 * np.arange(241.0)  # a quantity that grows by one every metre of 120 m
SAMPLES_M = np.arange(0.0, 120.0, 0.01)


def spread_of_one_look(scale_m: float, power: float, at_m: float) -> float:
    """What is left of not knowing, give or take 20 m, after one look at a ramp: a heavy tail of three degrees.

    The spread within 3 m of the peak (to the middle between bins), and 3 m of what lies further away.
    """
    before = np.exp(-0.5 * ((SAMPLES_M - 120.0) / 20.0) ** 2)
    after = before * (1.0 + ((SAMPLES_M - at_m) / scale_m) ** 2 / 3.0) ** (-2.0 * power)
    after /= after.sum()
    near = np.abs(SAMPLES_M - SAMPLES_M[np.argmax(after)]) <= 3.125
    mass = float(after[near].sum())
    mean_m = float(after[near] @ SAMPLES_M[near]) / mass
    return math.sqrt(float(after[near] @ (SAMPLES_M[near] - mean_m) ** 2) / mass) + 3.0 * (1.0 - mass)


@pytest.mark.parametrize(
    ("quantity", "level_m", "power"),
    [
        ("field", 0.5, 0.5 / 0.65 * (0.5 + 0.25)),  # the vertical half, the horizontal a quarter, by share of a step
        ("field", 1.3, 1.5 * (0.5 + 0.25)),  # at most one and a half
        ("vertical", 0.5, 0.5 / 0.65 * 0.5),
        ("altitude", 0.5, 0.2),
    ],
)
def test_how_much_one_look_tells(quantity: str, level_m: float, power: float) -> None:
    flat = np.zeros(241)
    out = outbound(
        240,
        mag_up_ut=np.full(241, math.nan) if quantity == "altitude" else RAMP,
        mag_level_ut={"field": RAMP, "vertical": flat}.get(quantity, np.full(241, math.nan)),
        altitude_m=RAMP if quantity == "altitude" else np.full(241, math.nan),
    )
    matcher = made(out, sigma_mag_ut=1.0, sigma_altitude_m=1.0, sigma_place_m=1e6)
    field = NO_FIELD if quantity == "altitude" else (100.0, 100.0 if quantity == "field" else 0.0)
    match = matcher.advance(0.01, level_m, WEST, field, 100.0 if quantity == "altitude" else math.nan, 60.0)
    assert match.sigma_m == pytest.approx(spread_of_one_look(1.0, power, match.route_m), rel=0.02)


def test_stairs_say_where_on_the_route_it_is() -> None:
    found = walked_with_field(4, heights=True)
    for true_m, match in found:
        if 41.0 < true_m < 50.0:
            assert match.route_m == pytest.approx(true_m + 2.0, abs=0.8)
        elif true_m < 30.0:
            assert match.route_m == pytest.approx(true_m, abs=0.9)
