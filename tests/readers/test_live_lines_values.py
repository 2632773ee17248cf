"""Lines as they arrive: clocks that restart, jump, stand still, and each limit on both of its sides."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.readers.cleaning import are_repeated
from fbgraph.readers.layout import ClockLayout, Layout, StreamLayout
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.raw_recorder import cut_torn_line, saved_lines, saved_log

HEADER = "t_ms,ax_ms2,ay_ms2,az_ms2,gx_rads,gy_rads,gz_rads,mx_ut,my_ut,mz_ut,p_hpa,event"
LAYOUT = Layout(
    acc=StreamLayout(columns=("ax_ms2", "ay_ms2", "az_ms2"), scale=1.0),
    gyro=StreamLayout(columns=("gx_rads", "gy_rads", "gz_rads"), scale=1.0),
    mag=StreamLayout(columns=("mx_ut", "my_ut", "mz_ut"), scale=1.0, repeats=False),
    pressure=StreamLayout(columns=("p_hpa",), scale=1.0, repeats=True),
    event=("*", "event"),
    clocks=(ClockLayout(columns=("t_ms",), tick_ns=1e6),),
)
USUAL = [5000 + 20 * i for i in range(120)]  # more than are looked at before anything is delivered


def row(t_ms: object, i: int = 0, pressure: object = "", event: str = "", mag: str = "1,2,3") -> str:
    return f"{t_ms},0.1,0.2,9.{i % 10},0.3,0.4,0.5,{mag},{pressure},{event}"


def delivered(reader: LiveReader, times_ms: Sequence[int], finish: bool = False) -> list[int]:
    """Push these times; return those of the samples that come back, on the device's clock in ms."""
    logs = [reader.push([row(t_ms, i) for i, t_ms in enumerate(times_ms)])]
    logs += [reader.finish()] if finish else []
    return [round((t_s + reader.t0_s) * 1000) for log in logs for t_s in log.acc.t_s.tolist()]


def begun() -> LiveReader:
    """A reader that has seen 120 rows up to 7380 ms."""
    reader = LiveReader(layout=LAYOUT)
    reader.push([HEADER])
    assert delivered(reader, USUAL) == USUAL
    return reader


def test_nothing_is_delivered_before_a_hundred_lines() -> None:
    reader = LiveReader("walk", LAYOUT)
    assert len(reader.push([HEADER, "# comment", "", *[row(20 * i) for i in range(97)]]).acc) == 0
    assert reader.t0_s == 0.0
    log = reader.push([row(1940)])
    assert len(log.acc) == 98
    assert reader.counts["lines"] == 101
    assert (log.name, log.format) == ("walk", "m5stickc")


def test_a_short_walk_comes_when_it_ends() -> None:
    reader = LiveReader(layout=LAYOUT)
    reader.push([HEADER, *[row(20 * i) for i in range(30)]])
    assert len(reader.finish().acc) == 30


def test_a_header_comes_after_a_thousand_lines_at_the_latest_or_more_are_let_go() -> None:
    for noise in (49, 100, 1000, 20_000):
        reader = LiveReader("walk", LAYOUT)
        log = reader.push(["boot"] * noise + [HEADER] + [row(20 * i) for i in range(400)])
        assert len(SensorLog.concatenate([log, reader.finish()]).acc) == 400
        assert reader.counts["lines_before_header"] == noise
    for noise in (50, 5000):
        reader = LiveReader("walk", LAYOUT)
        reader.push(["boot"] * noise)
        with pytest.raises(DataError, match="walk: no line names accelerometer columns"):
            reader.finish()


def test_days_of_junk_and_of_endless_lines_are_not_kept() -> None:
    reader = LiveReader()
    for _ in range(40):
        reader.push(["GET / HTTP/1.1", "1,2,3", "x" * 60_000] * 100)
        assert len(reader._waiting) < 5000
        assert sum(map(len, reader._waiting)) < 1 << 26
    assert reader.undecided.startswith("no header names the columns")


def test_time_begins_with_the_first_sample() -> None:
    reader = LiveReader(layout=LAYOUT)
    log = reader.push([HEADER + "\r\n", *[row(t_ms, event="go" if t_ms == 5100 else "") + "\r\n" for t_ms in USUAL]])
    assert (reader.t0_s, log.t0_s) == (5.0, 5.0)
    np.testing.assert_allclose(log.acc.t_s, 0.02 * np.arange(120), atol=1e-12)
    assert [(event.t_s, event.label) for event in log.events] == [(0.1, "go")]
    np.testing.assert_array_equal(log.gyro.values[0], [0.3, 0.4, 0.5])
    np.testing.assert_array_equal(log.mag.values[0], [1.0, 2.0, 3.0])


