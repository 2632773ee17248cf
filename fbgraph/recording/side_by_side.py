"""Several recordings side by side in one, under one timeline: the same question of each, left to right."""

from __future__ import annotations

import itertools
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.recording.blueprint import arranged
from fbgraph.recording.map_frame import Frame
from fbgraph.recording.tab_layout import question_tabs
from fbgraph.recording.writer import RrdWriter
from fbgraph.run.read_run import read_summary

RECORDING = "recording.rrd"


def recording_of(path: Path) -> Path:
    """The recording that a run folder or a file stands for.

    Raises:
        DataError: there is none.
    """
    if path.is_file():
        return path
    if (path / RECORDING).is_file():
        return path / RECORDING
    if path.is_dir():
        read_summary(path)  # or it is no run at all
        raise DataError(f"{path}: has no {RECORDING}; `fbgraph record {path}` writes it")
    raise DataError(f"{path}: no such run folder or recording")


def compare(paths: Sequence[Path], out: Path) -> None:
    """Write one recording that shows several.

    Args:
        paths: run folders or recordings.
        out: file to write.

    Raises:
        DataError: one of them is not a recording of fbgraph.
        OSError: the file cannot be written.
    """
    names = _names(paths)
    rrd = RrdWriter("-".join(names))
    entities: dict[str, set[str]] = {}
    seen = []
    for name, path in zip(names, paths, strict=True):
        chunks = _chunks(recording_of(path))
        entities[name] = {chunk.entity_path.lstrip("/") for chunk in chunks}
        seen.append(_places(chunks))
        rrd.copy(chunks, name)
    frame = replace(Frame.around(np.concatenate(seen)), legend=False)
    columns = {
        name: {str(tab.name): tab for tab in question_tabs(entities[name], frame, f"/{name}", narrow=True)}
        for name in names
    }
    questions = list(dict.fromkeys(question for column in columns.values() for question in column))
    views = (
        rrb.Horizontal(*(columns[name][question] for name in names if question in columns[name]), name=question)
        for question in questions
    )
    rrd.save(out, arranged(rrb.Tabs(*views)))


def require_walk(path: Path) -> None:
    """Whether this is a recording of a walk.

    Raises:
        DataError: it is not.
    """
    _chunks(path)


def _require_sound(path: Path) -> None:
    """Refuse a damaged recording; found out by a process of its own, for Rerun's reader ends the one it runs in.

    Raises:
        DataError: it is damaged.
    """
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(path.resolve())]
    if subprocess.run(command, capture_output=True).returncode:
        raise DataError(f"{path}: a damaged recording, or none; `fbgraph record RUN` writes a run's again")


def _chunks(path: Path) -> list[Chunk]:
    _require_sound(path)
    try:
        chunks = list(RrdReader(path).stream().to_chunks())
    except (RuntimeError, ValueError, OSError) as error:
        raise DataError(f"{path}: not a readable Rerun file: {str(error).splitlines()[0]}") from error
    if not any(chunk.entity_path.lstrip("/").startswith("map/") for chunk in chunks):
        raise DataError(f"{path}: not the recording of one walk by fbgraph, or damaged")
    return chunks


def _names(paths: Sequence[Path]) -> list[str]:
    """One for each, told apart: the run folder's or the file's, with a number if need be."""
    names: list[str] = []
    for path in paths:
        path = path.resolve()
        name = path.parent.name if path.name == RECORDING else path.stem if path.is_file() else path.name
        name = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
        numbered = (f"{name}_{number}" for number in itertools.count(2))
        names.append(name if name not in names else next(other for other in numbered if other not in names))
    return names


def _places(chunks: list[Chunk]) -> FloatArray:
    """(N, 2) points of all paths and of the legend on the map."""
    found = [np.zeros((1, 2))]
    for chunk in chunks:
        path = chunk.entity_path.lstrip("/")
        if path.startswith("map/") and path.endswith(("/path", "/colors")):
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                if name in ("LineStrips2D:strips", "Points2D:positions"):
                    column = batch.column(name)
                    while not pa.types.is_floating(column.type):
                        column = column.flatten()
                    found.append(np.asarray(column, dtype=float).reshape(-1, 2))
    return np.concatenate(found)
