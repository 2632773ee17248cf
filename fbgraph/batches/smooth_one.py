"""What a worker does with one log of a batch: smooth it into its run folder, unless that is done and whole."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fbgraph import __version__
from fbgraph.batches.index_row import row_of
from fbgraph.batches.log_entry import RUNS, BatchTask
from fbgraph.batches.places import fetched, is_address, joined, names_at, put_folder, version_of
from fbgraph.core.errors import DataError, FbgraphError
from fbgraph.core.tables import read_text
from fbgraph.pipeline import read_walk, reconstruct, write_files
from fbgraph.run.digests import SUMMARY
from fbgraph.run.folder import BATCH_NOTE, claimed_run
from fbgraph.run.inputs import RunInputs
from fbgraph.run.read_run import read_run

_RECORDING = "recording.rrd"
_FILES = ("log", "truth", "anchors", "layout", "building")


def smooth_one(task: BatchTask) -> tuple[dict[str, Any], bool]:
    """Smooth a log of a batch.

    Args:
        task: the log, and where its run goes.

    Returns:
        Its row of the index, and whether that is of a run that was there already.

    Raises:
        ConfigError, DataError: as ``fbgraph smooth`` would say.
    """
    key, run = task_key(task), joined(task.out, RUNS, task.entry.name)
    if task.resume and (row := kept_row(run, key)) is not None:
        return row, True
    with TemporaryDirectory(prefix="fbgraph-") as scratch:
        local, noted, config = _inputs(task, Path(scratch))
        place = Path(scratch) / "run" / task.entry.name if is_address(run) else Path(run)
        with _places_told(scratch, local, noted):
            row = _smoothed(task, local, noted, config, place, key)
        if is_address(run):
            put_folder(place, run, last=SUMMARY)
    return row, False


def _smoothed(
    task: BatchTask, local: RunInputs, noted: RunInputs, config: str | None, place: Path, key: str
) -> dict[str, Any]:
    """Read, reconstruct and write; the row."""
    begun, cpu = time.perf_counter(), time.process_time()
    log, effective, told = read_walk(local, config, task.options.overrides)
    read = time.perf_counter()
    with claimed_run(place, (noted, effective), force=True) as claim:
        result = replace(reconstruct(log, effective, told, local), inputs=noted)
        solved = time.perf_counter()
        with claim.written() as partial:
            summary = write_files(result, partial, task.options.recording)
            now = time.perf_counter()
            row = row_of(task.entry, summary, read - begun, now - solved, now - begun, time.process_time() - cpu)
            recording = partial / _RECORDING
            size = recording.stat().st_size if recording.is_file() else None
            write_note(partial, key, row, size)
    return row


def _inputs(task: BatchTask, scratch: Path) -> tuple[RunInputs, RunInputs, str | None]:
    """What is read here, what the run notes that it was read from, and the configuration."""
    entry, options = task.entry, task.options
    places = {
        "log": entry.log,
        "truth": entry.truth,
        "anchors": entry.anchors,
        "layout": options.layout,
        "building": options.building,
        "config": entry.config or options.config,
    }
    here: dict[str, Path | None] = {}
    for name, place in places.items():
        (folder := scratch / name).mkdir()
        away = place is not None and (name != "config" or is_address(place))
        here[name] = fetched(place, folder, options.max_size) if place is not None and away else None
    config = places["config"] if here["config"] is None else str(here["config"])
    local = options.inputs(**{name: here[name] for name in _FILES})
    log, truth, anchors, layout, building = (
        places[name] if is_address(places[name] or "") else getattr(local, name) for name in _FILES
    )
    return local, replace(local, log=log, truth=truth, anchors=anchors, layout=layout, building=building), config


@contextmanager
def _places_told(scratch: str, local: RunInputs, noted: RunInputs) -> Iterator[None]:
    """Errors name places as the user does, not the copies that are read."""
    try:
        yield
    except FbgraphError as error:
        text = str(error)
        for name in _FILES:
            copy, place = getattr(local, name), getattr(noted, name)
            if copy != place:
                text = text.replace(str(copy), str(place))
        raise type(error)(text.replace(f"{scratch}/", "")) from error


def task_key(task: BatchTask) -> str:
    """What a run was made from, in short: log, options, the files they name as they are now, and this fbgraph."""
    entry, options = task.entry, task.options
    files = (entry.log, entry.truth, entry.anchors, options.layout, options.building)
    config = entry.config or options.config
    content = {
        "entry": asdict(entry),
        "options": options.as_dict(),
        "files": [version_of(place) if place else "" for place in files],
        "config": version_of(config) if config and config.endswith(".toml") else "",
        "fbgraph": __version__,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def write_note(folder: Path, key: str, row: dict[str, Any], recording_bytes: int | None) -> None:
    """Leave in a run folder what the index says of it, and what it was made from."""
    note = {"key": key, "recording_bytes": recording_bytes, "row": row}
    note["sha256"] = _digest(note)
    (folder / BATCH_NOTE).write_text(json.dumps(note, indent=1) + "\n", "utf-8")


def _digest(note: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(note, sort_keys=True).encode()).hexdigest()


def kept_row(run: str, key: str) -> dict[str, Any] | None:
    """The row of a run that is made from the same and whole, every file as it was written; None if it is not.

    Args:
        run: its place.
        key: as ``task_key`` says now.
    """
    if BATCH_NOTE not in names_at(run):
        return None
    with TemporaryDirectory(prefix="fbgraph-") as scratch:
        try:
            folder = fetched(run, Path(scratch))
            note = json.loads(read_text(folder / BATCH_NOTE, "JSON"))
            sha256, row = note.pop("sha256"), note["row"]
            if note["key"] != key or sha256 != _digest(note):
                return None
            recording = folder / _RECORDING
            if note["recording_bytes"] is not None and note["recording_bytes"] != recording.stat().st_size:
                return None
            read_run(folder).read_config()
        except (DataError, OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
    return dict(row)
