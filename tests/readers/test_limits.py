"""Logs that are too large, too long, too wide, or no files: refused in one line, in little memory."""

import gzip
import itertools
import os
import resource
import subprocess
import sys
import threading
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from support.waves import waves

from fbgraph.core.bounded import (
    CONFIG_BYTES,
    FREE_BYTES,
    LONGEST_LINE,
    MIB,
    MOST_BYTES,
    MOST_COLUMNS,
    MOST_GROWTH,
    Allowance,
    WholeLines,
    parse_size,
)
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers import getsensordata, indoor_location, read_log, read_table_log
from fbgraph.readers.cleaning import RawLog
from fbgraph.tables import text_table
from fbgraph.tables.log_text import LogText, log_text
from fbgraph.tables.text_table import read_table

N = 500
ACC, GYRO, _ = waves(N)
HEADER = "t_ms,ax_ms2,ay_ms2,az_ms2,gx_rads,gy_rads,gz_rads"
ROWS = [f"{20 * i}," + ",".join(f"{v:.5f}" for v in (*ACC[i], *GYRO[i])) for i in range(N)]


def write(folder: Path, lines: list[str], end: str = "\n") -> Path:
    path = folder / "walk.csv"
    path.write_bytes("".join(line + end for line in lines).encode("latin-1"))
    return path


def cut(data: bytes, size: int) -> tuple[list[bytes], int]:
    """Lines kept of data that comes in blocks of this size, and how many were too long."""
    lines = WholeLines()
    joined = b"".join(lines.pieces(data[at : at + size] for at in range(0, len(data), size)))
    return joined.split(b"\n"), lines.too_long


@pytest.mark.parametrize(
    ("text", "size"),
    [("1", 1), ("100K", 102_400), ("2G", 2 << 30), ("1.5m", 3 << 19), ("64MiB", 64 * MIB), ("3gb", 3 << 30)],
)
def test_a_size_is_bytes_with_a_unit(text: str, size: int) -> None:
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "0", "-1", "G", "1X", "1e9", "nan", "9" * 5000, "1\u0663"])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"--max-size .*: expected a size such as 500M or 2G"):
        parse_size(text)


