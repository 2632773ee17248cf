"""Commands for many logs: batch, report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fbgraph.cli.app import (
    BuildingAxisOption,
    BuildingOption,
    ClosedLoopOption,
    ConfigOption,
    FormatOption,
    JsonOption,
    LayoutOption,
    MaxSizeOption,
    NoRecordingOption,
    OriginOption,
    OutAndBackOption,
    RateOption,
    SetOption,
    UseGnssOption,
    WorkersOption,
    app,
    require_not_stopped,
)
from fbgraph.cli.printing import batch_progress_bar, complain, print_table, say, say_json
from fbgraph.core.errors import DataError
from fbgraph.core.safe_text import short_name

if TYPE_CHECKING:
    from fbgraph.batches.run_batch import Batch, Progress


@app.command(epilog="Examples: `fbgraph batch walks/ --out b`, `fbgraph batch 'site*/*.gz' more.csv --out b --resume`")
def batch(
    out: Annotated[
        str,
        typer.Option("--out", metavar="DIR", help="Folder of the batch, or s3://… and the like.", show_default=False),
    ],
    logs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="LOGS…",
            help="Files, quoted globs, folders, zips, addresses such as s3://…, or a manifest: CSV with the columns "
            "log[,name][,truth][,anchors][,config]. NAME_truth.csv beside NAME.csv is its truth.",
            show_default=False,
        ),
    ] = None,
    workers: WorkersOption = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="tcp://HOST:PORT", help="Work on the Dask cluster of this scheduler instead."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on: runs that are done and whole stay as they are.")
    ] = False,
    timeout_s: Annotated[
        float, typer.Option("--timeout", metavar="SECONDS", min=0.1, help="Stop a log that takes longer.")
    ] = 3600.0,
    memory: Annotated[
        str | None,
        typer.Option(metavar="SIZE", help="Stop a log that takes more: 2G; its share of the machine's if absent."),
    ] = None,
    retries: Annotated[
        int, typer.Option(metavar="N", min=0, help="Try again what died or met a failing disk or network.")
    ] = 1,
    config: ConfigOption = None,
    set_: SetOption = None,
    format_: FormatOption = None,
    layout: LayoutOption = None,
    rate: RateOption = None,
    use_gnss: UseGnssOption = "none",
    closed_loop: ClosedLoopOption = False,
    building: BuildingOption = None,
    building_axis: BuildingAxisOption = None,
    origin: OriginOption = None,
    out_and_back: OutAndBackOption = True,
    max_size: MaxSizeOption = None,
    no_recording: NoRecordingOption = False,
    force: Annotated[bool, typer.Option("--force", help="Write smoothed walks that are withheld too.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Smooth many logs: DIR/runs with a run folder each, DIR/index.csv and .parquet with a row each.

    A log that fails, hangs or eats memory is stopped, named in the index with its reason, and stops no other; the
    command then ends with code 3. The same bits come from one worker, from many, and from a cluster.
    """
    from fbgraph.batches.log_entry import BatchOptions
    from fbgraph.batches.run_batch import HowToRun, run_batch
    from fbgraph.core.bounded import parse_size
    from fbgraph.core.georeference import parse_origin

    where = None if origin is None else parse_origin(origin)
    most = None if max_size is None else parse_size(max_size)
    options = BatchOptions(
        config=config,
        overrides=(*(set_ or ()), *(() if out_and_back else ("returning.out_and_back=false",))),
        format=format_,
        use_gnss=use_gnss,
        closed_walk=closed_loop,
        origin=None if where is None else (where.lat_deg, where.lon_deg),
        max_size=most,
        forced=force,
        layout=None if layout is None else str(layout),
        rate_hz=rate,
        building=None if building is None else str(building),
        building_axis=building_axis,
        recording=not no_recording,
    )
    most_memory = None if memory is None else parse_size(memory, "--memory")
    how = HowToRun(workers, scheduler, timeout_s, most_memory, retries, resume)
    with batch_progress_bar() as progress:
        try:

            def told(so_far: Progress) -> None:
                require_not_stopped()
                progress(so_far)

            result = run_batch(logs or (), out, options, how, complain, told)
        except SystemExit:
            complain(f"--resume goes on with the batch in {out}")
            raise
    _show_batch(result, as_json)


