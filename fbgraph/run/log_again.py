"""The log of a run, and the truth it was scored against, read again from where its summary says they are."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.errors import DataError
from fbgraph.readers import read_log
from fbgraph.readers.cleaning import LogFile
from fbgraph.readers.places import gnss_of, read_checkpoints
from fbgraph.readers.raw_recorder import saved_log
from fbgraph.run.folder import RAW
from fbgraph.run.inputs import RunInputs
from fbgraph.run.read_run import SavedRun, on_its_clock


def read_log_again(run: SavedRun, log_path: Path | None = None) -> LogFile:
    """The log that a run was made from, as far as it was walked then.

    Args:
        run: the run.
        log_path: where the log is now, if it has moved.

    Raises:
        DataError: the log was no file, is gone, or cannot be read.
    """
    inputs = RunInputs.from_summary(run.summary, run.folder)
    if inputs.log == RAW:
        file = LogFile(saved_log(run.folder / RAW), None)
    else:
        path = log_path or Path(str(inputs.log))
        if not path.exists():
            where = f"--log {path}: no such file" if log_path else f"its log {path} is not there any more"
            raise DataError(f"{run.folder}: {where}; say where it is now with --log")
        file = read_log(path, inputs.format, inputs.max_size, layout=inputs.layout, rate_hz=inputs.rate_hz)
    return file if inputs.until_s is None else replace(file, log=file.log.between(-math.inf, inputs.until_s))


def read_truth_again(run: SavedRun, log_path: Path | None = None) -> Checkpoints:
    """The truth that a run was scored against, in the frame in which it was.

    Args:
        run, log_path: as in ``read_log_again``.

    Raises:
        DataError: there was none, or it cannot be read any more.
    """
    inputs = RunInputs.from_summary(run.summary, run.folder)
    if inputs.truth is None:
        file = read_log_again(run, log_path)
        truth = file.gnss if file.truth is None else file.truth
    else:
        truth = read_checkpoints(inputs.truth)
    if truth is None or run.summary.get("truth") is None:
        raise DataError(f"{run.folder}: this run was given no truth; `fbgraph smooth LOG --truth FILE` takes it")
    anchors = None if inputs.anchors is None else read_checkpoints(inputs.anchors)
    if inputs.use_gnss != "none":
        anchors = read_log_again(run, log_path).gnss or gnss_of(log_path or Path(str(inputs.log)))
    anchors = None if anchors is None else on_its_clock(run, anchors)
    return on_its_clock(run, truth).in_frame_of(anchors)
