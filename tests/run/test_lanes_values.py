"""What the lanes over time show, and from when to when: each limit on both of its sides."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from support.by_hand import hand_step
from support.results_by_hand import T0_S, changed, hand_result, hand_signals, residuals

from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import Config, GraphConfig
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.timeline_lanes import (
    ARRIVED,
    DOUBTED,
    MOVING,
    OFF_ROUTE,
    ON_ROUTE,
    STANDING,
    TRUSTED,
    WALKING,
    Lane,
    compass_inflation,
    compass_lane,
    compass_trust,
    places_lane,
    returning_lane,
    stretches,
    wearer_lane,
)
from fbgraph.way_back.records import Closure, ReturnUpdate


def track(*spans: tuple[float, float]) -> StepTrack:
    """Steps from when to when, after a standing start before the first."""
    first = spans[0][0]
    return StepTrack([hand_step(t_s=first, start_s=first)] + [hand_step(start_s=a, t_s=b) for a, b in spans])


def lane(*spans: tuple[float, float], still: Sequence[tuple[float, float]] = (), window_s: float = 0.0) -> Lane:
    flags = np.zeros(101, dtype=bool)
    for start_s, end_s in still:
        flags[round(start_s * 10) : round(end_s * 10) + 1] = True
    return [(round(t_s, 6), name) for t_s, name in wearer_lane(hand_signals(10.0, flags), track(*spans), window_s)]


def test_the_wearer_stands_walks_and_moves() -> None:
    found = lane((4.0, 4.5), (4.5, 5.0), still=[(0.0, 1.9)])
    assert found == [(0.0, STANDING), (2.0, MOVING), (4.0, WALKING), (5.0, MOVING)]


def test_walking_hides_standing() -> None:
    assert lane((2.0, 3.0), still=[(0.0, 10.0)]) == [(0.0, STANDING), (2.0, WALKING), (3.0, STANDING)]


def test_standing_still_begins_a_window_before_it_is_known() -> None:
    assert lane((1.0, 2.0), still=[(7.0, 8.9)], window_s=1.5) == [
        (0.0, MOVING),
        (1.0, WALKING),
        (2.0, MOVING),
        (5.5, STANDING),
        (9.0, MOVING),
    ]


def test_every_rest_is_shown() -> None:
    found = lane((5.0, 6.0), still=[(1.5, 2.9), (7.8, 8.4)], window_s=0.5)
    states = [(0.0, MOVING), (1.0, STANDING), (3.0, MOVING), (5.0, WALKING), (6.0, MOVING), (7.3, STANDING)]
    assert found == [*states, (8.5, MOVING)]


def test_less_than_a_second_of_neither_is_a_blink() -> None:
    assert lane((1.0, 2.0), (2.9, 9.5))[1:] == [(1.0, WALKING)]
    assert lane((1.0, 2.0), (3.1, 10.1))[1:] == [(1.0, WALKING), (2.0, MOVING), (3.1, WALKING)]
    assert lane((0.5, 10.1))[0] == (0.0, MOVING)  # what comes first is shown however short


def test_without_signals_there_is_nothing_to_show() -> None:
    assert wearer_lane(hand_signals(10.0).head(0), track((1.0, 2.0)), 1.0) == []
    assert wearer_lane(hand_signals(10.0).head(1), track((1.0, 2.0)), 1.0) == [(0.0, MOVING)]


def test_short_breaks_are_bridged_and_single_flags_dropped() -> None:
    def flagged(*at: int) -> list[tuple[int, int]]:
        return stretches(np.isin(np.arange(40), at))

    assert flagged(3, 4, 20) == [(3, 4)]
    assert flagged(3, 6, 9) == [(3, 9)]
    assert flagged(3, 7) == []
    assert flagged(3, 4, 8, 9) == [(3, 4), (8, 9)]
    assert flagged(0, 1, 38, 39) == [(0, 1), (38, 39)]
    assert flagged() == []


def compassed(norm: Any = 50.0, dip: Any = 1.0, weights: dict[int, float] | None = None, **given: Any) -> Any:
    """A walk of fifty steps with a compass, its field and what the robust loss left of it."""
    every = np.ones(51)
    columns = {"mag_norm_ut": norm * every, "mag_dip_rad": dip * every, "yaw_mag_rad": 0.0 * every}
    found = (residuals("barometer", {7: 0.1}), residuals("compass", weights or {}))
    return hand_result(steps=columns, smoothed={"residuals": found}, **given)


def test_the_field_inflates_by_the_square_of_its_deviation() -> None:
    norm, dip = changed(51, [20], 90.0, 50.0), changed(51, [30], 1.25, 1.0)
    inflation = compass_inflation(compassed(norm, dip))
    assert inflation[20] == pytest.approx(1.0 + (40.0 / 20.0) ** 2)
    assert inflation[30] == pytest.approx(1.0 + (0.25 / 0.5) ** 2)
    assert np.delete(inflation, [20, 30]) == pytest.approx(1.0)
    config = Config(graph=GraphConfig(norm_scale_ut=10.0, dip_scale_rad=0.25))
    scaled = compass_inflation(compassed(norm, dip, config=config))
    assert (scaled[20], scaled[30]) == pytest.approx((17.0, 2.0))


def test_trust_is_what_the_loss_left_over_what_the_field_took() -> None:
    result = compassed(changed(51, [20, 25], 70.0, 50.0), weights={20: 0.8, 21: 0.6})
    trust = compass_trust(result)
    assert (trust[20], trust[21], trust[25]) == pytest.approx((0.4, 0.6, 0.5))
    assert np.delete(trust, [20, 21, 25]) == pytest.approx(1.0)


def test_without_a_compass_there_is_no_trust() -> None:
    result = hand_result()
    assert np.isnan(compass_trust(result)).all()
    assert compass_lane(result) == []


def test_the_compass_is_doubted_below_half_its_pull() -> None:
    """Steps are half a second long, the first from 1.0 s."""
    assert compass_lane(compassed(weights=dict.fromkeys(range(10, 20), 0.49))) == [
        (1.0, TRUSTED),
        (5.5, DOUBTED),
        (10.5, TRUSTED),
        (26.0, None),
    ]
    assert compass_lane(compassed(weights=dict.fromkeys(range(10, 20), 0.51))) == [(1.0, TRUSTED), (26.0, None)]


def test_the_lane_is_as_long_as_the_compass_is_known() -> None:
    result = compassed()
    heading = np.zeros(51)
    heading[[*range(5), *range(45, 51)]] = math.nan
    known = hand_result(steps={"yaw_mag_rad": heading, "mag_norm_ut": np.full(51, 50.0), "mag_dip_rad": np.ones(51)})
    assert compass_lane(known) == [(3.0, TRUSTED), (23.0, None)]
    assert compass_lane(result) == [(1.0, TRUSTED), (26.0, None)]


def test_places_are_shown_from_their_step_to_a_second_after_it() -> None:
    anchors = checkpoints(np.array([T0_S + 6.1, T0_S + 11.0]), np.zeros(2), np.zeros(2))
    result = hand_result(
        smoothed={"closures": (Closure(3, 40, 1.0, 1.0), Closure(9, 14, 1.0, 1.0))}, told=Told(None, anchors, True)
    )
    assert places_lane(result) == [
        (5.5, "anchor"),  # breadcrumb 10, at 6.0 s
        (7.0, None),
        (7.5, "closure"),
        (9.0, None),
        (10.5, "anchor"),
        (12.0, None),
        (20.5, "closure"),
        (22.0, None),
        (25.5, "closed walk"),
        (27.0, None),
    ]
    assert places_lane(hand_result()) == []


def told(t_s: float, off_route: bool = False, arrived: bool = False) -> ReturnUpdate:
    return ReturnUpdate(t_s, 1, 1, 0.0, 0.0, 0.0, 0.0, None, None, 0.3, off_route, arrived, "")


def test_the_way_back_is_on_the_route_off_it_or_at_its_end() -> None:
    updates = [told(1.0), told(2.0), told(3.0, True), told(4.0, True), told(5.0), told(6.0, arrived=True), told(7.0)]
    expected = [(1.0, ON_ROUTE), (3.0, OFF_ROUTE), (5.0, ON_ROUTE), (6.0, ARRIVED)]
    assert returning_lane(updates) == expected
    assert returning_lane([*updates, told(8.0, True)]) == expected
    assert returning_lane([]) == []
