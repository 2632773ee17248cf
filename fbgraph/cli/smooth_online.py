"""Commands that reconstruct a walk: smooth, online."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fbgraph.cli.app import (
    AnchorsOption,
    BuildingAxisOption,
    BuildingOption,
    ClosedLoopOption,
    ConfigOption,
    ForceOption,
    FormatOption,
    JsonOption,
    LayoutOption,
    LogArgument,
    MaxSizeOption,
    NoRecordingOption,
    OriginOption,
    OutAndBackOption,
    RateOption,
    ReturnAtOption,
    SetOption,
    TruthOption,
    UseGnssOption,
    app,
    parse_speed,
    require_rerun,
    stop_on_signals,
)
from fbgraph.cli.printing import print_summary, progress_bar, say, say_json
from fbgraph.core.errors import ConfigError, EstimationError

if TYPE_CHECKING:
    from fbgraph.core.config import Config
    from fbgraph.recording.live_view import LiveView


@app.command(
    epilog="Examples: `fbgraph smooth walk.csv`, `fbgraph smooth phyphox.zip --truth Location.csv --out runs/park`"
)
def smooth(
    log: LogArgument,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Run folder; runs/<log name> if absent.")
    ] = None,
    config: ConfigOption = None,
    set_: SetOption = None,
    format_: FormatOption = None,
    layout: LayoutOption = None,
    rate: RateOption = None,
    truth: TruthOption = None,
    anchors: AnchorsOption = None,
    use_gnss: UseGnssOption = "none",
    closed_loop: ClosedLoopOption = False,
    building: BuildingOption = None,
    building_axis: BuildingAxisOption = None,
    origin: OriginOption = None,
    out_and_back: OutAndBackOption = True,
    max_size: MaxSizeOption = None,
    no_recording: NoRecordingOption = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Reconstruct a walk: PDR, EKF and factor-graph smoother on the same steps."""
    from fbgraph.core.bounded import parse_size
    from fbgraph.core.georeference import parse_origin
    from fbgraph.pipeline import read_walk, reconstruct, write_run
    from fbgraph.run.folder import claimed_run
    from fbgraph.run.inputs import RunInputs

    set_ = [*(set_ or ()), *(() if out_and_back else ["returning.out_and_back=false"])]
    where = None if origin is None else parse_origin(origin)
    most = None if max_size is None else parse_size(max_size)
    known = building, building_axis
    inputs = RunInputs.of(log, format_, truth, anchors, closed_loop, where, most, force, use_gnss, layout, rate, *known)
    with progress_bar() as progress:
        progress("read")
        walk, effective, told = read_walk(inputs, config, set_)
        folder = out or Path("runs") / walk.name
        with claimed_run(folder, (inputs, effective), force) as claim:
            result = reconstruct(walk, effective, told, inputs, progress)
            summary = write_run(result, claim, recording=not no_recording, progress=progress)
    _show(summary, folder, as_json, indent=2)


