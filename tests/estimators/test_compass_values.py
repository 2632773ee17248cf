"""What the compass says once the device's iron is taken out: closed forms and numerical derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.factors import make_step
from support.magnetised import LEVEL_UT, seen

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.compass import (
    CompassReading,
    CompassReadings,
    circle_through,
    compass_reading,
    compass_readings,
    compass_residuals,
    iron_cost,
    iron_sigma_ut,
    scattered,
)
from fbgraph.estimators.magnetic_field import FieldMemory

CONFIG = GraphConfig(sigma_mag_rad=0.2, mag_correlation_m=6.0, mag_huber=1.5, sigma_iron_ut=1.0)
ALL_ROUND = np.linspace(0.1, 6.2, 12)


def readings_of(yaw_rad: FloatArray, iron_ut: FloatArray, mount_rad: float = 0.0) -> CompassReadings:
    """Of a device held at this angle to the walk, which goes in these directions."""
    field = seen(yaw_rad - mount_rad, iron_ut)
    sigma = np.full(len(yaw_rad), 0.2)
    level_ut = field["mag_norm_ut"] * np.cos(field["mag_dip_rad"])
    return CompassReadings(np.full(len(yaw_rad), mount_rad), field["yaw_mag_rad"], level_ut, sigma, 4.0 * sigma)


@pytest.mark.parametrize("mount_rad", [0.0, 0.7])
def test_with_its_iron_known_the_compass_is_right_all_round(mount_rad: float) -> None:
    iron_ut = np.array([6.0, -11.0, LEVEL_UT])
    readings = readings_of(ALL_ROUND, iron_ut[:2], mount_rad)
    off = compass_residuals(readings, ALL_ROUND, np.tile(iron_ut, (12, 1)), CONFIG)
    assert np.allclose(off.across_rad, 0.0, atol=1e-12)
    assert np.allclose(off.strength_rel, 0.0, atol=1e-12)
    assert np.all(off.across_weight == 1.0)
    unknown = compass_residuals(readings, ALL_ROUND, np.tile([0.0, 0.0, LEVEL_UT], (12, 1)), CONFIG)
    assert np.abs(unknown.across_rad).max() > 0.5
    assert np.abs(unknown.strength_rel).max() > 0.5


def test_heading_minus_reading_and_strength_over_the_usual() -> None:
    at = np.array([0.5])
    readings = CompassReadings(np.zeros(1), np.array([0.2]), np.array([26.0]), np.array([0.2]), np.array([0.8]))
    off = compass_residuals(readings, at, np.array([[0.0, 0.0, 20.0]]), CONFIG)
    assert off.across_rad == pytest.approx([0.3])
    assert off.strength_rel == pytest.approx([0.3])
    assert off.across_weight == pytest.approx([1.0])  # within 1.5 of its own 0.2 rad
    far = compass_residuals(readings, np.array([0.8]), np.array([[0.0, 0.0, 10.0]]), CONFIG)
    assert far.across_weight == pytest.approx([0.5])
    assert far.strength_weight == pytest.approx([0.3 / 1.6])


def test_derivatives_by_the_iron_are_numerical_ones() -> None:
    readings, h = readings_of(ALL_ROUND, np.array([5.0, 3.0])), 1e-6
    iron_ut = np.tile([2.0, -4.0, 18.0], (12, 1))
    off = compass_residuals(readings, ALL_ROUND, iron_ut, CONFIG)
    for axis in range(3):
        more = compass_residuals(readings, ALL_ROUND, iron_ut + h * np.eye(3)[axis], CONFIG)
        assert np.allclose((more.across_rad - off.across_rad) / h, off.across_by_iron[axis], atol=1e-5)
        if axis < 2:
            assert np.allclose((more.strength_rel - off.strength_rel) / h, off.strength_by_iron[axis], atol=1e-5)
    # by its own usual strength: over a usual that is taken as known
    assert np.allclose(off.strength_by_iron[2], -1.0 / 18.0)


def test_where_iron_cancels_the_field_its_direction_is_hardly_a_reading() -> None:
    """1 µT of 20 is left, whose direction a µT of iron would turn by a radian: it counts as 0.3 of the usual 20."""
    readings = CompassReadings(np.zeros(1), np.zeros(1), np.array([1.0]), np.array([0.2]), np.array([0.8]))
    off = compass_residuals(readings, np.zeros(1), np.array([[0.0, 0.0, 20.0]]), CONFIG)
    assert np.hypot(*off.across_by_iron[:2]) == pytest.approx(1.0 / 6.0)


def test_readings_are_of_the_device_not_of_the_walker() -> None:
    step = replace(make_step(length_m=0.7, yaw_mag_rad=1.5, mag_norm_ut=50.0, mag_dip_rad=1.0), mount_rad=0.4)
    readings = compass_readings([step, step], FieldMemory(20.0, 0.5), CONFIG)
    assert len(readings) == 2
    assert readings.yaw_rad == pytest.approx([1.1, 1.1])
    assert readings.level_ut == pytest.approx([50.0 * math.cos(1.0)] * 2)
    assert readings.own_rad == pytest.approx([0.2, 0.2])
    assert readings.sigma_rad == pytest.approx([0.2 * 4.1427403] * 2, rel=1e-6)
    one = compass_reading(step, FieldMemory(20.0, 0.5), CONFIG)
    assert one == tuple(getattr(readings, name)[0] for name in one._fields)


def test_one_reading_is_compared_as_many_are() -> None:
    readings, iron_ut = readings_of(ALL_ROUND, np.array([5.0, 3.0]), 0.3), np.array([2.0, -4.0, 18.0])
    many = compass_residuals(readings, ALL_ROUND + 0.5, np.tile(iron_ut, (12, 1)), CONFIG)
    for i, yaw_rad in enumerate((ALL_ROUND + 0.5).tolist()):
        one = CompassReading(*(float(getattr(readings, name)[i]) for name in CompassReading._fields))
        for alone, among in zip(compass_residuals(one, yaw_rad, iron_ut, CONFIG), many, strict=True):
            assert np.array(alone) == pytest.approx(np.array(among)[..., i], abs=1e-15)


def test_little_iron_is_likely_and_much_is_possible() -> None:
    """Student's t of one degree of freedom: a Gaussian of 1 / √3 at nothing, and ever wider further out."""
    assert iron_sigma_ut(np.array([0.0, 0.0, 20.0]), CONFIG) == pytest.approx(1.0 / math.sqrt(3.0))
    assert iron_sigma_ut(np.array([3.0, 4.0, 20.0]), CONFIG) == pytest.approx(math.sqrt(26.0 / 3.0))
    assert iron_cost(np.array([3.0, 4.0, 20.0]), CONFIG) == pytest.approx(1.5 * math.log(26.0))
    # reweighted, the Gaussian pulls as the t does: h / sigma² is the derivative of the cost
    iron_ut, h = np.array([3.0, 4.0, 20.0]), 1e-6
    slope = (iron_cost(iron_ut + h * np.eye(3)[0], CONFIG) - iron_cost(iron_ut, CONFIG)) / h
    assert slope == pytest.approx(3.0 / iron_sigma_ut(iron_ut, CONFIG) ** 2, rel=1e-5)


