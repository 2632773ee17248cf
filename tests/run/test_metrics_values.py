"""Errors against known places, computed by hand."""

import math
from dataclasses import asdict

import numpy as np
import pytest
from support.by_hand import way_along

from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.metrics import Score, checkpoint_errors, fit_to_truth, leg_errors, score, score_turns
from fbgraph.run.scores import score_entry, score_label

WAY = way_along((0.0, 0.0), (10.0, 0.0), (10.0, 10.0))  # two steps of 0.5 m a second: 1 m/s, 20 s


def truth(*rows: tuple[float, float, float], t0_s: float = 0.0) -> Checkpoints:
    t_s, x_m, y_m = np.array(rows, dtype=float).T
    return checkpoints(t_s + t0_s, x_m, y_m, source="truth.csv")


PLACES = truth((0.0, 5.0, 2.0), (10.0, 15.0, 5.0), (20.0, 15.0, 16.0))  # shifted by (5, 2), then 3 and 4 m off


def test_errors_are_those_after_the_first_once_it_agrees() -> None:
    assert checkpoint_errors(WAY, PLACES) == pytest.approx([3.0, 4.0])
    assert checkpoint_errors(WAY, truth((0, 5, 2), (5, 13, 6))) == pytest.approx([5.0])


def test_errors_as_it_is() -> None:
    expected = [math.hypot(5, 2), math.hypot(5, 5), math.hypot(5, 6)]
    assert checkpoint_errors(WAY, PLACES, alignment="none") == pytest.approx(expected)


def test_they_are_summed_up() -> None:
    expected = Score(
        rmse_m=math.sqrt(12.5), mean_m=3.5, max_m=4.0, final_m=4.0, checkpoints=2, final_percent=20.0,
        ce50_m=3.0, ce75_m=4.0, ce95_m=4.0, third_quartile_m=3.75, growth_m_s=0.2,
    )  # fmt: skip
    assert asdict(score(WAY, PLACES)) == pytest.approx(asdict(expected))
    other = score(WAY, truth((0, 0, 0), (10, 10, 4), (20, 10, 9)))
    assert (other.max_m, other.final_m, other.mean_m) == pytest.approx((4.0, 1.0, 2.5))
    assert list(other.as_dict()) == list(asdict(expected))


def test_circular_errors_hold_their_share_and_the_quartile_lies_between() -> None:
    """Twenty places, 1 to 20 m off; the smallest circles with 50, 75 and 95 % of them."""
    places = truth(
        (0, 0, 0), *((k, float(WAY.at(np.array([k]))[0, 0]), WAY.at(np.array([k]))[0, 1] + k) for k in range(1, 21))
    )
    found = score(WAY, places)
    assert (found.ce50_m, found.ce75_m, found.ce95_m) == pytest.approx((10.0, 15.0, 19.0))
    assert found.third_quartile_m == pytest.approx(15.25)
    assert found.growth_m_s == pytest.approx(1.0)
    assert found.final_percent == pytest.approx(100.0)


def test_a_constant_offset_neither_grows_nor_counts_once_the_walk_agrees() -> None:
    places = truth((0, 3, 4), (5, 8, 4), (10, 13, 4), (20, 13, 14))
    assert asdict(score(WAY, places)) == pytest.approx(
        dict.fromkeys(asdict(score(WAY, places)), 0.0) | {"checkpoints": 3}
    )
    as_is = score(WAY, places, alignment="none")
    assert (as_is.rmse_m, as_is.ce50_m, as_is.ce95_m, as_is.third_quartile_m) == pytest.approx((5.0,) * 4)
    assert as_is.growth_m_s == pytest.approx(0.0)


@pytest.mark.parametrize("rate_m_s", [0.05, 0.3])
def test_an_error_that_grows_does_so_at_its_rate(rate_m_s: float) -> None:
    at = np.array([2.0, 5.0, 9.0, 16.0, 20.0])
    x_m, y_m = WAY.at(at)[:, :2].T
    drifting = truth(*zip(at, x_m + 0.6 * rate_m_s * at, y_m - 0.8 * rate_m_s * at, strict=True))
    assert score(WAY, drifting).growth_m_s == pytest.approx(rate_m_s)
    assert score(WAY, drifting, alignment="none").growth_m_s == pytest.approx(rate_m_s)


def test_what_cannot_be_divided_is_not_known() -> None:
    standing = truth((0, 0, 0), (0, 3, 4))
    found = score(WAY, standing)
    assert (found.final_percent, found.growth_m_s) == (None, None)
    assert fit_to_truth(WAY, standing).turn_rad is None


