#!/usr/bin/env python3
"""How far off walks are, in one table: every log with truth in the named folders, one configuration a kind of device.

.venv/bin/python scripts/accuracy.py ../shared/data [--out accuracy.csv] [--jobs 2] [--check]

Horizontal RMSE in metres, a row a log: PDR, EKF and the online smoother at each step, told nothing; the smoother told
nothing (unaided), after the best rigid fit (aligned), told that the walk ends where it began (closed, of walks that
do), given every third checkpoint (anchored) or the first and the next that is 10 m or more from it (start + place),
and scored on the others; laid along the axis of its building, which all logs of the group tell without truth (axis). A
truth that is a track in a frame of its own (RIDI's) is fitted over its first 5 s. Then the means of each group, with
the mean difference to the EKF on the same checkpoints and its 95 % interval (bootstrap over logs). `NAME_truth.csv`
beside a log, or truth.csv in a folder that is one, is its truth where it carries none.

``--check`` fails where a mean is more than 3 % worse than ``accuracy_baseline.toml`` has it and that does not say why;
``--write-baseline`` writes it, with ``--because TEXT`` where something got worse.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import sys
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from scored_walks import MODES, UNAIDED, FoundLog, ScoredWalk, find_logs, score_log, with_buildings

from fbgraph.core.building_files import read_building
from fbgraph.core.config import load_config
from fbgraph.core.safe_text import for_csv
from fbgraph.core.whole_writes import whole_file
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.run.coverage import ELLIPSE_95
from fbgraph.study.comparison import interval_of_mean
from fbgraph.workers.run_tasks import run_tasks

FLOORS_M = {0: 0.0, -1: -3.4, -2: -5.5}  # measured in the museum of ipin2023
BASELINE = Path(__file__).with_name("accuracy_baseline.toml")
WORSE = 1.03
"""A mean that has grown by more than this is told."""
ONLINE = "online"
Row = dict[str, Any]
"""Cells by column; what is not known is absent."""
_BEFORE = ("group", "log", "checkpoints", "pdr", "ekf", ONLINE)
_AFTER = ("ce50", "ce75", "ce95", "inside_95", "of", "nees", "verdict", "note")
COLUMNS = (*_BEFORE, *MODES, *(f"ekf {mode}" for mode in MODES[1:]), *(f"less ekf {mode}" for mode in MODES))
COLUMNS = (*COLUMNS, *(f"{mode} {end}" for mode in MODES for end in ("low", "high")), *_AFTER)


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 1 if a mean got worse, 2 if there is nothing to score or to compare."""
    asked = _parser().parse_args(arguments)
    found = sorted({log.path: log for folder in asked.folders for log in find_logs(folder)}.values(), key=_order)
    if not asked.no_axis:
        found = with_buildings(found, None if asked.building is None else read_building(asked.building))
    walks = [walk for walk in scored(found, asked.jobs) if walk is not None]
    if not walks:
        print("no log with truth in these folders", file=sys.stderr)
        return 2
    groups = by_group(walks)
    means = [mean_row(name, members) for name, members in groups.items()]
    print(markdown([*(log_row(walk) for walk in walks), *means]))
    print(f"\n{by_mode(groups)}")
    for log in found:
        if "Trial51" in log.path.name:
            altitude(log.path)
    if asked.out is not None:
        write_csv(asked.out, [*(log_row(walk) for walk in walks), *means])
    now = {name: as_baseline(members) for name, members in groups.items()}
    if asked.write_baseline:
        return write_baseline(asked.baseline, now, asked.because)
    return check(asked.baseline, now) if asked.check else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Score every log with truth in folders.")
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="searched for logs, recursively")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write the table there too")
    parser.add_argument(
        "--building", type=Path, metavar="FILE.toml", help="of all logs; learned for each group if absent"
    )
    parser.add_argument("--no-axis", action="store_true", help="learn no building and lay no walk along it")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--check", action="store_true", help="fail if a mean is more than 3 %% worse than the baseline")
    parser.add_argument("--baseline", type=Path, default=BASELINE, metavar="FILE.toml")
    parser.add_argument("--write-baseline", action="store_true", help="make these means the baseline")
    parser.add_argument("--because", default="", metavar="TEXT", help="why something may be worse than the baseline")
    return parser


def _order(found: FoundLog) -> tuple[str, str]:
    return found.group, str(found.path)


