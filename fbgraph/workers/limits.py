"""What a worker process may take, and that it ends with whoever started it."""

from __future__ import annotations

import os
import resource
import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import parent_process
from pathlib import Path

LEAST_BYTES = 1 << 30
"""Of memory, for a process: what it imports takes a third of it."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def share_of_memory(workers: int) -> int:
    """Bytes of memory that each of so many processes may take, nine tenths of the machine's in all."""
    whole = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    control = Path("/sys/fs/cgroup/memory.max")  # a container's own
    if control.is_file() and (text := control.read_text("ascii").strip()).isdecimal():
        whole = min(whole, int(text))
    return max(int(0.9 * whole) // max(workers, 1), LEAST_BYTES)


def prepare_worker(modules: Sequence[str], memory_bytes: int | None) -> None:
    """In a worker as it begins: end when told, and with the process that started it; take no more than this.

    Args:
        modules: imported before the first item, whose time they do not take; most are there, as it was forked.
        memory_bytes: beyond what it has then; any if None.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # at once, whatever a solver is at; whole writes bear it
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    for module in modules:
        import_module(module)
    if memory_bytes is not None:
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = _reserved_bytes() + memory_bytes
        resource.setrlimit(resource.RLIMIT_DATA, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _reserved_bytes() -> int:
    """What this process has set aside already; libraries do with much more than they use."""
    try:
        return int(Path("/proc/self/statm").read_text("ascii").split()[5]) * resource.getpagesize()
    except OSError:  # not Linux
        return 0


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes started meanwhile do their linear algebra on one core: there is one of them a core."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
