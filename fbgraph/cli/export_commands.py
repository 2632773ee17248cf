"""Commands that give a run to other tools: export."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fbgraph.cli.app import app
from fbgraph.cli.printing import complain, say, say_document
from fbgraph.core.errors import ConfigError


@app.command(
    epilog="Examples: `fbgraph export run --to gpx --origin 49.4613,11.1110 --out walk.gpx`, "
    "`fbgraph export run --to mcap --out walk.mcap`, `fbgraph export run --to csv --estimator ekf > walk.csv`"
)
def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.", show_default=False)],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="tum, csv, gpx, geojson, kml, g2o, mcap, euroc or parquet.",
            show_default=False,
        ),
    ],
    estimator: Annotated[str, typer.Option(metavar="smoothed|online|ekf|pdr", help="Whose trajectory.")] = "smoothed",
    origin: Annotated[
        str | None,
        typer.Option(metavar="LAT,LON", help="Where the walk began, for maps; the run's own georeference if absent."),
    ] = None,
    start_height_m: Annotated[
        float | None,
        typer.Option(
            "--start-height-m", metavar="METRES", help="How high above sea level it began, for gpx, kml, mcap."
        ),
    ] = None,
    at: Annotated[
        str,
        typer.Option(
            metavar="steps|truth", help="Of tum: a pose a step, or one where truth.tum has a place, as scored."
        ),
    ] = "steps",
    log: Annotated[Path | None, typer.Option(metavar="LOG", help="Where its log is now, if it has moved.")] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="Write there; else text goes to stdout, binary to RUN's name here."),
    ] = None,
) -> None:
    """The walk in another tool's format: maps, trajectory tools, pose graphs, viewers, tables."""
    import math
    from dataclasses import replace
    from io import BytesIO

    from fbgraph.core.georeference import parse_origin
    from fbgraph.core.whole_writes import whole_file
    from fbgraph.exports import exporter
    from fbgraph.exports.exported_walk import exported_walk
    from fbgraph.run.folder import require_free
    from fbgraph.run.read_run import read_run

    format_ = exporter(to)
    if at not in ("steps", "truth") or (at == "truth" and to != "tum"):
        raise ConfigError(f"--at {at}: expected steps, or, with --to tum, truth")
    if start_height_m is not None and not math.isfinite(start_height_m):
        raise ConfigError(f"--start-height-m {start_height_m}: not a number of metres")
    start = None if origin is None else parse_origin(origin)
    if out is None and format_.BINARY:
        out = _beside(run, format_.SUFFIX)
    if out is not None:
        require_free(out, "--out")
    walk = exported_walk(read_run(run), estimator, to, start, start_height_m, format_.ON_EARTH)
    walk = replace(walk, log_path=log, at_truth=at == "truth")
    for text in walk.caution:
        complain(text)
    if format_.ON_EARTH and walk.placed is not None and walk.placed.note:
        complain(walk.placed.note)
    if out is None:
        document = BytesIO()
        notes = format_.write(walk, document)
        say_document(document.getvalue().decode(), for_reading=False)
    else:
        with whole_file(out) as partial, open(partial, "wb") as file:
            notes = format_.write(walk, file)
    for note in notes:
        complain(note)
    if out is not None:
        say(f"written to {out}")


def _beside(run: Path, suffix: str) -> Path:
    """A file of the run's name in the current folder, which must not be there yet.

    Raises:
        ConfigError: it is, or the current folder is the run's.
    """
    place = run.resolve()
    out = Path(f"{place.name}{suffix}")
    if Path.cwd() == place or out.exists():
        raise ConfigError(
            f"{out} {'is there already' if out.exists() else 'would be among the run’s'}; name --out FILE"
        )
    return out
