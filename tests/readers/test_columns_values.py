"""Units of CSV columns: those that names tell, and those that are judged by magnitude, on both sides of each limit."""

import math
from typing import Any

import numpy as np
import pytest
from fbgraph.readers.csv_columns import CANONICAL, Columns, Rows, plain_name

from fbgraph.core.errors import DataError

G, DEG = 9.80665, math.pi / 180.0


def columns(header: str) -> Columns:
    found = Columns.from_header(header)
    assert found is not None
    return found


def named(quantity: str, unit: str) -> float:
    """The scale that a unit in a column's name tells."""
    names = {
        "acc": "ax_{0},ay_{0},az_{0}",
        "gyro": "ax_g,ay_g,az_g,gx_{0},gy_{0},gz_{0}",
        "mag": "ax_g,ay_g,az_g,mx_{0},my_{0},mz_{0}",
        "pressure": "ax_g,ay_g,az_g,p_{0}",
        "time": "t_{0},ax_g,ay_g,az_g",
    }
    return columns(names[quantity].format(unit)).scale[quantity]


@pytest.mark.parametrize(
    ("quantity", "units"),
    [
        ("acc", {"g": G, "mg": G / 1000.0, "ms2": 1.0, "m_s2": 1.0, "mss": 1.0, "mps2": 1.0}),
        (
            "gyro",
            {"dps": DEG, "deg_s": DEG, "degsec": DEG, "mdps": DEG / 1000.0, "rads": 1.0, "rad_s": 1.0, "radsec": 1.0},
        ),
        ("mag", {"ut": 1.0, "nt": 0.001, "mg": 0.1, "mgauss": 0.1, "gauss": 100.0}),
        ("pressure", {"hpa": 1.0, "mbar": 1.0, "pa": 0.01, "kpa": 10.0}),
        (
            "time",
            {"s": 1e9, "sec": 1e9, "secs": 1e9, "second": 1e9, "seconds": 1e9, "ms": 1e6, "msec": 1e6, "millis": 1e6},
        ),
        (
            "time",
            {
                "milliseconds": 1e6,
                "us": 1e3,
                "usec": 1e3,
                "micros": 1e3,
                "microseconds": 1e3,
                "ns": 1,
                "nanoseconds": 1,
            },
        ),
    ],
)
def test_units_in_names(quantity: str, units: dict[str, float]) -> None:
    assert {unit: named(quantity, unit) for unit in units} == pytest.approx(units)


def test_names_are_made_plain() -> None:
    assert plain_name(' "Acc X (m/s²)"') == "acc_x_m_s2"
    assert plain_name("gyro_Y [°/s]") == "gyro_y_deg_s"
    assert plain_name("t (µs)") == plain_name("t (μs)") == "t_us"


def test_axes_are_told_by_their_names_not_their_order() -> None:
    found = columns("gz,ay_g,p_hpa,ax_g,event,t_ms,az_g,gx,gy")
    assert found.where == {"acc": (3, 1, 6), "gyro": (7, 8, 0), "pressure": (2,), "event": (4,), "time": (5,)}
    assert found.scale == {"acc": G, "time": 1e6, "pressure": 1.0}
    assert not found.sampled


def test_a_sensor_needs_its_three_axes() -> None:
    assert Columns.from_header("t,ax,ay,gx,gy,gz") is None
    assert "gyro" not in columns("t,ax,ay,az,gx,gy").where
    assert Columns.names_gyroscope("t,gx,gy,gz")
    assert not Columns.names_gyroscope("t,gx,gy,ax,ay,az")


def test_a_counter_is_a_clock_of_fifty_a_second() -> None:
    for header, where in (("n,ax,ay,az", (0,)), ("ax,ay,az", None)):
        found = columns(header)
        assert (found.sampled, found.scale["time"], found.where.get("time")) == (True, 2e7, where)
    assert columns("n,t_s,ax,ay,az").where["time"] == (1,)
    found = columns("ax_g,ay_g,az_g")
    np.testing.assert_array_equal(
        found.convert(found.parse(["0,0,1", "x,0,1", "0,0,1"], 7)).t, [140_000_000, 180_000_000]
    )


def settled(header: str, *table: Any) -> tuple[Columns, str]:
    """Columns with all units, and what was assumed."""
    found, notices = columns(header).settled(rows(header, *table))
    return found, "; ".join(notices)


def rows(header: str, *table: Any) -> Rows:
    lines = [",".join(f"{value:.9g}" for value in row) for row in np.column_stack(table)]
    return columns(header).parse(lines)


I = np.arange(200.0)  # noqa: E741
STEPPING = np.column_stack((0.1 * np.sin(I / 5), 0.0 * I, 1.0 + 0.3 * np.sin(I / 4)))  # g
TURNING = np.column_stack((0.3 * np.sin(I / 9), 0.0 * I, 0.0 * I))  # rad/s


