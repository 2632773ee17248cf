"""The recorder's parts against register maps and data sheets; the same code runs under MicroPython."""

import io
import random
import struct
from pathlib import Path

import numpy as np
import pytest
from calibration import Rest, Sphere, store_offsets, stored_offsets
from recorder import HEADER, Recorder, wrapped
from sensors import Axp192, Bmm150, Bmp280, Mpu6886, Qmp6988, SensorError, find_field, find_pressure, signed
from support.recorder_device import RECORD, Chip, Device, Frames, SimulatedBus
from support.recorder_frames import BIAS_DPS, frames_of
from walk_file import SEGMENT, Link, Sender, WalkFile, opened, sealed

from fbgraph.readers import read_log
from fbgraph.readers.numbered_lines import NumberedLines
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate


def device(frames: bytes = bytes(RECORD), folder: str = "") -> Device:
    return Device(Frames(io.BytesIO(frames)), folder, [])


def of_int16(values: bytes, at: int) -> int:
    return int(struct.unpack_from(">h", values, at)[0])


def reference_pa(otp: bytes, p: int, t: int) -> float:
    """M5Stack's integer driver of the QMP6988."""
    b00 = signed(otp[0] << 12 | otp[1] << 4 | otp[24] >> 4, 20)
    a0 = signed(otp[18] << 12 | otp[19] << 4 | otp[24] & 15, 20)
    a1, a2 = 3608 * of_int16(otp, 20) - 1731677965, 16889 * of_int16(otp, 22) - 87619360
    bt1, bt2 = 2982 * of_int16(otp, 2) + 107370906, 329854 * of_int16(otp, 4) + 108083093
    bp1, b11 = 19923 * of_int16(otp, 6) + 1133836764, 2406 * of_int16(otp, 8) + 118215883
    bp2, b12 = 3079 * of_int16(otp, 10) - 181579595, 6846 * of_int16(otp, 12) + 85590281
    b21, bp3 = 13836 * of_int16(otp, 14) + 79333336, 2915 * of_int16(otp, 16) + 157155561
    tx = (a0 + ((a1 * t + (((a2 * t) >> 14) * t >> 10)) // 32767 >> 19)) >> 4
    wk1 = bt1 * tx + ((bp1 * p) >> 5)
    wk3 = (((bt2 * tx) >> 1) * tx >> 8) + (((b11 * tx) >> 4) * p >> 1) + (((bp2 * p) >> 13) * p >> 1)
    wk1 += wk3 >> 14
    wk3 = (
        (((b12 * tx) * tx >> 22) * p >> 1)
        + ((((b21 * tx) >> 6) * p >> 23) * p >> 1)
        + (((bp3 * p) >> 12) * p >> 23) * p
    )
    return float((((wk1 + (wk3 >> 15)) // 32767) >> 11) + b00) / 16.0


@pytest.mark.parametrize("seed", range(4))
def test_a_qmp6988_reads_as_the_makers_integer_driver(seed: int) -> None:
    chance = random.Random(seed)
    bus = device().hat
    otp = bytes([0x41, 0xE8]) + struct.pack(">8h", *(chance.randint(-9000, 9000) for _ in range(8)))
    otp += bytes([0x0F, 0xA0]) + struct.pack(">hh", chance.randint(-9000, 9000), chance.randint(-9000, 9000)) + b"\x53"
    bus.chips[0x70].registers[0xA0:0xB9] = otp
    chip = Qmp6988(bus, 0x70)
    for p in (-3_000_000, -500_000, 0, 2_000_000):
        for t in (700_000, -900_000):
            assert 100.0 * chip.compensated_hpa(p, t) == pytest.approx(reference_pa(otp, p, t), abs=2.0)


def test_a_bmp280_reads_as_its_data_sheet() -> None:
    """The example of its section 3.12."""
    chip = Chip()
    chip.registers[0xD0] = 0x58
    dig = struct.pack("<HhhHhhhhhhhh", 27504, 26435, -1000, 36477, -10685, 3024, 2855, 140, -7, 15500, -14600, 6000)
    chip.registers[0x88:0xA0] = dig
    bus = SimulatedBus({0x76: chip})
    found = find_pressure([bus])
    assert isinstance(found, Bmp280)
    assert found.compensated_hpa(415148, 519888) == pytest.approx(1006.5327, abs=2e-4)
    raw = (415148 << 4).to_bytes(3, "big") + (519888 << 4).to_bytes(3, "big")
    chip.registers[0xF7:0xFD] = raw
    assert found.pressure_hpa() == pytest.approx(1006.5327, abs=2e-4)
    chip.registers[0xF7:0xFA] = b"\x80\x00\x00"
    assert found.pressure_hpa() is None
    assert bytes(chip.registers[0xF4:0xF6]) == b"\x57\x08"


def test_a_bmm150_is_found_trimmed_and_told_when_it_has_nothing() -> None:
    raw = struct.pack("<hhhH", 55 << 3, -20 << 3, -110 << 1, 7053 << 2)
    stick = device(bytes(14) + raw + bytes(6))
    found = find_field([stick.stick, *stick.hats], stick.sleep_ms)
    assert found is not None
    assert found.field_ut() == pytest.approx((55 * 0.36328, -20 * 0.36328, -110 * 0.33629), abs=0.01)
    assert found.field_ut() is None  # not ready again
    chip = stick.hat.chips[0x10]
    assert (chip.registers[0x51], chip.registers[0x52], chip.registers[0x4C]) == (4, 14, 0x38)
    found._xyz1 = 7100  # temperature: the Hall value's ratio takes part
    assert found._level(55, 7053, 0, 26) == pytest.approx(19.9955, abs=1e-3)
    lost = struct.pack("<hhhH", -4096 << 3, 0, 0, 7053 << 2)
    beyond = device(bytes(14) + lost + bytes(6))
    assert Bmm150(beyond.hat, 0x10, beyond.sleep_ms).field_ut() is None


def test_the_battery_and_a_stick_that_is_none() -> None:
    assert Axp192(device().stick).battery() == pytest.approx((3.948, -83.5), abs=1e-3)
    other = device()
    other.stick.chips[0x68].registers[0x75] = 0x71
    with pytest.raises(SensorError, match="no MPU6886"):
        Mpu6886(other.stick, other.sleep_ms)


def test_samples_come_evenly_out_of_the_queue_and_a_queue_that_ran_over_is_counted() -> None:
    stick = device()
    mpu, chance, times = Mpu6886(stick.stick, stick.sleep_ms), random.Random(1), list[int]()
    while stick.clock_us < 20_000_000:
        stick.clock_us += chance.randint(2_000, 60_000)
        times += [t_us for t_us, _ in mpu.frames(stick.clock_us)]
    steps = np.diff(times)
    assert abs(steps - 10_000).max() <= 2_500
    assert steps.mean() == pytest.approx(10_000, abs=5)
    assert abs(times[-1] - stick.clock_us) < 20_000
    assert stick.mpu.given == len(times)
    stick.clock_us += 900_000
    assert mpu.frames(stick.clock_us) == []
    assert mpu.lost == 1
    stick.clock_us += 20_000
    assert len(mpu.frames(stick.clock_us)) == 2


def test_the_gyroscopes_zero_is_taken_at_rest_only() -> None:
    chance, rest = random.Random(2), Rest()
    for i in range(300):  # moved
        assert not rest.take((0.0, 0.0, 1.0 + 0.2 * (i % 7)), (chance.gauss(0, 20), 0.0, 0.0))
    taken = [rest.take((0.0, 0.0, 1.0), (chance.gauss(0.5, 0.1), -1.2, 3.0)) for _ in range(260)]
    assert taken.index(True) <= 220
    assert rest.bias_dps == pytest.approx((0.5, -1.2, 3.0), abs=0.03)
    fast = Rest()  # turned evenly, as on a turntable
    assert not any(fast.take((0.0, 0.0, 1.0), (0.0, 0.0, 33.0)) for _ in range(500))


def test_a_figure_of_eight_finds_the_offsets_and_half_of_one_does_not(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    turns = rng.standard_normal((300, 3))
    ball = 48.0 * turns / np.linalg.norm(turns, axis=1)[:, None] + rng.normal(0.0, 0.5, (300, 3)) + (31.0, -12.0, 7.5)
    sphere, flat, belt = Sphere(), Sphere(), Sphere()
    for x, y, z in ball.tolist():
        sphere.take((x, y, z))
        flat.take((x, y, 7.5))
        if abs(z - 7.5) < 10.0:
            for i in range(3):
                belt.take((x, y, z + 0.01 * i))
    fitted = sphere.fit()
    assert fitted is not None
    assert fitted[0] == pytest.approx((31.0, -12.0, 7.5), abs=0.3)
    assert fitted[1] == pytest.approx(48.0, abs=0.3)
    assert flat.fit() is None
    assert belt.count > 100
    assert belt.fit() is None
    assert stored_offsets(str(tmp_path / "none.json")) is None
    store_offsets(str(tmp_path / "c.json"), fitted[0])
    assert stored_offsets(str(tmp_path / "c.json")) == fitted[0]
    (tmp_path / "c.json").write_text('{"mag_ut": [1, 2]}')
    assert stored_offsets(str(tmp_path / "c.json")) is None


def test_lines_of_a_walk_are_found_again_until_their_flash_is_needed(tmp_path: Path) -> None:
    free = [1 << 20]
    file = WalkFile(str(tmp_path), "00ff", lambda: free[0])
    for i in range(3 * SEGMENT + 100):
        file.append(f"line {i}")
    for number in (0, 5, 6, 7, SEGMENT - 1, SEGMENT, 3 * SEGMENT + 99, 2 * SEGMENT + 3):
        assert file.line(number) == f"line {number}".encode()
    assert file.line(file.count) is None
    free[0] = 0
    file.acknowledged = SEGMENT + 10
    for i in range(3 * SEGMENT + 100, 5 * SEGMENT):
        file.append(f"line {i}")
    assert file.line(SEGMENT - 1) is None  # the host has it
    assert file.line(SEGMENT) == b"line %d" % SEGMENT
    assert file.full  # the next file's lines nobody has
    assert file.line(5 * SEGMENT - 1) == b"line %d" % (5 * SEGMENT - 1)  # in memory
    assert file.line(4 * SEGMENT + 10) is None
    assert sorted(path.name for path in (tmp_path / "00ff").iterdir()) == ["00001.csv", "00002.csv", "00003.csv"]


class Wire(Link):
    """What the device sends, and what it is to hear."""

    def __init__(self) -> None:
        self.sent, self.heard, self.up = b"", b"", True

    def write(self, data: bytes) -> bool:
        self.sent += data if self.up else b""
        return self.up

    def read(self) -> bytes:
        heard, self.heard = self.heard, b""
        return heard


def test_what_the_host_says_is_taken_if_it_is_whole(tmp_path: Path) -> None:
    wire = Wire()
    sender = Sender(wire)
    file = WalkFile(str(tmp_path), "00ff", lambda: 1 << 20)
    sender.begin(file)
    for i in range(50):
        file.append(f"line {i}")
    wire.heard = (
        b"noise\n" + sealed("!", "<,12,134,turn left 85 in 12 m") + sealed("+", "00ff:30") + sealed("+", "0001:49")
    )
    wire.heard += (
        sealed("?", "00ff:3-5;9-9;48-70;x") + sealed("?", "00ff:3-4") + sealed("!", "^,x,1,a") + b"!^,1,1,a*0000\n"
    )
    sender.turn(77)
    assert sender.guidance == ("<", 12, 134, "turn left 85 in 12 m")
    assert (file.acknowledged, sender.heard_us) == (30, 77)
    assert wire.sent == sealed("$", "00ff:3,line 3") + sealed("$", "00ff:4,line 4")
    assert opened(b"$x*12") is None
    assert wrapped("off route: the route is 5 m to your left") == ["off route: the route", "is 5 m to your left"]


def test_every_sample_of_a_walk_is_in_the_file_that_the_host_stores(tmp_path: Path) -> None:
    """A tenth of the lines lost both ways, the link down for three seconds; read back, it is the walk."""
    log = simulate(load_route("square"), seed=7).log.between(0.0, 20.0)
    frames = frames_of(log)
    stick = Device(
        Frames(io.BytesIO(frames)),
        str(tmp_path),
        [(3.0, "click"), (3.8, "click"), (9.0, "mark"), (10.0, "click"), (22.0, "hold")],
    )
    wire, chance, lines, stored = Wire(), random.Random(5), NumberedLines(), b""
    recorder = Recorder(stick, wire)
    while not lines.ended and stick.clock_us < 60_000_000:
        recorder.turn()
        stick.clock_us += 20_000
        wire.up = not 12.0 < stick.clock_us * 1e-6 < 15.0
        kept = b"".join(line + b"\n" for line in wire.sent.splitlines() if chance.random() > 0.1)
        stored += lines.push(kept, stick.clock_us * 1e-6)
        wire.sent = b""
        said = b"".join(lines.requests(stick.clock_us * 1e-6))
        wire.heard += said if wire.up and chance.random() > 0.1 else b""
    assert lines.ended
    files = sorted((tmp_path / "walks" / "4f2a").iterdir())
    assert stored == b"".join(path.read_bytes() for path in files)
    rows = [line.split(",") for line in stored.decode().splitlines() if line[0].isdigit()]
    assert stored.decode().splitlines()[5] == HEADER
    assert_samples(rows, frames)
    assert [row[-1] for row in rows if row[-1]] == ["mark", "button"]
    (tmp_path / "raw.csv").write_bytes(stored)
    read = read_log(tmp_path / "raw.csv").log
    assert len(read.acc) == len(rows)
    inside = read.mag.t_s > 2.0
    level = np.interp(read.pressure.t_s[-1] - 0.2, log.pressure.t_s, log.pressure.values[:, 0])
    assert read.pressure.values[-1, 0] == pytest.approx(level, abs=0.2)
    assert np.linalg.norm(read.mag.values[inside], axis=1).mean() == pytest.approx(
        np.linalg.norm(log.mag.values, axis=1).mean(), abs=1.0
    )


def assert_samples(rows: list[list[str]], frames: bytes) -> None:
    """Rows are successive frames, none lost and none twice, less the gyroscope's zero."""
    acc = np.array([struct.unpack_from(">hhh", frames, at) for at in range(0, len(frames), RECORD)]) * 8.0 / 32768.0
    gyro = (
        np.array([struct.unpack_from(">hhh", frames, at + 8) for at in range(0, len(frames), RECORD)])
        * 2000.0
        / 32768.0
    )
    told = np.array([[float(value) for value in row[1:7]] for row in rows])
    start = next(k for k in range(len(acc)) if np.allclose(acc[k : k + 600][:300], told[200:500, :3], atol=1e-5)) - 200
    there = min(len(told), len(acc) - start)
    assert there > len(told) - 200
    assert np.allclose(told[:there, :3], acc[start : start + there], atol=1e-5)
    assert np.allclose(told[:there, 3:] + BIAS_DPS, gyro[start : start + there], atol=0.05)
