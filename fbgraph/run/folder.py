"""The run folder: its tables and its summary, written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fbgraph.core.config import Config, dump_toml
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.tables import read_text
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.tum_files import write_tum
from fbgraph.core.whole_writes import is_leftover, locked, whole_folder
from fbgraph.readers.layout import SAVED_LAYOUT
from fbgraph.run.digests import DIGESTS, SUMMARY, noted_digests
from fbgraph.run.inputs import RunInputs
from fbgraph.run.scores import score_label
from fbgraph.run.truth_rows import TRUTH, write_truth_tum
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.records import ReturnUpdate

BREADCRUMB_HEADER = "k,t_s,x_m,y_m,z_m,yaw_rad,gyro_bias_rad_s,sigma_x_m,sigma_y_m,cov_xy_m2,sigma_z_m,sigma_yaw_rad"
RETURN_HEADER = "t_s,breadcrumb,breadcrumb_t_s,route_m,remaining_m,cross_track_m,instruction,off_route"
RETURNS = "return.csv"
RAW = "raw.csv"
BATCH_NOTE = "batch.json"
"""What a batch notes of a run: its row in the index."""
RUN_FILES = {
    *(f"{name}.tum" for name in ("pdr", "ekf", "smoothed", "online")),
    *("breadcrumbs.csv", "summary.json", "config.toml", "recording.rrd", RAW, SAVED_LAYOUT, RETURNS, TRUTH, BATCH_NOTE),
}


@dataclass(frozen=True)
class RunClaim:
    """A place for a run folder that nobody else writes to meanwhile.

    Attributes:
        place: where it really is.
        check: raises if what is there by now must stay.
        keep: names of files there that stay when the run is written.
    """

    place: Path
    check: Callable[[Path], None]
    keep: tuple[str, ...] = ()

    def written(self) -> AbstractContextManager[Path]:
        """A folder to write into that becomes the run when the block ends well, and vanishes when it does not."""
        return whole_folder(self.place, self.keep, self.check)


@contextmanager
def claimed_run(out: Path, made_by: tuple[RunInputs, Config] | None = None, force: bool = False) -> Iterator[RunClaim]:
    """Hold the place of a run that is about to be made.

    Args:
        out: the run folder; a run of the same log and configuration there is replaced.
        made_by: what the new run is made from; None if that does not matter.
        force: replace the run of another log or configuration too.

    Raises:
        ConfigError: ``out`` holds something else, a live walk, or a run that may not be replaced; it cannot be
            written; another process writes there.
    """

    def check(place: Path) -> None:
        require_replaceable(place, made_by, force)

    with locked(out) as place:
        check(place)
        yield RunClaim(place, check)


@contextmanager
def claimed_live(out: Path, resume: bool, force: bool = False, option: str = "--resume") -> Iterator[RunClaim]:
    """Hold the place of a live walk, whose raw lines are kept there from its first byte on.

    Args:
        out: the run folder.
        resume: go on with the walk that is there; else nothing may be there but an empty one.
        force: let a finished run go; never a live walk.
        option: by which the walk to go on with was named.

    Raises:
        ConfigError: as ``claimed_run``; a finished run is there; nothing is there to resume.
    """

    def nothing(place: Path) -> None:
        """The walk that was recorded here under this very claim may be finished."""

    with locked(out) as place:
        if resume:
            finished_elsewhere = (place / SUMMARY).is_file() and not (place / RAW).is_file()
            if finished_elsewhere or not (place / "config.toml").is_file():
                raise ConfigError(f"{option} {out}: no {RAW} and config.toml there, so no walk to go on with")
            if (place / SUMMARY).is_file():
                raise ConfigError(f"{option} {out}: that walk was finished; begin another with --out")
            try:
                (place / RAW).touch()  # of a walk that was killed before its first byte
            except OSError as error:
                raise ConfigError(f"{place / RAW}: cannot write there: {error.strerror or error}") from error
        else:
            require_replaceable(place, None, force)
            if (place / "summary.json").exists() and not force:
                raise ConfigError(f"--out {out}: holds a finished run; name another folder, or --force lets it go")
            with whole_folder(place):
                pass
        yield RunClaim(place, nothing, keep=(RAW, SAVED_LAYOUT))


def require_replaceable(place: Path, made_by: tuple[RunInputs, Config] | None = None, force: bool = False) -> None:
    """Refuse to replace anything but a run, a live walk in any case, another walk's run without ``force``.

    Args:
        place: where it is.
        made_by, force: as in ``claimed_run``.

    Raises:
        ConfigError: it must stay.
    """
    if not os.path.lexists(place):
        return
    names = {entry.name for entry in place.iterdir() if not is_leftover(entry.name)} if place.is_dir() else {""}
    if names - RUN_FILES:
        raise ConfigError(f"--out {place}: exists and is not a run folder; name another, or remove it")
    if RAW in names and (place / RAW).stat().st_size > 0:
        raise ConfigError(f"--out {place}: holds {RAW}, the only copy of a live walk; name another folder")
    if not names - {RAW, SAVED_LAYOUT, "config.toml"}:
        return  # nothing, or a live walk of which no byte ever came
    try:
        summary = json.loads(read_text(place / SUMMARY, "JSON"))
        made, noted = summary["fbgraph"], summary.get("inputs") or {}
    except (DataError, ValueError, KeyError, TypeError, AttributeError):
        made, noted = None, {}
    if not isinstance(made, str) or not isinstance(noted, dict):
        raise ConfigError(f"--out {place}: exists and holds no whole run; name another, or remove it")
    if made_by is None or force:
        return
    inputs, config = made_by
    if noted.get("log") != inputs.log:
        other = noted.get("log") or "a log that was no file"
        raise ConfigError(f"--out {place}: holds the run of {other}; name another, or --force replaces it")
    if not (place / "config.toml").is_file() or read_text(place / "config.toml", "TOML") != dump_toml(config):
        raise ConfigError(
            f"--out {place}: holds a run with another configuration; name another, or --force replaces it"
        )


def require_free(path: Path, option: str) -> None:
    """Refuse to write onto a file of a run.

    Raises:
        ConfigError: ``path``, named by ``option``, is one.
    """
    if path.name in RUN_FILES and any((path.parent / name).is_file() for name in ("summary.json", RAW)):
        raise ConfigError(f"{option} {path}: that is a run's own file; name another")


def write_tables(result: WalkResult, folder: Path, summary: dict[str, Any]) -> None:
    """Trajectories, breadcrumbs, summary (of ``summarize``) with digests of all, configuration; into a folder."""
    for name, trajectory in result.trajectories.items():
        write_tum(folder / f"{name}.tum", trajectory, result.log.t0_s)
    if "smoothed" not in result.failed:
        write_breadcrumbs(folder / "breadcrumbs.csv", result.smoothed.trajectory, result.log.t0_s)
    _write_truth(result, folder)
    if result.returning:
        write_returns(folder / RETURNS, result.returning, result.log.t0_s)
    (folder / "config.toml").write_text(dump_toml(result.config), "utf-8")
    summary = {**summary, DIGESTS: noted_digests(folder, summary)}
    (folder / SUMMARY).write_text(json.dumps(summary, indent=2) + "\n", "utf-8")


def _write_truth(result: WalkResult, folder: Path) -> None:
    """Truth in the frame of the walk to believe, if there is enough of it to score one."""
    truth, t0_s = result.told.truth, result.log.t0_s
    if truth is None or len(truth) < 2:
        return
    start_s, end_s = result.log.span_s
    _, alignment = score_label(result.best, result.told.anchors is not None, result.told.closed_walk)
    walk = result.trajectories[result.best].since(-t0_s)
    write_truth_tum(folder / TRUTH, result.best, walk, truth, alignment, (start_s + t0_s, end_s + t0_s))


def breadcrumb_columns(trajectory: Trajectory, t0_s: float) -> tuple[IntArray | FloatArray, ...]:
    """The columns of ``BREADCRUMB_HEADER``, nan where the estimator says nothing; times as ``write_breadcrumbs``."""
    count = len(trajectory)
    cov = trajectory.cov_xy_yaw if trajectory.cov_xy_yaw is not None else np.full((count, 3, 3), np.nan)
    sigma_z = trajectory.sigma_z_m if trajectory.sigma_z_m is not None else np.full(count, np.nan)
    return (
        np.arange(count),
        trajectory.t_s + t0_s,
        trajectory.x_m,
        trajectory.y_m,
        trajectory.z_m,
        trajectory.yaw_rad,
        trajectory.gyro_bias_rad_s,
        np.sqrt(cov[:, 0, 0]),
        np.sqrt(cov[:, 1, 1]),
        cov[:, 0, 1],
        sigma_z,
        np.sqrt(cov[:, 2, 2]),
    )


def write_breadcrumbs(out: Path | BinaryIO, trajectory: Trajectory, t0_s: float) -> None:
    """One row a breadcrumb, covariances in the world frame, ``t_s`` on the format's event clock."""
    np.savetxt(
        out,
        np.column_stack(breadcrumb_columns(trajectory, t0_s)),
        fmt=["%d", "%.6f"] + ["%.6f"] * 4 + ["%.9f"] + ["%.6f"] * 5,
        delimiter=",",
        header=BREADCRUMB_HEADER,
        comments="",
    )


def write_returns(path: Path, updates: Iterable[ReturnUpdate], t0_s: float) -> None:
    """Write ``return.csv``, a row a step of the way back; times on the format's event clock, as in the TUM files."""
    with open(path, "w", encoding="utf-8", newline="") as out:
        out.write(RETURN_HEADER + "\n")
        for u in updates:
            out.write(
                f"{u.t_s + t0_s:.6f},{u.breadcrumb},{u.breadcrumb_t_s + t0_s:.6f},{u.route_m:.3f},{u.remaining_m:.3f},"
                f'{u.cross_track_m:.3f},"{u.instruction}",{str(u.off_route).lower()}\n'
            )
