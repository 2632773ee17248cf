"""The chips of an M5StickC Plus and its ENV hats, after their register maps. Runs on MicroPython and CPython.

MPU6886 (accelerometer and gyroscope) and AXP192 (power) are on the stick's own bus, BMM150 (magnetometer) and BMP280 or
QMP6988 (pressure) on the hat's. Each driver takes a bus with ``readfrom_mem``, ``writeto_mem`` and ``scan``, as
``machine.I2C`` has them.
"""

import struct

try:
    from typing import Callable
except ImportError:  # MicroPython has no such module, and does not look at annotations
    pass

MPU6886 = 0x68
BMM150 = (0x10, 0x11, 0x12, 0x13)
BMP280 = (0x76, 0x77)
QMP6988 = (0x70, 0x56)
AXP192 = 0x34

PERIOD_US = 10_000
FRAME = 14
FIFO_BYTES = 1024
ACC_G = 8.0 / 32768.0
GYRO_DPS = 2000.0 / 32768.0


class SensorError(Exception):
    """A chip that does not answer as its register map says."""


class Bus:
    """What the drivers need of ``machine.I2C``."""

    def readfrom_mem(self, address: int, register: int, count: int) -> bytes:
        """Read registers."""
        raise NotImplementedError

    def writeto_mem(self, address: int, register: int, data: bytes) -> None:
        """Write registers."""
        raise NotImplementedError

    def scan(self) -> list[int]:
        """Addresses of the chips that answer."""
        raise NotImplementedError


def signed(value: int, bits: int) -> int:
    """Two's complement of so many bits."""
    return value - (1 << bits) if value & (1 << (bits - 1)) else value


