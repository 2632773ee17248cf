"""The recorder: calibrates, records at 100 Hz, sends, shows the way back. Runs on MicroPython and CPython.

What it needs of a device is in ``Hardware``; ``main.py`` has an M5StickC Plus, the tests a simulated one.
"""

from calibration import Rest, Sphere, store_offsets, stored_offsets
from sensors import (
    ACC_G,
    AXP192,
    GYRO_DPS,
    Axp192,
    Bus,
    Mpu6886,
    find_field,
    find_pressure,
    mpu_temperature_c,
)
from walk_file import Link, Sender, WalkFile

try:
    from typing import Callable
except ImportError:  # MicroPython has no such module, and does not look at annotations
    pass

HEADER = "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa,temp_c,bat_v,bat_ma,event"
CLICK, HOLD, MARK = "click", "hold", "mark"
_FIELD_US, _PRESSURE_US, _BATTERY_US, _BEACON_US, _SCREEN_US = 33_000, 100_000, 1_000_000, 1_000_000, 500_000
_OLD_US = 10_000_000
_STRIKE_G, _STEP_US, _CADENCE_US = 1.15, 250_000, 4_000_000
_TEXT = 20  # characters of a line of the screen
_ARROWS = {"^": "AHEAD", "<": "LEFT", ">": "RIGHT", "v": "TURN ROUND", "o": "ARRIVED", "?": "OFF ROUTE"}
REST, EIGHT, READY, WALKING, ENDED = "hold still", "figure of 8", "ready", "walking", "ended"


class Hardware:
    """What a recorder runs on.

    Attributes:
        device: its name, for the header.
        stick: the bus of the accelerometer.
        hats: buses where a magnetometer and a barometer may be.
        folder: for walks and calibration.
    """

    device = ""
    folder = ""
    stick: Bus
    hats: list[Bus]

    def now_us(self) -> int:
        """A clock that never wraps."""
        raise NotImplementedError

    def sleep_ms(self, wait_ms: int) -> None:
        """Wait."""
        raise NotImplementedError

    def button(self) -> str:
        """What a button did since last time: ``click`` or ``hold`` of the one in front, ``mark``; or nothing."""
        raise NotImplementedError

    def show(self, lines: list[str]) -> None:
        """Show lines of text."""
        raise NotImplementedError

    def free_bytes(self) -> int:
        """Of flash."""
        raise NotImplementedError

    def walk_name(self) -> str:
        """Four hexadecimal digits, by chance."""
        raise NotImplementedError


