"""What the compass says at a step, once the device's own iron is taken out.

The horizontal field in the device's frame is that of the Earth, of strength H, seen from its direction θ, plus
what the device itself adds, the hard iron h, plus the iron of the place:

    L (cos m, -sin m) = H (cos θ, -sin θ) + h + iron of the place

with L the horizontal field measured and m the direction that it seems to show (Vasconcelos et al., IEEE T-AES
47(2), 2011). So h shows twice: as a strength and as a compass error that both follow the heading.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import BoolArray, FloatArray, wrap_angle
from fbgraph.estimators.magnetic_field import FieldMemory
from fbgraph.front_end.step_track import Step

_WEAK = 0.3  # of the usual strength: a weaker rest of the field tells no direction
_FAINT_UT = 5.0
_TAIL = 1.0  # degrees of freedom of Student's t: most devices are calibrated, some are far from it
_TRIPLES = 51  # of readings, of which a variance is told
_MEDIAN_CHI2 = 0.4549364  # of one degree of freedom
_ANYWHERE_RAD2 = math.pi**2 / 3.0  # variance of a compass that points anywhere
H_X, H_Y, STRENGTH = range(3)
"""Of the state (h_x, h_y, H): hard iron and usual horizontal strength, µT."""


class CompassReading(NamedTuple):
    """What the compass said at one step; the same as in ``CompassReadings``."""

    mount_rad: float
    yaw_rad: float
    level_ut: float
    own_rad: float
    sigma_rad: float


@dataclass(frozen=True, slots=True)
class CompassReadings:
    """Compass readings, (N,) of them.

    Attributes:
        mount_rad: walking direction against the device's forward, with which its own iron turns.
        yaw_rad: direction of the device's forward as measured, m.
        level_ut: horizontal strength as measured, L.
        own_rad: how far off an undisturbed reading may be; the robust loss begins there.
        sigma_rad: the same, larger as neighbouring steps share the iron of their place.
    """

    mount_rad: FloatArray
    yaw_rad: FloatArray
    level_ut: FloatArray
    own_rad: FloatArray
    sigma_rad: FloatArray

    def __len__(self) -> int:
        return len(self.yaw_rad)

    @staticmethod
    def of(readings: Sequence[CompassReading]) -> CompassReadings:
        """Readings in order as columns."""
        return CompassReadings(*np.array(readings, dtype=float).reshape(-1, len(CompassReading._fields)).T.copy())


class CompassResiduals(NamedTuple):
    """Compass readings against a heading, with the iron of a device; (N,) each, derivatives three of them.

    Of one reading, numbers.

    Attributes:
        across_rad: heading minus corrected reading, wrapped.
        across_by_iron: its derivative by (h_x, h_y, H), per µT.
        strength_rel: corrected strength minus H, over H.
        strength_by_iron: its derivative.
        across_weight, strength_weight: what Huber's loss leaves of them, 0 to 1.
    """

    across_rad: FloatArray
    across_by_iron: tuple[FloatArray, FloatArray, FloatArray]
    strength_rel: FloatArray
    strength_by_iron: tuple[FloatArray, FloatArray, FloatArray]
    across_weight: FloatArray
    strength_weight: FloatArray


def compass_reading(step: Step, field: FieldMemory, config: GraphConfig) -> CompassReading:
    """The reading of a step that has one.

    Args:
        step: at which the magnetometer was heard.
        field: the field's recent usual; learns from it.
        config: of the graph.
    """
    own = config.sigma_mag_rad * math.sqrt(field.inflation(step))
    # compass errors are those of the place: N correlated steps know as much as N (1 - a) / (1 + a) free ones
    # (information of a first-order Gauss-Markov process with a = exp(-L / correlation length))
    a = math.exp(-max(step.length_m, 0.05) / config.mag_correlation_m)
    level = step.mag_norm_ut * math.cos(step.mag_dip_rad)
    sigma = own * math.sqrt((1.0 + a) / (1.0 - a))
    return CompassReading(step.mount_rad, step.yaw_mag_rad - step.mount_rad, level, own, sigma)


def compass_readings(steps: Sequence[Step], field: FieldMemory, config: GraphConfig) -> CompassReadings:
    """The same of steps in order."""
    return CompassReadings.of([compass_reading(step, field, config) for step in steps])


def compass_residuals(
    readings: CompassReadings | CompassReading,
    yaw_rad: FloatArray | float,
    iron_ut: FloatArray,
    config: GraphConfig,
) -> CompassResiduals:
    """Compare readings with headings.

    Args:
        readings: (N,) of them, or one.
        yaw_rad: (N,) walking directions, or one.
        iron_ut: (N, 3) hard iron and usual horizontal strength at each, or (3,).
        config: of the graph.
    """
    h_x, h_y, believed = iron_ut.T
    usual = np.maximum(believed, _FAINT_UT)
    u = readings.level_ut * np.cos(readings.yaw_rad) - h_x
    v = -readings.level_ut * np.sin(readings.yaw_rad) - h_y
    level = np.maximum(np.hypot(u, v), 1e-6)
    both = level * np.maximum(level, _WEAK * usual)
    across = wrap_angle(yaw_rad - readings.mount_rad + np.arctan2(v, u))
    strength = (level - believed) / usual
    limit, by_level = config.mag_huber * readings.own_rad, -1.0 / (level * usual)
    return CompassResiduals(
        across,
        (v / both, -u / both, 0.0 * u),
        strength,
        (u * by_level, v * by_level, -1.0 / usual),
        np.minimum(1.0, limit / np.maximum(np.abs(across), 1e-9)),
        np.minimum(1.0, limit / np.maximum(np.abs(strength), 1e-9)),
    )


def scattered(
    readings: CompassReadings, across_rad: FloatArray, distance_m: FloatArray, config: GraphConfig
) -> CompassReadings:
    """Readings with standard deviations as large as their residuals show; none gets a smaller one.

    Of three residuals a correlation length apart, a, b and c, a - 2b + c has a variance of 6 σ² if they are free of
    each other, less if not, and nothing of a gyroscope that drifts, which is not the compass's fault. The variance of
    a reading is the median around it, together with what was believed of it before: single outliers are the robust
    loss's, but where iron is so near that the compass points anywhere, it is not believed.

    Args:
        readings: (N,) of them.
        across_rad: (N,) heading minus reading, iron taken out.
        distance_m: (N,) walked until there.
        config: of the graph.
    """
    one = np.searchsorted(distance_m, distance_m + config.mag_correlation_m)
    two = np.searchsorted(distance_m, distance_m + 2.0 * config.mag_correlation_m)
    triples = int(np.searchsorted(two, len(readings)))  # of which the third exists
    if triples < _TRIPLES:
        return readings
    one, two = one[:triples], two[:triples]
    bent = wrap_angle(across_rad[:triples] - 2.0 * across_rad[one] + across_rad[two])
    seen = median_filter(bent**2 / 6.0, size=_TRIPLES, mode="nearest") / _MEDIAN_CHI2
    middle = np.minimum(np.searchsorted(one, np.arange(len(readings))), triples - 1)
    variance = 0.5 * (config.sigma_mag_rad**2 + seen[middle])
    own = np.maximum(readings.own_rad, np.sqrt(np.minimum(variance, _ANYWHERE_RAD2)))
    return replace(readings, own_rad=own, sigma_rad=readings.sigma_rad * own / readings.own_rad)


def iron_sigma_ut(iron_ut: FloatArray, config: GraphConfig) -> float:
    """Standard deviation of the prior on either component of the hard iron: Student's t, reweighted at ``iron_ut``."""
    squared = float(iron_ut[H_X] ** 2 + iron_ut[H_Y] ** 2)
    return math.sqrt((_TAIL * config.sigma_iron_ut**2 + squared) / (_TAIL + 2.0))


def iron_cost(iron_ut: FloatArray, config: GraphConfig) -> float:
    """Negative log of that prior."""
    squared = float(iron_ut[H_X] ** 2 + iron_ut[H_Y] ** 2)
    return 0.5 * (_TAIL + 2.0) * math.log1p(squared / (_TAIL * config.sigma_iron_ut**2))


def circle_through(readings: CompassReadings, which: BoolArray) -> FloatArray:
    """(3,) hard iron and strength by the circle that the horizontal field describes as the wearer turns (Kåsa 1976)."""
    u = (readings.level_ut * np.cos(readings.yaw_rad))[which]
    v = -(readings.level_ut * np.sin(readings.yaw_rad))[which]
    rows = np.column_stack((2.0 * u, 2.0 * v, np.ones(len(u))))
    centre_u, centre_v, rest = np.linalg.lstsq(rows, u**2 + v**2, rcond=None)[0]
    return np.array([centre_u, centre_v, math.sqrt(max(rest + centre_u**2 + centre_v**2, _FAINT_UT**2))])
