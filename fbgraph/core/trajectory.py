"""Trajectory: what every estimator returns, and TUM files, which every trajectory tool reads."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class Breadcrumb:
    """One state of a trajectory as it was estimated at some moment.

    Attributes:
        k: index of the breadcrumb; 0 is the standing start.
        t_s: time of its step, seconds since log start.
        x_m, y_m, z_m, yaw_rad, gyro_bias_rad_s: its state.
        distance_m: walked so far.
    """

    k: int
    t_s: float
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    gyro_bias_rad_s: float
    distance_m: float


@dataclass(frozen=True)
class Trajectory:
    """Breadcrumbs of one estimator, K + 1 of them for K steps: node 0 is where the first step set out.

    Attributes:
        t_s: (K+1,) seconds since log start.
        x_m, y_m, z_m: (K+1,) in the world frame, the first breadcrumb at the origin.
        yaw_rad: (K+1,) walking direction of the step that ends there, counter-clockwise from East, unwrapped.
        gyro_bias_rad_s: (K+1,) bias of the yaw rate about the vertical; zeros where the estimator has none.
        cov_xy_yaw: (K+1, 3, 3) covariance of (x, y, yaw) in the world frame, or None.
        sigma_z_m: (K+1,) or None.
        sigma_bias_rad_s: (K+1,) or None.
    """

    t_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray
    yaw_rad: FloatArray
    gyro_bias_rad_s: FloatArray
    cov_xy_yaw: FloatArray | None = None
    sigma_z_m: FloatArray | None = None
    sigma_bias_rad_s: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def xy_m(self) -> FloatArray:
        """(K+1, 2)."""
        return np.column_stack((self.x_m, self.y_m))

    @property
    def distance_m(self) -> FloatArray:
        """(K+1,) horizontal distance walked up to each breadcrumb."""
        return np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(self.x_m), np.diff(self.y_m)))))

    @property
    def longest_sigma_m(self) -> FloatArray | None:
        """(K+1,) standard deviation along the longest axis of each breadcrumb's ellipse; None without covariance."""
        if self.cov_xy_yaw is None:
            return None
        return np.asarray(np.sqrt(np.linalg.eigvalsh(self.cov_xy_yaw[:, :2, :2])[:, 1]))

    def until(self, breadcrumb: int) -> Trajectory:
        """The part up to a breadcrumb, it included."""
        known: dict[str, FloatArray] = {
            f.name: getattr(self, f.name)[: breadcrumb + 1] for f in fields(self) if getattr(self, f.name) is not None
        }
        return Trajectory(**known)

    def at(self, t_s: FloatArray) -> FloatArray:
        """(M, 3) position at these times, linear between breadcrumbs, constant before the first and after the last."""
        return np.column_stack([np.interp(t_s, self.t_s, axis) for axis in (self.x_m, self.y_m, self.z_m)])


def write_tum(path: Path, trajectory: Trajectory, t0_s: float) -> None:
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
    np.savetxt(path, table, fmt=["%.6f"] + ["%.6f"] * 3 + ["%.9f"] * 4)


def read_tum(path: Path, t0_s: float = 0.0) -> Trajectory:
    """Read a TUM file written by ``write_tum`` (yaw about z; other tools' files too, if planar).

    Raises:
        DataError: not a TUM file, or no rows.
    """
    try:
        table = np.loadtxt(path, comments="#", ndmin=2)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: not a readable TUM file: {str(error).splitlines()[0]}") from error
    if table.shape[0] == 0 or table.shape[1] != 8:
        raise DataError(f"{path}: a TUM file has rows of 8 numbers (t x y z qx qy qz qw), found {table.shape}")
    t_s, x_m, y_m, z_m, _, _, qz, qw = table.T
    yaw_rad = np.unwrap(2.0 * np.arctan2(qz, qw))
    return Trajectory(t_s - t0_s, x_m, y_m, z_m, yaw_rad, np.zeros(len(t_s)))
