"""A batch from its logs to its index: which there are, what is done already, the rest in workers, the index."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from fbgraph import __version__
from fbgraph.batches.index import INDEX, INDEX_CSV, Rows, index_frame, write_index
from fbgraph.batches.index_row import DONE, failed_row
from fbgraph.batches.log_entry import MANIFEST, OPTIONS, RUNS, BatchOptions, BatchTask, LogEntry
from fbgraph.batches.manifest import manifest_text, read_manifest
from fbgraph.batches.places import fetched, held, is_address, joined, names_at, settled, written_file
from fbgraph.batches.which_logs import Tell, find_logs, named_entries
from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.tables import read_text
from fbgraph.core.whole_writes import clear_leftovers_in, is_leftover
from fbgraph.workers.processes import warm_up
from fbgraph.workers.run_tasks import run_tasks

if TYPE_CHECKING:
    import pandas as pd

_BATCH_FILES = {RUNS, MANIFEST, OPTIONS, INDEX, INDEX_CSV, "report.html", "compared.html"}
_PRELOAD = ("fbgraph.batches.smooth_one", "pandas")  # which reading needs
TIMEOUT_S = 3600.0
"""Of one log, if nothing else is said: a day's walk takes half of it."""


@dataclass(frozen=True)
class Progress:
    """How far a batch has come.

    Attributes:
        done, failed, kept: logs with a run, without one, and of the first those that were there already.
        total: all of them.
        seconds: since the batch began.
    """

    total: int
    done: int = 0
    failed: int = 0
    kept: int = 0
    seconds: float = 0.0

    @property
    def over(self) -> int:
        """Logs that have come to their end."""
        return self.done + self.failed

    @property
    def rate_hz(self) -> float:
        """Logs a second that were worked on."""
        return (self.over - self.kept) / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def count_text(self) -> str:
        """``812 of 2,000``."""
        return f"{self.over:,} of {self.total:,}"

    @property
    def pace_text(self) -> str:
        """``4.1/s, 9 failed, 0:04:51 left``."""
        told = [f"{self.rate_hz:.2g}/s" if self.rate_hz >= 1.0 else f"{60.0 * self.rate_hz:.2g}/min"]
        told += [f"{self.failed:,} failed"] if self.failed else []
        if self.rate_hz > 0.0:
            told.append(f"{timedelta(seconds=round((self.total - self.over) / self.rate_hz))} left")
        return ", ".join(told)


@dataclass(frozen=True)
class Batch:
    """A batch that has come to its end.

    Attributes:
        out: its place.
        index: a row a log.
        progress: at its end.
    """

    out: str
    index: pd.DataFrame
    progress: Progress


@dataclass(frozen=True)
class HowToRun:
    """Where and how the logs of a batch are worked on; as ``run_tasks`` takes it.

    Attributes:
        workers, scheduler, memory, retries: as there.
        timeout_s: of one log.
        resume: go on with the batch that is there.
    """

    workers: int | None = None
    scheduler: str | None = None
    timeout_s: float | None = TIMEOUT_S
    memory: int | None = None
    retries: int = 1
    resume: bool = False


