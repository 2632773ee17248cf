"""What uncertain headings do beyond first order, against drawn ones."""

import numpy as np
import pytest

from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.shared_errors import curvature_covariance


def shortening(yaw_rad: FloatArray, length_m: FloatArray, sigma_rad: float) -> FloatArray:
    """(2, 2) mean square of where a walk ends whose steps are all turned by one angle, less what lies to the side."""
    turned = np.random.default_rng(4).normal(0.0, sigma_rad, 200_000)
    short = (1.0 - np.cos(turned))[:, None]
    along = np.array([(length_m * np.cos(yaw_rad)).sum(), (length_m * np.sin(yaw_rad)).sum()])
    off = -short * along
    return np.asarray(off.T @ off / len(off))


@pytest.mark.parametrize("sigma_rad", [0.1, 0.5, 1.5])
def test_an_uncertain_heading_shortens_the_walk_whichever_way_it_is_off(sigma_rad: float) -> None:
    yaw_rad = np.array([0.3, 0.3, 0.3, 1.8, 1.8])
    length_m = np.array([0.7, 0.7, 0.6, 0.8, 0.7])
    covariance = curvature_covariance(length_m, yaw_rad, np.full(5, sigma_rad**2))
    assert np.allclose(covariance[-1, :2, :2], shortening(yaw_rad, length_m, sigma_rad), rtol=0.03)
    assert np.allclose(covariance[0, :2, :2], shortening(yaw_rad[:1], length_m[:1], sigma_rad), rtol=0.03)
    assert not covariance[:, 2].any()
    assert not covariance[:, :, 2].any()


def test_a_little_uncertainty_does_so_by_three_quarters_of_its_square() -> None:
    covariance = curvature_covariance(np.ones(3), np.zeros(3), np.full(3, 1e-3))
    assert covariance[:, 0, 0] == pytest.approx(0.75e-6 * np.array([1.0, 4.0, 9.0]), rel=1e-2)
    assert not curvature_covariance(np.ones(3), np.zeros(3), np.zeros(3)).any()


def test_nobody_knows_the_way_at_all_of_a_heading_that_may_be_anything() -> None:
    """E (1 - cos)² of any angle is one and a half: a step may end up to twice its length behind."""
    assert curvature_covariance(np.ones(1), np.zeros(1), np.array([1e3]))[0, 0, 0] == pytest.approx(1.5)
