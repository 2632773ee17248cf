"""``fbgraph play`` beside ``fbgraph online``."""

import signal
import socket
import subprocess
import sys
from pathlib import Path

from support.commands import fbgraph

from fbgraph.core.tum_files import read_tum


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_a_walk_without_hardware(device_lines: list[str], tmp_path: Path) -> None:
    """A tenth of its lines is lost; the walk ends when the device says so, and is the one that smooth finds."""
    log, live, port = tmp_path / "walk.csv", tmp_path / "live", free_port()
    device_lines = device_lines[:2500]
    log.write_text("".join(device_lines))
    command = [sys.executable, "-m", "fbgraph", "online", "--source", f"tcp://:{port}", "--out", str(live), "--follow"]
    with subprocess.Popen([*command, "--no-recording"], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as online:
        assert online.stderr is not None
        assert online.stdout is not None
        waits = online.stderr.readline().decode()
        assert (
            f"listening on tcp://127.0.0.1:{port} of this machine; for other devices: --source tcp://0.0.0.0" in waits
        )
        online.send_signal(signal.SIGHUP)  # its terminal goes away,
        online.stdout.close()  # and who read what it prints
        played = fbgraph("play", log, "--to", f"tcp://:{port}", "--number", "--lose", "0.1", "--speed", "60")
        err = online.stderr.read()
        assert online.wait(60) == 0, err.decode()
    rows, lost = (int(part.split()[0]) for part in played.stdout.split(", ")[:2])
    assert rows == len(device_lines) - 1
    assert 0.08 * rows < lost < 0.12 * rows
    assert "the first line came after" in err.decode()
    assert f"{lost} lines came when they were asked for again" in err.decode()
    assert (live / "raw.csv").read_text().count("\n") == len(device_lines) + 2
    fbgraph("smooth", log, "--out", tmp_path / "run", "--no-recording")
    one, other = read_tum(live / "smoothed.tum"), read_tum(tmp_path / "run" / "smoothed.tum")
    assert abs(one.xy_m - other.xy_m).max() < 1e-4


def test_what_cannot_be_played_is_told_in_a_line(device_lines: list[str], tmp_path: Path) -> None:
    log = tmp_path / "walk.csv"
    log.write_text("".join(device_lines[:600]))
    for cause, arguments in (
        ("expected pty, serial:PORT", ("--to", "carrier-pigeon")),
        ("--lose 1.5: expected a share", ("--to", "pty", "--lose", "1.5")),
        ("--speed 0: expected real, max", ("--to", "pty", "--speed", "0")),
    ):
        told = fbgraph("play", log, *arguments, code=2).stderr
        assert cause in told
        assert told.count("\n") == 1
