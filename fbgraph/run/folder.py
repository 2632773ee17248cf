"""The run folder: its tables and its summary, written whole or not at all."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph import __version__
from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import dump_toml
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.palette import LABELS
from fbgraph.core.trajectory import Trajectory, read_tum, write_tum
from fbgraph.run.findings import find
from fbgraph.run.metrics import Alignment, score
from fbgraph.run.result import WalkResult
from fbgraph.way_back.guide import write_returns
from fbgraph.way_back.turns import find_turns

BREADCRUMB_HEADER = "k,t_s,x_m,y_m,z_m,yaw_rad,gyro_bias_rad_s,sigma_x_m,sigma_y_m,cov_xy_m2,sigma_z_m,sigma_yaw_rad"
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


@contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A folder to write into that replaces ``out`` when the block ends well, and vanishes when it does not.

    Raises:
        ConfigError: its parent cannot be written.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    except OSError as error:
        raise ConfigError(f"--out {out}: cannot write there: {error.strerror}") from error
    try:
        partial.chmod(0o755)
        yield partial
        if out.exists():
            shutil.rmtree(out)
        partial.rename(out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


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


def score_label(name: str, anchored: bool, closed_walk: bool) -> tuple[str, Alignment]:
    """How an estimator may fairly be scored: ``unaided``, ``closed`` or ``anchored``, and how it is aligned."""
    if name == "smoothed" and anchored:
        return "anchored", "none"  # already in the anchors' frame
    if name == "smoothed" and closed_walk:
        return "closed", "start"
    return "unaided", "start"


def summarize(result: WalkResult) -> dict[str, Any]:
    """What ``summary.json`` holds.

    Raises:
        DataError: truth that does not belong to this log.
    """
    log, track, smoothed = result.log, result.track, result.smoothed
    estimators: dict[str, Any] = {}
    for name, trajectory in result.trajectories.items():
        entry: dict[str, Any] = {
            "distance_m": float(trajectory.distance_m[-1]),
            "end_m": [float(axis[-1]) for axis in (trajectory.x_m, trajectory.y_m, trajectory.z_m)],
            "turns": len(find_turns(trajectory)),
        }
        if result.truth is not None and len(result.truth) > 1:
            label, alignment = score_label(name, result.anchors is not None, result.closed_walk)
            entry["score"] = score_entry(trajectory, result.truth, log.t0_s, label, alignment)
        estimators[name] = entry
    final = smoothed.trajectory
    sigma_m = final.longest_sigma_m
    return {
        "fbgraph": __version__,
        "log": {
            "name": log.name,
            "format": log.format,
            "duration_s": log.duration_s,
            "t0_s": log.t0_s,
            "rates_hz": {
                name: round(getattr(log, name).rate_hz, 2)
                for name in ("acc", "gyro", "mag", "pressure")
                if len(getattr(log, name)) > 1
            },
            "samples": {name: len(getattr(log, name)) for name in ("acc", "gyro", "mag", "pressure")},
            "counts": dict(log.counts),
            "events": [{"t_s": event.t_s + log.t0_s, "label": event.label} for event in log.events],
        },
        "steps": len(track) - 1,
        "walk_s": float(track.t_s[-1] - track.t_s[0]),
        "distance_m": float(final.distance_m[-1]),
        "turns": estimators["smoothed"]["turns"],
        "altitude_range_m": [float(final.z_m.min()), float(final.z_m.max())],
        "end_2sigma_m": None if sigma_m is None else 2.0 * float(sigma_m[-1]),
        "gyro_bias_deg_s": float(np.degrees(final.gyro_bias_rad_s[-1])),
        "rest_s": float(track.rest_s.sum()),
        "closed_walk": result.closed_walk,
        "anchors": 0 if result.anchors is None else len(result.anchors),
        "return": return_entry(result),
        "truth": None if result.truth is None else result.truth.source,
        "estimators": estimators,
        "solver": {
            "iterations": smoothed.iterations,
            "error_initial": float(smoothed.errors[0]),
            "error_final": float(smoothed.errors[-1]),
            "errors": [float(f"{error:.6g}") for error in smoothed.errors],
            "factors": smoothed.factors,
        },
        "seconds": {name: round(value, 3) for name, value in result.seconds.items()},
        "versions": {name: version(name) for name in ("gtsam", "numpy", "scipy", "vqf")},
        "georeference": None if (where := result.georeference) is None else asdict(where),
        "inputs": dict(result.inputs),
        "findings": [asdict(finding) for finding in find(result)],
        "warnings": warnings(result),
    }


def return_entry(result: WalkResult) -> dict[str, Any] | None:
    """The way back, summed up; None for a walk of which no way back is known. Times on the format's event clock."""
    turned, t0_s = result.turn_back, result.log.t0_s
    if turned is None:
        return None
    arrived = [update.t_s + t0_s for update in result.returning if update.arrived]
    return {
        "turn_back": {"breadcrumb": turned.breadcrumb, "t_s": turned.t_s + t0_s, "known_t_s": turned.known_s + t0_s},
        "steps": len(result.returning),
        "off_route_steps": sum(update.off_route for update in result.returning),
        "arrived_t_s": arrived[0] if arrived else None,
        "remaining_m": result.returning[-1].remaining_m if result.returning else None,
        "closures": len(result.smoothed.closures),
    }


