"""A log's row in the index of its batch: what its summary says, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fbgraph.batches.log_entry import RUNS, LogEntry
from fbgraph.workers.outcome import Outcome

DONE, FAILED = "done", "failed"
ESTIMATORS = ("pdr", "ekf", "smoothed")
_SCORES = ("rmse_m", "mean_m", "max_m", "final_m")
_STAGES = ("read", "steps", "baselines", "smoother", "closures", "write")
_VERSIONS = ("fbgraph", "gtsam", "numpy", "scipy", "vqf")
COLUMNS: dict[str, str] = {
    **dict.fromkeys(("name", "log", "status", "cause", "reason", "verdict", "why", "format"), "string"),
    **dict.fromkeys(("duration_s", "walk_s", "rest_s"), "Float64"),
    "steps": "Int64",
    "distance_m": "Float64",
    "turns": "Int64",
    "turned_back": "boolean",
    **dict.fromkeys(("closures", "closures_doubted"), "Int64"),
    **dict.fromkeys(("end_x_m", "end_y_m", "end_z_m", "end_2sigma_m"), "Float64"),
    **dict.fromkeys(("warnings", "findings", "checkpoints"), "Int64"),
    "scored": "string",
    **{f"{name}_{score}": "Float64" for name in ESTIMATORS for score in _SCORES},
    **dict.fromkeys(("inside_95", "ellipses"), "Int64"),
    "nees_mean": "Float64",
    "iterations": "Int64",
    **{f"{stage}_s": "Float64" for stage in _STAGES},
    **dict.fromkeys(("wall_s", "cpu_s"), "Float64"),
    "tries": "Int64",
    **dict.fromkeys(("truth", "anchors", "config", "run", *_VERSIONS), "string"),
}
"""Of the index, with pandas' types: metres, seconds and counts are empty where they are not known."""
TIMINGS = (*(f"{stage}_s" for stage in _STAGES), "wall_s", "cpu_s", "tries")
"""Columns that another run of the same batch fills otherwise."""


def row_of(
    entry: LogEntry, summary: Mapping[str, Any], read_s: float, write_s: float, wall_s: float, cpu_s: float
) -> dict[str, Any]:
    """The row of a log whose run was written.

    Args:
        entry: the log.
        summary: of its run.
        read_s, write_s: seconds that reading the log and writing the run took.
        wall_s, cpu_s: that all of it took, of a clock and of the processor.
    """
    best = "ekf" if "smoothed" in summary["failed"] else "smoothed"
    integrity, back = summary["integrity"], summary["return"] or {}
    reasons = integrity["reasons"]
    failure = summary["failed"].get("smoothed", "")
    failed = bool(failure) and not failure.startswith("withheld")
    row: dict[str, Any] = {
        **_entry_cells(entry),
        "status": FAILED if failed else DONE,
        "cause": "estimation" if failed else "",
        "reason": failure if failed else "",
        "verdict": integrity["verdict"],
        "why": reasons[0]["text"] if reasons else "",
        "format": summary["log"]["format"],
        "duration_s": summary["log"]["duration_s"],
        **{key: summary[key] for key in ("walk_s", "rest_s", "steps", "distance_m", "turns", "end_2sigma_m")},
        "turned_back": bool(back),
        "closures": back.get("closures", 0),
        "closures_doubted": back.get("closures_doubted", 0),
        **dict(zip(("end_x_m", "end_y_m", "end_z_m"), summary["estimators"][best]["end_m"], strict=True)),
        "warnings": len(summary["warnings"]),
        "findings": len(summary["findings"]),
        "iterations": summary["solver"]["iterations"],
        "read_s": round(read_s, 3),
        "write_s": round(write_s, 3),
        "wall_s": round(wall_s, 3),
        "cpu_s": round(cpu_s, 3),
        "tries": 1,
        **{f"{stage}_s": summary["seconds"].get(stage) for stage in _STAGES[1:-1]},
        "run": f"{RUNS}/{entry.name}",
        "fbgraph": summary["fbgraph"],
        **{name: summary["versions"][name] for name in _VERSIONS[1:]},
    }
    return row | _score_cells(summary)


def _entry_cells(entry: LogEntry) -> dict[str, Any]:
    return {"name": entry.name, **{key: getattr(entry, key) for key in ("log", "truth", "anchors", "config")}}


def _score_cells(summary: Mapping[str, Any]) -> dict[str, Any]:
    """What truth says of each estimator; nothing where there is none."""
    cells: dict[str, Any] = {}
    for name in ESTIMATORS:
        score = summary["estimators"].get(name, {}).get("score")
        if score is None:
            continue
        cells |= {f"{name}_{key}": score[key] for key in _SCORES}
        cells |= {"checkpoints": score["checkpoints"], "scored": score["label"]}
        if (covered := score.get("coverage")) is not None:
            cells |= {"inside_95": covered["inside_95"], "ellipses": covered["of"], "nees_mean": covered["nees_mean"]}
    return cells


def failed_row(entry: LogEntry, outcome: Outcome[Any]) -> dict[str, Any]:
    """The row of a log that has no run."""
    cpu_s = round(outcome.cpu_s, 3) if outcome.cpu_s else None
    return {
        **_entry_cells(entry),
        **{"status": FAILED, "cause": outcome.cause, "reason": outcome.reason},
        **{"wall_s": round(outcome.wall_s, 3), "cpu_s": cpu_s, "tries": outcome.tries},
    }
