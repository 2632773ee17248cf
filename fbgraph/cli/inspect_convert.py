"""Commands that look at a log before it is smoothed: inspect, convert."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fbgraph.cli.app import (
    FormatOption,
    JsonOption,
    LayoutOption,
    LogArgument,
    MaxSizeOption,
    RateOption,
    app,
)
from fbgraph.cli.inspect_text import report_lines
from fbgraph.cli.printing import say, say_json
from fbgraph.core.errors import DataError
from fbgraph.core.whole_writes import whole_file


@app.command(
    epilog="Examples: `fbgraph inspect phyphox.zip`, `fbgraph inspect walk.csv --plot walk.png`, "
    "`fbgraph inspect table.csv --write-layout table.toml`, then `fbgraph smooth table.csv --layout table.toml`"
)
def inspect(
    log: LogArgument,
    as_json: JsonOption = False,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE.png", help="Draw the sensors, still phases, gaps and steps.")
    ] = None,
    write_layout: Annotated[
        Path | None,
        typer.Option("--write-layout", metavar="FILE.toml", help="Write how it is read, to be changed for --layout."),
    ] = None,
    format_: FormatOption = None,
    layout: LayoutOption = None,
    rate: RateOption = None,
    max_size: MaxSizeOption = None,
) -> None:
    """How a log is read and why, what its sensors show, and what smooth would say of it."""
    from fbgraph.core.bounded import parse_size
    from fbgraph.inspection.inspect_log import inspect_log
    from fbgraph.readers.layout import layout_toml
    from fbgraph.run.folder import require_free
    from fbgraph.run.inputs import RunInputs

    for option, path in (("--plot", plot), ("--write-layout", write_layout)):
        if path is not None:
            require_free(path, option)
    most = None if max_size is None else parse_size(max_size)
    found = inspect_log(RunInputs.of(log, format_, max_size=most, layout=layout, rate_hz=rate))
    if as_json:
        say_json(found.report)
    else:
        for line in report_lines(found.report):
            say(line)
    if plot is not None:
        from fbgraph.plots.sensor_figure import write_sensor_figure

        with whole_file(plot) as partial:
            write_sensor_figure(found.streams, found.still, found.gaps, found.steps_s, found.name, partial)
    if write_layout is not None:
        if found.layout is None:
            raise DataError(f"{log}: no layout to write: {found.report['smooth']['reasons'][0]}")
        with whole_file(write_layout) as partial:
            partial.write_text(layout_toml(found.layout), "utf-8")
    for path in (plot, write_layout):
        if path is not None and not as_json:
            say(f"written to {path}")


@app.command(epilog="Example: `fbgraph convert phyphox.zip walk.csv`, then `fbgraph smooth walk.csv`")
def convert(
    log: LogArgument,
    out: Annotated[Path, typer.Argument(metavar="OUT.csv", help="The file to write.", show_default=False)],
    format_: FormatOption = None,
    layout: LayoutOption = None,
    rate: RateOption = None,
    max_size: MaxSizeOption = None,
    force: Annotated[bool, typer.Option("--force", help="Replace OUT.csv if it is there.")] = False,
) -> None:
    """Write any log as an M5StickC CSV, nothing resampled; smoothing either gives the same walk.

    The log's truth, if it carries any, is written beside it as OUT_truth.csv.
    """
    from fbgraph.core.bounded import parse_size
    from fbgraph.readers import preset_of, read_log
    from fbgraph.readers.canonical_csv import convert_log
    from fbgraph.run.folder import require_free

    require_free(out, "OUT.csv")
    most = None if max_size is None else parse_size(max_size)
    file = read_log(log, format_, most, layout=layout, rate_hz=rate)
    for notice in file.log.notices:
        say(f"note: {notice}")
    for path in convert_log(file.log, file.truth, preset_of(file), out, force):
        say(f"written to {path}")
    if file.gnss is not None and file.truth is None:
        say(f"note: GNSS fixes are not converted; name the log itself for them: --truth {log}")
