"""``fbgraph online`` on live sources: interrupted, killed, resumed."""

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.commands import fbgraph, fbgraph_process
from support.walking import differences

from fbgraph.core.config import load_config
from fbgraph.core.tum_files import read_tum
from fbgraph.pipeline import reconstruct
from fbgraph.readers import read_log

KILLS = 5


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "fbgraph", "online", *map(str, arguments), "--no-recording"]


@contextmanager
def running(*arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()


def ended(process: subprocess.Popen[bytes], code: int = 0) -> str:
    out, err = process.communicate(timeout=60)
    assert process.returncode == code, err.decode()
    assert b"Traceback" not in err
    return out.decode()


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def connected(port: int) -> socket.socket:
    for _ in range(200):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except OSError:
            time.sleep(0.05)
    raise AssertionError("nobody listens")


@pytest.fixture(scope="module")
def reference(device_lines: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of the whole walk from standard input, uninterrupted."""
    out = tmp_path_factory.mktemp("reference") / "run"
    lines = "".join(device_lines)
    done = fbgraph_process("online", "--source", "stdin", "--out", out, "--json", "--no-recording", stdin=lines)
    updates = [json.loads(line) for line in done.stdout.splitlines()]
    assert [u["k"] for u in updates[:-1]] == list(range(len(updates) - 1))
    assert updates[-1]["out"] == str(out)
    return out


def same_walk(run: Path, reference: Path) -> None:
    assert (run / "raw.csv").read_bytes() == (reference / "raw.csv").read_bytes()
    for name in ("online.tum", "smoothed.tum"):
        assert (run / name).read_text() == (reference / name).read_text(), name


def test_stdin_keeps_every_line_and_smooth_gives_the_same(reference: Path, device_lines: list[str]) -> None:
    assert (reference / "raw.csv").read_text() == "".join(device_lines)
    batch = reconstruct(read_log(reference / "raw.csv").log, load_config("m5stickc")).smoothed.trajectory
    distance_m, yaw_deg = differences(read_tum(reference / "smoothed.tum"), batch)
    assert distance_m < 0.05
    assert yaw_deg < 0.3


def test_a_serial_port(device_lines: list[str], reference: Path, tmp_path: Path) -> None:
    master, slave = os.openpty()
    import tty

    tty.setraw(slave)
    with running("--source", f"serial:{os.ttyname(slave)}@115200", "--out", tmp_path / "run") as process:
        raw = tmp_path / "run" / "raw.csv"
        while not raw.exists():
            time.sleep(0.05)
        time.sleep(0.5)  # opening the port empties its buffers
        data = "".join(device_lines).encode()
        for at in range(0, len(data), 2000):
            os.write(master, data[at : at + 2000])
        deadline = time.time() + 20
        while raw.stat().st_size < len(data) and time.time() < deadline:
            time.sleep(0.05)
        os.close(master)  # the cable is pulled
        process.send_signal(signal.SIGINT)
        ended(process)
    os.close(slave)
    same_walk(tmp_path / "run", reference)


def stored(raw: Path, data: bytes) -> None:
    """Wait until all that was sent is on disk."""
    deadline = time.time() + 20
    while time.time() < deadline and (not raw.exists() or raw.stat().st_size < len(data)):
        time.sleep(0.05)
    assert raw.read_bytes() == data


def test_tcp_and_udp(device_lines: list[str], reference: Path, tmp_path: Path) -> None:
    port = free_port()
    with running("--source", f"tcp://:{port}", "--out", tmp_path / "tcp") as process:
        with connected(port) as device:
            device.sendall("".join(device_lines[:3000]).encode())
        time.sleep(0.3)
        with connected(port) as device:  # who comes back is heard again
            device.sendall("".join(device_lines[3000:]).encode())
        stored(tmp_path / "tcp" / "raw.csv", "".join(device_lines).encode())
        process.send_signal(signal.SIGTERM)
        ended(process)
    same_walk(tmp_path / "tcp", reference)
    port = free_port(socket.SOCK_DGRAM)
    with running("--source", f"udp://127.0.0.1:{port}", "--out", tmp_path / "udp") as process:
        raw = tmp_path / "udp" / "raw.csv"
        while not raw.exists():
            time.sleep(0.05)
        time.sleep(0.2)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
            for at in range(0, len(device_lines), 20):
                device.sendto("".join(device_lines[at : at + 20]).encode(), ("127.0.0.1", port))
                time.sleep(0.012)  # some fifteen times as fast as a device
        time.sleep(0.5)
        process.send_signal(signal.SIGTERM)
        ended(process)
    assert len(read_tum(tmp_path / "udp" / "smoothed.tum")) >= 0.9 * len(read_tum(reference / "smoothed.tum"))


def test_kills_lose_and_double_no_step(device_lines: list[str], reference: Path, tmp_path: Path) -> None:
    """The device sends again from the first line that was not saved, as one with a buffer does."""
    out, rng = tmp_path / "run", random.Random(11)
    for cycle in range(KILLS + 1):
        port = free_port()
        saved = (out / "raw.csv").read_bytes() if cycle else b""
        sent = saved.count(b"\n")
        how = ("--resume", out) if cycle else ("--out", out)
        with running("--source", f"tcp://:{port}", *how) as process, connected(port) as device:
            if cycle == KILLS:
                device.sendall("".join(device_lines[sent:]).encode())
                device.close()
                stored(out / "raw.csv", "".join(device_lines).encode())
                process.send_signal(signal.SIGTERM)
                ended(process)
                break
            until = min(sent + rng.randrange(200, 900), len(device_lines) - 20)
            data = "".join(device_lines[sent:until]).encode()
            device.sendall(data[: len(data) - rng.randrange(0, 60)])  # possibly torn in a line
            if cycle == 0:
                while not (out / "raw.csv").exists():
                    time.sleep(0.02)
            time.sleep(rng.uniform(0.0, 0.4))
            process.send_signal(signal.SIGKILL)
            process.wait()
    same_walk(out, reference)


def test_a_walk_killed_before_its_first_byte_is_resumed(
    device_lines: list[str], reference: Path, tmp_path: Path
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "config.toml").write_bytes((reference / "config.toml").read_bytes())
    arguments = ("--source", "stdin", "--resume", tmp_path / "run", "--no-recording")
    fbgraph_process("online", *arguments, stdin="".join(device_lines))
    same_walk(tmp_path / "run", reference)


def test_resume_needs_a_walk_and_sources_are_checked(tmp_path: Path) -> None:
    run = tmp_path / "run"
    for code, cause, arguments in (
        (2, "no walk", ("--source", "stdin", "--resume", tmp_path)),
        (2, "expected stdin", ("--source", "carrier-pigeon", "--out", run)),
        (2, "LOG", ("--out", run)),
        (2, "--speed", ("nothing.csv", "--speed", "-1", "--out", run)),
        (3, "nothing.csv", (tmp_path / "nothing.csv", "--out", run)),
    ):
        told = fbgraph("online", *arguments, code=code).stderr
        assert cause in told
        assert told.count("\n") == 1
