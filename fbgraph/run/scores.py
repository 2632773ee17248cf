"""How each estimator may fairly be scored against known places."""

from __future__ import annotations

from typing import Any

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.coverage import coverage
from fbgraph.run.metrics import Alignment, score


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
    """One estimator's score as it is written and printed: labelled, the best rigid fit and its ellipses' coverage."""
    entry = {
        "label": label,
        **score(trajectory, truth, t0_s, alignment, log_s).as_dict(),
        "aligned_rmse_m": score(trajectory, truth, t0_s, "rigid", log_s).rmse_m,
    }
    covered = coverage(trajectory, truth, t0_s, alignment, log_s)
    return entry if covered is None else {**entry, "coverage": covered.as_dict()}
