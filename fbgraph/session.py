"""A walk in progress: feeds the online smoother, keeps every raw line, writes the run folder when it ends."""

from __future__ import annotations

import itertools
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fbgraph.core.aids import Aids, Told
from fbgraph.core.config import Config, dump_toml, load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.log import SensorLog
from fbgraph.core.whole_writes import whole_file, whole_folder
from fbgraph.estimators.answers import Update
from fbgraph.estimators.baselines import baselines
from fbgraph.estimators.online import OnlineSmoother
from fbgraph.front_end.front_end import detect_steps
from fbgraph.pipeline import compose, require_anchors_within, write_files
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.raw_lines import cut_torn_line, saved_lines, saved_log
from fbgraph.run.folder import RAW, check_run_folder, require_no_raw
from fbgraph.run.inputs import RunInputs
from fbgraph.run.metrics import checkpoint_errors
from fbgraph.run.result import WalkResult
from fbgraph.run.summary import summarize, summary_markdown
from fbgraph.way_back.guide import ReturnGuide

if TYPE_CHECKING:
    from fbgraph.recording.live_view import LiveView

OnUpdate = Callable[[Update], None]
_BELIEF_STEPS = 5  # as often as iSAM2 relinearises


def cut_log(
    log: SensorLog, chunk_s: float, speed: float, stop: Callable[[], bool]
) -> Iterator[tuple[SensorLog, float]]:
    """A log cut into pieces, each with its end, delivered ``speed`` times as fast as recorded (infinity: at once)."""
    began = time.monotonic()
    end_s = max(log.acc.t_s[-1], log.gyro.t_s[-1])
    edges = [-np.inf, *np.arange(chunk_s, end_s, chunk_s).tolist(), np.inf]
    for start_s, until_s in itertools.pairwise(edges):
        due = began + min(until_s, end_s) / speed
        while time.monotonic() < due and not stop():
            time.sleep(min(max(due - time.monotonic(), 0.0), 0.2))
        if stop():
            return
        yield log.between(start_s, until_s), until_s


class WalkInProgress:
    """The online smoother, its guide and its viewer, fed together."""

    def __init__(self, config: Config, aids: Aids, believe: bool = False, view: LiveView | None = None) -> None:
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
        believe_steps = _BELIEF_STEPS if believe or view is not None else 0
        self._smoother = OnlineSmoother(config, aids, companion=self._guide, believe_steps=believe_steps)

    def feed(self, piece: SensorLog, on_update: OnUpdate | None = None) -> list[Update]:
        """Give the smoother a piece of log, and tell whoever wants to know what it made of it."""
        before = len(self._smoother.beliefs)
        updates = self._smoother.feed(piece)
        if on_update is not None:
            for update in updates:
                on_update(update)
        if self._view is not None:
            told = [update.returning for update in updates if update.returning is not None]
            self._view.fed(piece, self._smoother, self._smoother.beliefs[before:], told)
        return updates

    def finish(self, log: SensorLog, told: Told, inputs: RunInputs) -> WalkResult:
        """Everything about a walk that is over, the other estimators beside it."""
        smoothed = self._smoother.finish()
        track, signals = detect_steps(log, self._config)
        log = replace(log, notices=(*log.notices, *self._guide.warnings()))
        others = {**baselines(track, self._config), "online": self._smoother.causal}
        result = replace(
            compose(log, self._config, told, signals, track, smoothed, others),
            beliefs=tuple(self._smoother.beliefs),
            turn_back=self._guide.turn_back or self._smoother.turn_back,
            returning=tuple(self._guide.updates),
            inputs=inputs,
        )
        result = _without_foreign_truth(result)
        if self._view is not None:
            self._view.finished(result, self._smoother, summary_markdown(summarize(result)))
        return result


