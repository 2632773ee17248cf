"""The application, the options that commands share, and how it ends."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from fbgraph import __version__
from fbgraph.cli.printing import close_stdout, complain, output_lost, say
from fbgraph.core.errors import ConfigError, FbgraphError
from fbgraph.core.safe_text import for_terminal


@contextmanager
def _typed_shown() -> Iterator[None]:
    """Usage errors quote what was typed, names of files among it: shown, never interpreted."""
    try:
        yield
    except Exception as error:
        if isinstance(message := vars(error).get("message"), str):
            vars(error)["message"] = for_terminal(message)
        raise


_FIRST = (
    *("smooth", "online", "batch", "report", "inspect", "guide", "view", "plot"),
    *("evaluate", "export", "convert", "play", "calibrate"),
)
"""Commands that lead the help, in the order of a walk's life."""


class _Commands(TyperGroup):
    """All commands."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Their names, what most people want first."""
        names = super().list_commands(ctx)
        return [name for name in _FIRST if name in names] + [name for name in names if name not in _FIRST]

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Parse the options before the command."""
        with _typed_shown():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Parse the command's own and run it."""
        with _typed_shown():
            return super().invoke(ctx)


STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a command."""

app = typer.Typer(
    cls=_Commands,
    help="Where somebody walked, from IMU, magnetometer and barometer alone.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

LogArgument = Annotated[
    Path, typer.Argument(metavar="LOG", help="A walk's log: a file, .gz or not, a folder or a zip.", show_default=False)
]
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
LayoutOption = Annotated[
    Path | None,
    typer.Option(
        "--layout",
        metavar="FILE.toml",
        help="What the columns are, where names and physics do not tell; `fbgraph inspect --write-layout` writes one. "
        "Example: --layout walk.toml",
    ),
]
RateOption = Annotated[
    float | None,
    typer.Option("--rate", metavar="HZ", help="Samples a second, for a log without a clock. Example: --rate 50"),
]
TruthOption = Annotated[
    Path | None,
    typer.Option(
        "--truth",
        metavar="FILE",
        help="Known places, for scoring only: CSV t_s,x_m,y_m[,z_m][,floor][,sigma_m], a phone's Location.csv, GPX, "
        "TUM, or a log that carries them. Example: --truth Location.csv",
    ),
]
AnchorsOption = Annotated[
    Path | None,
    typer.Option(
        "--anchors",
        metavar="FILE",
        help="Known places for the smoother, in the forms of --truth. Example: --anchors track.gpx",
    ),
]
UseGnssOption = Annotated[
    str,
    typer.Option(
        "--use-gnss",
        metavar="none|start|ends|all",
        help="Which GNSS fixes of the log, or of the Location.csv beside it, are anchors; with none they only score. "
        "Example: --use-gnss start",
    ),
]
ClosedLoopOption = Annotated[bool, typer.Option("--closed-loop", help="The walk ends where it began.")]
BuildingOption = Annotated[
    Path | None,
    typer.Option(
        "--building",
        metavar="FILE.toml",
        help="The building's axis and field, by `fbgraph learn-building`: the walk is laid along its corridors.",
    ),
]
BuildingAxisOption = Annotated[
    str | None,
    typer.Option(
        "--building-axis",
        metavar="DEG[,SIGMA]",
        help="The same by hand: heading of its corridors, clockwise from North, any of the four; known to 2° if no "
        "SIGMA is given. Refused where the walk's legs contradict it. Example: --building-axis 70,2",
    ),
]
OutAndBackOption = Annotated[
    bool,
    typer.Option("--out-and-back/--no-out-and-back", help="Look for a turn-back; tie the way back to the way out."),
]
OriginOption = Annotated[
    str | None, typer.Option("--origin", metavar="LAT,LON", help="Where on Earth the walk began, in degrees.")
]
ReturnAtOption = Annotated[
    str | None,
    typer.Option(
        "--return-at",
        metavar="SECONDS|auto|event[:NAME]",
        help="When the way back begins; directions from then on. Example: --return-at event:button",
    ),
]
MaxSizeOption = Annotated[
    str | None,
    typer.Option(
        "--max-size", metavar="SIZE", help="Read as much text, unpacked: 500M, 2G; 1G, and no bombs, if absent."
    ),
]
NoRecordingOption = Annotated[bool, typer.Option("--no-recording", help="Write no recording.rrd.")]
ForceOption = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Replace the run of another log or configuration, never a live walk; write a walk that is withheld.",
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option("--workers", metavar="N", min=0, help="Processes; one a core if absent, 0 for none but this."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


_FEW_LOGS = 3


def workers_for(logs: int, asked: int | None) -> int | None:
    """Processes for so many logs: as asked; else none but this for a few, which are done before others start."""
    return 0 if asked is None and logs <= _FEW_LOGS else asked


def require_rerun() -> None:
    """Refuse what only works with rerun.

    Raises:
        ConfigError: it is not installed.
    """
    from importlib.util import find_spec

    if find_spec("rerun") is None:
        raise ConfigError("rerun-sdk is not installed; `pip install rerun-sdk` brings recordings and the viewer")


def parse_speed(text: str) -> float:
    """How many times as fast as measured; infinity for ``max``.

    Raises:
        ConfigError: not such a text.
    """
    if text in ("real", "max"):
        return 1.0 if text == "real" else float("inf")
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not factor > 0:
        raise ConfigError(f"--speed {text}: expected real, max or a positive factor")
    return factor


def stop_on_signals(live: bool = False) -> Callable[[], bool]:
    """Whether a signal came that ends the walk; a second one ends the command at once.

    Args:
        live: whether a recording goes on when its terminal goes away.
    """
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in STOPPING}

    def note(number: int, _frame: object) -> None:
        came.append(number)
        for one, handler in before.items():
            signal.signal(one, handler)

    for number in STOPPING:
        signal.signal(number, note)
    if live:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    return lambda: bool(came)


def main() -> None:
    """Entry point: every error ends as one line on stderr and an exit code (2 usage, 3 data, 4 estimation, 1 else)."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # what an encoding cannot show is no reason to fail
    _came.clear()
    for number in STOPPING:
        signal.signal(number, _stop)
    try:
        app()
    except _StoppedError as end:  # all is cleaned up; a solver in its thread is not waited for, nor torn down
        with contextlib.suppress(OSError):
            sys.stdout.flush()
        os._exit(int(end.code or 0))
    except SystemExit as end:
        sys.exit(end.code or int(output_lost()))
    except FbgraphError as error:
        _fail(str(error), error.exit_code)
    except BrokenPipeError:
        close_stdout()
        sys.exit(0)
    except Exception as error:
        if os.environ.get("FBGRAPH_DEBUG"):
            raise
        _fail(f"unexpected {type(error).__name__}: {error} (set FBGRAPH_DEBUG=1 for the traceback)", 1)


_came: list[int] = []
"""Signals that were to end this command."""


class _StoppedError(SystemExit):
    """A signal ended the command."""


def _stop(number: int, _frame: object) -> None:
    """End, cleaning up on the way: a run that was being written vanishes, the one before it stays."""
    complain(f"stopped by {signal.Signals(number).name}; what was not finished was not written")
    _came.append(number)
    raise _StoppedError(128 + number)


def require_not_stopped() -> None:
    """End after all if a signal came while a library was loading, some of which let no exception pass.

    Raises:
        SystemExit: one came.
    """
    if _came:
        raise _StoppedError(128 + _came[-1])


def _fail(message: str, code: int) -> None:
    complain(message)
    sys.exit(code)


def _print_version(wanted: bool) -> None:
    if wanted:
        say(f"fbgraph {__version__}")
        raise typer.Exit()


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass
