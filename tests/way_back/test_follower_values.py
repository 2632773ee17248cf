"""A whole walk followed back along itself: which breadcrumbs of it are the same place."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.by_hand import HALF_A_METRE, steps_of, way_along

from fbgraph.core.config import ReturnConfig
from fbgraph.core.trajectory import Trajectory
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.follower import RouteFollower, find_closures
from fbgraph.way_back.records import TurnBack
from fbgraph.way_back.way_out import Outbound

WAY = way_along((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), (20.0, 0.0), (0.0, 0.0))
TURNED = TurnBack(60, 30.0, 36.0)
CONFIG = ReturnConfig()


def track(way: Trajectory = WAY, silent: int | None = None) -> StepTrack:
    """Its steps, with a field that tells where they were made; before one of them the log may be silent."""
    middle = np.arange(len(way)) - 0.5
    along = np.minimum(middle, 120.0 - middle) * 0.5
    field, height = 50.0 + 8.0 * np.sin(along / 1.5), 0.3 * along
    chained = [k != silent for k in range(len(way))]
    dip = np.full(len(way), 1.0)
    return StepTrack(steps_of(way, mag_norm_ut=field, mag_dip_rad=dip, altitude_m=height, chained=chained))


def test_closures_are_of_the_way_back_and_lead_to_the_way_out() -> None:
    found = find_closures(WAY, track(), TURNED, HALF_A_METRE, CONFIG)
    assert 7 <= len(found) <= 8  # in 22 m one every three
    for closure in found:
        assert 60 < closure.j <= 120
        assert closure.i + closure.along_m / 0.5 == pytest.approx(120 - closure.j, abs=0.5)
        assert closure.sigma_across_m == 0.7
        assert 0.7 < closure.sigma_along_m < math.hypot(0.7, 0.8)


def test_the_first_step_after_the_turn_may_be_tied_already() -> None:
    eager = ReturnConfig(closure_away_m=0.0, closure_doubt_m=9.0, closure_steady_m=0.5, closure_every_m=0.5)
    found = find_closures(WAY, track(), TURNED, HALF_A_METRE, eager)
    assert [closure.j for closure in found] == list(range(61, 121))


def test_a_walk_that_does_not_turn_back_has_none() -> None:
    assert find_closures(WAY, track(), None, HALF_A_METRE, CONFIG) == ()


def test_every_step_after_the_turn_is_followed_in_its_own_direction() -> None:
    steps = track().steps
    follower = RouteFollower(Outbound.of(WAY, steps, HALF_A_METRE, 60), HALF_A_METRE, CONFIG)
    for k in range(61, 121):
        match, _ = follower.advance(steps, k, float(WAY.yaw_rad[k]))
        assert match.facing_back
        assert not match.off_route
        assert match.route_m == pytest.approx(0.5 * (120 - k), abs=0.25 if k > 64 else 0.6)
        assert match.cross_m == pytest.approx(0.0, abs=0.25)


def test_a_silence_is_a_gap_for_the_matcher() -> None:
    """Ten seconds before step 70 are lost, and nobody knows where the wearer is; told otherwise, somebody would."""
    way = replace(WAY, t_s=WAY.t_s + np.where(np.arange(121) >= 70, 10.0, 0.0))
    sigma_m = []
    for silent in (70, None):
        steps = track(way, silent).steps
        follower = RouteFollower(Outbound.of(way, steps, HALF_A_METRE, 60), HALF_A_METRE, CONFIG)
        matches = [follower.advance(steps, k, float(way.yaw_rad[k]))[0] for k in range(61, 71)]
        sigma_m.append(matches[-1].sigma_m)
    assert sigma_m[0] > sigma_m[1] + 0.3


def test_distance_is_compared_as_if_on_the_level() -> None:
    """Steps that climb were shortened to 0.3 m on the plan; on the way down they are 0.5 m: still the same stairs."""
    lengths = np.where((np.arange(121) > 20) & (np.arange(121) <= 40), 0.3, 0.5)
    x_m = np.where(np.arange(121) <= 60, np.cumsum(lengths) - 0.5, 0.0)
    end_m = float(x_m[60])
    x_m[61:] = end_m - 0.5 * np.arange(1, 61)
    yaw = np.where(np.arange(121) <= 60, 0.0, math.pi)
    way = replace(WAY, x_m=x_m, y_m=np.zeros(121), yaw_rad=yaw)
    steps = track(way).steps
    follower = RouteFollower(Outbound.of(way, steps, HALF_A_METRE, 60), HALF_A_METRE, CONFIG)
    for k in range(61, 121):
        match, _ = follower.advance(steps, k, math.pi)
        assert abs(match.breadcrumb - (120 - k)) <= 2
