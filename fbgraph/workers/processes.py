"""A pool of processes of which each can be stopped without the others: pebble's, begun anew should it break."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import forkserver
from typing import Generic

from pebble import ProcessExpired, ProcessPool

from fbgraph.core.errors import ConfigError
from fbgraph.workers.limits import one_thread_each, prepare_worker
from fbgraph.workers.outcome import Item, Outcome, Value, attempt, died, stopped

_MOST_TASKS = 200
"""After so many a process makes place for a fresh one, and memory that a library kept goes with it."""
_MOST_BREAKS = 3


def warm_up(modules: Sequence[str]) -> None:
    """Let the process that workers are forked from import what they need, while this one does something else."""
    with one_thread_each():
        forkserver.set_forkserver_preload(list(modules))
        forkserver.ensure_running()


class LocalPool(Generic[Item, Value]):
    """So many processes, each with one item at a time. They are forked from one that has imported what they need."""

    def __init__(
        self,
        function: Callable[[Item], Value],
        workers: int,
        timeout_s: float | None,
        memory_bytes: int | None,
        preload: Sequence[str] = (),
    ) -> None:
        """A pool whose processes start with the first item.

        Args:
            function: importable by its module's name.
            workers: how many processes.
            timeout_s: after which the process of an item is ended; never if None.
            memory_bytes: that a process may take beyond what it starts with; any if None.
            preload: modules that processes start with; that of the function if none.
        """
        self._function, self._workers, self._timeout_s = function, workers, timeout_s
        self._memory_bytes, self._preload = memory_bytes, tuple(preload)
        self._breaks = 0
        self._pool = self._new_pool()

    def _new_pool(self) -> ProcessPool:
        context = multiprocessing.get_context("forkserver")
        module = getattr(self._function, "func", self._function).__module__  # of what a partial calls
        modules = [name for name in self._preload or (module,) if name != "__main__"]
        context.set_forkserver_preload(modules)  # in vain where one runs already, for other modules
        if multiprocessing.current_process().daemon:  # as a Dask worker is: ours end with it all the same
            multiprocessing.current_process().daemon = False
        return ProcessPool(self._workers, _MOST_TASKS, prepare_worker, (modules, self._memory_bytes), context)

    def submit(self, item: Item) -> Future[Outcome[Value]]:
        """Let the next free process call the function on an item.

        Raises:
            ConfigError: no process can be started.
        """
        with one_thread_each():
            if self._breaks and not self._pool.active:
                self._begin_anew()
            future: Future[Outcome[Value]] = self._pool.schedule(
                attempt, args=(self._function, item), timeout=self._timeout_s
            )
            return future

    def _begin_anew(self) -> None:
        self.stop()
        if self._breaks > _MOST_BREAKS:
            raise ConfigError(
                "no process can be started to work in: a script that asks for several must do so under "
                'if __name__ == "__main__", and there must be memory for them'
            )
        self._pool = self._new_pool()

    def settled(self, future: Future[Outcome[Value]]) -> Outcome[Value] | None:
        """What became of an item; None if its process never began with it, and it is to be submitted again."""
        try:
            outcome = future.result()
        except TimeoutError:
            outcome = stopped(self._timeout_s or 0.0)
        except ProcessExpired as error:
            outcome = died(_how_it_ended(error.exitcode))
        except BrokenProcessPool:
            self._breaks += 1
            return None
        self._breaks = 0
        return outcome

    def start_no_more(self) -> None:
        """End the process that others are forked from, lest it start one that nobody awaits; a new pool has its own."""
        server = getattr(forkserver._forkserver, "_forkserver_pid", None)
        with suppress(ProcessLookupError):
            if server is not None:
                os.kill(server, signal.SIGKILL)

    def stop(self) -> None:
        """End all processes, whatever they are at."""
        self._pool.stop()
        if (starting := self._pool._pool_manager_loop) is not None:
            starting.join()
        for process in list(self._pool._pool_manager.worker_manager.workers.values()):
            process.kill()  # before what they read from is closed: who is only starting would complain of that
        self._pool.join()


def _how_it_ended(code: int) -> str:
    if code >= 0:
        return f"its process ended with code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    why = {"SIGKILL": ": killed, perhaps for want of memory", "SIGABRT": ": it gave up, perhaps for want of memory"}
    return f"its process was ended by {name}{why.get(name, '')}"
