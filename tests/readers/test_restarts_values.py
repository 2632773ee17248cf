"""Files of the wearable: clocks that restart, buttons held down, headers that come late or again."""

from pathlib import Path

import numpy as np
import pytest
from support.m5stickc_lines import lines_of_a_walk, read_rows

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import IntArray
from fbgraph.readers.restarts import continue_restarts, little_disorder

MS = 1_000_000
WALK = lines_of_a_walk(300)  # 50 Hz from 5 s; a button at rows 50, 150 and 250


def clock(*starts_and_counts: tuple[int, int]) -> IntArray:
    """Milliseconds in steps of 20 ms, in nanoseconds."""
    pieces = [start + 20 * np.arange(count) for start, count in starts_and_counts]
    return np.concatenate(pieces).astype(np.int64) * MS


def test_time_goes_on_one_step_after_the_last_row_where_a_clock_restarts() -> None:
    t_ns, restarts = continue_restarts(clock((5000, 100), (12, 100)))
    assert restarts == 1
    np.testing.assert_array_equal(t_ns, clock((5000, 200)))
    t_ns, restarts = continue_restarts(clock((5000, 100), (12, 100), (7, 100)))
    assert restarts == 2
    np.testing.assert_array_equal(t_ns, clock((5000, 300)))


def test_a_restart_is_a_jump_back_by_more_than_a_second() -> None:
    for back_ms, expected in ((990, 0), (1100, 1)):
        assert continue_restarts(clock((5000, 100), (6980 - back_ms, 100)))[1] == expected


def test_after_a_restart_time_runs_on() -> None:
    garbled = clock((5000, 200))
    garbled[100] = 7 * MS  # one time alone
    assert continue_restarts(garbled)[1] == 0
    near_the_end = clock((5000, 100), (12, 2))
    assert continue_restarts(near_the_end)[1] == 0
    assert continue_restarts(clock((5000, 100), (12, 3)))[1] == 1
    assert continue_restarts(clock((5000, 2), (12, 100)))[1] == 0
    assert continue_restarts(clock((5000, 3), (12, 100)))[1] == 1


def test_a_last_time_that_was_garbled_is_not_gone_on_from() -> None:
    t_ns = clock((5000, 100), (12, 100))
    t_ns[99] = 10**9 * MS
    repaired, restarts = continue_restarts(t_ns)
    assert restarts == 1
    # from a second after the middle of the last five at most
    assert repaired[100] == (5000 + 20 * 97 + 1000 + 20) * MS


def test_a_clock_that_runs_backwards_is_left_as_it_is() -> None:
    short = [(5000, 90)] * 12  # ten restarts, or one in a hundred rows, are as many as there may be
    assert continue_restarts(clock(*short[:11]))[1] == 10
    assert continue_restarts(clock(*short))[1] == 0
    np.testing.assert_array_equal(continue_restarts(clock(*short))[0], clock(*short))
    assert continue_restarts(clock(*short, (5000, 120)))[1] == 12  # 1200 rows
    assert continue_restarts(clock(*short, (5000, 119)))[1] == 0
    assert continue_restarts(clock((5000, 100)))[1] == 0


def test_restarts_are_counted_and_told(tmp_path: Path) -> None:
    rows = [row if i < 200 else f"{20 * i - 3990}{row[row.index(',') :]}" for i, row in enumerate(WALK[1:])]
    raw = read_rows(tmp_path, [WALK[0], *rows])
    assert raw.counts["clock_restarts"] == 1
    assert raw.notices == ["the device's clock restarted 1 times; later times go on from the last row"]
    np.testing.assert_array_equal(np.diff(raw.streams["acc"].t_ns), 20 * MS)


def test_a_button_held_down_is_one_event(tmp_path: Path) -> None:
    def events(*texts: str) -> list[tuple[int, str]]:
        rows = [row.rpartition(",")[0] + "," + text for row, text in zip(WALK[1:], texts, strict=False)]
        raw = read_rows(tmp_path, [WALK[0], *rows, *WALK[1 + len(texts) : 45]])
        return [((t_ns // MS - 5000) // 20, label) for t_ns, label in raw.events]

    assert events("", "a", "a", "a", "", "a") == [(1, "a"), (5, "a")]
    assert events("a", "b", "b", "a") == [(0, "a"), (1, "b"), (3, "a")]
    assert events("0", "1", "1", "0", "1") == [(1, "1"), (4, "1")]
    assert events("0", "0") == []
    assert events("tür") == [(0, "tür")]


def test_headers_may_come_late_or_again(tmp_path: Path) -> None:
    again = read_rows(tmp_path, [*WALK[:100], WALK[0], *WALK[100:200], WALK[0], *WALK[200:]])
    assert again.counts == {"headers_repeated": 2}
    assert len(again.streams["acc"].t_ns) == 300
    once = read_rows(tmp_path, WALK)
    assert once.counts == {}
    assert once.notices == []
    late = read_rows(tmp_path, ["# made by", "boot 1.2", "", *["noise"] * 980, *WALK])
    assert len(late.streams["acc"].t_ns) == 300


def test_without_a_header_the_canonical_columns_are_taken(tmp_path: Path) -> None:
    for noise in (0, 10):
        raw = read_rows(tmp_path, ["noise"] * noise + WALK[1:])
        assert raw.notices[0] == f"no header: columns taken as {CANONICAL}"
        assert len(raw.streams["acc"].t_ns) == 300
    with pytest.raises(DataError, match=r"walk.csv: no table in it"):
        read_rows(tmp_path, ["noise"] * 9)


def test_rows_a_little_late_are_told_from_restarts() -> None:
    t_ns = clock((5000, 200))
    t_ns[[50, 51]] = t_ns[[51, 50]]
    assert little_disorder(t_ns)
    assert not little_disorder(clock((5000, 200)))
    assert not little_disorder(clock((5000, 100), (12, 100)))
    assert not little_disorder(clock((5000, 200))[::-1])


def test_slow_sensors_are_kept_once_a_measurement(tmp_path: Path) -> None:
    rows = []
    for i, row in enumerate(WALK[1:]):
        fields = row.split(",")
        fields[10] = f"{1000.0 + 0.5 * (i // 10)}"
        fields[7:10] = [""] * 3 if i % 5 else fields[7:10]
        rows.append(",".join(fields))
    raw = read_rows(tmp_path, [WALK[0], *rows])
    np.testing.assert_array_equal(raw.streams["mag"].t_ns, clock((5000, 300))[::5])
    np.testing.assert_array_equal(raw.streams["pressure"].t_ns, clock((5000, 300))[::10])
    assert raw.counts == {"pressure_repeats": 270}


def test_a_clock_set_back_is_not_sorted_but_datagrams_out_of_order_are() -> None:
    t_ns = 10_000_000 * np.arange(1000, dtype=np.int64)
    set_back = t_ns - 500_000_000 * (np.arange(1000) >= 500)
    assert not little_disorder(set_back)
    swapped = t_ns.reshape(-1, 4)[:, [1, 0, 3, 2]].ravel()
    assert little_disorder(swapped)
    assert not little_disorder(t_ns)
