"""Factors of the compass: yaw and strength of the field at each step, and the device's own iron, I(j)."""

from __future__ import annotations

import gtsam
import numpy as np
from gtsam.symbol_shorthand import I, X

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.estimators.compass import CompassReading, CompassReadings, compass_residuals, iron_sigma_ut
from fbgraph.estimators.noise_models import sigmas

UNIT_UT = 20.0
"""Of I(j), a usual horizontal field: a tenth of it turns the compass by a tenth of a radian (iSAM2's thresholds)."""
_BY_POSE = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])


def iron_factor(j: int, iron_ut: FloatArray, usual_ut: float, config: GraphConfig) -> gtsam.PriorFactorVector:
    """The iron of a stretch is little, by Student's t reweighted at ``iron_ut``; the field about as usual."""
    sigma_ut = iron_sigma_ut(iron_ut, config)
    prior = np.array([0.0, 0.0, usual_ut])
    model = sigmas(*(sigma / UNIT_UT for sigma in (sigma_ut, sigma_ut, config.sigma_field_ut)))
    return gtsam.PriorFactorVector(I(j), prior / UNIT_UT, model)


def recalibration_factor(j: int, jump_ut: FloatArray, sigma_ut: float) -> gtsam.BetweenFactorVector:
    """The iron of a stretch is that of the one before and the jump that was seen; the field's strength the same."""
    model = sigmas(*(sigma_ut / UNIT_UT,) * 3)
    return gtsam.BetweenFactorVector(I(j - 1), I(j), jump_ut / UNIT_UT, model)


def compass_factors(
    k: IntArray,
    readings: CompassReadings,
    yaw_rad: FloatArray,
    stretch: IntArray,
    iron_ut: FloatArray,
    config: GraphConfig,
) -> list[gtsam.LinearContainerFactor]:
    """Yaw and strength of the field at steps; two rows each, of X(k) and I(j).

    Args:
        k: (N,) breadcrumbs.
        readings: (N,) of them.
        yaw_rad: (N,) headings at which to linearise.
        stretch: (N,) which iron is theirs.
        iron_ut: (N, 3) iron at which to linearise.
        config: weights.
    """
    off = compass_residuals(readings, yaw_rad, iron_ut, config)
    by_iron = UNIT_UT * np.array((off.across_by_iron, off.strength_by_iron)).transpose(2, 0, 1)
    right = -np.column_stack((off.across_rad, off.strength_rel))
    sigma = (readings.sigma_rad / np.sqrt(np.array((off.across_weight, off.strength_weight)))).T
    rows = zip(k.tolist(), stretch.tolist(), by_iron, right, sigma, yaw_rad.tolist(), iron_ut, strict=True)
    return [_factor(*row) for row in rows]


def compass_factor(
    k: int, j: int, reading: CompassReading, yaw_rad: float, iron_ut: FloatArray, config: GraphConfig
) -> gtsam.LinearContainerFactor:
    """The same of one step, whose iron is the ``j``-th."""
    off = compass_residuals(reading, yaw_rad, iron_ut, config)
    by_iron = UNIT_UT * np.array((off.across_by_iron, off.strength_by_iron))
    right = np.array((-off.across_rad, -off.strength_rel))
    sigma = reading.sigma_rad / np.sqrt(np.array((off.across_weight, off.strength_weight)))
    return _factor(k, j, by_iron, right, sigma, yaw_rad, iron_ut)


def _factor(
    k: int, j: int, by_iron: FloatArray, right: FloatArray, sigma: FloatArray, yaw_rad: float, iron_ut: FloatArray
) -> gtsam.LinearContainerFactor:
    model = gtsam.noiseModel.Diagonal.Sigmas(sigma)
    jacobian = gtsam.JacobianFactor(X(k), _BY_POSE, I(j), by_iron, right, model)
    point = gtsam.Values()
    point.insert_or_assign(X(k), pose2=gtsam.Pose2(0.0, 0.0, yaw_rad))
    point.insert(I(j), iron_ut / UNIT_UT)
    return gtsam.LinearContainerFactor(jacobian, point)
