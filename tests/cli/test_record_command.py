"""Opening, comparing and writing recordings again; a run's own files; life without rerun."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from rerun.chunk import RrdReader
from support.commands import fbgraph, fbgraph_process, rrd
from support.recordings import entities


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log with its truth, and two runs of it: smoothed, and online."""
    folder = tmp_path_factory.mktemp("viewing")
    fbgraph("simulate", folder / "walk.csv", "--route", "square", "--seed", 3)
    log, truth = folder / "walk.csv", folder / "walk_truth.csv"
    fbgraph("smooth", log, "--truth", truth, "--origin", "49.4613,11.1110", "--out", folder / "smooth")
    fbgraph("online", log, "--truth", truth, "--closed-loop", "--out", folder / "online")
    return folder


@pytest.mark.parametrize("run", ["smooth", "online"])
def test_record_writes_the_same_recording_again(folder: Path, tmp_path: Path, run: str) -> None:
    again = tmp_path / "again.rrd"
    assert str(again) in fbgraph("record", folder / run, "--out", again).stdout
    compared = rrd("compare", folder / run / "recording.rrd", again)
    assert compared.returncode == 0, compared.stderr[-500:]


def test_record_after_no_recording_and_with_a_log_that_moved(folder: Path, tmp_path: Path) -> None:
    log = shutil.copy(folder / "walk.csv", tmp_path / "walk.csv")
    run = tmp_path / "run"
    fbgraph("smooth", log, "--out", run, "--no-recording")
    assert not (run / "recording.rrd").exists()
    assert "record" in fbgraph("view", run, code=3).stderr
    moved = Path(log).rename(tmp_path / "moved.csv")
    assert "--log" in fbgraph("record", run, code=3).stderr
    fbgraph("record", run, "--log", moved)
    assert rrd("verify", run / "recording.rrd").returncode == 0


def test_record_refuses_another_walk_under_the_old_name(folder: Path, tmp_path: Path) -> None:
    run, log = tmp_path / "run", tmp_path / "walk.csv"
    shutil.copy(folder / "walk.csv", log)
    fbgraph("smooth", log, "--out", run)
    before = (run / "recording.rrd").read_bytes()
    fbgraph("simulate", log, "--route", "square", "--seed", 4)
    assert "another walk" in fbgraph("record", run, code=3).stderr
    assert (run / "recording.rrd").read_bytes() == before


