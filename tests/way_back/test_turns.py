"""Turns of a walk: found where its direction changes for good, and nowhere else."""

import math

import numpy as np
import pytest
from support.trajectories import trajectory, wobbly

from fbgraph.core.config import load_config
from fbgraph.pipeline import reconstruct
from fbgraph.run.metrics import score_turns
from fbgraph.simulator.routes import ROUTE_NAMES, load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.way_back.legs import Directions, directions_of
from fbgraph.way_back.turns import find_turns

CONFIG = load_config("m5stickc")


def off_path_m(found: Directions) -> float:
    """How far somebody who follows the instructions exactly gets from the ends of the legs."""
    here, off = np.array(found.points_m[0][:2]), 0.0
    for leg in found.legs:
        here = here + leg.length_m * np.array(leg.direction)
        off = max(off, float(np.hypot(*(here - leg.points_m[-1][:2]))))
    return off


@pytest.mark.parametrize("route", ROUTE_NAMES)
def test_turns_of_simulated_walks_are_found_and_no_others(route: str) -> None:
    for seed in range(200, 204):
        walk = simulate(load_route(route), seed=seed)
        smoothed = reconstruct(walk.log, CONFIG).smoothed.trajectory
        score = score_turns(smoothed, walk.turns.t_s, walk.turns.angle_rad)
        assert (score.missed, score.phantom) == ((), ())
        assert score.found == (np.abs(walk.turns.angle_rad) >= math.radians(30)).sum()
        assert np.abs(np.degrees(score.error_rad)).max(initial=0.0) < 15.0


@pytest.mark.parametrize("curve_deg", [40.0, 90.0, -180.0, 360.0])
@pytest.mark.parametrize("steps", [10, 15, 30])
def test_a_gradual_curve_is_walked_in_turns(curve_deg: float, steps: int) -> None:
    yaw = np.concatenate((np.zeros(20), np.linspace(0.0, curve_deg, steps), np.full(20, curve_deg)))
    found = directions_of(trajectory(yaw + wobbly((0.0, len(yaw)))))
    turns = [found.turn_rad(i) for i in range(1, len(found.legs))]
    assert math.degrees(sum(turns)) == pytest.approx(curve_deg, abs=8.0)
    assert min(np.abs(turns)) >= math.radians(30.0)
    assert off_path_m(found) < 1.5


@pytest.mark.parametrize(
    ("legs", "sigma_deg"),
    [
        ([(0.0, 300)], 2.0),
        ([(0.0, 300)], 15.0),
        ([(0.0, 30), (25.0, 30), (5.0, 30)], 3.0),  # bends, not turns
        ([(0.0, 30), (360.0, 30)], 2.0),  # once around on the spot
        ([(0.0, 30), (60.0, 1), (0.0, 30)], 2.0),  # a stumble
    ],
)
def test_what_is_no_turn(legs: list[tuple[float, int]], sigma_deg: float) -> None:
    assert find_turns(trajectory(wobbly(*legs, sigma_deg=sigma_deg))) == []


def test_an_unsteady_walk_still_has_its_turns() -> None:
    turns = find_turns(trajectory(wobbly((0.0, 15), (90.0, 15), (45.0, 15), (-135.0, 15), sigma_deg=8.0)))
    assert [turn.breadcrumb for turn in turns] == pytest.approx([15, 30, 45], abs=1)
    assert np.degrees([turn.angle_rad for turn in turns[:2]]) == pytest.approx([90, -45], abs=8)
