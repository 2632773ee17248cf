"""The command line: reads arguments, calls the pipeline, prints. The only room that prints or exits."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fbgraph import __version__
from fbgraph.errors import ConfigError, FbgraphError

if TYPE_CHECKING:
    from fbgraph.config import Config
    from fbgraph.georeference import Georeference
    from fbgraph.live_view import LiveView
    from fbgraph.online import Update
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
FormatOption = Annotated[
    str | None, typer.Option("--format", metavar="NAME", help="Log format; found by content if absent.")
]
TruthOption = Annotated[
    Path | None,
    typer.Option("--truth", metavar="CSV", help="Known places, for scoring only: t_s,x_m,y_m[,z_m][,floor]."),
]
AnchorsOption = Annotated[
    Path | None,
    typer.Option("--anchors", metavar="CSV", help="Known places for the smoother: t_s,x_m,y_m[,z_m][,sigma_m]."),
]
ClosedLoopOption = Annotated[bool, typer.Option("--closed-loop", help="The walk ends where it began.")]
OriginOption = Annotated[
    str | None, typer.Option("--origin", metavar="LAT,LON", help="Where on Earth the walk began, in degrees.")
]
ReturnAtOption = Annotated[
    str | None,
    typer.Option(
        "--return-at", metavar="SECONDS|auto|event", help="When the way back begins; directions from then on."
    ),
]
NoRecordingOption = Annotated[bool, typer.Option("--no-recording", help="Write no recording.rrd.")]
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
    format_: FormatOption = None,
    truth: TruthOption = None,
    anchors: AnchorsOption = None,
    closed_loop: ClosedLoopOption = False,
    origin: OriginOption = None,
    out_and_back: Annotated[
        bool,
        typer.Option("--out-and-back/--no-out-and-back", help="Look for a turn-back; tie the way back to the way out."),
    ] = True,
    no_recording: NoRecordingOption = False,
    as_json: JsonOption = False,
) -> None:
    """Reconstruct a walk: PDR, EKF and factor-graph smoother on the same steps."""
    from fbgraph.checkpoints import read_checkpoints
    from fbgraph.config import load_config
    from fbgraph.georeference import parse_origin
    from fbgraph.pipeline import reconstruct, write_run
    from fbgraph.readers import preset, read_log

    set_ = [*(set_ or ()), *(() if out_and_back else ["returning.out_and_back=false"])]
    load_config(config, set_)  # a wrong option is told before a long log is read
    known = None if truth is None else read_checkpoints(truth)
    anchored = None if anchors is None else read_checkpoints(anchors)
    where = None if origin is None else parse_origin(origin)
    with _progress() as progress:
        progress("read")
        log_file = read_log(log, format_)
        effective = load_config(config or preset(log_file.log.format), set_)
        result = reconstruct(
            log_file.log,
            effective,
            known or log_file.truth,
            anchored,
            closed_loop,
            where,
            _inputs(log, format_, truth, anchors, closed_loop, where),
            progress,
        )
        folder = out or Path("runs") / log_file.log.name
        summary = write_run(result, folder, recording=not no_recording, progress=progress)
    if as_json:
        print(json.dumps({"out": str(folder), **summary}, indent=2))
    else:
        _print_summary(summary)
        print(f"written to {folder}")


@app.command()
def online(
    log: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="A log to replay; none with --source.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Run folder.")] = None,
    source: Annotated[
        str | None,
        typer.Option(metavar="SOURCE", help="Live: stdin, serial:PORT[@BAUD], udp://[HOST]:PORT, tcp://[HOST]:PORT."),
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Go on with an interrupted live walk (with --source).")
    ] = None,
    speed: Annotated[str, typer.Option(metavar="real|max|FACTOR", help="How fast to replay.")] = "max",
    chunk: Annotated[float, typer.Option(metavar="SECONDS", min=0.001, help="Replay in pieces this long.")] = 0.1,
    follow: Annotated[bool, typer.Option("--follow", help="Print a line at each step.")] = False,
    view: Annotated[bool, typer.Option("--view", help="Show the walk in a live Rerun viewer.")] = False,
    connect: Annotated[
        str | None, typer.Option(metavar="URL", help="A running Rerun viewer for --view (rerun+http://…/proxy).")
    ] = None,
    config: ConfigOption = None,
    set_: SetOption = None,
    format_: FormatOption = None,
    truth: TruthOption = None,
    anchors: AnchorsOption = None,
    closed_loop: ClosedLoopOption = False,
    origin: OriginOption = None,
    return_at: ReturnAtOption = None,
    no_recording: NoRecordingOption = False,
    as_json: JsonOption = False,
) -> None:
    """The trajectory while walking: replay a log, or follow a live device. Ctrl-C ends the walk, not the data."""
    from fbgraph import session
    from fbgraph.checkpoints import read_checkpoints
    from fbgraph.config import load_config
    from fbgraph.exports import check_run_folder
    from fbgraph.georeference import parse_origin
    from fbgraph.readers import preset, read_log
    from fbgraph.sources import open_source

    if (log is None) == (source is None):
        raise ConfigError("name either a LOG to replay or a --source to follow")
    if source is not None and anchors is not None:
        raise ConfigError("--anchors needs a LOG: a live device's clock is not known beforehand")
    set_ = [*(set_ or ()), *([f"returning.at={json.dumps(return_at)}"] if return_at is not None else ())]
    load_config(config, set_)  # a wrong option is told before a long log is read
    folder = resume or out
    if folder is None:
        if log is None:
            raise ConfigError("--out DIR says where the walk is kept")
        folder = Path("runs") / log.name.removesuffix(".gz").rpartition(".")[0]
    show = _update_printer(follow, as_json)
    known = None if truth is None else read_checkpoints(truth)
    where = None if origin is None else parse_origin(origin)
    inputs = _inputs(log, format_, truth, anchors, closed_loop, where)
    check_run_folder(folder)
    stopping = _stop_on_signals()
    if log is not None:
        log_file = read_log(log, format_)
        effective = load_config(config or preset(log_file.log.format), set_ or ())
        result = session.replay(
            log_file.log,
            effective,
            chunk_s=chunk,
            speed=_speed(speed),
            on_update=show,
            stop=stopping,
            truth=known or log_file.truth,
            anchors=None if anchors is None else read_checkpoints(anchors),
            closed_walk=closed_loop,
            origin=where,
            recording=not no_recording,
            view=_live_view(effective, view, connect),
            inputs=inputs,
        )
    else:
        assert source is not None
        effective = session.resumed_config(folder, return_at) if resume else load_config(config or "m5stickc", set_)
        result = session.live(
            open_source(source, stopping),
            folder,
            effective,
            on_update=show,
            resume=resume is not None,
            closed_walk=closed_loop,
            truth=known,
            origin=where,
            recording=not no_recording,
            view=_live_view(effective, view, connect),
            inputs=inputs,
        )
    summary = session.write_walk(result, folder, recording=not no_recording)
    if as_json:
        print(json.dumps({"out": str(folder), **summary}))
    else:
        _print_summary(summary)
        print(f"written to {folder}")


def _live_view(config: Config, view: bool, url: str | None) -> LiveView | None:
    if not view and url is None:
        return None
    _require_rerun()
    from fbgraph.live_view import LiveView

    return LiveView(config, url)


def _inputs(
    log: Path | None,
    format_: str | None,
    truth: Path | None,
    anchors: Path | None,
    closed_walk: bool,
    origin: Georeference | None,
) -> dict[str, Any]:
    """What a run is made from, for ``fbgraph record`` to make it again."""
    return {
        "log": None if log is None else str(log.resolve()),
        "format": format_,
        "truth": None if truth is None else str(truth.resolve()),
        "anchors": None if anchors is None else str(anchors.resolve()),
        "closed_walk": closed_walk,
        "origin": None if origin is None else [origin.lat_deg, origin.lon_deg],
    }


def _speed(text: str) -> float:
    if text in ("real", "max"):
        return 1.0 if text == "real" else float("inf")
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not factor > 0:
        raise ConfigError(f"--speed {text}: expected real, max or a positive factor")
    return factor


def _stop_on_signals() -> Callable[[], bool]:
    """Whether SIGINT or SIGTERM came; a second one ends at once."""
    import signal

    came: list[int] = []

    def note(number: int, _frame: object) -> None:
        came.append(number)
        signal.signal(number, signal.SIG_DFL)

    signal.signal(signal.SIGINT, note)
    signal.signal(signal.SIGTERM, note)
    return lambda: bool(came)


def _update_printer(follow: bool, as_json: bool) -> Callable[[Update], None]:
    def show(update: Update) -> None:
        if as_json:
            fields = asdict(update)
            if fields["returning"] is None:
                del fields["returning"]
            print(json.dumps(fields), flush=True)
        elif follow:
            from fbgraph.geometry import heading_deg

            print(
                f"{update.t_s:8.2f} s  step {update.k:5d}  x {update.x_m:8.2f}  y {update.y_m:8.2f}  "
                f"z {update.z_m:6.2f} m  heading {heading_deg(update.yaw_rad):3.0f}°  {update.distance_m:7.1f} m"
                + (f"  {update.returning.instruction}" if update.returning else ""),
                flush=True,
            )

    return show


@app.command()
def view(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN|FILE…", help="Run folders or .rrd files.")],
    save: Annotated[
        Path | None, typer.Option(metavar="FILE.rrd", help="Write what would be shown, open nothing.")
    ] = None,
    web: Annotated[bool, typer.Option("--web", help="Show it in a browser.")] = False,
) -> None:
    """Open recordings in the Rerun viewer, several side by side under one timeline."""
    import shutil
    import subprocess
    import tempfile

    _require_rerun()
    from fbgraph.side_by_side import compare, recording_of

    with tempfile.TemporaryDirectory(prefix="fbgraph-") as folder:
        shown = recording_of(runs[0])
        if len(runs) > 1:
            shown = Path(folder) / "comparison.rrd"
            compare(runs, shown)
        if save is not None:
            try:
                shutil.copyfile(shown, save)
            except OSError as error:
                raise ConfigError(f"--save {save}: cannot write there: {error.strerror or error}") from error
            print(f"written to {save}")
            return
        command = [sys.executable, "-m", "rerun", str(shown), *(["--web-viewer"] if web else [])]
        if code := subprocess.run(command).returncode:
            raise ConfigError(f"the Rerun viewer ended with code {code}; without a screen, --web or --save FILE may do")


@app.command()
def record(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.", show_default=False)],
    log: Annotated[Path | None, typer.Option(metavar="LOG", help="Where its log is now, if it has moved.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.rrd", help="RUN/recording.rrd if absent.")] = None,
) -> None:
    """Write the recording of a run again."""
    _require_rerun()
    from fbgraph import reruns

    try:
        print(f"written to {reruns.record(run, out, log)}")
    except OSError as error:
        raise ConfigError(f"{out or run}: cannot write there: {error.strerror or error}") from error


def _require_rerun() -> None:
    from importlib.util import find_spec

    if find_spec("rerun") is None:
        raise ConfigError("rerun-sdk is not installed; `pip install rerun-sdk` brings recordings and the viewer")


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
def guide(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.", show_default=False)],
    pace_m: Annotated[
        float | None,
        typer.Option("--pace-m", metavar="METRES", help="Length of your step; the median of the walk if absent."),
    ] = None,
    units: Annotated[str, typer.Option(metavar="metric|steps", help="What comes first.")] = "metric",
    format_: Annotated[str, typer.Option("--format", metavar="text|json|geojson|gpx|csv", help="To print.")] = "text",
    estimator: Annotated[
        str, typer.Option(metavar="smoothed|online|ekf|pdr", help="Whose trajectory to follow.")
    ] = "smoothed",
    origin: Annotated[
        str | None,
        typer.Option(metavar="LAT,LON", help="Where the walk began, for maps; the run's own georeference if absent."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Write there, not to stdout.")] = None,
) -> None:
    """Directions back along the breadcrumbs, from the end of a walk to its start."""
    from fbgraph.exports import read_summary
    from fbgraph.georeference import parse_origin
    from fbgraph.runs import read_georeference, read_way
    from fbgraph.way_maps import format_way

    if units not in ("metric", "steps"):
        raise ConfigError(f"unknown units {units!r}: expected metric or steps")
    given = None if origin is None else parse_origin(origin)
    there = read_way(run, estimator, pace_m)
    if given is None:
        where = read_georeference(read_summary(run), str(run))
    else:
        x_m, y_m, _ = there.points_m[0]
        where = given.moved(-x_m, -y_m)
    text = format_way(there.reversed(), format_, "steps" if units == "steps" else "metric", where)
    if out is None:
        print(text, end="")
        return
    try:
        out.write_text(text, "utf-8")
    except OSError as error:
        raise ConfigError(f"--out {out}: cannot write there: {error.strerror}") from error


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
def study(
    dataset: Annotated[
        str,
        typer.Argument(
            metavar="DATASET|simulated",
            help="A CSV a trial, a folder or a zip of them; or simulated.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Study folder; studies/<name> if absent.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of simulated trials; 1 if absent.", show_default=False)] = None,
    trials: Annotated[int | None, typer.Option(min=1, help="The first so many trials; all, or 36.")] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The columns' names: [dataset.columns], as in configs/forestback.toml."),
    ] = None,
    config: ConfigOption = None,
    set_: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Reproduce the ForestBack paper's evaluation, and ours beside it: tables, figures, report."""
    import shlex

    from fbgraph.config import load_config, load_mapping, parse_config
    from fbgraph.study.run import SIMULATED, study_files

    simulated = dataset == SIMULATED
    if seed is not None and not simulated:
        raise ConfigError("--seed is for simulated trials; a data set has none")
    effective = load_config(config or "forestback", set_ or ())
    if effective.dataset.columns == parse_config({}, "").dataset.columns:  # a configuration that says nothing of them
        columns = load_config("forestback").dataset.columns
        effective = effective.model_copy(update={"dataset": effective.dataset.model_copy(update={"columns": columns})})
    if mapping is not None:
        effective = effective.model_copy(update={"dataset": load_mapping(mapping, effective.dataset)})
    seed = 1 if seed is None else seed
    folder = out or Path("studies") / (f"simulated-{seed}" if simulated else Path(dataset).name.partition(".")[0])
    with _study_progress() as progress:
        result = study_files(dataset, folder, effective, seed, trials, shlex.join(["fbgraph", *sys.argv[1:]]), progress)
    from fbgraph.study.report import headline, summary, table  # heavy, and by now imported

    if as_json:
        print(json.dumps({"out": str(folder), **summary(result)}, indent=2))
        return
    print(headline(result))
    head, *rows = table(result)
    _print_table(head, rows)
    for name, reason in result.skipped:
        print(f"not used: {name}: {reason}")
    for text in result.notices:
        print(f"note: {text}")
    print(f"written to {folder}")


