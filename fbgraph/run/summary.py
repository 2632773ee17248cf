"""The summary of a run: what summary.json holds, and the same for people."""

from __future__ import annotations

import math
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from fbgraph import __version__
from fbgraph.core.colors import LABELS
from fbgraph.core.earth_field import declination_text
from fbgraph.core.geometry import heading_deg
from fbgraph.core.safe_text import MOST_NAME, for_markdown
from fbgraph.core.verdict import MOST_TOLD, Integrity, verdict_lines
from fbgraph.estimators.estimates import AxisFit
from fbgraph.run.findings import walk_findings
from fbgraph.run.scores import score_entry, score_label
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.turns import find_turns


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
        if result.told.truth is not None and len(result.told.truth) > 1:
            label, alignment = score_label(name, *result.told.modes)
            entry["score"] = score_entry(trajectory, result.told.truth, log.t0_s, label, alignment, log.span_s)
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
            "reading": dict(log.reading),
            "events": [{"t_s": event.t_s + log.t0_s, "label": event.label} for event in log.events],
        },
        "integrity": result.integrity.as_dict(),
        "steps": len(track) - 1,
        "walk_s": float(track.t_s[-1] - track.t_s[0]),
        "distance_m": float(final.distance_m[-1]),
        "turns": estimators[result.best]["turns"],
        "altitude_range_m": [float(final.z_m.min()), float(final.z_m.max())],
        "end_2sigma_m": None if sigma_m is None else 2.0 * float(sigma_m[-1]),
        "gyro_bias_deg_s": float(np.degrees(final.gyro_bias_rad_s[-1])),
        "rest_s": float(track.rest_s.sum()),
        "closed_walk": result.told.closed_walk,
        **_told(result),
        "return": return_entry(result),
        "estimators": estimators,
        "failed": dict(result.failed),
        "solver": {
            "iterations": smoothed.iterations,
            "error_initial": _finite(smoothed.errors[0]),
            "error_final": _finite(smoothed.errors[-1]),
            "errors": [float(f"{error:.6g}") for error in smoothed.errors if np.isfinite(error)],
            "factors": smoothed.factors,
        },
        "seconds": {name: round(value, 3) for name, value in result.seconds.items()},
        "versions": {name: version(name) for name in ("gtsam", "numpy", "scipy", "vqf")},
        "declination": _declination(result),
        "georeference": None if (where := result.georeference) is None else asdict(where),
        "inputs": result.inputs.as_dict(),
        "findings": [asdict(finding) for finding in walk_findings(result)],
        "warnings": warnings(result),
    }


def _told(result: WalkResult) -> dict[str, Any]:
    """How many anchors there were, what the truth was, what became of the log's own fixes and of a building's axis."""
    told = result.told
    return {
        "anchors": 0 if told.anchors is None else len(told.anchors),
        "truth": None if told.truth is None else told.truth.label,
        "gnss": None if told.gnss is None else told.gnss.as_dict(),
        "axis": axis_entry(result),
    }


def _declination(result: WalkResult) -> dict[str, Any] | None:
    """By how much the compass was turned to point to true North, and who says so; None if it was not."""
    text = declination_text(result.config) if len(result.log.mag) else None
    return None if text is None else {"deg": result.config.device.declination_deg, "text": text}


def axis_entry(result: WalkResult) -> dict[str, Any] | None:
    """What was said of the building's axis and what became of it; None if nobody said anything."""
    building, fit = result.told.building, result.smoothed.axis
    if building is None:
        return None
    fit = fit or AxisFit(why="the smoother gave no walk")
    declination_deg = result.config.device.declination_deg
    return {
        "used": fit.used,
        "why_not": fit.why or None,
        "heading_deg": round(heading_deg(building.axis.yaw_rad(declination_deg)) % 90.0, 2),
        "sigma_deg": building.axis.sigma_deg,
        "north": "magnetic" if declination_deg is None else "true",
        "turned_deg": math.degrees(fit.turned_rad),
        "turned_sigma_deg": math.degrees(fit.sigma_rad) if fit.used else None,
        "legs": fit.legs,
        "legs_along": fit.along,
        "log_odds": round(fit.log_odds, 3),
    }


def _finite(value: float) -> float | None:
    """JSON knows no nan."""
    return float(value) if np.isfinite(value) else None


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
        "closures_doubted": result.smoothed.closures_doubted,
    }


