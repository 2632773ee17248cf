"""A walk in progress: feeds the online smoother, keeps every raw line, writes the run folder when it ends."""

from __future__ import annotations

import itertools
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import Config, dump_toml, load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.georeference import Georeference
from fbgraph.core.log import SensorLog
from fbgraph.estimators.ekf import run_ekf
from fbgraph.estimators.online import OnlineSmoother, Update
from fbgraph.estimators.pdr import dead_reckon
from fbgraph.front_end.front_end import detect_steps
from fbgraph.pipeline import write_files
from fbgraph.readers.base import OPTIONAL_SENSORS
from fbgraph.readers.live_lines import LiveReader
from fbgraph.run.folder import RAW, RUN_FILES, check_run_folder, require_no_raw, summarize, summary_markdown
from fbgraph.run.metrics import checkpoint_errors
from fbgraph.run.result import WalkResult
from fbgraph.way_back.guide import ReturnGuide

if TYPE_CHECKING:
    from fbgraph.recording.live_view import LiveView

OnUpdate = Callable[[Update], None]
_TAIL_BYTES, _BLOCK_BYTES = 1 << 16, 1 << 21
_BELIEF_STEPS = 5  # as often as iSAM2 relinearises


def pieces(log: SensorLog, chunk_s: float, speed: float, stop: Callable[[], bool]) -> Iterator[tuple[SensorLog, float]]:
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


def _feed(piece: SensorLog, smoother: OnlineSmoother, view: LiveView | None, on_update: OnUpdate | None) -> None:
    """Give the smoother a piece of log, and tell whoever wants to know what it made of it."""
    before = len(smoother.beliefs)
    updates = smoother.feed(piece)
    if on_update is not None:
        for update in updates:
            on_update(update)
    if view is not None:
        told = [update.returning for update in updates if update.returning is not None]
        view.fed(piece, smoother, smoother.beliefs[before:], told)


def replay(
    log: SensorLog,
    config: Config,
    *,
    chunk_s: float,
    speed: float,
    on_update: OnUpdate,
    stop: Callable[[], bool],
    truth: Checkpoints | None = None,
    anchors: Checkpoints | None = None,
    closed_walk: bool = False,
    origin: Georeference | None = None,
    recording: bool = True,
    view: LiveView | None = None,
    inputs: Mapping[str, Any] | None = None,
) -> WalkResult:
    """Feed a log through the online path.

    Args:
        log: the walk.
        config: the effective configuration.
        chunk_s, speed: fed in pieces this long, so many times as fast as they were recorded.
        on_update: called at each step.
        stop: asked whether to end the walk here.
        truth, anchors, closed_walk, origin, inputs: as in ``WalkResult``.
        recording: whether the result is to hold beliefs.
        view: shows the walk meanwhile.

    Raises:
        DataError: no step in the log, or an anchor that lies outside it.
        EstimationError: the solver failed.
    """
    if anchors is not None:
        anchors.require_within(log.t0_s + log.acc.t_s[0], log.t0_s + log.acc.t_s[-1])
    guide = ReturnGuide(config)
    believe_steps = _BELIEF_STEPS if recording or view is not None else 0
    smoother = OnlineSmoother(config, anchors, log.t0_s, closed_walk, companion=guide, believe_steps=believe_steps)
    fed_until_s = -np.inf
    for piece, until_s in pieces(log, chunk_s, speed, stop):
        _feed(piece, smoother, view, on_update)
        fed_until_s = until_s
    seen = log.between(-np.inf, fed_until_s)
    result = _result(seen, smoother, guide, view, config, truth, anchors, closed_walk)
    stopped_s = fed_until_s if np.isfinite(fed_until_s) else None
    return replace(result, origin=origin, inputs={**(inputs or {}), "online_chunk_s": chunk_s, "until_s": stopped_s})


def live(
    source: Iterable[bytes],
    out: Path,
    config: Config,
    *,
    on_update: OnUpdate,
    resume: bool = False,
    closed_walk: bool = False,
    truth: Checkpoints | None = None,
    origin: Georeference | None = None,
    recording: bool = True,
    view: LiveView | None = None,
    inputs: Mapping[str, Any] | None = None,
) -> WalkResult:
    """Follow a live source; every complete line is on disk before it is used.

    Args:
        source: bytes as they arrive.
        out: the run folder; ``raw.csv`` and ``config.toml`` are there from the start.
        config: the effective configuration.
        on_update: called at each step.
        resume: go on from the lines in ``out/raw.csv``; their steps are not reported again.
        closed_walk: the smoother may assume that the walk ended where it began.
        truth: for scoring, on the device's clock.
        origin, inputs: as in ``WalkResult``.
        recording: whether the result is to hold beliefs.
        view: shows the walk meanwhile.

    Raises:
        ConfigError: ``out`` holds something else, or there is nothing to resume.
        DataError: no usable line or no step arrived.
        EstimationError: the solver failed.
    """
    raw_path = out / RAW
    reader, guide = LiveReader(out.name), ReturnGuide(config)
    believe_steps = _BELIEF_STEPS if recording or view is not None else 0
    smoother = OnlineSmoother(config, closed_walk=closed_walk, companion=guide, believe_steps=believe_steps)
    if resume:
        _cut_torn_line(raw_path)
        for line_block in _saved_lines(raw_path):
            _feed(reader.push(line_block), smoother, view, None)
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
            _feed(reader.push(complete.decode("latin-1").split("\n")), smoother, view, on_update)
    _feed(reader.finish(), smoother, view, on_update)
    result = _result(saved_log(raw_path), smoother, guide, view, config, truth, None, closed_walk)
    return replace(result, origin=origin, inputs={**(inputs or {}), "log": RAW})


