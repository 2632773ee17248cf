"""The Rerun viewer as a process of its own. It listens to this machine only: Rerun by itself listens to everybody."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time

from fbgraph.core.errors import ConfigError

HOST, PORT = "127.0.0.1", 9876  # where Rerun's viewers listen
_START_S = 20.0


def viewer_command(*arguments: str) -> list[str]:
    """The command that starts a viewer, in a window or, with ``--web-viewer``, in a browser."""
    return [sys.executable, "-m", "rerun_cli", "--bind", HOST, *arguments]


def start_viewer() -> str:
    """Open a viewer that waits for a walk, unless one is open already; returns its URL. It outlives this process.

    Raises:
        ConfigError: it does not start.
    """
    if not _listens():
        # as ``RecordingStream.spawn`` does it, which cannot be told where to listen
        process = subprocess.Popen(
            viewer_command("--port", str(PORT), "--memory-limit", "75%", "--expect-data-soon"),
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            env={**os.environ, "RERUN_APP_ONLY": "true"},
        )
        due_s = time.monotonic() + _START_S
        while not _listens():
            if process.poll() is not None or time.monotonic() > due_s:
                raise ConfigError("--view: no viewer: it does not start; without a screen, --connect URL may do")
            time.sleep(0.05)
    return f"rerun+http://{HOST}:{PORT}/proxy"


def _listens() -> bool:
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((HOST, PORT)) == 0