class Mpu6886:
    """±8 g and ±2000 °/s at 100 Hz, out of the chip's own queue: nothing is lost while the flash is written.

    Attributes:
        lost: how often the queue ran over.
    """

    def __init__(self, bus: Bus, sleep_ms: Callable[[int], None]) -> None:
        """Reset the chip and start its queue.

        Args:
            bus: its bus.
            sleep_ms: waits; takes milliseconds.
        """
        self._bus = bus
        self.lost = 0
        if bus.readfrom_mem(MPU6886, 0x75, 1)[0] != 0x19:
            raise SensorError("no MPU6886")
        for register, value, wait_ms in (
            (0x6B, 0x80, 10),  # PWR_MGMT_1: reset
            (0x6B, 0x01, 10),  # its best clock
            (0x1C, 0x10, 1),  # ACCEL_CONFIG: ±8 g
            (0x1B, 0x18, 1),  # GYRO_CONFIG: ±2000 °/s
            (0x1A, 0x03, 1),  # CONFIG: 41 Hz low pass; the queue drops its oldest
            (0x1D, 0x03, 1),  # ACCEL_CONFIG2: 45 Hz low pass
            (0x19, 0x09, 1),  # SMPLRT_DIV: 1 kHz / 10
            (0x23, 0x18, 1),  # FIFO_EN: gyroscope and accelerometer
            (0x6A, 0x44, 10),  # USER_CTRL: empty the queue and start it
        ):
            bus.writeto_mem(MPU6886, register, bytes([value]))
            sleep_ms(wait_ms)
        self._last_us = -1

    def frames(self, now_us: int) -> list[tuple[int, tuple[int, ...]]]:
        """What was measured since last time: (time in µs, raw acc x y z, temperature, gyro x y z), the oldest first.

        The chip counts evenly but has no clock; times are evenly spaced too, drawn slowly towards when they are read.
        """
        high, low = self._bus.readfrom_mem(MPU6886, 0x72, 2)
        waiting = high << 8 | low
        if waiting >= FIFO_BYTES - FRAME:
            self._bus.writeto_mem(MPU6886, 0x6A, bytes([0x44]))
            self.lost += 1
            self._last_us = -1
            return []
        count = waiting // FRAME
        if not count:
            return []
        data = self._bus.readfrom_mem(MPU6886, 0x74, count * FRAME)
        newest_us = now_us - PERIOD_US // 2
        if self._last_us < 0:
            self._last_us = newest_us - count * PERIOD_US
        off_us = newest_us - (self._last_us + count * PERIOD_US)
        if abs(off_us) > 20 * PERIOD_US:  # the program stood still
            self._last_us = max(self._last_us, newest_us - count * PERIOD_US)
            off_us = 0
        self._last_us += min(max(off_us // 16, -2000), 2000)
        found = []
        for i in range(count):
            self._last_us += PERIOD_US
            found.append((self._last_us, struct.unpack_from(">hhhhhhh", data, i * FRAME)))
        return found


def mpu_temperature_c(raw: int) -> float:
    """Temperature of the MPU6886."""
    return raw / 326.8 + 25.0


class Bmm150:
    """Field in µT at 30 Hz, compensated as Bosch's driver does."""

    def __init__(self, bus: Bus, address: int, sleep_ms: Callable[[int], None]) -> None:
        """Wake the chip up and read its trimming."""
        self._bus, self._address = bus, address
        bus.writeto_mem(address, 0x4B, b"\x01")
        sleep_ms(5)
        if bus.readfrom_mem(address, 0x40, 1)[0] != 0x32:
            raise SensorError("no BMM150")
        self._x1, self._y1 = struct.unpack("<bb", bus.readfrom_mem(address, 0x5D, 2))
        self._z4, self._x2, self._y2 = struct.unpack("<hbb", bus.readfrom_mem(address, 0x62, 4))
        trim = struct.unpack("<hHHhbB", bus.readfrom_mem(address, 0x68, 10))
        self._z2, self._z1, self._xyz1, self._z3, self._xy2, self._xy1 = trim
        self._xyz1 &= 0x7FFF
        bus.writeto_mem(address, 0x51, b"\x04")  # 9 repetitions for x and y
        bus.writeto_mem(address, 0x52, b"\x0e")  # 15 for z
        bus.writeto_mem(address, 0x4C, b"\x38")  # normal mode, 30 Hz

    def field_ut(self) -> tuple[float, float, float] | None:
        """The field since last time; None if there is none, or it is beyond what the chip can measure."""
        x, y, z, hall = struct.unpack("<hhhH", self._bus.readfrom_mem(self._address, 0x42, 8))
        if not hall & 1:
            return None
        x, y, z, hall = x >> 3, y >> 3, z >> 1, hall >> 2
        if x == -4096 or y == -4096 or z == -16384 or hall == 0:
            return None
        return self._level(x, hall, self._x1, self._x2), self._level(y, hall, self._y1, self._y2), self._up(z, hall)

    def _level(self, raw: int, hall: int, one: int, two: int) -> float:
        ratio = self._xyz1 * 16384.0 / hall - 16384.0
        part = self._xy2 * (ratio * ratio / 268435456.0) + ratio * self._xy1 / 16384.0
        return float(raw * ((part + 256.0) * (two + 160.0)) / 8192.0 + one * 8.0) / 16.0

    def _up(self, raw: int, hall: int) -> float:
        part = (raw - self._z4) * 131072.0 - self._z3 * float(hall - self._xyz1)
        return float(part / ((self._z2 + self._z1 * float(hall) / 32768.0) * 4.0)) / 16.0


class Bmp280:
    """Pressure by a BMP280."""

    name = "BMP280"

    def __init__(self, bus: Bus, address: int) -> None:
        """Read the calibration and start measuring."""
        self._bus, self._address = bus, address
        if bus.readfrom_mem(address, 0xD0, 1)[0] != 0x58:
            raise SensorError("no BMP280")
        self._dig = struct.unpack("<HhhHhhhhhhhh", bus.readfrom_mem(address, 0x88, 24))
        bus.writeto_mem(address, 0xF5, b"\x08")  # filter 4, no pause
        bus.writeto_mem(address, 0xF4, b"\x57")  # temperature x2, pressure x16, always

    def pressure_hpa(self) -> float | None:
        """Pressure now; None before the first measurement."""
        data = self._bus.readfrom_mem(self._address, 0xF7, 6)
        raw_p = data[0] << 12 | data[1] << 4 | data[2] >> 4
        raw_t = data[3] << 12 | data[4] << 4 | data[5] >> 4
        return None if raw_p == 0x80000 else self.compensated_hpa(raw_p, raw_t)

    def compensated_hpa(self, raw_p: int, raw_t: int) -> float:
        """The data sheet's 64-bit formula."""
        t1, t2, t3, p1, p2, p3, p4, p5, p6, p7, p8, p9 = self._dig
        fine = ((((raw_t >> 3) - (t1 << 1)) * t2) >> 11) + (((((raw_t >> 4) - t1) ** 2) >> 12) * t3 >> 14)
        a = fine - 128000
        b = a * a * p6 + ((a * p5) << 17) + (p4 << 35)
        a = ((a * a * p3) >> 8) + ((a * p2) << 12)
        a = (((1 << 47) + a) * p1) >> 33
        if a == 0:
            return 0.0
        p = (((1048576 - raw_p) << 31) - b) * 3125 // a
        a = (p9 * (p >> 13) * (p >> 13)) >> 25
        b = (p8 * p) >> 19
        return float(((p + a + b) >> 8) + (p7 << 4)) / 25600.0


class Qmp6988:
    """Pressure by a QMP6988."""

    name = "QMP6988"

    def __init__(self, bus: Bus, address: int) -> None:
        """Read the calibration and start measuring."""
        self._bus, self._address = bus, address
        if bus.readfrom_mem(address, 0xD1, 1)[0] != 0x5C:
            raise SensorError("no QMP6988")
        otp = bus.readfrom_mem(address, 0xA0, 25)
        b00 = signed(otp[0] << 12 | otp[1] << 4 | otp[24] >> 4, 20)
        a0 = signed(otp[18] << 12 | otp[19] << 4 | otp[24] & 0x0F, 20)
        bt1, bt2, bp1, b11, bp2, b12, b21, bp3 = struct.unpack_from(">hhhhhhhh", otp, 2)
        a1, a2 = struct.unpack_from(">hh", otp, 20)
        self._b00, self._a0 = b00 / 16.0, a0 / 16.0
        self._a1 = -6.3e-3 + 4.3e-4 * a1 / 32767.0
        self._a2 = -1.9e-11 + 1.2e-10 * a2 / 32767.0
        self._bt1 = 1.0e-1 + 9.1e-2 * bt1 / 32767.0
        self._bt2 = 1.2e-8 + 1.2e-6 * bt2 / 32767.0
        self._bp1 = 3.3e-2 + 1.9e-2 * bp1 / 32767.0
        self._b11 = 2.1e-7 + 1.4e-7 * b11 / 32767.0
        self._bp2 = -6.3e-10 + 3.5e-10 * bp2 / 32767.0
        self._b12 = 2.9e-13 + 7.6e-13 * b12 / 32767.0
        self._b21 = 2.1e-15 + 1.2e-14 * b21 / 32767.0
        self._bp3 = 1.3e-16 + 7.9e-17 * bp3 / 32767.0
        bus.writeto_mem(address, 0xF1, b"\x02")  # filter 4
        bus.writeto_mem(address, 0xF4, b"\x33")  # temperature x1, pressure x8, always

    def pressure_hpa(self) -> float | None:
        """Pressure now; None before the first measurement."""
        data = self._bus.readfrom_mem(self._address, 0xF7, 6)
        raw_p = (data[0] << 16 | data[1] << 8 | data[2]) - 8388608
        raw_t = (data[3] << 16 | data[4] << 8 | data[5]) - 8388608
        return None if raw_p == -8388608 else self.compensated_hpa(raw_p, raw_t)

    def compensated_hpa(self, p: int, t: int) -> float:
        """The data sheet's polynomial; fits single precision to a pascal's tenth."""
        tr = self._a0 + (self._a1 + self._a2 * t) * t
        level = self._bp1 + self._b11 * tr + self._b12 * tr * tr + (self._bp2 + self._b21 * tr + self._bp3 * p) * p
        return float(self._b00 + (self._bt1 + self._bt2 * tr) * tr + level * p) / 100.0


class Axp192:
    """Battery of the stick."""

    def __init__(self, bus: Bus) -> None:
        """Let it measure everything."""
        self._bus = bus
        bus.writeto_mem(AXP192, 0x82, b"\xff")

    def battery(self) -> tuple[float, float]:
        """Voltage in V and current in mA, positive while charging."""
        data = self._bus.readfrom_mem(AXP192, 0x78, 6)
        charging, discharging = data[2] << 5 | data[3], data[4] << 5 | data[5]
        return (data[0] << 4 | data[1]) * 1.1e-3, 0.5 * (charging - discharging)


def find_field(buses: list[Bus], sleep_ms: Callable[[int], None]) -> Bmm150 | None:
    """The magnetometer of a hat, if there is one."""
    for bus in buses:
        for address in bus.scan():
            if address in BMM150:
                try:
                    return Bmm150(bus, address, sleep_ms)
                except (SensorError, OSError):
                    pass
    return None


def find_pressure(buses: list[Bus]) -> Bmp280 | Qmp6988 | None:
    """The barometer of a hat, if there is one."""
    for bus in buses:
        for address in bus.scan():
            try:
                if address in BMP280:
                    return Bmp280(bus, address)
                if address in QMP6988:
                    return Qmp6988(bus, address)
            except (SensorError, OSError):
                pass
    return None