@pytest.mark.parametrize("turn_deg", [-170.0, -20.0, 0.0, 35.0, 90.0])
def test_the_fit_says_how_far_the_walk_is_turned(turn_deg: float) -> None:
    """Truth turned to the right of a walk has that walk to its left; nothing is left over."""
    at = np.array([0.0, 5.0, 10.0, 15.0, 20.0])
    places = WAY.at(at)[:, :2] @ (1.0, 1j) * np.exp(-1j * math.radians(turn_deg)) + (300.0 - 8.0j)
    fit = fit_to_truth(WAY, truth(*zip(at, places.real, places.imag, strict=True)))
    assert fit.turn_rad == pytest.approx(math.radians(turn_deg), abs=1e-9)
    assert fit.rmse_m == pytest.approx(0.0, abs=1e-9)
    assert fit.spread_m == pytest.approx(math.sqrt((np.abs(places - places.mean()) ** 2).mean()))
    entry = score_entry(WAY, truth(*zip(at, places.real, places.imag, strict=True)), 0.0, "unaided", "start")
    assert entry["turned_deg"] == pytest.approx(turn_deg, abs=1e-9)
    assert entry["aligned_rmse_m"] == pytest.approx(0.0, abs=1e-9)


def test_the_best_rigid_fit_turns_and_moves_but_does_not_stretch() -> None:
    turn = np.exp(1j * math.radians(70.0))
    at = np.array([0.0, 5.0, 10.0, 15.0, 20.0])
    places = WAY.at(at)[:, :2] @ (1.0, 1j) * turn + (3.0 - 8.0j)
    moved = truth(*zip(at, places.real, places.imag, strict=True))
    assert checkpoint_errors(WAY, moved, alignment="rigid") == pytest.approx(0.0, abs=1e-9)
    line = way_along((0.0, 0.0), (10.0, 0.0))
    stretched = truth((0, 0, 0), (5, 0, 6), (10, 0, 12))  # North, a fifth longer
    assert checkpoint_errors(line, stretched, alignment="rigid") == pytest.approx([1.0, 0.0, 1.0])
    mirrored = truth((0, 0, 0), (10, 10, 0), (20, 10, -10))
    assert checkpoint_errors(WAY, mirrored, alignment="rigid").max() > 1.0


def test_times_of_the_truth_are_on_the_event_clock() -> None:
    later = truth((100.0, 5.0, 2.0), (110.0, 15.0, 5.0), (120.0, 15.0, 16.0))
    assert checkpoint_errors(WAY, later, 100.0) == pytest.approx([3.0, 4.0])


def test_between_breadcrumbs_the_walk_is_linear_and_beyond_its_ends_it_stands() -> None:
    assert checkpoint_errors(WAY, truth((0, 0, 0), (3.1, 3.1, 0.0), (99, 10, 13))) == pytest.approx([0.0, 3.0])


def test_truth_of_another_log_is_refused() -> None:
    with pytest.raises(DataError, match=r"truth.csv: its times 120.1 … 130.0 s lie outside the walk \(100.0 … 120.0"):
        checkpoint_errors(WAY, truth((120.1, 0, 0), (130, 1, 1)), 100.0)
    with pytest.raises(DataError, match="lie outside"):
        checkpoint_errors(WAY, truth((-5, 0, 0), (-0.1, 1, 1)))
    assert len(checkpoint_errors(WAY, truth((-5, 0, 0), (0.0, 1, 1)))) == 1  # the first moment counts
    assert len(checkpoint_errors(WAY, truth((20, 0, 0), (30.0, 1, 1)))) == 1  # so does the last
    with pytest.raises(DataError, match=r"truth.csv: scoring needs at least two checkpoints, found 1"):
        checkpoint_errors(WAY, truth((1, 0, 0)))


def test_who_stood_still_before_the_first_step_and_after_the_last_was_there() -> None:
    """The log runs from -8 to 30 s, the walk from 0 to 20."""
    log_s = (-8.0, 30.0)
    ends = truth((-5, 0, 0), (28, 10, 13))
    assert checkpoint_errors(WAY, ends, log_s=log_s) == pytest.approx([3.0])
    assert score(WAY, truth((95, 0, 0), (128, 10, 13)), 100.0, log_s=log_s).final_m == pytest.approx(3.0)
    for other in (truth((-5, 0, 0), (-0.1, 1, 1)), truth((20.1, 0, 0), (29, 1, 1)), truth((-9, 0, 0), (31, 10, 13))):
        with pytest.raises(DataError, match="outside the walk"):
            checkpoint_errors(WAY, other, log_s=log_s)
    with pytest.raises(DataError, match="outside the walk"):
        checkpoint_errors(WAY, ends)


def test_legs_are_compared_in_length_and_direction() -> None:
    """True legs 8 m East and 10 m towards 60° left of it; walked 10 m East and 10 m North."""
    y_m = 10.0 * math.sin(math.radians(60.0))
    legs = leg_errors(WAY, truth((50, 1, 1), (60, 9, 1), (70, 14, 1 + y_m)), 50.0)
    assert legs.length_rel == pytest.approx([0.25, 0.0])
    assert np.degrees(legs.yaw_rad) == pytest.approx([0.0, 30.0])
    assert legs.start_s == pytest.approx([0.0, 10.0])
    assert legs.end_s == pytest.approx([10.0, 20.0])


