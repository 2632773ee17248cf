"""Truth in a walk's own frame, as a TUM file that ``evo_ape tum truth.tum smoothed.tum`` scores as we do.

evo pairs poses by time, within 10 ms, and measures in three dimensions. So each checkpoint is told at its breadcrumb
nearest in time, moved as far as the walk moved between the two, at the walk's own height: the distance of that pair is
the horizontal error at the checkpoint. The first checkpoint, where the walk is moved to agree, is not scored and not
there. Truth of more places than the walk has steps stays at its own times.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fbgraph.core.checkpoints import Checkpoints, anchor_breadcrumbs
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.metrics import Alignment, checkpoint_offsets

TRUTH = "truth.tum"
_TICK_S = 1e-6  # of the files: rows of one breadcrumb are told apart by it


def is_dense(trajectory: Trajectory, truth: Checkpoints) -> bool:
    """Whether truth has so many places that evo would look for one a breadcrumb instead of the other way round."""
    return len(truth) >= len(trajectory)


def truth_rows(
    trajectory: Trajectory, truth: Checkpoints, alignment: Alignment, log_s: tuple[float, float] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Times and places of the scored checkpoints in a trajectory's frame.

    Args:
        trajectory, truth: on one clock.
        alignment: ``start`` or ``none``, as the trajectory is scored.
        log_s: as in ``checkpoint_errors``.

    Returns:
        (M,) increasing times and (M, 3) places: of breadcrumbs, if truth is not dense.

    Raises:
        DataError: truth that does not belong to it.
    """
    offset_m = checkpoint_offsets(trajectory, truth, 0.0, alignment, log_s)
    t_s = truth.t_s[-len(offset_m) :]
    if not is_dense(trajectory, truth):
        t_s = trajectory.t_s[anchor_breadcrumbs(truth, trajectory.t_s)[-len(offset_m) :]]
    places_m = trajectory.at(t_s)
    places_m[:, :2] -= offset_m
    ticks_s = _TICK_S * np.arange(len(t_s))
    return np.maximum.accumulate(t_s - ticks_s) + ticks_s, places_m


def write_truth_tum(
    path: Path,
    name: str,
    trajectory: Trajectory,
    truth: Checkpoints,
    alignment: Alignment,
    log_s: tuple[float, float] | None = None,
) -> None:
    """Write ``truth.tum``; its first lines, comments, say what it holds.

    Args:
        path: the file.
        name: of the trajectory's estimator.
        trajectory, truth, alignment, log_s: as in ``truth_rows``; times are written as they are.

    Raises:
        DataError: truth that does not belong to it.
    """
    t_s, places_m = truth_rows(trajectory, truth, alignment, log_s)
    first = "" if alignment == "none" else ", which agrees with the first known place"
    said = (
        f"known places in the frame of {name}.tum{first}; heights are the walk's own, directions are not known\n"
        + (
            f"more places than steps, of which evo would take one a step: all are scored with the poses of "
            f"`fbgraph export RUN --to tum --estimator {name} --at truth`"
            if is_dense(trajectory, truth)
            else f"each at the step nearest in time, moved as {name}.tum moved between: "
            f"`evo_ape tum {TRUTH} {name}.tum` gives the score of summary.json"
        )
        + "\nt x y z qx qy qz qw"
    )
    turn = np.tile((0.0, 0.0, 0.0, 1.0), (len(t_s), 1))
    table = np.column_stack((t_s, places_m.round(6) + 0.0, turn))  # no -0.0
    np.savetxt(path, table, fmt=["%.6f"] * 4 + ["%d"] * 4, header=said, encoding="utf-8")
