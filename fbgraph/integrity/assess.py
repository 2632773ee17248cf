"""One verdict from all checks, and what it does to the covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Integrity, Verdict
from fbgraph.integrity.aid_checks import aids_that_contradict, closures_doubted, field_unlike_the_building
from fbgraph.integrity.carrying_checks import mount_does_not_fit, turned_in_hand
from fbgraph.integrity.compass_checks import compass_against_gyroscope, field_strength, field_upside_down
from fbgraph.integrity.evidence import Check, Doubt, Evidence, SensedCheck
from fbgraph.integrity.sensor_checks import (
    clock_set,
    cut_off_values,
    frozen_magnetometer,
    frozen_sensors,
    gravity_against_gyroscope,
    gravitys_size,
    limp_gyroscope,
    noisy_sensors,
    silent_sensors,
    sparse_samples,
    too_slow,
)
from fbgraph.integrity.solution_checks import (
    factors_beyond_their_sigmas,
    smoother_against_others,
    solver_at_its_limit,
    solver_failed,
)
from fbgraph.integrity.walk_checks import rhythm, rise_of_a_step, unexplained_time

SENSED_CHECKS: tuple[SensedCheck, ...] = (
    frozen_magnetometer,
    frozen_sensors,
    silent_sensors,
    cut_off_values,
    noisy_sensors,
    sparse_samples,
    too_slow,
    clock_set,
    gravitys_size,
    gravity_against_gyroscope,
    limp_gyroscope,
    field_strength,
    field_upside_down,
    compass_against_gyroscope,
    rhythm,
    rise_of_a_step,
)
"""Those that can be asked of a part of a walk, while it goes on."""
CHECKS: tuple[Check, ...] = (
    *SENSED_CHECKS,
    unexplained_time,
    solver_failed,
    solver_at_its_limit,
    factors_beyond_their_sigmas,
    smoother_against_others,
    mount_does_not_fit,
    turned_in_hand,
    aids_that_contradict,
    closures_doubted,
    field_unlike_the_building,
)
"""In no order: what they find is sorted by weight."""


@dataclass(frozen=True)
class Assessment:
    """What all checks of a walk came to.

    Attributes:
        integrity: the verdict.
        trajectory: the smoothed walk, its covariance widened to what was found.
    """

    integrity: Integrity
    trajectory: Trajectory


def assess(walk: Evidence, checks: Sequence[Check] = CHECKS) -> Assessment:
    """Check a walk against everything that is known of it."""
    doubts = [doubt for check in checks for doubt in check(walk)]
    doubts.sort(key=lambda doubt: -doubt.reason.weight)
    return judged(doubts, walk.smoothed.trajectory)


def judged(doubts: Sequence[Doubt], trajectory: Trajectory) -> Assessment:
    """The verdict of doubts in order of weight, and the trajectory widened by them."""
    wider = widened(trajectory, doubts)
    factor = 1.0
    if (before := trajectory.longest_sigma_m) is not None and (after := wider.longest_sigma_m) is not None:
        factor = float(after[-1] / max(before[-1], 1e-9))
    return Assessment(Integrity(verdict_of(doubts), tuple(doubt.reason for doubt in doubts), factor), wider)


def verdict_of(doubts: Sequence[Doubt]) -> Verdict:
    """What doubts come to."""
    return "withheld" if any(doubt.withhold for doubt in doubts) else "doubtful" if doubts else "sound"


def widened(trajectory: Trajectory, doubts: Sequence[Doubt]) -> Trajectory:
    """A trajectory whose covariance allows for what was found: variances of independent reasons add."""
    count = len(trajectory)
    cov, sigma_z = trajectory.cov_xy_yaw, trajectory.sigma_z_m
    place, altitude = _variance(count, [d.sigma_m for d in doubts]), _variance(count, [d.sigma_z_m for d in doubts])
    if cov is not None and place.any():
        # nobody is further off than twice as far as was walked
        place = np.minimum(place, (2.0 * trajectory.distance_m) ** 2)
        cov = cov.copy()
        cov[:, 0, 0] += place
        cov[:, 1, 1] += place
    if sigma_z is not None and altitude.any():
        sigma_z = np.sqrt(sigma_z**2 + altitude)
    return replace(trajectory, cov_xy_yaw=cov, sigma_z_m=sigma_z)


def _variance(count: int, sigmas: Sequence[FloatArray | None]) -> FloatArray:
    total = np.zeros(count)
    for sigma in sigmas:
        if sigma is not None:
            total += np.asarray(sigma) ** 2
    return total
