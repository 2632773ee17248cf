"""The way out as the way back is compared with it, and what a step says for that comparison."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.front_end.step_length import flat_length_m
from fbgraph.front_end.step_track import Step


@dataclass(frozen=True)
class Outbound:
    """The route walked out, by breadcrumb, (K + 1,) each.

    Attributes:
        t_s: when.
        route_m: distance along it, 0 at the start.
        level_m: the same, each step as long as it would be on the level.
        x_m, y_m: where.
        mag_up_ut, mag_level_ut: vertical and horizontal component of the magnetic field; nan where not known.
        altitude_m: barometric; nan where not known.
    """

    t_s: FloatArray
    route_m: FloatArray
    level_m: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    mag_up_ut: FloatArray
    mag_level_ut: FloatArray
    altitude_m: FloatArray

    @staticmethod
    def of(trajectory: Trajectory, steps: Sequence[Step], length: StepLengthConfig, last: int) -> Outbound:
        """Breadcrumbs 0 to ``last`` of a walk."""
        n = last + 1
        up, level = np.array([field_of(step) for step in steps[:n]]).T
        return Outbound(
            t_s=trajectory.t_s[:n],
            route_m=trajectory.distance_m[:n],
            level_m=np.cumsum([level_length_m(step, length) for step in steps[:n]]),
            x_m=trajectory.x_m[:n],
            y_m=trajectory.y_m[:n],
            mag_up_ut=up,
            mag_level_ut=level,
            altitude_m=np.array([step.altitude_m for step in steps[:n]]),
        )


def field_of(step: Step) -> tuple[float, float]:
    """Vertical (down positive) and horizontal component of the field at a step, µT."""
    return step.mag_norm_ut * math.sin(step.mag_dip_rad), step.mag_norm_ut * math.cos(step.mag_dip_rad)


def level_length_m(step: Step, length: StepLengthConfig) -> float:
    """How long the step would have been on the level; 0 for the standing start."""
    if step.length_m == 0.0:
        return 0.0
    return max(flat_length_m(length, step.frequency_hz, step.surge_m_s), length.shortest_m)


def gap_before_s(steps: Sequence[Step], k: int) -> float:
    """How long the log was silent between step k and the one before it."""
    return 0.0 if steps[k].chained else steps[k].t_s - steps[k - 1].t_s
