"""The verdict, its reasons in order of weight, and what it does to the covariance."""

import math
from typing import Any

import numpy as np
import pytest
from support.by_hand import steps_of, way_along
from support.results_by_hand import hand_result, with_cov

from fbgraph.core.config import Config
from fbgraph.core.verdict import Integrity, Reason, verdict_lines
from fbgraph.front_end.step_track import StepTrack
from fbgraph.integrity.assess import assess, judged
from fbgraph.integrity.evidence import Doubt, stretched_m, turned_m
from fbgraph.integrity.solution_checks import solver_at_its_limit, solver_failed
from fbgraph.run.walk_result import WalkResult

WAY = with_cov(way_along((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), t0_s=1.0), 0.3, 0.3)  # 60 steps, from 1 s to 31 s


def doubt(weight: float, sigma_m: float = 0.0, withhold: bool = False) -> Doubt:
    return Doubt(Reason("steps", weight, f"weighs {weight:g}", "look"), np.full(61, sigma_m), withhold=withhold)


def test_nothing_found_is_sound_and_changes_nothing() -> None:
    found = judged([], WAY)
    assert (found.integrity.verdict, found.integrity.reasons, found.integrity.widened) == ("sound", (), 1.0)
    np.testing.assert_array_equal(found.trajectory.cov_xy_yaw, WAY.cov_xy_yaw)


def test_reasons_stand_in_order_of_weight() -> None:
    found = assess(hand_result(WAY), [lambda walk: [doubt(1.0), doubt(3.0)], lambda walk: [doubt(2.0)]]).integrity
    assert found.verdict == "doubtful"
    assert [reason.weight for reason in found.reasons] == [3.0, 2.0, 1.0]


def test_one_reason_withholds() -> None:
    assert judged([doubt(3.0), doubt(1.0, withhold=True)], WAY).integrity.verdict == "withheld"


def test_variances_of_reasons_add() -> None:
    """0.3 m and 0.4 m and 1.2 m of independent reasons are 1.3 m."""
    found = judged([doubt(2.0, 0.4), doubt(1.0, 1.2)], WAY)
    assert found.trajectory.longest_sigma_m is not None
    assert found.trajectory.longest_sigma_m[-1] == pytest.approx(1.3)
    assert found.integrity.widened == pytest.approx(1.3 / 0.3)
    assert found.trajectory.cov_xy_yaw is not None
    assert found.trajectory.cov_xy_yaw[-1, 0, 1] == 0.0


def test_nobody_is_further_off_than_twice_the_way_walked() -> None:
    found = judged([doubt(1.0, 500.0)], WAY).trajectory.cov_xy_yaw
    assert found is not None
    assert found[0, 0, 0] == pytest.approx(0.09)
    assert found[60, 1, 1] == pytest.approx(0.09 + 60.0**2)


def test_an_error_of_heading_or_length_grows_with_the_way() -> None:
    """From 11 s, 10 m on, a tenth: 2 m at the end, shared by both axes."""
    track = StepTrack(steps_of(WAY))
    for sigma_m in (turned_m(track, 0.1, 11.0), stretched_m(track, 0.1, 11.0)):
        assert sigma_m[:21].max() == 0.0
        assert sigma_m[-1] == pytest.approx(2.0 / math.sqrt(2.0))
    assert turned_m(track, 9.0)[-1] == pytest.approx(30.0 * math.pi / 2.0 / math.sqrt(2.0))


def result(iterations: int, **given: Any) -> WalkResult:
    return hand_result(WAY, smoothed={"errors": np.linspace(9.0, 1.0, iterations + 1)}, **given)


def test_a_solver_at_its_limit_is_doubted() -> None:
    limit = Config().solver.max_iterations
    assert solver_at_its_limit(result(limit - 1)) == []
    (found,) = solver_at_its_limit(result(limit))
    assert f"limit of {limit} iterations" in found.reason.text
    assert not found.withhold


def test_a_smoother_that_failed_is_withheld() -> None:
    assert solver_failed(result(3)) == []
    assert solver_failed(result(3, failed={"online": "late"})) == []
    (found,) = solver_failed(result(3, failed={"smoothed": "indeterminate"}))
    assert found.withhold
    assert "indeterminate" in found.reason.text


def test_the_verdict_is_told_with_its_three_weightiest_reasons() -> None:
    assert verdict_lines(Integrity()) == ["sound: nothing in the log contradicts this walk"]
    reasons = tuple(Reason("steps", 5.0 - i, f"found {i}", "look") for i in range(5))
    lines = verdict_lines(Integrity("doubtful", reasons, 2.04))
    assert lines[0].endswith("its uncertainty is widened 2.0 times")
    assert lines[1:] == ["found 0: look", "found 1: look", "found 2: look", "and 2 more, in summary.json"]
    assert verdict_lines(Integrity("withheld", reasons[:1], 2.0))[1:] == ["found 0: look"]
    assert "widened" not in verdict_lines(Integrity("doubtful", reasons, 1.01))[0]


def test_an_integrity_is_what_its_summary_says() -> None:
    integrity = Integrity("doubtful", (Reason("steps", 1.5, "found", "look", 3.0, 4.0),), 1.25)
    assert Integrity.from_dict(integrity.as_dict()) == integrity
    assert Integrity.from_dict(None) == Integrity()
