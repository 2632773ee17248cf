"""The run folder: its tables and its summary, written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.core.config import dump_toml
from fbgraph.core.errors import ConfigError
from fbgraph.core.trajectory import Trajectory, write_tum
from fbgraph.core.whole_writes import whole_folder
from fbgraph.run.result import WalkResult
from fbgraph.way_back.records import ReturnUpdate

BREADCRUMB_HEADER = "k,t_s,x_m,y_m,z_m,yaw_rad,gyro_bias_rad_s,sigma_x_m,sigma_y_m,cov_xy_m2,sigma_z_m,sigma_yaw_rad"
RETURN_HEADER = "t_s,breadcrumb,breadcrumb_t_s,route_m,remaining_m,cross_track_m,instruction,off_route"
RETURNS = "return.csv"
RAW = "raw.csv"
RUN_FILES = {
    *(f"{name}.tum" for name in ("pdr", "ekf", "smoothed", "online")),
    *("breadcrumbs.csv", "summary.json", "config.toml", "recording.rrd", RAW, RETURNS),
}


@contextmanager
def run_folder(out: Path) -> Iterator[Path]:
    """A folder to write into that becomes ``out`` when the block ends well, and vanishes when it does not.

    An earlier run at ``out`` is replaced; anything else there is left alone.

    Raises:
        ConfigError: ``out`` is a file, a folder that is not a run or that of a live walk, or its parent cannot be
            written.
    """
    check_run_folder(out)
    require_no_raw(out)
    with whole_folder(out) as folder:
        yield folder


def check_run_folder(out: Path) -> None:
    """Refuse a place that holds anything but an earlier run.

    Raises:
        ConfigError: ``out`` is a file, or a folder with files that no run wrote.
    """
    if out.exists() and (not out.is_dir() or {entry.name for entry in out.iterdir()} - RUN_FILES):
        raise ConfigError(f"--out {out}: exists and is not a run folder; name another, or remove it")


def require_free(path: Path, option: str) -> None:
    """Refuse to write onto a file of a run.

    Raises:
        ConfigError: ``path``, named by ``option``, is one.
    """
    if path.name in RUN_FILES and any((path.parent / name).is_file() for name in ("summary.json", RAW)):
        raise ConfigError(f"{option} {path}: that is a run's own file; name another")


def require_no_raw(out: Path) -> None:
    """Refuse to replace the only copy of a live walk.

    Raises:
        ConfigError: ``out`` holds one.
    """
    if (out / RAW).is_file():
        raise ConfigError(f"--out {out}: holds {RAW}, the only copy of a live walk; name another folder")


def write_tables(result: WalkResult, folder: Path, summary: dict[str, Any]) -> None:
    """Trajectories, breadcrumbs, summary (of ``summarize``) and configuration into an existing folder."""
    for name, trajectory in result.trajectories.items():
        write_tum(folder / f"{name}.tum", trajectory, result.log.t0_s)
    write_breadcrumbs(folder / "breadcrumbs.csv", result.smoothed.trajectory, result.log.t0_s)
    if result.returning:
        write_returns(folder / RETURNS, result.returning, result.log.t0_s)
    (folder / "config.toml").write_text(dump_toml(result.config), "utf-8")
    (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", "utf-8")


def write_breadcrumbs(path: Path, trajectory: Trajectory, t0_s: float) -> None:
    """One row a breadcrumb, covariances in the world frame, ``t_s`` on the format's event clock."""
    count = len(trajectory)
    cov = trajectory.cov_xy_yaw if trajectory.cov_xy_yaw is not None else np.full((count, 3, 3), np.nan)
    sigma_z = trajectory.sigma_z_m if trajectory.sigma_z_m is not None else np.full(count, np.nan)
    columns = (
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
    np.savetxt(
        path,
        np.column_stack(columns),
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
