"""The M5StickC CSV reader: names, units, clocks, slow sensors, junk."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from fbgraph.core.errors import DataError
from fbgraph.core.log import SensorLog
from fbgraph.readers import detect, read_log
from fbgraph.readers.columns import CANONICAL, Columns
from fbgraph.readers.m5stickc import EXAMPLE

G = 9.80665
DEG = np.pi / 180.0
N = 300
I = np.arange(N)  # noqa: E741
T_S = 5.0 + 0.02 * I
# A walk as a wearable sees it, in SI, distinct on every axis.
ACC = np.column_stack((0.5 * np.sin(I / 5), 0.8 * np.cos(I / 7), 9.8 + 2.5 * np.sin(I / 4)))
GYRO = np.column_stack((0.9 * np.sin(I / 6), 1.1 * np.cos(I / 9), 1.3 * np.sin(I / 11)))
MAG = np.column_stack((20 + np.sin(I / 30), -5 + np.cos(I / 30), -38 + np.sin(I / 20)))
PRESSURE = 1013.0 + 0.1 * np.sin(I / 50)

Log = Callable[..., SensorLog]


@pytest.fixture
def log(tmp_path: Path) -> Log:
    """Write rows of columns under a header and read them back."""

    def write(header: str, *columns: np.ndarray, name: str = "walk.csv") -> SensorLog:
        path = tmp_path / name
        table = np.column_stack(columns)
        path.write_text("\n".join([header, *(",".join(f"{v:.10g}" for v in row) for row in table)]) + "\n")
        assert detect(path) == "m5stickc"
        return read_log(path).log

    return write


def lines_of_a_walk(n: int = N) -> list[str]:
    """Canonical lines, header first, with an event every hundred rows."""
    rows = [CANONICAL]
    for i in range(n):
        numbers = [*ACC[i % N] / G, *GYRO[i % N] / DEG, *MAG[i % N], PRESSURE[i % N], 31.5]
        text = ",".join(f"{value:.4f}" for value in numbers)
        rows.append(f"{5000 + 20 * i},{text},{'button' if i % 100 == 50 else ''}")
    return rows


def read_lines(tmp_path: Path, lines: list[str], name: str = "walk.csv") -> SensorLog:
    path = tmp_path / name
    path.write_bytes(("\n".join(lines) + "\n").encode("latin-1", "replace"))
    return read_log(path, "m5stickc").log


def check_sound(log: SensorLog) -> None:
    for stream in (log.acc, log.gyro, log.mag, log.pressure):
        assert np.isfinite(stream.t_s).all()
        assert np.isfinite(stream.values).all()
        assert (np.diff(stream.t_s) > 0).all()


VARIANTS = {
    "canonical": (CANONICAL.removesuffix(",temp_c,event"), (T_S * 1e3, ACC / G, GYRO / DEG, MAG, PRESSURE), 0),
    "capitals, any order": ("GX,GY,GZ,AX,AY,AZ,timestamp", (GYRO / DEG, ACC / G, T_S), 3),
    "n and t_sec": ("n,t_sec,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", (I, T_S, ACC / G, GYRO / DEG), 0),
    "segment": (
        "segment,timestamp_ms,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z",
        (I * 0, T_S * 1e3, ACC / G, GYRO / DEG),
        2,
    ),
    "iterator": ("iterator,seconds,accX,accY,accZ,gyroX,gyroY,gyroZ", (I, T_S, ACC, GYRO), 2),
    "microseconds, pascal, rad/s": (
        "t_us,ax_ms2,ay_ms2,az_ms2,gx_rads,gy_rads,gz_rads,mag_x,mag_y,mag_z,p_pa",
        (T_S * 1e6, ACC, GYRO, MAG, PRESSURE * 100),
        1,
    ),
    "units in brackets": (
        '"Time (ms)","Acc X (m/s²)","Acc Y (m/s²)","Acc Z (m/s²)","Gyro X (°/s)","Gyro Y (°/s)","Gyro Z (°/s)",p',
        (T_S * 1e3, ACC, GYRO / DEG, PRESSURE * 100),
        1,
    ),
    "phone-like names": (
        "time,gyro_x,gyro_y,gyro_z,acce_x,acce_y,acce_z,magnet_x,magnet_y,magnet_z",
        (T_S * 1e9, GYRO, ACC, MAG),
        4,
    ),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_header_variants_give_si(variant: str, log: Log) -> None:
    header, columns, assumptions = VARIANTS[variant]
    read = log(header, *columns)
    np.testing.assert_allclose(read.acc.values, ACC, atol=1e-6)
    np.testing.assert_allclose(read.gyro.values, GYRO, atol=1e-6)
    np.testing.assert_allclose(read.acc.t_s + read.t0_s, T_S, atol=1e-9)
    if len(read.mag):
        np.testing.assert_allclose(read.mag.values, MAG, atol=1e-6)
    if len(read.pressure):
        np.testing.assert_allclose(read.pressure.values[:, 0], PRESSURE, atol=1e-4)
    assert sum("has no unit in its name" in notice for notice in read.notices) == assumptions, read.notices


@pytest.mark.parametrize("header", ["aX,aY,aZ,gX,gY,gZ", "SampleID,AccX_ms2,AccY_ms2,AccZ_ms2,GyroX,GyroY,GyroZ"])
def test_without_a_time_column_50_hz_are_assumed_and_said(header: str, log: Log) -> None:
    counted = header.startswith("Sample")
    index = np.delete(I, [100, 101, 102])  # lost samples show in the counter only
    columns = (index, ACC[index], GYRO[index] / DEG) if counted else (ACC / G, GYRO / DEG)
    read = log(header, *columns)
    assert read.acc.rate_hz == pytest.approx(50.0)
    assert read.acc.t_s[-1] == pytest.approx((N - 1) / 50)
    assert any("50 Hz assumed" in notice for notice in read.notices)


def test_raw_magnetometer_counts_are_scaled_and_said(log: Log) -> None:
    header = "SampleID,AccX_ms2,AccY_ms2,AccZ_ms2,GyroX_dps,GyroY_dps,GyroZ_dps,MagX,MagY,MagZ"
    read = log(header, I, ACC, GYRO / DEG, np.round(MAG / 0.15 * 5))
    assert np.median(np.linalg.norm(read.mag.values, axis=1)) == pytest.approx(50.0, rel=0.01)
    np.testing.assert_allclose(
        read.mag.values[0] / np.linalg.norm(read.mag.values[0]), MAG[0] / np.linalg.norm(MAG[0]), atol=1e-2
    )
    assert any("MagX" in notice and "raw counts" in notice for notice in read.notices)


def test_gyro_unit_of_a_device_at_rest_is_degrees(log: Log) -> None:
    still = np.tile([0.0, 0.0, 1.0], (N, 1)) + 1e-3 * np.sin(np.outer(I, [1, 2, 3]))
    read = log("t_ms,ax,ay,az,gx,gy,gz", T_S * 1e3, still, np.tile([2.0, 0.0, 0.0], (N, 1)) + still / 10)
    assert np.median(read.gyro.values[:, 0]) == pytest.approx(2.0 * DEG, rel=0.01)


def test_unusable_units_are_refused_in_one_line(log: Log) -> None:
    with pytest.raises(
        DataError, match=r"walk.csv: ax has no unit .* 4\d{3}, neither g nor m/s²; put the unit"
    ) as error:
        log("t_ms,ax,ay,az,gx,gy,gz", T_S * 1e3, ACC / G * 4096, GYRO / DEG)
    assert "\n" not in str(error.value)
    with pytest.raises(DataError, match="gravity removed"):
        log("t_ms,ax_ms2,ay_ms2,az_ms2,gx,gy,gz", T_S * 1e3, ACC - [0, 0, 9.8], GYRO / DEG)


@pytest.mark.parametrize(
    ("unit", "first", "step"),
    [("ns", 1764585663780992301, 20_000_001), ("us", 1764585663780992, 20_003), ("ms", 1764585663780, 20)],
)
@pytest.mark.parametrize("bad_time", ["", "17645x", "nan", "9" * 19, "9" * 30])
def test_epoch_times_lose_nothing(unit: str, first: int, step: int, bad_time: str) -> None:
    columns = Columns.from_header(f"t_{unit},ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps")
    assert columns is not None
    lines = [f"{first + step * i},0,0,1,0,0,0" for i in range(500)]
    lines[7] = "17645,0,x,1,0,0,0"
    lines[9] = bad_time + ",0,1,1,0,0,0"
    tick = {"ns": 1, "us": 1000, "ms": 1_000_000}[unit]
    rows = columns.convert(columns.parse(lines))
    assert rows.t.tolist() == [(first + step * i) * tick for i in range(500) if i not in (7, 9)]


def test_epoch_seconds_keep_their_microseconds() -> None:
    columns = Columns.from_header("GX,GY,GZ,AX_g,AY,AZ,t_s")
    assert columns is not None
    columns, _ = columns.settled(columns.parse(["1,1,1,0,0,1,0"]))
    rows = columns.convert(columns.parse(["1,1,1,0,0,1,1746801688.014539", "1,1,1,0,0,1,1746801688.119681"]))
    assert rows.t.tolist() == [1746801688014539000, 1746801688119681000]


def test_slow_sensors_with_empty_fields_have_only_their_rows(tmp_path: Path) -> None:
    lines = [CANONICAL]
    for i, line in enumerate(lines_of_a_walk()[1:]):
        fields = line.split(",")
        if i % 5:
            fields[7:10] = ["", "", ""]
        if i % 10:
            fields[10] = ""
        lines.append(",".join(fields))
    log = read_lines(tmp_path, lines)
    assert (len(log.acc), len(log.gyro), len(log.mag), len(log.pressure)) == (N, N, N // 5, N // 10)
    np.testing.assert_allclose(log.mag.t_s, 0.1 * np.arange(N // 5), atol=1e-9)
    np.testing.assert_allclose(log.mag.values, MAG[::5], atol=1e-4)


def test_repeated_values_of_a_slow_sensor_are_dropped(log: Log) -> None:
    header = CANONICAL.removesuffix(",temp_c,event")
    read = log(header, T_S * 1e3, ACC / G, GYRO / DEG, MAG[I // 5 * 5], PRESSURE[I // 10 * 10])
    np.testing.assert_allclose(read.mag.values[:, 0], MAG[::5, 0], atol=1e-6)
    assert read.mag.rate_hz == pytest.approx(10.0)
    assert read.pressure.rate_hz == pytest.approx(5.0)
    assert read.counts["mag_repeats"] == N - len(read.mag)
    read = log(header, T_S * 1e3, ACC / G, GYRO / DEG, MAG, np.where(I < 250, 1013.0, 1012.9))
    assert 6 <= len(read.pressure) <= 8 or len(read.pressure) == 0  # one a second while it stays the same
    assert len(read.mag) == N


def test_events_begin_once_and_carry_their_text(tmp_path: Path) -> None:
    lines = lines_of_a_walk()
    lines[1:] = [line.rsplit(",", 1)[0] + "," for line in lines[1:]]
    for row, text in ((10, "start"), (50, "b"), (51, "b"), (52, "b"), (60, "b"), (70, "0"), (80, "Brücke")):
        lines[1 + row] += text.encode().decode("latin-1")
    lines[101] = lines[101].removesuffix(",")  # the column may be left out
    log = read_lines(tmp_path, lines)
    assert [(round(e.t_s / 0.02), e.label) for e in log.events] == [(10, "start"), (50, "b"), (60, "b"), (80, "Brücke")]
    assert len(log.acc) == N


def test_the_example_reads() -> None:
    header, *rows = EXAMPLE.splitlines()
    columns = Columns.from_header(header)
    assert columns is not None
    parsed = columns.parse(rows)
    assert parsed.counts == {}
    assert parsed.t.tolist() == [10250, 10260]
    assert parsed.events == [(1, "button")]


@pytest.mark.parametrize("width", [11, 12, 13])
def test_a_stream_joined_midway_is_taken_as_canonical(width: int, tmp_path: Path) -> None:
    lines = [",".join(line.split(",")[:width]) for line in lines_of_a_walk()[1:]]
    path = tmp_path / "midway.csv"
    path.write_text("\n".join([lines[0][17:], *lines]) + "\n")
    assert detect(path) == "m5stickc"
    log = read_log(path).log
    assert len(log.acc) == N
    assert log.notices[0].startswith("no header: columns taken as t_ms,ax_g")


def test_clock_restart_goes_on_from_the_last_row(tmp_path: Path) -> None:
    lines = lines_of_a_walk()
    again = [line.replace(line.split(",")[0], str(200 + 20 * i), 1) for i, line in enumerate(lines[1:])]
    log = read_lines(tmp_path, [*lines, CANONICAL, *again])
    assert log.counts["clock_restarts"] == 1
    assert log.counts["headers_repeated"] == 1
    np.testing.assert_allclose(np.diff(log.acc.t_s), 0.02, atol=1e-9)
    assert len(log.acc) == 2 * N
    assert any("restarted" in notice for notice in log.notices)


def test_one_garbled_time_is_no_restart_and_costs_one_row(tmp_path: Path) -> None:
    for bad in ("99999999", "4", "999999999999999999", "-5"):
        for row in (1, 2, 150, N - 1, N):
            lines = lines_of_a_walk()
            lines[row] = lines[row].replace(lines[row].split(",")[0], bad, 1)
            log = read_lines(tmp_path, lines)
            assert len(log.acc) == N - 1, (bad, row, log.counts)
            assert "clock_restarts" not in log.counts
            assert log.duration_s < 6.1


@pytest.mark.parametrize("step_ms", [20, 5000])
def test_time_backwards_throughout_is_refused(step_ms: int, log: Log) -> None:
    with pytest.raises(DataError, match="time goes backwards"):
        log("t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", 10_000_000 - step_ms * I, ACC / G, GYRO / DEG)


def test_whole_second_stamps_are_spread(log: Log) -> None:
    read = log("t_s,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", np.floor(T_S), ACC / G, GYRO / DEG)
    assert read.acc.rate_hz == pytest.approx(50.0)
    assert len(read.acc) > N - 50
    read = log("timestamp,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", np.floor(T_S), ACC / G, GYRO / DEG)
    assert read.acc.rate_hz == pytest.approx(50.0)


def test_a_row_with_an_impossible_number_is_dropped_whole(tmp_path: Path) -> None:
    lines = lines_of_a_walk()
    fields = lines[40].split(",")
    lines[40] = ",".join([fields[0], "442355.0", *fields[2:]])
    log = read_lines(tmp_path, lines)
    assert log.counts == {"rows_impossible": 1}
    assert len(log.gyro) == len(log.mag) == N - 1


def test_gz_equals_plain_and_crlf_equals_lf(tmp_path: Path) -> None:
    text = "\n".join(lines_of_a_walk()) + "\n"
    plain, crlf, packed = tmp_path / "a.csv", tmp_path / "b.csv", tmp_path / "c.csv.gz"
    plain.write_bytes(text.encode())
    crlf.write_bytes(text.replace("\n", "\r\n").encode())
    packed.write_bytes(gzip.compress(text.encode()))
    logs = [read_log(path).log for path in (plain, crlf, packed)]
    for other in logs[1:]:
        np.testing.assert_array_equal(logs[0].acc.t_s, other.acc.t_s)
        np.testing.assert_array_equal(logs[0].gyro.values, other.gyro.values)
        assert logs[0].events == other.events
        assert other.counts == {}
    assert logs[2].name == "c"


def test_line_by_line_equals_the_whole_file(tmp_path: Path) -> None:
    lines = lines_of_a_walk()
    lines[30] = lines[30][:25]
    lines[31] = lines[31].replace(".", "x", 1)
    columns = Columns.from_header(lines[0])
    assert columns is not None
    columns, _ = columns.settled(columns.parse(lines[1:]))
    whole = columns.convert(columns.parse(lines[1:]))
    live = [columns.convert(columns.parse([line + "\r\n"])) for line in lines[1:]]
    np.testing.assert_array_equal(np.concatenate([rows.t for rows in live]), whole.t)
    for sensor, values in whole.values.items():
        np.testing.assert_array_equal(np.concatenate([rows.values[sensor] for rows in live]), values)
    assert sum(len(rows.events) for rows in live) == len(whole.events) == 3
    assert sum(rows.counts.get("lines_unreadable", 0) for rows in live) == whole.counts["lines_unreadable"] == 2


JUNK = st.one_of(
    st.tuples(st.just("cut"), st.integers(0, 80)),
    st.tuples(st.just("put"), st.text(st.characters(max_codepoint=255), min_size=1, max_size=12)),
    st.tuples(st.just("line"), st.text(st.characters(max_codepoint=255), max_size=40)),
    st.tuples(st.just("join"), st.just("")),
    st.tuples(st.just("head"), st.just(CANONICAL)),
    st.tuples(
        st.just("time"), st.sampled_from(["", "nan", "1e999", "-9223372036854775808", "1" * 30, "0", "9e15", "1_0"])
    ),
    st.tuples(st.just("value"), st.sampled_from(["nan", "inf", "-inf", "1e308", "", " ", "0x1", "--1", "1e", "True"])),
)


@given(st.lists(st.tuples(st.integers(0, 400), st.integers(0, 90), JUNK), max_size=40), st.booleans(), st.booleans())
@example([(i, 0, ("time", "1e999")) for i in range(401)], False, True)
@example([(i, 0, ("value", "inf")) for i in range(401)], False, True)
@example([(i, 3, ("value", "inf")) for i in range(401)], False, False)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_junk_never_breaks_the_reader(tmp_path: Path, damage: list, also_header: bool, units: bool) -> None:
    lines = lines_of_a_walk(400)
    if not units:
        lines[0] = "t,ax,ay,az,gx,gy,gz,mx,my,mz,p,temp,event"
    for row, at, (kind, what) in damage:
        if row == 0 and not also_header:
            continue
        line = lines[row]
        fields = line.split(",")
        lines[row] = {
            "cut": lambda line=line, what=what: line[: int(what)],
            "put": lambda line=line, at=at, what=what: line[:at] + what + line[at:],
            "line": lambda what=what: what,
            "join": lambda line=line, row=row: line + lines[row - 1],
            "head": lambda what=what: what,
            "time": lambda fields=fields, what=what: ",".join([what, *fields[1:]]),
            "value": lambda fields=fields, at=at, what=what: ",".join(
                [*fields[: 1 + at % 10], what, *fields[2 + at % 10 :]]
            ),
        }[kind]()
    try:
        log = read_lines(tmp_path, lines)
    except DataError as error:
        message = str(error)
    else:
        message = ""
        check_sound(log)
    assert "\n" not in message
    if not also_header and len(damage) < 10:
        assert not message
        assert len(log.acc) >= 400 - 3 * len(damage)


@given(st.lists(st.text("0123456789.,-+e_ nax\x00\"'\xb2", max_size=30), min_size=101, max_size=130))
@settings(max_examples=40, deadline=None)
def test_many_lines_parse_like_few(lines: list[str]) -> None:
    columns = Columns.from_header("t_ms,ax_g,ay_g,az_g,event")
    assert columns is not None
    lines = [line if i % 2 else f"{i},1.5,{line},0.25," for i, line in enumerate(lines)]
    many = columns.parse(lines)
    few = [columns.parse([line]) for line in lines]
    np.testing.assert_array_equal(np.concatenate([rows.values["acc"] for rows in few]), many.values["acc"])
    np.testing.assert_array_equal(np.concatenate([rows.t for rows in few]), many.t)
    assert [text for rows in few for _, text in rows.events] == [text for _, text in many.events]


@pytest.mark.parametrize(
    ("header", "found"),
    [
        ("time,seconds_elapsed,z,y,x", False),
        ('"Time (s)","X (m/s^2)","Y (m/s^2)","Z (m/s^2)"', False),
        ("t_ms,ax_g,ay_g,gx_dps,gy_dps,gz_dps", False),
        ("linacce_x,linacce_y,linacce_z", False),
        ("ax_world,ay_world,az_world", False),
        ("\u00ef\u00bb\u00bft_ms,AX,AY,AZ", True),
    ],
)
def test_only_headers_with_an_accelerometer_are_taken(header: str, found: bool) -> None:
    assert (Columns.from_header(header) is not None) == found


def test_real_m5stickc_logs(shared_data: Path) -> None:
    for path in sorted((shared_data / "formats" / "m5stickc_plus_kilian_tcp").glob("*.csv")):
        log = read_log(path).log
        check_sound(log)
        assert log.format == "m5stickc"
        assert 9.0 < log.acc.rate_hz < 11.0
        assert 179.0 < log.duration_s < 182.0
        assert len(log.acc) > 0.98 * (len(path.read_text().splitlines()) - 1)
        assert 1 <= log.counts["rows_impossible"] <= 5
        assert np.median(np.linalg.norm(log.acc.values, axis=1)) == pytest.approx(G, rel=0.03)
        assert any("10" in notice or "9." in notice for notice in log.notices)
    for path in sorted((shared_data / "formats" / "m5stickcplus_kjwu").glob("*.csv")):
        log = read_log(path).log
        check_sound(log)
        assert log.counts == {}
        assert any("no time column: 50 Hz assumed" in notice for notice in log.notices)
    log = read_log(shared_data / "formats" / "esp32_icm20948_gps_kris_Apache2" / "sensor.csv").log
    check_sound(log)
    assert len(log.mag) == len(log.acc) == 19864
    assert np.abs(log.gyro.values).max() == pytest.approx(249 * DEG)


def test_real_phone_logs_in_csv_are_understood(shared_data: Path) -> None:
    for path in sorted((shared_data / "ridi").glob("*.csv.gz")):
        log = read_log(path).log
        check_sound(log)
        assert 195.0 < log.acc.rate_hz < 210.0
        assert np.percentile(np.linalg.norm(log.gyro.values, axis=1), 90) > 0.5  # rad/s, not °/s
        assert np.median(np.linalg.norm(log.acc.values, axis=1)) == pytest.approx(G, rel=0.1)