def run_batch(
    logs: Sequence[str],
    out: str,
    options: BatchOptions | None = None,
    how: HowToRun | None = None,
    tell: Tell = lambda text: None,
    progress: Callable[[Progress], None] = lambda so_far: None,
) -> Batch:
    """Smooth many logs.

    Args:
        logs: as ``find_logs`` takes them; those of the batch that is resumed if none.
        out: place of the batch: a folder, or an address that fsspec knows.
        options: as ``fbgraph smooth`` takes them.
        how: with how many workers, and when to give up.
        tell: told what was assumed.
        progress: told whenever a log has come to its end.

    Raises:
        ConfigError: options, logs or a place that cannot be used.
        DataError: a manifest that cannot be read.
    """
    options, how, out = _lasting(options or BatchOptions()), how or HowToRun(), settled(out)
    if options.config is None or not is_address(options.config):
        load_config(options.config, options.overrides)  # a wrong option is told before any log is read
    building = None if options.building is None or is_address(options.building) else Path(options.building)
    inputs = options.inputs(building=building)
    if building is not None or options.building is None:
        inputs.building_told()
    begun = time.monotonic()
    if how.workers != 0 and how.scheduler is None:
        warm_up(_PRELOAD)
    with held(out):
        before = _before(out, how.resume, options)
        found = find_logs(logs, tell) if logs else list(before)
        if not found:
            raise ConfigError("no logs: name files, globs, folders, zips or a manifest")
        entries = named_entries(found, before)
        _require_workers_see(entries, out, how)
        _keep(out, OPTIONS, json.dumps({"fbgraph": __version__, "options": options.as_dict()}, indent=2) + "\n")
        _keep(out, MANIFEST, manifest_text(entries))
        rows, so_far = Rows(len(entries)), Progress(len(entries))
        progress(so_far)
        with _without_leftovers(out):
            tasks = (BatchTask(entry, options, out, how.resume) for entry in entries)
            for outcome in run_tasks(
                _smooth,
                tasks,
                how.workers,
                how.timeout_s,
                how.scheduler,
                memory=how.memory,
                retries=how.retries,
                preload=_PRELOAD,
            ):
                row, kept = outcome.value or (failed_row(entries[outcome.number], outcome), False)
                rows.put(outcome.number, row if kept else {**row, "tries": outcome.tries})
                done = row["status"] == DONE
                so_far = replace(
                    so_far,
                    done=so_far.done + done,
                    failed=so_far.failed + (not done),
                    kept=so_far.kept + kept,
                    seconds=time.monotonic() - begun,
                )
                progress(so_far)
        frame = index_frame(rows)
        write_index(frame, out)
    return Batch(out, frame, so_far)


def _smooth(task: BatchTask) -> tuple[dict[str, Any], bool]:
    from fbgraph.batches.smooth_one import smooth_one  # who hands out tasks needs no solver

    return smooth_one(task)


def _lasting(options: BatchOptions) -> BatchOptions:
    """Places of files that mean the same from anywhere; of ``config`` only where it is no preset."""
    config = options.config
    if config is not None and (is_address(config) or config.endswith(".toml")):
        config = settled(config)
    layout, building = (None if one is None else settled(one) for one in (options.layout, options.building))
    return replace(options, config=config, layout=layout, building=building)


def _before(out: str, resume: bool, options: BatchOptions) -> list[LogEntry]:
    """The logs of the batch that is there; none if there is none.

    Raises:
        ConfigError: something else is there, a batch that is not to be resumed, or one with other options.
    """
    there = {name for name in names_at(out) if not is_leftover(name)}
    if not there:
        return []
    if there - _BATCH_FILES or (MANIFEST not in there and RUNS in there):
        raise ConfigError(f"--out {out}: exists and is not a batch; name another, or remove it")
    if not resume:
        raise ConfigError(f"--out {out}: holds a batch; --resume goes on with it, or name another")
    with TemporaryDirectory(prefix="fbgraph-") as folder:
        try:
            noted = json.loads(read_text(fetched(joined(out, OPTIONS), Path(folder)), "JSON"))["options"]
            entries = read_manifest(fetched(joined(out, MANIFEST), Path(folder))) if MANIFEST in there else []
        except (DataError, OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"--resume: the batch in {out} is damaged ({error}); name another folder") from error
    if other := options.first_difference(noted):
        option = {"overrides": "set", "closed_walk": "closed-loop", "rate_hz": "rate", "forced": "force"}.get(
            other, other
        )
        raise ConfigError(
            f"--resume: the batch in {out} was begun with another --{option.replace('_', '-')}; say the same again, or "
            "name another folder"
        )
    return entries


def _require_workers_see(entries: Sequence[LogEntry], out: str, how: HowToRun) -> None:
    """Refuse what only this process has where others are to work on it."""
    alone = how.workers == 0 and how.scheduler is None
    if not alone and (mine := [place for place in (out, *(one.log for one in entries)) if place.startswith("memory:")]):
        raise ConfigError(f"{mine[0]}: is in the memory of this process alone; --workers 0 works in it")


def _keep(out: str, name: str, text: str) -> None:
    with written_file(joined(out, name)) as partial:
        partial.write_text(text, "utf-8", "surrogateescape")


@contextmanager
def _without_leftovers(out: str) -> Iterator[None]:
    """What a worker that was stopped, now or before, left beside the runs is cleared away."""
    try:
        _clear(out)
        yield
    finally:
        _clear(out)


def _clear(out: str) -> None:
    folder = Path(out, RUNS)
    if is_address(out) or not folder.is_dir():
        return
    clear_leftovers_in(folder)
