"""From a log to a result: composes the rooms, estimates nothing itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import Config
from fbgraph.core.errors import ConfigError
from fbgraph.core.georeference import Georeference
from fbgraph.core.log import SensorLog
from fbgraph.estimators.ekf import run_ekf
from fbgraph.estimators.pdr import dead_reckon
from fbgraph.estimators.smoother import smooth, tie_way_back
from fbgraph.front_end.front_end import detect_steps
from fbgraph.run.folder import run_folder, summarize, summary_markdown, write_tables
from fbgraph.run.result import WalkResult

if TYPE_CHECKING:
    from fbgraph.simulator.routes import Route
    from fbgraph.simulator.simulate import SimulateOptions

Progress = Callable[[str], None]
"""Called with the name of each stage as it begins."""


def reconstruct(
    log: SensorLog,
    config: Config,
    truth: Checkpoints | None = None,
    anchors: Checkpoints | None = None,
    closed_walk: bool = False,
    origin: Georeference | None = None,
    inputs: Mapping[str, Any] | None = None,
    progress: Progress = lambda stage: None,
) -> WalkResult:
    """Run dead reckoning, the EKF pipeline and the smoother on the same steps of one log.

    Args:
        log: the walk.
        config: the effective configuration.
        truth: known places; carried along for scoring, no estimator sees them.
        anchors: known places that the smoother may use, on the clock ``t_s + log.t0_s``.
        closed_walk: tell the smoother that the walk ends where it began.
        origin, inputs: as in ``WalkResult``.
        progress: told each stage.

    Raises:
        DataError: no step in the log, or an anchor that lies outside it.
        EstimationError: the smoother failed.
    """
    if anchors is not None:
        anchors.require_within(log.t0_s + log.acc.t_s[0], log.t0_s + log.acc.t_s[-1])
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
    turned = None
    if config.returning.out_and_back:
        with stage("closures"):
            smoothed, turned = tie_way_back(smoothed, track, ekf, config, anchors, log.t0_s, closed_walk)
    return WalkResult(
        log=log,
        config=config,
        signals=signals,
        track=track,
        trajectories={"pdr": pdr, "ekf": ekf, "smoothed": smoothed.trajectory},
        smoothed=smoothed,
        truth=None if truth is None else truth.in_frame_of(anchors),
        anchors=anchors,
        closed_walk=closed_walk,
        seconds=seconds,
        origin=origin,
        inputs=inputs or {},
        turn_back=turned,
    )


def write_run(
    result: WalkResult, out: Path, recording: bool = True, progress: Progress = lambda stage: None
) -> dict[str, Any]:
    """Write the run folder, whole or not at all, and return its summary.

    Raises:
        ConfigError: ``out`` cannot be written or holds something else.
        DataError: truth that does not belong to this log.
    """
    with run_folder(out) as folder:
        return write_files(result, folder, recording, progress)


def write_files(
    result: WalkResult, folder: Path, recording: bool = True, progress: Progress = lambda stage: None
) -> dict[str, Any]:
    """Write all files of a run into an existing folder and return the summary.

    Raises:
        DataError: truth that does not belong to this log.
    """
    progress("tables")
    summary = summarize(result)
    if recording and find_spec("rerun") is None:
        recording = False
        summary["warnings"].append("no recording.rrd: rerun-sdk is not installed (pip install rerun-sdk)")
    write_tables(result, folder, summary)
    if recording:
        progress("recording")
        from fbgraph.recording.recorder import write_recording

        write_recording(result, folder / "recording.rrd", summary_markdown(summary))
    return summary


def simulate_files(out: Path, route: Route, options: SimulateOptions, seed: int) -> dict[str, Any]:
    """Write a simulated M5StickC log to ``out`` and its exact truth beside it; returns what was written.

    Raises:
        ConfigError: impossible options, or ``out`` cannot be written.
    """
    from fbgraph.simulator.simulate import simulate, write_m5stickc_csv, write_truth_csv

    walk = simulate(route, options, seed)
    truth = out.with_name(f"{out.stem}_truth.csv")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_m5stickc_csv(walk.log, out)
        write_truth_csv(walk, truth)
    except OSError as error:
        raise ConfigError(f"{out}: cannot write there: {error.strerror}") from error
    return {
        "log": str(out),
        "truth": str(truth),
        "duration_s": round(walk.log.duration_s, 2),
        "steps": len(walk.steps.t_s),
        "distance_m": round(float(walk.steps.length_m.sum()), 2),
        "turns": len(walk.turns.t_s),
    }
