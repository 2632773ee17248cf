"""Sensor Logger's pushes over HTTP as lines of a wearable: a phone is a live device without any hardware.

The app posts ``{"messageId": 1, "sessionId": "…", "deviceId": "…", "payload": [{"name": "gyroscope", "time": 1698…,
"values": {"x": 0.1, …}}, …]}`` every so often (PUSHING.md of github.com/tszheichoi/awesome-sensor-logger): times are
Unix nanoseconds, values SI, µT and hPa, sensors one after the other. Here they become rows in order of time.
"""

from __future__ import annotations

import heapq
import json
import math
import queue
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from http.server import BaseHTTPRequestHandler
from socketserver import TCPServer
from typing import Any

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.errors import DataError
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from fbgraph.readers.canonical_csv import remark_of

HEADER = "t_ns," + CANONICAL.partition(",")[2]
REMARK = "# " + remark_of("sensor_logger", "phone")
"""First line, by which ``smooth`` takes the configuration of phones (``canonical_csv.noted_preset``)."""
MOST_BODY = 1 << 23
"""Bytes of a push: a minute of every sensor."""
_WAITING = 32  # pushes that nobody took yet
_POLL_S, _PATIENCE_S = 0.2, 5.0
_SILENT_NS = 3_000_000_000  # a sensor silent for so long is not waited for
_AHEAD_NS = 3_600_000_000_000  # a time so far ahead of all others is garbled
_PAIR_NS = 100_000_000  # gravity this old still belongs to an acceleration
_GRAVITY, _TOTAL, _LINEAR = "gravity", "totalacceleration", "accelerometer"
_COLUMNS = {_TOTAL: (1, STANDARD_GRAVITY_M_S2), "gyroscope": (4, DEGREE_RAD), "magnetometer": (7, 1.0)}
_PRESSURE, _EVENT, _WIDTH = 10, 12, 13
_ORDER = (_GRAVITY, _TOTAL, _LINEAR, "gyroscope", "magnetometer", "barometer", "annotation")  # in one row
_Sample = tuple[int, int, tuple[float, ...], str]
Tell = Callable[[str], None]


