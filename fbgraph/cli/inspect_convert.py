"""Commands that look at a log before it is smoothed: inspect, convert."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fbgraph.cli.app import (
    FormatOption,
    LayoutOption,
    LogArgument,
    MaxSizeOption,
    RateOption,
    app,
)
from fbgraph.cli.printing import say


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
