"""Any log as a device: its canonical lines, at the pace at which they were measured, to wherever ``online`` listens.

On demand some lines are lost, come late, or the device restarts in the middle; numbered lines are sent again when they
are asked for, as the recorder does (``scripts/recorder``).
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.core.errors import ConfigError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.readers.canonical_csv import write_canonical_csv
from fbgraph.readers.device_links import Link, Pushes
from fbgraph.readers.numbered_lines import END_LINE, FIRST_LINE, asked, numbered, opened, sealed

_POLL_S = 0.2
_LINGER_S = 3.0  # after the last line, for requests
_LATE_ROWS = 3
_PUSH_S = 0.5
_AGAIN_LINES = 20  # of those asked for, with each new one
Stop = Callable[[], bool]
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Faults:
    """What goes wrong on the way.

    Attributes:
        lose: share of rows that are lost; never the header.
        reorder: share of rows that come up to three rows late.
        restart_at_s: when the device starts again, its clock at 0, since the beginning of the log; never if None.
        seed: of chance.
    """

    lose: float = 0.0
    reorder: float = 0.0
    restart_at_s: float | None = None
    seed: int = 0


@dataclass
class Played:
    """What was sent: rows, those lost on purpose, late on purpose, sent again, and lines that came back."""

    rows: int = 0
    lost: int = 0
    late: int = 0
    again: int = 0
    told: list[str] = field(default_factory=list)


def play(
    log: SensorLog,
    link: Link | Pushes,
    faults: Faults,
    *,
    speed: float,
    number: bool = False,
    remark: str = "",
    stop: Stop = lambda: False,
    tell: Tell = lambda text: None,
) -> Played:
    """Send a log as a device would.

    Args:
        log: any.
        link: from ``device_links.open_device``; of ``http://`` it takes no faults and no numbers.
        faults: what goes wrong.
        speed: so many times as fast as it was measured; infinity for at once.
        number: number the lines, and send again what is asked for.
        remark: sent before the header, from ``canonical_csv.remark_of``; none if empty.
        stop: asked whether to end here.
        tell: called with each new line that came back.
    """
    played = Played()
    with contextlib.closing(link):
        try:
            if isinstance(link, Pushes):
                _push(log, link, speed, stop, played)
            else:
                _send(device_lines(log, faults.restart_at_s, remark), link, faults, speed, stop, played, number, tell)
        except OSError as error:
            tell(f"nobody takes it any more: {error.strerror or error}")
    return played


def _send(
    lines: Iterable[tuple[float, bytes]],
    link: Link,
    faults: Faults,
    speed: float,
    stop: Stop,
    played: Played,
    number: bool,
    tell: Tell,
) -> None:
    chance = np.random.default_rng(faults.seed)
    walk = f"{chance.integers(1 << 16):04x}"
    device = _Device(link, walk if number else "", played, tell)
    if number:
        link.send(device.wire(FIRST_LINE.format(walk=walk).encode()))
    late: list[tuple[int, bytes]] = []  # after how many more rows, and what
    began = time.monotonic()
    for t_s, line in lines:
        _wait(began + t_s / speed, stop)
        if stop():
            return
        luck = chance.random(2) if t_s >= 0.0 else np.ones(2)
        played.rows += t_s >= 0.0
        if luck[0] < faults.lose:
            played.lost += 1
            device.wire(line)
        elif luck[1] < faults.reorder:
            played.late += 1
            late.append((int(chance.integers(1, _LATE_ROWS + 1)), device.wire(line)))
        else:
            link.send(device.wire(line))
            late = [(wait - 1, text) for wait, text in late]
            for _, text in [one for one in late if one[0] <= 0]:
                link.send(text)
            late = [one for one in late if one[0] > 0]
        device.answer()
    for _, text in late:
        link.send(text)
    if number:
        link.send(device.wire(END_LINE))
        until = time.monotonic() + _LINGER_S
        while time.monotonic() < until and device.stored < len(device.lines) and not stop():
            device.beacon()
            until = time.monotonic() + _LINGER_S if device.answer() else until
            time.sleep(0.02)


class _Device:
    """The lines that a device sent, numbered if its walk has a name."""

    def __init__(self, link: Link, walk: str, played: Played, tell: Tell) -> None:
        self._link, self._walk, self._played, self._tell = link, walk, played, tell
        self._rest = b""
        self._again: list[int] = []
        self._beacon_s = 0.0
        self.lines: list[bytes] = []
        self.stored = 0

    def wire(self, line: bytes) -> bytes:
        """The next line of the walk as it is sent."""
        if not self._walk:
            return line + b"\n"
        self.lines.append(line)
        return numbered(self._walk, len(self.lines) - 1, line)

    def beacon(self) -> None:
        """Say now and then how many lines there are."""
        if time.monotonic() - self._beacon_s > _POLL_S:
            self._beacon_s = time.monotonic()
            self._link.send(sealed(b"@", b"%s:%d" % (self._walk.encode(), len(self.lines))))

    def answer(self) -> bool:
        """Take what came back: lines to send again, what is stored, what the wearer is told."""
        *came, self._rest = (self._rest + self._link.received()).split(b"\n")
        for line in came:
            found = opened(line)
            if found is None:
                continue
            mark, body = found
            if mark == b"!" and (text := body.decode("utf-8", "replace")) != (self._played.told or [""])[-1]:
                self._played.told.append(text)
                self._tell(f"told: {text}")
            elif mark == b"?" and (wanted := asked(body))[0] == self._walk:
                self._again = [n for a, b in wanted[1] for n in range(a, min(b + 1, len(self.lines)))]
            elif mark == b"+" and body.startswith(self._walk.encode() + b":"):
                self.stored = int(body.rpartition(b":")[2] or b"0")
        for n in self._again[:_AGAIN_LINES]:
            self._played.again += 1
            self._link.send(numbered(self._walk, n, self.lines[n]))
        del self._again[:_AGAIN_LINES]
        return bool(came)


def device_lines(log: SensorLog, restart_at_s: float | None = None, remark: str = "") -> Iterator[tuple[float, bytes]]:
    """A log's canonical lines, each with its time in seconds since the first row; the header comes at -1.

    Args:
        log: any.
        restart_at_s: when the device starts again: it sends its header once more, and its clock begins at 0.
        remark: before the header; none if empty.
    """
    with tempfile.TemporaryDirectory(prefix="fbgraph-") as folder:
        path = Path(folder) / "log.csv"
        write_canonical_csv(log, path)
        header, *rows = path.read_bytes().splitlines()
    tick_s = 1e-3 if header.startswith(b"t_ms") else 1e-9
    first = int(rows[0].partition(b",")[0])
    began = first
    restarts = restart_at_s is not None
    if remark:
        yield -1.0, f"# {remark}".encode()
    yield -1.0, header
    for row in rows:
        tick, _, values = row.partition(b",")
        t_s = (int(tick) - first) * tick_s
        if restarts and restart_at_s is not None and t_s >= restart_at_s:
            restarts, began = False, int(tick)
            yield -1.0, header
        yield t_s, row if began == first else b"%d,%s" % (int(tick) - began, values)


def _wait(due_s: float, stop: Stop) -> None:
    while (left_s := due_s - time.monotonic()) > 0 and not stop():
        time.sleep(min(left_s, _POLL_S))


def _push(log: SensorLog, link: Pushes, speed: float, stop: Stop, played: Played) -> None:
    """Push a log as Sensor Logger does: every half second, one sensor after the other."""
    began = time.monotonic()
    streams = {"totalacceleration": log.acc, "gyroscope": log.gyro, "magnetometer": log.mag, "barometer": log.pressure}
    edges = np.arange(0.0, log.span_s[1] + _PUSH_S, _PUSH_S)
    for i, start_s in enumerate(edges.tolist()):
        _wait(began + (start_s + _PUSH_S) / speed, stop)
        if stop():
            return
        payload: list[dict[str, Any]] = []
        for name, stream in streams.items():
            inside = (stream.t_s >= (start_s if i else -np.inf)) & (stream.t_s < start_s + _PUSH_S)
            for t_s, values in zip(stream.t_s[inside].tolist(), stream.values[inside].tolist(), strict=True):
                named = {"pressure": values[0]} if name == "barometer" else dict(zip("xyz", values, strict=True))
                payload.append({"name": name, "time": _unix_ns(log, t_s), "values": named})
        for event in log.events:
            if start_s <= event.t_s < start_s + _PUSH_S:
                item = {"name": "annotation", "time": _unix_ns(log, event.t_s), "values": {"text": event.label}}
                payload.append(item)
        if payload:
            link.push({"messageId": i, "sessionId": log.name, "deviceId": "fbgraph", "payload": payload})
            played.rows += len(payload)


def _unix_ns(log: SensorLog, t_s: float) -> int:
    return round(log.t0_s * 1e9) + round(t_s * 1e9)


def faults_of(to: str, lose: float, reorder: float, restart_at_s: float | None, number: bool, seed: int) -> Faults:
    """Faults as told on the command line.

    Raises:
        ConfigError: a share that is none, or something that the link ``to`` does not know.
    """
    for name, share in (("--lose", lose), ("--reorder", reorder)):
        if not 0.0 <= share < 1.0:
            raise ConfigError(f"{name} {share:g}: expected a share of the rows, 0 to 1")
    if to.startswith("http://") and (lose or reorder or number or restart_at_s is not None):
        raise ConfigError(f"--to {to}: a phone that pushes loses and numbers nothing; leave out the faults")
    return Faults(lose, reorder, restart_at_s, seed)
