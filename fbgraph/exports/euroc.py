"""EuRoC / ASL: the poses as in the data sets' ``state_groundtruth_estimate0/data.csv``, its first eight columns.

``R`` is the walk's world frame; ``S`` looks where the person walks (x) with z up. What comes after the quaternion
there, velocity and biases in the device's axes, no estimator here gives.
"""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from fbgraph.exports.exported_walk import ExportedWalk

DESCRIPTION = "timestamp in ns, position, quaternion, as EuRoC's ground truth; for OpenVINS, Kalibr, evo"
SUFFIX, BINARY, ON_EARTH = ".csv", False, False
HEADER = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it."""
    way = walk.trajectory
    zeros = np.zeros(len(way))
    columns = (way.x_m, way.y_m, way.z_m, np.cos(way.yaw_rad / 2.0), zeros, zeros, np.sin(way.yaw_rad / 2.0))
    rows = np.column_stack(columns).tolist()
    lines = [HEADER] + [
        f"{round(t_s * 1e6) * 1000},{x:.6f},{y:.6f},{z:.6f},{qw:.9f},{qx:.0f},{qy:.0f},{qz:.9f}"
        for t_s, (x, y, z, qw, qx, qy, qz) in zip(way.t_s.tolist(), rows, strict=True)
    ]
    out.write(("\n".join(lines) + "\n").encode())
    return []
