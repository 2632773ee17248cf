"""Angles and rotations that numpy and scipy do not name."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


def wrap_angle(angle_rad: FloatArray) -> FloatArray:
    """The same angles in [-π, π), any shape."""
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi


def wrap_scalar(angle_rad: float) -> float:
    """The same angle in [-π, π); plain floats, for loops over steps."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def rotate(quat_wxyz: FloatArray, vectors: FloatArray) -> FloatArray:
    """Rotate each vector by its quaternion: ``v_n = nRb v_b``.

    Written out element by element so that a row's result never depends on how many rows come with it.

    Args:
        quat_wxyz: (N, 4) unit quaternions nRb, scalar first.
        vectors: (N, 3) in the body frame, or (3,) to rotate one vector by all.

    Returns:
        (N, 3) in the world frame.
    """
    w, x, y, z = quat_wxyz.T
    vx, vy, vz = np.broadcast_to(vectors, (len(quat_wxyz), 3)).T
    # v + 2w(q×v) + 2 q×(q×v)
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return np.column_stack(
        (
            vx + w * tx + y * tz - z * ty,
            vy + w * ty + z * tx - x * tz,
            vz + w * tz + x * ty - y * tx,
        )
    )


def heading_deg(yaw_rad: float) -> float:
    """Compass heading in [0, 360), clockwise from North, of a yaw counter-clockwise from East. For printing only."""
    return (90.0 - math.degrees(yaw_rad)) % 360.0
