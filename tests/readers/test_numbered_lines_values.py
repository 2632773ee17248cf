"""Numbered lines: whatever a link loses, doubles or reorders, what is stored is the file on the device."""

import random
from binascii import crc32
from pathlib import Path

import pytest
from support.m5stickc_lines import lines_of_a_walk

from fbgraph.readers.numbered_lines import NumberedLines, Stored, asked, numbered, opened, sealed, stored_lines

WALK = "4f2a"
FILE = [f"# fbgraph recorder 1 walk {WALK}".encode(), *(line.encode() for line in lines_of_a_walk(400)), b"# end"]
WHOLE = b"".join(line + b"\n" for line in FILE)


def frame(number: int) -> bytes:
    return numbered(WALK, number, FILE[number])


def beacon() -> bytes:
    return sealed(b"@", f"{WALK}:{len(FILE)}".encode())


def test_a_line_of_the_protocol_is_as_told() -> None:
    body = b"4f2a:7,10250,0.012"
    assert numbered(WALK, 7, b"10250,0.012") == b"$4f2a:7,10250,0.012*%04x\n" % (crc32(body) & 0xFFFF)
    assert opened(b"$" + body + b"*%04x\r\n" % (crc32(body) & 0xFFFF)) == (b"$", body)
    assert opened(b"$4f2a:8,10250,0.012*%04x" % (crc32(body) & 0xFFFF)) is None
    assert asked(b"4f2a:1-2;9-9;x-3") == (WALK, [(1, 2), (9, 9)])


@pytest.mark.parametrize("seed", range(5))
def test_what_is_lost_doubled_garbled_or_late_is_stored_once_in_order(seed: int) -> None:
    """Both ways lose a fifth; the device answers what it understands."""
    chance, lines, stored = random.Random(seed), NumberedLines(), b""
    pending = [frame(n) for n in range(len(FILE))]
    pending[100:140] = reversed(pending[100:140])
    now_s, pieces = 0.0, 0
    while not lines.ended and pieces < 5000:
        now_s, pieces = now_s + 0.05, pieces + 1
        sent = b"".join(pending.pop(0) for _ in range(min(10, len(pending)))) + beacon()
        kept = b"".join(line + b"\n" for line in sent.splitlines() if chance.random() > 0.2)
        if chance.random() < 0.2 and kept:
            at = chance.randrange(len(kept))
            kept = kept[:at] + bytes([kept[at] ^ 1]) + kept[at + 1 :]
        for at in range(0, len(kept), 77):
            stored += lines.push(kept[at : at + 77], now_s)
        for request in lines.requests(now_s):
            found = opened(request)
            if found and found[0] == b"?" and chance.random() > 0.2:
                pending += [frame(n) for a, b in asked(found[1])[1] for n in range(a, b + 1)]
    assert stored == WHOLE
    assert lines.finish() == b""
    assert lines.again > 50
    assert lines.stored == Stored(WALK, len(FILE))


@pytest.mark.parametrize("line", [b"t_ms,ax_g\r\n1,2\r\n", b"$GPGGA,1*47\n@x\n$4f2a:1", b"\xff\xfe$\n", b"1\r2\r"])
def test_a_device_that_numbers_nothing_is_passed_through(line: bytes) -> None:
    lines = NumberedLines()
    out = b"".join(lines.push(line[at : at + 1], 0.0) for at in range(len(line))) + lines.finish()
    assert (out, lines.requests(9.0)) == (line, [])


def test_one_wrong_line_is_no_reason_to_trust_what_else_comes() -> None:
    lines = NumberedLines()
    assert lines.push(b"ets Jun  8 2016\n" + frame(0)[:-6] + b"0000\n", 0.0) == b"ets Jun  8 2016\n"
    assert lines.push(frame(0) + b"chatter\n" + frame(1), 0.0) == FILE[0] + b"\n" + FILE[1] + b"\n"
    assert lines.garbled == 1


def test_what_the_device_no_longer_has_is_noted(tmp_path: Path) -> None:
    told: list[str] = []
    lines = NumberedLines(told.append)
    stored = lines.push(b"".join(frame(n) for n in (0, 1, 2, 6, 7)), 0.0)
    stored += lines.push(sealed(b"-", b"4f2a:3-5"), 0.5)
    assert stored.splitlines() == [*FILE[:3], b"# lines 3 to 5 never came", *FILE[6:8]]
    assert "3 to 5 never came" in told[0]
    raw = tmp_path / "raw.csv"
    raw.write_bytes(b"boot\n" + stored)
    assert stored_lines(raw) == Stored(WALK, 8)


def test_a_gap_is_left_only_when_others_came_for_long_and_never_while_the_link_is_down() -> None:
    lines = NumberedLines()
    lines.push(frame(0) + frame(2), 0.0)
    assert lines.requests(0.5)
    assert lines.push(frame(3), 900.0) == b""  # an hour of silence is no answer
    out = [lines.push(frame(4 + n), 901.0 + n) for n in range(40)]
    assert [piece != b"" for piece in out].index(True) == 28  # the thirtieth second in which the device was heard
    assert next(piece for piece in out if piece).startswith(b"# lines 1 to 1 never came\n" + FILE[2])


def test_a_walk_that_is_gone_on_with_asks_for_what_was_never_stored(tmp_path: Path) -> None:
    raw = tmp_path / "raw.csv"
    raw.write_bytes(b"".join(line + b"\n" for line in FILE[:100]))
    lines = NumberedLines(stored=stored_lines(raw))
    assert lines.push(frame(99) + frame(150), 0.0) == b""
    found = opened(lines.requests(0.0)[0])
    assert found is not None
    assert asked(found[1]) == (WALK, [(100, 149)])


def test_a_device_that_restarts_begins_another_file() -> None:
    told: list[str] = []
    lines = NumberedLines(told.append)
    out = lines.push(b"".join(frame(n) for n in (0, 1, 3)), 0.0)
    out += lines.push(numbered("0001", 0, b"# fbgraph recorder 1 walk 0001") + numbered("0001", 1, b"x"), 1.0)
    assert out.splitlines()[2:] == [b"# lines 2 to 2 never came", FILE[3], b"# fbgraph recorder 1 walk 0001", b"x"]
    assert told[-1].startswith("the device began a new file")
    assert lines.stored == Stored("0001", 2)


def test_memory_is_bounded_however_far_ahead_a_number_is() -> None:
    lines = NumberedLines()
    lines.push(frame(0) + numbered(WALK, 999_999_999, b"x"), 0.0)
    found = opened(lines.requests(0.0)[0])
    assert found is not None
    assert asked(found[1])[1] == [(1, 400)]


def test_lines_that_are_on_their_way_are_not_asked_for_again() -> None:
    """A host that is slow would else drown in what it asked for."""
    lines, asks = NumberedLines(), 0
    lines.push(frame(0) + frame(200), 0.0)
    for i in range(1, 150):
        now_s = 0.1 * i
        asks += any(request[:1] == b"?" for request in lines.requests(now_s))
        lines.push(frame(i), now_s)
    assert asks == 1
    assert not any(request[:1] == b"?" for request in lines.requests(15.5))
    assert any(request[:1] == b"?" for request in lines.requests(16.5))