def _keep_config(config: Config, out: Path) -> None:
    """Write ``config.toml``, at once or not at all: a walk killed meanwhile must go on as it began."""
    text, path = dump_toml(config), out / "config.toml"
    if path.is_file() and path.read_text("utf-8") == text:
        return
    partial = out.parent / f".{out.name}.config.toml"
    partial.write_text(text, "utf-8")
    partial.replace(path)


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


def saved_log(raw_path: Path) -> SensorLog:
    """The samples of saved raw lines, exactly as the online smoother was given them.

    Raises:
        DataError: no usable samples.
    """
    reader = LiveReader(raw_path.parent.name)
    parts = [reader.push(block) for block in _saved_lines(raw_path)]
    parts.append(reader.finish())
    log = SensorLog.concatenate(parts)
    if min(len(log.acc), len(log.gyro)) < 2:
        raise DataError(f"{raw_path}: no usable accelerometer and gyroscope samples arrived")
    counts = {reason: number for reason, number in reader.counts.items() if number}
    missing = [
        f"no {sensor}: {cost}" for name, (sensor, cost) in OPTIONAL_SENSORS.items() if len(getattr(log, name)) == 0
    ]
    return replace(
        log,
        name=raw_path.parent.name,
        format="m5stickc",
        t0_s=reader.t0_s,
        notices=(*reader.notices, *missing),
        counts=counts,
    )


def _cut_torn_line(raw_path: Path) -> None:
    """Take off what a crash left of a last line, before others are added."""
    with open(raw_path, "rb+") as raw:
        size = raw.seek(0, os.SEEK_END)
        tail = b""
        while size and b"\n" not in tail:
            size = max(size - _TAIL_BYTES, 0)
            raw.seek(size)
            tail = raw.read(_TAIL_BYTES)
        raw.truncate(size + tail.rfind(b"\n") + 1)


def _saved_lines(raw_path: Path) -> Iterator[list[str]]:
    """Blocks of complete lines; one torn by a crash is left out."""
    with open(raw_path, "rb") as raw:
        while lines := raw.readlines(_BLOCK_BYTES):
            yield [line[:-1].decode("latin-1") for line in lines if line.endswith(b"\n")]


def _result(
    log: SensorLog,
    smoother: OnlineSmoother,
    guide: ReturnGuide,
    view: LiveView | None,
    config: Config,
    truth: Checkpoints | None,
    anchors: Checkpoints | None,
    closed_walk: bool,
) -> WalkResult:
    """Everything about a walk that is over, the other estimators beside it."""
    smoothed = smoother.finish()
    track, signals = detect_steps(log, config)
    log = replace(log, notices=(*log.notices, *guide.warnings()))
    result = WalkResult(
        log=log,
        config=config,
        signals=signals,
        track=track,
        trajectories={
            "pdr": dead_reckon(track, config.step_length),
            "ekf": run_ekf(track, config.ekf),
            "smoothed": smoothed.trajectory,
            "online": smoother.causal,
        },
        smoothed=smoothed,
        truth=None if truth is None else truth.in_frame_of(anchors),
        anchors=anchors,
        closed_walk=closed_walk,
        beliefs=tuple(smoother.beliefs),
        turn_back=guide.turn_back or smoother.turn_back,
        returning=tuple(guide.updates),
    )
    if result.truth is not None and len(result.truth) > 1:
        try:
            checkpoint_errors(smoothed.trajectory, result.truth, log.t0_s)
        except DataError as error:  # truth of another walk is no reason to lose this one
            result = replace(result, truth=None, log=replace(log, notices=(*log.notices, f"not scored: {error}")))
    if view is not None:
        view.finished(result, smoother, summary_markdown(summarize(result)))
    return result


def write_walk(result: WalkResult, out: Path, recording: bool = True) -> dict[str, Any]:
    """The run folder of a walk that was followed; returns its summary.

    Into a folder of its own first, then file by file into place, so that none is ever half there; what is in place
    already, ``raw.csv``, stays.
    """
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
        summary = write_files(result, Path(folder), recording)
        written = {path.name for path in Path(folder).iterdir()}
        for name in written:
            (Path(folder) / name).replace(out / name)
    for name in RUN_FILES - written - {RAW}:  # of an earlier run
        (out / name).unlink(missing_ok=True)
    return summary
