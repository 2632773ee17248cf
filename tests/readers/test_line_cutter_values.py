"""Bytes in any pieces become lines; one that never ends is left out whole."""

import pytest

from fbgraph.readers.raw_recorder import LineCutter


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("size", [1, 2, 3, 100])
def test_lines_end_in_any_way_in_any_pieces(end: bytes, size: int) -> None:
    data, cutter = end.join((b"1,2", b"3,4", b"5,6", b"")), LineCutter()
    lines = [line for at in range(0, len(data), size) for line in cutter.push(data[at : at + size])]
    assert [line for line in [*lines, *cutter.finish()] if line] == ["1,2", "3,4", "5,6"]


def test_a_line_without_end_is_left_out_with_its_tail() -> None:
    cutter = LineCutter()
    assert cutter.push(b"1,2\n" + b"x" * 70_000) == ["1,2"]
    assert cutter.push(b"x" * 70_000) == []
    assert cutter.push(b"3,4\n5,6\n") == ["5,6"]  # 3,4 is its tail
    assert cutter.too_long == 1
