"""Makes a run's result again from its folder: the log it names, its configuration, and what it was told."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from fbgraph.core.errors import DataError
from fbgraph.core.whole_writes import locked, whole_file
from fbgraph.pipeline import read_told, reconstruct, with_places
from fbgraph.run.folder import RAW
from fbgraph.run.inputs import RunInputs
from fbgraph.run.log_again import read_log_again
from fbgraph.run.read_run import SavedRun, read_run
from fbgraph.run.summary import summarize, summary_markdown
from fbgraph.run.walk_result import WalkResult
from fbgraph.session import replay_log

_SAME_M = 0.001
_LIVE_CHUNK_S = 0.1


def repeat_run(run: Path, log_path: Path | None = None) -> WalkResult:
    """The result that a run folder was written from, computed again.

    Args:
        run: the folder.
        log_path: where the log is now, if it has moved.

    Raises:
        DataError: not a run folder, the log is gone, or what comes out is another walk than the folder's.
    """
    saved = read_run(run)
    inputs = RunInputs.from_summary(saved.summary, run)
    config, told = saved.read_config(), read_told(inputs)
    chunk_s = inputs.online_chunk_s
    if inputs.log == RAW:
        chunk_s = chunk_s or _LIVE_CHUNK_S
    file = read_log_again(saved, log_path)
    log, told = with_places(file, told, inputs if log_path is None else replace(inputs, log=str(log_path)))
    if chunk_s is None:
        result = reconstruct(log, config, told, inputs)
    else:
        result = replace(replay_log(log, config, told, chunk_s=chunk_s), inputs=inputs)
    _require_same(saved, result)
    return result


def record_run(run: Path, out: Path | None = None, log_path: Path | None = None) -> Path:
    """Write the recording of a run again; returns where.

    Args:
        run: its folder.
        out: the file to write; the folder's ``recording.rrd`` if None.
        log_path: where the log is now, if it has moved.

    Raises:
        DataError: as ``repeat_run``.
        ConfigError: the file cannot be written.
    """
    from fbgraph.recording.recorder import write_recording  # rerun takes a second to import

    result = repeat_run(run, log_path)
    path = out or run / "recording.rrd"
    with ExitStack() as held:
        if out is None and not Path.cwd().is_relative_to(run.resolve()):
            held.enter_context(locked(run, make_parents=False))  # else a run that ends meanwhile takes it away
        partial = held.enter_context(whole_file(path))
        write_recording(result, partial, summary_markdown(summarize(result)))
    return path


def _require_same(saved: SavedRun, result: WalkResult) -> None:
    """Whether the walk that the folder's reader would believe came out again."""
    best = "smoothed" if "smoothed" in saved.trajectories else "ekf"
    before, again = saved.trajectories.get(best), result.trajectories.get(best)
    if (
        before is None
        or again is None
        or len(before) != len(again)
        or np.abs(again.xy_m - before.xy_m).max() >= _SAME_M
    ):
        raise DataError(
            f"{saved.folder}: smoothing its log again gives another walk than {best}.tum: the log, the files it was "
            "told of, or fbgraph itself has changed since; smooth the log again"
        )
