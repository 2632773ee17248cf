"""What processes are given to do in tests: good and bad."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

from fbgraph.core.errors import DataError


def work(what: int | str) -> int:
    """Square a number, or go wrong in the way that is named."""
    if isinstance(what, int):
        return what * what
    if what == "hang":
        while True:  # no signal handler of Python ever gets to run
            time.sleep(0.05)
    if what == "eat":
        eaten = []
        while True:
            eaten.append(bytearray(20_000_000))
    if what == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "exit":
        sys.exit(3)
    if what == "disk":
        raise OSError(5, "Input/output error")
    if what == "data":
        raise DataError("walk.csv: nothing in it")
    raise KeyError(what)


def note_and_die_once(place: str) -> str:
    """End its process unless it was begun before."""
    if Path(place).exists():
        return "done"
    Path(place).touch()
    os.kill(os.getpid(), signal.SIGKILL)
    return "never"


def slowly(place: str) -> None:
    """Tell which process this is, then take a minute."""
    Path(place).write_text(str(os.getpid()))
    time.sleep(60.0)


def threads_told(_: int) -> str | None:
    """How many threads linear algebra may have."""
    return os.environ.get("OPENBLAS_NUM_THREADS")