def test_an_hour_at_1_khz_is_within_the_limits() -> None:
    longest_row = "1700000000000000000" + ",-12.345678" * 10 + ",31.25,"
    assert 3600 * 1000 * len(longest_row) < 0.6 * MOST_BYTES
    Allowance.of(None).refuse("log", MOST_BYTES, -(-MOST_BYTES // MOST_GROWTH))


@pytest.mark.parametrize(
    ("size", "packed", "refused"),
    [
        (MOST_BYTES, None, False),
        (MOST_BYTES + 1, None, True),
        (FREE_BYTES, 1, False),
        (FREE_BYTES + 1, 1, True),
        (MOST_GROWTH * MIB, MIB, False),
        (MOST_GROWTH * MIB + 1, MIB, True),
        (MOST_BYTES, MOST_BYTES, False),
        (MOST_BYTES + 1, MOST_BYTES, True),
    ],
)
def test_size_and_growth_are_refused_beyond_their_limits(size: int, packed: int | None, refused: bool) -> None:
    if not refused:
        Allowance.of(None).refuse("log", size, packed)
        return
    with pytest.raises(DataError, match=r"^log: .* the limit is .*--max-size"):
        Allowance.of(None).refuse("log", size, packed)


def test_a_size_that_was_told_is_meant_whatever_the_growth() -> None:
    Allowance.of(500 * MIB).refuse("log", 500 * MIB, 1)
    with pytest.raises(DataError, match=r"500 MiB or more, the limit is 499 MiB; --max-size SIZE allows more"):
        Allowance.of(499 * MIB).refuse("log", 500 * MIB, 1)


@pytest.mark.parametrize("packed", [False, True])
def test_a_log_of_just_the_limit_is_read_and_one_byte_more_is_not(packed: bool, tmp_path: Path) -> None:
    path = write(tmp_path, [HEADER, *ROWS])
    size = path.stat().st_size
    if packed:
        path.write_bytes(gzip.compress(path.read_bytes()))
    assert len(read_log(path, max_size=size).log.acc) == N
    with pytest.raises(DataError, match=r"walk.csv: .* or more, the limit is .*; --max-size SIZE allows more"):
        read_log(path, max_size=size - 1)


@pytest.mark.parametrize("size", [1, 2, 3, 7, 1000, 1 << 20])
def test_lines_are_the_same_in_blocks_of_any_size(size: int) -> None:
    data = b"a\r\nbb\rccc\n\n\r\r\n" + b"d" * 9 + b"\nlast"
    assert cut(data, size) == ([b"a", b"bb", b"ccc", b"", b"", b"", b"ddddddddd", b"last"], 0)
    assert cut(data[:-4] + b"x\r", size)[0][-2:] == [b"x", b""]


@pytest.mark.parametrize("block", [1000, 1 << 15, 1 << 20])
@pytest.mark.parametrize("last", [False, True])
def test_a_line_of_64_kib_is_kept_and_a_longer_one_left_out(block: int, last: bool) -> None:
    end = b"" if last else b"\nz\n"
    kept, too_long = cut(b"a\n" + b"x" * LONGEST_LINE + end, block)
    assert (len(kept[1]), too_long) == (LONGEST_LINE, 0)
    kept, too_long = cut(b"a\n" + b"x" * (LONGEST_LINE + 1) + end, block)
    assert too_long == 1
    assert kept == ([b"a", b""] if last else [b"a", b"z", b""])
    assert cut(b"a\n" + (b"y" * 200_000 + b"\nb\n") * 5, block) == ([b"a", *[b"b"] * 5, b""], 5)


def test_endless_lines_in_a_log_are_left_out_and_told(tmp_path: Path) -> None:
    lines = [HEADER, *ROWS]
    lines[200:200] = ["7" * 300_000, "8" * 70_000]
    log = read_log(write(tmp_path, lines)).log
    assert len(log.acc) == N
    assert log.counts == {"lines_too_long": 2}
    assert any("2 lines of more than 64 KiB" in notice for notice in log.notices)
    with pytest.raises(DataError, match="it holds nothing but lines of more than 64 KiB"):
        read_log(write(tmp_path, ["7" * 100_000]))
    with pytest.raises(DataError, match="a binary file"):
        read_log(write(tmp_path, ["\0" * 100_000]))


@pytest.mark.parametrize(("columns", "refused"), [(MOST_COLUMNS, False), (MOST_COLUMNS + 1, True)])
def test_a_header_has_4096_columns_at_most(columns: int, refused: bool, tmp_path: Path) -> None:
    more = columns - 7
    path = write(tmp_path, [HEADER + ",c" * more, *(row + "," * more for row in ROWS)])
    if refused:
        with pytest.raises(DataError, match=r"a line of 4097 columns, of which a log has 4096 at most"):
            read_log(path)
    else:
        assert len(read_log(path).log.acc) == N


def test_a_thousand_wide_lines_before_the_header_take_no_time() -> None:
    line = ",".join(f"ab{i}" for i in range(4000))
    table = read_table(LogText(Path("wide.csv"), ("\n".join([line] * 300).encode(),)), "wide", "wide.csv")
    assert table is None or not len(table)


def raw_of(text: LogText) -> RawLog:
    table = read_table(text, "walk", "walk.csv")
    assert table is not None
    return read_table_log([table], text.source)[0]


@pytest.mark.parametrize("timed", [True, False])
def test_pieces_and_blocks_give_what_one_text_gives(timed: bool, tmp_path: Path) -> None:
    rows = [f"{20 * i if timed else i}," + ROWS[i % N].partition(",")[2] for i in range(9001)]
    rows[5] = "torn"
    rows[4500] = "4,5"
    whole = log_text(write(tmp_path, [HEADER if timed else HEADER.replace("t_ms", "n"), *rows]))
    text = b"".join(whole.pieces)
    cuts = [0, *(text.index(b"\n", at) + 1 for at in range(1000, len(text), 77_777)), len(text)]
    pieces = tuple(text[a:b] for a, b in itertools.pairwise(cuts))
    one, many = (raw_of(LogText(whole.source, each)) for each in ((text,), pieces))
    assert one.counts == many.counts == {"lines_unreadable": 2}
    for name in ("acc", "gyro"):
        assert np.array_equal(one.streams[name].values, many.streams[name].values)
        assert np.array_equal(one.streams[name].t_ns, many.streams[name].t_ns)
        assert one.streams[name].t_ns[-1] == 20_000_000 * 9000


def test_what_is_no_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"/dev/zero: is a device or socket, not a log file"):
        read_log(Path("/dev/zero"))
    with pytest.raises(DataError, match=r"check the path"):
        read_log(Path("a\0b"))
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    with pytest.raises(DataError, match=r"loop: .*; check the path"):
        read_log(loop)


def test_a_pipe_gives_the_same_log_as_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, [HEADER, *ROWS])
    pipe = tmp_path / "pipe"
    for data in (path.read_bytes(), gzip.compress(path.read_bytes())):
        os.mkfifo(pipe)
        writer = threading.Thread(target=pipe.write_bytes, args=(data,))
        writer.start()
        log = read_log(pipe).log
        writer.join()
        pipe.unlink()
        assert np.array_equal(log.acc.values, read_log(path).log.acc.values)
        assert log.name == "pipe"


