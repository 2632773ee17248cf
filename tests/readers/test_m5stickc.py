"""The M5StickC CSV reader: names, units, slow sensors, and what other devices call the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.m5stickc_lines import (
    ACC,
    DEG,
    GYRO,
    MAG,
    PRESSURE,
    T_S,
    G,
    I,
    N,
    lines_of_a_walk,
    read_columns,
    read_lines,
    read_rows,
)
from support.waves import check_sound

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.errors import DataError
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.readers import read_log

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
def test_header_variants_give_si(variant: str, tmp_path: Path) -> None:
    header, columns, assumptions = VARIANTS[variant]
    read = read_columns(tmp_path, header, *columns)
    np.testing.assert_allclose(read.acc.values, ACC, atol=1e-6)
    np.testing.assert_allclose(read.gyro.values, GYRO, atol=1e-6)
    np.testing.assert_allclose(read.acc.t_s + read.t0_s, T_S, atol=1e-9)
    if len(read.mag):
        np.testing.assert_allclose(read.mag.values, MAG, atol=1e-6)
    if len(read.pressure):
        np.testing.assert_allclose(read.pressure.values[:, 0], PRESSURE, atol=1e-4)
    assert sum("no unit in" in notice for notice in read.notices) == assumptions, read.notices


@pytest.mark.parametrize("header", ["aX,aY,aZ,gX,gY,gZ", "SampleID,AccX_ms2,AccY_ms2,AccZ_ms2,GyroX,GyroY,GyroZ"])
def test_without_a_time_column_50_hz_are_assumed_and_said(header: str, tmp_path: Path) -> None:
    counted = header.startswith("Sample")
    index = np.delete(I, [100, 101, 102])  # lost samples show in the counter only
    columns = (index, ACC[index], GYRO[index] / DEG) if counted else (ACC / G, GYRO / DEG)
    read = read_columns(tmp_path, header, *columns)
    assert read.acc.rate_hz == pytest.approx(50.0)
    assert read.acc.t_s[-1] == pytest.approx((N - 1) / 50)
    assert any("50 Hz assumed" in notice for notice in read.notices)


def test_raw_magnetometer_counts_are_scaled_and_said(tmp_path: Path) -> None:
    header = "SampleID,AccX_ms2,AccY_ms2,AccZ_ms2,GyroX_dps,GyroY_dps,GyroZ_dps,MagX,MagY,MagZ"
    read = read_columns(tmp_path, header, I, ACC, GYRO / DEG, np.round(MAG / 0.15 * 5))
    assert np.median(np.linalg.norm(read.mag.values, axis=1)) == pytest.approx(50.0, rel=0.01)
    np.testing.assert_allclose(
        read.mag.values[0] / np.linalg.norm(read.mag.values[0]), MAG[0] / np.linalg.norm(MAG[0]), atol=1e-2
    )
    assert any("magnetic field: no unit in its name" in notice and "scaled to 50" in notice for notice in read.notices)


def test_gyro_unit_of_a_device_at_rest_is_degrees(tmp_path: Path) -> None:
    still = np.tile([0.0, 0.0, 1.0], (N, 1)) + 1e-3 * np.sin(np.outer(I, [1, 2, 3]))
    read = read_columns(
        tmp_path, "t_ms,ax,ay,az,gx,gy,gz", T_S * 1e3, still, np.tile([2.0, 0.0, 0.0], (N, 1)) + still / 10
    )
    assert np.median(read.gyro.values[:, 0]) == pytest.approx(2.0 * DEG, rel=0.01)


@pytest.mark.parametrize(("unit", "step"), [("ns", 20_000_001), ("us", 20_003), ("ms", 20)])
@pytest.mark.parametrize("bad_time", ["", "17645x", "nan", "9" * 19, "9" * 30])
def test_epoch_times_lose_nothing(unit: str, step: int, bad_time: str, tmp_path: Path) -> None:
    """Where a garbled time has no place in whole numbers, the others keep what a float has of them: a microsecond."""
    tick = {"ns": 1, "us": 1000, "ms": 1_000_000}[unit]
    first = 1764585663780992301 // tick
    rows = [f"{first + step * i},{i % 7 / 100},0,1,0,{i % 5},0" for i in range(300)]
    rows[9] = bad_time + ",0,0,1,0,0,0"
    raw = read_rows(tmp_path, [f"t_{unit},ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", *rows])
    expected = [(first + step * i) * tick for i in range(300) if i != 9]
    assert np.abs(raw.streams["acc"].t_ns[np.abs(raw.streams["acc"].t_ns) <= MAX_T_NS] - expected).max() < 1000
    rows[9] = f"{first + step * 9},0,0,1,0,0,0"
    raw = read_rows(tmp_path, [f"t_{unit},ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", *rows])
    assert raw.streams["acc"].t_ns.tolist() == [(first + step * i) * tick for i in range(300)]


def test_epoch_seconds_keep_their_microseconds(tmp_path: Path) -> None:
    rows = [f"1,1,{i},0,0,1,{1746801688.014539 + 0.02 * i:.6f}" for i in range(30)]
    raw = read_rows(tmp_path, ["GX_dps,GY_dps,GZ_dps,AX_g,AY_g,AZ_g,t_s", *rows])
    assert raw.streams["acc"].t_ns.tolist() == [1746801688014539000 + 20_000_000 * i for i in range(30)]


def test_raw_acceleration_is_understood_and_gravity_removed_refused(tmp_path: Path) -> None:
    read = read_columns(tmp_path, "t_ms,ax,ay,az,gx,gy,gz", T_S * 1e3, np.round(ACC / G * 4096), GYRO / DEG)
    np.testing.assert_allclose(read.acc.values, ACC, atol=2e-3)
    assert any("taken as raw, 4096 a g" in notice for notice in read.notices)
    with pytest.raises(DataError, match="gravity removed") as error:
        read_columns(tmp_path, "t_ms,ax_ms2,ay_ms2,az_ms2,gx,gy,gz", T_S * 1e3, ACC - [0, 0, 9.8], GYRO / DEG)
    assert "\n" not in str(error.value)


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


def test_repeated_values_of_a_slow_sensor_are_dropped(tmp_path: Path) -> None:
    header = CANONICAL.removesuffix(",temp_c,event")
    read = read_columns(tmp_path, header, T_S * 1e3, ACC / G, GYRO / DEG, MAG[I // 5 * 5], PRESSURE[I // 10 * 10])
    np.testing.assert_allclose(read.mag.values[:, 0], MAG[::5, 0], atol=1e-6)
    assert read.mag.rate_hz == pytest.approx(10.0)
    assert read.pressure.rate_hz == pytest.approx(5.0)
    assert read.counts["mag_repeats"] == N - len(read.mag)
    read = read_columns(tmp_path, header, T_S * 1e3, ACC / G, GYRO / DEG, MAG, np.where(I < 250, 1013.0, 1012.9))
    assert 6 <= len(read.pressure) <= 8 or len(read.pressure) == 0  # one a second while it stays the same
    assert len(read.mag) == N


def test_events_begin_once_and_carry_their_text(tmp_path: Path) -> None:
    lines = lines_of_a_walk()
    lines[1:] = [line.rsplit(",", 1)[0] + "," for line in lines[1:]]
    for row, text in ((10, "start"), (50, "b"), (51, "b"), (52, "b"), (60, "b"), (70, "0"), (80, "Brücke")):
        lines[1 + row] += text.encode().decode("latin-1")
    lines[101:] = [line.removesuffix(",") for line in lines[101:]]  # the column may be left out
    log = read_lines(tmp_path, lines)
    assert [(round(e.t_s / 0.02), e.label) for e in log.events] == [(10, "start"), (50, "b"), (60, "b"), (80, "Brücke")]
    assert len(log.acc) == N


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
        assert any("50 Hz assumed" in notice for notice in log.notices)
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
