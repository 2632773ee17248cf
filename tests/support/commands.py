"""The command line, and Rerun's."""

import contextlib
import io
import os
import signal
import subprocess
import sys
from pathlib import Path
from unittest import mock

from fbgraph import cli
from fbgraph.cli.app import STOPPING


def fbgraph(*arguments: object, code: int = 0, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """``fbgraph`` as typed, in this process, which spares starting one; it must end with this code."""
    written = io.BytesIO(), io.BytesIO()
    out, err = (io.TextIOWrapper(data, "utf-8", newline="", write_through=True) for data in written)
    typed = ["fbgraph", *map(str, arguments)]
    handlers = {number: signal.getsignal(number) for number in STOPPING}
    with (
        contextlib.chdir(cwd or Path.cwd()),
        mock.patch.object(sys, "argv", typed),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            cli.main()
            ended: object = 0
        except SystemExit as end:
            ended = end.code or 0
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
    stdout, stderr = (data.getvalue().decode() for data in written)
    assert ended == code, stderr
    return subprocess.CompletedProcess(typed, code, stdout, stderr)


def fbgraph_process(
    *arguments: object, code: int = 0, stdin: str = "", **environment: str
) -> subprocess.CompletedProcess[str]:
    """``python -m fbgraph`` in a process of its own; it must end with this code, and never with a traceback."""
    done = subprocess.run(
        [sys.executable, "-m", "fbgraph", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        input=stdin,
        timeout=120,
        env={**os.environ, **environment},
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    return done


def rrd(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """``rerun rrd``, which checks and compares recordings."""
    command = [sys.executable, "-m", "rerun", "rrd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)
