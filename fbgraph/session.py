"""A walk in progress: feeds the online smoother, keeps every raw line, writes the run folder when it ends."""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.checkpoints import Checkpoints
from fbgraph.config import Config, dump_toml, load_config
from fbgraph.ekf import run_ekf
from fbgraph.errors import ConfigError, DataError
from fbgraph.exports import RETURNS, check_run_folder, summarize, summary_markdown, write_tables
from fbgraph.log import SensorLog, Stream
from fbgraph.online import OnlineSmoother, Update
from fbgraph.pdr import dead_reckon
from fbgraph.readers.base import OPTIONAL_SENSORS
from fbgraph.readers.live import LiveReader
from fbgraph.result import WalkResult
from fbgraph.returning import ReturnGuide
from fbgraph.steps import detect_steps

OnUpdate = Callable[[Update], None]
RAW = "raw.csv"


def pieces(log: SensorLog, chunk_s: float, speed: float, stop: Callable[[], bool]) -> Iterator[SensorLog]:
    """A log cut into pieces, delivered ``speed`` times as fast as it was recorded (infinity: at once)."""
    began = time.monotonic()
    end_s = max(log.acc.t_s[-1], log.gyro.t_s[-1])
    edges = np.arange(0.0, end_s + chunk_s, chunk_s)
    for start_s in edges:
        due = began + (start_s + chunk_s) / speed
        while time.monotonic() < due and not stop():
            time.sleep(min(max(due - time.monotonic(), 0.0), 0.2))
        if stop():
            return
        yield log.between(start_s if start_s > 0 else -np.inf, start_s + chunk_s)


def replay(
    log: SensorLog,
    out: Path,
    config: Config,
    *,
    chunk_s: float,
    speed: float,
    on_update: OnUpdate,
    stop: Callable[[], bool],
    truth: Checkpoints | None = None,
    anchors: Checkpoints | None = None,
    closed_walk: bool = False,
    recording: bool = True,
) -> dict[str, Any]:
    """Feed a log through the online path and write its run folder; returns the summary.

    Raises:
        ConfigError: ``out`` holds something else.
        DataError: no step in the log, or truth that does not belong to it.
        EstimationError: the solver failed.
    """
    check_run_folder(out)
    guide = ReturnGuide(config)
    smoother = OnlineSmoother(config, anchors, log.t0_s, closed_walk, companion=guide)
    fed_until_s = 0.0
    for piece in pieces(log, chunk_s, speed, stop):
        for update in smoother.feed(piece):
            on_update(update)
        fed_until_s += chunk_s
    seen = log if not stop() else log.between(-np.inf, fed_until_s)
    return _write(seen, smoother, guide, out, config, truth, anchors, closed_walk, recording)


def live(
    source: Iterable[bytes],
    out: Path,
    config: Config,
    *,
    on_update: OnUpdate,
    resume: bool = False,
    closed_walk: bool = False,
    truth: Checkpoints | None = None,
    recording: bool = True,
) -> dict[str, Any]:
    """Follow a live source; every complete line is on disk before it is used.

    Args:
        source: bytes as they arrive.
        out: the run folder; ``raw.csv`` and ``config.toml`` are there from the start.
        config: the effective configuration.
        on_update: called at each step.
        resume: go on from the lines in ``out/raw.csv``; their steps are not reported again.
        closed_walk: the smoother may assume that the walk ended where it began.
        truth: for scoring, on the device's clock.
        recording: whether to write ``recording.rrd``.

    Raises:
        ConfigError: ``out`` holds something else, or there is nothing to resume.
        DataError: no usable line or no step arrived.
        EstimationError: the solver failed.
    """
    raw_path = out / RAW
    reader, guide = LiveReader(out.name), ReturnGuide(config)
    smoother = OnlineSmoother(config, closed_walk=closed_walk, companion=guide)
    if resume:
        for line_block in _saved_lines(raw_path):
            smoother.feed(reader.push(line_block))
    else:
        check_run_folder(out)
        out.mkdir(parents=True, exist_ok=True)
        for name in os.listdir(out):
            (out / name).unlink()
    (out / "config.toml").write_text(dump_toml(config), "utf-8")
    rest = b""
    with open(raw_path, "ab", buffering=0) as raw:
        for data in source:
            complete, newline, rest = (rest + data).rpartition(b"\n")
            if not newline:
                continue
            raw.write(complete + newline)
            for update in smoother.feed(reader.push(complete.decode("latin-1").split("\n"))):
                on_update(update)
    for update in smoother.feed(reader.finish()):
        on_update(update)
    return _write(saved_log(raw_path), smoother, guide, out, config, truth, None, closed_walk, recording)


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
    streams = {
        name: Stream(
            np.concatenate([getattr(part, name).t_s for part in parts]),
            np.concatenate([getattr(part, name).values for part in parts]),
        )
        for name in ("acc", "gyro", "mag", "pressure")
    }
    if min(len(streams["acc"]), len(streams["gyro"])) < 2:
        raise DataError(f"{raw_path}: no usable accelerometer and gyroscope samples arrived")
    counts = {reason: number for reason, number in reader.counts.items() if number}
    missing = [f"no {sensor}: {cost}" for name, (sensor, cost) in OPTIONAL_SENSORS.items() if len(streams[name]) == 0]
    events = tuple(event for part in parts for event in part.events)
    return SensorLog(
        name=raw_path.parent.name,
        format="m5stickc",
        t0_s=reader.t0_s,
        acc=streams["acc"],
        gyro=streams["gyro"],
        mag=streams["mag"],
        pressure=streams["pressure"],
        events=events,
        notices=(*reader.notices, *missing),
        counts=counts,
    )


def _saved_lines(raw_path: Path) -> Iterator[list[str]]:
    """Blocks of complete lines; a line torn by a crash is cut off the file."""
    with open(raw_path, "rb+") as raw:
        content = raw.read()
        whole = content.rfind(b"\n") + 1
        raw.truncate(whole)
    lines = content[:whole].decode("latin-1").split("\n")[:-1]
    for at in range(0, len(lines), 20_000):
        yield lines[at : at + 20_000]


def _write(
    log: SensorLog,
    smoother: OnlineSmoother,
    guide: ReturnGuide,
    out: Path,
    config: Config,
    truth: Checkpoints | None,
    anchors: Checkpoints | None,
    closed_walk: bool,
    recording: bool,
) -> dict[str, Any]:
    """The run folder: into a folder of its own first, then file by file into place, so that none is ever half there."""
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
        truth=truth,
        anchors=anchors,
        closed_walk=closed_walk,
        turn_back=guide.turn_back,
        returning=tuple(guide.updates),
    )
    summary = summarize(result)
    out.mkdir(parents=True, exist_ok=True)
    (out / RETURNS).unlink(missing_ok=True)  # of an earlier run
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as folder:
        write_tables(result, Path(folder))
        if recording:
            from fbgraph.recording import write_recording  # rerun takes a second to import

            write_recording(result, Path(folder) / "recording.rrd", summary_markdown(summary))
        for path in Path(folder).iterdir():
            path.replace(out / path.name)
    return summary
