"""Cleaning of samples: each limit held by a value on either side of it."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from support.waves import waves

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.nanoseconds import MAX_T_NS, to_ns
from fbgraph.core.sensor_log import SensorLog
from fbgraph.readers.cleaning import LIMITS, RawLog, RawStream, assemble, drop_repeats, log_name
from fbgraph.tables.log_text import log_text

S = 1_000_000_000
N = 500
ACC, GYRO, MAG = waves(N)
PRESSURE = (1000.0 + 0.1 * np.sin(np.arange(N) / 9.0))[:, None]
T_NS: IntArray = 100 * S + np.arange(N) * 20_000_000  # 50 Hz, from 100 s


def cleaned(t_ns: Any = T_NS, events: Any = (), **values: Any) -> SensorLog:
    """A walk of four sensors on one clock, some with other values or as streams of their own, or left out."""
    usual = {"acc": ACC, "gyro": GYRO, "mag": MAG, "pressure": PRESSURE} | values
    streams = {
        name: value if isinstance(value, RawStream) else RawStream(t_ns, value)
        for name, value in usual.items()
        if value is not None
    }
    return assemble(RawLog(streams, list(events)), Path("walk.csv"), "test").log


def changed(values: npt.NDArray[Any], at: Any, value: Any) -> npt.NDArray[Any]:
    values = values.copy()
    values[at] = value
    return values


def moved(by_s: float, rows: slice) -> IntArray:
    """The clock with some rows later, or earlier."""
    t_ns = T_NS.copy()
    t_ns[rows] += round(by_s * S)
    return t_ns


@pytest.mark.parametrize(("name", "limit"), [("acc", 160.0), ("gyro", 37.0), ("mag", 5000.0)])
def test_a_component_beyond_what_the_sensor_can_say_is_dropped(name: str, limit: float) -> None:
    values = {"acc": ACC, "gyro": GYRO, "mag": MAG}[name]
    assert LIMITS[name] == limit
    for sign in (1.0, -1.0):
        assert cleaned(**{name: changed(values, (7, 1), sign * limit)}).counts == {}
        log = cleaned(**{name: changed(values, (7, 1), sign * limit * 1.001)})
        assert log.counts == {f"{name}_out_of_range": 1}
        assert len(getattr(log, name)) == N - 1
        assert 0.14 not in getattr(log, name).t_s


def test_air_pressure_is_between_300_and_1200() -> None:
    for hpa, dropped in ((300.0, 0), (299.9, 1), (1200.0, 0), (1200.1, 1), (-1000.0, 1)):
        assert cleaned(pressure=changed(PRESSURE, 9, hpa)).counts.get("pressure_out_of_range", 0) == dropped


def test_what_is_not_finite_is_dropped_once() -> None:
    log = cleaned(acc=changed(changed(ACC, (3, 0), np.nan), (4, slice(0, 2)), np.inf))
    assert log.counts == {"acc_not_finite": 2}


def test_times_that_no_clock_shows_are_dropped() -> None:
    acc = RawStream(changed(T_NS, [3, 4], [MAX_T_NS + 1, -MAX_T_NS - 1]), changed(ACC, (3, 0), np.nan))
    assert cleaned(acc=acc).counts == {"acc_not_finite": 1, "acc_impossible_time": 1}
    late = MAX_T_NS - T_NS[-1]
    assert cleaned(T_NS + late).t0_s == pytest.approx((MAX_T_NS - 499 * 20_000_000) / 1e9)


def test_ticks_are_exact_where_they_can_be() -> None:
    assert to_ns(np.array([5, -7]), 1_000_000).tolist() == [5_000_000, -7_000_000]
    assert to_ns(np.array([1_574_572_467_406_123_457]), 1).tolist() == [1_574_572_467_406_123_457]
    assert to_ns(np.array([0.123456789, 2.5]), S).tolist() == [123_456_789, 2_500_000_000]
    assert to_ns(np.array([1_574_572_467.406123]), S).tolist() == [1_574_572_467_406_123_000]
    assert to_ns(np.array([4_503_599.123456789]), S).tolist() == [4_503_599_123_456_789]  # 2**52 ns: still exact
    assert to_ns(np.array([4_503_600.123456789]), S).tolist() == [4_503_600_123_457_000]
    assert to_ns(np.array([4e9, -4e9]), S).tolist() == [MAX_T_NS, -MAX_T_NS]
    assert to_ns(np.array([4.000001e9, -4.000001e9, np.nan, np.inf]), S).tolist() == [MAX_T_NS + 1] * 4


def test_a_sample_given_twice_is_kept_once() -> None:
    twice = np.repeat(np.arange(N), np.where(np.arange(N) == 10, 2, 1))
    log = cleaned(acc=RawStream(T_NS[twice], ACC[twice]))
    assert log.counts == {"acc_duplicate": 1}
    np.testing.assert_array_equal(log.acc.values, ACC)
    # the time of another with other values is not the same sample
    other = changed(ACC[twice], (11, 0), 5.0)
    assert cleaned(acc=RawStream(T_NS[twice], other)).counts == {"acc_time_shared": 1}


def test_samples_that_share_a_time_are_spread_over_the_step_before() -> None:
    t_ns = changed(T_NS, slice(20, 24), T_NS[23])  # four that came together
    log = cleaned(t_ns)
    assert log.counts == {f"{name}_time_shared": 3 for name in ("acc", "gyro", "mag", "pressure")}
    np.testing.assert_allclose(log.acc.t_s, 0.02 * np.arange(N), atol=1e-9)
    burst = changed(T_NS, slice(20, 24), T_NS[19] + 8_000_000)  # 8 ms after the one before: 2 ms each
    np.testing.assert_allclose(cleaned(burst).acc.t_s[20:24], 0.38 + 0.002 * np.arange(1.0, 5.0))


def test_nothing_is_spread_by_less_than_a_millisecond() -> None:
    for gap_ns, kept in ((4_000_000, 4), (3_999_999, 1)):
        log = cleaned(changed(T_NS, slice(20, 24), T_NS[19] + gap_ns))
        assert len(log.acc) == N - 4 + kept


def test_after_a_pause_samples_are_no_further_apart_than_usual() -> None:
    t_ns = moved(0.9, slice(20, None))
    t_ns[20:23] = t_ns[22]
    steps_s = np.diff(cleaned(t_ns).acc.t_s)[19:22]
    assert steps_s == pytest.approx([0.92, 0.02, 0.02])


def test_spread_samples_are_told_of_from_a_hundredth_on() -> None:
    for pairs, told in ((5, False), (6, True)):
        t_ns = T_NS.copy()
        t_ns[20 : 20 + 2 * pairs : 2] = t_ns[21 : 21 + 2 * pairs : 2]
        notices = cleaned(t_ns).notices
        text = f"{pairs} samples came with the time of another; spread over the step before"
        assert (text in notices) == told


def test_a_time_that_goes_back_costs_as_few_samples_as_possible() -> None:
    back = cleaned(moved(-0.5, slice(100, 103)))
    assert back.counts == {f"{name}_not_later": 3 for name in ("acc", "gyro", "mag", "pressure")}
    ahead = cleaned(moved(5.0, slice(100, 103)))
    assert ahead.counts == {f"{name}_not_later": 3 for name in ("acc", "gyro", "mag", "pressure")}
    np.testing.assert_allclose(ahead.acc.t_s, 0.02 * np.delete(np.arange(N), [100, 101, 102]), atol=1e-9)


def test_a_clock_that_mostly_runs_backwards_is_refused() -> None:
    sawtooth = 100 * S + (np.arange(N) % 3 * -7 + np.arange(N) // 3) * 10_000_000
    with pytest.raises(DataError, match=r"in most rows \(first at accelerometer sample 2\); check the time column"):
        cleaned(sawtooth)
    half = np.where(np.arange(N) // 5 % 2 == 0, T_NS, T_NS - 10 * S)  # every second handful is elsewhere
    assert cleaned(half).counts["acc_not_later"] == N // 2


def test_a_log_is_at_least_ten_samples_and_a_second_long() -> None:
    def part(count: int, step_ns: int) -> SensorLog:
        rows = slice(0, count)
        t_ns = 100 * S + np.arange(count, dtype=np.int64) * step_ns
        return cleaned(t_ns, acc=ACC[rows], gyro=GYRO[rows], mag=None, pressure=None)

    assert len(part(10, 112_000_000).acc) == 10
    with pytest.raises(DataError, match=r"only 9 accelerometer samples over 1.60 s"):
        part(9, 200_000_000)
    assert part(51, 20_000_000).duration_s == pytest.approx(1.0)
    with pytest.raises(DataError, match=r"only 50 accelerometer samples over 0.98 s"):
        part(50, 20_000_000)


def test_both_inertial_sensors_are_needed() -> None:
    for name, sensor in (("acc", "accelerometer"), ("gyro", "gyroscope")):
        with pytest.raises(DataError, match=rf"walk.csv: no usable {sensor} samples \(none in the file\)"):
            cleaned(**{name: None})
    with pytest.raises(DataError, match=r"no usable gyroscope samples \(500 gyro_out_of_range\)"):
        cleaned(gyro=GYRO + 100.0)


def test_the_median_acceleration_is_about_gravity() -> None:
    norm = float(np.median(np.linalg.norm(ACC, axis=1)))
    for low, high in ((2.99, 3.01), (30.01, 29.99)):
        assert len(cleaned(acc=ACC * high / norm).acc) == N
        with pytest.raises(DataError, match=rf"median magnitude is {low:.2f} m/s² where gravity alone is 9.8"):
            cleaned(acc=ACC * low / norm)


def test_an_inertial_sensor_changes_on_one_axis_at_least() -> None:
    still = np.tile([0.0, 0.0, 9.8], (N, 1))
    with pytest.raises(DataError, match="the accelerometer never changes"):
        cleaned(acc=still)
    assert len(cleaned(acc=changed(still, (7, 0), 0.1)).acc) == N
    text = "the gyroscope never changes: it was stuck or switched off, turns are not seen"
    assert cleaned(gyro=GYRO * 0.0).notices == (text,)
    assert cleaned(gyro=changed(GYRO * 0.0, (7, 1), 0.01)).notices == ()


def test_the_clock_begins_with_the_first_inertial_sample_and_events_are_on_it() -> None:
    gyro = RawStream(T_NS - S // 2, GYRO)
    end = int(T_NS[-1])
    events = [(end, "last"), (99 * S + S // 2, "first"), (99 * S, "before"), (end + 1, "after"), (101 * S, "b")]
    log = cleaned(gyro=gyro, events=events)
    assert log.t0_s == 99.5
    assert (log.acc.t_s[0], log.gyro.t_s[0], log.mag.t_s[0]) == (0.5, 0.0, 0.5)
    assert [(event.t_s, event.label) for event in log.events] == [(0.0, "first"), (1.5, "b"), (10.48, "last")]
    assert (log.name, log.format) == ("walk", "test")


def test_few_samples_far_from_all_others_are_stray() -> None:
    """Fewer than five, more than two seconds away."""
    for count, gap_s, kept in ((4, 2.1, False), (5, 2.1, True), (4, 1.9, True)):
        log = cleaned(moved(-gap_s, slice(0, count)))
        assert (len(log.acc) == N) == kept
        assert log.counts.get("acc_stray_time", 0) == (0 if kept else count)


def test_the_longest_piece_of_a_clock_that_was_set_is_kept() -> None:
    for gap_s, pieces in ((172_799.0, 1), (172_801.0, 2)):
        log = cleaned(moved(gap_s, slice(200, None)))
        assert log.counts.get("acc_stray_time", 0) == (200 if pieces == 2 else 0)
        text = "time jumps by more than 48 h; kept the longest of 2 pieces"
        assert (text in log.notices) == (pieces == 2)
    early = cleaned(moved(200_000.0, slice(300, None)))
    assert (early.t0_s, len(early.acc)) == (100.0, 300)


def test_other_sensors_may_begin_and_end_two_seconds_apart_from_the_accelerometer() -> None:
    inside = slice(200, 300)  # 4 s to 5.98 s of ten
    log = cleaned(acc=RawStream(T_NS[inside], ACC[inside]))
    assert log.counts == {f"{name}_stray_time": 200 for name in ("gyro", "mag", "pressure")}
    assert log.acc.t_s[0] == pytest.approx(2.0)
    assert log.gyro.t_s[-1] == pytest.approx(5.98)


def test_rates_below_twenty_a_second_are_told() -> None:
    for step_ms, told in ((49, False), (51, True)):
        notices = cleaned(100 * S + np.arange(N) * step_ms * 1_000_000).notices
        text = "the accelerometer runs at 19.6 Hz; steps need 20 Hz or more"
        assert (text in notices) == told
        assert not [notice for notice in notices if "gyroscope runs" in notice]  # the same times: said once
    slow = RawStream(100 * S + np.arange(200) * 50_500_000, GYRO[:200])
    assert "the gyroscope runs at 19.8 Hz; steps need 20 Hz or more" in cleaned(gyro=slow).notices


def test_gaps_of_more_than_a_second_are_told() -> None:
    t_ns = moved(0.97, slice(100, None))
    t_ns[200:] += round(0.99 * S)
    t_ns[300:] += round(1.48 * S)
    t_ns[400:] += S
    text = "3 gaps of more than 1 s in the accelerometer, the longest 1.5 s at 7.9 s"
    assert cleaned(t_ns).notices == (text,)
    assert cleaned(moved(0.979, slice(100, None))).notices == ()


def at_rail(values: FloatArray, axis: int, rail: float, count: int, near: int = 0) -> FloatArray:
    values = changed(values, (slice(50, 50 + count), axis), rail)
    values[100 : 100 + near, axis] = rail * 0.99 - np.arange(near) * 1e-6 * rail
    return values


@pytest.mark.parametrize(
    ("rail", "count", "near", "found"),
    [
        (4.36, 3, 0, 3),
        (4.36, 2, 0, 0),
        (4.19, 9, 0, 0),
        (4.21, 9, 0, 9),
        (8.7, 5, 5, 5),
        (8.7, 5, 6, 0),
        (-8.7, 4, 0, 4),
    ],
)
def test_a_full_scale_shows_as_an_extreme_that_repeats(rail: float, count: int, near: int, found: int) -> None:
    log = cleaned(gyro=at_rail(GYRO, 2, rail, count, near))
    assert log.counts.get("gyro_saturated", 0) == found
    degrees = np.degrees(abs(rail))
    text = f"{found} samples at the gyroscope's limit of {degrees:.4g} °/s: too little is seen"
    assert (text in log.notices) == (found > 0)


def test_the_accelerometers_narrowest_scale_is_two_g() -> None:
    for rail, found in ((18.4, 0), (18.6, 6)):
        log = cleaned(acc=at_rail(ACC, 0, rail, 6))
        assert log.counts.get("acc_saturated", 0) == found
        assert (f"6 samples at the accelerometer's limit of {rail:.4g} m/s²: too little is seen" in log.notices) == (
            found > 0
        )


def test_a_sensor_that_says_nothing_is_not_used() -> None:
    log = cleaned(mag=MAG * 0.0 + 3.0, pressure=RawStream(T_NS[:9], PRESSURE[:9]))
    assert log.notices == (
        "magnetometer not used, it has 500 samples or never changes: "
        "heading rests on the gyroscope alone and its start is arbitrary",
        "barometer not used, it has 9 samples or never changes: altitude stays at 0",
    )
    assert (len(log.mag), len(log.pressure)) == (0, 0)
    assert len(cleaned(pressure=RawStream(T_NS[:10], PRESSURE[:10])).pressure) == 10
    assert cleaned(mag=None, pressure=None).notices == (
        "no magnetometer: heading rests on the gyroscope alone and its start is arbitrary",
        "no barometer: altitude stays at 0",
    )


def test_repeats_go_where_most_samples_repeat() -> None:
    t_ns = np.arange(400) * 10_000_000
    polled = drop_repeats(RawStream(t_ns, np.floor(np.arange(400.0) / 4)[:, None]))
    np.testing.assert_array_equal(polled.t_ns, t_ns[::4])
    np.testing.assert_array_equal(polled.values[:, 0], np.arange(100.0))
    for every, kept in ((2, 200), (1, 400)):
        assert len(drop_repeats(RawStream(t_ns, np.floor(np.arange(400.0) / every)[:, None])).t_ns) == kept
    mostly = np.cumsum(np.arange(400) % 5 < 3).astype(np.float64)[:, None]  # three of five change
    assert len(drop_repeats(RawStream(t_ns, mostly)).t_ns) == 400
    constant = drop_repeats(RawStream(t_ns, np.ones((400, 1))))
    np.testing.assert_array_equal(constant.t_ns, [0, S, 2 * S, 3 * S])
    one_axis = np.column_stack((np.ones(400), np.floor(np.arange(400.0) / 100)))
    assert len(drop_repeats(RawStream(t_ns, one_axis)).t_ns) == 4


def test_logs_are_named_after_their_files() -> None:
    names = [log_name(Path(name)) for name in ("a/walk.csv", "walk.txt.gz", "walk", ".gz", "a.b.csv.gz")]
    assert names == ["walk", "walk", "walk", "walk", "a.b"]


def test_logs_may_be_packed(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes("a\r\nµ".encode("latin-1"))
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress("a\r\nµ".encode("latin-1")))
    for name in ("a.csv", "a.csv.gz"):
        assert log_text(tmp_path / name).pieces == (b"a\n", "µ".encode())
    (tmp_path / "b.gz").write_bytes(gzip.compress(b"x" * 9999)[:-9])
    for name, message in (("b.gz", "truncated or damaged"), ("c", "No such file"), (".", "is a directory")):
        with pytest.raises(DataError, match=message):
            log_text(tmp_path / name)
