"""How each estimator may fairly be scored against known places."""

from __future__ import annotations

import math
from typing import Any

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.coverage import coverage
from fbgraph.run.metrics import Alignment, fit_to_truth, score


def score_label(name: str, anchored: bool, closed_walk: bool) -> tuple[str, Alignment]:
    """How an estimator may fairly be scored: ``unaided``, ``closed`` or ``anchored``, and how it is aligned."""
    if name == "smoothed" and anchored:
        return "anchored", "none"  # already in the anchors' frame
    if name == "smoothed" and closed_walk:
        return "closed", "start"
    return "unaided", "start"


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
