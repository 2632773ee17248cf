"""The M5StickC CSV reader on clocks that restart, lines that break and junk."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from support.m5stickc_lines import ACC, DEG, GYRO, T_S, G, I, N, lines_of_a_walk, read_columns, read_lines
from support.waves import check_sound

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.errors import DataError
from fbgraph.readers import read_log


@pytest.mark.parametrize("width", [11, 12, 13])
def test_a_stream_joined_midway_is_taken_as_canonical(width: int, tmp_path: Path) -> None:
    lines = [",".join(line.split(",")[:width]) for line in lines_of_a_walk()[1:]]
    path = tmp_path / "midway.csv"
    path.write_text("\n".join([lines[0][17:], *lines]) + "\n")
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
def test_time_backwards_throughout_is_refused(step_ms: int, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="column t_ms goes backwards from row to row"):
        read_columns(
            tmp_path, "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", 10_000_000 - step_ms * I, ACC / G, GYRO / DEG
        )


def test_whole_second_stamps_are_spread(tmp_path: Path) -> None:
    read = read_columns(tmp_path, "t_s,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", np.floor(T_S), ACC / G, GYRO / DEG)
    assert read.acc.rate_hz == pytest.approx(50.0)
    assert len(read.acc) > N - 50
    read = read_columns(tmp_path, "timestamp,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", np.floor(T_S), ACC / G, GYRO / DEG)
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


def damaged(line: str, at: int, kind: str, what: str | int, before: str) -> str:
    """A line after something happened to it; ``before`` is the one before it."""
    fields = line.split(",")
    match kind:
        case "cut":
            return line[: int(what)]
        case "put":
            return f"{line[:at]}{what}{line[at:]}"
        case "join":
            return line + before
        case "time":
            return ",".join([str(what), *fields[1:]])
        case "value":
            return ",".join([*fields[: 1 + at % 10], str(what), *fields[2 + at % 10 :]])
        case _:  # another line in its place
            return str(what)


@given(st.lists(st.tuples(st.integers(0, 400), st.integers(0, 90), JUNK), max_size=40), st.booleans(), st.booleans())
@example([(i, 0, ("time", "1e999")) for i in range(401)], False, True)
@example([(i, 0, ("value", "inf")) for i in range(401)], False, True)
@example([(i, 3, ("value", "inf")) for i in range(401)], False, False)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_junk_never_breaks_the_reader(
    tmp_path: Path, damage: list[tuple[int, int, tuple[str, int | str]]], also_header: bool, units: bool
) -> None:
    lines = lines_of_a_walk(400)
    if not units:
        lines[0] = "t,ax,ay,az,gx,gy,gz,mx,my,mz,p,temp,event"
    for row, at, (kind, what) in damage:
        if row == 0 and not also_header:
            continue
        lines[row] = damaged(lines[row], at, kind, what, lines[row - 1])
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