def test_the_field_describes_a_circle_about_the_iron() -> None:
    readings = readings_of(ALL_ROUND, np.array([18.0, -7.0]))
    assert circle_through(readings, np.ones(12, dtype=bool)) == pytest.approx([18.0, -7.0, LEVEL_UT])
    half = ALL_ROUND < 3.0  # the others are of another device
    readings = replace(readings, level_ut=np.where(half, readings.level_ut, 300.0))
    assert circle_through(readings, half) == pytest.approx([18.0, -7.0, LEVEL_UT])


def steadily(count: int, sigma_rad: float = 0.2) -> CompassReadings:
    some, own = np.zeros(count), np.full(count, sigma_rad)
    return CompassReadings(some, some, np.full(count, 20.0), own, 4.0 * own)


WAY_M: FloatArray = 0.7 * np.arange(1.0, 401.0)


def test_a_compass_that_agrees_with_the_gyroscope_is_believed_as_before() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.2, 200)
    for off_rad in (np.zeros(200), np.full(200, 2.0), noise, np.cumsum(np.full(200, 0.01))):
        told = scattered(steadily(200), off_rad, WAY_M[:200], CONFIG)
        assert told.own_rad == pytest.approx(0.2, rel=0.3)
        assert (told.own_rad >= 0.2).all()


def test_a_compass_that_points_anywhere_is_not_believed() -> None:
    """a - 2b + c is then anywhere on the circle, its median π / 2; what was believed before halves the square."""
    off_rad = np.random.default_rng(2).uniform(-np.pi, np.pi, 200)
    told = scattered(steadily(200), off_rad, WAY_M[:200], CONFIG)
    assert np.median(told.own_rad) == pytest.approx(0.69, rel=0.25)
    assert told.sigma_rad == pytest.approx(4.0 * told.own_rad)


def test_a_gyroscope_that_drifts_is_not_the_compasss_fault() -> None:
    for off_rad in (0.05 * np.arange(200.0), np.cumsum(np.where(np.arange(200) < 100, 0.0, 0.05))):
        assert scattered(steadily(200), off_rad, WAY_M[:200], CONFIG).own_rad == pytest.approx(0.2)


def test_noise_of_three_times_the_usual_is_seen_and_where_it_is() -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.2, 400)
    noise[200:] *= 3.0
    told = scattered(steadily(400), noise, WAY_M, CONFIG)
    assert np.median(told.own_rad[:170]) == pytest.approx(0.2, rel=0.1)
    assert np.median(told.own_rad[230:]) == pytest.approx(0.2 * math.sqrt(0.5 * (1.0 + 9.0)), rel=0.2)


def test_a_few_outliers_are_left_to_the_robust_loss() -> None:
    off_rad = np.zeros(200)
    off_rad[90:97] = 1.5
    assert scattered(steadily(200), off_rad, WAY_M[:200], CONFIG).own_rad == pytest.approx(0.2)


def test_of_a_short_walk_nothing_is_told() -> None:
    readings = steadily(40)
    assert scattered(readings, np.linspace(0.0, 9.0, 40), WAY_M[:40], CONFIG) is readings
