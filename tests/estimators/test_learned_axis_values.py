"""An axis from many walks: found whichever way each of them is off, and not where there is none."""

import math

import numpy as np
import pytest

from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.building_axis import OFFSETS_RAD, Legs, fold
from fbgraph.estimators.learned_axis import learn_axis, votes_of


def walk(rng: np.random.Generator, axis_deg: float | None, off_deg: float = 5.0) -> FloatArray:
    """A walk whose legs follow an axis, give or take, or none."""
    legs = 5
    if axis_deg is None:
        yaw_deg = rng.uniform(-180.0, 180.0, legs)
    else:
        yaw_deg = axis_deg + 90.0 * rng.integers(0, 4, legs) + rng.normal(0.0, off_deg) + rng.normal(0.0, 5.0, legs)
    return votes_of(Legs(np.radians(yaw_deg), rng.uniform(6.0, 30.0, legs), np.arange(legs)))


def set_of(seed: int, count: int, axis_deg: float | None, off_deg: float = 5.0) -> list[FloatArray]:
    rng = np.random.default_rng(seed)
    return [walk(rng, axis_deg, off_deg) for _ in range(count)]


@pytest.mark.parametrize("axis_deg", [-44.0, -10.0, 0.0, 20.0, 44.9])
def test_ten_walks_show_their_axis(axis_deg: float) -> None:
    found = learn_axis(set_of(3, 10, axis_deg))
    off_deg = math.degrees(float(fold(np.array(found.yaw_rad - math.radians(axis_deg)))))
    assert abs(off_deg) < 2.0 * math.degrees(found.sigma_rad) < 7.0
    assert found.log_odds > 5.0


def test_the_sigma_is_that_of_the_answers() -> None:
    found = [learn_axis(set_of(seed, 12, 30.0)) for seed in range(25)]
    in_sigmas = [math.degrees(one.yaw_rad) - 30.0 for one in found] / np.degrees([one.sigma_rad for one in found])
    assert 0.5 < float(np.sqrt((in_sigmas**2).mean())) < 1.3


def test_more_walks_know_it_better_and_are_surer() -> None:
    few, many = (learn_axis(set_of(5, count, 30.0)) for count in (6, 40))
    assert many.sigma_rad < 0.6 * few.sigma_rad
    assert many.log_odds > 3.0 * few.log_odds


def test_some_walks_that_follow_nothing_are_borne() -> None:
    found = learn_axis([*set_of(6, 12, 30.0), *set_of(7, 5, None)])
    assert math.degrees(found.yaw_rad) == pytest.approx(30.0, abs=5.0)
    assert found.log_odds > 3.0


def test_legs_in_all_directions_have_no_axis() -> None:
    odds = [learn_axis(set_of(seed, count, None)).log_odds for seed in range(20) for count in (4, 12)]
    assert max(odds) < 3.0
    assert np.median(odds) < 0.0


def test_one_walk_shows_none() -> None:
    """Its own axis is as clear as can be, but every walk has one."""
    assert abs(learn_axis(set_of(8, 1, 30.0, off_deg=0.0)).log_odds) < 0.3


def test_a_vote_is_as_wide_as_walks_are_off() -> None:
    legs = Legs(np.radians([30.0, 120.0, -150.0]), np.full(3, 30.0), np.arange(3))
    votes = votes_of(legs)
    assert votes.shape == OFFSETS_RAD.shape
    best = int(votes.argmax())
    assert math.degrees(OFFSETS_RAD[best]) == pytest.approx(30.0)
    # of nine legs' worth of 8°, and 6° of the walk
    width = math.hypot(6.0, 8.0 / 3.0)
    evidence = (np.exp(votes[best]) - 0.2) / 0.8
    at = int(np.abs(OFFSETS_RAD - math.radians(30.0 + width)).argmin())
    there = math.degrees(OFFSETS_RAD[at]) - 30.0
    less = math.exp(-0.5 * (there / width) ** 2)
    assert (math.exp(votes[at]) - 0.2) / 0.8 == pytest.approx(evidence * less, rel=0.06)
    assert float(np.exp(votes).mean()) == pytest.approx(1.0, abs=1e-6)  # against legs that lie anywhere


def test_a_walk_without_legs_votes_for_nothing() -> None:
    none: FloatArray = np.empty(0)
    assert votes_of(Legs(none, none, none.astype(np.int64))) == pytest.approx(np.zeros(len(OFFSETS_RAD)))
