"""The line that shows how a live walk stands: in its place on a terminal, nowhere else, and never in the way."""

import io
import sys

import pytest

from fbgraph.cli.printing import complain, say, show_status


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_it_stands_in_its_place_and_gives_way_to_what_is_told(
    capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "30")
    show_status("100 lines/s  7 steps")
    show_status("100 lines/s  7 steps")
    complain("the device disconnected")
    show_status("a name with \x1b[2J in it, and too long for it")
    say("a step")
    show_status("")
    text = terminal.getvalue()
    assert text.startswith("\r\x1b[K100 lines/s  7 steps\r\x1b[Kfbgraph: the device disconnected\n\r\x1b[K")
    assert "\x1b[2J" not in text
    shown = text.split("\r\x1b[K")[3]
    assert len(shown) == 29
    assert text.endswith("\r\x1b[K")
    assert text.count("\r\x1b[K") == 4
    assert capfdbinary.readouterr().out == b"a step\n"


def test_where_nobody_looks_nothing_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    show_status("100 lines/s")
    assert capsys.readouterr().err == ""
