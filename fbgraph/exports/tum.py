"""TUM: ``t x y z qx qy qz qw``, the run's own file; or the poses at the truth's times, as they are scored."""

from __future__ import annotations

from dataclasses import replace
from typing import BinaryIO

import numpy as np

from fbgraph.core.tum_files import write_tum
from fbgraph.exports.exported_walk import ExportedWalk
from fbgraph.run.log_again import read_truth_again
from fbgraph.run.metrics import checkpoint_offsets
from fbgraph.run.read_run import trajectory_of
from fbgraph.run.scores import score_label
from fbgraph.run.truth_rows import truth_rows

DESCRIPTION = "t x y z qx qy qz qw, for evo and any trajectory tool"
SUFFIX, BINARY, ON_EARTH = ".tum", False, False


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it.

    Raises:
        DataError: poses at the truth's times of a run whose truth cannot be read any more.
    """
    if not walk.at_truth:
        out.write((walk.run.folder / f"{walk.estimator}.tum").read_bytes())
        return []
    run, summary = walk.run, walk.run.summary
    truth = read_truth_again(run, walk.log_path)
    told = bool(summary.get("anchors")), bool(summary.get("closed_walk"))
    t0_s = float(summary["log"]["t0_s"])
    log_s = t0_s, t0_s + float(summary["log"]["duration_s"])
    best = "smoothed" if "smoothed" in run.trajectories else "ekf"
    t_s, places_m = truth_rows(trajectory_of(run, best), truth, score_label(best, *told)[1], log_s)
    offset_m = checkpoint_offsets(walk.trajectory, truth, 0.0, score_label(walk.estimator, *told)[1], log_s)
    t_s, places_m = t_s[-len(offset_m) :], places_m[-len(offset_m) :]  # who is anchored is scored at the first too
    places_m[:, :2] += offset_m
    poses = replace(
        walk.trajectory,
        t_s=t_s,
        x_m=places_m[:, 0],
        y_m=places_m[:, 1],
        z_m=places_m[:, 2],
        yaw_rad=np.interp(t_s, walk.trajectory.t_s, walk.trajectory.yaw_rad),
    )
    write_tum(out, poses, 0.0)
    return [f"poses as {walk.estimator} is scored: moved to agree at the first known place, {len(poses)} of truth.tum"]
