"""One function on many items, several at a time: the one engine of batches, calibrations and measurements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from typing import Protocol, TypeVar

from fbgraph.core.errors import ConfigError
from fbgraph.workers.dask_cluster import ClusterPool, cluster
from fbgraph.workers.limits import cores, share_of_memory
from fbgraph.workers.outcome import AGAIN, Item, Outcome, Value, attempt
from fbgraph.workers.processes import LocalPool

_WINDOW = 3
"""Items that are handed out for each process: one in work, others on their way, none of the rest in memory."""
_POLL_S = 1.0


_Item = TypeVar("_Item", contravariant=True)


class _Pool(Protocol[_Item, Value]):
    def submit(self, item: _Item) -> Future[Outcome[Value]]: ...

    def settled(self, future: Future[Outcome[Value]]) -> Outcome[Value] | None: ...


def run_tasks(
    function: Callable[[Item], Value],
    items: Iterable[Item],
    workers: int | None = None,
    timeout: float | None = None,
    scheduler: str | None = None,
    *,
    memory: int | None = None,
    retries: int = 0,
    preload: Sequence[str] = (),
) -> Iterator[Outcome[Value]]:
    """Call a function on every item, each in a process that can be stopped; outcomes as they come.

    An item whose function raises, hangs, eats memory or kills its process is an outcome with a cause and a reason, and
    stops no other. Leaving the loop early ends all processes. Results do not depend on how many processes there are.

    Example:
        >>> rmse_m = [one.value for one in run_tasks(score, paths) if not one.cause]

    Args:
        function: of a module (not a lambda); a script's own is called under ``if __name__ == "__main__"``.
        items: picklable; taken as they are needed.
        workers: how many processes; one a core if None. With 0 all is done in this process, which nothing can stop.
        timeout: seconds after which an item is given up; never if None.
        scheduler: address of a Dask scheduler, whose workers are then used, one item a thread of theirs.
        memory: bytes that an item may take; each process an equal share of nine tenths of the machine's if None.
        retries: how often what died or met a failing disk or network is tried again.
        preload: names of modules that processes start with; that of the function if none.

    Yields:
        An ``Outcome`` an item, in the order in which they end; ``number`` says which it is.

    Raises:
        ConfigError: no process can be started, or no such cluster.
    """
    if scheduler is not None and workers is not None:
        raise ConfigError("--workers are those of this machine; a --scheduler has its own")
    if workers is not None and workers < 0:
        raise ConfigError(f"--workers {workers}: expected 1 or more, or 0 for this process alone")
    if workers == 0:
        yield from _here(function, items, retries)
    elif scheduler is not None:
        with cluster(scheduler) as (executor, threads):
            shared: ClusterPool[Item, Value] = ClusterPool(executor, function, timeout, memory, preload)
            yield from _outcomes(shared, items, _WINDOW * threads, retries)
    else:
        count = workers or cores()
        share = share_of_memory(count) if memory is None else memory
        with _stopping(LocalPool(function, count, timeout, share, preload)) as pool:
            yield from _outcomes(pool, items, _WINDOW * count, retries)


@contextmanager
def _stopping(pool: LocalPool[Item, Value]) -> Iterator[LocalPool[Item, Value]]:
    """A pool that is stopped when the block ends, in whatever way."""
    try:
        yield pool
    except (KeyboardInterrupt, SystemExit):
        pool.start_no_more()
        raise
    finally:
        pool.stop()


def _here(function: Callable[[Item], Value], items: Iterable[Item], retries: int) -> Iterator[Outcome[Value]]:
    for number, item in enumerate(items):
        tries, outcome = 1, attempt(function, item)
        while outcome.cause in AGAIN and tries <= retries:
            tries, outcome = tries + 1, attempt(function, item)
        yield outcome.tried(number, tries)


def _outcomes(pool: _Pool[Item, Value], items: Iterable[Item], window: int, retries: int) -> Iterator[Outcome[Value]]:
    """Of all items, so many of them handed out at a time."""
    coming = enumerate(items)
    waiting: dict[Future[Outcome[Value]], tuple[int, Item, int]] = {}
    while True:
        while len(waiting) < window and (following := next(coming, None)) is not None:
            number, item = following
            waiting[pool.submit(item)] = (number, item, 1)
        if not waiting:
            return
        for future in wait(waiting, _POLL_S, FIRST_COMPLETED).done:
            number, item, tries = waiting.pop(future)
            outcome = pool.settled(future)
            if outcome is None:
                waiting[pool.submit(item)] = (number, item, tries)
            elif outcome.cause in AGAIN and tries <= retries:
                waiting[pool.submit(item)] = (number, item, tries + 1)
            else:
                yield outcome.tried(number, tries)
