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
    show_status("")
    with suppress(OSError):  # nobody reads it
        print(f"fbgraph: {for_terminal(' '.join(text.split()))}", file=sys.stderr, flush=True)


_status = [""]


def show_status(text: str) -> None:
    """Show a line on a terminal in place of the one before, nothing elsewhere; none if empty."""
    if text == _status[0]:
        return
    with suppress(OSError):
        if not sys.stderr.isatty():
            return
        import shutil

        kept = for_terminal(text)[: max(shutil.get_terminal_size().columns - 1, 1)]
        sys.stderr.write(f"\r\x1b[K{kept}")
        sys.stderr.flush()
        _status[0] = text


def _write(data: bytes) -> None:
    """Write to stdout at once; who no longer reads it misses the rest, the work goes on."""
    show_status("")
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
    scores = [entry.get("score") for entry in summary["estimators"].values()]
    rows = []
    for name, entry in summary["estimators"].items():
        end = [f"{value:.2f}" for value in entry["end_m"]]
        rows.append([name, f"{entry['distance_m']:.1f}", str(entry["turns"]), *end])
    heads = ["estimator", "distance m", "turns", "end x m", "end y m", "end z m"]
    without_scores = len(heads)
    if all(scores):
        heads += _SCORE_HEADS
        rows = [[*row, *_score_cells(score)] for row, score in zip(rows, scores, strict=True)]
    print_table(heads, rows, part_at=without_scores)
    if summary["return"] is not None:
        _print_return(summary["return"])
    if summary["declination"] is not None:
        say(summary["declination"]["text"])
    if (summary["axis"] or {}).get("used"):
        for finding in summary["findings"]:
            if finding["kind"] == "axis":
                say(finding["text"])
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


_SCORE_HEADS = ["scored", "RMSE m", "aligned\nRMSE m", "turned °", "mean m", "max m", "final m"]
_MORE_SCORE_HEADS = ["final %", "CE50 m", "CE75 m", "CE95 m", "Q3 m", "growth\nm/s", "in 95 %\nellipse"]
_MORE_METRES = ("ce50_m", "ce75_m", "ce95_m", "third_quartile_m")


def _score_cells(score: dict[str, Any]) -> list[str]:
    cells = [score["label"], *(f"{score[key]:.2f}" for key in ("rmse_m", "aligned_rmse_m"))]
    return [
        *cells,
        _known(score["turned_deg"], "+.0f"),
        *(f"{score[key]:.2f}" for key in ("mean_m", "max_m", "final_m")),
    ]


def print_scores(runs: dict[str, dict[str, Any]]) -> None:
    """Scores by run and estimator, from ``read_run.score_run``: how many checkpoints each run has, then a table."""
    rows = []
    for run, scores in runs.items():
        say(f"{short_name(run)}: {next(iter(scores.values()))['checkpoints']} checkpoints scored")
        for name, score in scores.items():
            more = [_known(score["final_percent"], ".1f"), *(f"{score[key]:.2f}" for key in _MORE_METRES)]
            more += [_known(score["growth_m_s"], ".4f"), _coverage_cell(score)]
            rows.append([run, name, *_score_cells(score), *more])
    heads = ["run", "estimator", *_SCORE_HEADS, *_MORE_SCORE_HEADS]
    if len(runs) == 1:
        print_table(heads[1:], [row[1:] for row in rows])
    else:
        print_table(heads, rows, keys=2)


def _known(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _coverage_cell(score: dict[str, Any]) -> str:
    """How many checkpoints lie within the ellipse of an estimator that has one."""
    covered = score.get("coverage")
    return "–" if covered is None else f"{covered['inside_95']} of {covered['of']}"


_TEXT_HEADS = ("run", "estimator", "scored", "Metric")


def print_table(heads: list[str], rows: list[list[str]], keys: int = 1, part_at: int = 0) -> None:
    """A table, numbers to the right; where it is wider than the terminal, its columns in several, one below another.

    Args:
        heads: may be of several lines.
        rows: as wide as the heads.
        keys: how many of the first columns say what a row is of; they stand in every table, shortened if need be.
        part_at: where the columns are parted first, if they must be; wherever they no longer fit if 0.
    """
    from rich.cells import cell_len

    width = _terminal_width()
    most = max(width // (2 * keys), 12)
    rows = [[*(_shortened(short_name(c), most) for c in row[:keys]), *map(short_name, row[keys:])] for row in rows]
    wide = [
        max(map(cell_len, [*head.split("\n"), *cells])) + _BETWEEN for head, *cells in zip(heads, *rows, strict=True)
    ]
    blocks: list[list[int]] = [[]]
    for column in range(keys, len(heads)):
        parted = column == part_at and sum(wide) > width
        if blocks[-1] and (parted or sum(wide[c] for c in (*range(keys), *blocks[-1], column)) > width):
            blocks.append([])
        blocks[-1].append(column)
    for block in blocks:
        kept = (*range(keys), *block)
        _print_block([heads[c] for c in kept], [[row[c] for c in kept] for row in rows], width)


_BETWEEN = 2
"""Characters between two columns; at the edges of a table, half of them each."""
_ANY_WIDTH = 10_000


def _terminal_width() -> int:
    """Of what is printed to; a pipe, unless ``COLUMNS`` gives it one, has none of its own and takes all."""
    import shutil

    if sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdecimal():
        return max(shutil.get_terminal_size().columns, 20)
    return _ANY_WIDTH


def _shortened(text: str, most: int) -> str:
    from rich.cells import cell_len, set_cell_size

    return text if cell_len(text) <= most else set_cell_size(text, most - 1).rstrip() + "…"


def _print_block(heads: list[str], rows: list[list[str]], width: int) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, _BETWEEN - 1, 0, 0))
    for head in heads:
        left = head in _TEXT_HEADS
        table.add_column(Text(head), justify="left" if left else "right", no_wrap=True, vertical="bottom")
    for row in rows:
        table.add_row(*map(Text, row))  # no markup
    console = Console(width=width)
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


@contextmanager
def batch_progress_bar() -> Iterator[Callable[[Any], None]]:
    """Logs of a batch that are over, how fast, failures and time left, on a terminal; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda so_far: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.fields[count]}"), BarColumn(bar_width=None), TextColumn("{task.fields[pace]}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1, count="", pace="")

        def show(so_far: Any) -> None:
            bar.update(task, total=so_far.total, completed=so_far.over, count=so_far.count_text, pace=so_far.pace_text)

        yield show