@app.command(
    epilog="Examples: `fbgraph online walk.csv --follow`, `fbgraph online --source udp://:5555 --out runs/today --view`"
)
def online(
    log: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="A log to replay; none with --source.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Run folder.")] = None,
    source: Annotated[
        str | None,
        typer.Option(metavar="SOURCE", help="Live: stdin, serial:PORT[@BAUD], udp://, tcp:// or http://[HOST]:PORT."),
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Go on with an interrupted live walk (with --source).")
    ] = None,
    finish: Annotated[
        Path | None, typer.Option(metavar="DIR", help="End an interrupted live walk, without its device.")
    ] = None,
    tell: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="Tell the way back in short lines: device (that sends), serial:PORT, udp:// or tcp://HOST:PORT.",
        ),
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
    layout: LayoutOption = None,
    rate: RateOption = None,
    truth: TruthOption = None,
    anchors: AnchorsOption = None,
    use_gnss: UseGnssOption = "none",
    closed_loop: ClosedLoopOption = False,
    building: BuildingOption = None,
    building_axis: BuildingAxisOption = None,
    origin: OriginOption = None,
    return_at: ReturnAtOption = None,
    max_size: MaxSizeOption = None,
    no_recording: NoRecordingOption = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """The trajectory while walking: replay a log, or follow a live device. Ctrl-C ends the walk, not the data."""
    from fbgraph import session
    from fbgraph.cli.live_walk import LiveOptions, record_live, require_live, update_printer
    from fbgraph.core.bounded import parse_size
    from fbgraph.core.config import load_config
    from fbgraph.core.georeference import parse_origin
    from fbgraph.pipeline import read_walk, write_run
    from fbgraph.run.folder import claimed_run
    from fbgraph.run.inputs import RunInputs

    folder = _online_folder(log, source, out, resume, finish)
    if (resume or finish) is not None and (config is not None or set_):
        raise ConfigError("--resume goes on with the walk's own configuration: leave out --config and --set")
    if log is None:
        _require_live(anchors, use_gnss, layout, rate)
    require_live(tell, source)
    set_ = [*(set_ or ()), *([f"returning.at={json.dumps(return_at)}"] if return_at is not None else ())]
    load_config(config, set_)  # a wrong option is told before the walk begins
    where = None if origin is None else parse_origin(origin)
    most = None if max_size is None else parse_size(max_size)
    known = building, building_axis
    inputs = RunInputs.of(log, format_, truth, anchors, closed_loop, where, most, force, use_gnss, layout, rate, *known)
    show, pace = update_printer(follow, as_json), parse_speed(speed)
    stopping = stop_on_signals(live=log is None)
    if log is None:
        option = "--resume" if finish is None else "--finish"
        live = LiveOptions(source, (resume or finish) is not None, tell, return_at, option)
        summary = record_live(
            live,
            folder,
            inputs,
            lambda: load_config(config or ("phone" if source and source.startswith("http") else "m5stickc"), set_),
            lambda effective: _live_view(effective, view, connect),
            show,
            stopping,
            not no_recording,
            force,
        )
    else:
        walk, effective, told = read_walk(inputs, config, set_)
        with claimed_run(folder, (inputs, effective), force) as claim:
            result = session.replay_log(
                walk,
                effective,
                told,
                chunk_s=chunk,
                speed=pace,
                on_update=show,
                stop=stopping,
                recording=not no_recording,
                view=_live_view(effective, view, connect),
                inputs=inputs,
            )
            summary = write_run(result, claim, recording=not no_recording)
    _show(summary, folder, as_json)


def _show(summary: dict[str, Any], folder: Path, as_json: bool, indent: int | None = None) -> None:
    """Print what a run found.

    Raises:
        EstimationError: an estimator failed; told last, when what the others found is written.
    """
    if as_json:
        say_json({"out": str(folder), **summary}, indent)
    else:
        print_summary(summary)
        say(f"written to {folder}")
    for name, why in summary["failed"].items():
        anyway = "; --force writes it all the same" if why.startswith("withheld") else ""
        raise EstimationError(f"no {name} trajectory: {why}; what the other estimators found is in {folder}{anyway}")


def _require_live(anchors: Path | None, use_gnss: str, layout: Path | None, rate_hz: float | None) -> None:
    """Refuse what only a log can have.

    Raises:
        ConfigError: it was asked for.
    """
    if anchors is not None:
        raise ConfigError("--anchors needs a LOG: a live device's clock is not known beforehand")
    if use_gnss != "none":
        raise ConfigError("--use-gnss needs a LOG, with the fixes in it or beside it")
    if layout is not None or rate_hz is not None:
        raise ConfigError("--layout and --rate need a LOG: a device's lines are read by what they name and show")


def _online_folder(
    log: Path | None, source: str | None, out: Path | None, resume: Path | None, finish: Path | None
) -> Path:
    """Where the walk is kept.

    Raises:
        ConfigError: these options do not go together.
    """
    if finish is not None:
        if (log, source, resume) != (None, None, None) or out not in (None, finish):
            raise ConfigError("--finish DIR ends the walk that is kept there: leave out LOG, --source, --resume, --out")
        return finish
    if (log is None) == (source is None):
        raise ConfigError("name either a LOG to replay or a --source to follow")
    if resume is not None and source is None:
        raise ConfigError("--resume goes on with a live walk: name its --source")
    if resume is not None and out is not None and out != resume:
        raise ConfigError("--resume DIR is where the walk is kept: leave out --out")
    if folder := resume or out:
        return folder
    from fbgraph.readers.cleaning import log_name

    if log is None:
        raise ConfigError("--out DIR says where the walk is kept")
    return Path("runs") / log_name(log)


def _live_view(config: Config, view: bool, url: str | None) -> LiveView | None:
    if not view and url is None:
        return None
    require_rerun()
    from fbgraph.recording.live_view import LiveView

    return LiveView(config, url)