BOMBS = {
    "zeros": (b"", b"\0" * MIB),
    "newlines": ((HEADER + "\n" + "\n".join(ROWS) + "\n").encode(), b"\n" * MIB),
    "rows": ((HEADER + "\n").encode(), b"1,1,1,1,1,1,1\n" * (MIB // 14)),
    "phone": (b"% GetSensorData\n", b"ACCE;0.1;0.1;1;2;9;3\n" * (MIB // 21)),
}


@pytest.mark.parametrize("kind", BOMBS)
def test_a_bomb_of_200_mb_is_refused_within_little_memory(kind: str, tmp_path: Path) -> None:
    head, block = BOMBS[kind]
    path = tmp_path / "bomb.csv.gz"
    with gzip.open(path, "wb", compresslevel=6) as bomb:
        bomb.write(head)
        for _ in range(200):
            bomb.write(block)
    assert path.stat().st_size < 2 * MIB
    code = (
        "import sys, pathlib, numpy, fbgraph.readers\n"
        "from fbgraph.core.errors import DataError\n"
        "try: fbgraph.readers.read_log(sys.argv[1])\n"
        "except DataError as error: print(error)\n"
    )
    most = 1500 * MIB
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
    )
    assert done.returncode == 0, done.stderr
    said = "the limit is 64 MiB or 100 times as much as packed; if it is a walk, --max-size"
    assert (said if kind != "zeros" else "a binary file, not a log") in done.stdout


def test_many_empty_lines_within_the_limit_cost_no_memory(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_bytes(("\n".join([HEADER, *ROWS]) + "\n" * (60 * MIB)).encode())
    code = "import sys, numpy, fbgraph.readers as r; print(len(r.read_log(sys.argv[1]).log.acc))"
    most = 1500 * MIB
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
    )
    assert done.stdout.strip() == str(N), done.stderr


@pytest.mark.parametrize(
    ("data", "rows"),
    [(b"", 0), (b"\n\n\n", 0), (b"a", 1), (b"a\n", 1), (b"\na\n\n\nb\r\nc", 3), (b"a\rb\r\r\n", 2)],
)
def test_rows_are_lines_that_are_not_empty(data: bytes, rows: int, tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_bytes(data)
    assert log_text(tmp_path / "walk.csv").rows == rows
    lines = 400_000  # in pieces of a mebibyte
    (tmp_path / "walk.csv").write_bytes(b"1,2,3,4\n" * lines + data)
    assert log_text(tmp_path / "walk.csv").rows == lines + rows


def test_a_wearables_log_has_a_days_rows_at_most(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, [HEADER, *ROWS])
    assert text_table.MOST_ROWS > 24 * 3600 * 100
    monkeypatch.setattr(text_table, "MOST_ROWS", N + 1)
    assert len(read_log(path).log.acc) == N
    monkeypatch.setattr(text_table, "MOST_ROWS", N)
    with pytest.raises(
        DataError, match=r"walk\.csv: 501 rows, the limit is 500; if it is a walk, --max-size SIZE allows more"
    ):
        read_log(path)
    assert len(read_log(path, max_size=1 << 30).log.acc) == N


@pytest.mark.parametrize("phone", [getsensordata, indoor_location])
def test_a_phones_log_has_twenty_million_rows_at_most(
    phone: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "walk.txt").write_text(phone.FORMAT.example)
    rows = phone.FORMAT.example.count("\n")
    assert phone.MOST_LINES == 20_000_000
    monkeypatch.setattr(phone, "MOST_LINES", rows)
    assert phone.read(tmp_path / "walk.txt").streams
    monkeypatch.setattr(phone, "MOST_LINES", rows - 1)
    with pytest.raises(DataError, match=rf"walk\.txt: {rows} rows, the limit is {rows - 1}"):
        phone.read(tmp_path / "walk.txt")


def test_a_configuration_is_small() -> None:
    assert CONFIG_BYTES == 65_536
