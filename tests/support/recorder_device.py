"""A simulated M5StickC Plus for the recorder: its buses as register maps, its flash, buttons and screen.

Runs on MicroPython (``micropython recorder_device.py FRAMES FOLDER SPEED BUTTONS``: standard input and output are the
serial port) and on CPython. FRAMES holds what the chips' registers show every 10 ms; its clock goes on by the turn, not
by the computer's, so that a busy computer loses nothing.
"""

import json
import select
import struct
import sys
import time

try:  # noqa: SIM105  nor contextlib
    from typing import BinaryIO
except ImportError:  # MicroPython has no such module, and does not look at annotations
    pass

if __name__ == "__main__":
    sys.path.insert(0, __file__.rsplit("/", 3)[0] + "/scripts/recorder")

from recorder import Hardware, Recorder
from sensors import Bus
from walk_file import Link

RECORD = 14 + 8 + 6
TURN_US = 20_000
BMM_TRIM = struct.pack("<bb", 0, 0), struct.pack("<hbb", 0, 26, 26), struct.pack("<hHHhbB", 763, 24747, 7053, 0, -3, 29)
QMP_OTP = bytes([0x41, 0xE8]) + struct.pack(">hhhhhhhh", -4000, 300, 1500, -900, 700, -400, 250, -600)
QMP_OTP += bytes([0x0F, 0xA0]) + struct.pack(">hh", -1200, 900) + bytes([0x53])


class Chip:
    """Registers that can be read and written."""

    def __init__(self) -> None:
        self.registers = bytearray(256)

    def read(self, register: int, count: int) -> bytes:
        return bytes(self.registers[register : register + count])

    def write(self, register: int, data: bytes) -> None:
        self.registers[register : register + len(data)] = data


