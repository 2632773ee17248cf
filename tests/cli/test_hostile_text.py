"""Text from logs, names and files on a terminal: shown, whatever it would like to do."""

import csv
import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gpxpy
import numpy as np
import pytest
from support.commands import fbgraph, fbgraph_process
from support.hostile import (
    CLEAR,
    CLIPBOARD,
    FORMULA,
    MARKUP,
    RED_8BIT,
    RIGHT_TO_LEFT,
    TEXTS,
    TITLE,
    on_terminal,
    unseen,
)

from fbgraph.api import load_run
from fbgraph.cli.printing import print_table
from fbgraph.readers import FORMATS, log_format

NAME = f"w{TITLE}{MARKUP.partition('/')[0]}{RIGHT_TO_LEFT}\n\x9b31m"
"""As much of it as a file's name may hold."""
SHOWN = r"w\x1b]0;PWNED\x07[red]markup[\u202eRTL\n\x9b31m"
LABELS = [text for text in TEXTS if text.isascii() or text.encode("utf-8", "ignore").decode() == text]


@pytest.fixture(scope="module")
def log(device_lines: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk with a hostile name, header and events."""
    lines = [line.rstrip("\n").split(",") for line in device_lines]
    event = lines[0].index("event")
    for number, text in enumerate(TEXTS):
        label = text.replace("\n", " ").replace("\r", " ").replace(",", ";")
        lines[len(lines) // 3 + 60 * number][event] = label.encode("utf-8", "replace").decode("utf-8")
    path = tmp_path_factory.mktemp("hostile") / f"{NAME}.csv"
    path.write_text("\n".join(map(",".join, lines)) + "\n", "utf-8")
    return path


@pytest.fixture(scope="module")
def smoothed(log: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Its run folder, and what was seen while it was made."""
    folder = tmp_path_factory.mktemp("run") / "run"
    return folder, on_terminal("smooth", log, "--out", folder)


@pytest.fixture(scope="module")
def edited(smoothed: tuple[Path, str]) -> Path:
    """A run whose summary somebody wrote by hand."""
    folder, _ = smoothed
    path = folder / "summary.json"
    summary: dict[str, Any] = json.loads(path.read_text())
    summary.pop("sha256", None)  # of what stood there before
    summary["log"]["name"] = "".join(LABELS)[:300]
    first_s, last_s = (float((folder / "pdr.tum").read_text().splitlines()[k].split()[0]) for k in (1, -1))
    times_s = np.linspace(first_s, last_s, len(LABELS) + 2)[1:-1].tolist()
    summary["log"]["events"] = [{"t_s": t_s, "label": text} for t_s, text in zip(times_s, LABELS, strict=True)]
    path.write_text(json.dumps(summary))
    return folder


def test_smooth_shows_the_name(smoothed: tuple[Path, str]) -> None:
    folder, seen = smoothed
    assert unseen(seen) == set()
    assert seen.lstrip("\n").startswith(f"{SHOWN} (m5stickc): ")
    assert seen.endswith(f"written to {folder}\n")


def test_the_summary_keeps_the_true_text(smoothed: tuple[Path, str], log: Path) -> None:
    summary = json.loads((smoothed[0] / "summary.json").read_text())
    if "sha256" in summary:
        assert summary["log"]["name"] == NAME
    assert summary["inputs"]["log"] == str(log.resolve())


@pytest.mark.parametrize("term", ["dumb", "xterm-256color"])
def test_evaluate_shows_what_a_summary_says(edited: Path, tmp_path: Path, term: str) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("t_s,x_m,y_m\n8,0,0\n20,1,1\n30,2,2\n")
    seen = on_terminal("evaluate", edited, "--truth", truth, term=term)
    assert unseen(seen) == set()
    assert seen.startswith(r"\x1b]0;PWNED\x07\x1b]52;c;UFdORUQ=\x07\x1b[2J\x07bell\x9b31m\u202eRTL[red]markup[/red]")
    assert "…: 2 checkpoints scored\n" in seen


@pytest.mark.parametrize("text", [TITLE, RED_8BIT, CLEAR, CLIPBOARD, RIGHT_TO_LEFT, MARKUP, "A" * 10_000])
def test_a_header_in_an_error_is_shown_in_one_line(smoothed: tuple[Path, str], tmp_path: Path, text: str) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text(f"t_s,{text},y\n1,2,3\n", "utf-8")
    seen = on_terminal("evaluate", smoothed[0], "--truth", truth, code=3)
    assert unseen(seen) == set()
    assert seen.startswith(f"fbgraph: {truth}: no column x_m, y_m (found t_s, ")
    assert seen.count("\n") == 1
    assert len(seen) < 2100


def test_a_file_that_is_not_there_is_named_as_it_is_written(tmp_path: Path) -> None:
    seen = on_terminal("smooth", f"{NAME}.csv", cwd=tmp_path, code=3)
    assert unseen(seen) == set()
    assert r"w\x1b]0;PWNED\x07[red]markup[\u202eRTL \x9b31m.csv" in seen  # an error is one line: its spaces are one


def test_a_name_that_is_no_utf_8_is_a_name(log: Path, tmp_path: Path) -> None:
    other = tmp_path / "w\udc9b31m.csv"
    other.write_bytes(log.read_bytes())
    seen = on_terminal("smooth", other, "--out", tmp_path / "run").lstrip("\n")
    assert unseen(seen) == set()
    assert seen.startswith(r"w\udc9b31m (m5stickc): ")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["log"]["name"] == "w\udc9b31m"
    assert on_terminal("guide", tmp_path / "run").startswith(r"Way back of w\udc9b31m (smoothed): ")
    said = json.loads(on_terminal("guide", tmp_path / "run", "--format", "json"))
    assert said["name"] == "w\udc9b31m (smoothed)"


def test_what_was_typed_wrong_is_shown_too(tmp_path: Path) -> None:
    for wrong in (("smooth", "a.csv", f"{TITLE}.csv"), ("smooth", f"--{RED_8BIT}"), (CLEAR,)):
        seen = on_terminal(*wrong, cwd=tmp_path, code=2)
        assert unseen(seen) == set()
        assert r"\x" in seen


@pytest.mark.parametrize("format_", ["text", "json", "geojson", "gpx", "csv"])
def test_directions_on_a_terminal_are_only_text(edited: Path, tmp_path: Path, format_: str) -> None:
    arguments = ("guide", edited, "--format", format_, "--origin", "60,20")
    seen = on_terminal(*arguments)
    assert unseen(seen) == set()
    if format_ in ("geojson", "gpx"):  # a terminal shows both streams
        told, seen = seen.split("\n", 1)
        assert "declination" in told
    fbgraph(*arguments, "--out", tmp_path / "way")
    assert (tmp_path / "way").read_text("utf-8") == seen
    if format_ == "gpx":
        labels = {point.name for point in gpxpy.parse(seen).waypoints}
    elif format_ == "geojson":
        marks = [f["properties"] for f in json.loads(seen)["features"] if f["properties"]["kind"] == "landmark"]
        assert {mark["label"] for mark in marks} == set(LABELS)
        return
    elif format_ == "json":
        assert {mark["label"] for leg in json.loads(seen)["legs"] for mark in leg["landmarks"]} == set(LABELS)
        return
    elif format_ == "csv":
        rows = list(csv.DictReader(io.StringIO(seen, newline="")))
        assert all(row["landmarks"][:1] not in tuple("=+-@") for row in rows)
        return
    else:
        assert f"“{MARKUP}”" in seen
        return
    assert {MARKUP, FORMULA, "a|b"} <= labels


def test_the_recording_of_a_hostile_walk_is_whole(smoothed: tuple[Path, str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(smoothed[0] / "recording.rrd")],
        capture_output=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr


def closed_pipe(*arguments: object) -> subprocess.CompletedProcess[bytes]:
    """``fbgraph … | true``: nobody reads what it prints."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "fbgraph", *map(str, arguments)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=writer, stderr=subprocess.PIPE, timeout=120)
    os.close(writer)
    return done


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device here that is always full")
def test_a_full_disk_behind_a_redirection_is_told_and_loses_no_file(log: Path, tmp_path: Path) -> None:
    for arguments in (("formats",), ("smooth", log, "--out", tmp_path / "run", "--no-recording")):
        command = [sys.executable, "-m", "fbgraph", *map(str, arguments)]
        with open("/dev/full", "wb") as full:
            done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
        told = done.stderr.decode()
        assert done.returncode == 1
        assert told.count("standard output cannot be written (No space left on device)") == 1
        assert "Traceback" not in told
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["steps"] > 20


def test_a_pipe_that_closes_ends_quietly_and_loses_nothing(
    smoothed: tuple[Path, str], log: Path, tmp_path: Path
) -> None:
    for arguments in (
        ("guide", smoothed[0]),
        ("config",),
        ("smooth", log, "--out", tmp_path / "batch", "--no-recording"),
        ("online", log, "--follow", "--out", tmp_path / "online", "--no-recording"),
        ("formats",),
    ):
        done = closed_pipe(*arguments)
        assert (done.returncode, done.stderr) == (0, b"")
    steps = [json.loads((tmp_path / run / "summary.json").read_text())["steps"] for run in ("batch", "online")]
    assert steps[0] == steps[1] > 20


@pytest.mark.parametrize(
    ("io_encoding", "locale", "utf8_mode"), [("ascii", "C.UTF-8", "1"), ("", "C", "0")], ids=["ascii", "C"]
)
def test_an_encoding_that_lacks_a_character_is_no_failure(
    smoothed: tuple[Path, str], tmp_path: Path, io_encoding: str, locale: str, utf8_mode: str
) -> None:
    def ended(*arguments: object, code: int = 0) -> subprocess.CompletedProcess[str]:
        return fbgraph_process(
            *arguments,
            code=code,
            PYTHONIOENCODING=io_encoding,
            LC_ALL=locale,
            PYTHONUTF8=utf8_mode,
            PYTHONCOERCECLOCALE="0",
        )

    told = ended("guide", smoothed[0]).stdout
    assert told.isascii()
    assert r"face 0" in told
    assert r"\xb0" in told  # °
    said = ended("guide", smoothed[0], "--format", "json").stdout
    assert json.loads(said)["legs"][0]["instruction"].count("°") == 1
    assert ended("smooth", tmp_path / "Café.csv", code=3).stderr.isascii()


def test_examples_of_formats_can_be_copied() -> None:
    printed = fbgraph("formats").stdout
    for name in FORMATS:
        assert "".join(f"    {line}\n" for line in log_format(name).example.strip().splitlines()) in printed


def test_cells_of_tables_are_no_markup(capfd: pytest.CaptureFixture[str]) -> None:
    print_table(["estimator", "end [red]x[/red]"], [[MARKUP, TITLE], ["A" * 10_000, ":smile:"]])
    printed = capfd.readouterr().out
    assert unseen(printed) == set()
    for shown in (MARKUP, r"\x1b]0;PWNED\x07", ":smile:", "end [red]x[/red]"):
        assert shown in printed


def test_a_notebook_shows_names_as_text(edited: Path) -> None:
    walk = load_run(edited)
    assert unseen(repr(walk)) == set()
    assert repr(walk).startswith(r"<Walk \x1b]0;PWNED\x07")
    page = walk._repr_html_()
    assert "PWNED" not in page
    assert page.startswith("<table><tr><th></th><th>distance m</th>")