def test_checkpoints_nearer_than_two_metres_make_no_leg() -> None:
    near = leg_errors(WAY, truth((0, 0, 0), (1.9, 1.9, 0), (5, 5, 0), (6.9, 6.9, 0), (7.0, 7.0, 0)))
    assert near.end_s == pytest.approx([5.0, 7.0])
    assert len(leg_errors(WAY, truth((0, 0, 0), (1.9, 1.9, 0))).yaw_rad) == 0
    assert leg_errors(WAY, truth((0, 0, 0), (1, 1, 0), (2, 2, 0)), min_leg_m=0.5).end_s == pytest.approx([1.0, 2.0])


TURNING = way_along((0, 0), (10, 0), (10, 10), (20, 10))  # left after breadcrumb 20 (10 s), right after 40 (20 s)
LEFT, RIGHT = math.pi / 2, -math.pi / 2


def turned(*true: tuple[float, float], way: Trajectory = TURNING) -> tuple[int, int, int]:
    """How many were found, missed, and not there."""
    t_s, angle = np.array(true, dtype=float).reshape(-1, 2).T
    found = score_turns(way, t_s, angle)
    return found.found, len(found.missed), len(found.phantom)


def test_turns_are_found_missed_or_phantoms() -> None:
    assert turned((10.0, LEFT), (20.0, RIGHT)) == (2, 0, 0)
    assert turned((10.0, LEFT)) == (1, 0, 1)
    assert turned() == (0, 0, 2)
    assert turned((10.0, LEFT), (15.0, LEFT), (20.0, RIGHT)) == (2, 1, 0)
    found = score_turns(TURNING, np.array([10.0, 15.0]), np.array([LEFT, LEFT]))
    assert found.missed == ((15.0, LEFT),)
    assert [turn.breadcrumb for turn in found.phantom] == [40]


def test_a_turn_is_found_within_three_breadcrumbs() -> None:
    assert turned((11.5, LEFT), (18.5, RIGHT)) == (2, 0, 0)
    assert turned((11.6, LEFT), (18.4, RIGHT)) == (0, 2, 2)


def test_and_within_thirty_degrees() -> None:
    for error_deg, count in ((29.0, 1), (-29.0, 1), (31.0, 0), (-31.0, 0)):
        assert turned((10.0, LEFT - math.radians(error_deg)))[0] == count
    found = score_turns(TURNING, np.array([10.0]), np.array([LEFT - 0.2]))
    assert found.error_rad == pytest.approx([0.2])


def test_true_bends_below_thirty_degrees_are_no_turns() -> None:
    assert turned((10.0, math.radians(29.9)))[:2] == (0, 0)
    assert turned((5.0, math.radians(30.1)))[:2] == (0, 1)


def test_left_about_is_right_about() -> None:
    about = way_along((0.0, 0.0), (10.0, 0.0), (0.0, 0.0))
    for angle in (math.pi, -math.pi, math.radians(170.0), math.radians(-170.0)):
        assert turned((10.0, angle), way=about) == (1, 0, 0)


def test_the_nearest_turn_is_taken_and_only_once() -> None:
    assert turned((10.0, LEFT), (10.5, LEFT)) == (1, 1, 1)
    two = way_along((0, 0), (10, 0), (10, 2), (8, 2), (8, -8))  # left at breadcrumbs 20, 24 and 28
    found = score_turns(two, np.array([11.2]), np.array([LEFT]))
    assert found.found == 1
    assert [turn.breadcrumb for turn in found.phantom] == [20, 28]


def test_how_each_estimator_may_be_scored() -> None:
    assert score_label("smoothed", True, False) == ("anchored", "none")
    assert score_label("smoothed", True, True) == ("anchored", "none")
    assert score_label("smoothed", False, True) == ("closed", "start")
    assert score_label("smoothed", False, False) == ("unaided", "start")
    assert score_label("smoothed", False, False, True) == ("axis", "start")
    assert score_label("smoothed", False, True, True) == ("closed + axis", "start")
    assert score_label("smoothed", True, True, True) == ("anchored + axis", "none")
    for name in ("pdr", "ekf", "online"):
        assert score_label(name, True, True, True) == ("unaided", "start")


def test_a_score_is_written_with_the_best_fit_beside_it() -> None:
    entry = score_entry(WAY, PLACES, 0.0, "unaided", "start")
    assert list(entry) == ["label", *score(WAY, PLACES).as_dict(), "aligned_rmse_m", "turned_deg"]
    assert (entry["label"], entry["rmse_m"], entry["checkpoints"]) == ("unaided", pytest.approx(math.sqrt(12.5)), 2)
    assert entry["aligned_rmse_m"] == pytest.approx(
        math.sqrt((checkpoint_errors(WAY, PLACES, alignment="rigid") ** 2).mean())
    )
    assert entry["aligned_rmse_m"] < math.sqrt((9 + 16) / 3)
    assert score_entry(WAY, PLACES, 0.0, "anchored", "none")["final_m"] == pytest.approx(math.hypot(5, 6))
    later = truth((100.0, 5.0, 2.0), (110.0, 15.0, 5.0), (120.0, 15.0, 16.0))
    assert score_entry(WAY, later, 100.0, "unaided", "start") == entry