class PushedRows:
    """Pushes in, canonical rows in order of time out.

    A sample waits until every sensor that is still heard has told something later, for a push holds one sensor after
    the other; the wait is as long as the app collects before it pushes.
    """

    def __init__(self, tell: Tell = lambda text: None) -> None:
        """No push has come.

        Args:
            tell: called with what was assumed.
        """
        self._tell = tell
        self._heap: list[_Sample] = []
        self._latest: dict[str, int] = {}
        self._told: set[str] = set()
        self._headed = False
        self._gravity: tuple[int, tuple[float, ...]] | None = None
        self._done_ns = -1
        self.late = 0
        self.ios: bool | None = None

    def push(self, message: Mapping[str, Any]) -> bytes:
        """Take a push; return the rows that are complete with it, the header before the first.

        Raises:
            ValueError: it is none.
        """
        payload = message.get("payload")
        if not isinstance(payload, list):
            raise ValueError("no list named payload in it")
        for item in payload:
            if isinstance(item, dict):
                self._take(item)
        if not self._latest:
            return b""
        newest = max(self._latest.values())
        return self._rows(min(t for t in self._latest.values() if newest - t <= _SILENT_NS))

    def finish(self) -> bytes:
        """The rows that were waiting for others."""
        if self.late:
            self._tell(f"{self.late} samples came too late to be put in order of time, and were left out")
        return self._rows(math.inf)

    def _take(self, item: dict[str, Any]) -> None:
        name = "".join(c for c in str(item.get("name", "")).lower() if c.isalpha())
        values = item.get("values")
        if name not in _ORDER or not isinstance(values, dict):
            return
        try:
            t_ns = int(item["time"])
            wanted = ("pressure",) if name == "barometer" else () if name == "annotation" else ("x", "y", "z")
            numbers = tuple(float(values[key]) for key in wanted)
        except (KeyError, TypeError, ValueError, OverflowError):
            return
        if not all(map(math.isfinite, numbers)) or not 0 <= t_ns < 1 << 62:
            return
        if self._latest and t_ns > max(self._latest.values()) + _AHEAD_NS:
            return
        if name != "annotation":
            self._latest[name] = max(t_ns, self._latest.get(name, 0))
        if t_ns <= self._done_ns:
            self.late += 1
            return
        heapq.heappush(self._heap, (t_ns, _ORDER.index(name), numbers, str(values.get("text") or "mark")))

    def _rows(self, until_ns: float) -> bytes:
        rows: list[str] = []
        while self._heap and self._heap[0][0] <= until_ns:
            t_ns = self._heap[0][0]
            row = [""] * _WIDTH
            while self._heap and self._heap[0][0] == t_ns:
                _, order, numbers, text = heapq.heappop(self._heap)
                self._fill(row, t_ns, _ORDER[order], numbers, text)
            self._done_ns = t_ns
            if any(row):
                row[0] = str(t_ns)
                rows.append(",".join(row))
        if rows and not self._headed:
            self._headed = True
            rows[:0] = [REMARK, HEADER]
        return "".join(f"{row}\n" for row in rows).encode()

    def _fill(self, row: list[str], t_ns: int, name: str, numbers: tuple[float, ...], text: str) -> None:
        """Put a sample into its row."""
        if name == "annotation":
            row[_EVENT] = " ".join("".join(c if c.isalnum() or c in "-_." else " " for c in text[:80]).split())
        elif name == "barometer":
            row[_PRESSURE] = f"{numbers[0]:.9g}"
        elif name == _GRAVITY:
            self._gravity = t_ns, numbers
        elif name == _LINEAR:
            if _TOTAL in self._latest:
                return
            if self._gravity is None or t_ns - self._gravity[0] > _PAIR_NS:
                self._once("the phone sends acceleration without gravity: switch on Gravity or TotalAcceleration")
                return
            ios = self.ios is not False
            if self.ios is None:
                self._once("taken for an iPhone, whose signs are turned round; if it is none, let it push to …/android")
            sign = -1.0 if ios else 1.0
            total = tuple(sign * (a + b) for a, b in zip(numbers, self._gravity[1], strict=True))
            self._fill(row, t_ns, _TOTAL, total, text)
        else:
            first, unit = _COLUMNS[name]
            row[first : first + 3] = [f"{value / unit:.9g}" for value in numbers]

    def _once(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self._tell(text)


class _Server(TCPServer):
    """Takes one push at a time, of one phone."""

    allow_reuse_address = True

    def __init__(self, address: tuple[str, int], tell: Tell) -> None:
        self.taken: queue.Queue[tuple[str, dict[str, Any]]] = queue.Queue(_WAITING)
        self.phone: tuple[str, str] | None = None
        self._tell = tell
        self._turned_away: set[str] = set()
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        super().__init__(address, _Handler)

    def is_phone(self, host: str, device: str) -> bool:
        """Whether this is the phone that is recorded: the first that pushed."""
        self.phone = self.phone or (host, device)
        if self.phone == (host, device):
            return True
        if host not in self._turned_away and len(self._turned_away) < _WAITING:
            self._turned_away.add(host)
            self._tell(f"{host} was turned away: the phone at {self.phone[0]} is recorded")
        return False

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that breaks off is no error of ours; anything else is told."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _PATIENCE_S

    def do_POST(self) -> None:
        """Take a push, or say why not."""
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal():
            return self._answer(411, "Content-Length is missing")
        if int(length) > MOST_BODY:
            return self._answer(413, f"more than {MOST_BODY} bytes; let the app push more often")
        body = self.rfile.read(int(length))
        if len(body) < int(length):
            return self._answer(400, "cut short")
        try:
            message = json.loads(body)
        except (ValueError, RecursionError):
            return self._answer(400, "no JSON")
        if not isinstance(message, dict) or not isinstance(message.get("payload"), list):
            return self._answer(400, "no push of Sensor Logger: no list named payload")
        if not message["payload"]:
            return self._answer(200, "nothing in it")
        if not self.server.is_phone(self.client_address[0], str(message.get("deviceId", ""))[:200]):
            return self._answer(409, "another phone is recorded")
        try:
            self.server.taken.put((self.path, message), timeout=_PATIENCE_S)
        except queue.Full:
            return self._answer(503, "too much at once")
        return self._answer(200, "taken")

    def do_GET(self) -> None:
        """For who tries the address in a browser."""
        self._answer(200, "fbgraph takes Sensor Logger's HTTP pushes here")

    def _answer(self, code: int, text: str) -> None:
        data = f"{text}\n".encode()
        self.send_response(code)
        self.send_header("Content-Type", "text/plain")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: it is not for the user."""


def pushes(host: str, port: int, stop: Callable[[], bool], tell: Tell) -> Iterator[bytes]:
    """Rows of what a phone pushes to ``http://host:port``, in pieces; nothing, several times a second, in silence.

    Where the path of the address that it pushes to ends in ``ios`` or ``android``, its signs are those; if it does not,
    acceleration without gravity, and gravity, but no total acceleration are taken for an iPhone's, and that is told.

    Raises:
        DataError: nobody can listen there.
    """
    try:
        server = _Server((host, port), tell)
    except OSError as error:
        raise DataError(f"{host}:{port}: cannot listen there: {error.strerror or error}") from error
    threading.Thread(target=server.serve_forever, args=(_POLL_S,), daemon=True).start()

    def received() -> Iterator[bytes]:
        rows = PushedRows(tell)
        try:
            while not (stop() and server.taken.empty()):
                try:
                    path, message = server.taken.get(timeout=_POLL_S)
                except queue.Empty:
                    yield b""
                    continue
                system = path.rstrip("/").rpartition("/")[2].lower()
                rows.ios = {"ios": True, "android": False}.get(system, rows.ios)
                yield rows.push(message)
            yield rows.finish()
        finally:
            server.shutdown()
            server.server_close()

    return received()
