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


def mean_of(values: FloatArray) -> FloatArray:
    """Mean along the first axis; ``np.mean`` takes three times as long to find out what it is given a dozen numbers."""
    return np.asarray(np.add.reduce(values, axis=0) / len(values))


def rotate(quat_wxyz: FloatArray, vectors: FloatArray) -> FloatArray:
    """Rotate vectors by their quaternions: ``v_n = nRb v_b``.

    Args:
        quat_wxyz: (N, 4) unit quaternions nRb, scalar first.
        vectors: in the body frame: (N, 3), (3,) to rotate one by all, or (N, 3, M) for M a quaternion.

    Returns:
        (N, 3) or (N, 3, M) in the world frame; a row's result never depends on how many rows come with it.
    """
    w, x, y, z = quat_wxyz.T
    matrix = np.empty((len(quat_wxyz), 3, 3))
    matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 2, 2] = (
        1 - 2 * (y * y + z * z),
        1 - 2 * (x * x + z * z),
        1 - 2 * (x * x + y * y),
    )
    xy, wz, xz, wy, yz, wx = x * y, w * z, x * z, w * y, y * z, w * x
    matrix[:, 0, 1], matrix[:, 1, 0] = 2 * (xy - wz), 2 * (xy + wz)
    matrix[:, 0, 2], matrix[:, 2, 0] = 2 * (xz + wy), 2 * (xz - wy)
    matrix[:, 1, 2], matrix[:, 2, 1] = 2 * (yz - wx), 2 * (yz + wx)
    if vectors.ndim < 3:
        return np.asarray((matrix @ vectors[..., None])[..., 0])
    return np.asarray(matrix @ vectors)


def plane_turns(yaw_rad: FloatArray) -> FloatArray:
    """(N, 3, 3) from the tangent space of a Pose2, in its body's axes, to (x, y, yaw) of the world."""
    turns = np.zeros((len(yaw_rad), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(yaw_rad)
    turns[:, 1, 0] = np.sin(yaw_rad)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1.0
    return turns


def heading_deg(yaw_rad: float) -> float:
    """Compass heading in [0, 360), clockwise from North, of a yaw counter-clockwise from East. For printing only."""
    return (90.0 - math.degrees(yaw_rad)) % 360.0


def turned(places_m: FloatArray, turn_rad: float) -> FloatArray:
    """(…, 2) places turned about the origin, anticlockwise."""
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    return np.asarray(places_m @ np.array([[cos, sin], [-sin, cos]]))
