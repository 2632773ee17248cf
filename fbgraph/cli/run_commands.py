"""Commands that look at a run: view, record, guide."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fbgraph.cli.app import app, require_rerun
from fbgraph.cli.printing import complain, say, say_document
from fbgraph.core.errors import ConfigError
from fbgraph.core.whole_writes import whole_file


@app.command(epilog="Examples: `fbgraph view runs/walk`, `fbgraph view runs/a runs/b --save both.rrd`")
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

    require_rerun()
    from fbgraph.recording.side_by_side import compare, recording_of, require_walk
    from fbgraph.recording.viewer import viewer_command
    from fbgraph.run.folder import require_free

    with tempfile.TemporaryDirectory(prefix="fbgraph-") as folder:
        shown = recording_of(runs[0])
        if save is not None:
            require_free(save, "--save")
        if len(runs) > 1:
            shown = Path(folder) / "comparison.rrd"
            compare(runs, shown)
        else:
            require_walk(shown)
        if save is not None:
            with whole_file(save) as partial:
                shutil.copyfile(shown, partial)
            say(f"written to {save}")
            return
        command = viewer_command(str(shown.resolve()), *(["--web-viewer"] if web else []))
        if code := subprocess.run(command).returncode:
            raise ConfigError(f"the Rerun viewer ended with code {code}; without a screen, --web or --save FILE may do")


@app.command(epilog="Example: `fbgraph record runs/walk --log moved/walk.csv`")
def record(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.", show_default=False)],
    log: Annotated[Path | None, typer.Option(metavar="LOG", help="Where its log is now, if it has moved.")] = None,
    out: Annotated[Path | None, typer.Option(metavar="FILE.rrd", help="RUN/recording.rrd if absent.")] = None,
) -> None:
    """Write the recording of a run again."""
    require_rerun()
    from fbgraph import reruns
    from fbgraph.run.folder import require_free

    if out is not None:
        require_free(out, "--out")
    say(f"written to {reruns.record_run(run, out, log)}")


@app.command(
    epilog="Examples: `fbgraph guide runs/walk`, `fbgraph guide runs/walk --shorten --format gpx --origin 49.46,11.11`"
)
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
    shorten: Annotated[
        bool, typer.Option("--shorten", help="Leave out loops and dead ends that the walk closed itself.")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="Write there, not to stdout.")] = None,
) -> None:
    """Directions back along the breadcrumbs, from the end of a walk to its start."""
    from fbgraph.core.earth_field import degrees_text
    from fbgraph.core.georeference import parse_origin
    from fbgraph.core.whole_writes import whole_file
    from fbgraph.run.folder import require_free
    from fbgraph.run.placement import placement
    from fbgraph.run.read_run import read_directions, read_run
    from fbgraph.way_back.gpx_geojson import format_directions

    if units not in ("metric", "steps"):
        raise ConfigError(f"unknown units {units!r}: expected metric or steps")
    given = None if origin is None else parse_origin(origin)
    saved = read_run(run)
    placed = placement(saved, estimator, given) if format_ in ("geojson", "gpx") else None
    there = read_directions(saved, estimator, pace_m, placed.turned_rad if placed else 0.0, shorten)
    if placed and placed.note:
        complain(placed.note)
    elif format_ == "text" and (north := (saved.summary.get("declination") or {}).get("deg")):
        complain(f"headings are from true North; a compass needle there points {degrees_text(north)} of it")
    text = format_directions(
        there.reversed(), format_, "steps" if units == "steps" else "metric", placed.origin if placed else None
    )
    if out is None:
        say_document(text, for_reading=format_ == "text")
        return
    require_free(out, "--out")
    with whole_file(out) as partial:
        partial.write_text(text, "utf-8")