class Frames:
    """What the sensors measure, every 10 ms of the device's clock; the last for ever. In a file: memory is short."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._last = file.seek(0, 2) // RECORD - 1

    def at(self, t_us: int) -> bytes:
        self._file.seek(min(t_us // 10_000, self._last) * RECORD)
        return self._file.read(RECORD)


class SimulatedMpu(Chip):
    """Measures only when it is set up as it must be."""

    SET = ((0x6B, 0x01), (0x1C, 0x10), (0x1B, 0x18), (0x19, 0x09), (0x23, 0x18))

    def __init__(self, device: "Device") -> None:
        super().__init__()
        self.registers[0x75] = 0x19
        self._device = device
        self._first = self._read = 0
        self.given = 0  # frames that were read

    def _waiting(self) -> int:
        runs = self.registers[0x6A] & 0x40 and all(self.registers[at] == value for at, value in self.SET)
        return self._device.clock_us // 10_000 - self._read if runs else 0

    def write(self, register: int, data: bytes) -> None:
        super().write(register, data)
        if register == 0x6B and data[0] & 0x80:
            self.registers[0x19:0x6B] = bytes(0x6B - 0x19)
        if register == 0x6A and data[0] & 0x04:
            self._read = self._device.clock_us // 10_000

    def read(self, register: int, count: int) -> bytes:
        if register == 0x72:
            return struct.pack(">H", min(14 * self._waiting(), 1024))
        if register == 0x74:
            data = b""
            while len(data) < count:
                self._read += 1
                self.given += 1
                data += self._device.frames.at(self._read * 10_000)[:14]
            return data
        return super().read(register, count)


class SimulatedBmm(Chip):
    """Ready anew 30 times a second, once it is awake and measures."""

    def __init__(self, device: "Device") -> None:
        super().__init__()
        self._device = device
        self._last = -1

    def read(self, register: int, count: int) -> bytes:
        if self.registers[0x4B] & 1:
            self.registers[0x40] = 0x32
            for at, trim in zip((0x5D, 0x62, 0x68), BMM_TRIM):  # noqa: B905  MicroPython's zip is never strict
                self.registers[at : at + len(trim)] = trim
        if register == 0x42 and self.registers[0x4C] & 0x06 == 0:
            data = bytearray(self._device.frames.at(self._device.clock_us)[14:22])
            ready = self._device.clock_us // 33_333
            data[6] = data[6] & 0xFE | (ready != self._last)
            self._last = ready
            return bytes(data)
        return super().read(register, count)


class SimulatedQmp(Chip):
    """Measures in normal mode."""

    def __init__(self, device: "Device") -> None:
        super().__init__()
        self._device = device
        self.registers[0xD1] = 0x5C
        self.registers[0xA0:0xB9] = QMP_OTP

    def read(self, register: int, count: int) -> bytes:
        if register == 0xF7 and self.registers[0xF4] & 3 == 3:
            return self._device.frames.at(self._device.clock_us)[22:28]
        return super().read(register, count)


class SimulatedBus(Bus):
    """Chips at addresses."""

    def __init__(self, chips: dict[int, Chip]) -> None:
        self.chips = chips

    def scan(self) -> list[int]:
        return sorted(self.chips)

    def _chip(self, address: int) -> Chip:
        if address not in self.chips:
            raise OSError(19)
        return self.chips[address]

    def readfrom_mem(self, address: int, register: int, count: int) -> bytes:
        return self._chip(address).read(register, count)

    def writeto_mem(self, address: int, register: int, data: bytes) -> None:
        self._chip(address).write(register, data)


class Device(Hardware):
    """The stick. Its buttons are pressed at told times of its clock."""

    device = "simulated M5StickC Plus"
    stick: SimulatedBus

    def __init__(self, frames: Frames, folder: str, buttons: list[tuple[float, str]], walk: str = "4f2a") -> None:
        self.frames, self.folder, self.walk = frames, folder, walk
        self.clock_us = 0
        self.mpu = SimulatedMpu(self)
        power = Chip()
        power.registers[0x78:0x7E] = bytes([0xE0, 0x05, 0, 0, 0x05, 0x07])  # 3589 steps of 1.1 mV, -167 of 0.5 mA
        self.stick = SimulatedBus({0x34: power, 0x51: Chip(), 0x68: self.mpu})
        self.hat = SimulatedBus({0x10: SimulatedBmm(self), 0x70: SimulatedQmp(self)})
        self.hats = [self.hat]
        self.lines: list[str] = []
        self.free = 1 << 20
        self._buttons = list(buttons)

    def now_us(self) -> int:
        return self.clock_us

    def sleep_ms(self, wait_ms: int) -> None:
        self.clock_us += 1000 * wait_ms

    def button(self) -> str:
        if self._buttons and self.clock_us >= self._buttons[0][0] * 1e6:
            return self._buttons.pop(0)[1]
        return ""

    def show(self, lines: list[str]) -> None:
        self.lines = lines

    def free_bytes(self) -> int:
        return self.free

    def walk_name(self) -> str:
        return self.walk


class Pipe(Link):
    """Standard input and output."""

    def __init__(self) -> None:
        self._poll = select.poll()
        self._poll.register(sys.stdin, select.POLLIN)
        self.over = False

    def write(self, data: bytes) -> bool:
        sys.stdout.write(data.decode())
        return True

    def read(self) -> bytes:
        parts = []
        while self._poll.poll(0) and not self.over:
            part = sys.stdin.readline()
            self.over = not part
            parts.append(part.encode())
        return b"".join(parts)


def main(frames: str, folder: str, speed: float, buttons: str) -> None:
    """Record until all is stored by the host and it has said the last word; leave the screen in a file."""
    pressed = [(float(one.split(":")[0]), one.split(":")[1]) for one in buttons.split(",")]
    device = Device(Frames(open(frames, "rb")), folder, pressed)  # noqa: SIM115  until the end
    link = Pipe()
    recorder = Recorder(device, link)
    began, over_us = time.time(), 0
    while not link.over:
        recorder.turn()
        device.clock_us += TURN_US
        ahead_s = device.clock_us * 1e-6 / speed - (time.time() - began)
        if ahead_s > 0.002:
            time.sleep(ahead_s)
        stored = recorder.file is not None and recorder.file.acknowledged >= recorder.file.count
        over_us = over_us if recorder.state == "ended" and stored else device.clock_us
        if device.clock_us - over_us > 3_000_000 * speed:  # three seconds of the host's
            break
    with open(folder + "/screen.json", "w") as file:
        json.dump(
            {"lines": recorder.screen(device.clock_us), "lost": recorder._mpu.lost, "given": device.mpu.given}, file
        )


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4])
