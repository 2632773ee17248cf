"""The same pool on a cluster: Dask carries items to its workers, each of which has processes that can be stopped."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from threading import Lock
from typing import TYPE_CHECKING, Any, Generic

from fbgraph import __version__
from fbgraph.core.errors import ConfigError
from fbgraph.workers.limits import share_of_memory
from fbgraph.workers.outcome import Item, Outcome, Value, died
from fbgraph.workers.processes import LocalPool

if TYPE_CHECKING:
    from distributed import Client

_ANSWER_S = 30.0
_POOLS: dict[bytes, tuple[LocalPool[Any, Any], list[Future[Outcome[Any]]]]] = {}
"""Of this Dask worker, each with what it is at."""
_STARTING = Lock()


class ClusterPool(Generic[Item, Value]):
    """A Dask cluster that does with items what a ``LocalPool`` does."""

    def __init__(
        self,
        executor: Executor,
        function: Callable[[Item], Value],
        timeout_s: float | None,
        memory_bytes: int | None,
        preload: Sequence[str] = (),
    ) -> None:
        """Of a cluster's executor; the others as of ``LocalPool``."""
        self._executor, self._function = executor, function
        self._limits, self._preload = (timeout_s, memory_bytes), tuple(preload)

    def submit(self, item: Item) -> Future[Outcome[Value]]:
        """Let the next free process call the function on an item."""
        return self._executor.submit(_on_worker, self._function, item, self._limits, self._preload)

    def settled(self, future: Future[Outcome[Value]]) -> Outcome[Value] | None:
        """What became of an item."""
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker:
            return died("every Dask worker that began with it ended")


@contextmanager
def cluster(scheduler: str) -> Iterator[tuple[Executor, int]]:
    """The executor of a Dask cluster, and how many threads its workers have.

    Args:
        scheduler: its address, ``tcp://HOST:PORT``.

    Raises:
        ConfigError: Dask is not installed, nobody answers, no worker comes, or one has another fbgraph.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigError("--scheduler needs Dask: pip install 'fbgraph[cluster]'") from error
    try:
        client = Client(scheduler, timeout=_ANSWER_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(
            f"--scheduler {scheduler}: no Dask scheduler answers there ({error}); `dask scheduler` starts one and says "
            "its address"
        ) from error
    with client:
        _require_same_everywhere(client, scheduler)
        yield client.get_executor(pure=False), sum(client.nthreads().values())


def _require_same_everywhere(client: Client, scheduler: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_ANSWER_S)
    except TimeoutError as error:
        raise ConfigError(f"--scheduler {scheduler}: no worker there; `dask worker {scheduler}` starts some") from error
    try:
        versions = client.run(_version)
    except Exception as error:
        raise ConfigError(
            f"--scheduler {scheduler}: a worker cannot import fbgraph ({error}); install it where `dask worker` runs"
        ) from error
    if other := next((where for where, found in versions.items() if found != __version__), None):
        raise ConfigError(
            f"--scheduler {scheduler}: the worker {other} has fbgraph {versions[other]}, here it is {__version__}: "
            "install the same"
        )


def _version() -> str:
    return __version__


def _on_worker(
    function: Callable[[Item], Value],
    item: Item,
    limits: tuple[float | None, int | None],
    preload: tuple[str, ...],
) -> Outcome[Value]:
    """In a thread of a Dask worker: hand an item to a process beside it, which can be stopped."""
    from distributed import get_worker

    threads, (timeout_s, memory_bytes) = int(get_worker().state.nthreads), limits
    if memory_bytes is None:
        limit = get_worker().memory_manager.memory_limit  # what `dask worker` says, or finds
        memory_bytes = int(limit / threads) if limit else share_of_memory(threads)
    key = pickle.dumps((function, timeout_s, memory_bytes))  # a partial equals itself alone
    with _STARTING:
        if key not in _POOLS:
            for other in [other for other, (_, busy) in _POOLS.items() if not busy]:  # of batches that are over
                _POOLS.pop(other)[0].stop()
            _POOLS[key] = LocalPool(function, threads, timeout_s, memory_bytes, preload), []
        pool, busy = _POOLS[key]
        future = pool.submit(item)
        busy.append(future)
    while (outcome := pool.settled(future)) is None:
        with _STARTING:
            busy.remove(future)
            future = pool.submit(item)
            busy.append(future)
    with _STARTING:
        busy.remove(future)
    return outcome
