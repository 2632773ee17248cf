"""What columns are taken for, by the headers that apps, loggers and sketches write."""

from __future__ import annotations

import pytest
from support.tables_by_hand import best, said, table_of

from fbgraph.columns.column_names import CANONICAL, guess_columns
from fbgraph.columns.units import UNITS, quantities_of, unit_of

_X = {"x": "xyz", "X": "XYZ", "0": "012", "1": "123"}
VECTORS = {  # the name of the x axis: what its three are
    "ax_g": "acc[g]",
    "ax_m_s2": "acc[ms2]",
    "ax (mg)": "acc[mg]",
    "acc_g_x": "acc[g]",
    "acc_mg_x": "acc[mg]",
    "AccX_ms2": "acc[ms2]",
    "aX": "acc",
    "AcX": "acc",
    "Accel X": "acc",
    "accel_x_mg": "acc[mg]",
    "xacc": "acc",
    "acce_x": "acc",
    "acc[0]": "acc",
    "accel1": "acc",
    "imu_0_ax": "acc",
    "mpu6050_ax": "acc",
    "UncalAccelXMps2": "acc[ms2]",
    "a_RS_S_x [m s^-2]": "acc[ms2]",
    "ACCELEROMETER X (m/s²)": "acc[ms2]",
    "Acceleration X(g)": "acc[g]",
    "Acc X (m/sÂ²)": "acc[ms2]",
    "accelerometerAccelerationX(G)": "acc[g]",
    "accelerationIncludingGravity.x": "acc",
    "BMI160 Accelerometer.x": "acc",
    "加速度X(g)": "acc[g]",
    "Beschleunigung x (m/s²)": "acc[ms2]",
    "aceleración x": "acc",
    "accélération x (m/s²)": "acc[ms2]",
    "x-axis (g)": "acc[g]",
    "LINEAR ACCELERATION X (m/s²)": "linear_acc[ms2]",
    "linearAccelerationX": "linear_acc",
    "lineare Beschleunigung x (m/s²)": "linear_acc[ms2]",
    "Acceleration without g x (m/s^2)": "linear_acc[ms2]",
    "motionUserAccelerationX(G)": "linear_acc[g]",
    "user_acc_x(G)": "linear_acc[g]",
    "linacce_x": "linear_acc",
    "lacx": "linear_acc",
    "GRAVITY X (m/s²)": "gravity[ms2]",
    "motionGravityX(G)": "gravity[g]",
    "grav_x": "gravity",
    "Schwerkraft x": "gravity",
    "gx_dps": "gyro[dps]",
    "gx_rads": "gyro[rads]",
    "GX": "gyro",
    "G X": "gyro",
    "GyX": "gyro",
    "wx(deg/s)": "gyro[dps]",
    "AsX(°/s)": "gyro[dps]",
    "Gyr X (Â°/s)": "gyro[dps]",
    "gyro_x_mdps": "gyro[mdps]",
    "xgyro": "gyro",
    "imu_1_gx": "gyro",
    "w_RS_S_x [rad s^-1]": "gyro[rads]",
    "rotation_rate_x(radians/s)": "gyro[rads]",
    "motionRotationRateX(rad/s)": "gyro[rads]",
    "gyroRotationX(rad/s)": "gyro[rads]",
    "Angular velocity X(°/s)": "gyro[dps]",
    "GYROSCOPE X (rad/s)": "gyro[rads]",
    "UncalGyroXRadPerSec": "gyro[rads]",
    "角速度X(°/s)": "gyro[dps]",
    "Winkelgeschwindigkeit x (°/s)": "gyro[dps]",
    "mx_ut": "mag[ut]",
    "HX(uT)": "mag[ut]",
    "Bx": "mag",
    "hx": "mag",
    "xmag": "mag",
    "mag_x_mgauss": "mag[mgauss]",
    "Mag X (�T)": "mag[ut]",
    "MagnX[uT]": "mag[ut]",
    "magnet_x": "mag",
    "MAGNETIC FIELD X (μT)": "mag[ut]",
    "Magnetic field X(ʯt)": "mag[ut]",
    "UncalMagXMicroT": "mag[ut]",
    "magnetic_field_x(microteslas)": "mag[ut]",
    "champ magnétique x (µT)": "mag[ut]",
    "Magnetfeld x (µT)": "mag[ut]",
}
SINGLES = {
    "t_ms": "time[ms]",
    "t_us": "time[us]",
    "t_sec": "time[s]",
    "millis": "time[ms]",
    "seconds": "time[s]",
    "seconds_elapsed": "time[s]",
    "Time (s)": "time[s]",
    "Zeit (s)": "time[s]",
    "#timestamp [ns]": "time[ns]",
    "%time": "time",
    "TimeStamp[ms]": "time[ms]",
    "Time since start in ms ": "time[ms]",
    "GPST": "time",
    "ChipTime": "time",
    "epoc (ms)": "time[ms]",
    "utcTimeMillis": "time[ms]",
    "elapsedRealtimeNanos": "time[ns]",
    "accelerometerTimestamp_sinceReboot(s)": "time[s]",
    "SampleTimeFine": "time",
    "locationTimestamp_since1970(s)": "time[s]",
    "dt": "unknown",
    "interval": "unknown",
    "n": "counter",
    "SampleID": "counter",
    "PacketCounter": "counter",
    "iterator": "counter",
    "loggingSample(N)": "counter",
    "segment": "unknown",
    "p_hpa": "pressure[hpa]",
    "pressure_pa": "pressure[pa]",
    "Press[Pa]": "pressure[pa]",
    "ATMOSPHERIC PRESSURE (hPa)": "pressure[hpa]",
    "altimeterPressure(kPa)": "pressure[kpa]",
    "press_abs": "pressure",
    "Luftdruck (hPa)": "pressure[hpa]",
    "p": "orientation",
    "pitch": "orientation",
    "ORIENTATION X (pitch °)": "orientation",
    "Angle X(°)": "orientation",
    "locationMagneticHeading(°)": "orientation",
    "LOCATION Altitude-atmospheric pressure ( m)": "height[m]",
    "relativeAltitude": "altitude",
    "imu_degC": "temperature[c]",
    "T(°)": "temperature[c]",
    "temp_c": "temperature[c]",
    "aT": "unknown",
    "TgF": "unknown",
    "gForce": "unknown",
    "accNorm": "unknown",
    "acc_mag": "unknown",
    "gyro_x_bias": "unknown",
    "BiasXMicroT": "unknown",
    "b_w_RS_S_x [rad s^-1]": "unknown",
    "v_RS_R_x [m s^-1]": "unknown",
    "output_Hz": "unknown",
    "locationSpeed(m/s)": "unknown",
    "Velocity (m/s)": "unknown",
    "Battery level(%)": "unknown",
    "millisecond_press_duration": "unknown",
    "p_RS_R_x [m]": "truth_x[m]",
    "pos_y": "truth_y",
    "Latitude (°)": "lat",
    "Lng": "lon",
    "LOCATION Longitude : ": "lon",
    "Horizontal Accuracy (m)": "accuracy[m]",
    "event": "event",
    "Device name": "device",
}


