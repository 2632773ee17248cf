"""g2o: a pose graph of the walk in the plane, a vertex a breadcrumb, an edge a step; for GTSAM, g2o, Ceres, SE-Sync.

An edge is as uncertain as the run's covariance grows from one breadcrumb to the next, so that places composed from
edges whose headings are exact are as uncertain as the run says; where it does not grow (the compass, an anchor or a
closure pulls it together), as one step is by itself. Heights are not in it.
"""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, plane_turns, wrap_angle
from fbgraph.core.trajectory import Trajectory
from fbgraph.exports.exported_walk import ExportedWalk

DESCRIPTION = "a pose graph in the plane with information matrices; for GTSAM, g2o, Ceres, SE-Sync"
SUFFIX, BINARY, ON_EARTH = ".g2o", False, False


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it.

    Raises:
        DataError: a damaged configuration.
    """
    way, graph = walk.trajectory, walk.run.read_config().graph
    known = way.cov_xy_yaw is not None and bool(np.isfinite(way.cov_xy_yaw[:, [0, 0, 1, 2], [0, 1, 1, 2]]).all())
    cov = _grown(way, graph) if known else _one_step(way, graph)
    # rounded as it is written, so that vertices and edges agree
    poses: FloatArray = np.column_stack((way.x_m, way.y_m, wrap_angle(way.yaw_rad))).round(9)
    turns = plane_turns(poses[:-1, 2])
    edges = (np.diff(poses, axis=0)[:, None, :] @ turns)[:, 0]
    edges[:, 2] = wrap_angle(edges[:, 2])
    upper = np.linalg.inv(cov)[:, *np.triu_indices(3)]
    lines = [f"VERTEX_SE2 {k} " + " ".join(f"{value:.9f}" for value in pose) for k, pose in enumerate(poses.tolist())]
    lines += [
        f"EDGE_SE2 {k} {k + 1} " + " ".join([f"{value:.9f}" for value in edge] + [f"{value:.9g}" for value in row])
        for k, (edge, row) in enumerate(zip(edges.tolist(), upper.tolist(), strict=True))
    ]
    out.write(("\n".join(lines) + "\n").encode())
    return (
        [] if known else [f"{walk.estimator} gives no covariance: the edges' is that of one step by the run's config"]
    )


def _one_step(way: Trajectory, graph: GraphConfig) -> FloatArray:
    """(K, 3, 3) covariance of each step by itself, in the axes of the breadcrumb where it ends."""
    cov = np.zeros((len(way) - 1, 3, 3))
    along_m = graph.sigma_length_rel * np.diff(way.distance_m)
    cov[:, 0, 0] = along_m**2 + graph.sigma_lateral_m**2
    cov[:, 1, 1] = graph.sigma_lateral_m**2
    cov[:, 2, 2] = graph.sigma_yaw_step_rad**2
    return cov


def _grown(way: Trajectory, graph: GraphConfig) -> FloatArray:
    """(K, 3, 3) by how much the covariance grows, never less than a step's smallest, in the same axes."""
    assert way.cov_xy_yaw is not None
    cov = np.zeros((len(way) - 1, 3, 3))
    turns = plane_turns(way.yaw_rad[1:])[:, :2, :2]
    growth = turns.swapaxes(1, 2) @ np.diff(way.cov_xy_yaw[:, :2, :2], axis=0) @ turns
    variance, axes = np.linalg.eigh(growth)
    least = np.maximum(variance, graph.sigma_lateral_m**2)
    cov[:, :2, :2] = (axes * least[:, None, :]) @ axes.swapaxes(1, 2)
    cov[:, 2, 2] = np.maximum(np.diff(way.cov_xy_yaw[:, 2, 2]), graph.sigma_yaw_step_rad**2)
    return cov
