"""Everything that is printed goes through here: lines, documents, tables, progress bars.

What comes from a log or a file is shown, never interpreted (``core.safe_text``).
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from fbgraph.core.safe_text import for_json, for_terminal, short_name, visible
from fbgraph.core.verdict import Integrity, verdict_lines

Progress = Callable[[str], None]
"""Called with the name of each stage as it begins."""
_lost: list[OSError] = []


def say(line: str = "") -> None:
    """Print one line."""
    _write((for_terminal(line) + "\n").encode(sys.stdout.encoding, "backslashreplace"))


def say_json(value: object, indent: int | None = 2) -> None:
    """Print something as JSON."""
    _write((for_json(json.dumps(value, indent=indent)) + "\n").encode())


def say_document(text: str, for_reading: bool) -> None:
    """Print text of many lines; what is not for reading but for a program is UTF-8 wherever it is printed."""
    if for_reading:
        _write(visible(text, keep="\n\t").encode(sys.stdout.encoding, "backslashreplace"))
    else:
        _write(text.encode())


def complain(text: str) -> None:
    """Tell the user on stderr, in one line, what went wrong."""
    with suppress(OSError):  # nobody reads it
        print(f"fbgraph: {for_terminal(' '.join(text.split()))}", file=sys.stderr, flush=True)


def _write(data: bytes) -> None:
    """Write to stdout at once; who no longer reads it misses the rest, the work goes on."""
    try:
        sys.stdout.flush()
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    except BrokenPipeError:
        close_stdout()
    except OSError as error:  # a full disk behind a redirection: the work goes on, the exit code tells
        close_stdout()
        _lost.append(error)
        complain(f"standard output cannot be written ({error.strerror}); files are written all the same")


def output_lost() -> bool:
    """Whether something that was printed found no place."""
    return bool(_lost)


def close_stdout() -> None:
    """From now on print to nobody."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar of stages on a terminal, nothing elsewhere."""
    stages = ("read", "steps", "baselines", "smoother", "closures", "tables", "recording")
    if not sys.stderr.isatty():
        yield lambda stage: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:10}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=len(stages))
        yield lambda stage: bar.update(task, description=stage, completed=stages.index(stage))


def print_summary(summary: dict[str, Any]) -> None:
    """What a run found, from its summary."""
    log = summary["log"]
    low, high = (round(value, 1) + 0.0 for value in summary["altitude_range_m"])  # no -0.0
    altitude = f"altitude {low:+.1f} to {high:+.1f} m" if log["samples"]["pressure"] else "no barometer"
    minutes, seconds = divmod(round(log["duration_s"]), 60)
    name = short_name(log["name"])
    say(
        f"{name} ({log['format']}): {minutes} min {seconds:02d} s, {summary['steps']} steps, "
        f"{summary['distance_m']:.1f} m, {summary['turns']} turns, {altitude}"
    )
    for line in reading_lines(log):
        say(line)
    scores = {name: entry.get("score") for name, entry in summary["estimators"].items()}
    rows = []
    for name, entry in summary["estimators"].items():
        end = [f"{value:.2f}" for value in entry["end_m"]]
        rows.append([name, f"{entry['distance_m']:.1f}", str(entry["turns"]), *end, *_score_cells(scores[name])])
    heads = ["estimator", "distance m", "turns", "end x m", "end y m", "end z m"]
    print_table(heads + (_SCORE_HEADS if any(scores.values()) else []), rows)
    if summary["return"] is not None:
        _print_return(summary["return"])
    if summary["declination"] is not None:
        say(summary["declination"]["text"])
    for text in summary["warnings"]:
        say(f"note: {text}")
    verdict, *reasons = verdict_lines(Integrity.from_dict(summary.get("integrity")))
    say(verdict)
    for reason in reasons:
        say(f"  - {reason}")


