"""What ``online`` does with a live device: says what it waits for, records, tells the way back, says how it stands."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fbgraph.cli.printing import complain, say, say_json, show_status
from fbgraph.core.errors import ConfigError

if TYPE_CHECKING:
    from fbgraph.core.config import Config
    from fbgraph.estimators.estimates import Update
    from fbgraph.live import Listener, Teller
    from fbgraph.run.inputs import RunInputs
    from fbgraph.session import WalkViewer

_WIDTH = 60
Show = Callable[["Update"], None]


@dataclass(frozen=True)
class LiveOptions:
    """What was asked of a live walk.

    Attributes:
        source: where its lines come from; None to finish a walk without its device.
        resume: whether it goes on with the walk in its folder.
        tell: where the way back is told; nowhere if None.
        return_at: overrules, of a walk that is gone on with, when the way back begins.
        option: by which the folder was named.
    """

    source: str | None
    resume: bool
    tell: str | None
    return_at: str | None
    option: str = "--resume"


def record_live(
    options: LiveOptions,
    folder: Path,
    inputs: RunInputs,
    configured: Callable[[], Config],
    view_of: Callable[[Config], WalkViewer | None],
    show: Show,
    stop: Callable[[], bool],
    recording: bool,
    force: bool,
) -> dict[str, Any]:
    """Record a live walk, and write its run when it ends; returns the summary.

    Args:
        options: what was asked.
        folder: the run folder.
        inputs: for the run.
        configured: the configuration of a walk that begins.
        view_of: who shows the walk.
        show: takes every step.
        stop: asked whether to end the walk.
        recording: whether to write a recording.
        force: let a finished run in the folder go.
    """
    from fbgraph import session
    from fbgraph.pipeline import read_told, write_run
    from fbgraph.run.folder import claimed_live

    with claimed_live(folder, options.resume, force, options.option) as claim:
        told = read_told(inputs)
        effective = session.resumed_config(claim.place, options.return_at) if options.resume else configured()
        effective = session.live_declination(effective, told)
        pieces, take = _connected(options, claim.place, show, stop)
        result = session.follow_source(
            pieces,
            claim.place,
            effective,
            told,
            on_update=take,
            tell=complain,
            resume=options.resume,
            recording=recording,
            view=view_of(effective),
            inputs=inputs,
        )
        show_status("")
        return write_run(result, claim, recording=recording)


def _connected(options: LiveOptions, place: Path, show: Show, stop: Callable[[], bool]) -> tuple[Iterator[bytes], Show]:
    """The bytes of the source, and who takes the steps."""
    if options.source is None:
        return iter(()), lambda update: None
    from fbgraph.live import Listener, open_teller
    from fbgraph.readers.numbered_lines import in_order
    from fbgraph.readers.sources import open_source
    from fbgraph.run.folder import RAW

    source = open_source(options.source, stop, complain)
    teller = None if options.tell is None else open_teller(options.tell, options.source, source, complain)
    complain(f"{source.where}; waiting for the first line")
    standing = _Standing(Listener(complain), teller, show)
    pieces = in_order(source, place / RAW, complain)
    return standing.listener.through(pieces, standing.between), standing.take


class _Standing:
    """How a live walk stands: shown in a line on a terminal, told to the device."""

    def __init__(self, listener: Listener, teller: Teller | None, show: Show) -> None:
        self.listener = listener
        self._teller = teller
        self._show = show
        self._last: Update | None = None

    def take(self, update: Update) -> None:
        """Take a step."""
        self._last = update
        if self._teller is not None:
            self._teller.update(update)
        self._show(update)

    def between(self) -> None:
        """What is to be done again and again, also in silence."""
        import time

        from fbgraph.live import status_text

        if self._teller is not None:
            self._teller.remind(time.monotonic())
        last = self._last
        steps, distance_m, caution = (0, 0.0, None) if last is None else (last.k, last.distance_m, last.caution)
        show_status(status_text(self.listener.heard, steps, distance_m, caution))


def require_live(tell: str | None, source: str | None) -> None:
    """Refuse what only a live device can have.

    Raises:
        ConfigError: it was asked for.
    """
    if tell is not None and source is None:
        raise ConfigError("--tell needs a live device: name its --source")


def update_printer(follow: bool, as_json: bool) -> Show:
    """Prints each step, as JSON or for reading, or not at all."""
    told: list[str] = []

    def doubted(update: Update) -> str:
        """That the position is doubtful; why, when that is new."""
        if not update.caution:
            return ""
        if told[-1:] == [update.caution]:
            return "position doubtful"
        told.append(str(update.caution))
        return f"position doubtful: {update.caution}"

    def show(update: Update) -> None:
        if as_json:
            fields = {key: value for key, value in asdict(update).items() if value is not None}
            say_json(fields, indent=None)
        elif follow:
            for line in step_lines(update, doubted(update)):
                say(line)

    return show


def step_lines(update: Update, doubted: str = "") -> list[str]:
    """A step in lines of 60 columns: on the way back what to do and what is left first, then where it was.

    Args:
        update: the step.
        doubted: that its position is doubtful; nothing if it is not, or is said in the instruction.
    """
    from fbgraph.core.geometry import heading_deg

    where = (
        f"{update.t_s:7.1f} s {update.k:5d}  x {update.x_m:7.1f} y {update.y_m:7.1f} z {update.z_m:5.1f}  "
        f"{heading_deg(update.yaw_rad):3.0f}° {update.distance_m:6.0f} m"
    )
    if update.returning is not None and update.returning.instruction:
        first = f"{update.returning.instruction}, {update.returning.remaining_m:.0f} m left"
        return textwrap.wrap(f"{first}  [step {update.k}, {update.t_s:.0f} s]", _WIDTH, subsequent_indent="  ")
    return [where, *textwrap.wrap(doubted, _WIDTH, initial_indent="  ", subsequent_indent="  ")]
