"""Between a live walk and those around it: what its device is told, and what is known of the device meanwhile."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import monotonic

from fbgraph.core.errors import ConfigError
from fbgraph.estimators.estimates import Update
from fbgraph.readers.device_links import open_link
from fbgraph.readers.numbered_lines import sealed
from fbgraph.readers.raw_recorder import LineCutter
from fbgraph.readers.sources import Source
from fbgraph.way_back.short_lines import short_line

_AGAIN_S = 1.0  # a line that was lost is there a second later
_SILENT_S = 10.0
_RATE_S = 3.0
_VOLTS = (2.5, 15.0)  # that a battery's may be
Tell = Callable[[str], None]


class Teller:
    """Tells a device what its wearer is to do next, again and again: links lose lines."""

    def __init__(self, send: Callable[[bytes], object]) -> None:
        """Nothing is told yet.

        Args:
            send: takes a line to the device.
        """
        self._send = send
        self._line = b""
        self._sent_s = -1e9

    def update(self, update: Update) -> None:
        """Take what was told at a step."""
        if update.returning is not None and (text := short_line(update.returning)):
            self._line, self._sent_s = sealed(b"!", text.encode()), -1e9
        self.remind(monotonic())

    def remind(self, now_s: float) -> None:
        """Send the last line, if it is new or a second old."""
        if self._line and now_s - self._sent_s >= _AGAIN_S:
            self._sent_s = now_s
            self._send(self._line)


def open_teller(spec: str, source_spec: str, source: Source, tell: Tell) -> Teller:
    """Who tells the device, or another one.

    Args:
        spec: ``device`` for the link that the lines come from, ``serial`` for the same if that is a serial port,
            ``serial:PORT[@BAUD]``, ``udp://HOST:PORT`` or ``tcp://HOST:PORT``.
        source_spec: of the source.
        source: where the lines come from.
        tell: called once if nobody takes the lines.

    Raises:
        ConfigError: not such a specification, or a source that knows no way back.
        DataError: nobody listens there.
    """
    if spec == "device" or (spec == "serial" and source_spec.startswith("serial:")):
        if source_spec == "stdin" or source_spec.startswith("http://"):
            raise ConfigError(
                f"--tell {spec}: {source_spec} knows no way back; name udp://HOST:PORT or tcp://HOST:PORT"
            )
        return Teller(source.send)
    if spec in ("serial", "pty") or spec.startswith("http://"):
        raise ConfigError(f"--tell {spec}: expected device, serial:PORT[@BAUD], udp://HOST:PORT or tcp://HOST:PORT")
    link, failed = open_link(spec, lambda: True, tell), list[str]()

    def send(line: bytes) -> None:
        try:
            link.send(line)
            link.received()  # what a display says is for nobody
        except OSError as error:  # a display that is gone ends no walk
            if not failed:
                tell(f"--tell {spec}: nobody takes what is told: {error.strerror or error}")
            failed.append(spec)

    return Teller(send)


@dataclass
class Heard:
    """What is known of a device from its lines.

    Attributes:
        first_s: after how many seconds the first line came; None before it.
        rows: lines that came.
        rate_hz: of lines, lately.
        battery_v: as its last line with a battery's voltage says; None if none does.
        silent_s: since when nothing came, if that is long; None else.
    """

    first_s: float | None = None
    rows: int = 0
    rate_hz: float = 0.0
    battery_v: float | None = None
    silent_s: float | None = None


class Listener:
    """Listens to what passes from a source to who records it.

    Attributes:
        heard: what is known of the device.
    """

    def __init__(self, tell: Tell, now_s: Callable[[], float] = monotonic) -> None:
        """Nothing has come.

        Args:
            tell: called when the first line came, when nothing comes for long, and when it comes again.
            now_s: a clock.
        """
        self._tell, self._now_s = tell, now_s
        self._began_s = self._last_s = now_s()
        self._cutter = LineCutter()
        self._recent: deque[tuple[float, int]] = deque()
        self._battery: int | None = None
        self.heard = Heard()

    def through(self, pieces: Iterator[bytes], each: Callable[[], None]) -> Iterator[bytes]:
        """The same pieces; ``each`` is called after every one."""
        for data in pieces:
            self._note(data)
            yield data
            each()

    def _note(self, data: bytes) -> None:
        now_s, heard = self._now_s(), self.heard
        if data:
            if heard.first_s is None:
                heard.first_s = now_s - self._began_s
                self._tell(f"the first line came after {heard.first_s:.1f} s")
            elif heard.silent_s is not None:
                self._tell(f"lines come again, after {now_s - self._last_s:.0f} s")
            heard.silent_s, self._last_s = None, now_s
            lines = self._cutter.push(data)
            heard.rows += len(lines)
            self._recent.append((now_s, len(lines)))
            for line in lines:
                self._look(line)
        elif now_s - self._last_s >= _SILENT_S:
            if heard.silent_s is None:
                since = (
                    "the first line is still awaited" if heard.first_s is None else "is the device on, and in reach?"
                )
                self._tell(f"nothing came for {now_s - self._last_s:.0f} s: {since}")
            heard.silent_s = now_s - self._last_s
        while self._recent and now_s - self._recent[0][0] > _RATE_S:
            self._recent.popleft()
        heard.rate_hz = sum(count for _, count in self._recent) / min(_RATE_S, max(now_s - self._began_s, 0.1))

    def _look(self, line: str) -> None:
        """Find the column of the battery's voltage in a header, and its value in a row."""
        fields = line.split(",")
        if line[:1].isalpha():
            volts = [i for i, name in enumerate(fields) if _is_battery(name)]
            self._battery = volts[0] if volts else None
        elif self._battery is not None and self._battery < len(fields) and fields[self._battery].strip():
            try:
                volts_v = float(fields[self._battery])
            except ValueError:
                return
            if _VOLTS[0] <= volts_v <= _VOLTS[1]:
                self.heard.battery_v = volts_v


def _is_battery(name: str) -> bool:
    name = name.strip().lower()
    return name.startswith(("bat", "vbat")) and not name.endswith(("ma", "_a", "pct", "percent", "level"))


def status_text(heard: Heard, steps: int, distance_m: float, caution: str | None) -> str:
    """How a live walk stands, in a line: rate, steps, battery, verdict."""
    parts = [f"{heard.rate_hz:.0f} lines/s", f"{steps} steps", f"{distance_m:.0f} m"]
    if heard.battery_v is not None:
        parts.append(f"battery {heard.battery_v:.2f} V")
    parts.append("no line yet" if heard.first_s is None else "doubtful" if caution else "sound")
    if heard.silent_s is not None and heard.first_s is not None:
        parts.append(f"silent for {heard.silent_s:.0f} s")
    return "  ".join(parts)