def _without_foreign_truth(result: WalkResult) -> WalkResult:
    """Truth of another walk is no reason to lose this one."""
    truth, log = result.told.truth, result.log
    if truth is None or len(truth) < 2:
        return result
    try:
        checkpoint_errors(result.smoothed.trajectory, truth, log.t0_s)
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
    view: LiveView | None = None,
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
    walk = WalkInProgress(config, told.aids(log.t0_s), recording, view)
    fed_until_s = -np.inf
    for piece, until_s in cut_log(log, chunk_s, speed, stop):
        walk.feed(piece, on_update)
        fed_until_s = until_s
    stopped_s = fed_until_s if np.isfinite(fed_until_s) else None
    inputs = replace(inputs or RunInputs(), online_chunk_s=chunk_s, until_s=stopped_s)
    return walk.finish(log.between(-np.inf, fed_until_s), told, inputs)


def follow_source(
    source: Iterable[bytes],
    out: Path,
    config: Config,
    told: Told | None = None,
    *,
    on_update: OnUpdate | None = None,
    resume: bool = False,
    recording: bool = True,
    view: LiveView | None = None,
    inputs: RunInputs | None = None,
) -> WalkResult:
    """Follow a live source; every complete line is on disk before it is used.

    Args:
        source: bytes as they arrive.
        out: the run folder; ``raw.csv`` and ``config.toml`` are there from the start.
        config: the effective configuration.
        told: truth on the device's clock, a closed end, an origin; no anchors, for that clock is not known beforehand.
        on_update: called at each step.
        resume: go on from the lines in ``out/raw.csv``; their steps are not reported again.
        recording: whether the result is to hold beliefs.
        view: shows the walk meanwhile.
        inputs: as in ``WalkResult``.

    Raises:
        ConfigError: ``out`` holds something else, or there is nothing to resume.
        DataError: no usable line or no step arrived.
        EstimationError: the solver failed.
    """
    told = told or Told()
    raw_path, reader = out / RAW, LiveReader(out.name)
    walk = WalkInProgress(config, Aids(closed_walk=told.closed_walk), recording, view)
    if resume:
        cut_torn_line(raw_path)
        for line_block in saved_lines(raw_path):
            walk.feed(reader.push(line_block), None)
    else:
        check_run_folder(out)
        require_no_raw(out)
        out.mkdir(parents=True, exist_ok=True)
        for name in os.listdir(out):
            (out / name).unlink()
    _keep_config(config, out)
    rest = b""
    with open(raw_path, "ab", buffering=0) as raw:
        for data in source:
            complete, newline, rest = (rest + data).rpartition(b"\n")
            if not newline:
                continue
            raw.write(complete + newline)
            walk.feed(reader.push(complete.decode("latin-1").split("\n")), on_update)
    walk.feed(reader.finish(), on_update)
    return walk.finish(saved_log(raw_path), told, replace(inputs or RunInputs(), log=RAW))


def _keep_config(config: Config, out: Path) -> None:
    """Write ``config.toml``, at once or not at all: a walk killed meanwhile must go on as it began."""
    text, path = dump_toml(config), out / "config.toml"
    if path.is_file() and path.read_text("utf-8") == text:
        return
    with whole_file(path) as partial:
        partial.write_text(text, "utf-8")


def resumed_config(out: Path, return_at: str | None = None) -> Config:
    """The configuration with which the walk in ``out`` was begun, when the way back begins included.

    Args:
        out: the run folder.
        return_at: overrules when the way back begins.

    Raises:
        ConfigError: there is no walk to resume.
    """
    if not (out / RAW).is_file() or not (out / "config.toml").is_file():
        raise ConfigError(f"--resume {out}: no {RAW} and config.toml there, so no walk to go on with")
    overrides = () if return_at is None else (f"returning.at={json.dumps(return_at)}",)
    return load_config(str(out / "config.toml"), overrides)


def write_walk(result: WalkResult, out: Path, recording: bool = True) -> dict[str, Any]:
    """Write the run folder of a walk that was followed; ``raw.csv`` stays. Returns its summary.

    Raises:
        ConfigError: ``out`` cannot be written.
    """
    with whole_folder(out, keep=(RAW,)) as folder:
        return write_files(result, folder, recording)
