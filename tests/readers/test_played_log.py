"""A log played as a device: what arrives is what ``convert`` writes, whatever the link, but for faults on demand."""

import http.client
import json
import os
import select
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fbgraph.core.errors import ConfigError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.readers.canonical_csv import noted_preset, write_canonical_csv
from fbgraph.readers.device_links import open_device
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.numbered_lines import in_order
from fbgraph.readers.phone_pushes import HEADER, MOST_BODY, REMARK, PushedRows
from fbgraph.readers.played_log import Faults, Played, device_lines, faults_of, play
from fbgraph.readers.sources import open_source
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate

NOWHERE = Path("/nowhere/raw.csv")


@pytest.fixture(scope="module")
def log() -> SensorLog:
    return simulate(load_route("square"), seed=7).log.between(0.0, 12.0)


@pytest.fixture(scope="module")
def canonical(log: SensorLog, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("canonical") / "walk.csv"
    write_canonical_csv(log, path)
    return path.read_bytes()


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def received(spec: str, send: Callable[[], Played], until: Callable[[bytes], bool]) -> tuple[bytes, Played, list[str]]:
    """What a source takes of what is played to it meanwhile."""
    told, sent, over = list[str](), list[Played](), threading.Event()
    source = open_source(spec, over.is_set, told.append)
    playing = threading.Thread(target=lambda: sent.append(send()))
    playing.start()
    got, began_s = b"", time.monotonic()
    for data in in_order(source, NOWHERE, told.append):
        got += data
        if (not data and until(got) and not playing.is_alive()) or time.monotonic() - began_s > 60.0:
            over.set()
    playing.join()
    return got, sent[0], told


def player(log: SensorLog, spec: str, speed: float = np.inf, number: bool = False, **faults: Any) -> Played:
    link = open_device(spec, lambda: False, lambda text: None)
    return play(log, link, Faults(**faults), speed=speed, number=number)


def test_tcp_carries_every_byte(log: SensorLog, canonical: bytes) -> None:
    spec = f"tcp://127.0.0.1:{free_port()}"
    got, sent, _ = received(spec, lambda: player(log, spec), lambda got: len(got) >= len(canonical))
    assert got == canonical
    assert sent.rows == canonical.count(b"\n") - 1


def test_a_pseudo_terminal_is_a_serial_port(log: SensorLog, canonical: bytes) -> None:
    """It says where it is, waits for who opens it, and goes away only when all was read."""
    said, over, found = list[str](), threading.Event(), threading.Event()

    def tell(text: str) -> None:
        said.append(text.split("serial:")[1].split(" ")[0])
        found.set()

    playing = threading.Thread(target=lambda: play(log, open_device("pty", over.is_set, tell), Faults(), speed=np.inf))
    playing.start()
    assert found.wait(10.0)
    told: list[str] = []
    source, got = open_source(f"serial:{said[0]}", over.is_set, told.append), b""
    for data in source:
        got += data
        if told:
            over.set()
    playing.join()
    assert got == canonical
    assert told == [f"serial port {said[0]} went away; waiting for it to come back"]


def test_a_serial_port_is_played_to(log: SensorLog, canonical: bytes) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    got = b""
    playing = threading.Thread(target=player, args=(log, f"serial:{os.ttyname(slave)}@230400"))
    playing.start()
    while len(got) < len(canonical) and select.select([master], [], [], 10.0)[0]:
        got += os.read(master, 1 << 16)
    playing.join()
    for end in (master, slave):
        os.close(end)
    assert got == canonical


def test_numbered_datagrams_lose_nothing(log: SensorLog, canonical: bytes) -> None:
    spec = f"udp://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    got, sent, told = received(
        spec, lambda: player(log, spec, 20.0, True, lose=0.1, reorder=0.1, seed=1), lambda got: b"# end" in got
    )
    first, rest = got.split(b"\n", 1)
    assert first.startswith(b"# fbgraph recorder 1 walk ")
    assert rest == canonical + b"# end\n"
    assert sent.lost > 0.07 * sent.rows
    assert sent.late > 0.07 * sent.rows
    assert sent.again >= sent.lost
    assert told[0] == "the device ended the walk"


