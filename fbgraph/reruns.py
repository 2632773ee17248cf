"""Makes a run's result again from its folder: the log it names, its configuration, and what it was told."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from fbgraph.core.config import load_config
from fbgraph.core.errors import DataError
from fbgraph.core.georeference import Georeference
from fbgraph.core.trajectory import read_tum
from fbgraph.pipeline import reconstruct
from fbgraph.run.folder import RAW, read_summary, summarize, summary_markdown
from fbgraph.run.result import WalkResult

_SAME_M = 0.001


def again(run: Path, log_path: Path | None = None) -> WalkResult:
    """The result that a run folder was written from, computed again.

    Args:
        run: the folder.
        log_path: where the log is now, if it has moved.

    Raises:
        DataError: not a run folder, the log is gone, or what comes out is another walk than the folder's.
    """
    from fbgraph import session
    from fbgraph.core.checkpoints import read_checkpoints
    from fbgraph.readers import read_log

    summary = read_summary(run)
    inputs = summary.get("inputs") or {}
    if not inputs.get("log"):
        raise DataError(f"{run}: written by an earlier fbgraph, which did not note its log; smooth the log again")
    config = load_config(str(run / "config.toml"))
    truth = read_checkpoints(Path(inputs["truth"])) if inputs.get("truth") else None
    anchors = read_checkpoints(Path(inputs["anchors"])) if inputs.get("anchors") else None
    origin = Georeference(*inputs["origin"]) if inputs.get("origin") else None
    closed_walk, chunk_s = bool(inputs.get("closed_walk")), inputs.get("online_chunk_s")
    if inputs["log"] == RAW:
        log, chunk_s = session.saved_log(run / RAW), chunk_s or 0.1
    else:
        path = log_path or Path(inputs["log"])
        if not path.exists():
            where = f"--log {path}: no such file" if log_path else f"its log {path} is not there any more"
            raise DataError(f"{run}: {where}; say where it is now with --log")
        log_file = read_log(path, inputs.get("format"))
        log, truth = log_file.log, truth or log_file.truth
    if inputs.get("until_s") is not None:
        log = log.between(-np.inf, float(inputs["until_s"]))
    if chunk_s is None:
        result = reconstruct(log, config, truth, anchors, closed_walk, origin, inputs)
    else:
        result = session.replay(
            log,
            config,
            chunk_s=float(chunk_s),
            speed=np.inf,
            on_update=lambda update: None,
            stop=lambda: False,
            truth=truth,
            anchors=anchors,
            closed_walk=closed_walk,
            origin=origin,
            inputs=inputs,
        )
        result = replace(result, inputs=inputs)
    _require_same(run, result)
    return result


def record(run: Path, out: Path | None = None, log_path: Path | None = None) -> Path:
    """Write the recording of a run again; returns where.

    Args:
        run: its folder.
        out: the file to write; the folder's ``recording.rrd`` if None.
        log_path: where the log is now, if it has moved.

    Raises:
        DataError: as ``again``.
        OSError: the file cannot be written.
    """
    from fbgraph.recording.recorder import write_recording

    result = again(run, log_path)
    path = out or run / "recording.rrd"
    with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
        partial = Path(folder) / path.name
        write_recording(result, partial, summary_markdown(summarize(result)))
        partial.replace(path)
    return path


def _require_same(run: Path, result: WalkResult) -> None:
    """Whether the folder's smoothed walk came out again."""
    smoothed, saved = result.smoothed.trajectory, read_tum(run / "smoothed.tum")
    same = len(smoothed) == len(saved) and np.abs(smoothed.xy_m - saved.xy_m).max() < _SAME_M
    if not same:
        raise DataError(
            f"{run}: smoothing its log again gives another walk than smoothed.tum: the log, the files it was told of, "
            "or fbgraph itself has changed since; smooth the log again"
        )