def _show_batch(result: Batch, as_json: bool) -> None:
    """Print what became of the logs.

    Raises:
        DataError: some failed; told last.
    """
    from fbgraph.batches.statistics import SHARES, failures_of, known, quantile_of, verdict_counts

    frame, end = result.index, result.progress
    verdicts, failures = verdict_counts(frame), failures_of(frame)
    if as_json:
        columns = ["name", "log", "cause", "reason"]
        failed = frame[frame["status"] == "failed"][columns].to_dict("records")
        counts: dict[str, Any] = {"logs": end.total, "done": end.done, "failed": end.failed, "kept": end.kept}
        say_json(
            {"out": result.out, **counts, "seconds": round(end.seconds, 3), "verdicts": verdicts, "failures": failed}
        )
    else:
        told = ", ".join(f"{count:,} {verdict}" for verdict, count in verdicts.items() if count)
        kept = f"; {end.kept:,} were done before" if end.kept else ""
        rate = f", {end.rate_hz:.2g} a second" if end.over > end.kept else ""
        say(f"{end.total:,} logs: {end.done:,} done ({told or 'none'}), {end.failed:,} failed{kept}")
        say(f"{duration_text(end.seconds)}{rate}")
        if len(rmse_m := known(frame["smoothed_rmse_m"])):
            half, most = (quantile_of(rmse_m, share) for share in SHARES)
            say(
                f"{len(rmse_m):,} scored: RMSE median {half.text()} m, 95 % below {most.value:.2f} m, "
                f"worst {rmse_m.max():.2f} m"
            )
        if len(places := known(frame["ellipses"])):
            share = 100.0 * known(frame["inside_95"]).sum() / places.sum()
            say(f"{share:.0f} % of {places.sum():,.0f} known places in the 95 % ellipses")
        for one in failures:
            first = "" if one.logs == 1 else "first "
            say(f"failed, {one.cause}: {one.logs:,}; {first}{short_name(one.name)}: {one.reason}")
        say(f"written to {result.out}; `fbgraph report {result.out}` draws it")
    if end.failed:
        raise DataError(
            f"{end.failed:,} of {end.total:,} logs failed; {Path('index.csv')} there names each with its reason"
        )


def duration_text(seconds: float) -> str:
    """``2 h 05 min``, ``5 min 03 s``, ``12.3 s``."""
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


@app.command(epilog="Examples: `fbgraph report runs/all`, `fbgraph report before after --out changed.html`")
def report(
    batches: Annotated[
        list[str],
        typer.Argument(metavar="DIR [DIR2]", help="A batch; or two, before and after a change.", show_default=False),
    ],
    out: Annotated[
        str | None,
        typer.Option(metavar="FILE.html", help="report.html (of two: compared.html) in the last DIR if absent."),
    ] = None,
    pictures: Annotated[int, typer.Option(metavar="N", min=0, help="Draw so many of the worst.")] = 10,
    as_json: JsonOption = False,
) -> None:
    """Errors, coverage, verdicts and failures of a batch: a page and tables; of two, what changed between them."""
    from fbgraph.batches import report_tables as tables
    from fbgraph.batches.places import joined
    from fbgraph.batches.report import read_report, write_report
    from fbgraph.plots.walk_figure import run_png

    found = read_report(batches)
    place = out or joined(found.places[-1], "report.html" if found.changes is None else "compared.html")
    write_report(found, place, run_png, pictures)
    frame = found.index
    shown = {
        "errors": tables.error_rows(frame),
        "verdicts": tables.verdict_rows(frame),
        "failures": tables.failure_rows(frame),
        "worst": tables.worst_rows(frame),
    }
    if found.changes is not None:
        shown = {"paired": tables.paired_rows(found.changes), "changed": tables.changed_rows(found.changes), **shown}
    if as_json:
        as_records = {name: [dict(zip(rows[0], row, strict=True)) for row in rows[1:]] for name, rows in shown.items()}
        say_json({"out": place, "batches": list(found.places), **as_records})
        return
    for one, index in zip(found.places, found.indices, strict=True):
        say(f"{one}: {tables.headline(index)}")
    if found.changes is not None:
        say(tables.changed_text(found.changes))
    for name, (head, *rows) in shown.items():
        if rows and name != "failures":
            print_table(head, rows)
        for cause, count, first in rows if name == "failures" else ():
            say(f"failed, {cause}: {count}; {'' if count == '1' else 'first '}{first}")
    if told := tables.coverage_text(frame):
        say(told)
    say(f"written to {place}")