def test_rows_that_are_not_later_are_dropped_up_to_a_second_back() -> None:
    reader = begun()
    assert delivered(reader, [7380, 7370, 6380, 7400]) == [7400]
    assert reader.counts["rows_not_later"] == 3
    assert delivered(reader, [6399]) == []  # more than a second: held until others follow it
    assert reader.counts["rows_not_later"] == 3
    assert delivered(reader, [7420]) == [7420]
    assert reader.counts["rows_odd_time"] == 1


def test_a_restarted_clock_goes_on_ten_milliseconds_later_after_three_rows() -> None:
    reader = begun()
    assert delivered(reader, [100, 120]) == []
    assert delivered(reader, [140]) == [7390, 7410, 7430]
    assert reader.counts["clock_restarts"] == 1
    assert delivered(reader, [160, 180]) == [7450, 7470]
    delivered(reader, range(200, 2000, 20))
    assert delivered(reader, [7, 27, 47]) == [9280, 9300, 9320]  # once more, from 9270
    assert reader.counts["clock_restarts"] == 2
    assert reader.counts["rows_odd_time"] == reader.counts["silences"] == 0


def test_five_seconds_ahead_are_believed_at_once_and_more_after_three_rows() -> None:
    reader = begun()
    assert delivered(reader, [12380]) == [12380]
    assert delivered(reader, [17381, 17401]) == []
    assert delivered(reader, [17421]) == [17381, 17401, 17421]
    assert reader.counts["silences"] == 1
    assert reader.counts["clock_restarts"] == 0


def test_an_odd_time_is_given_up_when_time_goes_on_without_it() -> None:
    reader = begun()
    assert delivered(reader, [99999, 7400, 7420, 1, 2, 7440]) == [7400, 7420, 7440]
    assert reader.counts["rows_odd_time"] == 3


def test_odd_times_that_do_not_follow_each_other_are_given_up() -> None:
    reader = begun()
    assert delivered(reader, [100, 120, 120]) == []  # not later
    assert delivered(reader, [5200, 130]) == []  # more than five seconds ahead, then back
    assert reader.counts["rows_odd_time"] == 4
    assert delivered(reader, [5130]) == []
    assert delivered(reader, [5150]) == [7390, 12390, 12410]
    assert delivered(reader, [1], finish=True) == []
    assert reader.counts["rows_odd_time"] == 5


def test_how_lines_are_cut_makes_no_difference() -> None:
    times = [*USUAL, 99999, 7400, 100, 120, 140, 160, 90000, 90020, 90040, 90060, 90060, 90080]
    whole = LiveReader(layout=LAYOUT)
    whole.push([HEADER])
    expected = delivered(whole, times, finish=True)
    for size in (1, 7):
        reader = LiveReader(layout=LAYOUT)
        reader.push([HEADER])
        found = [t for at in range(0, len(times), size) for t in delivered(reader, times[at : at + size])]
        assert found + delivered(reader, [], finish=True) == expected
        assert reader.counts == whole.counts


def with_pressure(values: Sequence[object], rest: Sequence[object] = ()) -> tuple[list[float], LiveReader]:
    """Times, in rows, of the pressures delivered; some of them in a second piece."""
    reader = LiveReader(layout=LAYOUT)
    rows = [row(20 * i, i, value) for i, value in enumerate([*values, *rest])]
    logs = [reader.push([HEADER, *rows[: len(values)]]), reader.push(rows[len(values) :]), reader.finish()]
    return [round(t_s / 0.02) for log in logs for t_s in log.pressure.t_s.tolist()], reader


