"""``fbgraph online --return-at``."""

import csv
import json
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from support.commands import fbgraph, fbgraph_process
from support.walking import route

from fbgraph.core.sensor_log import Event
from fbgraph.core.tum_files import read_tum
from fbgraph.run.folder import RETURN_HEADER
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.way_back.records import ReturnUpdate


@pytest.fixture(scope="module")
def walk() -> SimulatedWalk:
    return simulate(load_route("out-and-back"), seed=4)


def online(*arguments: object, code: int = 0, stdin: str | None = None) -> subprocess.CompletedProcess[str]:
    if stdin is not None:
        return fbgraph_process("online", *arguments, "--no-recording", code=code, stdin=stdin)
    return fbgraph("online", *arguments, "--no-recording", code=code)


def test_rows_on_disk_and_lines_on_the_screen_tell_the_same(walk: SimulatedWalk, tmp_path: Path) -> None:
    log = tmp_path / "walk.csv"
    write_m5stickc_csv(walk.log, log)
    out = tmp_path / "run"
    done = online(log, "--return-at", "auto", "--out", out, "--json")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    told = [line["returning"] for line in lines[:-1] if "returning" in line]
    assert set(told[0]) == set(ReturnUpdate.__dataclass_fields__)
    with open(out / "return.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert ",".join(rows[0]) == RETURN_HEADER
    assert len(rows) == len(told) == lines[-1]["return"]["steps"]
    assert lines[-1]["return"]["arrived_t_s"] is not None
    causal = read_tum(out / "online.tum")  # the same clock
    assert float(rows[0]["t_s"]) == pytest.approx(causal.t_s[-len(rows)], abs=1e-5)
    assert float(rows[5]["breadcrumb_t_s"]) == pytest.approx(causal.t_s[int(rows[5]["breadcrumb"])], abs=1e-5)
    refused = online(log, "--return-at", "100000", "--out", out, code=2)
    assert "another configuration; name another, or --force" in refused.stderr
    late = online(log, "--return-at", "100000", "--out", out, "--follow", "--force")
    assert "later than the last step" in late.stdout
    assert not (out / "return.csv").exists()
    bad = online(log, "--return-at", "tomorrow", "--out", out, code=2)
    assert "--return-at" in bad.stderr


def test_a_resumed_walk_is_told_the_same_way_back(walk: SimulatedWalk, tmp_path: Path) -> None:
    """The time of return is kept in the run's config.toml; steps before the interruption are matched again."""
    log = tmp_path / "walk.csv"
    write_m5stickc_csv(walk.log, log)
    lines = log.read_text().splitlines(keepends=True)
    whole, part = tmp_path / "whole", tmp_path / "part"
    live = ("--source", "stdin")
    online(*live, "--out", whole, "--return-at", "auto", stdin="".join(lines))
    cut = int(0.8 * len(lines))
    broken_off(part, whole, lines[:cut])
    online(*live, "--resume", part, stdin="".join(lines[cut:]))
    assert (part / "return.csv").read_text() == (whole / "return.csv").read_text()
    again = online(*live, "--resume", part, code=2)
    assert "that walk was finished" in again.stderr


def broken_off(place: Path, like: Path, lines: list[str]) -> None:
    """What a crash leaves of a live walk that began as another did."""
    place.mkdir()
    (place / "config.toml").write_bytes((like / "config.toml").read_bytes())
    (place / "raw.csv").write_text("".join(lines))


def test_a_walk_that_crashed_is_finished_without_its_device(tmp_path: Path) -> None:
    """And a replay lets no live walk go; the event that begins the way back has a name."""
    log = tmp_path / "walk.csv"
    there_and_back = simulate(route((0, 0), (12, 0, 12.0), (0, 0)), seed=4).log
    write_m5stickc_csv(replace(there_and_back, events=(Event(8.0, "mark"), Event(19.0, "button"))), log)
    text = log.read_text().splitlines(keepends=True)
    broken = len(text) * 8 // 10
    whole, part = tmp_path / "whole", tmp_path / "part"
    told = online(log, "--return-at", "event:button", "--out", whole, "--follow").stdout.splitlines()
    assert json.loads((whole / "summary.json").read_text())["return"]["arrived_t_s"] is not None
    steps = [line for line in told if line.startswith(" ")]
    assert max(map(len, steps)) <= 60
    assert any(line.startswith("you are back at the start, ") for line in told)
    assert any("m left  [step" in line for line in told)
    broken_off(part, whole, text[:broken])
    refused = online(log, "--out", part, "--force", code=2)
    assert "holds raw.csv, the only copy of a live walk" in refused.stderr
    assert [path.name for path in sorted(part.iterdir())] == ["config.toml", "raw.csv"]
    both = online("--finish", part, "--source", "stdin", code=2)
    assert "leave out LOG, --source" in both.stderr
    finished = online("--finish", part)
    assert f"written to {part}" in finished.stdout
    assert (part / "raw.csv").read_text() == "".join(text[:broken])
    assert "that walk was finished" in online("--finish", part, code=2).stderr
    assert online(log, "--tell", "udp://:9", code=2).stderr.count("--source") == 1


def test_another_event_begins_no_way_back(walk: SimulatedWalk, tmp_path: Path) -> None:
    log = tmp_path / "walk.csv"
    write_m5stickc_csv(walk.log.between(0.0, 15.0), log)
    done = online(log, "--return-at", "event:button", "--out", tmp_path / "run")
    assert "no event named button after walking began" in " ".join(done.stdout.split())
    assert "event:NAME" in online(log, "--return-at", "event:", "--out", tmp_path / "run", code=2).stderr
