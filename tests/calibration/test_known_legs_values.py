"""Legs of walks made by hand, whose lengths can be told on paper."""

import math
from typing import Any

import numpy as np
import pytest
from support.by_hand import HALF_A_METRE, steps_of, way_along

from fbgraph.calibration.legs import leg_of_distance, legs_between
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.front_end.length_fit import coefficients, least_squares, step_shares, step_terms
from fbgraph.front_end.step_track import StepTrack

L_SHAPE = way_along((0.0, 0.0), (10.0, 0.0), (10.0, 6.0))
TRACK = StepTrack(steps_of(L_SHAPE))


def places(*rows: tuple[float, float, float], sigma_m: float = 0.2) -> Checkpoints:
    t_s, x_m, y_m = np.array(rows).T
    return checkpoints(t_s, x_m, y_m, sigma_m=np.full(len(rows), sigma_m))


def test_a_leg_is_as_long_as_its_ends_are_apart_and_its_steps_count_along_it() -> None:
    corner = legs_between("L", TRACK, L_SHAPE.yaw_rad, places((0, 0, 0), (10, 10, 0), (16, 10, 6)), HALF_A_METRE)
    assert corner.length_m.tolist() == [10.0, 6.0]
    assert (corner.sums @ coefficients(HALF_A_METRE)).tolist() == pytest.approx([10.0, 6.0])
    assert corner.steps.tolist() == [20.0, 12.0]
    across = legs_between("L", TRACK, L_SHAPE.yaw_rad, places((0, 0, 0), (16, 10, 6)), HALF_A_METRE)
    assert across.length_m[0] == pytest.approx(math.hypot(10.0, 6.0))
    assert (across.sums @ coefficients(HALF_A_METRE))[0] == pytest.approx(math.hypot(10.0, 6.0))  # not 16 m of path
    turned = legs_between("L", TRACK, L_SHAPE.yaw_rad + 0.4, places((0, 0, 0), (16, 10, 6)), HALF_A_METRE)
    np.testing.assert_allclose(turned.sums, across.sums)


def test_a_step_on_the_edge_counts_by_its_share() -> None:
    legs = legs_between("L", TRACK, L_SHAPE.yaw_rad, places((0.25, 0, 0), (9.9, 9.65, 0)), HALF_A_METRE)
    assert legs.steps[0] == pytest.approx(2.0 * 9.65)
    assert step_shares(TRACK, 0.25, 9.9)[[0, 1, 19, 20]].tolist() == pytest.approx([0.5, 1.0, 0.8, 0.0])


def test_errors_are_those_of_places_and_steps_and_a_place_between_legs_is_in_both() -> None:
    legs = legs_between(
        "L", TRACK, L_SHAPE.yaw_rad, places((0, 0, 0), (5, 5, 0), (10, 10, 0), (16, 10, 6)), HALF_A_METRE
    )
    own_m2 = 0.2**2 * 2 + 10 * (0.08 * 0.5) ** 2
    assert legs.cov_m2[0, 0] == pytest.approx(own_m2)
    assert legs.cov_m2[0, 1] == pytest.approx(-(0.2**2))  # straight on: what makes one longer makes the next shorter
    assert legs.cov_m2[1, 2] == pytest.approx(0.0, abs=1e-12)  # round a corner it does neither
    assert legs.cov_m2[0, 2] == 0.0


@pytest.mark.parametrize(
    ("given", "rows", "why"),
    [
        ({}, [(0, 0, 0), (10, 10, 0), (16, 10, 6), (16.5, 20, 6)], "16 to 16 s: fewer than 4 steps"),
        ({"chained": [k != 5 for k in range(33)]}, [(0, 0, 0), (10, 10, 0), (16, 10, 6)], "0 to 10 s: a gap"),
    ],
)
def test_legs_that_tell_nothing_are_left_out(given: dict[str, Any], rows: list[tuple[float, ...]], why: str) -> None:
    track = StepTrack(steps_of(L_SHAPE, **given))
    legs = legs_between("L", track, L_SHAPE.yaw_rad, places(*rows), HALF_A_METRE)  # type: ignore[arg-type]
    (text,) = legs.left_out
    assert text.startswith(why)


def test_there_and_back_is_no_leg() -> None:
    way = way_along((0.0, 0.0), (10.0, 0.0), (4.0, 0.0))
    legs = legs_between("", StepTrack(steps_of(way)), way.yaw_rad, places((0, 0, 0), (16, 4, 0)), HALF_A_METRE)
    assert len(legs) == 0
    assert "path is much longer" in legs.left_out[0]


def test_fixes_of_a_receiver_must_be_further_apart() -> None:
    from dataclasses import replace

    rows = [(2.0 * k, 2.0 * k, 0.0) for k in range(6)]
    fixes = replace(places(*rows, sigma_m=1.2), gnss=True)
    legs = legs_between("", TRACK, L_SHAPE.yaw_rad, fixes, HALF_A_METRE)
    assert legs.length_m.tolist() == [10.0]


def test_a_distance_is_along_the_path() -> None:
    legs = leg_of_distance("L", TRACK, 16.0, HALF_A_METRE)
    assert (legs.sums @ coefficients(HALF_A_METRE)).tolist() == pytest.approx([16.0])
    assert legs.cov_m2[0, 0] == pytest.approx(32 * 0.04**2 + (0.005 * 16.0) ** 2 + 0.5**2)


def test_terms_times_coefficients_are_lengths_of_steps_that_stand_for_several_too() -> None:
    from fbgraph.core.config import load_config
    from fbgraph.front_end.step_length import flat_length_m

    config = load_config("phone").step_length
    rng = np.random.default_rng(2)
    f, surge, slope = rng.uniform(1.3, 2.8, 33), rng.uniform(0.05, 0.5, 33), rng.uniform(0.0, 0.1, 33)
    count = np.where(np.arange(33) % 7 == 0, 3.0, 1.0)
    length_m = count * [
        flat_length_m(config, *one) + config.gamma_m * s
        for *one, s in zip(f.tolist(), surge.tolist(), slope.tolist(), strict=True)
    ]
    track = StepTrack(steps_of(L_SHAPE, frequency_hz=f, surge_m_s=surge, slope=slope, length_m=length_m))
    terms = step_terms(track, config)
    np.testing.assert_allclose(terms @ coefficients(config), length_m[1:])
    np.testing.assert_allclose(terms[:, 0], count[1:])


def test_without_a_prior_it_is_the_papers_least_squares() -> None:
    rng = np.random.default_rng(1)
    rows, lengths = rng.normal(size=(20, 3)), rng.normal(size=20)
    theta, cov = least_squares(rows, lengths)
    np.testing.assert_allclose(theta, np.linalg.inv(rows.T @ rows) @ rows.T @ lengths)
    np.testing.assert_allclose(cov, np.linalg.inv(rows.T @ rows))
    root, mean = np.diag((1.0, 2.0, 4.0)), np.array([1.0, -1.0, 0.5])
    theta, cov = least_squares(rows, lengths, mean, root)
    np.testing.assert_allclose(cov @ (rows.T @ lengths + root.T @ root @ mean), theta)
