"""Trajectory: what every estimator returns."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from fbgraph.core.geometry import FloatArray

if TYPE_CHECKING:
    import pandas as pd


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

    def to_dataframe(self) -> pd.DataFrame:
        """A row a breadcrumb, for pandas; nan where the estimator says nothing.

        Returns:
            ``t_s, x_m, y_m, z_m, yaw_rad, gyro_bias_rad_s``, standard deviations ``sigma_x_m, sigma_y_m, cov_xy_m2,
            sigma_z_m, sigma_yaw_rad, sigma_bias_rad_s``, and the ellipse of one sigma: half axes ``ellipse_major_m,
            ellipse_minor_m`` and ``ellipse_yaw_rad``, the direction of the longer one counter-clockwise from East.
        """
        import pandas as pd  # here, because it takes a second to import

        unknown = np.full(len(self), np.nan)
        cov = np.full((len(self), 3, 3), np.nan) if self.cov_xy_yaw is None else self.cov_xy_yaw
        half_m, axis = np.full((len(self), 2), np.nan), np.full((len(self), 2, 2), np.nan)
        known = np.isfinite(cov[:, :2, :2]).all(axis=(1, 2))
        variance, axis[known] = np.linalg.eigh(cov[known, :2, :2])
        half_m[known] = np.sqrt(np.maximum(variance, 0.0))
        columns = {name: getattr(self, name) for name in ("t_s", "x_m", "y_m", "z_m", "yaw_rad", "gyro_bias_rad_s")}
        columns |= {"sigma_x_m": np.sqrt(cov[:, 0, 0]), "sigma_y_m": np.sqrt(cov[:, 1, 1]), "cov_xy_m2": cov[:, 0, 1]}
        columns |= {
            "sigma_z_m": unknown if self.sigma_z_m is None else self.sigma_z_m,
            "sigma_yaw_rad": np.sqrt(cov[:, 2, 2]),
            "sigma_bias_rad_s": unknown if self.sigma_bias_rad_s is None else self.sigma_bias_rad_s,
            "ellipse_major_m": half_m[:, 1],
            "ellipse_minor_m": half_m[:, 0],
            "ellipse_yaw_rad": np.arctan2(axis[:, 1, 1], axis[:, 0, 1]),
        }
        return pd.DataFrame(columns)

    def until(self, breadcrumb: int) -> Trajectory:
        """The part up to a breadcrumb, it included."""
        known: dict[str, FloatArray] = {
            f.name: getattr(self, f.name)[: breadcrumb + 1] for f in fields(self) if getattr(self, f.name) is not None
        }
        return Trajectory(**known)

    def turned(self, angle_rad: float, about_m: FloatArray | None = None) -> Trajectory:
        """The same walk, its covariance too, turned counter-clockwise about a place, its first breadcrumb if None."""
        pivot_m = self.xy_m[0] if about_m is None else about_m
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        turn = np.array([[c, -s], [s, c]])
        x_m, y_m = turn @ (self.xy_m - pivot_m).T + pivot_m[:, None]
        cov = self.cov_xy_yaw
        if cov is not None:  # by blocks: those of place and yaw may be unknown
            cov = cov.copy()
            cov[:, :2, :2] = turn @ cov[:, :2, :2] @ turn.T
            cov[:, :2, 2] = cov[:, 2, :2] = cov[:, :2, 2] @ turn.T
        return replace(self, x_m=x_m, y_m=y_m, yaw_rad=self.yaw_rad + angle_rad, cov_xy_yaw=cov)

    def since(self, t0_s: float) -> Trajectory:
        """The same breadcrumbs, their times in seconds since ``t0_s``."""
        return replace(self, t_s=self.t_s - t0_s)

    def at(self, t_s: FloatArray) -> FloatArray:
        """(M, 3) position at these times, linear between breadcrumbs, constant before the first and after the last."""
        return np.column_stack([np.interp(t_s, self.t_s, axis) for axis in (self.x_m, self.y_m, self.z_m)])