@contextmanager
def _study_progress() -> Iterator[Callable[[str, float], None]]:
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


@app.command()
def config(config: ConfigOption = None, set_: SetOption = None, as_json: JsonOption = False) -> None:
    """Print the effective configuration as TOML."""
    from fbgraph.config import dump_toml, load_config

    effective = load_config(config, set_ or ())
    print(effective.model_dump_json(indent=2) if as_json else dump_toml(effective), end="\n" if as_json else "")


@contextmanager
def _progress() -> Iterator[Progress]:
    """A bar of stages on a terminal, nothing elsewhere."""
    stages = ("read", "steps", "pdr", "ekf", "smoother", "closures", "tables", "recording")
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
    if summary["return"] is not None:
        _print_return(summary["return"])
    for text in summary["warnings"]:
        print(f"note: {text}")


def _print_return(way_back: dict[str, Any]) -> None:
    turned, arrived_s = way_back["turn_back"], way_back["arrived_t_s"]
    text = f"turned back at {turned['t_s']:.1f} s (breadcrumb {turned['breadcrumb']}"
    text += f", known at {turned['known_t_s']:.1f} s)"
    if way_back["steps"]:
        text += f", {way_back['steps']} steps guided, {way_back['off_route_steps']} of them off the route, "
        text += f"{way_back['remaining_m']:.1f} m left" if arrived_s is None else f"arrived at {arrived_s:.1f} s"
    print(f"{text}; {way_back['closures']} closures")


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
        table.add_column(head, justify="left" if head in ("estimator", "scored", "Metric") else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    # a pipe has no width of its own: give it all the table needs
    Console(width=None if sys.stdout.isatty() else 160).print(table)


if __name__ == "__main__":
    main()
