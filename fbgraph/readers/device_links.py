"""Links by which a device sends: the other ends of what ``readers.sources`` listens to."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import socket
import termios
import time
import tty
from collections.abc import Callable
from typing import Any, Protocol

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers.sources import serial_port

_POLL_S = 0.2
_SETTLE_S = 0.5  # a reader that opens a serial port empties its buffers
_AGAIN_S = 0.5
Stop = Callable[[], bool]
Tell = Callable[[str], None]


class Link(Protocol):
    """Where a device's bytes go."""

    def send(self, data: bytes) -> None:
        """Send bytes; OSError if nobody takes them any more."""

    def received(self) -> bytes:
        """What came back, without waiting."""

    def close(self) -> None:
        """Let go of it."""


def open_link(spec: str, stop: Stop, tell: Tell) -> Link:
    """The link of that name; of TCP somebody is waited for who listens.

    Args:
        spec: ``pty``, ``serial:PORT[@BAUD]``, ``udp://HOST:PORT`` or ``tcp://HOST:PORT``.
        stop: asked meanwhile whether to give up.
        tell: called with what is waited for.

    Raises:
        ConfigError: not such a specification.
        DataError: a port that cannot be opened, or nobody listens and ``stop()``.
    """
    if spec == "pty":
        return _Pty(stop, tell)
    if spec.startswith("serial:"):
        return _Serial(*serial_port(spec, "--to"))
    kind, place = _addressed(spec, ("udp", "tcp"))
    return _Udp(place) if kind == "udp" else _Tcp(place, stop, tell)


def open_device(spec: str, stop: Stop, tell: Tell) -> Link | Pushes:
    """What ``play --to`` names: a link, or ``http://HOST:PORT``, to which a phone pushes; errors as ``open_link``."""
    if spec.startswith("http://"):
        return Pushes(_addressed(spec, ("http",))[1], stop, tell)
    return open_link(spec, stop, tell)


def _addressed(spec: str, kinds: tuple[str, ...]) -> tuple[str, tuple[str, int]]:
    """Kind, host and port of a place in the network."""
    kind, slashes, address = spec.partition("://")
    host, _, port = address.rstrip("/").rpartition(":")
    if kind not in kinds or not slashes or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ConfigError(
            f"{spec}: expected pty, serial:PORT[@BAUD], udp://HOST:PORT, tcp://HOST:PORT or http://HOST:PORT"
        )
    return kind, (host.strip("[]") or "127.0.0.1", int(port))


class _Udp:
    def __init__(self, place: tuple[str, int]) -> None:
        try:
            family, kind, _, _, address = socket.getaddrinfo(*place, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise DataError(f"{place[0]}: {error.strerror or error}") from error
        self._socket, self._address = socket.socket(family, kind), address

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, self._address)

    def received(self) -> bytes:
        return _waiting(self._socket)

    def close(self) -> None:
        self._socket.close()


class _Tcp:
    def __init__(self, place: tuple[str, int], stop: Stop, tell: Tell) -> None:
        self._socket = _connected(place, stop, tell)

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def received(self) -> bytes:
        return _waiting(self._socket)

    def close(self) -> None:
        with contextlib.suppress(OSError):  # what was sent is to be read before the end
            self._socket.shutdown(socket.SHUT_WR)
        self._socket.close()


def _connected(place: tuple[str, int], stop: Stop, tell: Tell) -> socket.socket:
    waited = False
    while True:
        try:
            return socket.create_connection(place, timeout=10.0)
        except OSError as error:
            if stop():
                raise DataError(f"{place[0]}:{place[1]}: {error.strerror or error}") from error
            if not waited:
                tell(f"waiting for somebody to listen on {place[0]}:{place[1]}")
            waited = True
            time.sleep(_AGAIN_S)


def _waiting(connected: socket.socket) -> bytes:
    parts = []
    while select.select([connected], [], [], 0)[0] and (data := connected.recv(1 << 16)):
        parts.append(data)
    return b"".join(parts)


class Pushes:
    """A phone that pushes."""

    def __init__(self, place: tuple[str, int], stop: Stop, tell: Tell) -> None:
        self._place = place
        _connected(place, stop, tell).close()

    def push(self, message: dict[str, Any]) -> None:
        """Push what was measured; OSError if it is not taken."""
        from http.client import HTTPConnection, HTTPException

        connection = HTTPConnection(*self._place, timeout=10.0)
        try:
            connection.request("POST", "/android", json.dumps(message), {"Content-Type": "application/json"})
            answer = connection.getresponse()
            said = answer.read().decode("utf-8", "replace").strip()
        except HTTPException as error:
            raise OSError(str(error)) from error
        finally:
            connection.close()
        if answer.status != 200:
            raise OSError(f"{answer.status} {said}")

    def close(self) -> None:
        """Each push was a connection of its own."""


class _Serial:
    def __init__(self, port: str, baud: int) -> None:
        import serial

        try:
            self._port = serial.Serial(port, baud, timeout=0)
        except (serial.SerialException, ValueError) as error:
            raise DataError(f"serial port {port}: cannot be opened: {error}") from error

    def send(self, data: bytes) -> None:
        self._port.write(data)

    def received(self) -> bytes:
        return self._port.read(1 << 16)

    def close(self) -> None:
        self._port.close()


class _Pty:
    """A pseudo-terminal, which whoever reads it takes for a serial port."""

    def __init__(self, stop: Stop, tell: Tell) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self._name = name = os.ttyname(slave)
        os.close(slave)
        tell(f"the device is at {name}: fbgraph online --source serial:{name} --out runs/live")
        self._stop = stop
        watched = select.poll()
        watched.register(self._master, select.POLLHUP)
        while watched.poll(0) and not stop():  # nobody has it open
            time.sleep(0.05)
        time.sleep(_SETTLE_S)

    def send(self, data: bytes) -> None:
        while data:
            while not select.select([], [self._master], [], _POLL_S)[1]:
                if self._stop():
                    return
            data = data[os.write(self._master, data[:1024]) :]

    def received(self) -> bytes:
        parts = []
        with contextlib.suppress(OSError):  # nobody has it open any more
            while select.select([self._master], [], [], 0)[0] and (data := os.read(self._master, 1 << 16)):
                parts.append(data)
        return b"".join(parts)

    def close(self) -> None:
        """Let go when all is read: what is not would be lost."""
        with contextlib.suppress(OSError):
            slave = os.open(self._name, os.O_RDWR | os.O_NOCTTY)
            empty = 0  # times in a row that nothing waited: what is on its way there is not counted
            while empty < 6 and not self._stop():
                empty = 0 if any(fcntl.ioctl(slave, termios.FIONREAD, bytes(4))) else empty + 1
                time.sleep(0.05)
            os.close(slave)
        os.close(self._master)
