"""A run folder read back: trajectories with what is known of their errors, events of its log, its way."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.georeference import Georeference
from fbgraph.core.trajectory import Trajectory, read_tum
from fbgraph.run.folder import BREADCRUMB_HEADER, RAW
from fbgraph.run.result import ESTIMATORS
from fbgraph.run.scores import score_entry, score_label
from fbgraph.way_back.legs import Directions, directions_of


def read_breadcrumbs(path: Path) -> Trajectory:
    """Read what ``write_breadcrumbs`` wrote, ``t_s`` on the format's event clock.

    Covariances between place and yaw are not in the file: NaN.

    Raises:
        DataError: no such file, or not breadcrumbs.
    """
    try:
        with path.open(encoding="utf-8") as file:
            if file.readline().strip() != BREADCRUMB_HEADER:
                raise ValueError("its header is not that of breadcrumbs")
            rows = file.readlines()
        if not rows:
            raise ValueError("a header and no row")
        table = np.loadtxt(rows, delimiter=",", ndmin=2)
        _, t_s, x_m, y_m, z_m, yaw_rad, bias, sigma_x, sigma_y, cov_xy, sigma_z, sigma_yaw = table.T
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: not readable as breadcrumbs: {str(error).splitlines()[0]}") from error
    cov = np.full((len(t_s), 3, 3), np.nan)
    cov[:, 0, 0], cov[:, 1, 1], cov[:, 2, 2] = sigma_x**2, sigma_y**2, sigma_yaw**2
    cov[:, 0, 1] = cov[:, 1, 0] = cov_xy
    return Trajectory(t_s, x_m, y_m, z_m, yaw_rad, bias, cov_xy_yaw=cov, sigma_z_m=sigma_z)


def read_trajectory(run: Path, estimator: str) -> Trajectory:
    """An estimator's trajectory of a run folder, ``t_s`` on the format's event clock; the smoother's with covariance.

    Raises:
        ConfigError: no estimator of this name.
        DataError: the run does not have it.
    """
    if estimator not in ESTIMATORS:
        raise ConfigError(f"unknown estimator {estimator!r}: expected one of {', '.join(ESTIMATORS)}")
    if estimator == "smoothed" and (run / "breadcrumbs.csv").is_file():
        return read_breadcrumbs(run / "breadcrumbs.csv")
    path = run / f"{estimator}.tum"
    if not path.is_file():
        there = ", ".join(name for name in ESTIMATORS if (run / f"{name}.tum").is_file())
        raise DataError(f"{run}: this run has no {estimator} trajectory, only {there or 'none at all'}")
    return read_tum(path)


def read_events(summary: dict[str, Any]) -> list[tuple[float, str]]:
    """(time on the format's event clock, label) of what the log marked; none if the summary only counts them."""
    events = summary["log"].get("events")
    if not isinstance(events, list):
        return []
    labelled = [
        (float(event["t_s"]), "".join(c for c in event["label"] if c.isprintable()).strip()) for event in events
    ]
    return [(t_s, label) for t_s, label in labelled if label]


def read_georeference(summary: dict[str, Any], source: str) -> Georeference | None:
    """Where on Earth a run's world frame lies, or None if it does not know.

    Raises:
        DataError: it cannot be read, naming ``source``.
    """
    entry = summary.get("georeference")
    if entry is None:
        return None
    try:
        return Georeference(float(entry["lat_deg"]), float(entry["lon_deg"]))
    except (TypeError, KeyError, ValueError) as error:
        raise DataError(f"{source}: its georeference is not lat_deg and lon_deg in degrees") from error


def read_directions(run: Path, estimator: str = "smoothed", pace_m: float | None = None) -> Directions:
    """The way of a run folder in walking order, with the landmarks of its log.

    Raises:
        ConfigError: no such estimator, or a pace that is not positive.
        DataError: not a run folder, or nothing in it that leads anywhere.
    """
    summary = read_summary(run)
    trajectory = read_trajectory(run, estimator)
    if len(trajectory) != summary.get("steps", len(trajectory) - 1) + 1:
        raise DataError(f"{run}: {len(trajectory)} breadcrumbs, but {summary['steps']} steps: smooth the log again")
    graph = load_config(str(run / "config.toml")).graph
    anchored = estimator == "smoothed" and summary.get("anchors", 0) > 1  # in the anchors' own frame
    compass = anchored or summary["log"].get("samples", {}).get("mag", 1) > 0
    name = f"{summary['log']['name']} ({estimator})"
    return directions_of(trajectory, read_events(summary), pace_m, graph, name, compass)


def read_summary(run: Path) -> dict[str, Any]:
    """The summary of a run folder.

    Raises:
        DataError: not a run folder.
    """
    try:
        summary = json.loads((run / "summary.json").read_text("utf-8"))
        return {**summary, "log": summary["log"], "estimators": summary["estimators"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        if (run / RAW).is_file():
            raise DataError(
                f"{run}: a live walk that has not ended; `fbgraph online --source … --resume {run}` goes on with it"
            ) from error
        raise DataError(f"{run}: not a run folder (no readable summary.json); `fbgraph smooth` makes one") from error


def score_run(run: Path, truth: Checkpoints) -> dict[str, Any]:
    """Score every trajectory of a run folder; by estimator, as in ``summary.json``.

    Raises:
        DataError: not a run folder, or truth that does not belong to it.
    """
    summary = read_summary(run)
    scores = {}
    for name in summary["estimators"]:
        trajectory = read_tum(run / f"{name}.tum")
        label, alignment = score_label(name, bool(summary.get("anchors")), bool(summary.get("closed_walk")))
        scores[name] = score_entry(trajectory, truth, 0.0, label, alignment)
    return scores