def test_plain_datagrams_lose_what_they_lose(log: SensorLog, canonical: bytes) -> None:
    spec = f"udp://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    got, sent, _ = received(spec, lambda: player(log, spec, 20.0, lose=0.2, seed=1), lambda got: True)
    assert got.count(b"\n") == 1 + sent.rows - sent.lost
    assert set(got.splitlines()) < set(canonical.splitlines())


def test_pushes_give_the_same_walk(log: SensorLog, canonical: bytes) -> None:
    spec = f"http://127.0.0.1:{free_port()}"
    got, sent, _ = received(spec, lambda: player(log, spec), lambda got: True)
    rows = [line.split(",") for line in canonical.decode().splitlines()[1:]]
    expected = [",".join((f"{row[0]}000000", *row[1:])) for row in rows]
    assert got.decode().splitlines() == [REMARK, HEADER, *expected]
    assert noted_preset([REMARK.removeprefix("# ")]) == "phone"
    assert sent.rows == len(log.acc) + len(log.gyro) + len(log.mag) + len(log.pressure) + len(log.events)
    of_device, of_phone = LiveReader("a"), LiveReader("b")
    one, other = (
        SensorLog.concatenate([reader.push(text.decode().splitlines()), reader.finish()])
        for reader, text in ((of_device, canonical), (of_phone, got))
    )
    assert len(one.acc) == len(log.acc)
    assert of_phone.reading is not None
    assert of_phone.reading.layout.preset == "phone"
    assert np.array_equal(one.acc.values, other.acc.values)
    assert np.array_equal(one.gyro.t_s, other.gyro.t_s)


def test_a_device_that_restarts_begins_again_at_zero(log: SensorLog, canonical: bytes) -> None:
    lines = list(device_lines(log, 5.0))
    times = [int(line.partition(b",")[0]) for t_s, line in lines if t_s >= 0.0]
    assert sum(t_s < 0.0 for t_s, _ in lines) == 2
    again = times.index(0, 1)
    assert times[again - 1] - times[0] < 5000 <= times[again - 1] - times[0] + 20
    assert len(times) == canonical.count(b"\n") - 1


def test_a_remark_goes_before_all(log: SensorLog) -> None:
    lines = [line for _, line in device_lines(log, None, "converted by fbgraph from ipin; preset phone")]
    assert lines[0] == b"# converted by fbgraph from ipin; preset phone"
    assert lines[1].startswith(b"t_ms,")


def test_faults_are_checked() -> None:
    assert faults_of("pty", 0.1, 0.2, 3.0, True, 4) == Faults(0.1, 0.2, 3.0, 4)
    for cause, arguments in (
        ("--lose 1: expected a share", ("pty", 1.0, 0.0, None, False, 0)),
        ("--reorder -0.1: expected a share", ("pty", 0.0, -0.1, None, False, 0)),
        ("leave out the faults", ("http://:80", 0.1, 0.0, None, False, 0)),
    ):
        with pytest.raises(ConfigError, match=cause):
            faults_of(*arguments)
    for spec in ("carrier-pigeon", "tcp://:0", "serial:"):
        with pytest.raises(ConfigError, match="expected"):
            open_device(spec, lambda: True, lambda text: None)


def sample(name: str, t_ns: int, *values: float, **more: str) -> dict[str, Any]:
    return {"name": name, "time": t_ns, "values": {**dict(zip("xyz", values, strict=False)), **more}}


def pushed(*items: dict[str, Any], rows: PushedRows) -> list[str]:
    return rows.push({"messageId": 1, "payload": list(items)}).decode().splitlines()


