"""Baseline dead reckoning, as the paper defines it (section Baseline PDR Method)."""

from __future__ import annotations

import numpy as np

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.front_end.step_track import StepTrack

_START_STEPS = 4


def dead_reckon(track: StepTrack, config: StepLengthConfig) -> Trajectory:
    """Constant step length, direct heading propagation.

    x_k = x_{k-1} + L0 cos θ_k, y_k = y_{k-1} + L0 sin θ_k. The heading is the gyroscope's, less the bias of the
    calibration stage (the first rest, if there was one), started at the compass. Neither turns while the log is silent.
    The baseline has no altitude: z stays 0.
    """
    yaw = calibrated_yaw_rad(track)
    length = np.where(track.length_m > 0, config.constant_m, 0.0)
    zeros = np.zeros(len(track))
    return Trajectory(track.t_s, np.cumsum(length * np.cos(yaw)), np.cumsum(length * np.sin(yaw)), zeros, yaw, zeros)


def calibrated_yaw_rad(track: StepTrack) -> FloatArray:
    """(K+1,) heading of the gyroscope less the calibration stage's bias, started at the compass, still where silent."""
    silent_s = np.cumsum(np.where(track.chained == 0, np.diff(track.yaw_s, prepend=track.yaw_s[0]), 0.0))
    yaw = track.yaw_gyro_rad - calibration_bias_rad_s(track) * (track.yaw_s - track.yaw_s[0] - silent_s)
    return np.asarray(yaw - yaw[0] + first_compass_yaw_rad(track))


def calibration_bias_rad_s(track: StepTrack) -> float:
    """Mean yaw rate of the first rest, the calibration stage; 0 if the wearer never stood still."""
    rests = track.rest_rate_rad_s[np.isfinite(track.rest_rate_rad_s)]
    return float(rests[0]) if len(rests) else 0.0


def first_compass_yaw_rad(track: StepTrack) -> float:
    """Yaw of the start by the compass, over the steps that confirm a walk; 0 (East) without a magnetometer."""
    known = np.flatnonzero(np.isfinite(track.yaw_mag_rad))[:_START_STEPS]
    if len(known) == 0:
        return 0.0
    offset = track.yaw_mag_rad[known] - (track.yaw_gyro_rad[known] - track.yaw_gyro_rad[0])
    return float(np.arctan2(np.sin(offset).mean(), np.cos(offset).mean()))
