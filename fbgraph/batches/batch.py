"""Many logs from Python."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fbgraph.batches.log_entry import BatchOptions
from fbgraph.batches.run_batch import TIMEOUT_S, HowToRun, run_batch
from fbgraph.core.errors import ConfigError

if TYPE_CHECKING:
    import pandas as pd


def batch(
    logs: str | Path | Sequence[str | Path],
    *,
    out: str | Path,
    config: str | Path | None = None,
    overrides: Sequence[str] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    retries: int = 1,
    timeout_s: float | None = TIMEOUT_S,
    memory: int | None = None,
    recording: bool = True,
    **options: Any,
) -> pd.DataFrame:
    """Smooth many logs, several at a time; a script calls it under ``if __name__ == "__main__"``.

    Example:
        >>> index = fbgraph.batch("walks/", out="runs/all")
        >>> index[index.status == "failed"][["name", "cause", "reason"]]

    Args:
        logs: files, globs, folders, zips, addresses that fsspec knows, or manifests, as ``fbgraph batch`` takes them.
        out: the folder of the batch: ``runs/`` with a run folder for each log, ``index.parquet``, ``index.csv``.
        config: a preset or a TOML file, for all logs; the preset of each one's format if None.
        overrides: ``a.b=value`` strings, as ``--set`` takes them.
        workers: processes; one a core if None, none but this if 0.
        scheduler: address of a Dask scheduler, on whose workers it is done instead.
        resume: go on with the batch that is there: runs that are done and whole stay as they are.
        retries: how often what died or met a failing disk or network is tried again.
        timeout_s: after which a log is stopped; never if None.
        memory: bytes that a log may take; a share of the machine's if None.
        recording: whether to write ``recording.rrd`` too.
        options: ``format``, ``use_gnss``, ``closed_walk``, ``origin``, ``max_size``, ``forced``, ``layout``,
            ``rate_hz``, ``building``, ``building_axis``, for all logs.

    Returns:
        The index: a row a log, in their order, with summary, verdict, scores and timings, or why there is no run.

    Raises:
        ConfigError: options, logs or a folder that cannot be used.
    """
    named = [str(one) for one in ([logs] if isinstance(logs, str | Path) else logs)]
    preset = None if config is None else str(config)
    if unknown := set(options) - set(BatchOptions.__dataclass_fields__):
        raise ConfigError(f"unknown option {min(unknown)!r} of a batch")
    taken = BatchOptions(config=preset, overrides=tuple(overrides), recording=recording, **options)
    how = HowToRun(workers, scheduler, timeout_s, memory, retries, resume)
    return run_batch(named, str(out), taken, how).index
