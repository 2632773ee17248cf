"""A walk in progress: feeds the online smoother, keeps every raw line, writes the run folder when it ends."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from fbgraph.core.aids import Aids, Told
from fbgraph.core.config import Config, dump_toml, load_config
from fbgraph.core.earth_field import with_declination
from fbgraph.core.errors import ConfigError, DataError, EstimationError
from fbgraph.core.sensor_log import Event, SensorLog
from fbgraph.core.tables import read_text
from fbgraph.core.trajectory import Breadcrumb, Trajectory
from fbgraph.core.verdict import Integrity
from fbgraph.core.whole_writes import whole_file
from fbgraph.estimators.baselines import baselines
from fbgraph.estimators.estimates import Belief, Update
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.front_end.detect_steps import detect_steps
from fbgraph.front_end.step_track import Step
from fbgraph.integrity.live_check import LiveCheck
from fbgraph.pipeline import compose, held_back, reconstruct, require_anchors_within, stand_in, with_places
from fbgraph.readers.cleaning import LogFile
from fbgraph.readers.layout import SAVED_LAYOUT, keep_layout
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.raw_recorder import LineCutter, RawRecorder, cut_torn_line, saved_lines, saved_log
from fbgraph.run.folder import RAW
from fbgraph.run.inputs import RunInputs
from fbgraph.run.metrics import checkpoint_errors
from fbgraph.run.summary import summarize, summary_markdown
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.guide import ReturnGuide
from fbgraph.way_back.records import Closure, ReturnUpdate

OnUpdate = Callable[[Update], None]
Tell = Callable[[str], None]
"""Called with a sentence for the user."""


class WalkViewer(Protocol):
    """Somebody who shows a walk while it goes on: ``recording.live_view.LiveView``."""

    def fed(
        self,
        piece: SensorLog,
        smoother: OnlineSmoother,
        beliefs: Sequence[Belief],
        returning: Sequence[ReturnUpdate] = (),
    ) -> None:
        """Note a piece of log that the smoother was just fed, what it came to believe, and what the wearer was told."""

    def finished(self, result: WalkResult, smoother: OnlineSmoother, summary_markdown: str) -> None:
        """Show the finished walk."""


_BELIEF_STEPS = 5  # as often as iSAM2 relinearises


def cut_log(
    log: SensorLog, chunk_s: float, speed: float, stop: Callable[[], bool]
) -> Iterator[tuple[SensorLog, float]]:
    """A log cut into pieces, each with its end, delivered ``speed`` times as fast as recorded (infinity: at once)."""
    began = time.monotonic()
    end_s = max(log.acc.t_s[-1], log.gyro.t_s[-1])
    inner = np.arange(chunk_s, end_s, chunk_s)
    times = [log.acc.t_s, log.gyro.t_s, log.mag.t_s, log.pressure.t_s, np.array([event.t_s for event in log.events])]
    filled = np.unique(np.searchsorted(inner, np.concatenate(times), side="right"))  # hours may hold nothing
    edges = np.concatenate(([-np.inf], inner, [np.inf]))
    for start_s, until_s in zip(edges[filled].tolist(), edges[filled + 1].tolist(), strict=True):
        due = began + min(until_s, end_s) / speed
        while time.monotonic() < due and not stop():
            time.sleep(min(max(due - time.monotonic(), 0.0), 0.2))
        if stop():
            return
        yield log.between(start_s, until_s), until_s


class WalkInProgress:
    """The online smoother, its guide and its viewer, fed together."""

    def __init__(self, config: Config, aids: Aids, believe: bool = False, view: WalkViewer | None = None) -> None:
        """A walk that has not begun.

        Args:
            config: the effective configuration.
            aids: what the smoother may know besides the sensors.
            believe: whether to keep what the walk was taken to be, for the recording.
            view: shows the walk meanwhile.
        """
        self._config = config
        self._view = view
        self._guide = ReturnGuide(config)
        self._check = LiveCheck(config)
        believe_steps = _BELIEF_STEPS if believe or view is not None else 0
        self._smoother = OnlineSmoother(config, aids, companion=self, believe_steps=believe_steps)

    @property
    def integrity(self) -> Integrity:
        """How far the walk may be believed, by what its sensors and steps showed until now."""
        return self._check.integrity

    def note(self, events: Iterable[Event]) -> None:
        """As a companion of the smoother: hand events on to the guide."""
        self._guide.note(events)

    def advance(
        self, update: Breadcrumb, step: Step, estimate: Callable[[], Trajectory]
    ) -> tuple[ReturnUpdate | None, Iterable[Closure]]:
        """As a companion of the smoother: the guide is told of a step, and of what became doubtful with it."""
        if (signals := self._smoother.signals) is not None:
            self._check.level(signals)
        self._guide.distrust(self._check.advance(step) or "")
        return self._guide.advance(update, step, estimate)

    def feed(self, piece: SensorLog, on_update: OnUpdate | None = None) -> list[Update]:
        """Give the smoother a piece of log, and tell whoever wants to know what it made of it."""
        before = len(self._smoother.beliefs)
        self._check.feed(piece)
        updates = [replace(one, caution=self._check.caution(one.k)) for one in self._smoother.feed(piece)]
        if (signals := self._smoother.signals) is not None:
            self._check.level(signals)
        if on_update is not None:
            for update in updates:
                on_update(update)
        if self._view is not None:
            told = [update.returning for update in updates if update.returning is not None]
            self._view.fed(piece, self._smoother, self._smoother.beliefs[before:], told)
        return updates

    def finish(self, log: SensorLog, told: Told, inputs: RunInputs) -> WalkResult:
        """Everything about a walk that is over, the other estimators beside it.

        Raises:
            DataError: no step in it.
        """
        failed = {}
        track, signals = detect_steps(log, self._config)
        others = baselines(track, self._config)
        try:
            smoothed = self._smoother.finish()
        except EstimationError as error:
            failed["smoothed"], smoothed = str(error), stand_in(others["ekf"])
        log = replace(log, notices=(*log.notices, *self._guide.warnings()))
        others["online"] = self._smoother.causal
        result = replace(
            compose(log, self._config, told, signals, track, smoothed, others, failed),
            beliefs=tuple(self._smoother.beliefs),
            turn_back=self._guide.turn_back or self._smoother.turn_back,
            returning=tuple(self._guide.updates),
            inputs=inputs,
        )
        result = held_back(_without_foreign_truth(result))
        if self._view is not None:
            self._view.finished(result, self._smoother, summary_markdown(summarize(result)))
        return result


class _LiveEstimates:
    """The estimates of a live walk. Whatever goes wrong in them, the recording of its lines goes on."""

    def __init__(self, start: Callable[[], tuple[LiveReader, WalkInProgress]], raw_path: Path, tell: Tell) -> None:
        self._start = start
        self._raw_path = raw_path
        self._tell = tell
        self._restarts = 0
        self._doubted = self._awaited = ""
        self._kept = False
        self.reader, self.walk = start()
        self.failure: str | None = None

    def feed(self, lines: list[str], on_update: OnUpdate | None) -> None:
        """Make something of the next lines, or start again from all that is stored, or give up until the end."""
        if self.failure is not None or not lines:
            return
        try:
            piece = self.reader.push(lines)
            self._tell_reading()
            self.walk.feed(piece, on_update)
            self._distrust()
        except Exception as error:  # an estimator that fails never stops a recording
            self._restart(error)

    def _distrust(self) -> None:
        """Tell why the position is doubtful, when that is new: without steps nobody else does."""
        reasons = self.walk.integrity.reasons
        if reasons and reasons[0].sentence != self._doubted:
            self._doubted = reasons[0].sentence
            self._tell(f"position doubtful: {self._doubted}")

    def _tell_reading(self) -> None:
        """Tell once that samples are held back, and then what was decided; keep it beside the lines."""
        if self.reader.undecided and not self._awaited:
            self._awaited = self.reader.undecided
            self._tell(f"deciding how to read it: {self._awaited}; no steps until then, 20 s of walking at most")
        if self.reader.reading is None or self._kept:
            return
        self._kept = True
        if self._awaited:
            self._tell(f"decided: {self.reader.told()}")
        try:
            keep_layout(self.reader.reading.layout, self._raw_path.parent)
        except ConfigError as error:  # it would be decided again, from the same lines
            self._tell(f"{SAVED_LAYOUT}: {_first_line(error)}")

    def catch_up(self) -> None:
        """Take the lines that are stored already; their steps are not reported again."""
        try:
            for lines in saved_lines(self._raw_path):
                piece = self.reader.push(lines)
                self._tell_reading()
                self.walk.feed(piece)
        except Exception as error:
            self._give_up(error)

    def finish(self, log: SensorLog, config: Config, told: Told, inputs: RunInputs) -> WalkResult:
        """The finished walk; from the stored lines alone if the estimates had failed."""
        if self.failure is None:
            try:
                piece = self.reader.finish()
                self._tell_reading()
                self.walk.feed(piece)
                return self.walk.finish(log, told, inputs)
            except Exception as error:
                self._give_up(error)
        result = reconstruct(log, config, told, inputs)
        notice = f"the live estimates ended early ({self.failure}); the walk was smoothed from its stored lines"
        return replace(result, log=replace(result.log, notices=(*result.log.notices, notice)))

    def _restart(self, error: Exception) -> None:
        if self._restarts:
            self._give_up(error)
            return
        self._restarts += 1
        self._tell(f"the estimates failed ({_first_line(error)}); starting them again from the stored lines")
        self.reader, self.walk = self._start()
        self.catch_up()

    def _give_up(self, error: Exception) -> None:
        self.failure = _first_line(error)
        self._tell(f"no more estimates until the end ({self.failure}); every line is still recorded")


def _first_line(error: Exception) -> str:
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0]


def _without_foreign_truth(result: WalkResult) -> WalkResult:
    """Truth of another walk is no reason to lose this one."""
    truth, log = result.told.truth, result.log
    if truth is None or len(truth) < 2:
        return result
    try:
        checkpoint_errors(result.smoothed.trajectory, truth, log.t0_s, log_s=log.span_s)
    except DataError as error:
        log = replace(log, notices=(*log.notices, f"not scored: {error}"))
        return replace(result, told=replace(result.told, truth=None), log=log)
    return result


def replay_log(
    log: SensorLog,
    config: Config,
    told: Told | None = None,
    *,
    chunk_s: float = 0.1,
    speed: float = np.inf,
    on_update: OnUpdate | None = None,
    stop: Callable[[], bool] = lambda: False,
    recording: bool = True,
    view: WalkViewer | None = None,
    inputs: RunInputs | None = None,
) -> WalkResult:
    """Feed a log through the online path.

    Args:
        log: the walk.
        config: the effective configuration.
        told: truth, anchors, a closed end, an origin.
        chunk_s, speed: fed in pieces this long, so many times as fast as they were recorded.
        on_update: called at each step.
        stop: asked whether to end the walk here.
        recording: whether the result is to hold beliefs.
        view: shows the walk meanwhile.
        inputs: as in ``WalkResult``.

    Raises:
        DataError: no step in the log, or an anchor that lies outside it.
        EstimationError: the solver failed.
    """
    told = told or Told()
    require_anchors_within(log, told)
    config = with_declination(config, told.place, log.t0_s)
    walk = WalkInProgress(config, told.aids(log.t0_s, config.device.declination_deg), recording, view)
    fed_until_s = -np.inf
    for piece, until_s in cut_log(log, chunk_s, speed, stop):
        walk.feed(piece, on_update)
        fed_until_s = until_s
    stopped_s = fed_until_s if np.isfinite(fed_until_s) else None
    inputs = replace(inputs or RunInputs(), online_chunk_s=chunk_s, until_s=stopped_s)
    return walk.finish(log.between(-np.inf, fed_until_s), told, inputs)


def follow_source(
    source: Iterable[bytes],
    place: Path,
    config: Config,
    told: Told | None = None,
    *,
    on_update: OnUpdate | None = None,
    tell: Tell = lambda text: None,
    resume: bool = False,
    recording: bool = True,
    view: WalkViewer | None = None,
    inputs: RunInputs | None = None,
) -> WalkResult:
    """Follow a live source; every byte is on disk before it is used, and recorded whatever the estimates do.

    Args:
        source: bytes as they arrive; nothing, now and then, while it is silent.
        place: the run folder, claimed (``claimed_live``); ``raw.csv`` and ``config.toml`` are there from the start,
            ``layout.toml`` once it is decided.
        config: the effective configuration.
        told: truth on the device's clock, a closed end, an origin; no anchors, for that clock is not known beforehand.
        on_update: called at each step.
        tell: called with what went wrong meanwhile.
        resume: go on from the lines in ``raw.csv``; their steps are not reported again.
        recording: whether the result is to hold beliefs.
        view, inputs: as in ``replay_log``.

    Raises:
        ConfigError: nothing can be written there.
        DataError: no usable line or no step arrived.
    """
    told = told or Told()
    config = live_declination(config, told)
    raw_path, cutter = place / RAW, LineCutter()
    aids = replace(told, anchors=None).aids(0.0, config.device.declination_deg)
    estimates = _LiveEstimates(
        lambda: (LiveReader(place.name), WalkInProgress(config, aids, recording, view)), raw_path, tell
    )
    if resume:
        cut_torn_line(raw_path)
        estimates.catch_up()
    _keep_config(config, place)
    try:
        with RawRecorder(raw_path) as raw:
            for data in source:
                raw.write(data)
                estimates.feed(cutter.push(data), on_update)
    except OSError as error:
        if not raw_path.exists():
            raise ConfigError(f"{raw_path}: cannot write there: {error.strerror or error}") from error
        tell(f"recording ended: {raw_path}: {error.strerror or error}; what came before is kept there")
    estimates.feed(cutter.finish(), on_update)
    log, told = _with_its_truth(saved_log(raw_path), told)
    return estimates.finish(log, config, told, replace(inputs or RunInputs(), log=RAW))


def _with_its_truth(log: SensorLog, told: Told) -> tuple[SensorLog, Told]:
    """A live walk's truth on its clock, which is known now; without it if it is another's."""
    try:
        return with_places(LogFile(log, None), told, RunInputs())
    except DataError as error:
        return replace(log, notices=(*log.notices, f"not scored: {error}")), replace(told, truth=None)


def live_declination(config: Config, told: Told) -> Config:
    """The configuration of a live walk, which is walked today: what its clock shows is not known beforehand."""
    return with_declination(config, told.place, float("nan"))


def _keep_config(config: Config, out: Path) -> None:
    """Write ``config.toml``, at once or not at all: a walk killed meanwhile must go on as it began."""
    text, path = dump_toml(config), out / "config.toml"
    if path.is_file() and read_text(path, "TOML") == text:
        return
    with whole_file(path) as partial:
        partial.write_text(text, "utf-8")


def resumed_config(place: Path, return_at: str | None = None) -> Config:
    """The configuration with which the live walk in a claimed run folder was begun.

    Args:
        place: the run folder.
        return_at: overrules when the way back begins.

    Raises:
        ConfigError: it is damaged.
    """
    overrides = () if return_at is None else (f"returning.at={json.dumps(return_at)}",)
    return load_config(str(place / "config.toml"), overrides)
