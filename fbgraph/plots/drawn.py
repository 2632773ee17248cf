"""What of runs is drawn: trajectories in one frame, each with its errors, its look and its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.colors import LABELS, RUN_COLORS
from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.safe_text import for_terminal
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Integrity
from fbgraph.plots.style import RUN_STYLES, STYLES, Shade, color, run_color
from fbgraph.run.evaluation import NamedRun
from fbgraph.run.metrics import checkpoint_errors
from fbgraph.run.read_run import SavedRun, trajectory_of
from fbgraph.run.scores import score_label

SIGMAS = 2.0
"""What ellipses and bands are drawn of."""
_MOST_NAME = 32
_BEST = ("smoothed", "ekf", "online", "pdr")


@dataclass(frozen=True)
class Drawn:
    """A trajectory of a figure.

    Attributes:
        label: what the legend calls it.
        color, line, marker: how it is drawn.
        way: moved into the frame of the figure, ``t_s`` on the event clock.
        truth: in the frame of the figure, None if nobody knows any.
        error_m: (M,) at the last M checkpoints of the truth; empty without.
        height: whether its altitude is measured.
        main: whether it is what the figure is about; ellipses and bands are drawn of that alone.
    """

    label: str
    color: Shade
    line: Any
    marker: str
    way: Trajectory
    truth: Checkpoints | None
    error_m: FloatArray
    height: bool
    main: bool

    def walked_m(self, t_s: FloatArray) -> FloatArray:
        """Distance walked up to these times of the event clock."""
        return np.asarray(np.interp(t_s, self.way.t_s, self.way.distance_m))

    @property
    def error_walked_m(self) -> FloatArray:
        """(M,) distance walked at the checkpoints of ``error_m``."""
        if self.truth is None:
            return np.empty(0)
        return self.walked_m(self.truth.t_s[len(self.truth) - len(self.error_m) :])


def drawn_of(runs: Sequence[NamedRun], estimators: Sequence[str] = ()) -> list[Drawn]:
    """Choose what is drawn: of one run all estimators, of several the best of each, or those that are named.

    The frame is that of the first run's walk. A run with truth is moved to agree with it at its first checkpoint, as it
    is scored, so that walks whose truth is in one frame lie as they were walked.

    Raises:
        ConfigError: more trajectories than can be told apart, or no estimator of that name.
        DataError: a run does not have a named one, or its truth is another's.
    """
    chosen: list[tuple[NamedRun, str]] = []
    for run in runs:
        there = run.saved.trajectories
        if estimators:
            names = list(dict.fromkeys(estimators))
        else:
            names = [name for name in _BEST if name in there]
            names = names if len(runs) == 1 else names[:1]
        chosen += [(run, name) for name in names]
    if len(runs) > 1 and len(chosen) > len(RUN_COLORS):
        raise ConfigError(
            f"{len(chosen)} trajectories in one figure; {len(RUN_COLORS)} can be told apart: "
            "name fewer runs or estimators"
        )
    origin = _shift_m(*chosen[0])
    return [
        _drawn(run, name, origin, None if len(runs) == 1 else k, main=len(runs) > 1 or k == 0)
        for k, (run, name) in enumerate(chosen)
    ]


def in_order(drawn: Sequence[Drawn]) -> list[Drawn]:
    """What lies below first: what only accompanies, then runs whose lines are ever more broken."""
    return [*(one for one in reversed(drawn) if not one.main), *(one for one in drawn if one.main)]


def distinct_truths(drawn: Sequence[Drawn]) -> list[Checkpoints]:
    """The truths of a figure, each once."""
    found: list[Checkpoints] = []
    for one in drawn:
        truth = one.truth
        if truth is not None and not any(np.array_equal(truth.xy_m, other.xy_m) for other in found):
            found.append(truth)
    return found


def north_of(run: SavedRun, estimator: str = "smoothed") -> str:
    """Which North the y axis of a trajectory's frame points to: ``true``, ``magnetic``, or nothing anybody knows."""
    summary = run.summary
    if summary.get("anchors", 0) > 1 and estimator == "smoothed":
        return "true" if summary.get("georeference") else ""
    if not summary["log"].get("samples", {}).get("mag", 1):
        return ""
    return "true" if summary.get("declination") else "magnetic"


def _scored_truth(run: NamedRun) -> Checkpoints | None:
    return run.truth if run.truth is not None and len(run.truth) > 1 else None


def _label(run: SavedRun, estimator: str) -> tuple[str, Any]:
    return score_label(estimator, bool(run.summary.get("anchors")), bool(run.summary.get("closed_walk")))


def _shift_m(run: NamedRun, estimator: str) -> FloatArray:
    """(2,) what brings a trajectory into the frame of its truth, without truth to where its run's best one starts."""
    trajectory, truth = trajectory_of(run.saved, estimator), _scored_truth(run)
    if truth is None:
        best = next(run.saved.trajectories[name] for name in _BEST if name in run.saved.trajectories)
        return np.asarray(best.xy_m[0] - trajectory.xy_m[0])
    if _label(run.saved, estimator)[1] == "none":
        return np.zeros(2)
    return np.asarray(truth.xy_m[0] - trajectory.at(truth.t_s[:1])[0, :2])


def _drawn(run: NamedRun, estimator: str, origin: FloatArray, number: int | None, main: bool) -> Drawn:
    trajectory, truth = trajectory_of(run.saved, estimator), _scored_truth(run)
    dx_m, dy_m = (_shift_m(run, estimator) - origin).tolist()
    errors = np.empty(0)
    if truth is not None:
        log = run.saved.summary["log"]
        log_s = (float(log["t0_s"]), float(log["t0_s"]) + float(log["duration_s"]))
        errors = checkpoint_errors(trajectory, truth, 0.0, _label(run.saved, estimator)[1], log_s)
        truth = replace(truth, x_m=truth.x_m - origin[0], y_m=truth.y_m - origin[1])
    label = LABELS[estimator]
    if number is not None:
        name = for_terminal(run.name, _MOST_NAME)
        label = name if estimator == "smoothed" else f"{name}, {label}"
    if estimator == "smoothed" and Integrity.from_dict(run.saved.summary.get("integrity")).verdict == "doubtful":
        label += " (doubtful)"
    line, marker = STYLES[estimator] if number is None else RUN_STYLES[number]
    return Drawn(
        label=label,
        color=color(estimator) if number is None else run_color(number),
        line=line,
        marker=marker,
        way=replace(trajectory, x_m=trajectory.x_m + dx_m, y_m=trajectory.y_m + dy_m),
        truth=truth,
        error_m=errors,
        height=bool(run.saved.summary["log"].get("samples", {}).get("pressure", 1))
        and bool(np.ptp(trajectory.z_m) > 0),
        main=main,
    )