class Recorder:
    """Everything between the buttons and the host.

    Attributes:
        state: ``REST``, ``EIGHT``, ``READY``, ``WALKING`` or ``ENDED``.
        file: of the walk; None before the first.
        sender: to the host.
    """

    def __init__(self, hardware: Hardware, link: Link) -> None:
        """Find the sensors.

        Raises:
            SensorError: no accelerometer.
        """
        self._hardware = hardware
        self._mpu = Mpu6886(hardware.stick, hardware.sleep_ms)
        buses = hardware.hats + [hardware.stick]
        self._field = find_field(buses, hardware.sleep_ms)
        self._pressure = find_pressure(buses)
        self._power = Axp192(hardware.stick) if AXP192 in hardware.stick.scan() else None
        self._offsets_at = "%s/calibration.json" % hardware.folder
        self._offsets = stored_offsets(self._offsets_at)
        self._stored = self._offsets is not None
        self._rest, self._sphere = Rest(), Sphere()
        self._bias = (0.0, 0.0, 0.0)
        self._began_us = hardware.now_us()
        self._due = {"field": 0, "pressure": 0, "battery": 0, "beacon": 0, "screen": 0}
        self._slow = [""] * 4  # field, pressure, battery, event: of the next row
        self._battery = (0.0, 0.0)
        self._events: list[str] = []
        self._strikes: list[int] = []
        self._above = False
        self.sender = Sender(link)
        self.file: WalkFile | None = None
        self.state = REST

    def turn(self) -> None:
        """Do what is to be done now; to be called every few milliseconds."""
        now_us = self._hardware.now_us()
        self._press(self._hardware.button())
        self._read_slow(now_us)
        for t_us, raw in self._mpu.frames(now_us):
            self._take(t_us, raw)
        self.sender.turn(now_us)
        if self._is_due("beacon", now_us, _BEACON_US):
            self.sender.beacon()
        if self._is_due("screen", now_us, _SCREEN_US):
            self._hardware.show(self.screen(now_us))

    def _is_due(self, what: str, now_us: int, period_us: int) -> bool:
        if now_us < self._due[what]:
            return False
        self._due[what] = now_us + period_us
        return True

    def _press(self, button: str) -> None:
        if self.state == EIGHT and button == CLICK:
            self.state = READY
        elif self.state in (READY, ENDED) and button == CLICK:
            self._begin()
        elif self.state == WALKING and button == CLICK:
            self._events.append("button")
        elif self.state == WALKING and button == MARK:
            self._events.append("mark")
        elif self.state == WALKING and button == HOLD:
            self._write("# end of the walk, %d lines before" % self._count())
            self.state = ENDED
            if self.file is not None:
                self.file.close()

    def _count(self) -> int:
        return 0 if self.file is None else self.file.count

    def _begin(self) -> None:
        """A new file, with its header."""
        hardware = self._hardware
        walk = hardware.walk_name()
        self.file = WalkFile(hardware.folder + "/walks", walk, hardware.free_bytes)
        self.sender.begin(self.file)
        self.state, self._events = WALKING, []
        chips = ["MPU6886 8 g 2000 dps"]
        chips += [] if self._field is None else ["BMM150"]
        chips += [] if self._pressure is None else [self._pressure.name]
        self._write("# fbgraph recorder 1 walk %s" % walk)
        self._write("# device %s; %s; 100 Hz" % (hardware.device, ", ".join(chips)))
        self._write("# axes of the MPU6886, see README.md; the magnetometer's as its chip has them")
        self._write("# gyroscope %.3f %.3f %.3f dps at rest, taken off" % self._bias)
        if self._offsets is None:
            self._write("# magnetometer not calibrated")
        else:
            how = "stored" if self._stored else "found before this walk"
            self._write("# magnetometer %.2f %.2f %.2f ut taken off, %s" % (self._offsets + (how,)))
        self._write(HEADER)

    def _write(self, line: str) -> None:
        if self.file is not None:
            self.file.append(line)
            self.sender.send_last()

    def _read_slow(self, now_us: int) -> None:
        """The sensors that are slower than the accelerometer; each fills its columns of the next row."""
        try:
            if self._field is not None and self._is_due("field", now_us, _FIELD_US):
                field = self._field.field_ut()
                if field is not None:
                    self._take_field(field)
            if self._pressure is not None and self._is_due("pressure", now_us, _PRESSURE_US):
                pressure = self._pressure.pressure_hpa()
                self._slow[1] = "" if pressure is None else "%.3f" % pressure
            if self._power is not None and self._is_due("battery", now_us, _BATTERY_US):
                self._battery = self._power.battery()
                self._slow[2] = "%.3f,%.1f" % self._battery
        except OSError:  # a hat that was pulled off
            pass

    def _take_field(self, field: tuple[float, float, float]) -> None:
        if self.state == EIGHT:
            self._sphere.take(field)
            fitted = self._sphere.fit() if self._sphere.count % 30 == 0 else None
            if fitted is not None:
                self._offsets, self._stored = fitted[0], False
                store_offsets(self._offsets_at, fitted[0])
                self.state = READY
        x, y, z = self._offsets or (0.0, 0.0, 0.0)
        self._slow[0] = "%.2f,%.2f,%.2f" % (field[0] - x, field[1] - y, field[2] - z)

    def _take(self, t_us: int, raw: tuple[int, ...]) -> None:
        """A sample of accelerometer and gyroscope: calibration before the walk, a row of it on it."""
        acc = raw[0] * ACC_G, raw[1] * ACC_G, raw[2] * ACC_G
        gyro = raw[4] * GYRO_DPS, raw[5] * GYRO_DPS, raw[6] * GYRO_DPS
        if self.state == REST and self._rest.take(acc, gyro) and self._rest.bias_dps is not None:
            self._bias = self._rest.bias_dps
            self.state = READY if self._field is None or self._offsets is not None else EIGHT
        if self.state != WALKING:
            return
        self._count_step(t_us, acc)
        bias = self._bias
        slow = self._slow
        self._write(
            "%d,%.5f,%.5f,%.5f,%.3f,%.3f,%.3f,%s,%s,%s,%s,%s"
            % (
                (t_us - self._began_us) // 1000,
                acc[0],
                acc[1],
                acc[2],
                gyro[0] - bias[0],
                gyro[1] - bias[1],
                gyro[2] - bias[2],
                slow[0] or ",,",
                slow[1],
                "%.1f" % mpu_temperature_c(raw[3]) if slow[2] else "",
                slow[2] or ",",
                self._events.pop(0) if self._events else "",
            )
        )
        self._slow = [""] * 4

    def _count_step(self, t_us: int, acc: tuple[float, float, float]) -> None:
        """Strikes of the foot, roughly, for the screen."""
        above = acc[0] ** 2 + acc[1] ** 2 + acc[2] ** 2 > _STRIKE_G**2
        if above and not self._above and (not self._strikes or t_us - self._strikes[-1] > _STEP_US):
            self._strikes.append(t_us)
        self._above = above
        while self._strikes and t_us - self._strikes[0] > _CADENCE_US:
            self._strikes.pop(0)

    def screen(self, now_us: int) -> list[str]:
        """What the screen shows: state and time, steps a second, link, battery; on the way back what to do."""
        file, sender = self.file, self.sender
        seconds = (now_us - self._began_us) // 1_000_000
        lines = ["%s %d:%02d" % (self.state, seconds // 60, seconds % 60)]
        if self.state == REST:
            lines.append("lay it down")
        elif self.state == EIGHT:
            lines += ["turn it all ways", "click: without"]
        elif self.state == READY:
            lines.append("click: start")
        heard = sender.heard_us >= 0 and now_us - sender.heard_us < _OLD_US
        link = "host ok" if heard else "sending" if sender.up else "no link"
        if file is not None:
            waiting = file.count - file.acknowledged
            lines.append("%.1f steps/s %s" % (len(self._strikes) / (_CADENCE_US * 1e-6), link))
            lines.append("%d lines, %d here" % (file.count, waiting) if waiting > 300 else "%d lines" % file.count)
        else:
            lines.append(link)
        if self._power is not None:
            lines.append("%.2f V %.0f mA" % self._battery)
        if file is not None and file.full:
            lines.append("FLASH FULL")
        if self._mpu.lost:
            lines.append("%d gaps" % self._mpu.lost)
        if sender.guidance is not None:
            arrow, next_m, left_m, text = sender.guidance
            old = "" if heard else " (old)"
            lines += ["%s %d m%s" % (_ARROWS.get(arrow, arrow), next_m, old), "%d m left" % left_m]
            lines += wrapped(text)
        return lines


def wrapped(text: str) -> list[str]:
    """A sentence in lines that fit the screen."""
    lines = [""]
    for word in text.split():
        if lines[-1] and len(lines[-1]) + 1 + len(word) > _TEXT:
            lines.append("")
        lines[-1] = (lines[-1] + " " + word).strip()
    return lines


def run(recorder: Recorder, hardware: Hardware, stop: Callable[[], bool]) -> None:
    """Record until ``stop()``."""
    while not stop():
        recorder.turn()
        hardware.sleep_ms(5)
