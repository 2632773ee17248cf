"""Several runs read at once, each with its name and its truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers.places import read_checkpoints
from fbgraph.run.evaluation import NamedRun
from fbgraph.run.log_again import read_truth_again
from fbgraph.run.read_run import SavedRun, on_its_clock, read_run


def named_runs(
    runs: Sequence[Path],
    truths: Sequence[Path] = (),
    tell: Callable[[str], None] = lambda text: None,
    lost_is_unknown: bool = False,
) -> list[NamedRun]:
    """Read runs, each with its truth.

    Args:
        runs: their folders.
        truths: one file for all of them, or one for each in their order; the truth that each was made with if none.
        tell: told what was assumed of truth.
        lost_is_unknown: whether a run whose own truth is no longer there counts as one without, which is told.

    Raises:
        ConfigError: a folder named twice, or as many truths as belong to nobody knows which.
        DataError: a file that cannot be used.
    """
    if len(truths) not in (0, 1, len(runs)):
        raise ConfigError(
            f"{len(truths)} --truth for {len(runs)} runs: name one for all, or one for each in their order"
        )
    real = Counter(run.resolve() for run in runs)
    if twice := [run for run in runs if real[run.resolve()] > 1]:
        raise ConfigError(f"{twice[0]}: named twice")
    called = Counter(run.resolve().name for run in runs)
    read = [read_checkpoints(path) for path in truths]
    found, notices = [], []
    for k, run in enumerate(runs):
        saved = read_run(run)
        try:
            truth = on_its_clock(saved, read[min(k, len(read) - 1)]) if read else _own_truth(saved)
        except DataError as error:
            if read or not lost_is_unknown:
                raise
            notices.append(f"drawn without truth: {error}")
            truth = None
        notices += [] if truth is None else truth.notices
        found.append(NamedRun(name if called[name := run.resolve().name] == 1 else str(run), saved, truth))
    for notice in dict.fromkeys(notices):
        tell(notice)
    return found


def _own_truth(run: SavedRun) -> Checkpoints | None:
    """The truth that a run was made with; None if there was none."""
    if run.summary.get("truth") is None:
        return None
    try:
        return read_truth_again(run)
    except DataError as error:
        raise DataError(f"{error}; the truth that {run.folder} was made with: name it with --truth FILE") from error