@pytest.mark.parametrize(("x", "expected"), VECTORS.items())
def test_three_axes_by_name(x: str, expected: str) -> None:
    at = max(x.rfind(mark) for mark in "xX01") if x in ("acc[0]", "accel1") else _place_of_axis(x)
    names = [x[:at] + axis + x[at + 1 :] for axis in _X[x[at]]]
    found = best(table_of(names))
    quantity, _, unit = expected.partition("[")
    wanted = [f"{quantity}.{axis}" + (f"[{unit}" if unit else "") for axis in "xyz"]
    assert [said(found[name]) for name in names] == wanted
    assert all(found[name].weight > 0.35 for name in names)


def _place_of_axis(name: str) -> int:
    """Of the letter x in a name that is its axis: the last that is not inside a word such as ``axis``."""
    return max(i for i, c in enumerate(name) if c in "xX" and name[i : i + 4] not in ("xis ",))


@pytest.mark.parametrize(("name", "expected"), SINGLES.items())
def test_one_column_by_name(name: str, expected: str) -> None:
    assert said(best(table_of([name]))[name.strip()]) == expected


def test_an_index_of_one_quantity_never_takes_the_unit_of_another() -> None:
    found = best(table_of("ax_raw;ay_raw;az_raw;ax_g;ay_g;az_g"))
    assert [(found[f"a{axis}_raw"].unit, found[f"a{axis}_raw"].grade) for axis in "xyz"] == [("", "raw")] * 3
    assert [(found[f"a{axis}_g"].unit, found[f"a{axis}_g"].grade) for axis in "xyz"] == [("g", "")] * 3


def test_a_row_of_units_belongs_to_each_column() -> None:
    header = "Timestamp;Accel X;Accel Y;Accel Z;Gyro X;Gyro Y;Gyro Z;Mag X;Mag Y;Mag Z"
    units = ("ms", *["mg"] * 3, *["mdps"] * 3, *["mG"] * 3)
    found = best(table_of(header, units=units))
    assert said(found["Timestamp"]) == "time[ms]"
    assert said(found["Accel X"]) == "acc.x[mg]"
    assert said(found["Gyro Y"]) == "gyro.y[mdps]"
    assert said(found["Mag Z"]) == "mag.z[mgauss]"


def test_p_is_pressure_if_it_is_one() -> None:
    pressure = [1008.0 + i / 100 for i in range(50)]
    assert best(table_of("t;p", {"t": range(50), "p": pressure}))["p"].quantity == "pressure"
    assert best(table_of("t;p", {"t": range(50), "p": [20.0] * 50}))["p"].quantity == "orientation"
    assert best(table_of("r;p;y", {"r": range(50), "p": pressure, "y": range(50)}))["p"].quantity == "orientation"


