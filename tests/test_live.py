"""Between a live walk and those around it: what the device is told, and what is known of it meanwhile."""

import socket
from collections.abc import Iterator

import pytest

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.estimators.estimates import Update
from fbgraph.live import Listener, Teller, open_teller, status_text
from fbgraph.readers.numbered_lines import opened, sealed
from fbgraph.readers.sources import Source
from fbgraph.way_back.records import ReturnUpdate
from fbgraph.way_back.short_lines import ARROWS, short_line

HEADER = b"t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,bat_v,bat_ma,event\n"


def told(instruction: str, **known: object) -> ReturnUpdate:
    fields = {
        **{"t_s": 80.0, "k": 120, "breadcrumb": 3, "breadcrumb_t_s": 9.0, "route_m": 134.2, "remaining_m": 134.2},
        **{"cross_track_m": -4.6, "next_turn_m": 12.4, "next_turn_rad": 1.48, "sigma_m": 1.0},
        **{"off_route": False, "arrived": False, "instruction": instruction, **known},
    }
    return ReturnUpdate(**fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("update", "line"),
    [
        (told("turn left 85° in 12 m"), "<,12,134,turn left 85 in 12 m"),
        (told("turn right 85° now", next_turn_rad=-1.48, next_turn_m=0.4), ">,0,134,turn right 85 now"),
        (told("turn around"), "v,12,134,turn around"),
        (told("turn around in 12 m"), "v,12,134,turn around in 12 m"),
        (told("straight on for 134 m", next_turn_m=None, next_turn_rad=None), "^,134,134,straight on for 134 m"),
        (
            told("off route: the route is 5 m to your left", off_route=True),
            "?,5,134,off route: the route is 5 m to your left",
        ),
        (told("you are back at the start", arrived=True, remaining_m=0.3), "o,0,0,you are back at the start"),
        (told("position doubtful: iron; near; turn left 85° now"), "<,12,134,unsure: turn left 85 now"),
        (told("", arrived=False), ""),
    ],
)
def test_a_step_in_one_short_line(update: ReturnUpdate, line: str) -> None:
    assert short_line(update) == line
    assert not line or line[0] in ARROWS


def step(returning: ReturnUpdate | None) -> Update:
    return Update(1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, distance_m=1.0, returning=returning)


def test_what_is_new_is_told_at_once_and_what_was_told_again() -> None:
    sent: list[bytes] = []
    teller = Teller(sent.append)
    teller.remind(0.0)
    teller.update(step(None))
    assert sent == []
    teller.update(step(told("turn around")))
    teller.update(step(told("turn left 85° in 12 m")))
    assert sent == [sealed(b"!", b"v,12,134,turn around"), sealed(b"!", b"<,12,134,turn left 85 in 12 m")]
    teller.update(step(told("")))  # arrived before: the last line stays
    now_s = teller._sent_s
    teller.remind(now_s + 0.5)
    assert len(sent) == 2
    teller.remind(now_s + 1.0)
    assert sent[2] == sent[1]


def test_a_display_of_its_own_is_told_and_ends_no_walk() -> None:
    said: list[str] = []
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        teller = open_teller(f"tcp://:{server.getsockname()[1]}", "stdin", Source(), said.append)
        with server.accept()[0] as display:
            teller.update(step(told("turn around")))
            assert opened(display.recv(100)) == (b"!", b"v,12,134,turn around")
    for _ in range(5):
        teller._sent_s = -1e9
        teller.remind(0.0)
    assert len(said) == 1
    assert "nobody takes what is told" in said[0]


def test_where_nobody_can_be_told_is_said_before_the_walk() -> None:
    for spec, of in (
        ("device", "stdin"),
        ("device", "http://:80"),
        ("serial", "udp://:5"),
        ("pty", "stdin"),
        ("x", "x"),
    ):
        with pytest.raises(ConfigError, match=r"--tell|expected"):
            open_teller(spec, of, Source(), lambda text: None)
    with pytest.raises(DataError):
        open_teller("tcp://127.0.0.1:1", "stdin", Source(), lambda text: None)
    back: list[bytes] = []
    source = Source(back=back.append)
    open_teller("serial", "serial:/dev/x", source, lambda text: None).update(step(told("turn around")))
    assert len(back) == 1


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_what_is_known_of_a_device_from_its_lines() -> None:
    said, clock, seen = list[str](), Clock(), list[str]()
    listener = Listener(said.append, clock)

    def pieces() -> Iterator[bytes]:
        for _ in range(12):  # nothing for twelve seconds
            clock.now_s += 1.0
            yield b""
        yield HEADER + b"10,0,0,1,0,0,0,3.95,-80,\n"
        for i in range(100):
            clock.now_s += 0.1
            yield b"%d,0,0,1,0,0,0,%s,,\n" % (20 + i, b"99" if i < 50 else b"")
        clock.now_s += 11.0
        yield b""
        clock.now_s += 1.0
        yield b"500,0,0,1,0,0,0,3.90,,\n"

    passed = b"".join(listener.through(pieces(), lambda: seen.append(status_text(listener.heard, 7, 5.2, None))))
    assert passed.count(b"\n") == 103
    assert said == [
        "nothing came for 10 s: the first line is still awaited",
        "the first line came after 12.0 s",
        "nothing came for 11 s: is the device on, and in reach?",
        "lines come again, after 12 s",
    ]
    assert seen[0] == "0 lines/s  7 steps  5 m  no line yet"
    assert seen[112] == "10 lines/s  7 steps  5 m  battery 3.95 V  sound"
    assert seen[113] == "0 lines/s  7 steps  5 m  battery 3.95 V  sound  silent for 11 s"
    assert listener.heard.battery_v == 3.90
    assert "doubtful" in status_text(listener.heard, 7, 5.2, "iron")
