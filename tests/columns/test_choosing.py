"""Which columns are used for each quantity, and what is said of the others."""

from __future__ import annotations

import numpy as np
import pytest
from support.tables_by_hand import table_of

from fbgraph.columns.choosing import choose
from fbgraph.columns.column_names import guess_columns
from fbgraph.columns.guesses import Chosen
from fbgraph.tables.table import Table

XYZ = "time;seconds_elapsed;z;y;x"


def chosen(*tables: Table) -> Chosen:
    return choose(tables, [guess_columns(table) for table in tables])


def names(tables: tuple[Table, ...], result: Chosen, quantity: str) -> tuple[str, ...]:
    pick = result.picks[quantity]
    return (tables[pick.table].name, *(tables[pick.table].columns[i].name for i in pick.columns))


def test_a_unit_beats_raw_counts() -> None:
    table = table_of("t_ms;ax_raw;ay_raw;az_raw;gx_raw;gy_raw;gz_raw;ax_g;ay_g;az_g;gx_dps;gy_dps;gz_dps")
    result = chosen(table)
    assert names((table,), result, "acc") == ("walk", "ax_g", "ay_g", "az_g")
    assert result.picks["gyro"].unit == "dps"
    assert [(pick.grade, why[:10]) for pick, why in result.passed_over] == [("raw", "raw counts")] * 2


def test_sensor_logger_keeps_gravity_and_its_axes_in_order() -> None:
    tables = tuple(
        table_of(XYZ, name=name) for name in ("Accelerometer", "AccelerometerUncalibrated", "Gyroscope", "Gravity")
    )
    total = table_of(XYZ, name="TotalAcceleration")
    result = chosen(*tables, total)
    assert names((*tables, total), result, "acc") == ("TotalAcceleration", "x", "y", "z")
    assert result.picks["acc"].unit == "ms2"
    assert "linear_acc" not in result.picks
    assert result.apps == ("Sensor Logger",)
    restored = chosen(*tables)
    assert "acc" not in restored.picks
    assert names(tables, restored, "linear_acc") == ("Accelerometer", "x", "y", "z")
    assert names(tables, restored, "gravity") == ("Gravity", "x", "y", "z")


@pytest.mark.parametrize(
    ("platform", "standardised", "sign"), [("ios", "false", -1), ("ios", "true", 1), ("android", "false", 1)]
)
def test_sensor_logger_has_the_signs_of_its_system(platform: str, standardised: str, sign: int) -> None:
    facts = {"version": ["3"], "platform": [platform], "standardisation": [standardised]}
    metadata = table_of("version;platform;standardisation", facts, name="Metadata")
    result = chosen(table_of(XYZ, name="TotalAcceleration"), table_of(XYZ, name="Gyroscope"), metadata)
    assert result.picks["acc"].signs == (sign,) * 3
    assert result.picks["gyro"].signs == (1, 1, 1)


def test_sensor_logger_linear_alone_is_no_accelerometer() -> None:
    result = chosen(table_of(XYZ, name="Accelerometer"), table_of(XYZ, name="Gyroscope"))
    assert "acc" not in result.picks
    assert result.picks["linear_acc"].unit == "ms2"


def test_physics_toolbox_g_force_is_the_accelerometer() -> None:
    table = table_of("time;gFx;gFy;gFz;ax;ay;az;wx;wy;wz;p;Bx;By;Bz;Azimuth;Pitch;Roll;I;Gain")
    result = chosen(table)
    assert names((table,), result, "acc")[1:] == ("gFx", "gFy", "gFz")
    assert {q: result.picks[q].unit for q in ("acc", "gyro", "mag", "pressure")} == {
        "acc": "g",
        "gyro": "rads",
        "mag": "ut",
        "pressure": "hpa",
    }
    assert "acc" not in chosen(table_of("time;ax;ay;az;aT")).picks


def test_openlog_artemis_counts_milli_g_and_turns_its_magnetometer() -> None:
    table = table_of("rtcDate;rtcTime;aX;aY;aZ;gX;gY;gZ;mX;mY;mZ;imu_degC;output_Hz")
    picks = chosen(table).picks
    assert (picks["acc"].unit, picks["gyro"].unit, picks["mag"].unit) == ("mg", "dps", "ut")
    assert picks["mag"].signs == (1, -1, -1)


def test_ros_linear_acceleration_has_gravity() -> None:
    axes = [f"field.{what}.{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    picks = chosen(table_of(["%time", "field.header.seq", "field.header.stamp", *axes])).picks
    assert (picks["acc"].unit, picks["gyro"].unit) == ("ms2", "rads")


def test_of_two_devices_the_first_is_used_for_everything_and_named() -> None:
    header = [f"{side} {what}_{axis}" for side in ("left", "right") for what in ("acc", "gyr") for axis in "xyz"]
    table = table_of(["time [s]", *header])
    result = chosen(table)
    assert result.picks["acc"].sensor == result.picks["gyro"].sensor == "left"
    assert "left acc_x" in result.notes[0]
    assert "right acc_x" in result.notes[0]
    assert len(result.passed_over) == 2


def test_the_same_names_twice_are_two_sensors() -> None:
    one = ["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z"]
    result = chosen(table_of(["t", *one, *one]))
    assert result.picks["acc"].columns == (1, 2, 3)
    assert result.picks["gyro"].columns == (4, 5, 6)
    assert {pick.columns for pick, _ in result.passed_over} == {(7, 8, 9), (10, 11, 12)}


def test_a_device_with_both_sensors_beats_one_with_an_accelerometer_only() -> None:
    table = table_of("t;chest_ax;chest_ay;chest_az;foot_ax;foot_ay;foot_az;foot_gx;foot_gy;foot_gz")
    result = chosen(table)
    assert result.picks["acc"].sensor == result.picks["gyro"].sensor == "foot"


def test_empty_columns_are_passed_over() -> None:
    values = {"t": np.arange(50), "Press[Pa]": np.full(50, np.nan), "pressure_hpa": np.full(50, 1000.0)}
    table = table_of("t;ax;ay;az;Press[Pa];pressure_hpa", values)
    result = chosen(table)
    assert names((table,), result, "pressure") == ("walk", "pressure_hpa")
    assert [why for pick, why in result.passed_over if pick.quantity == "pressure"] == ["it holds no values"]


def test_three_units_that_differ_are_none() -> None:
    assert chosen(table_of("ax (g);ay (g);az (mg)")).picks["acc"].unit == ""


def test_latitude_and_longitude_come_from_one_table_with_horizontal_accuracy() -> None:
    header = "time;seconds_elapsed;bearingAccuracy;speedAccuracy;verticalAccuracy;horizontalAccuracy;altitude;longitude"
    table = table_of(header + ";latitude", name="Location")
    result = chosen(table)
    assert names((table,), result, "accuracy")[1:] == ("horizontalAccuracy",)
    assert names((table,), result, "lat")[1:] == ("latitude",)
    assert names((table,), result, "height")[1:] == ("altitude",)


def test_two_walks_in_a_folder_are_said_to_be_two_logs() -> None:
    header = "t;ax;ay;az;gx;gy;gz"
    assert chosen(table_of(header, name="one"), table_of(header, name="two")).notes[0].startswith("several logs")
