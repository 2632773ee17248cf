"""The command that makes a device of a log: play."""

from __future__ import annotations

from typing import Annotated

import typer

from fbgraph.cli.app import (
    FormatOption,
    LayoutOption,
    LogArgument,
    MaxSizeOption,
    RateOption,
    app,
    parse_speed,
    stop_on_signals,
)
from fbgraph.cli.printing import complain, say


@app.command(
    epilog="Examples: `fbgraph play walk.csv --to tcp://:5555` and, beside it, `fbgraph online --source tcp://:5555 "
    "--out runs/live`; `fbgraph play walk.csv --to pty --number --lose 0.1`"
)
def play(
    log: LogArgument,
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="LINK",
            help="pty (a serial port that it makes), serial:PORT[@BAUD], udp://, tcp:// or http://[HOST]:PORT.",
            show_default=False,
        ),
    ],
    speed: Annotated[str, typer.Option(metavar="real|max|FACTOR", help="How fast.")] = "real",
    lose: Annotated[float, typer.Option(metavar="SHARE", help="Lose so many of the rows. Example: --lose 0.1")] = 0.0,
    reorder: Annotated[float, typer.Option(metavar="SHARE", help="Send so many of the rows late.")] = 0.0,
    restart_at: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Restart the device then: its clock begins at 0 again.")
    ] = None,
    number: Annotated[
        bool, typer.Option("--number", help="Number the lines as the recorder does, so that what is lost comes again.")
    ] = False,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of what is lost and late.")] = 0,
    format_: FormatOption = None,
    layout: LayoutOption = None,
    rate: RateOption = None,
    max_size: MaxSizeOption = None,
) -> None:
    """Play a log as a device that `fbgraph online` follows, with faults on demand."""
    from fbgraph.core.bounded import parse_size
    from fbgraph.readers import preset_of, read_log
    from fbgraph.readers.canonical_csv import remark_of
    from fbgraph.readers.device_links import open_device
    from fbgraph.readers.played_log import faults_of
    from fbgraph.readers.played_log import play as played_to

    faults, pace = faults_of(to, lose, reorder, restart_at, number, seed), parse_speed(speed)
    file = read_log(log, format_, None if max_size is None else parse_size(max_size), layout=layout, rate_hz=rate)
    stopping = stop_on_signals()
    link = open_device(to, stopping, complain)
    complain(f"playing {file.log.span_s[1] / pace:.0f} s to {to}")
    preset = preset_of(file)
    if preset != "m5stickc" and not to.startswith("http"):
        complain(f"it is a {preset}'s: follow it with fbgraph online --config {preset}")
    remark = remark_of(file.log.format, preset) if preset != "m5stickc" else ""
    sent = played_to(file.log, link, faults, speed=pace, number=number, remark=remark, stop=stopping, tell=complain)
    what = "samples" if to.startswith("http") else "rows"
    again = f", {sent.again} sent again" if number else ""
    say(f"{sent.rows} {what} played, {sent.lost} lost, {sent.late} late{again}")