def reading_lines(log: dict[str, Any]) -> list[str]:
    """How a log was read and what was assumed, in a line each, from its part of the summary."""
    reading, rates_hz = log.get("reading") or {}, log["rates_hz"]
    sensors = reading.get("sensors", {})
    told = []
    for name, called in _MEASURED.items():
        if name not in rates_hz:
            continue
        sensor = sensors.get(name)
        text = called if sensor is None else f"{called} {_column_names(sensor)} in {sensor['unit'] or 'SI'}"
        if sensor is not None and sensor["axes"] != ["x", "y", "z"]:
            text += f" along {' '.join(sensor['axes'])}"
        told.append(f"{text}, {rates_hz[name]:g} Hz")
    clocks = [", ".join(clock["columns"]) or "evenly spaced rows" for clock in reading.get("clocks", [])]
    told += [f"time {' and '.join(dict.fromkeys(clocks))}"] if clocks else []
    lines = [f"read: {'; '.join(told)}"]
    if reading.get("assumed"):
        lines.append(f"assumed: {'; '.join(reading['assumed'])}")
    return lines


_MEASURED = {"acc": "acceleration", "gyro": "rotation", "mag": "field", "pressure": "pressure"}


def _column_names(sensor: dict[str, Any]) -> str:
    """``ax_g…``, with its table where there are several."""
    first, more = short_name(sensor["columns"][0]), "…" if len(sensor["columns"]) > 1 else ""
    return f"{first}{more}" if sensor["table"] == "*" else f"{short_name(sensor['table'])}/{first}{more}"


def _print_return(way_back: dict[str, Any]) -> None:
    turned, arrived_s = way_back["turn_back"], way_back["arrived_t_s"]
    text = f"turned back at {turned['t_s']:.1f} s (breadcrumb {turned['breadcrumb']}"
    text += f", known at {turned['known_t_s']:.1f} s; by the log's clock)"
    if way_back["steps"]:
        text += f", {way_back['steps']} steps guided, {way_back['off_route_steps']} of them off the route, "
        text += f"{way_back['remaining_m']:.1f} m left" if arrived_s is None else f"arrived at {arrived_s:.1f} s"
    say(f"{text}; {closures_text(way_back)}")


def closures_text(way_back: dict[str, Any]) -> str:
    """How many closures there are, and how many of them are doubted."""
    doubted = way_back.get("closures_doubted", 0)
    return f"{way_back['closures']} closures" + (f", {doubted} doubted" if doubted else "")


_SCORE_HEADS = ["RMSE m", "mean m", "max m", "final m", "scored"]


def _score_cells(score: dict[str, Any] | None) -> list[str]:
    if score is None:
        return []
    return [*(f"{score[key]:.2f}" for key in ("rmse_m", "mean_m", "max_m", "final_m")), score["label"]]


def print_scores(name: str, scores: dict[str, Any]) -> None:
    """Scores by estimator, from ``exports.score_run``."""
    say(f"{short_name(name)}: {next(iter(scores.values()))['checkpoints']} checkpoints scored")
    rows = [
        [name, *_score_cells(score), f"{score['aligned_rmse_m']:.2f}", _coverage_cell(score)]
        for name, score in scores.items()
    ]
    print_table(["estimator", *_SCORE_HEADS, "aligned RMSE m", "in 95 % ellipse"], rows)


def _coverage_cell(score: dict[str, Any]) -> str:
    """How many checkpoints lie within the ellipse of an estimator that has one."""
    covered = score.get("coverage")
    return "–" if covered is None else f"{covered['inside_95']} of {covered['of']}"


def print_table(heads: list[str], rows: list[list[str]]) -> None:
    """A table, numbers to the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head in heads:
        table.add_column(
            Text(head), justify="left" if head in ("estimator", "scored", "Metric") else "right", no_wrap=True
        )
    for row in rows:
        table.add_row(*(Text(short_name(cell)) for cell in row))  # no markup
    # a pipe has no width of its own: give it all the table needs
    console = Console(width=None if sys.stdout.isatty() else 160)
    with console.capture() as printed:
        console.print(table)
    _write(printed.get().encode(sys.stdout.encoding, "backslashreplace"))


@contextmanager
def study_progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar for each stage on a terminal, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda stage, share: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:10}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda stage, share: bar.update(task, description=stage, completed=share)