@pytest.mark.parametrize(
    ("norm", "factor", "unit"), [(0.301, G, "g"), (2.99, G, "g"), (3.01, 1.0, "m/s²"), (29.9, 1.0, "m/s²")]
)
def test_acceleration_below_three_is_in_g(norm: float, factor: float, unit: str) -> None:
    found, said = settled("t_ms,ax,ay,az", 20 * I, STEPPING / np.median(np.linalg.norm(STEPPING, axis=1)) * norm)
    assert found.scale["acc"] == factor
    assert said == f"ax has no unit in its name: median norm {norm:.3g}, taken as {unit}"


@pytest.mark.parametrize("norm", [0.299, 30.1, 980.0])
def test_acceleration_that_is_neither_is_refused(norm: float) -> None:
    with pytest.raises(DataError, match="neither g nor m/s²; put the unit into the header"):
        settled("t_ms,ax,ay,az", 20 * I, STEPPING / np.median(np.linalg.norm(STEPPING, axis=1)) * norm)


@pytest.mark.parametrize(("fast", "unit"), [(9.9, "rad/s"), (10.1, "°/s")])
def test_who_turns_by_ten_does_so_in_degrees(fast: float, unit: str) -> None:
    gyro = TURNING / np.percentile(np.abs(TURNING[:, 0]), 90) * fast
    found, said = settled("t_ms,ax_g,ay_g,az_g,gx,gy,gz", 20 * I, STEPPING, gyro)
    assert found.scale["gyro"] == (1.0 if unit == "rad/s" else pytest.approx(DEG))
    assert said == f"gx has no unit in its name: a tenth of the norms above {fast:.3g}, taken as {unit}"


@pytest.mark.parametrize(("spread_m_s2", "unit"), [(0.98, "°/s"), (1.02, "rad/s")])
def test_at_rest_degrees_are_likelier(spread_m_s2: float, unit: str) -> None:
    """Of the norms of acceleration the middle half is spread by a metre per second squared."""
    acc = np.column_stack((0.0 * I, 0.0 * I, 9.8 + np.linspace(-1.0, 1.0, 200) * spread_m_s2))
    found, said = settled("t_ms,ax_ms2,ay_ms2,az_ms2,gx,gy,gz", 20 * I, acc, TURNING)
    assert said.endswith(f"taken as {unit}")
    assert (found.scale["gyro"] == 1.0) == (unit == "rad/s")
    in_g, _ = settled("t_ms,ax_g,ay_g,az_g,gx,gy,gz", 20 * I, acc / G, TURNING)
    assert in_g.scale["gyro"] == found.scale["gyro"]


@pytest.mark.parametrize(
    ("norm", "factor", "unit"),
    [
        (0.099, 50.0 / 0.099, "raw counts, scaled to a median of 50 µT"),
        (0.101, 100.0, "gauss"),
        (1.49, 100.0, "gauss"),
        (1.51, 50.0 / 1.51, "raw counts, scaled to a median of 50 µT"),
        (7.9, 50.0 / 7.9, "raw counts, scaled to a median of 50 µT"),
        (8.1, 1.0, "µT"),
        (159.0, 1.0, "µT"),
        (161.0, 50.0 / 161.0, "raw counts, scaled to a median of 50 µT"),
    ],
)
def test_the_magnetic_field_is_that_of_the_earth(norm: float, factor: float, unit: str) -> None:
    mag = np.column_stack((0.0 * I, 0.6 * norm + 0.0 * I, 0.8 * norm + 0.0 * I))
    found, said = settled("t_ms,ax_g,ay_g,az_g,mx,my,mz", 20 * I, STEPPING, mag)
    assert found.scale["mag"] == pytest.approx(factor)
    assert said == f"mx has no unit in its name: median norm {norm:.3g}, taken as {unit}"


@pytest.mark.parametrize(
    ("value", "unit"),
    [
        (299.0, None),
        (301.0, "hPa"),
        (1199.0, "hPa"),
        (1201.0, None),
        (29_900.0, None),
        (30_100.0, "Pa"),
        (119_900.0, "Pa"),
        (120_100.0, None),
        (29.9, None),
        (30.1, "kPa"),
        (119.0, "kPa"),
        (121.0, None),
    ],
)
def test_air_pressure_is_that_of_the_air(value: float, unit: str | None) -> None:
    found, said = settled("t_ms,ax_g,ay_g,az_g,p", 20 * I, STEPPING, value + 0.0 * I)
    assert found.scale.get("pressure") == (None if unit is None else {"hPa": 1.0, "Pa": 0.01, "kPa": 10.0}[unit])
    verdict = "which is no air pressure: not used" if unit is None else f"taken as {unit}"
    assert said == f"p has no unit in its name: median {value:.6g}, {verdict}"


