"""A run folder read back: trajectories with what is known of their errors, events of its log, its way.

Everything is checked where it enters: each file by itself, then against what the others say. Whoever reads a run goes
through ``read_run`` and can believe it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import Config, load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.core.georeference import Georeference
from fbgraph.core.place_clocks import LogClock, on_logs_clock
from fbgraph.core.tables import read_numbers, read_text
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.tum_files import read_tum
from fbgraph.core.verdict import Integrity
from fbgraph.run.digests import DIGESTS, SUMMARY, require_as_written, require_summary_as_written
from fbgraph.run.folder import BREADCRUMB_HEADER, RAW
from fbgraph.run.run_checks import require_agreement, require_same_states
from fbgraph.run.scores import score_entry, score_label
from fbgraph.run.summary_model import NotedRun, noted_run
from fbgraph.run.walk_result import ESTIMATORS
from fbgraph.way_back.legs import Directions, directions_of
from fbgraph.way_back.shorten import LeftOut, left_out_text, shortened

_MOST_SIGMA = 1e6  # metres, radians: nobody is that lost
_BREADCRUMBS = "breadcrumbs.csv"


@dataclass(frozen=True)
class SavedRun:
    """A run folder whose files agree.

    Attributes:
        folder: where it is.
        summary: what its ``summary.json`` holds, checked as far as anybody reads it.
        trajectories: by estimator, ``t_s`` on the format's event clock; the smoother's with covariance.
        digests: of its files, by name; empty if its fbgraph noted none.
    """

    folder: Path
    summary: dict[str, Any]
    trajectories: dict[str, Trajectory]
    digests: dict[str, str]

    def read_config(self) -> Config:
        """The configuration that it was made with.

        Raises:
            DataError: it is damaged.
        """
        path = self.folder / "config.toml"
        with _advised():
            try:
                config = load_config(str(path))
            except ConfigError as error:
                raise DataError(str(error).removeprefix("--config ")) from error
            require_as_written(path, self.digests)
        return config


def read_run(run: Path) -> SavedRun:
    """Read the summary and the trajectories of a run folder.

    Raises:
        DataError: not a run folder, or a damaged one: naming the file, and its line or field.
    """
    summary, noted = _read_summary(run)
    with _advised():
        trajectories: dict[str, Trajectory] = {name: read_tum(run / f"{name}.tum") for name in noted.estimators}
        require_agreement(run, noted, trajectories)
        if "smoothed" in trajectories:
            path = run / _BREADCRUMBS
            breadcrumbs = read_breadcrumbs(path)
            require_same_states(path, breadcrumbs, trajectories["smoothed"], "smoothed.tum")
            trajectories["smoothed"] = breadcrumbs
            require_as_written(path, noted.sha256)
        for name in noted.estimators:
            require_as_written(run / f"{name}.tum", noted.sha256)
    return SavedRun(run, summary, trajectories, noted.sha256)


@contextmanager
def _advised() -> Iterator[None]:
    """Says what to do about a damaged run."""
    try:
        yield
    except DataError as error:
        raise DataError(f"{error}; smooth the log again") from error


def read_breadcrumbs(path: Path) -> Trajectory:
    """Read what ``write_breadcrumbs`` wrote, ``t_s`` on the format's event clock.

    Covariances between place and yaw are not in the file: NaN. So are those that the estimator did not give.

    Raises:
        DataError: no such file, or not whole breadcrumbs.
    """
    table = read_numbers(path, "breadcrumbs", BREADCRUMB_HEADER, ",", BREADCRUMB_HEADER)
    k, t_s, x_m, y_m, z_m, yaw_rad, bias, sigma_x, sigma_y, cov_xy, sigma_z, sigma_yaw = table.values.T
    table.refuse_infinite(slice(7))
    table.refuse(k != np.arange(len(k)), "its number k does not follow that of the line before")
    table.refuse_unordered(t_s)
    table.refuse(_no_sigmas(np.column_stack((sigma_x, sigma_y, sigma_yaw))), "its standard deviations cannot be")
    table.refuse(_no_sigmas(sigma_z[:, None]), "its sigma_z_m cannot be")
    rounding = 2e-6 * (1.0 + sigma_x + sigma_y)
    table.refuse(
        (np.abs(cov_xy) > sigma_x * sigma_y + rounding) | (np.isnan(cov_xy) != np.isnan(sigma_x)),
        "its cov_xy_m2 cannot be",
    )
    if not read_text(path, "breadcrumbs").endswith("\n"):
        raise DataError(f"{path}: line {table.line[-1]}: cut off in its middle")
    cov = np.full((len(t_s), 3, 3), np.nan)
    cov[:, 0, 0], cov[:, 1, 1], cov[:, 2, 2] = sigma_x**2, sigma_y**2, sigma_yaw**2
    cov[:, 0, 1] = cov[:, 1, 0] = cov_xy
    return Trajectory(t_s, x_m, y_m, z_m, yaw_rad, bias, cov_xy_yaw=cov, sigma_z_m=sigma_z)


def _no_sigmas(sigmas: FloatArray) -> BoolArray:
    """Rows that hold no standard deviations, where nan in all rows alike says that none are known."""
    if np.isnan(sigmas).all():
        return np.zeros(len(sigmas), dtype=bool)
    return np.asarray(~((sigmas >= 0.0) & (sigmas < _MOST_SIGMA)).all(axis=1))


def trajectory_of(run: SavedRun, estimator: str) -> Trajectory:
    """An estimator's trajectory of a run.

    Raises:
        ConfigError: no estimator of this name.
        DataError: the run does not have it.
    """
    if estimator not in ESTIMATORS:
        raise ConfigError(f"unknown estimator {estimator!r}: expected one of {', '.join(ESTIMATORS)}")
    if estimator not in run.trajectories:
        there = ", ".join(run.trajectories)
        integrity = Integrity.from_dict(run.summary.get("integrity"))
        why = ""
        if estimator == "smoothed" and integrity.verdict == "withheld" and integrity.reasons:
            why = f"; it was withheld: {integrity.reasons[0].sentence}"
        raise DataError(f"{run.folder}: this run has no {estimator} trajectory, only {there}{why}")
    return run.trajectories[estimator]


def read_events(summary: dict[str, Any]) -> list[tuple[float, str]]:
    """(time on the format's event clock, label) of what the log marked; none if the summary only counts them.

    Labels are as the log has them, whatever is in them: who shows one goes through ``core.safe_text``.
    """
    events = summary["log"].get("events")
    if not isinstance(events, list):
        return []
    return [(float(event["t_s"]), str(event["label"])) for event in events if event["label"].strip()]


def read_georeference(summary: dict[str, Any]) -> Georeference | None:
    """Where on Earth a run's world frame lies, or None if it does not know."""
    entry = summary.get("georeference")
    return None if entry is None else Georeference(float(entry["lat_deg"]), float(entry["lon_deg"]))


def in_anchors_frame(run: SavedRun, estimator: str) -> bool:
    """Whether a trajectory lies in the frame of the run's anchors, not in that of its compass."""
    return estimator == "smoothed" and int(run.summary.get("anchors", 0)) > 1


def knows_north(run: SavedRun, estimator: str) -> bool:
    """Whether it is known where North is: by a compass, or by anchors."""
    return in_anchors_frame(run, estimator) or run.summary["log"].get("samples", {}).get("mag", 1) > 0


def read_directions(
    run: SavedRun,
    estimator: str = "smoothed",
    pace_m: float | None = None,
    turned_rad: float = 0.0,
    shorten: bool = False,
) -> Directions:
    """The way of a run in walking order, with the landmarks of its log.

    Args:
        run, estimator: whose.
        pace_m: the wearer's step length; the median of the walk if None.
        turned_rad: turns the walk about its start, counter-clockwise.
        shorten: leave out loops and dead ends that the walk closed itself.

    Raises:
        ConfigError: no such estimator, or a pace that is not positive.
        DataError: a damaged configuration, or nothing in the run that leads anywhere.
    """
    summary, trajectory = run.summary, trajectory_of(run, estimator).turned(turned_rad)
    name, graph = f"{summary['log']['name']} ({estimator})", run.read_config().graph
    events = read_events(summary)
    left_out: tuple[LeftOut, ...] = ()
    if shorten:
        whole, (trajectory, left_out) = trajectory, shortened(trajectory, graph)
        gone = [(whole.t_s[one.first], whole.t_s[one.last]) for one in left_out]
        events = [event for event in events if not any(begin < event[0] < end for begin, end in gone)]
        if left_out and len(trajectory) < 3:
            told = " ".join(left_out_text(left_out))
            raise DataError(f"{name}: nothing is left to walk: it ended where it began. {told}")
    way = directions_of(trajectory, events, pace_m, graph, name, knows_north(run, estimator))
    return replace(way, integrity=Integrity.from_dict(summary.get("integrity")), left_out=left_out)


def read_summary(run: Path) -> dict[str, Any]:
    """The summary of a run folder, without the digests of its files.

    Raises:
        DataError: not a run folder, or a field that is missing or wrong.
    """
    return _read_summary(run)[0]


def _read_summary(run: Path) -> tuple[dict[str, Any], NotedRun]:
    """The summary of a run folder as it stands there, and as it was understood."""
    path = run / SUMMARY
    if not path.is_file():
        if (run / RAW).is_file():
            raise DataError(
                f"{run}: a live walk that has not ended; `fbgraph online --source … --resume {run}` goes on with it"
            )
        raise DataError(f"{run}: not a run folder (no {SUMMARY}); `fbgraph smooth` makes one")
    with _advised():
        try:
            summary = json.loads(read_text(path, "JSON"), parse_constant=lambda _: None, parse_float=_finite)
        except (ValueError, RecursionError) as error:
            raise DataError(f"{path}: not readable as JSON: {error}") from error
        if not isinstance(summary, dict):
            raise DataError(f"{path}: not a summary, but a JSON {type(summary).__name__}")
        noted = noted_run(summary, path)
        summary.pop(DIGESTS, None)
        require_summary_as_written(path, summary, noted.sha256)
    return summary, noted


def _finite(text: str) -> float | None:
    """A number of a summary; None, as JSON knows no infinity, if it is beyond what can be counted."""
    value = float(text)
    return value if math.isfinite(value) else None


def on_its_clock(run: SavedRun, places: Checkpoints) -> Checkpoints:
    """Places that a file told, on the clock of the run's log.

    Raises:
        DataError: they are of another walk, or on another clock.
    """
    log = run.summary["log"]
    rates_hz = log.get("rates_hz")
    rate_hz = rates_hz.get("acc") if isinstance(rates_hz, dict) else None
    start_s = float(log["t0_s"])
    rows_hz = float(rate_hz) if isinstance(rate_hz, int | float) else math.nan
    return on_logs_clock(places, LogClock(start_s, start_s + float(log["duration_s"]), rows_hz))


def score_run(run: SavedRun, truth: Checkpoints) -> dict[str, Any]:
    """Score every trajectory of a run; by estimator, as in ``summary.json``.

    Raises:
        DataError: truth that does not belong to it.
    """
    scores, log = {}, run.summary["log"]
    log_s = (float(log["t0_s"]), float(log["t0_s"]) + float(log["duration_s"]))
    truth = on_its_clock(run, truth)
    for name, trajectory in run.trajectories.items():
        told = [bool(run.summary.get(aid)) for aid in ("anchors", "closed_walk", "axis")]
        label, alignment = score_label(name, *told)
        scores[name] = score_entry(trajectory, truth, 0.0, label, alignment, log_s)
    return scores
