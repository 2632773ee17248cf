"""Of those who send to a socket one is the device: who, since when, and what the others are told."""

import socket
import time
from collections.abc import Iterator

import pytest
from support.m5stickc_lines import lines_of_a_walk

from fbgraph.readers.sources import OneSender, open_source

DEVICE, STRAY, RESTARTED = ("10.0.0.2", 4000), ("10.0.0.9", 4000), ("10.0.0.2", 4001)
HEADER, *ROWS = (line.encode() for line in lines_of_a_walk(40))


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def sender(told: list[str]) -> OneSender:
    return OneSender(told.append)


@pytest.mark.parametrize("first", [HEADER, ROWS[0], b"1,2,3,4,5,6", b"boot\n" + ROWS[0]])
def test_the_first_who_sends_a_row_or_header_is_the_device(sender: OneSender, told: list[str], first: bytes) -> None:
    assert sender.is_device(STRAY, b"hello", 0.0)  # nobody knows yet who it will be
    assert sender.is_device(STRAY, b"a,b,c,d,e,f,g,,,,,", 0.0)
    assert sender.is_device(DEVICE, first, 1.0)
    assert not sender.is_device(STRAY, ROWS[0], 1.1)
    assert sender.is_device(DEVICE, b"anything", 1.2)
    assert told == ["lines that 10.0.0.9:4000 sends are left out: 10.0.0.2:4000 is recorded"]


def test_it_is_held_for_the_whole_walk_and_others_are_counted(sender: OneSender, told: list[str]) -> None:
    assert sender.is_device(DEVICE, ROWS[0], 0.0)
    assert not any(sender.is_device(STRAY, row, 3600.0 * hour) for hour, row in enumerate(ROWS))
    assert sender.is_device(DEVICE, ROWS[1], 48 * 3600.0)
    sender.ended()
    assert sender.left_out == 40
    assert told[1:] == ["40 datagrams of other senders were left out"]


def test_a_device_that_restarts_sends_from_another_port(sender: OneSender) -> None:
    """Heard again once its old port is silent for two seconds; two programs on one host are not mixed."""
    assert sender.is_device(DEVICE, ROWS[0], 10.0)
    assert not sender.is_device(RESTARTED, ROWS[1], 12.0)
    assert not sender.is_device(RESTARTED, b"boot", 12.1)
    assert sender.is_device(RESTARTED, ROWS[2], 12.1)
    assert not sender.is_device(DEVICE, ROWS[3], 12.2)


def test_who_was_never_alone_is_told_nothing(sender: OneSender, told: list[str]) -> None:
    assert all(sender.is_device(DEVICE, row, 0.0) for row in (HEADER, *ROWS))
    sender.ended()
    assert (sender.left_out, told) == (0, [])


def drained(source: Iterator[bytes], until: int) -> bytes:
    """What comes until so many bytes are there, or ten seconds have passed."""
    got, began_s = b"", time.monotonic()
    for data in source:
        got += data
        if len(got) >= until or time.monotonic() - began_s > 10.0:
            return got
    return got


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_datagrams_of_another_sender_are_not_in_the_walk(told: list[str]) -> None:
    port, stopped = free_port(socket.SOCK_DGRAM), list[bool]()
    source = open_source(f"udp://:{port}", lambda: bool(stopped), told.append)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stray,
    ):
        device.sendto(HEADER, ("127.0.0.1", port))
        for row in ROWS:
            stray.sendto(b"9,9,9,9,9,9,9\n", ("127.0.0.1", port))
            device.sendto(row, ("127.0.0.1", port))
        expected = b"".join(line + b"\n" for line in (HEADER, *ROWS))
        assert drained(source, len(expected)) == expected
    stopped.append(True)
    assert list(source) == []
    assert "is recorded" in told[0]
    assert told[-1] == "40 datagrams of other senders were left out"


def test_who_calls_while_a_device_is_connected_is_turned_away_and_that_is_told_once(told: list[str]) -> None:
    port, stopped = free_port(socket.SOCK_STREAM), list[bool]()
    source = open_source(f"tcp://:{port}", lambda: bool(stopped), told.append)
    with socket.create_connection(("127.0.0.1", port)) as device:
        device.sendall(ROWS[0] + b"\n")
        assert drained(source, len(ROWS[0]) + 1) == ROWS[0] + b"\n"
        for _ in range(3):
            with socket.create_connection(("127.0.0.1", port)) as stray:
                assert next(source) == b""
                assert stray.recv(100) == b"busy: another device is connected\n"
                assert stray.recv(1) == b""
        device.sendall(ROWS[1] + b"\n")
        assert drained(source, 1) == ROWS[1] + b"\n"
    stopped.append(True)
    assert list(source) == []
    stopped.append(True)
    assert list(source) == []
    assert len(told) == 1
    assert "was turned away: a device is connected" in told[0]


def test_what_is_told_goes_back_to_the_device_while_there_is_one(told: list[str]) -> None:
    port, stopped = free_port(socket.SOCK_DGRAM), list[bool]()
    source = open_source(f"udp://:{port}", lambda: bool(stopped), told.append)
    assert not source.send(b"nobody is there")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
        device.sendto(ROWS[0], ("127.0.0.1", port))
        assert drained(source, 1)
        assert source.send(b"turn\n")
        assert device.recv(100) == b"turn\n"
    port = free_port(socket.SOCK_STREAM)
    source = open_source(f"tcp://:{port}", lambda: bool(stopped), told.append)
    with socket.create_connection(("127.0.0.1", port)) as caller:
        caller.sendall(ROWS[0] + b"\n")
        assert drained(source, 1)
        assert source.send(b"turn\n")
        assert caller.recv(100) == b"turn\n"
    for data in source:
        if told:
            break
        assert data == b""
    assert told == ["the device disconnected; waiting for it to come back"]
    assert not source.send(b"it went away")


def test_a_device_that_fell_silent_may_call_again(told: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A link that dies without a word leaves its connection open."""
    monkeypatch.setattr("fbgraph.readers.sources._GONE_S", 0.0)
    port = free_port(socket.SOCK_STREAM)
    source = open_source(f"tcp://:{port}", lambda: False, told.append)
    with socket.create_connection(("127.0.0.1", port)) as before:
        before.sendall(ROWS[0][:9])  # torn
        assert drained(source, 9) == ROWS[0][:9]
        with socket.create_connection(("127.0.0.1", port)) as again:
            again.sendall(ROWS[1] + b"\n")
            assert drained(source, 2 + len(ROWS[1])) == b"\n" + ROWS[1] + b"\n"
    assert told == []


def test_where_a_source_listens_is_told() -> None:
    port = free_port(socket.SOCK_STREAM)
    here = open_source(f"tcp://:{port}", lambda: True)
    assert here.where == (
        f"listening on tcp://127.0.0.1:{port} of this machine; for other devices: --source tcp://0.0.0.0:{port}"
    )
    assert list(here) == []
    anywhere = open_source(f"tcp://0.0.0.0:{port}", lambda: True)
    assert anywhere.where.startswith(f"listening on tcp://0.0.0.0:{port}")
    assert list(anywhere) == []
