"""Trajectories as TUM files, which every trajectory tool reads."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np

from fbgraph.core.tables import read_numbers
from fbgraph.core.trajectory import Trajectory

_QUATERNION = 1e-5  # files have six digits at least


def write_tum(out: Path | BinaryIO, trajectory: Trajectory, t0_s: float) -> None:
    """Write ``t x y z qx qy qz qw``, one row a breadcrumb, ``t`` on the format's event clock (``t_s + t0_s``)."""
    half = trajectory.yaw_rad / 2.0
    zeros = np.zeros(len(trajectory))
    table = np.column_stack(
        (
            trajectory.t_s + t0_s,
            trajectory.x_m,
            trajectory.y_m,
            trajectory.z_m,
            zeros,
            zeros,
            np.sin(half),
            np.cos(half),
        )
    )
    np.savetxt(out, table, fmt=["%.6f"] + ["%.6f"] * 3 + ["%.9f"] * 4)


def read_tum(path: Path, t0_s: float = 0.0) -> Trajectory:
    """Read a TUM file written by ``write_tum`` (other tools' files too, if they turn about z only).

    Raises:
        DataError: not a TUM file, no rows, a number that is not finite, times that do not increase, or a quaternion
            that is no turn about z.
    """
    table = read_numbers(path, "a TUM file", "t x y z qx qy qz qw")
    table.refuse_infinite()
    t_s, x_m, y_m, z_m, qx, qy, qz, qw = table.values.T
    table.refuse_unordered(t_s)
    planar = (np.abs(np.hypot(qz, qw) - 1.0) < _QUATERNION) & (np.hypot(qx, qy) < _QUATERNION)
    table.refuse(~planar, "its quaternion is not of length 1 about z")
    yaw_rad = np.unwrap(2.0 * np.arctan2(qz, qw))
    return Trajectory(t_s - t0_s, x_m, y_m, z_m, yaw_rad, np.zeros(len(t_s)))
