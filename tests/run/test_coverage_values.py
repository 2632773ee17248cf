"""Whether ellipses hold, in closed form and on walks whose errors are drawn from them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.by_hand import way_along

from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.coverage import ELLIPSE_95, Coverage, coverage
from fbgraph.run.scores import score_entry

WAY = way_along((0.0, 0.0), (10.0, 0.0), (10.0, 10.0))  # 1 m/s, 20 s


def truth(*rows: tuple[float, float, float], sigma_m: float = math.nan) -> Checkpoints:
    t_s, x_m, y_m = np.array(rows, dtype=float).T
    return checkpoints(t_s, x_m, y_m, sigma_m=np.full(len(t_s), sigma_m), source="truth.csv")


def sure(*sigmas: tuple[float, float, float]) -> Trajectory:
    """The way with variances of x and y and their covariance at 0, 10 and 20 s, linear between them."""
    at = np.column_stack([np.interp(WAY.t_s, (0, 10, 20), column) for column in zip(*sigmas, strict=True)])
    cov = np.full((len(WAY), 3, 3), np.nan)  # a run read back does not know those of yaw
    cov[:, 0, 0], cov[:, 1, 1], cov[:, 0, 1] = at.T
    cov[:, 1, 0] = cov[:, 0, 1]
    return replace(WAY, cov_xy_yaw=cov)


def nees(way: Trajectory, places: Checkpoints, alignment: str = "start") -> list[float]:
    found = coverage(way, places, alignment=alignment)  # type: ignore[arg-type]
    assert found is not None
    return [float(value) for value in found.nees]


def test_the_ellipse_is_the_breadcrumbs_with_the_surveys_errors_at_both_ends() -> None:
    way = sure((0.0, 0.0, 0.0), (4.0, 1.0, 0.0), (9.0, 5.0, 2.0))
    exact = truth((0, 0, 0), (10, 8, 0), (20, 10, 13))
    assert nees(way, exact) == pytest.approx([4 / 4, 9 * 9 / (9 * 5 - 4)])
    surveyed = truth((0, 0, 0), (10, 8, 0), (20, 10, 13), sigma_m=1.0)  # twice: there, and where the walk was moved to
    assert nees(way, surveyed) == pytest.approx([4 / 6, 9 * 11 / (11 * 7 - 4)])
    assert nees(way, surveyed, "none") == pytest.approx([0.0, 4 / 5, 9 * 10 / (10 * 6 - 4)])


def test_where_the_first_checkpoint_comes_late_the_walks_own_error_there_counts_too() -> None:
    way = sure((0.0, 0.0, 0.0), (4.0, 4.0, 0.0), (8.0, 8.0, 0.0))
    assert nees(way, truth((5, 5, 0), (20, 10, 13))) == pytest.approx([9 / (2 + 8)])


def test_between_breadcrumbs_it_is_linear() -> None:
    way = sure((0.0, 0.0, 0.0), (4.0, 1.0, 0.0), (4.0, 1.0, 0.0))
    assert nees(way, truth((0, 0, 0), (2.5, 2.5, 1.0))) == pytest.approx([1.0 / 0.25])


def test_the_survey_says_where_each_place_is_better_or_worse_known() -> None:
    places = replace(truth((0, 0, 0), (10, 8, 0), (20, 10, 13)), sigma_m=np.array([0.0, 2.0, np.nan]))
    assert nees(sure(*[(1.0, 1.0, 0.0)] * 3), places) == pytest.approx([4 / 6, 9 / 2])


def test_inside_means_within_95_per_cent() -> None:
    edge = math.sqrt(ELLIPSE_95)
    assert math.exp(-ELLIPSE_95 / 2) == pytest.approx(0.05)
    found = Coverage(np.array([0.0, (edge - 1e-6) ** 2, (edge + 1e-6) ** 2, 100.0]))
    assert (found.inside, found.share) == (2, 0.5)
    noted = found.as_dict()
    assert (noted["inside_95"], noted["of"], noted["worst_sigma"]) == (2, 4, 10.0)
    assert noted["nees_mean"] == pytest.approx((2 * ELLIPSE_95 + 100.0) / 4)


def test_errors_drawn_from_the_ellipses_lie_inside_19_of_20_times() -> None:
    """Of 4000 walks: 95 %, give or take 3.3 standard deviations of a share."""
    rng, way, inside = np.random.default_rng(4), sure((0.0, 0.0, 0.0), (4.0, 1.0, 0.0), (9.0, 5.0, 2.0)), 0
    root = np.linalg.cholesky(np.array([[9.0, 2.0], [2.0, 5.0]]))
    for _ in range(4000):
        off, survey = root @ rng.standard_normal(2), rng.standard_normal((2, 2))
        places = truth((0, *survey[0]), (20, 10 + off[0] + survey[1, 0], 10 + off[1] + survey[1, 1]), sigma_m=1.0)
        found = coverage(way, places)
        assert found is not None
        inside += found.inside
    assert inside / 4000 == pytest.approx(0.95, abs=0.0114)


def test_without_covariance_nothing_is_said_of_it() -> None:
    places = truth((0, 0, 0), (10, 8, 0))
    assert coverage(WAY, places) is None
    assert "coverage" not in score_entry(WAY, places, 0.0, "unaided", "start")
    entry = score_entry(sure(*[(1.0, 1.0, 0.0)] * 3), places, 0.0, "unaided", "start")
    assert entry["coverage"] == {
        "inside_95": 1,
        "of": 1,
        "nees_mean": pytest.approx(2.0),
        "worst_sigma": pytest.approx(2**0.5),
    }


def test_truth_of_another_log_covers_nothing() -> None:
    with pytest.raises(DataError, match="outside the walk"):
        coverage(sure(*[(1.0, 1.0, 0.0)] * 3), truth((50, 0, 0), (60, 1, 1)))
