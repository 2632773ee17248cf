"""Which matches become closures: each threshold on both of its sides."""

import math

import pytest
from support.by_hand import HALF_A_METRE, match_at, steps_of, way_along

from fbgraph.core.config import ReturnConfig
from fbgraph.way_back.closures import ClosureMaker, beside_m
from fbgraph.way_back.records import Closure
from fbgraph.way_back.way_out import Outbound

WAY = way_along((0.0, 0.0), (40.0, 0.0))
OUTBOUND = Outbound.of(WAY, steps_of(WAY), HALF_A_METRE, 80)
CONFIG = ReturnConfig()


def first(route_m: float = 30.0, steady_m: float = 10.0) -> Closure | None:
    return ClosureMaker(OUTBOUND, CONFIG).advance(99, 0.5, match_at(route_m, steady_m=steady_m))


def test_a_closure_ties_this_breadcrumb_to_that_of_the_match() -> None:
    found = ClosureMaker(OUTBOUND, CONFIG).advance(99, 0.5, match_at(30.2, breadcrumb=60, sigma_m=0.3))
    assert found is not None
    assert (found.i, found.j) == (60, 99)
    assert found.along_m == pytest.approx(0.2)  # breadcrumb 60 lies at 30 m
    before = ClosureMaker(OUTBOUND, CONFIG).advance(99, 0.5, match_at(29.9, breadcrumb=60))
    assert before is not None
    assert before.along_m == pytest.approx(-0.1)


def test_its_doubt_along_the_route_holds_that_of_the_match_and_across_it_does_not() -> None:
    found = ClosureMaker(OUTBOUND, CONFIG).advance(99, 0.5, match_at(sigma_m=0.24))
    assert found is not None
    assert found.sigma_across_m == 0.7
    assert found.sigma_along_m == pytest.approx(math.sqrt(0.24**2 + 0.7**2)) == pytest.approx(0.74)


def test_the_route_must_have_been_followed_for_four_metres() -> None:
    assert first(steady_m=3.99) is None
    assert first(steady_m=4.0) is not None


def test_nothing_is_tied_within_eight_metres_of_the_turn_back() -> None:
    assert first(route_m=32.01) is None
    assert first(route_m=32.0) is not None


def test_the_next_closure_comes_three_metres_later() -> None:
    maker = ClosureMaker(OUTBOUND, CONFIG)
    found = [maker.advance(100 + i, 0.5, match_at(30.0 - 0.5 * i)) is not None for i in range(14)]
    assert found == [i in (0, 6, 12) for i in range(14)]


def test_metres_walked_in_doubt_count_too() -> None:
    maker = ClosureMaker(OUTBOUND, CONFIG)
    assert maker.advance(100, 0.5, match_at())
    assert [maker.advance(101 + i, 0.5, match_at(steady_m=0.0)) for i in range(6)] == [None] * 6
    assert maker.advance(107, 0.5, match_at()) is not None


def test_thresholds_are_those_of_the_configuration() -> None:
    config = ReturnConfig(closure_steady_m=1.0, closure_away_m=0.0, closure_every_m=0.9, closure_sigma_m=2.0)
    maker = ClosureMaker(OUTBOUND, config)
    found = [maker.advance(90 + i, 0.5, match_at(40.0, steady_m=1.0, sigma_m=1.5)) for i in range(3)]
    assert [f is not None for f in found] == [True, False, True]
    assert found[0] is not None
    assert (found[0].sigma_along_m, found[0].sigma_across_m) == pytest.approx((2.5, 2.0))


def test_nothing_is_tied_once_the_route_was_walked_out_again_for_five_metres() -> None:
    maker = ClosureMaker(OUTBOUND, CONFIG)
    for i in range(9):
        assert maker.advance(100 + i, 0.5, match_at(facing_back=False, steady_m=0.0)) is None
    assert maker.advance(109, 0.5, match_at()) is not None
    again = [maker.advance(110 + i, 0.5, match_at(facing_back=False, steady_m=0.0)) for i in range(10)]
    assert again == [None] * 10
    assert maker.advance(120, 5.0, match_at()) is None


def test_who_has_lingered_at_the_start_may_walk_on_anywhere() -> None:
    maker = ClosureMaker(OUTBOUND, CONFIG)
    found = [maker.advance(100 + i, 1.0, match_at(route_m=1.0)) is not None for i in range(8)]
    assert found == [True, False, False, *[False] * 5]


@pytest.mark.parametrize("aside_m", [0.0, 1.5, -1.0])
def test_how_far_beside_the_way_out_the_way_back_begins(aside_m: float) -> None:
    corners = [(0.0, 0.0), (30.0, 0.0), *([(30.0, aside_m)] if aside_m else []), (0.0, aside_m)]
    way = way_along(*corners)
    turned = int((way.x_m >= 29.99).argmax())
    assert beside_m(way, turned) == pytest.approx(aside_m, abs=0.1)


def test_of_a_way_that_has_hardly_begun_nothing_is_known_beside() -> None:
    way = way_along((0.0, 0.0), (30.0, 0.0))
    assert beside_m(way, len(way) - 1) == 0.0
    assert beside_m(way, 1) == 0.0


def test_a_closure_says_how_far_beside_it_is() -> None:
    found = ClosureMaker(OUTBOUND, CONFIG, across_m=1.4).advance(99, 0.5, match_at(steady_m=10.0))
    assert found is not None
    assert found.across_m == 1.4


def test_a_way_back_more_than_two_metres_beside_is_not_tied() -> None:
    for across_m, there in ((1.9, True), (-1.9, True), (2.1, False), (-2.1, False)):
        found = ClosureMaker(OUTBOUND, CONFIG, across_m=across_m).advance(99, 0.5, match_at(steady_m=10.0))
        assert (found is not None) == there
