"""Node: a value of every state of one breadcrumb."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

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
