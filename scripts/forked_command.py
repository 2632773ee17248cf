"""Runs fbgraph's commands in forks of a process that has imported all of it: starting one costs next to nothing."""

from __future__ import annotations

import atexit
import contextlib
import importlib
import os
import pkgutil
import select
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import fbgraph
from fbgraph.core.config import load_config
from fbgraph.pipeline import reconstruct
from fbgraph.readers import read_log
from fbgraph.simulator.files import write_m5stickc_csv

_PIECE = 20_000  # bytes of its input that a command is sent at once


@dataclass(frozen=True)
class Ended:
    """How a command ended.

    Attributes:
        code: its exit code; of a signal, its number below zero.
        said: on stderr.
        took_s: from its start on.
    """

    code: int
    said: str
    took_s: float


def import_everything() -> None:
    """All modules of the package and what they import, late or not; and smooth a walk, which fills many a cache."""
    for module in pkgutil.walk_packages(fbgraph.__path__, "fbgraph."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    walk = fbgraph.simulate("square", seed=1)
    with tempfile.TemporaryDirectory() as folder:
        write_m5stickc_csv(walk.log.between(0.0, 12.0), Path(folder) / "walk.csv")
        file = read_log(Path(folder) / "walk.csv")
    reconstruct(file.log, load_config("m5stickc"))


def run(
    folder: Path,
    arguments: tuple[str, ...],
    stdin: bytes = b"",
    patience_s: float = 30.0,
    kill_after_s: float | None = None,
    environment: Mapping[str, str] | None = None,
) -> Ended:
    """Run a command; RuntimeError if it hangs.

    Args:
        folder: where.
        arguments: of ``fbgraph``.
        stdin: what is sent to it.
        patience_s: for so long it may take.
        kill_after_s: when it is killed, if it is still there.
        environment: more of it.
    """
    read, write = os.pipe()
    began = time.monotonic()
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if child == 0:
            os.close(write)
            _become(folder, arguments, read, said.fileno(), environment or {})
        os.close(read)
        ended = os.pidfd_open(child)
        try:
            until = began + (patience_s if kill_after_s is None else kill_after_s)
            alive = _fed(write, ended, stdin, until)
        finally:
            os.close(ended)
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)  # does nothing to what has ended
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if alive and kill_after_s is None:
            raise RuntimeError(f"{' '.join(arguments)} hangs with {environment}")
        said.seek(0)
        return Ended(code, said.read().decode("utf-8", "replace"), time.monotonic() - began)


def _fed(write: int, ended: int, data: bytes, until: float) -> bool:
    """Send a process its input and wait for its end; whether it is there still when the time is over."""
    os.set_blocking(write, False)
    sent = 0
    while True:
        if sent == len(data) and write >= 0:
            os.close(write)
            write = -1
        left_s = until - time.monotonic()
        over, writable, _ = select.select([ended], [write] if write >= 0 else [], [], max(left_s, 0.0))
        if writable:
            try:
                sent += os.write(write, data[sent : sent + _PIECE])
            except BrokenPipeError:
                sent = len(data)
        if over or left_s <= 0.0:
            if write >= 0:
                os.close(write)
            return not over


def _become(
    folder: Path, arguments: tuple[str, ...], stdin: int, said: int, environment: Mapping[str, str]
) -> NoReturn:
    """Be the command, from its first line to its end."""
    from fbgraph.cli import main

    code = 1
    try:
        os.chdir(folder)
        os.environ.update(environment)
        nothing = os.open(os.devnull, os.O_WRONLY)
        for descriptor, place in ((stdin, 0), (nothing, 1), (said, 2)):
            os.dup2(descriptor, place)
        sys.stdin = open(0, closefd=False)  # noqa: SIM115
        sys.stdout, sys.stderr = (open(i, "w", closefd=False) for i in (1, 2))  # noqa: SIM115
        sys.argv = ["fbgraph", *arguments]
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)