def scored(found: Sequence[FoundLog], jobs: int) -> list[ScoredWalk | None]:
    """All logs, in order."""
    outcomes = sorted(run_tasks(score_log, found, 0 if jobs < 2 else jobs), key=lambda one: one.number)
    return [one.required() for one in outcomes]


def by_group(walks: Iterable[ScoredWalk]) -> dict[str, list[ScoredWalk]]:
    """Walks by their group's name."""
    groups: dict[str, list[ScoredWalk]] = {}
    for walk in walks:
        groups.setdefault(walk.group, []).append(walk)
    return dict(sorted(groups.items()))


def log_row(walk: ScoredWalk) -> Row:
    """A log's row."""
    free = walk.modes[UNAIDED]
    row: Row = {"group": walk.group, "log": walk.name, "verdict": walk.verdict, "note": walk.note}
    row |= {"pdr": free.pdr_m, "ekf": free.ekf_m, ONLINE: free.online_m}
    for mode, score in walk.modes.items():
        row |= {mode: score.smoothed_m, f"less ekf {mode}": score.smoothed_m - score.ekf_m}
        row |= {} if mode == UNAIDED else {f"ekf {mode}": score.ekf_m}
    return row | circles([walk])


def mean_row(group: str, walks: list[ScoredWalk]) -> Row:
    """A group's row: means over its logs, circular errors and ellipses over all their checkpoints."""
    row: Row = {"group": group, "log": f"mean of {len(walks)}"}
    rows = [log_row(walk) for walk in walks]
    for column in rows[0].keys() | {key for one in rows for key in one}:
        values = [one[column] for one in rows if isinstance(one.get(column), float)]
        if values:
            row[column] = float(np.mean(values))
    for mode in MODES:
        less_m = [one[f"less ekf {mode}"] for one in rows if mode in one]
        if len(less_m) > 2:
            row[f"{mode} low"], row[f"{mode} high"] = interval_of_mean(np.array(less_m))
    sound = sum(walk.verdict == "sound" for walk in walks)
    return row | circles(walks) | {"verdict": f"{sound} sound"}


def circles(walks: list[ScoredWalk], mode: str = UNAIDED) -> Row:
    """Circular errors and ellipses of a mode, over the checkpoints of several walks."""
    scores = [walk.modes[mode] for walk in walks if mode in walk.modes]
    error_m, nees = (np.concatenate([getattr(one, name) for one in scores]) for name in ("error_m", "nees"))
    ce_m = np.quantile(error_m, (0.5, 0.75, 0.95), method="inverted_cdf").tolist()
    row: Row = {"checkpoints": len(error_m), **dict(zip(("ce50", "ce75", "ce95"), ce_m, strict=True))}
    if len(nees):
        row |= {"inside_95": int((nees <= ELLIPSE_95).sum()), "of": len(nees), "nees": float(nees.mean())}
    return row


def markdown(rows: list[Row]) -> str:
    """A row a log, then the means."""
    shown = (*_BEFORE, *MODES, *_AFTER)
    return _table([[_cell(row.get(name, "")) for name in shown] for row in rows], shown)


def by_mode(groups: dict[str, list[ScoredWalk]]) -> str:
    """The means once more, a row a group and mode."""
    heads: tuple[str, ...] = ("logs", "mode", "PDR", "EKF", "online, at each step", "smoother", "smoother / EKF")
    heads = (*heads, "less EKF (95 %)", "CE50", "CE75", "CE95", "in its 95 % ellipse", "NEES")
    rows = []
    for group, walks in groups.items():
        for mode in MODES:
            scores = [walk.modes[mode] for walk in walks if mode in walk.modes]
            if not scores:
                continue
            names = ("pdr_m", "ekf_m", "online_m", "smoothed_m")
            means = [float(np.mean([getattr(one, name) for one in scores])) for name in names]
            less = np.array([one.smoothed_m - one.ekf_m for one in scores])
            low, high = interval_of_mean(less)
            held = circles(walks, mode)
            inside = f"{100.0 * held['inside_95'] / held['of']:.0f} % of {held['of']}" if "of" in held else ""
            cells = [f"{group}, {len(scores)}", mode, *map(_cell, means), _cell(means[3] / means[1])]
            cells += [f"{less.mean():+.2f}" + (f" ({low:+.2f} to {high:+.2f})" if np.isfinite(low) else "")]
            cells += [*(_cell(held[name]) for name in ("ce50", "ce75", "ce95")), inside, _cell(held.get("nees", ""))]
            rows.append(cells)
    return _table(rows, heads)


