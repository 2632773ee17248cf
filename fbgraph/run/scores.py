"""How each estimator may fairly be scored against known places."""

from __future__ import annotations

from typing import Any

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.metrics import Alignment, score


def score_label(name: str, anchored: bool, closed_walk: bool) -> tuple[str, Alignment]:
    """How an estimator may fairly be scored: ``unaided``, ``closed`` or ``anchored``, and how it is aligned."""
    if name == "smoothed" and anchored:
        return "anchored", "none"  # already in the anchors' frame
    if name == "smoothed" and closed_walk:
        return "closed", "start"
    return "unaided", "start"


def score_entry(
    trajectory: Trajectory, truth: Checkpoints, t0_s: float, label: str, alignment: Alignment
) -> dict[str, Any]:
    """One estimator's score as it is written and printed: labelled, the best rigid fit beside it."""
    return {
        "label": label,
        **score(trajectory, truth, t0_s, alignment).as_dict(),
        "aligned_rmse_m": score(trajectory, truth, t0_s, "rigid").rmse_m,
    }
