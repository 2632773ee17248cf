"""Whether the files of a run agree with one another: what each of them says is said by another too."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.summary_model import NotedRun

_ROUNDED = 1.5e-6  # files have six digits: two that say the same differ by one unit of the last, and a little
_SLACK_S = 1.0  # a step ends in the log, give or take what filters hold back
_SPRINTER_M_S = 12.5  # nobody is faster
_STRIDE_M = 2.0  # and a step may be over in no time


def require_agreement(run: Path, noted: NotedRun, trajectories: Mapping[str, Trajectory]) -> None:
    """Refuse a run whose trajectories contradict its summary or one another.

    Args:
        run: the folder, for messages.
        noted: its summary.
        trajectories: every one that the summary names, ``t_s`` on the format's event clock.

    Raises:
        DataError: naming the file, and its line or the summary's field.
    """
    first, times = next((name, trajectory.t_s) for name, trajectory in trajectories.items())
    for name, entry in noted.estimators.items():
        path, trajectory = run / f"{name}.tum", trajectories[name]
        if len(trajectory) != noted.steps + 1:
            raise DataError(f"{path}: {len(trajectory)} breadcrumbs, but by summary.json {noted.steps} steps")
        require_same(path, trajectory.t_s, times, "time", f"{first}.tum")
        _require_walkable(path, trajectory, name, noted)
        where, rows = f"estimators.{name}", noted.steps + 1
        _require_noted(path, f"{where}.distance_m", trajectory.distance_m[-1:], [entry.distance_m], rows)
        end_m = np.array([trajectory.x_m[-1], trajectory.y_m[-1], trajectory.z_m[-1]])
        _require_noted(path, f"{where}.end_m", end_m, entry.end_m)
    best = "smoothed" if "smoothed" in trajectories else "ekf"
    if best in trajectories:
        _require_whole_walk(run / f"{best}.tum", noted, trajectories[best])


def require_same_states(path: Path, breadcrumbs: Trajectory, other: Trajectory, source: str) -> None:
    """Refuse breadcrumbs that are not the trajectory beside them, whose covariances they hold.

    Raises:
        DataError: naming ``path`` and the line.
    """
    if len(breadcrumbs) != len(other):
        raise DataError(f"{path}: {len(breadcrumbs)} breadcrumbs, but {len(other)} in {source}")
    for axis in ("t_s", "x_m", "y_m", "z_m"):
        require_same(path, getattr(breadcrumbs, axis), getattr(other, axis), axis, source, header=1)
    off_rad = np.abs(wrap_angle(breadcrumbs.yaw_rad - other.yaw_rad))
    require_same(path, off_rad, np.zeros(len(other)), "yaw_rad", source, header=1)


def require_same(path: Path, values: FloatArray, others: FloatArray, what: str, source: str, header: int = 0) -> None:
    """Refuse values that are not those of another file, up to rounding.

    Args:
        path: the file of ``values``.
        values, others: row by row.
        what: their name.
        source: name of the other file.
        header: lines of ``path`` before the first row.

    Raises:
        DataError: naming the first line that differs.
    """
    if len(values) != len(others):
        raise DataError(f"{path}: {len(values)} breadcrumbs, but {len(others)} in {source}")
    bad = np.abs(values - others) > _ROUNDED
    if bad.any():
        row = int(np.argmax(bad))
        raise DataError(f"{path}: line {row + 1 + header}: its {what} is not that of {source}")


def _require_noted(path: Path, field: str, values: FloatArray, noted: list[float], roundings: int = 1) -> None:
    """Refuse a summary that says otherwise than a trajectory."""
    for value, said in zip(values.tolist(), noted, strict=True):
        if abs(value - said) > _ROUNDED * roundings:
            raise DataError(f"{path}: gives {value:.6g} where summary.json notes {field} as {said:.6g}")


def _require_whole_walk(path: Path, noted: NotedRun, trajectory: Trajectory) -> None:
    """Refuse a summary whose account of the whole walk is not that of its best trajectory."""
    _require_noted(path, "distance_m", trajectory.distance_m[-1:], [noted.distance_m], noted.steps + 1)
    if noted.walk_s is not None:
        _require_noted(path, "walk_s", trajectory.t_s[-1:] - trajectory.t_s[0], [noted.walk_s])
    if noted.altitude_range_m is not None:
        low_high = np.array([trajectory.z_m.min(), trajectory.z_m.max()])
        _require_noted(path, "altitude_range_m", low_high, noted.altitude_range_m)
    before_s, after_s = trajectory.t_s[0] - noted.log.t0_s, noted.log.t0_s + noted.log.duration_s - trajectory.t_s[-1]
    if min(before_s, after_s) < -_SLACK_S:
        raise DataError(f"{path}: not within the log, whose times summary.json notes as log.t0_s and log.duration_s")


def _require_walkable(path: Path, trajectory: Trajectory, name: str, noted: NotedRun) -> None:
    """Refuse breadcrumbs further apart than anybody runs, but where places that were told may have pulled them."""
    if name == "online" or (name == "smoothed" and noted.anchors):
        return
    places = np.column_stack((trajectory.xy_m, trajectory.z_m))
    apart_m, dt_s = np.linalg.norm(np.diff(places, axis=0), axis=1), np.diff(trajectory.t_s)
    bad = apart_m > _STRIDE_M + _SPRINTER_M_S * dt_s
    if bad.any():
        row = int(np.argmax(bad))
        raise DataError(
            f"{path}: line {row + 2}: {apart_m[row]:.4g} m from the breadcrumb before, {dt_s[row]:.4g} s earlier: "
            "faster than anybody runs"
        )
