"""Trajectories made of the directions of their steps."""

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory


def trajectory(yaw_deg: FloatArray, step_m: float | FloatArray = 0.7, z_m: FloatArray | float = 0.0) -> Trajectory:
    """Breadcrumbs of steps in these directions."""
    yaw = np.radians(np.append(yaw_deg[:1], yaw_deg))
    x, y = (np.append(0.0, np.cumsum(step_m * f(yaw[1:]))) for f in (np.cos, np.sin))
    t_s = 0.55 * np.arange(len(yaw), dtype=np.float64)
    return Trajectory(t_s, x, y, np.broadcast_to(z_m, yaw.shape), yaw, np.zeros(len(yaw)))


def wobbly(*legs: tuple[float, int], sigma_deg: float = 2.0) -> FloatArray:
    """Directions of a walker who goes so many steps in each direction given, degrees, not quite straight."""
    yaw = np.concatenate([np.full(count, direction) for direction, count in legs])
    return yaw + np.random.default_rng(0).normal(0.0, sigma_deg, len(yaw))
