"""The command line: reads arguments, calls the pipeline, prints. The only room that prints or exits."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fbgraph import __version__
from fbgraph.errors import FbgraphError

if TYPE_CHECKING:
    from fbgraph.pipeline import Progress

app = typer.Typer(
    help="Where somebody walked, from IMU, magnetometer and barometer alone.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

LogArgument = Annotated[Path, typer.Argument(metavar="LOG", help="A walk's log file, .gz or not.", show_default=False)]
ConfigOption = Annotated[
    str | None,
    typer.Option(
        "--config", metavar="PRESET|FILE", help="phone, m5stickc or a TOML file; by the log's format if absent."
    ),
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Set one configuration key; repeatable.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


def main() -> None:
    """Entry point: every error ends as one line on stderr and an exit code (2 usage, 3 data, 4 estimation, 1 else)."""
    try:
        app()
    except FbgraphError as error:
        _fail(str(error), error.exit_code)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except Exception as error:
        if os.environ.get("FBGRAPH_DEBUG"):
            raise
        _fail(f"unexpected {type(error).__name__}: {error} (set FBGRAPH_DEBUG=1 for the traceback)", 1)


def _fail(message: str, code: int) -> None:
    print(f"fbgraph: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(code)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"fbgraph {__version__}")
        raise typer.Exit()


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
def smooth(
    log: LogArgument,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Run folder; runs/<log name> if absent.")
    ] = None,
    config: ConfigOption = None,
    set_: SetOption = None,
    format_: Annotated[
        str | None, typer.Option("--format", metavar="NAME", help="Log format; found by content if absent.")
    ] = None,
    truth: Annotated[
        Path | None,
        typer.Option("--truth", metavar="CSV", help="Known places, for scoring only: t_s,x_m,y_m[,z_m][,floor]."),
    ] = None,
    anchors: Annotated[
        Path | None,
        typer.Option("--anchors", metavar="CSV", help="Known places for the smoother: t_s,x_m,y_m[,z_m][,sigma_m]."),
    ] = None,
    closed_loop: Annotated[bool, typer.Option("--closed-loop", help="The walk ends where it began.")] = False,
    no_recording: Annotated[bool, typer.Option("--no-recording", help="Write no recording.rrd.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Reconstruct a walk: PDR, EKF and factor-graph smoother on the same steps."""
    from fbgraph.checkpoints import read_checkpoints
    from fbgraph.config import load_config
    from fbgraph.pipeline import reconstruct, write_run
    from fbgraph.readers import preset, read_log

    load_config(config, set_ or ())  # a wrong option is told before a long log is read
    known = None if truth is None else read_checkpoints(truth)
    anchored = None if anchors is None else read_checkpoints(anchors)
    with _progress() as progress:
        progress("read")
        log_file = read_log(log, format_)
        effective = load_config(config or preset(log_file.log.format), set_ or ())
        result = reconstruct(log_file.log, effective, known or log_file.truth, anchored, closed_loop, progress=progress)
        folder = out or Path("runs") / log_file.log.name
        summary = write_run(result, folder, recording=not no_recording, progress=progress)
    if as_json:
        print(json.dumps({"out": str(folder), **summary}, indent=2))
    else:
        _print_summary(summary)
        print(f"written to {folder}")


@app.command()
def evaluate(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.", show_default=False)],
    truth: Annotated[Path, typer.Option("--truth", metavar="CSV", help="Known places: t_s,x_m,y_m[,z_m][,floor].")],
    as_json: JsonOption = False,
) -> None:
    """Score a run folder against known places."""
    from fbgraph.checkpoints import read_checkpoints
    from fbgraph.exports import read_summary, score_run

    scores = score_run(run, read_checkpoints(truth))
    if as_json:
        print(json.dumps(scores, indent=2))
    else:
        _print_scores(read_summary(run)["log"]["name"], scores)


