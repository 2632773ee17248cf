"""What tells the time of rows, and the nanoseconds that come of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.tables_by_hand import table_of

from fbgraph.columns.clock_times import Clock, RunningClock, clock_ns
from fbgraph.columns.clocks import find_clock
from fbgraph.columns.column_names import guess_columns
from fbgraph.columns.tick_counts import unwrapped
from fbgraph.columns.time_texts import stamps_ns
from fbgraph.core.errors import DataError
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.tables.table import Table

AXES = "ax;ay;az;gx;gy;gz"
MS = np.round(np.cumsum(np.random.default_rng(3).normal(20, 2, 300))).astype(np.int64)
"""Milliseconds of a logger at 50 Hz."""


def walk(**clocks: Any) -> Table:
    return table_of([*clocks, *AXES.split(";")], clocks)


def found(table: Table, rate_hz: float | None = None) -> Clock:
    return find_clock(table, guess_columns(table), rate_hz)


def ms_of(table: Table) -> NDArray[Any]:
    """Milliseconds since the first row."""
    t_ns = clock_ns(table, found(table))
    return np.asarray((t_ns - t_ns[0]) / 1e6)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("t_ms", MS),
        ("t_us", MS * 1000),
        ("t_s", MS / 1000),
        ("timestamp", 1_730_000_000_000 + MS),
        ("timestamp", 1_730_000_000_000_000 + MS * 1000),
        ("time", 1_730_000_000_000_000_000 + MS * 1_000_000),
        ("time", 1_730_000_000.0 + MS / 1000),
        ("time", MS),
        ("time", MS * 1000),
        ("time", MS / 1000),
        ("time", MS * 1_000_000),
        ("timestamp_ms", MS * 1000),  # a wrong unit in its name
        ("GPST", 390_884.0 + MS / 1000),
        ("datenum", 739_560.5 + MS / 86_400_000),
        ("t_us", (2**32 - 3_000_000 + MS * 1000) % 2**32),
        ("t_ms", (60_000 + MS) % 2**16),
        ("t_us", (2**31 - 3_000_000 + MS * 1000 + 2**31) % 2**32 - 2**31),  # signed
        ("t_s", ((2**32 - 3_000_000 + MS * 1000) % 2**32) / 1e6),
        ("tow", (604_798.0 + MS / 1000) % 604_800),
    ],
)
def test_numbers_of_any_tick(name: str, values: NDArray[Any]) -> None:
    name = "time" if name == "datenum" else name
    np.testing.assert_allclose(ms_of(walk(**{name: values})), MS - MS[0], atol=0.02)


def test_what_a_name_leaves_open_is_said() -> None:
    assert found(walk(t_ms=MS)).text == ""
    assert "no unit" in found(walk(time=MS)).text
    assert "taken as µs" in found(walk(timestamp_ms=MS * 1000)).text
    assert "begins again after 65536" in found(walk(t_ms=(60_000 + MS) % 2**16)).text


def test_nanoseconds_stay_whole() -> None:
    t = 1_730_000_000_000_000_001 + MS * 1_000_000
    assert clock_ns(walk(time=t), found(walk(time=t))).tolist() == t.tolist()


def test_a_tenth_of_a_millisecond_by_the_app() -> None:
    table = table_of("PacketCounter;SampleTimeFine;Acc_X;Acc_Y;Acc_Z", {"SampleTimeFine": MS * 10})
    np.testing.assert_array_equal(ms_of(table), MS - MS[0])
    dot = table_of("PacketCounter;SampleTimeFine;Acc_X;Acc_Y;Acc_Z", {"SampleTimeFine": MS * 1000})
    np.testing.assert_array_equal(ms_of(dot), MS - MS[0])


def text(form: str, start: str = "2024-11-05T13:59:58.000") -> list[str]:
    from datetime import datetime, timedelta

    times = [datetime.fromisoformat(start) + timedelta(milliseconds=int(ms)) for ms in MS]
    return [time.strftime(form).replace("%L", f"{time.microsecond // 1000:03d}") for time in times]


@pytest.mark.parametrize(
    "form",
    [
        "%Y-%m-%dT%H:%M:%S.%L",
        "%Y-%m-%dT%H:%M:%S.%L+01:00",
        "%Y-%m-%d %H:%M:%S.%LZ",
        "%d.%m.%Y %H:%M:%S,%L",
        "%m/%d/%Y %I:%M:%S.%L %p",
        "%d-%b-%Y %H:%M:%S.%L",
        "%Y-%m-%d %H:%M:%S:%L",
        "%Y-%m-%d %H-%M-%S_%L",
        "%H:%M:%S.%L",
        "%H:%M:%S,%L",
        "%I:%M:%S.%L %p",
        "%M:%S.%L",  # as a spreadsheet shows it
    ],
)
@pytest.mark.parametrize("start", ["2024-11-05T13:59:58.000", "2024-11-30T23:59:58.000"])
def test_texts(form: str, start: str) -> None:
    np.testing.assert_allclose(ms_of(walk(time=text(form, start))), MS - MS[0], atol=1e-6)


def test_zones_are_counted() -> None:
    with_zone = np.array(["2024-11-05T13:59:50.010+01:00", "2024-11-05 12:59:50.010Z", None, "soon"], dtype=object)
    read = stamps_ns(with_zone)
    assert read[0] == read[1] == 1_730_811_590_010_000_000
    assert read[2] == read[3] < -MAX_T_NS
    odd = stamps_ns(np.array(["05.11.2024 13:59:50,010 +0100"], dtype=object))
    assert odd[0] == read[0]


def test_a_date_beside_a_time_of_day() -> None:
    table = walk(Date=text("%Y-%m-%d", "2024-11-30T23:59:58"), Time=text("%H:%M:%S.%L", "2024-11-30T23:59:58"))
    clock = found(table)
    assert clock.kind == "date_and_time"
    t_ns = clock_ns(table, clock)
    np.testing.assert_array_equal((t_ns - t_ns[0]) // 1_000_000, MS - MS[0])
    assert t_ns[0] // 86_400_000_000_000 == 20057  # days from 1970 to 30 November 2024


def test_a_fine_number_goes_before_a_text_and_a_sensor_s_own_stamp_before_the_recorder_s() -> None:
    assert found(walk(timestamp=text("%Y-%m-%dT%H:%M:%S.%L"), t_ms=MS)).columns == (1,)
    assert found(walk(date=text("%H:%M:%S"), micros=MS * 1000)).columns == (1,)
    ns = 1_730_000_000_000_000_000 + MS * 1_000_000
    names = ["%time", "field.header.stamp", *(f"field.linear_acceleration.{a}" for a in "xyz")]
    names += [f"field.angular_velocity.{a}" for a in "xyz"]
    assert found(table_of(names, {"%time": ns, "field.header.stamp": ns})).columns == (1,)


def test_whole_seconds_are_spread() -> None:
    seconds = np.arange(10.35, 20.0, 0.02)
    table = walk(time=np.floor(seconds).astype(np.int64))
    np.testing.assert_allclose(clock_ns(table, found(table)) * 1e-9, seconds, atol=0.011)
    stamped = walk(time=[f"13:00:{int(s)}" for s in seconds])
    assert "show the same time" in found(stamped).text
    np.testing.assert_allclose(clock_ns(stamped, found(stamped)) * 1e-9 - 46_800, seconds, atol=0.011)


def test_rows_out_of_order_keep_their_times() -> None:
    order = np.arange(300).reshape(-1, 4)[:, [3, 0, 1, 2]].ravel()
    table = walk(time=1_730_000_000_000_000_000 + MS[order] * 1_000_000)
    np.testing.assert_array_equal(clock_ns(table, found(table)) // 1_000_000 - 1_730_000_000_000, MS[order])


@pytest.mark.parametrize("huge", [1e308, -1e308])
def test_a_tick_that_a_garbled_line_made_huge_is_no_wrap(huge: float) -> None:
    ticks = np.arange(200.0)
    ticks[[50, 51]] = huge, -huge
    with np.errstate(all="raise"):
        same, span = unwrapped(ticks, (2.0**16,))
    assert span == 0.0
    np.testing.assert_array_equal(same, ticks)


def test_a_restart_is_no_wrap() -> None:
    t = np.concatenate((MS, MS))
    clock = found(walk(t_ms=t))
    assert clock.wrap == 0
    assert clock_ns(walk(t_ms=t), clock)[300] == MS[0] * 1_000_000


def test_empty_times_are_no_times() -> None:
    t = MS.astype(float)
    t[7] = np.nan
    t_ns = clock_ns(walk(t_ms=t), found(walk(t_ms=t)))
    assert abs(t_ns[7]) > MAX_T_NS
    assert t_ns[8] == MS[8] * 1_000_000


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"timestamp_ms": np.full(300, 1.73e12)}, "spreadsheet"),
        ({"timestamp_ms": np.round((1.73e12 + MS) / 1e6) * 1e6}, "spreadsheet"),
        ({"time": np.arange(300)}, "like a counter"),
        ({"time": np.full(300, 5.0)}, "always"),
        ({"time": np.random.default_rng(0).normal(size=300)}, "(does not grow|goes backwards) from row to row"),
        ({"time": ["########"] * 300}, "no times that can be read"),
        ({"t_ms": np.arange(300) * 3_333_333.0 % 77_777_777}, "does not grow"),
        ({"foo": MS}, "grows like a clock"),
    ],
)
def test_a_clock_that_cannot_be_read_is_named_and_no_rate_assumed(columns: dict[str, Any], message: str) -> None:
    table = walk(**columns)
    with pytest.raises(DataError, match=message) as error:
        found(table)
    assert next(iter(columns)) in str(error.value)
    assert "walk.csv" in str(error.value)
    assert found(table, rate_hz=25.0).tick_ns == 40_000_000


def test_without_a_clock_a_rate_is_assumed_and_said() -> None:
    clock = found(walk())
    assert (clock.kind, clock.columns, clock.tick_ns) == ("samples", (), 20_000_000)
    assert "50 Hz assumed" in clock.text
    counted = walk(n=np.r_[0:100, 110:310])
    assert found(counted).columns == (0,)
    assert clock_ns(counted, found(counted))[100] == 110 * 20_000_000


def test_a_counter_of_sixteen_bits_goes_on() -> None:
    counted = walk(n=(65_500 + np.arange(300)) % 2**16)
    t_ns = clock_ns(counted, found(counted, 100.0))
    assert set(np.diff(t_ns).tolist()) == {10_000_000}


def test_labels_beside_give_the_rate_of_samples() -> None:
    labels = {"StartSampleID": np.arange(60) * 45, "Hour": np.full(60, 11), "Min": np.full(60, 20)}
    beside = table_of("StartSampleID;Hour;Min;Sec", labels | {"Sec": np.arange(60)}, name="labels")
    table = table_of(f"SampleID;{AXES}", {"SampleID": np.arange(500)})
    clock = find_clock(table, guess_columns(table), labels=[beside])
    assert clock.tick_ns == pytest.approx(1e9 / 45)
    assert "45 Hz by the labels" in clock.text


@pytest.mark.parametrize("size", [1, 7, 50])
@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("t_us", (2**32 - 3_000_000 + MS * 1000) % 2**32),
        ("t_ms", (60_000 + MS) % 2**16),
        ("t_ms", MS),
        ("time", text("%H:%M:%S.%L", "2024-11-30T23:59:58.000")),
        ("time", text("%Y-%m-%d %H:%M:%S.%L")),
        ("n", (65_500 + np.arange(300)) % 2**16),
    ],
)
def test_rows_a_few_at_a_time_have_the_same_times(name: str, values: Any, size: int) -> None:
    whole = walk(**{name: values})
    clock = found(whole, 100.0 if name == "n" else None)
    running = RunningClock(clock)
    pieces = [
        running.ns(walk(**{name: np.asarray(whole.columns[0].values[at : at + size])})) for at in range(0, 300, size)
    ]
    np.testing.assert_array_equal(np.concatenate(pieces), clock_ns(whole, clock))