def warnings(result: WalkResult) -> list[str]:
    """What the user should know before believing the result."""
    log, track = result.log, result.track
    found = [
        f"the {name} trajectory is {why if why.startswith('withheld') else f'missing, its estimator failed: {why}'}"
        for name, why in result.failed.items()
    ]
    found += [*log.notices, *result.smoothed.notes]
    building, declination_deg = result.told.building, result.config.device.declination_deg
    if building is not None and building.axis.north == "walk" and declination_deg is None:
        found.append("the building's axis is counted from magnetic North: where the walk was nobody said (--origin)")
    compass = bool(np.isfinite(track.yaw_mag_rad).any())
    if result.told.truth is not None and len(result.told.truth) < 2:
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
    return found


def summary_markdown(summary: dict[str, Any]) -> str:
    """The summary for people, inside the recording."""
    low, high = (round(value, 1) + 0.0 for value in summary["altitude_range_m"])  # no -0.0
    turns = f"{summary['turns']} turn{'' if summary['turns'] == 1 else 's'}"
    best = "ekf" if "smoothed" in summary["failed"] else "smoothed"
    smoothed = summary["estimators"][best]
    why = for_markdown(summary["failed"].get("smoothed", ""))
    integrity = Integrity.from_dict(summary.get("integrity"))
    verdict, *reasons = verdict_lines(integrity)
    altitude = f"altitude {low:+.1f} to {high:+.1f} m" if summary["log"]["samples"]["pressure"] else "no barometer"
    lines = [
        f"# {for_markdown(summary['log']['name'], MOST_NAME)}",
        f"**{for_markdown(verdict[0].upper() + verdict[1:])}.**",
        *(f"- {for_markdown(reason)}" for reason in reasons),
        "",
        f"{summary['log']['duration_s']:.0f} s of log, {summary['steps']} steps, "
        f"{summary['distance_m']:.0f} m as smoothed, {turns}, {altitude}.",
        *([f"\n**No smoothed walk: what is drawn as smoothed is the EKF's.** {why}"] if best == "ekf" else []),
        "",
        f"{_ends_text(smoothed['end_m'], summary)}.",
    ]
    if (declination := summary.get("declination")) is not None:
        lines.append(f"\nD{for_markdown(declination['text'][1:])}.")
    findings = summary.get("findings", [])
    lines += [f"\nThe {f['text']}." for f in findings if f["kind"] == "gyro_bias"]
    lines += ["", *_estimator_table(summary)]
    if "score" in smoothed:
        lines += [
            "",
            "Errors are horizontal, at the truth's checkpoints after the first; “last” is at the last of them.",
        ]
    lines += (
        ["", "## Warnings", *(f"- {for_markdown(text)}" for text in summary["warnings"])] if summary["warnings"] else []
    )
    told_above = {reason.sentence for reason in integrity.reasons[:MOST_TOLD]}
    worth = [f for f in findings if f["kind"] != "gyro_bias" and f["text"] not in told_above]
    worth.sort(key=lambda f: f["kind"] != "truth")  # what is wrong before what may be its cause
    if worth:
        lines += ["", "## Worth a look"]
    for f in worth:
        when = (
            f"{f['start_s']:.0f} s" if f["end_s"] - f["start_s"] < 1.0 else f"{f['start_s']:.0f} to {f['end_s']:.0f} s"
        )
        lines.append(f"- {when}: {f['text']}")
    return "\n".join(lines) + "\n"


def _estimator_table(summary: dict[str, Any]) -> list[str]:
    """Where each estimator ends and how far it is from the truth, as lines of a Markdown table."""
    lines = [
        "| estimator | ends East, North (m) | RMSE (m) | max (m) | last (m) | told of |",
        "|---|---|---|---|---|---|",
    ]
    told = {"unaided": "nothing", "closed": "its end is its start", "anchored": "anchors", "axis": "the axis"}
    way_back = summary.get("return") or {}
    closures, doubted = way_back.get("closures", 0), way_back.get("closures_doubted", 0)
    let_go = f", {doubted} doubted" if doubted else ""
    for name, entry in summary["estimators"].items():
        x_m, y_m, _ = (round(value, 1) + 0.0 for value in entry["end_m"])
        row = f"| {LABELS[name]} | {x_m:.1f}, {y_m:.1f} |"
        if "score" in entry:
            s = entry["score"]
            knew = " and ".join(told[one] for one in s["label"].split(" + "))
            row += f" {s['rmse_m']:.2f} | {s['max_m']:.2f} | {s['final_m']:.2f} | {knew}"
            row += f"; found {closures} closures{let_go} |" if closures and name == "smoothed" else " |"
        else:
            row += " – | – | – | no truth |"
        lines.append(row)
    return lines


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
