"""From a log to a result: composes the rooms, estimates nothing itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fbgraph.checkpoints import Checkpoints
from fbgraph.config import Config
from fbgraph.ekf import run_ekf
from fbgraph.exports import run_folder, summarize, summary_markdown, write_tables
from fbgraph.log import SensorLog
from fbgraph.pdr import dead_reckon
from fbgraph.result import WalkResult
from fbgraph.smoother import smooth
from fbgraph.steps import detect_steps

Progress = Callable[[str], None]
"""Called with the name of each stage as it begins."""


def reconstruct(
    log: SensorLog,
    config: Config,
    truth: Checkpoints | None = None,
    anchors: Checkpoints | None = None,
    closed_walk: bool = False,
    progress: Progress = lambda stage: None,
) -> WalkResult:
    """Run dead reckoning, the EKF pipeline and the smoother on the same steps of one log.

    Args:
        log: the walk.
        config: the effective configuration.
        truth: known places; carried along for scoring, no estimator sees them.
        anchors: known places that the smoother may use, on the clock ``t_s + log.t0_s``.
        closed_walk: tell the smoother that the walk ends where it began.
        progress: told each stage.

    Raises:
        DataError: no step in the log.
        EstimationError: the smoother failed.
    """
    seconds: dict[str, float] = {}

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        progress(name)
        start = time.perf_counter()
        yield
        seconds[name] = time.perf_counter() - start

    with stage("steps"):
        track, signals = detect_steps(log, config)
    with stage("pdr"):
        pdr = dead_reckon(track, config.step_length)
    with stage("ekf"):
        ekf = run_ekf(track, config.ekf)
    with stage("smoother"):
        smoothed = smooth(track, ekf, config.graph, config.solver, anchors, log.t0_s, closed_walk)
    return WalkResult(
        log=log,
        config=config,
        signals=signals,
        track=track,
        trajectories={"pdr": pdr, "ekf": ekf, "smoothed": smoothed.trajectory},
        smoothed=smoothed,
        truth=truth,
        anchors=anchors,
        closed_walk=closed_walk,
        seconds=seconds,
    )


def write_run(
    result: WalkResult, out: Path, recording: bool = True, progress: Progress = lambda stage: None
) -> dict[str, Any]:
    """Write the run folder, whole or not at all, and return its summary.

    Raises:
        ConfigError: ``out`` cannot be written or holds something else.
        DataError: truth that does not belong to this log.
    """
    summary = summarize(result)
    with run_folder(out) as folder:
        progress("tables")
        write_tables(result, folder)
        if recording:
            progress("recording")
            from fbgraph.recording import write_recording  # rerun takes a second to import

            write_recording(result, folder / "recording.rrd", summary_markdown(summary))
    return summary
