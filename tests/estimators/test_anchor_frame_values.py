"""Anchors against a walk: frames of every turn, place and unit, and which anchors contradict."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.by_hand import way_along

from fbgraph.core.geometry import FloatArray, turned
from fbgraph.estimators.anchor_frame import FrameFit, WalkAtAnchors, predicted

WAY = way_along((0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0))
CRUMBS = np.array([4, 40, 70, 100, 140, 180, 215])


def fitted(
    there_m: FloatArray, count: int = 7, compass: bool = True, mirrored: bool = False, scaled: bool = False
) -> FrameFit:
    walk = WalkAtAnchors(WAY, CRUMBS[:count], there_m[:count], np.full(count, 0.5))
    fit = walk.fit(compass, mirrored, scaled)
    assert fit is not None
    return fit


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, -135.0])
def test_a_frame_of_any_turn_and_place_is_found(turn_deg: float) -> None:
    shift = np.array([450_000.0, 5_200_000.0])
    fit = fitted(turned(WAY.xy_m[CRUMBS], math.radians(turn_deg)) + shift)
    assert math.degrees(fit.turn_rad) == pytest.approx(turn_deg, abs=0.1)
    assert fit.shift_m == pytest.approx(shift, abs=0.05)
    assert fit.agree.all()
    assert fit.off_m == pytest.approx(np.zeros(7), abs=0.05)
    assert fit.clear
    # a frame that is not the compass's has its price
    assert fit.cost == pytest.approx(min((math.radians(turn_deg) / 0.2) ** 2, 9.0), abs=0.05)


def test_anchors_of_the_wrong_place_contradict_by_how_far_they_are_off() -> None:
    wrong = WAY.xy_m[CRUMBS].copy()
    wrong[2] += (0.0, 25.0)
    wrong[5] += (-18.0, 0.0)
    fit = fitted(wrong)
    assert fit.agree.tolist() == [True, True, False, True, True, False, True]
    assert fit.off_m[[2, 5]] == pytest.approx([25.0, 18.0], abs=0.5)
    assert fit.cost == pytest.approx(50.0, abs=0.5)


def test_mirrored_anchors_contradict_and_fit_a_mirrored_frame() -> None:
    exchanged = WAY.xy_m[CRUMBS][:, ::-1]
    assert fitted(exchanged).agree.sum() <= 4
    fit = fitted(exchanged, mirrored=True)
    assert fit.agree.all()
    assert fit.turn_rad == pytest.approx(0.0, abs=0.01)
    assert fit.shift_m == pytest.approx([0.0, 0.0], abs=0.1)


@pytest.mark.parametrize("unit", [1000.0, 3.2808, 0.001])
def test_other_units_contradict_and_fit_a_scale(unit: float) -> None:
    there = WAY.xy_m[CRUMBS] * unit
    told = fitted(there)
    assert not told.agree.all() or told.cost > 20.0
    fit = fitted(there, scaled=True)
    assert fit.agree.all()
    assert fit.scale == pytest.approx(unit, rel=0.02)


def test_two_anchors_tell_the_turn_and_their_distance_alone_contradicts() -> None:
    here = WAY.xy_m[CRUMBS]
    assert fitted(here, count=2, compass=False).agree.all()
    assert not fitted(here * 3.0, count=2).agree.any()


def test_of_three_anchors_of_which_two_fit_in_two_ways_nobody_is_believed() -> None:
    """Turned about the first, the third is as far from it as it should be: the second or the third is wrong."""
    crumbs = CRUMBS[[0, 2, 5]]
    there = WAY.xy_m[crumbs].copy()
    there[2] = there[0] + turned(there[2] - there[0], math.radians(80.0))
    fit = WalkAtAnchors(WAY, crumbs, there, np.full(3, 0.5)).fit(compass=False)
    assert fit is not None
    assert fit.agree.sum() == 2
    assert not fit.clear


def test_anchors_too_near_to_one_another_tell_no_turn() -> None:
    crumbs = np.array([10, 12])
    assert WalkAtAnchors(WAY, crumbs, WAY.xy_m[crumbs], np.full(2, 0.5)).fit(compass=True) is None


def test_more_anchors_than_are_compared_with_one_another_are_judged_by_their_neighbours() -> None:
    crumbs = np.arange(0, len(WAY), 2)
    there = WAY.xy_m[crumbs].copy()
    there[33] += (30.0, 0.0)
    fit = WalkAtAnchors(WAY, crumbs, there, np.full(len(crumbs), 0.5)).fit(compass=True)
    assert fit is not None
    assert np.flatnonzero(~fit.agree).tolist() == [33]
    assert fit.off_m[33] == pytest.approx(30.0, abs=0.5)


def test_a_clock_that_is_late_costs_least_where_it_is_right() -> None:
    crumbs = CRUMBS[:-1]
    later = WAY.at(WAY.t_s[crumbs] - 4.0)[:, :2]  # told when the wearer was four seconds further
    walk = WalkAtAnchors(WAY, crumbs, later, np.full(6, 0.5))
    fit = walk.fit(compass=True)
    assert fit is not None
    costs = [walk.cost_if_late(fit, late_s) for late_s in (0.0, 2.0, 4.0, 6.0)]
    assert int(np.argmin(costs)) == 2
    assert costs[2] < 0.01


def test_a_walk_that_knows_its_direction_less_tells_less_of_the_turn() -> None:
    cov = np.zeros((len(WAY), 3, 3))
    cov[:, 2, 2] = 0.5**2
    sure, unsure = (
        WalkAtAnchors(way, CRUMBS[:3], WAY.xy_m[CRUMBS[:3]], np.full(3, 0.5)).fit(compass=True)
        for way in (WAY, replace(WAY, cov_xy_yaw=cov))
    )
    assert sure is not None
    assert unsure is not None
    assert unsure.sigma_turn_rad > 3.0 * sure.sigma_turn_rad


@pytest.mark.parametrize("agreeing", [[], [2], [0, 3], [0, 1, 2, 3, 4, 5]])
def test_each_is_predicted_by_the_others_that_agree_as_if_solved_alone(agreeing: list[int]) -> None:
    rng = np.random.default_rng(4)
    spread = rng.normal(size=(12, 12))
    whole, off = spread @ spread.T + 0.1 * np.eye(12), rng.normal(size=12)
    agree = np.isin(np.arange(6), agreeing)
    away, squared = predicted(whole, off, agree)
    for i in range(6):
        others = np.repeat(agree & (np.arange(6) != i), 2)
        at = slice(2 * i, 2 * i + 2)
        if not others.any():
            assert [*away[i], squared[i]] == [0.0] * 3
            continue
        gain = whole[at, others] @ np.linalg.inv(whole[np.ix_(others, others)])
        left = off[at] - gain @ off[others]
        assert away[i] == pytest.approx(left, rel=1e-9)
        assert squared[i] == pytest.approx(
            left @ np.linalg.inv(whole[at, at] - gain @ whole[others, at]) @ left, rel=1e-8
        )