def test_a_live_walk_is_recorded_again_from_its_raw_lines(folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "live"
    lines = (folder / "walk.csv").read_text()
    fbgraph_process("online", "--source", "stdin", "--out", run, stdin=lines)
    found = entities(run / "recording.rrd")
    (run / "recording.rrd").unlink()
    fbgraph("record", run)
    assert entities(run / "recording.rrd") == found


def test_two_runs_side_by_side(folder: Path, tmp_path: Path) -> None:
    both = tmp_path / "both.rrd"
    fbgraph("view", folder / "smooth", folder / "online" / "recording.rrd", "--save", both)
    assert rrd("verify", both).returncode == 0
    found = entities(both)
    for run in ("smooth", "online"):
        single = entities(folder / run / "recording.rrd")
        assert {f"{run}/{entity}" for entity in single} <= found
    assert len(RrdReader(both).recordings()) == 1
    assert len(RrdReader(both).blueprints()) == 1


def test_a_run_beside_itself_has_two_names(folder: Path, tmp_path: Path) -> None:
    both = tmp_path / "both.rrd"
    fbgraph("view", folder / "smooth", folder / "smooth", "--save", both)
    assert {entity.split("/")[0] for entity in entities(both)} == {"smooth", "smooth_2"}


def test_what_is_no_recording_is_told(folder: Path, tmp_path: Path) -> None:
    text = tmp_path / "text.rrd"
    text.write_text("no", "utf-8")
    assert "text.rrd" in fbgraph("view", text, folder / "smooth", "--save", tmp_path / "x.rrd", code=3).stderr
    assert "no such" in fbgraph("view", tmp_path / "absent", code=3).stderr
    assert "not a run folder" in fbgraph("view", tmp_path, code=3).stderr
    assert "not a run folder" in fbgraph("record", tmp_path, code=3).stderr
    assert "cannot write" in fbgraph("view", folder / "smooth", "--save", text / "x.rrd", code=2).stderr


def test_without_rerun_a_walk_is_smoothed_and_says_so(folder: Path, tmp_path: Path) -> None:
    """A Python that has no rerun: a folder early on its path hides the package."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text("import sys\nsys.modules['rerun'] = None\n", "utf-8")
    run = tmp_path / "run"
    told = ("--origin", "49.4613,11.1110", "--out", run)
    printed = fbgraph_process("smooth", folder / "walk.csv", *told, PYTHONPATH=str(site)).stdout
    assert "rerun-sdk is not installed" in printed
    assert not (run / "recording.rrd").exists()
    assert (run / "smoothed.tum").read_text() == (folder / "smooth" / "smoothed.tum").read_text()
    assert "rerun-sdk" in json.loads((run / "summary.json").read_text())["warnings"][-1]
    for command in (("view", run), ("record", run), ("online", folder / "walk.csv", "--view")):
        assert "rerun-sdk" in fbgraph_process(*command, code=2, PYTHONPATH=str(site)).stderr


def test_a_runs_own_files_are_not_written_over(folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    shutil.copytree(folder / "smooth", run)
    before = {path.name: path.read_bytes() for path in run.iterdir()}
    assert "own file" in fbgraph("view", run, folder / "online", "--save", run / "recording.rrd", code=2).stderr
    assert "own file" in fbgraph("record", run, "--out", run / "summary.json", code=2).stderr
    assert "own file" in fbgraph("guide", run, "--out", run / "breadcrumbs.csv", code=2).stderr
    assert {path.name: path.read_bytes() for path in run.iterdir()} == before
    (run / "recording.rrd").write_bytes(b"no")
    assert "recording.rrd" in fbgraph("view", run, "--save", tmp_path / "x.rrd", code=3).stderr
    lines = (run / "breadcrumbs.csv").read_text().splitlines()
    (run / "breadcrumbs.csv").write_text("\n".join(lines[: len(lines) // 2]) + "\n", "utf-8")
    assert "breadcrumbs" in fbgraph("guide", run, code=3).stderr


def test_the_raw_lines_of_a_live_walk_are_never_replaced(folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "live"
    lines = (folder / "walk.csv").read_text()
    fbgraph_process("online", "--source", "stdin", "--out", run, stdin=lines)
    assert "raw.csv" in fbgraph("smooth", run / "raw.csv", "--out", run, code=2).stderr
    fbgraph_process("online", "--source", "stdin", "--out", run, stdin="", code=2)
    assert (run / "raw.csv").read_text() == lines
    assert "--source" in fbgraph("online", folder / "walk.csv", "--resume", run, code=2).stderr


def test_truth_that_cannot_score_does_not_cost_the_walk(folder: Path, tmp_path: Path) -> None:
    one = tmp_path / "one.csv"
    one.write_text("t_s,x_m,y_m\n6.0,0,0\n", "utf-8")
    printed = fbgraph("smooth", folder / "walk.csv", "--truth", one, "--out", tmp_path / "a", "--no-recording").stdout
    assert "not scored" in printed
    late = tmp_path / "late.csv"
    late.write_text("t_s,x_m,y_m\n1e6,0,0\n2e6,1,1\n", "utf-8")
    arguments = (folder / "walk.csv", "--truth", late, "--no-recording")
    assert "not scored" in fbgraph("online", *arguments, "--out", tmp_path / "b").stdout
    assert (
        "outside" in fbgraph("smooth", folder / "walk.csv", "--anchors", late, "--out", tmp_path / "c", code=3).stderr
    )
