"""Where live lines come from: standard input, a serial port, a UDP or TCP socket, HTTP. Bytes in, and a way back."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from fbgraph.columns.column_names import names_accelerometer
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.tables.dialect import SEPARATORS, split
from fbgraph.tables.fields import number

_AT_ONCE = 1000  # datagrams
_POLL_S = 0.2  # how soon a source notices that it should stop
_CHUNK = 65536
_BUFFER = 1 << 22  # bytes of datagrams that wait; the system may allow less
_BAUD = 115200
_ROW_FIELDS = 6  # of a line with accelerometer and gyroscope
_LOOKED_AT = 20  # lines of a datagram, in search of one
_GONE_S = 2.0  # a sender silent for so long may come back from another port of its host
_REOPEN_S = 0.5  # how often a serial port that went away is looked for
_BUSY = b"busy: another device is connected\n"

Stop = Callable[[], bool]
Tell = Callable[[str], None]
"""Called with a sentence for the user."""


@dataclass
class Source:
    """Pieces of input as they arrive, and a way back to the device that sends them.

    Attributes:
        pieces: bytes, cut anywhere; nothing, ``b""``, several times a second while there is silence.
        where: where it is waited for, for people.
        back: sends bytes to the device; None while none is connected, or its link knows no way back.
    """

    pieces: Iterator[bytes] = field(default_factory=lambda: iter(()))
    where: str = ""
    back: Callable[[bytes], object] | None = None

    def __iter__(self) -> Iterator[bytes]:
        return self

    def __next__(self) -> bytes:
        return next(self.pieces)

    def send(self, data: bytes) -> bool:
        """Send bytes to the device; whether there was one, as far as one knows."""
        if self.back is None:
            return False
        try:
            self.back(data)
        except OSError:  # it went away; who reads from it will notice
            return False
        return True


def open_source(spec: str, stop: Stop, tell: Tell = lambda text: None) -> Source:
    """Open a source of live lines, which ends when its input does or ``stop()`` is true.

    A device that disconnects, or whose cable is pulled, is waited for again. One sender is listened to: of UDP and
    HTTP the first that sends a row, for the whole walk; others are left out, and told.

    Args:
        spec: ``stdin``, ``serial:PORT[@BAUD]`` (115200 baud if not told), ``udp://[HOST]:PORT``, ``tcp://[HOST]:PORT``
            or ``http://[HOST]:PORT`` for the pushes of Sensor Logger. Sockets wait for the device to send or connect,
            on the loopback address unless a host is named.
        stop: asked several times a second.
        tell: called when another sender is left out, or a device comes or goes.

    Raises:
        ConfigError: not such a specification.
        DataError: the port or address cannot be opened.
    """
    source = Source()
    if spec == "stdin":
        source.pieces, source.where = _stdin(stop), "reading standard input"
        return source
    if spec.startswith("serial:"):
        port, baud = serial_port(spec, "--source")
        source.pieces, source.where = _serial(port, baud, source, stop, tell), f"reading serial port {port}"
        return source
    kind, slashes, address = spec.partition("://")
    host, _, port = address.rstrip("/").rpartition(":")
    if kind not in ("udp", "tcp", "http") or not slashes or not port.isdecimal() or int(port) > 65535:
        raise ConfigError(
            f"--source {spec}: expected stdin, serial:PORT[@BAUD], udp://HOST:PORT, tcp://HOST:PORT or http://HOST:PORT"
        )
    host = host.strip("[]") or "127.0.0.1"
    if kind == "http":
        from fbgraph.readers.phone_pushes import pushes  # a server, which few need

        source.pieces = pushes(host, int(port), stop, tell)
    else:
        source.pieces = (_udp if kind == "udp" else _tcp)(host, int(port), source, stop, tell)
    source.where = f"listening on {kind}://{host}:{port}"
    if host in ("127.0.0.1", "::1", "localhost"):
        source.where += f" of this machine; for other devices: --source {kind}://0.0.0.0:{port}"
    elif (place := _own_address()) and host == "0.0.0.0":
        source.where += f"; for other devices {kind}://{place}:{port}"
    return source


def _own_address() -> str:
    """The address of this machine as its network sees it; nothing is sent to find it. Empty without a network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address that is nobody's (RFC 5737)
        except OSError:
            return ""
        return str(probe.getsockname()[0])


def serial_port(spec: str, option: str) -> tuple[str, int]:
    """Port and baud rate of ``serial:PORT[@BAUD]``.

    Raises:
        ConfigError: not such a specification.
    """
    port, at, baud = spec.removeprefix("serial:").rpartition("@") if "@" in spec else (spec[7:], "", "")
    if not port or (at and not baud.isdecimal()):
        raise ConfigError(f"{option} {spec}: expected serial:PORT[@BAUD], for example serial:/dev/ttyUSB0@115200")
    return port, int(baud) if at else _BAUD


def _stdin(stop: Stop) -> Iterator[bytes]:
    return _read(sys.stdin.fileno(), stop)


def _read(descriptor: int, stop: Stop) -> Iterator[bytes]:
    while not stop():
        data = b""
        if select.select([descriptor], [], [], _POLL_S)[0]:
            data = os.read(descriptor, _CHUNK)
            if not data:
                return
        yield data