def _table(rows: list[list[str]], heads: Sequence[str]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.2f}" if np.isfinite(value) else ""
    return str(value)


def write_csv(path: Path, rows: list[Row]) -> None:
    """All columns; an empty cell is not known."""
    with whole_file(path) as partial, open(partial, "w", encoding="utf-8", newline="") as out:
        table = csv.writer(out, lineterminator="\n")
        table.writerow([name.replace(" + ", "_").replace(" ", "_") for name in COLUMNS])
        for row in rows:
            cells = [row.get(name, "") for name in COLUMNS]
            table.writerow([for_csv(c) if isinstance(c, str) else f"{c:.4f}" if c == c else "" for c in cells])


def as_baseline(walks: list[ScoredWalk]) -> Row:
    """A group's means as the baseline holds them, and which logs they are of."""
    named = hashlib.sha256("\n".join(sorted(walk.name for walk in walks)).encode()).hexdigest()[:12]
    row = mean_row("", walks)
    means = {mode: round(row[mode], 4) for mode in (ONLINE, *MODES) if mode in row}
    return {"logs": len(walks), "digest": named, "mean_m": means, "accepted": {}}


def compared(was: Row, now: Row) -> dict[str, tuple[float, float, str]]:
    """Means that are more than 3 % worse than they were: before, now, and why that is accepted (empty if it is not)."""
    worse = {}
    for mode, now_m in now["mean_m"].items():
        was_m = was["mean_m"].get(mode)
        if was_m is not None and now_m > WORSE * was_m:
            accepted = was.get("accepted", {}).get(mode, {})
            why = accepted.get("why", "") if now_m <= accepted.get("up_to_m", 0.0) + 0.005 else ""
            worse[mode] = (was_m, now_m, why.strip())
    return worse


def check(path: Path, now: dict[str, Row]) -> int:
    """Compare with the baseline, saying what is worse, and why that is accepted."""
    baseline = tomllib.loads(path.read_text("utf-8"))
    failed, alike = False, 0
    for group, row in now.items():
        was = baseline.get(group)
        if was is None or was["digest"] != row["digest"]:
            print(f"not compared: {group}: other logs than the baseline's")
            continue
        alike += 1
        for mode, (was_m, now_m, why) in compared(was, row).items():
            failed |= not why
            text = f"{group}, {mode}: {was_m:.2f} → {now_m:.2f} m, {100.0 * (now_m / was_m - 1.0):.1f} % worse"
            print(f"{text}; accepted: {why}" if why else f"FAILED: {text}")
    if not alike:
        print(f"nothing to compare with in {path}", file=sys.stderr)
        return 2
    print("worse than the baseline" if failed else f"no worse than the baseline, {alike} groups")
    return int(failed)


def write_baseline(path: Path, now: dict[str, Row], because: str) -> int:
    """Keep the best means that these logs ever had; what is more than 3 % worse needs a reason."""
    baseline: dict[str, Row] = tomllib.loads(path.read_text("utf-8")) if path.exists() else {}
    for group, row in now.items():
        was = baseline.get(group)
        if was is not None and was["digest"] == row["digest"]:
            for mode, (was_m, now_m, why) in compared(was, row).items():
                if not (why or because.strip()):
                    print(f"{group}, {mode}: {was_m:.2f} → {now_m:.2f} m: say why with --because", file=sys.stderr)
                    return 1
                row["accepted"][mode] = {"up_to_m": now_m, "why": why or because.strip()}
            row["mean_m"] = was["mean_m"] | {
                m: min(now_m, was["mean_m"].get(m, now_m)) for m, now_m in row["mean_m"].items()
            }
        baseline[group] = row
    with whole_file(path) as partial:
        partial.write_text(tomli_w.dumps(baseline), "utf-8")
    print(f"written to {path}")
    return 0


def altitude(path: Path) -> None:
    """How far off altitude is on the museum's stairs."""
    log_file = read_log(path)
    truth = log_file.truth
    assert truth is not None
    result = reconstruct(log_file.log, load_config(preset(log_file.log.format)))
    z_m = result.trajectories["smoothed"].at(truth.t_s - log_file.log.t0_s)[:, 2]
    off = z_m - [FLOORS_M[int(floor)] for floor in truth.floor]
    print(f"\n{path.name}: altitude off by at most {np.abs(off).max():.2f} m at {len(off)} checkpoints")


if __name__ == "__main__":
    sys.exit(main())