def test_a_barometer_that_repeats_its_last_value_says_it_once_and_once_a_second() -> None:
    often = [1000.0 + i // 4 for i in range(120)]
    once = sorted({*range(0, 120, 4), 50, 100})
    assert with_pressure(often)[0] == once
    assert with_pressure(often, [1029.0, 1029.0, 1030.0, 1030.0, 1029.0])[0] == [*once, 122, 124]


def test_half_of_the_values_must_repeat() -> None:
    for distinct, repeated in ((60, True), (61, False)):
        assert are_repeated(np.minimum(np.arange(120), distinct - 1)[:, None]) is repeated


def test_what_no_sensor_can_say_is_not_delivered() -> None:
    values: list[object] = [1000.0 + i for i in range(100)] + [300.0, 299.9, 1200.0, 1200.1, -500.0, "", "nan"]
    assert with_pressure(values)[0] == [*range(100), 100, 102]
    reader = LiveReader(layout=LAYOUT)
    mags = ["5000,1,2", "5001,1,2", "1,-5000.1,2", "1,2,", "1,2,3"]
    lines = [HEADER, *[row(20 * i, i, mag=f"1,2,{i}") for i in range(100)]]
    log = SensorLog.concatenate(
        [reader.push(lines), reader.push([row(2000 + 20 * i, i, mag=mag) for i, mag in enumerate(mags)])]
    )
    assert [round(t_s / 0.02) for t_s in log.mag.t_s.tolist()] == [*range(100), 100, 104]
    assert len(log.acc) == 105


def test_bad_lines_are_counted() -> None:
    reader = begun()
    reader.push(["1,2,3", row("x"), row(7400).replace("9.0", "161")])
    assert reader.counts["lines_unreadable"] == 1
    assert reader.counts["rows_impossible"] == 2


def test_a_sample_counter_goes_on_over_pieces() -> None:
    counted = LAYOUT.model_copy(update={"clocks": (ClockLayout(kind="samples", tick_ns=2e7),)})
    reader = LiveReader(layout=counted)
    lines = [row("", i) for i in range(130)]
    parts = [reader.push([HEADER, *lines[:110]]), reader.push(lines[110:])]
    np.testing.assert_allclose(SensorLog.concatenate(parts).acc.t_s, 0.02 * np.arange(130), atol=1e-9)


def raw_file(folder: Path, text: str) -> Path:
    path = folder / "run" / "raw.csv"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(text.encode("latin-1"))
    return path


def test_saved_lines_are_read_back_as_they_came(tmp_path: Path) -> None:
    rows = [HEADER, *[row(t_ms, i, 1000.0 + i) for i, t_ms in enumerate(USUAL)]]
    path = raw_file(tmp_path, "\n".join([*rows, row(100), row(120), row(140)]) + "\n" + row(160))
    log = saved_log(path, LAYOUT)
    assert (log.name, log.format, log.t0_s, len(log.acc)) == ("run", "m5stickc", 5.0, 123)
    assert log.counts == {"lines": 124, "clock_restarts": 1}
    assert log.notices == ()
    assert [line for lines in saved_lines(path) for line in lines] == [*rows, row(100), row(120), row(140)]


def test_saved_lines_without_sensors_say_so(tmp_path: Path) -> None:
    told = LAYOUT.model_copy(update={"mag": None, "pressure": None, "event": None})
    header, rows = HEADER.split(",mx")[0], [",".join(row(t_ms, i).split(",")[:7]) for i, t_ms in enumerate(USUAL)]
    assert saved_log(raw_file(tmp_path, "\n".join([header, *rows]) + "\n"), told).notices == (
        "no magnetometer: heading rests on the gyroscope alone and its start is arbitrary",
        "no barometer: altitude stays at 0",
    )
    for count, usable in ((2, True), (1, False)):
        path = raw_file(tmp_path, "\n".join([header, *rows[:count]]) + "\n")
        if usable:
            assert len(saved_log(path, told).acc) == 2
        else:
            with pytest.raises(DataError, match="no rows of numbers under the header"):
                saved_log(path, told)


@pytest.mark.parametrize(
    ("before", "after"),
    [("a\nb\nc", "a\nb\n"), ("a\nb\n", "a\nb\n"), ("abc", ""), ("", ""), ("a\n" + "x" * 70_000, "a\n")],
)
def test_a_torn_line_is_cut_off(tmp_path: Path, before: str, after: str) -> None:
    path = raw_file(tmp_path, before)
    cut_torn_line(path)
    assert path.read_text() == after


def test_a_torn_line_that_cannot_be_cut_off_is_told(tmp_path: Path) -> None:
    (tmp_path / "raw.csv").mkdir()
    with pytest.raises(ConfigError, match=r"raw\.csv: cannot write there: Is a directory"):
        cut_torn_line(tmp_path / "raw.csv")
