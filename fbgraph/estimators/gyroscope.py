"""What the gyroscope says between steps: turns while moving, turns while resting, and how its bias may drift."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, wrap_scalar
from fbgraph.front_end.step_track import Step, StepTrack


class GyroTurn(NamedTuple):
    """The turn from a breadcrumb to the next.

    Attributes:
        turned_rad: by the gyroscope, what its bias added while resting taken out.
        moving_s: time over which the bias adds to it.
        sigma_rad: standard deviation of the turn.
        drift_rad_s: how far the bias may have drifted meanwhile.
    """

    turned_rad: float
    moving_s: float
    sigma_rad: float
    drift_rad_s: float


class GyroTurns(NamedTuple):
    """The same of all K steps of a walk, (K,) each."""

    turned_rad: FloatArray
    moving_s: FloatArray
    sigma_rad: FloatArray
    drift_rad_s: FloatArray


def gyro_turn(before: Step, step: Step, config: GraphConfig) -> GyroTurn:
    """Turn between two consecutive steps.

    While the wearer rests, the turn is the gyroscope's less what its bias added by the rest itself, not less the bias
    of the walk times the length of the rest: a bias known to 0.01 °/s is 36° in an hour. Across a gap of the log the
    gyroscope says nothing.
    """
    dt_s = step.yaw_s - before.yaw_s
    drift = min(config.sigma_bias_walk_rad_s * math.sqrt(max(dt_s, 1e-3)), config.sigma_bias_rad_s)
    if not step.chained:
        return GyroTurn(0.0, 0.0, min(config.sigma_gap_yaw_rad_s * max(dt_s, 0.1), math.pi), drift)
    turned = step.yaw_gyro_rad - before.yaw_gyro_rad - step.rest_drift_rad
    if step.rest_s > 0:  # how often somebody turned right round in a pause, nobody asks, and after hours nobody knows
        turned = wrap_scalar(turned)
    sigma = math.hypot(config.sigma_yaw_step_rad, step.rest_drift_sigma_rad)
    return GyroTurn(turned, max(dt_s - step.rest_s, 0.0), sigma, drift)


def gyro_turns(track: StepTrack, config: GraphConfig) -> GyroTurns:
    """Turns of a whole walk, columns of ``GyroTurn``."""
    rows = [gyro_turn(before, step, config) for before, step in pairwise(track.steps)]
    return GyroTurns(*np.array(rows).reshape(-1, 4).T)
