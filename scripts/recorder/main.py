"""The recorder on an M5StickC Plus with UIFlow2. See README.md; untested on hardware."""

import os
import select
import socket
import sys

import M5
import micropython
import network
from machine import I2C, Pin
from recorder import CLICK, HOLD, MARK, Hardware, Recorder, run
from settings import LINK, WIFI
from utime import sleep_ms, ticks_us
from walk_file import Link

_WRAP = 1 << 30  # of ticks_us
_RETRY_US = 3_000_000


class Stick(Hardware):
    """The stick."""

    device = "M5StickC Plus"
    folder = "/flash/fbgraph"

    def __init__(self) -> None:
        M5.begin()
        M5.Lcd.setRotation(1)
        M5.Lcd.setTextSize(2)
        M5.Lcd.setTextColor(0xFFFFFF, 0x000000)
        self.stick = I2C(0, sda=Pin(21), scl=Pin(22), freq=400_000)
        self.hats = [I2C(1, sda=Pin(0), scl=Pin(26), freq=400_000)]
        self._ticks = ticks_us()
        self._now_us = 0
        self._shown: list[str] = []
        try:
            os.mkdir(self.folder)
        except OSError:
            pass

    def now_us(self) -> int:
        ticks = ticks_us()
        self._now_us += (ticks - self._ticks) % _WRAP
        self._ticks = ticks
        return self._now_us

    def sleep_ms(self, wait_ms: int) -> None:
        sleep_ms(wait_ms)

    def button(self) -> str:
        M5.update()
        if M5.BtnA.wasHold():
            return HOLD
        if M5.BtnA.wasClicked():
            return CLICK
        return MARK if M5.BtnB.wasClicked() else ""

    def show(self, lines: list[str]) -> None:
        for i in range(max(len(lines), len(self._shown))):
            line = "%-20s" % (lines[i] if i < len(lines) else "")
            if i >= len(self._shown) or line != self._shown[i]:
                M5.Lcd.drawString(line, 0, 17 * i)
        self._shown = ["%-20s" % line for line in lines]

    def free_bytes(self) -> int:
        found = os.statvfs("/flash")
        return int(found[0] * found[3])

    def walk_name(self) -> str:
        return "%04x" % (int.from_bytes(os.urandom(2), "big"))


class Serial(Link):
    """The USB cable, where the REPL was."""

    def __init__(self) -> None:
        micropython.kbd_intr(-1)
        self._poll = select.poll()
        self._poll.register(sys.stdin, select.POLLIN)

    def write(self, data: bytes) -> bool:
        sys.stdout.write(data.decode())
        return True

    def read(self) -> bytes:
        data = b""
        while self._poll.poll(0) and len(data) < 256:
            data += sys.stdin.read(1).encode()
        return data


class Wireless(Link):
    """UDP or TCP over Wi-Fi, joined again whenever it was lost; never waits for longer than a moment."""

    def __init__(self, hardware: Hardware, spec: str, wifi: tuple[str, str]) -> None:
        kind, _, address = spec.partition("://")
        host, _, port = address.partition(":")
        self._hardware, self._tcp, self._place, self._wifi = hardware, kind == "tcp", (host, int(port)), wifi
        self._station = network.WLAN(network.STA_IF)
        self._station.active(True)
        self._socket: socket.socket | None = None
        self._retry_us = 0

    def _connected(self) -> socket.socket | None:
        now_us = self._hardware.now_us()
        if self._socket is not None or now_us < self._retry_us:
            return self._socket
        self._retry_us = now_us + _RETRY_US
        if not self._station.isconnected():
            try:
                self._station.connect(*self._wifi)
            except OSError:  # it is trying already
                pass
            return None
        made = socket.socket(socket.AF_INET, socket.SOCK_STREAM if self._tcp else socket.SOCK_DGRAM)
        try:
            made.settimeout(0.3)
            made.connect(self._place)
            made.settimeout(0.05)
        except OSError:
            made.close()
            return None
        self._socket = made
        return made

    def _lost(self) -> None:
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def write(self, data: bytes) -> bool:
        connected = self._connected()
        if connected is None:
            return False
        try:
            if connected.send(data) == len(data):
                return True
        except OSError:
            pass
        self._lost()
        return False

    def read(self) -> bytes:
        if self._socket is None:
            return b""
        try:
            self._socket.settimeout(0)
            data = self._socket.recv(256)
            if not data and self._tcp:
                self._lost()
            return data
        except OSError:
            return b""
        finally:
            if self._socket is not None:
                self._socket.settimeout(0.05)


def start() -> None:
    """Run for as long as the stick is on."""
    stick = Stick()
    link = Serial() if LINK == "serial" else Wireless(stick, LINK, WIFI)
    run(Recorder(stick, link), stick, lambda: False)


if __name__ == "__main__":
    start()
