"""Viewers and web servers of Rerun listen to this machine only."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.commands import fbgraph, fbgraph_process

from fbgraph.recording.viewer import HOST, PORT, viewer_command

LISTENING = "0A"


def listening_of(pid: int) -> set[str]:
    """Addresses on which a process and its children listen, ``127.0.0.1:9090``; IPv6 ones as hexadecimal digits."""
    pids = [pid]
    for one in pids:
        pids += map(int, Path(f"/proc/{one}/task/{one}/children").read_text().split())
    inodes = set()
    for one in pids:
        for entry in Path(f"/proc/{one}/fd").iterdir():
            try:
                found = re.fullmatch(r"socket:\[(\d+)\]", os.readlink(entry))
            except OSError:
                continue
            if found:
                inodes.add(found[1])
    addresses = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == LISTENING and fields[9] in inodes:
                host, port = fields[1].split(":")
                shown = socket.inet_ntoa(bytes.fromhex(host)[::-1]) if table == "tcp" else host
                addresses.add(f"{shown}:{int(port, 16)}")
    return addresses


@pytest.fixture
def free_ports() -> None:
    """The ports on which Rerun listens are somebody else's now and then."""
    for port in (PORT, 9090):
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) == 0:
                pytest.skip(f"port {port} is in use")


def test_every_viewer_is_told_to_listen_here() -> None:
    command = viewer_command("--web-viewer")
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert command[-1] == "--web-viewer"


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="who listens is asked of /proc")
def test_the_web_viewer_listens_to_this_machine_only(free_ports: None, device_lines: list[str], tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text("".join(device_lines))
    fbgraph("smooth", tmp_path / "walk.csv", "--out", tmp_path / "run")
    command = [sys.executable, "-m", "fbgraph", "view", str(tmp_path / "run"), "--web"]
    nothing = shutil.which("true") or "true"
    viewer = subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "BROWSER": nothing},
        start_new_session=True,
    )
    try:
        until, found = time.monotonic() + 30.0, set[str]()
        while time.monotonic() < until and len(found) < 2 and viewer.poll() is None:
            time.sleep(0.2)
            found = listening_of(viewer.pid)
    finally:
        os.killpg(viewer.pid, signal.SIGKILL)
        viewer.wait()
    assert found == {f"{HOST}:{PORT}", f"{HOST}:9090"}


def test_a_live_viewer_is_started_here_and_shown_the_walk(
    free_ports: None, device_lines: list[str], tmp_path: Path
) -> None:
    (tmp_path / "walk.csv").write_text("".join(device_lines))
    rerun, noted = tmp_path / "rerun", tmp_path / "noted.txt"
    # in place of Rerun's own: notes what it was told, listens a while
    rerun.write_text(
        f"#!{sys.executable}\nimport socket, sys, time\n"
        f"open({str(noted)!r}, 'w').write(' '.join(sys.argv[1:]))\n"
        f"server = socket.create_server(('127.0.0.1', {PORT}))\ntime.sleep(2)\n"
    )
    rerun.chmod(0o755)
    (tmp_path / "none").mkdir()
    command = [sys.executable, "-c", "from fbgraph.recording.viewer import start_viewer; print(start_viewer())"]
    environment = {**os.environ, "RERUN_CLI_PATH": str(rerun)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
    assert done.stdout == f"rerun+http://127.0.0.1:{PORT}/proxy\n", done.stderr
    assert noted.read_text().startswith(f"--bind 127.0.0.1 --port {PORT} ")


def test_a_viewer_that_does_not_start_is_told(free_ports: None, tmp_path: Path, device_lines: list[str]) -> None:
    (tmp_path / "walk.csv").write_text("".join(device_lines))
    done = fbgraph_process(
        *("online", tmp_path / "walk.csv", "--out", tmp_path / "run", "--view", "--no-recording"),
        code=2,
        RERUN_CLI_PATH=shutil.which("false") or "false",
    )
    assert done.stderr.splitlines()[-1].startswith("fbgraph: --view: no viewer: ")
