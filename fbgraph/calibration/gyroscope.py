"""The gyroscope's scale, by the turns between legs whose directions are known.

By leg i the gyroscope has turned to g_i, its bias b and scale s in it, and the leg really lies along θ_i:

    g_i - θ_i = s g_i + b t_i + o

with o the unknown start. s shows where a walk turns both ways, or unevenly in time; else a bias explains it as well.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.front_end.length_fit import least_squares, step_shares
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.metrics import leg_ends

_LEG_M, _LEAST_STEPS, _STRAIGHT = 4.0, 4.0, 0.9
_PLACE_M = 0.3  # of a place that tells no sigma
_WAY_RAD = 0.05  # who walks from one place to the next sways and cuts corners
_LEAST_LEGS = 5
_WIDE = np.array([1.0, 0.1, 2.0 * np.pi])  # what is thought possible of scale, bias (rad/s) and start


def scale_by_places(track: StepTrack, places: Checkpoints, config: GraphConfig) -> tuple[float, float]:
    """Share by which the gyroscope shows too much of a turn, and its standard deviation; nan with too few legs.

    Args:
        track: the steps.
        places: on its clock.
        config: how fast the bias drifts.
    """
    rows = _directions(track, places)
    if len(rows) < _LEAST_LEGS:
        return np.nan, np.nan
    t_s, by_gyro, really, sigma = rows.T
    t_s = t_s - t_s[0]
    off = np.unwrap(wrap_angle(by_gyro - really))
    early, late = np.minimum.outer(t_s, t_s), np.maximum.outer(t_s, t_s)
    drifted = config.sigma_bias_walk_rad_s**2 * early**2 * (late / 2.0 - early / 6.0)  # of an integrated random walk
    root = np.linalg.cholesky(drifted + np.diag(sigma**2))
    terms = np.column_stack((by_gyro - by_gyro.mean(), t_s, np.ones(len(t_s))))
    whitened = np.linalg.solve(root, np.column_stack((terms, off)))
    found, cov = least_squares(whitened[:, :3], whitened[:, 3], np.zeros(3), np.diag(1.0 / _WIDE))
    return float(found[0]), float(np.sqrt(cov[0, 0]))


def _directions(track: StepTrack, places: Checkpoints) -> FloatArray:
    """(S, 4) of straight legs before any gap: time, direction by the gyroscope and by the places, its sigma."""
    ahead = np.exp(1j * (track.yaw_gyro_rad[1:] - track.yaw_gyro_rad[1]))
    gaps = np.flatnonzero(track.chained == 0)
    until_s = float(track.t_s[gaps[0] - 1]) if len(gaps) else np.inf
    sigma_m = np.nan_to_num(places.sigma_m, nan=_PLACE_M)
    rows = []
    for first, last in pairwise(leg_ends(places, None if places.gnss else _LEG_M)):
        share = step_shares(track, float(places.t_s[first]), float(places.t_s[last])) * track.length_m[1:]
        way = complex((share * ahead).sum())
        steps = int((share > 0.0).sum())
        if places.t_s[last] > until_s or steps < _LEAST_STEPS or abs(way) < _STRAIGHT * float(share.sum()):
            continue
        about = float((share * track.yaw_gyro_rad[1:]).sum() / share.sum())  # unwrapped; the way is within half a turn
        by_gyro = about + float(wrap_angle(np.angle(way) + track.yaw_gyro_rad[1] - about))
        leg = complex(*(places.xy_m[last] - places.xy_m[first]).tolist())
        sigma = float(np.hypot(np.hypot(sigma_m[first], sigma_m[last]) / abs(leg), _WAY_RAD))
        rows.append((float((places.t_s[first] + places.t_s[last]) / 2.0), by_gyro, float(np.angle(leg)), sigma))
    return np.array(rows).reshape(-1, 4)
