"""The command line, and Rerun's, as processes of their own."""

import os
import subprocess
import sys
from pathlib import Path


def fbgraph(
    *arguments: object, code: int = 0, cwd: Path | None = None, stdin: str | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """``fbgraph`` as typed; it must end with this code, and never with a traceback."""
    done = subprocess.run(
        [sys.executable, "-m", "fbgraph", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        input=stdin,
        stdin=subprocess.DEVNULL if stdin is None else None,
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