def test_rows_are_in_order_of_time_across_sensors_and_pushes() -> None:
    rows = PushedRows()
    assert pushed(sample("TotalAcceleration", 10, 0.0, 0.0, 9.80665), rows=rows) == [
        REMARK,
        HEADER,
        "10,0,0,1,,,,,,,,,",
    ]
    items = sample("totalacceleration", 30, 0.0, 9.80665, 0.0), sample("gyroscope", 20, 1.0, 0, 0)
    assert pushed(*items, rows=rows) == ["20,,,,57.2957795,0,0,,,,,,"]
    assert pushed(sample("gyroscope", 30, 0, 0, 0), sample("annotation", 25, text="a,b\n=1"), rows=rows) == [
        "25,,,,,,,,,,,,a b 1",
        "30,0,1,0,0,0,0,,,,,,",
    ]
    assert pushed(sample("gyroscope", 29, 0, 0, 0), rows=rows) == []
    assert rows.late == 1


def test_a_sensor_that_fell_silent_is_not_waited_for_and_nonsense_is_left_out() -> None:
    rows = PushedRows()
    pushed(sample("magnetometer", 1, 1, 2, 3), sample("gyroscope", 1, 0, 0, 0), rows=rows)
    late = [sample("gyroscope", 4_000_000_000, 0, 0, 0), sample("gyroscope", 5_000_000_000, 0, 0, 0)]
    assert len(pushed(*late, rows=rows)) == 2
    nonsense = [
        {"name": "gyroscope", "time": "x", "values": {"x": 1, "y": 1, "z": 1}},
        sample("gyroscope", 1 << 61, 0, 0, 0),
        sample("gyroscope", 5_000_000_001, float("nan"), 0, 0),
        {"name": ["a"], "values": 3},
        sample("location", 5_000_000_001, 1.0),
    ]
    assert pushed(*nonsense, rows=rows) == []
    with pytest.raises(ValueError, match="payload"):
        rows.push({"payload": 3})


@pytest.mark.parametrize(("ios", "sign"), [(None, "-1"), (True, "-1"), (False, "1")])
def test_an_iphone_has_gravity_beside_acceleration_and_other_signs(ios: bool | None, sign: str) -> None:
    told: list[str] = []
    rows = PushedRows(told.append)
    rows.ios = ios
    items = [sample("accelerometer", 10, 0, 0, 0.0), sample("gravity", 10, 0, 0, 9.80665)]
    assert pushed(*items, rows=rows)[2].split(",")[3] == sign
    assert len(told) == (ios is None)
    alone = PushedRows(told.append)
    assert pushed(sample("accelerometer", 10, 0, 0, 0.0), rows=alone) == []
    assert "without gravity" in told[-1]


@contextmanager
def listening() -> Iterator[tuple[int, Iterator[bytes], list[str]]]:
    told, over, port = list[str](), threading.Event(), free_port()
    source = open_source(f"http://:{port}", over.is_set, told.append)
    yield port, source, told
    over.set()
    assert b"" not in list(source)[1:]


def posted(port: int, body: bytes, length: int | None = None, method: str = "POST") -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
    headers = {} if length is None else {"Content-Length": str(length)}
    connection.request(method, "/", body, headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def test_one_phone_is_listened_to_and_bodies_are_bounded() -> None:
    push = {"deviceId": "mine", "payload": [sample("totalacceleration", 10, 0, 0, 9.80665)]}
    with listening() as (port, source, told):
        assert posted(port, b"", method="GET")[0] == 200
        assert posted(port, b"not json")[0] == 400
        assert posted(port, b"[]")[0] == 400
        assert posted(port, b"[" * 100_000)[0] == 400
        assert posted(port, b"", MOST_BODY + 1)[0] == 413
        assert posted(port, json.dumps(push).encode()) == (200, "taken\n")
        assert posted(port, json.dumps({**push, "deviceId": "stray"}).encode()) == (409, "another phone is recorded\n")
        assert next(data for data in source if data) == f"{REMARK}\n{HEADER}\n10,0,0,1,,,,,,,,,\n".encode()
        assert told == ["127.0.0.1 was turned away: the phone at 127.0.0.1 is recorded"]
