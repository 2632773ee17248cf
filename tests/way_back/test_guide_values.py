"""The way back told step by step, on a walk of half-metre steps whose every answer is known."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from support.by_hand import HALF_A_METRE, crumb_of, steps_of, way_along

from fbgraph.core.config import Config, ReturnConfig
from fbgraph.core.sensor_log import Event
from fbgraph.core.trajectory import Trajectory
from fbgraph.way_back.guide import ReturnGuide

# 20 m East, 10 m North and back: breadcrumb 40 is the corner, 60 the end of the way out, 120 the start again
WAY = way_along((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (20.0, 0.0), (0.0, 0.0), t0_s=2.0)


def walked(
    at: str, way: Trajectory = WAY, events: Sequence[Event] = (), early: bool = False, **returning: Any
) -> ReturnGuide:
    """A guide that has been told every step; its field, different every metre, tells where it was walked."""
    config = Config(step_length=HALF_A_METRE, returning=ReturnConfig(at=at, **returning))
    guide = ReturnGuide(config)
    middle = np.arange(len(way)) - 0.5  # what a step says is the mean over it
    field = 50.0 + 8.0 * np.sin(np.minimum(middle, 120.0 - middle) * 0.5 / 1.5)
    steps = steps_of(way, mag_norm_ut=field, mag_dip_rad=np.full(len(way), 1.0))
    for k, step in enumerate(steps):
        guide.note(
            [event for event in events if (early and k == 0) or (not early and step.start_s < event.t_s <= step.t_s)]
        )
        guide.advance(crumb_of(way, k), step, partial(way.until, k))
    return guide


@pytest.fixture(scope="module")
def guide() -> ReturnGuide:
    return walked("32.2")  # a little after breadcrumb 60, dropped at 32 s


def test_the_way_back_begins_with_the_first_step_after_its_time(guide: ReturnGuide) -> None:
    assert guide.turn_back is not None
    assert (guide.turn_back.breadcrumb, guide.turn_back.t_s, guide.turn_back.known_s) == (60, 32.0, 32.5)
    assert [update.k for update in guide.updates] == list(range(61, 121))
    assert [update.t_s for update in guide.updates] == [2.0 + 0.5 * k for k in range(61, 121)]
    assert guide.outbound is not None
    np.testing.assert_allclose(guide.outbound.route_m, 0.5 * np.arange(61))


def test_what_is_left_is_what_was_not_yet_walked_back(guide: ReturnGuide) -> None:
    for update in guide.updates[4:]:
        assert update.remaining_m == pytest.approx(0.5 * (120 - update.k), abs=0.25)
        assert update.sigma_m < 0.6


def test_the_breadcrumb_is_the_one_there(guide: ReturnGuide) -> None:
    for update in guide.updates:
        assert update.breadcrumb == pytest.approx(update.remaining_m / 0.5, abs=0.5 + 1e-9)
        assert update.route_m == pytest.approx(0.5 * update.breadcrumb)
        assert update.breadcrumb_t_s == 2.0 + 0.5 * update.breadcrumb


def test_the_next_turn_is_the_corner_the_other_way_round(guide: ReturnGuide) -> None:
    before = [update for update in guide.updates if update.remaining_m > 20.5]
    after = [update for update in guide.updates if update.remaining_m <= 20.5]
    assert min(len(before), len(after)) > 15
    for update in before:
        assert update.next_turn_m == pytest.approx(update.remaining_m - 20.0)
        assert update.next_turn_rad == pytest.approx(-math.pi / 2, abs=0.01)  # out a left turn, back a right one
    assert {(update.next_turn_m, update.next_turn_rad) for update in after} == {(None, None)}


def test_sides_are_those_of_the_way_back() -> None:
    """A corner to the left on the way out is one to the right on the way back."""
    left = walked("32.2")
    assert left.updates[5].next_turn_rad is not None
    mirrored = walked("32.2", replace(WAY, y_m=-WAY.y_m, yaw_rad=-WAY.yaw_rad))
    assert mirrored.updates[5].next_turn_rad == pytest.approx(-left.updates[5].next_turn_rad)


def test_of_several_turns_the_next_is_told() -> None:
    way = way_along((0, 0), (10, 0), (10, 10), (20, 10), (10, 10), (10, 0), (0, 0), t0_s=2.0)
    guide = walked("32.2", way)
    for update in guide.updates:
        expected = 20.0 if update.remaining_m > 20.5 else 10.0 if update.remaining_m > 10.5 else None
        if expected is None:
            assert update.next_turn_m is None
        else:
            assert update.next_turn_m == pytest.approx(update.remaining_m - expected)
            assert update.next_turn_rad == pytest.approx(math.pi / 2 if expected == 20.0 else -math.pi / 2, abs=0.01)


def test_arriving_is_told_once_and_then_nothing(guide: ReturnGuide) -> None:
    first = next(i for i, update in enumerate(guide.updates) if update.remaining_m <= 3.5)
    assert [update.arrived for update in guide.updates].index(True) == first
    assert sum(update.arrived for update in guide.updates) == 1
    assert guide.updates[first].instruction == "you are back at the start"
    assert {update.instruction for update in guide.updates[first + 1 :]} == {""}
    assert all(update.instruction for update in guide.updates[: first + 1])


def test_how_near_is_there_is_configured() -> None:
    guide = walked("32.2", arrived_m=8.0)
    arrived = next(update for update in guide.updates if update.arrived)
    assert 7.4 <= arrived.remaining_m <= 8.0


def test_sentences_go_with_the_numbers(guide: ReturnGuide) -> None:
    for update in guide.updates[:15]:
        assert update.next_turn_m is not None
        ahead = "now" if update.next_turn_m < 1.5 else f"in {update.next_turn_m:.0f} m"
        assert update.instruction == f"turn right 90° {ahead}"


def test_two_metres_the_wrong_way_bring_turn_around() -> None:
    way = way_along((0.0, 0.0), (20.0, 0.0), (10.0, 0.0), (15.0, 0.0), t0_s=2.0)
    told = walked("22.2", way).updates
    out_again = told[20:]  # ten steps out again
    wrong = [update.instruction == "turn around" for update in out_again]
    assert wrong == [False] * 3 + [True] * 7
    assert [update.instruction == "turn around" for update in told[:20]] == [False] * 20


def test_a_step_back_begins_the_count_anew() -> None:
    way = way_along((0.0, 0.0), (20.0, 0.0), (10.0, 0.0), (11.5, 0.0), (11.0, 0.0), (12.5, 0.0), (5.0, 0.0), t0_s=2.0)
    assert not [update for update in walked("22.2", way).updates if update.instruction == "turn around"]


@pytest.mark.parametrize(("at", "late"), [("30.0", 0), ("33.2", 3), ("33.7", 4), ("37.0", 10)])
def test_who_says_so_late_is_caught_up_with(at: str, late: int) -> None:
    guide = walked(at)
    assert guide.turn_back is not None
    known = {0: 56, 3: 63, 4: 64, 10: 70}[late]
    assert guide.turn_back.known_s == 2.0 + 0.5 * known
    assert guide.turn_back.breadcrumb == {0: 55, 3: 62, 4: 60, 10: 60}[late]
    assert guide.updates[0].k == known
    if late > 3:
        assert guide.updates[0].remaining_m == pytest.approx(0.5 * (120 - known), abs=0.8)
        assert len(guide.updates) == 121 - known


def test_closures_tie_each_pass_to_the_other(guide: ReturnGuide) -> None:
    assert len(guide.closures) >= 5
    for closure in guide.closures:
        assert closure.i == pytest.approx(120 - closure.j, abs=1)
        assert 0.5 * closure.i <= 22.3  # 8 m from the turn-back
        assert abs(closure.along_m) <= 0.25 + 1e-9
    assert min(np.diff([closure.j for closure in guide.closures])) >= 6
    assert min(closure.j for closure in guide.closures) >= 60 + 15


def test_a_closure_comes_with_the_step_that_makes_it() -> None:
    config = Config(step_length=HALF_A_METRE, returning=ReturnConfig(at="32.2"))
    guide = ReturnGuide(config)
    for k, step in enumerate(steps_of(WAY)):
        update, closures = guide.advance(crumb_of(WAY, k), step, partial(WAY.until, k))
        assert [closure.j for closure in closures] in ([], [k])
        assert (update is None) == (k < 61)
        assert update is None or update is guide.updates[-1]


def test_a_button_begins_the_way_back_after_the_first_step() -> None:
    events = [Event(2.0, "start"), Event(32.2, "back")]
    guide = walked("event", events=events)
    assert guide.turn_back is not None
    assert (guide.turn_back.breadcrumb, guide.turn_back.known_s) == (60, 32.5)
    assert walked("event", events=events[:1]).turn_back is None
    told = walked("20.2", events=[Event(8.2, "mark")])
    assert told.turn_back is not None
    assert told.turn_back.known_s == 20.5


def test_of_several_presses_the_first_counts() -> None:
    guide = walked("event", events=[Event(33.1, "b"), Event(32.2, "a"), Event(40.0, "c")])
    assert guide.turn_back is not None
    assert guide.turn_back.known_s == 32.5


def test_events_that_come_together_are_told_apart() -> None:
    guide = walked("event", events=[Event(40.0, "c"), Event(32.2, "b"), Event(2.0, "a")], early=True)
    assert guide.turn_back is not None
    assert guide.turn_back.known_s == 32.5  # the first after the standing start, which is at 2.0 s
    assert walked("event", events=[Event(2.0, "a")], early=True).turn_back is None
    during = walked("event", events=[Event(2.3, "a")], early=True)
    assert during.turn_back is not None
    assert during.turn_back.known_s == 3.0


@pytest.mark.parametrize(
    ("corners", "rise_m"),
    [
        (((0.0, 0.0), (30.0, 0.0), (30.0, 3.0), (5.0, 3.0)), 0.0),
        (((0.0, 0.0), (0.0, 30.0), (3.0, 30.0), (3.0, 5.0)), 0.0),
        (((0.0, 0.0), (30.0, 0.0), (5.0, 0.0)), 2.0),
    ],
)
def test_another_lane_or_floor_is_not_the_way_back(corners: tuple[tuple[float, float], ...], rise_m: float) -> None:
    way = way_along(*corners, t0_s=2.0)
    way = replace(way, z_m=np.where(np.arange(len(way)) > 60, rise_m, 0.0))
    assert walked("auto", way).turn_back is None
    told = walked("40.2", way).turn_back
    assert told is not None
    assert told.breadcrumb == 76  # the last before 40.2 s: nothing was reversed


def test_who_walks_on_when_the_way_back_begins_is_told_after_two_metres() -> None:
    way = way_along((0.0, 0.0), (30.0, 0.0), t0_s=2.0)
    told = [update.instruction == "turn around" for update in walked("20.2", way).updates[:5]]
    assert told == [False, False, False, True, True]


def test_it_may_be_noticed_by_itself() -> None:
    guide = walked("auto", retraced_m=12.0)
    assert guide.turn_back is not None
    assert guide.turn_back.breadcrumb == pytest.approx(60, abs=3)
    assert guide.turn_back.known_s == pytest.approx(44.0, abs=1.5)  # twelve metres later
    assert guide.updates[0].t_s == guide.turn_back.known_s
    assert guide.updates[0].remaining_m == pytest.approx(18.0, abs=1.0)
    assert walked("auto", retraced_m=31.0).turn_back is None


def test_a_walk_that_never_goes_back_is_let_be() -> None:
    guide = walked("never")
    assert (guide.updates, guide.turn_back, guide.outbound, guide.warnings()) == ([], None, None, [])


def test_warnings_say_why_there_was_no_way_back() -> None:
    assert walked("32.2").warnings() == []
    assert walked("500").warnings() == [
        "--return-at 500: later than the last step (62.0 s), so there was no way back to guide"
    ]
    assert walked("auto", retraced_m=31.0).warnings() == [
        "--return-at auto: no turn-back was noticed, so there was no way back to guide"
    ]
    assert walked("event").warnings() == [
        "--return-at event: the log has no event after walking began, so there was no way back to guide"
    ]
    assert "later than the last step (never)" in ReturnGuide(Config(returning=ReturnConfig(at="5"))).warnings()[0]


def test_two_steps_are_needed_before_the_way_back() -> None:
    guide = walked("0")
    assert guide.turn_back is not None
    assert (guide.turn_back.breadcrumb, guide.turn_back.known_s) == (1, 3.0)