@app.command()
def simulate(
    out: Annotated[Path, typer.Argument(metavar="OUT.csv", help="The M5StickC log to write.", show_default=False)],
    route: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE", help="obstacle, square, straight, eight, out-and-back, stairs, or x_m,y_m[,z_m] CSV."
        ),
    ] = "obstacle",
    seed: Annotated[int, typer.Option(help="Same seed, same walk.")] = 0,
    laps: Annotated[int, typer.Option(help="Walk the route so often.")] = 1,
    scale: Annotated[float, typer.Option(help="Stretch the route.")] = 1.0,
    duration_s: Annotated[
        float | None, typer.Option("--duration", metavar="SECONDS", help="Repeat the route for about this long.")
    ] = None,
    noise: Annotated[float, typer.Option(help="Sensor errors: 1 as the data sheets say, 0 perfect.")] = 1.0,
    anomalies: Annotated[float, typer.Option(help="Strength of the iron beside the route.")] = 1.0,
    variation: Annotated[float, typer.Option(help="Irregularity of the gait; 0 is a metronome.")] = 1.0,
    shake_s: Annotated[float, typer.Option("--shake", metavar="SECONDS", help="Shake and turn before the walk.")] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Write a simulated M5StickC log, and its exact truth beside it as OUT_truth.csv."""
    from fbgraph.gait import Walker
    from fbgraph.pipeline import simulate_files
    from fbgraph.routes import load_route
    from fbgraph.simulate import SimulateOptions

    walker = Walker(gait_variation=variation, shake_s=shake_s)
    options = SimulateOptions(walker=walker, noise=noise, anomalies=anomalies, duration_s=duration_s)
    written = simulate_files(out, load_route(route, scale, laps), options, seed)
    print(json.dumps(written, indent=2) if as_json else "\n".join(f"{k}: {v}" for k, v in written.items()))


@app.command()
def formats(as_json: JsonOption = False) -> None:
    """List the log formats that can be read, with an example of each."""
    from fbgraph.readers import FORMATS, reader

    known = {name: reader(name) for name in FORMATS}
    if as_json:
        print(
            json.dumps(
                [{"name": n, "description": r.DESCRIPTION, "example": r.EXAMPLE} for n, r in known.items()], indent=2
            )
        )
        return
    for name, module in known.items():
        print(f"{name}: {module.DESCRIPTION}")
        print("".join(f"    {line}\n" for line in module.EXAMPLE.strip().splitlines()))


@app.command()
def config(config: ConfigOption = None, set_: SetOption = None, as_json: JsonOption = False) -> None:
    """Print the effective configuration as TOML."""
    from fbgraph.config import dump_toml, load_config

    effective = load_config(config, set_ or ())
    print(effective.model_dump_json(indent=2) if as_json else dump_toml(effective), end="\n" if as_json else "")


@contextmanager
def _progress() -> Iterator[Progress]:
    """A bar of stages on a terminal, nothing elsewhere."""
    stages = ("read", "steps", "pdr", "ekf", "smoother", "tables", "recording")
    if not sys.stderr.isatty():
        yield lambda stage: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:10}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=len(stages))
        yield lambda stage: bar.update(task, description=stage, completed=stages.index(stage))


def _print_summary(summary: dict[str, Any]) -> None:
    log = summary["log"]
    low, high = summary["altitude_range_m"]
    altitude = f"altitude {low:+.1f} to {high:+.1f} m" if log["samples"]["pressure"] else "no barometer"
    minutes, seconds = divmod(round(log["duration_s"]), 60)
    print(
        f"{log['name']} ({log['format']}): {minutes} min {seconds:02d} s, {summary['steps']} steps, "
        f"{summary['distance_m']:.1f} m, {summary['turns']} turns, {altitude}"
    )
    scores = {name: entry.get("score") for name, entry in summary["estimators"].items()}
    rows = []
    for name, entry in summary["estimators"].items():
        end = [f"{value:.2f}" for value in entry["end_m"]]
        rows.append([name, f"{entry['distance_m']:.1f}", str(entry["turns"]), *end, *_score_cells(scores[name])])
    heads = ["estimator", "distance m", "turns", "end x m", "end y m", "end z m"]
    _print_table(heads + (_SCORE_HEADS if any(scores.values()) else []), rows)
    for text in summary["warnings"]:
        print(f"note: {text}")


_SCORE_HEADS = ["RMSE m", "mean m", "max m", "final m", "scored"]


def _score_cells(score: dict[str, Any] | None) -> list[str]:
    if score is None:
        return []
    return [*(f"{score[key]:.2f}" for key in ("rmse_m", "mean_m", "max_m", "final_m")), score["label"]]


def _print_scores(name: str, scores: dict[str, Any]) -> None:
    print(f"{name}: {next(iter(scores.values()))['checkpoints']} checkpoints scored")
    rows = [[name, *_score_cells(score), f"{score['aligned_rmse_m']:.2f}"] for name, score in scores.items()]
    _print_table(["estimator", *_SCORE_HEADS, "aligned RMSE m"], rows)


def _print_table(heads: list[str], rows: list[list[str]]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head in heads:
        table.add_column(head, justify="left" if head in ("estimator", "scored") else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    # a pipe has no width of its own: give it all the table needs
    Console(width=None if sys.stdout.isatty() else 160).print(table)


if __name__ == "__main__":
    main()
