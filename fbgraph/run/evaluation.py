"""Runs against known places: their scores, and every checkpoint's error."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.safe_text import for_csv
from fbgraph.core.whole_writes import whole_file
from fbgraph.run.coverage import ELLIPSE_95, coverage
from fbgraph.run.metrics import checkpoint_offsets, fit_to_truth
from fbgraph.run.read_run import SavedRun, score_run
from fbgraph.run.scores import score_label

ERRORS_HEADER = (
    *("run", "estimator", "t_s", "truth_x_m", "truth_y_m", "x_m", "y_m"),
    *("error_m", "aligned_error_m", "in_ellipse_95", "scored"),
)


@dataclass(frozen=True)
class NamedRun:
    """A run that is compared with others.

    Attributes:
        name: its folder's; as it was typed where others' folders are called the same.
        saved: what it holds.
        truth: known places on its event clock; None if nobody knows any.
    """

    name: str
    saved: SavedRun
    truth: Checkpoints | None

    def scores(self) -> dict[str, Any]:
        """By estimator, as in ``summary.json``.

        Raises:
            DataError: there is no truth, or it does not belong to the run.
        """
        return score_run(self.saved, self.known())

    def known(self) -> Checkpoints:
        """The truth.

        Raises:
            DataError: there is none.
        """
        if self.truth is None:
            raise DataError(f"{self.saved.folder}: was made without truth; name it with --truth FILE")
        return self.truth


def error_rows(run: NamedRun) -> Iterator[tuple[object, ...]]:
    """A row a checkpoint and estimator, as ``ERRORS_HEADER`` names them.

    Places are in the truth's frame, the estimate moved as it is scored; ``in_ellipse_95`` is 1 or 0, empty where the
    estimator gives no covariance; ``scored`` is 0 for the first checkpoint where the walk is moved to agree with it.

    Raises:
        DataError: there is no truth, or it does not belong to the run.
    """
    truth, summary = run.known(), run.saved.summary
    log_s = (float(summary["log"]["t0_s"]), float(summary["log"]["t0_s"]) + float(summary["log"]["duration_s"]))
    for name, trajectory in run.saved.trajectories.items():
        _, alignment = score_label(name, bool(summary.get("anchors")), bool(summary.get("closed_walk")))
        offset_m = checkpoint_offsets(trajectory, truth, 0.0, alignment, log_s)
        aligned_m = np.hypot(*fit_to_truth(trajectory, truth, 0.0, log_s).offset_m.T)
        covered = coverage(trajectory, truth, 0.0, alignment, log_s)
        first = len(truth) - len(offset_m)
        for k, (t_s, place) in enumerate(zip(truth.t_s.tolist(), truth.xy_m, strict=True)):
            off_m = np.zeros(2) if k < first else offset_m[k - first]
            inside = "" if covered is None or k < first else int(covered.nees[k - first] <= ELLIPSE_95)
            numbers = (t_s, *place.tolist(), *(place + off_m).tolist(), float(np.hypot(*off_m)), float(aligned_m[k]))
            yield (for_csv(run.name), name, *(f"{value:.6f}" for value in numbers), inside, int(k >= first))


def write_errors(path: Path, runs: Sequence[NamedRun]) -> None:
    """Write ``error_rows`` of runs as CSV.

    Raises:
        ConfigError: the file cannot be written.
        DataError: a run has no truth, or another's.
    """
    with whole_file(path) as partial, open(partial, "w", encoding="utf-8", newline="") as out:
        table = csv.writer(out, lineterminator="\n")
        table.writerow(ERRORS_HEADER)
        for run in runs:
            table.writerows(error_rows(run))