@pytest.mark.parametrize(
    ("step", "unit", "scale"),
    [
        (0.62, "s", 1e9),
        (0.64, "ms", 1e6),
        (0.02, "s", 1e9),
        (20.0, "ms", 1e6),
        (620.0, "ms", 1e6),
        (640.0, "µs", 1e3),
        (620e3, "µs", 1e3),
        (640e3, "ns", 1.0),
        (20e9, "ns", 1.0),
        (1e-5, "s", 1e9),
    ],
)
def test_steps_of_time_are_nearest_to_fifty_a_second(step: float, unit: str, scale: float) -> None:
    """Between a second and a millisecond, √1000 times 1/50 s; there is nothing beyond seconds and nanoseconds."""
    found, said = settled("t,ax_g,ay_g,az_g", step * I, STEPPING)
    assert found.scale["time"] == pytest.approx(scale)
    assert said == f"t has no unit in its name: step {step:.4g}, taken as {unit}"


def test_a_clock_in_whole_seconds_is_one_in_seconds() -> None:
    found, said = settled("t,ax_g,ay_g,az_g", np.floor(I / 50), STEPPING)
    assert found.scale["time"] == 1e9
    assert "taken as s" in said
    assert settled("t,ax_g,ay_g,az_g", 0.0 * I, STEPPING)[0].scale["time"] == 1e6  # it stands still: milliseconds


def test_what_names_tell_is_not_judged() -> None:
    found, said = settled(CANONICAL.rpartition(",temp")[0], 20 * I, STEPPING * 9, TURNING, STEPPING, 5.0 + 0.0 * I)
    assert said == ""
    assert (found.scale["acc"], found.scale["gyro"], found.scale["mag"], found.scale["pressure"]) == (G, DEG, 1.0, 1.0)


def test_a_row_that_no_sensor_can_give_is_dropped_whole() -> None:
    found = columns("t_s,ax_ms2,ay_ms2,az_ms2,gx_rads,gy_rads,gz_rads,event")
    lines = [
        "1,160,0,0,37,0,0,a",
        "2,160.1,0,0,0,0,0,b",
        "3,0,0,0,0,0,-37.1,c",
        "4e9,0,0,0,0,0,0,d",
        "4.1e9,0,0,0,0,0,0,e",
    ]
    kept = found.convert(found.parse([*lines, "6,,0,0,0,0,0,f"]))
    np.testing.assert_array_equal(kept.t, [10**9, 4 * 10**18, 6 * 10**9])
    assert kept.events == [(0, "a"), (1, "d"), (2, "f")]
    assert kept.counts == {"rows_impossible": 3}
    np.testing.assert_array_equal(kept.values["acc"][:, 0], [160.0, 0.0, math.nan])


@pytest.mark.parametrize("count", [40, 400])
def test_lines_with_the_wrong_fields_are_counted(count: int) -> None:
    """Few lines and many are parsed by different means."""
    found = columns("t_ms,ax_g,ay_g,az_g,event")
    good = [f"{20 * i},0.5,,-1e-1,{'x' if i == 7 else ''}" for i in range(count)]
    bad = ["1,2,3", "1,2,3,4,5,6", "a,1,2,3,", "1,b,2,3,", "1,1_0,2,3,", ",1,2,3,", "nan,1,2,3,"]
    parsed = found.parse([*good[:20], *bad, *good[20:]])
    assert parsed.counts == {"lines_unreadable": len(bad)}
    np.testing.assert_array_equal(parsed.t, 20 * np.arange(count))
    np.testing.assert_array_equal(parsed.values["acc"], [[0.5, math.nan, -0.1]] * count)
    assert parsed.events == [(7, "x")]
    short = [line.rpartition(",")[0] for line in good]  # the event may be left out
    assert found.parse(short).counts == {}


@pytest.mark.parametrize("count", [4, 400])
def test_integer_times_are_exact(count: int) -> None:
    found = columns("t_ns,ax_g,ay_g,az_g")
    first = 1_574_572_467_406_123_457
    np.testing.assert_array_equal(found.parse([f"{first + i},0,0,1" for i in range(count)]).t, first + np.arange(count))
    mixed = found.parse(
        [f"{first + i},0,0,1" for i in range(count)] + ["x,0,0,1", f"{2**62},0,0,1", f"{2**62 - 1},0,0,1"]
    )
    np.testing.assert_array_equal(mixed.t[:count], first + np.arange(count))
    assert mixed.counts == {"lines_unreadable": 2}


def test_canonical_rows_are_known_by_their_fields() -> None:
    row = "10250,0.012,-0.034,0.998,1.22,-0.61,0.31,21.4,-3.2,-40.1,1013.25"
    for line, names in ((row, 11), (f"{row},31.5", 12), (f"{row},button", 12), (f"{row},31.5,button", 13)):
        found = Columns.assumed(line)
        assert found is not None
        assert len(found.names) == names
        assert ("event" in found.where) == ("button" in line)
    for wrong in (
        row.rpartition(",")[0],
        f"{row},1,2,3",
        row.replace("10250", "1.5"),
        row.replace("0.998", ""),
        row.replace("1013.25", "299.9"),
        row.replace("21.4", "x"),
    ):
        assert Columns.assumed(wrong) is None
    assert Columns.assumed(row.replace("1013.25", "300")) is not None
    assert Columns.assumed(row.replace("1013.25", "")) is not None