def _serial(port: str, baud: int, source: Source, stop: Stop, tell: Tell) -> Iterator[bytes]:
    import serial  # only who has a cable needs it

    def opened() -> serial.Serial:
        return serial.Serial(port, baud, timeout=_POLL_S, write_timeout=_POLL_S)

    try:
        first = opened()
    except (serial.SerialException, ValueError) as error:
        raise DataError(f"serial port {port}: cannot be opened: {error}") from error

    def lines() -> Iterator[bytes]:
        device: serial.Serial | None = first
        torn = False
        while not stop():
            if device is None:
                time.sleep(_REOPEN_S)
                try:
                    device = opened()
                except OSError:
                    yield b""
                    continue
                tell(f"serial port {port} is back")
            source.back = device.write
            try:
                data = device.read(max(device.in_waiting, 1))
            except (OSError, TypeError):  # the cable was pulled
                with contextlib.suppress(OSError):
                    device.close()
                device, source.back = None, None
                tell(f"serial port {port} went away; waiting for it to come back")
                data = b"\n" if torn else b""
            torn = not data.endswith((b"\n", b"\r")) if data else torn
            yield data
        if device is not None:
            device.close()

    return lines()


class OneSender:
    """Which of those who send datagrams is the device: the first who sends a row, for the whole walk.

    Attributes:
        left_out: datagrams of others.
    """

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._address: tuple[str, int] | None = None
        self._heard_s = 0.0
        self.left_out = 0

    def is_device(self, address: tuple[str, int], data: bytes, now_s: float) -> bool:
        """Whether a datagram that came from this address at this time is the device's, as far as one knows."""
        if address != self._address and _holds_row(data):
            restarted = self._address is not None and address[0] == self._address[0]
            if self._address is None or (restarted and now_s - self._heard_s > _GONE_S):
                self._address = address
        if self._address not in (None, address):
            if not self.left_out:
                self._tell(f"lines that {_place(address)} sends are left out: {_place(self._address)} is recorded")
            self.left_out += 1
            return False
        self._heard_s = now_s
        return True

    def ended(self) -> None:
        """Tell what was left out."""
        if self.left_out:
            self._tell(f"{self.left_out} datagrams of other senders were left out")


def _place(address: tuple[str, int] | None) -> str:
    return "nobody" if address is None else f"{address[0]}:{address[1]}"


def _holds_row(data: bytes) -> bool:
    """Whether a line of these names an accelerometer, or is numbers enough to be a row; strays may chatter."""
    for line in data.decode("latin-1").splitlines()[:_LOOKED_AT]:
        for separator in SEPARATORS:
            fields = split(line, separator, monitor=True)
            if len(fields) < _ROW_FIELDS:
                continue
            decimals = "." if separator == "," else ".,"
            if any(sum(number(field, decimal) is not None for field in fields) >= _ROW_FIELDS for decimal in decimals):
                return True
            if names_accelerometer(fields):
                return True
    return False


def _udp(host: str, port: int, source: Source, stop: Stop, tell: Tell) -> Iterator[bytes]:
    receiver = _bound(socket.SOCK_DGRAM, host, port)
    receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)

    def datagrams() -> Iterator[bytes]:
        sender = OneSender(tell)
        with receiver:
            while not stop():
                parts: list[bytes] = []
                wait_s = _POLL_S
                while len(parts) < _AT_ONCE and select.select([receiver], [], [], wait_s)[0]:
                    data, address = receiver.recvfrom(_CHUNK)
                    if sender.is_device(address[:2], data, time.monotonic()):
                        source.back = partial(_send_datagram, receiver, address)
                        # a datagram holds whole lines
                        parts.append(data if data.endswith((b"\n", b"\r")) else data + b"\n")
                    wait_s = 0.0  # what else is there already: the system keeps a few hundred, no more
                yield b"".join(parts)
        sender.ended()

    return datagrams()


def _send_datagram(sender: socket.socket, address: Any, data: bytes) -> None:
    sender.sendto(data, address)


def _tcp(host: str, port: int, source: Source, stop: Stop, tell: Tell) -> Iterator[bytes]:
    server = _bound(socket.SOCK_STREAM, host, port)
    server.listen(1)

    def received() -> Iterator[bytes]:
        device: socket.socket | None = None
        host_of = ""
        heard_s = 0.0
        heard = torn = told = False  # who has connected but said nothing gives way to who comes later
        try:
            while not stop():
                ready = select.select([s for s in (server, device) if s is not None], [], [], _POLL_S)[0]
                data = b""
                if device is not None and device in ready:
                    data, heard_s = _received(device), time.monotonic()
                    heard = heard or bool(data)
                    if not data:  # the device went away; it may come back
                        device.close()
                        device, data = None, b"\n" if torn else b""
                        source.back = None
                        if heard:
                            tell("the device disconnected; waiting for it to come back")
                    torn = bool(data) and not data.endswith((b"\n", b"\r"))
                elif server in ready:  # only when all that the device sent is read, its farewell included
                    caller, address = server.accept()
                    back_again = address[0] == host_of and time.monotonic() - heard_s > _GONE_S
                    if device is not None and heard and not back_again:
                        _turn_away(caller)
                        if not told:
                            tell(f"{_place(address[:2])} was turned away: a device is connected; so is who comes next")
                        told = True
                    else:
                        if device is not None:
                            device.close()
                        data, torn = b"\n" if torn else b"", False
                        device, host_of, heard = caller, address[0], False
                        device.settimeout(_POLL_S)
                        source.back = device.sendall
                yield data
        finally:
            server.close()
            if device is not None:
                device.close()

    return received()


def _turn_away(caller: socket.socket) -> None:
    with contextlib.suppress(OSError):
        caller.settimeout(_POLL_S)
        caller.sendall(_BUSY)
    caller.close()


def _received(device: socket.socket) -> bytes:
    """What came; nothing if the connection ended, in whatever way."""
    try:  # select said that something is there
        return device.recv(_CHUNK)
    except OSError:
        return b""


def _bound(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind)[0]
        bound = socket.socket(family, kind)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
    except OSError as error:
        raise DataError(f"{host}:{port}: cannot listen there: {error.strerror or error}") from error
    return bound
