"""How each estimator may fairly be scored against known places."""

from __future__ import annotations

import math
from typing import Any

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.coverage import coverage
from fbgraph.run.metrics import Alignment, fit_to_truth, score


def score_label(name: str, anchored: bool, closed_walk: bool, axis: bool = False) -> tuple[str, Alignment]:
    """How an estimator may fairly be scored, and how it is aligned.

    ``unaided``, ``closed``, ``anchored`` or ``axis``; of a walk that was told a building's axis besides, both.
    """
    if name != "smoothed":
        return "unaided", "start"
    told = ["anchored"] if anchored else ["closed"] if closed_walk else []
    told += ["axis"] if axis else []
    return " + ".join(told) or "unaided", "none" if anchored else "start"  # anchors: already in their frame


def score_entry(
    trajectory: Trajectory,
    truth: Checkpoints,
    t0_s: float,
    label: str,
    alignment: Alignment,
    log_s: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """One estimator's score as it is written and printed: labelled, the best rigid fit and its ellipses' coverage.

    ``aligned_rmse_m`` is what the best rigid fit over all checkpoints leaves, ``turned_deg`` how far the walk was
    turned from the truth before it, counter-clockwise (to the left); None where that cannot be told.
    """
    fit = fit_to_truth(trajectory, truth, t0_s, log_s)
    entry = {
        "label": label,
        **score(trajectory, truth, t0_s, alignment, log_s).as_dict(),
        "aligned_rmse_m": fit.rmse_m,
        "turned_deg": None if fit.turn_rad is None else math.degrees(fit.turn_rad),
    }
    covered = coverage(trajectory, truth, t0_s, alignment, log_s)
    return entry if covered is None else {**entry, "coverage": covered.as_dict()}