def warnings(result: WalkResult) -> list[str]:
    """What the user should know before believing the result."""
    log, track = result.log, result.track
    found = list(log.notices)
    compass = bool(np.isfinite(track.yaw_mag_rad).any())
    if result.truth is not None and len(result.truth) < 2:
        found.append("not scored: the truth has one checkpoint, and the walk is moved to agree with the first")
    gaps = int((track.chained == 0).sum())
    if gaps:
        across = "rests on the compass alone" if compass else "is not known: there is no compass"
        found.append(f"{gaps} gap(s) in the log during the walk: direction across them {across}")
    if len(track) - 1 < 10:
        found.append(f"only {len(track) - 1} steps")
    if not (track.rest_s > 0).any():
        by = "was found from the compass alone" if compass else "is not known: there is no compass either"
        found.append(f"the wearer never stood still: the gyroscope's bias {by}")
    norm = track.mag_norm_ut[np.isfinite(track.mag_norm_ut)]
    if len(norm) and np.percentile(norm, 95) - np.percentile(norm, 5) > 0.3 * np.median(norm):
        found.append(
            f"magnetic disturbance: the field is usually {np.median(norm):.0f} µT strong, {norm.min():.0f} to "
            f"{norm.max():.0f} µT at the extremes"
        )
    return found


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


def score_entry(
    trajectory: Trajectory, truth: Checkpoints, t0_s: float, label: str, alignment: Alignment
) -> dict[str, Any]:
    """One estimator's score as it is written and printed: labelled, the best rigid fit beside it."""
    return {
        "label": label,
        **score(trajectory, truth, t0_s, alignment).as_dict(),
        "aligned_rmse_m": score(trajectory, truth, t0_s, "rigid").rmse_m,
    }


def summary_markdown(summary: dict[str, Any]) -> str:
    """The summary for people, inside the recording."""
    low, high = (round(value, 1) + 0.0 for value in summary["altitude_range_m"])  # no -0.0
    turns = f"{summary['turns']} turn{'' if summary['turns'] == 1 else 's'}"
    smoothed = summary["estimators"]["smoothed"]
    lines = [
        f"# {summary['log']['name']}",
        f"{summary['log']['duration_s']:.0f} s of log, {summary['steps']} steps, "
        f"{summary['distance_m']:.0f} m as smoothed, {turns}, altitude {low:+.1f} to {high:+.1f} m.",
        "",
        f"{_ends_text(smoothed['end_m'], summary)}.",
    ]
    findings = summary.get("findings", [])
    lines += [f"\nThe {f['text']}." for f in findings if f["kind"] == "gyro_bias"]
    lines += [
        "",
        "| estimator | ends East, North (m) | RMSE (m) | max (m) | last (m) | told of |",
        "|---|---|---|---|---|---|",
    ]
    told = {"unaided": "nothing", "closed": "its end is its start", "anchored": "anchors"}
    closures = (summary.get("return") or {}).get("closures", 0)
    for name, entry in summary["estimators"].items():
        x_m, y_m, _ = (round(value, 1) + 0.0 for value in entry["end_m"])
        row = f"| {LABELS[name]} | {x_m:.1f}, {y_m:.1f} |"
        if "score" in entry:
            s = entry["score"]
            row += f" {s['rmse_m']:.2f} | {s['max_m']:.2f} | {s['final_m']:.2f} | {told[s['label']]}"
            row += f"; found {closures} closures |" if closures and name == "smoothed" else " |"
        else:
            row += " – | – | – | no truth |"
        lines.append(row)
    if "score" in smoothed:
        lines += [
            "",
            "Errors are horizontal, at the truth's checkpoints after the first; “last” is at the last of them.",
        ]
    lines += ["", "## Warnings", *(f"- {text}" for text in summary["warnings"])] if summary["warnings"] else []
    worth = [f for f in findings if f["kind"] != "gyro_bias"]
    worth.sort(key=lambda f: f["kind"] != "truth")  # what is wrong before what may be its cause
    if worth:
        lines += ["", "## Worth a look"]
    for f in worth:
        when = (
            f"{f['start_s']:.0f} s" if f["end_s"] - f["start_s"] < 1.0 else f"{f['start_s']:.0f} to {f['end_s']:.0f} s"
        )
        lines.append(f"- {when}: {f['text']}")
    return "\n".join(lines) + "\n"


def _ends_text(end_m: list[float], summary: dict[str, Any]) -> str:
    """Where the smoothed walk ends, and how sure that is."""
    x_m, y_m = (round(value, 1) + 0.0 for value in end_m[:2])
    if summary["anchors"]:
        text = f"The smoothed walk ends at {x_m:.1f} East, {y_m:.1f} North in the anchors' frame"
    else:
        east, north = "East" if x_m >= 0 else "West", "North" if y_m >= 0 else "South"
        text = f"The smoothed walk ends {abs(x_m):.1f} m {east} and {abs(y_m):.1f} m {north} of its start"
    sure_m = summary.get("end_2sigma_m")
    return text if sure_m is None else f"{text}, ± {sure_m:.1f} m (2σ)"
