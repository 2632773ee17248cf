"""Lines as devices really send them: in any pieces, in any writing, they are read as the file of them is."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.sensor_log import SensorLog
from fbgraph.readers import read_log
from fbgraph.readers.layout import keep_layout
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.raw_recorder import LineCutter, saved_log
from fbgraph.readers.sources import OneSender

Write = Callable[[list[list[str]]], list[str]]
_BOOT = ["rst:0x1 (POWERON_RESET),boot:0x13", "", "WiFi connected, 192.168.1.4", "ets Jul 29 2019"]


def _joined(rows: list[list[str]], separator: str = ",") -> list[str]:
    return [separator.join(row) for row in rows]


def _clocked(name: str, clock: Callable[[int], object]) -> Write:
    return lambda rows: _joined([[name, *rows[0][1:]], *[[str(clock(int(row[0]))), *row[1:]] for row in rows[1:]]])


def _time_of_day(t_ms: int) -> str:
    second = (t_ms // 1000 + 86_380) % 86_400  # midnight comes after fifteen seconds
    return f"{second // 3600:02d}:{second // 60 % 60:02d}:{second % 60:02d}"


def _emptied(first: int, columns: range) -> Write:
    return lambda rows: _joined(
        [["" if 0 < i < first and j in columns else field for j, field in enumerate(row)] for i, row in enumerate(rows)]
    )


def _with_headers(rows: list[list[str]], first: int) -> list[str]:
    header, *lines = _joined(rows)
    return [line for i, row in enumerate(lines) for line in ([header, row] if i % 300 == first else [row])]


def _restarted(rows: list[list[str]]) -> list[str]:
    half = len(rows) // 2
    gone_ms = int(rows[half][0]) - 40
    rest = [[str(int(row[0]) - gone_ms), *row[1:]] for row in rows[half:]]
    return _joined([*rows[:half]]) + _BOOT + _joined([rows[0], *rest])


def _stray(rows: list[list[str]]) -> list[str]:
    return [
        line for row in _joined(rows) for line in (row, *(["GET / HTTP/1.1", '{"a": 1}'] if "7,0.0" in row else []))
    ]


WRITTEN: dict[str, Write] = {
    "plain": _joined,
    "boot lines": lambda rows: _BOOT * 20 + _joined(rows),
    "semicolons and decimal commas": lambda rows: [line.replace(".", ",") for line in _joined(rows, ";")],
    "tabs": lambda rows: _joined(rows, "\t"),
    "blanks": lambda rows: _joined([[field or "nan" for field in row] for row in rows], "  "),
    "a header every 300 rows": lambda rows: _with_headers(rows, 0),
    "a header that comes late": lambda rows: _with_headers(rows, 150),
    "degrees and micro": lambda rows: [line.replace("_dps", " (°/s)").replace("_ut", " µT") for line in _joined(rows)],
    "a serial monitor's times": lambda rows: [
        f"13:59:{i // 100 % 60:02d}.{i % 100:02d}0 -> {line}" for i, line in enumerate(_joined(rows))
    ],
    "a restarted device": _restarted,
    "stray lines": _stray,
    "whole seconds": _clocked("time_s", lambda t_ms: t_ms // 1000),
    "a time of day over midnight": _clocked("time", _time_of_day),
    "16 bits": _clocked("t_ms", lambda t_ms: (t_ms + 50_000) % 2**16),
    "32 bits": _clocked("t_us", lambda t_ms: (1000 * t_ms + 2**32 - 20_000_000) % 2**32),
    "a magnetometer that starts at once after the decision": _emptied(2500, range(7, 10)),
    "a magnetometer that starts before": _emptied(300, range(7, 10)),
}


def followed(data: bytes, size: int) -> tuple[LiveReader, SensorLog]:
    """What is delivered of bytes that come so many at a time."""
    reader, cutter = LiveReader("walk"), LineCutter()
    parts = [reader.push(cutter.push(data[at : at + size])) for at in range(0, len(data), size)]
    parts += [reader.push(cutter.finish()), reader.finish()]
    return reader, SensorLog.concatenate(parts)


def assert_same(one: SensorLog, other: SensorLog, within_s: float = 0.0) -> None:
    for name in ("acc", "gyro", "mag", "pressure"):
        a, b = getattr(one, name), getattr(other, name)
        assert len(a) == len(b), name
        np.testing.assert_array_equal(a.values, b.values, name)
        np.testing.assert_allclose(a.t_s, b.t_s, rtol=0.0, atol=within_s, err_msg=name)
    assert [event.label for event in one.events] == [event.label for event in other.events]


@pytest.fixture(scope="module")
def rows(device_lines: list[str]) -> list[list[str]]:
    found = [line.rstrip("\n").split(",") for line in device_lines]
    for i, row in enumerate(found[1:]):
        row[-1] = "home" if i in (3600, 3601, 3602, 3700) else ""
    return found


@pytest.mark.parametrize("written", WRITTEN)
def test_lines_in_any_pieces_are_read_as_their_file_is(written: str, rows: list[list[str]], tmp_path: Path) -> None:
    """The same samples for any pieces, from the saved lines, and from them as a log with the layout beside."""
    data = ("\n".join(WRITTEN[written](rows)) + "\n").encode()
    reader, whole = followed(data, len(data))
    other, pieces = followed(data, 9973)
    assert_same(whole, pieces)
    assert reader.counts == other.counts
    assert reader.reading is not None
    assert other.reading is not None
    assert reader.reading.layout == other.reading.layout
    assert len(whole.acc) == len(rows) - 1
    assert [event.label for event in whole.events] == ["home", "home"]
    assert len(whole.pressure) > 50
    assert len(whole.mag) > 50
    (tmp_path / "raw.csv").write_bytes(data)
    assert_same(saved_log(tmp_path / "raw.csv"), whole)
    keep_layout(reader.reading.layout, tmp_path)
    shared = written in ("whole seconds", "a time of day over midnight")  # how many rows share a tick is not known yet
    assert_same(read_log(tmp_path / "raw.csv").log, whole, 0.04 if shared else 0.0)


def test_rows_of_a_coarse_clock_are_spread_as_they_come(rows: list[list[str]]) -> None:
    rows = [rows[0], *rows[70:]]
    data = "\n".join(_clocked("time_s", lambda t_ms: t_ms // 1000)(rows)).encode() + b"\n"
    _, log = followed(data, 4000)
    true_s = np.array([int(row[0]) for row in rows[1:]]) / 1000.0
    assert np.abs(log.acc.t_s - (true_s - true_s[0])).max() < 0.04


def test_whole_lines_of_bad_bytes_cost_themselves(rows: list[list[str]]) -> None:
    lines = [line.encode() for line in _joined(rows)]
    lines[700] = lines[700][:20] + b"\xff\xfe\x80" + lines[700][20:]
    lines[0] = b"\xef\xbb\xbf" + lines[0]
    _, log = followed(b"\n".join(lines) + b"\n", 5000)
    assert len(rows) - 3 <= len(log.acc) <= len(rows) - 1


def test_while_it_is_undecided_why_is_told(rows: list[list[str]]) -> None:
    """A device at rest does not show whether its axes are as named; told, they are not awaited."""
    lines = _joined(rows)
    reader = LiveReader("walk")
    reader.push(lines[:150])
    assert reader.reading is None
    assert "turned too little" in reader.undecided
    reader.push(lines[150:])
    assert reader.undecided == ""
    assert reader.told().startswith("acc ax_g/ay_g/az_g in g; gyro gx_dps/gy_dps/gz_dps in °/s; mag ")
    assert reader.reading is not None
    told = LiveReader("walk", reader.reading.layout)
    assert len(told.push(lines[:150]).acc) == 149


@pytest.mark.parametrize(
    "row",
    ["1;2;3,5;4;5;6", "1,0;2,0;3,0;4,0;5,0;6,0", "1\t2\t3\t4\t5\t6", "1 2 3 4 5 6", "13:59:50.010 -> 1,2,3,4,5,6"],
)
def test_a_row_in_any_writing_makes_its_sender_the_device(row: str) -> None:
    sender = OneSender(lambda text: None)
    for chatter in ("1,5;2,5;3,5", "one 2 three 4 five six seven", "a,b,c,d,e,f,g"):
        sender.is_device(("10.0.0.9", 1), chatter.encode(), 0.0)
    assert sender.is_device(("10.0.0.2", 1), row.encode(), 0.1)
    assert not sender.is_device(("10.0.0.9", 1), row.encode(), 0.2)