def test_gx_beside_wx_is_gravity() -> None:
    found = best(table_of("ax;ay;az;gx;gy;gz;wx;wy;wz"))
    assert [said(found[name]) for name in ("ax", "gx", "wx")] == ["acc.x", "gravity.x", "gyro.x"]
    assert said(best(table_of("ax;ay;az;gx (m/s²);gy (m/s²);gz (m/s²)"))["gx (m/s²)"]) == "gravity.x[ms2]"


def test_acceleration_beside_one_including_gravity_has_none() -> None:
    names = [f"acceleration{kind}.{axis}" for kind in ("", "IncludingGravity") for axis in "xyz"]
    found = best(table_of(names))
    assert [found[name].quantity for name in names] == ["linear_acc"] * 3 + ["acc"] * 3


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ("Accelerometer", "acc.x"),
        ("acc", "acc.x"),
        ("Linear Accelerometer", "linear_acc.x"),
        ("LinearAcceleration", "linear_acc.x"),
        ("TotalAcceleration", "acc.x"),
        ("Gravity", "gravity.x"),
        ("Gyroscope", "gyro.x"),
        ("UncalGyro", "gyro.x"),
        ("AngularVelocity", "gyro.x"),
        ("android.sensor.magnetic_field", "mag.x"),
        ("TYPE_GYROSCOPE", "gyro.x"),
        ("walk", "unknown"),
    ],
)
def test_x_y_z_are_of_the_sensor_that_names_the_table(table: str, expected: str) -> None:
    assert said(best(table_of("time;x;y;z", name=table))["x"]) == expected


def test_a_barometer_has_no_axes() -> None:
    found = best(table_of("Time (s);X (hPa)", name="Barometer"))["X (hPa)"]
    assert said(found) == "pressure[hpa]"


def test_without_a_header_the_table_and_the_order_tell() -> None:
    table = table_of(["", "", "", ""], name="gyr")
    bare = type(table)(table.name, table.source, table.columns, headed=False)
    assert [said(guess) for guess in sorted(guess_columns(bare), key=lambda guess: guess.column)] == [
        "time",
        "gyro.x",
        "gyro.y",
        "gyro.z",
    ]
    six = table_of([""] * 6)
    guesses = guess_columns(type(six)(six.name, six.source, six.columns, headed=False))
    assert {guess.quantity for guess in guesses} == {"unknown"}


def test_canonical_columns_need_no_header() -> None:
    names = CANONICAL.split(",")
    values = {"t_ms": range(0, 2000, 10), "p_hpa": [1013.0] * 200, "event": [""] * 200}
    table = table_of(names, values)
    bare = type(table)(table.name, table.source, table.columns, headed=False)
    found = {guess.column: said(guess) for guess in reversed(guess_columns(bare))}
    assert found[0] == "time[ms]"
    assert found[1] == "acc.x[g]"
    assert found[6] == "gyro.z[dps]"
    assert found[10] == "pressure[hpa]"
    far = table_of(names, values | {"p_hpa": [12.0] * 200})
    guesses = guess_columns(type(far)(far.name, far.source, far.columns, headed=False))
    assert {guess.quantity for guess in guesses} == {"unknown"}


def test_units_belong_to_a_quantity() -> None:
    assert unit_of("mg", "acc") == "mg"
    assert unit_of("mG", "mag") == "mgauss"
    assert unit_of("m/s", "time") == ""
    assert unit_of("m/s^2", "acc") == "ms2"
    assert quantities_of("mg") == ("acc", "mag")
    assert quantities_of("hPa") == ("pressure",)
    for quantity, units in UNITS.items():
        for unit in units:
            assert unit in ("100us",) or unit_of(unit, quantity) == unit, (quantity, unit)


@pytest.mark.parametrize(
    ("quantity", "unit", "si"),
    [
        ("acc", "g", 9.80665),
        ("acc", "mg", 0.00980665),
        ("gyro", "dps", 0.017453292519943295),
        ("gyro", "mdps", 1.7453292519943295e-05),
        ("mag", "nt", 0.001),
        ("mag", "gauss", 100.0),
        ("mag", "mgauss", 0.1),
        ("mag", "t", 1e6),
        ("pressure", "pa", 0.01),
        ("pressure", "kpa", 10.0),
        ("time", "100us", 1e5),
        ("time", "day", 8.64e13),
    ],
)
def test_factors_to_si(quantity: str, unit: str, si: float) -> None:
    assert UNITS[quantity][unit] == pytest.approx(si, rel=1e-12)


def test_every_column_is_guessed_and_hostile_names_end() -> None:
    names = ["", "x" * 5000, "=cmd()", "\x1b[31m", "🎲", "((((", "a" * 40 + "x", "_", "1_000"]
    table = table_of(names)
    assert {guess.column for guess in guess_columns(table)} == set(range(len(names)))
