"""Node: a value of every state of one breadcrumb."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, D, X, Z

from fbgraph.core.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class Node:
    """A value of every state of one breadcrumb."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    bias_rad_s: float
    isobar_m: float = 0.0
    gyro_scale: float = 0.0

    @property
    def pose(self) -> gtsam.Pose2:
        """As a gtsam.Pose2."""
        return gtsam.Pose2(self.x_m, self.y_m, self.yaw_rad)

    @property
    def gyroscope(self) -> FloatArray:
        """(2,) its bias and scale."""
        return np.array([self.bias_rad_s, self.gyro_scale])

    def insert_into(self, values: gtsam.Values, k: int) -> None:
        """Let values hold it as breadcrumb ``k``."""
        # (``insert`` does the same, but asks thirty other types first whether a number is one of them)
        values.insert_or_assign(X(k), pose2=self.pose)
        values.insert_or_assign(Z(k), c=self.z_m)
        values.insert(B(k), self.gyroscope)
        values.insert_or_assign(D(k), c=self.isobar_m)
