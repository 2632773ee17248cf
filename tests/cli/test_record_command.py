"""Opening, comparing and writing recordings again; the same layout live; life without rerun."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from fbgraph.core.config import load_config
from fbgraph.readers import read_log
from fbgraph.recording.blueprint import blueprint, question_tabs
from fbgraph.recording.live_view import LiveView
from fbgraph.recording.recorder import write_recording
from fbgraph.recording.writer import RrdWriter
from fbgraph.run.result import WalkResult
from fbgraph.run.summary import summarize, summary_markdown
from fbgraph.session import replay


def fbgraph(*arguments: object, code: int = 0, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fbgraph", *map(str, arguments)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120, env={**os.environ, **environment}
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    return done


def rrd(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rerun", "rrd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def entities(path: Path) -> set[str]:
    return {chunk.entity_path.lstrip("/") for chunk in RrdReader(path).stream().to_chunks()}


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
    command = [sys.executable, "-m", "fbgraph", "online", "--source", "stdin", "--out", str(run)]
    lines = (folder / "walk.csv").read_bytes()
    subprocess.run(command, input=lines, check=True, capture_output=True, timeout=120)
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
    assert "--save" in fbgraph("view", folder / "smooth", "--save", tmp_path / "no" / "x.rrd", code=2).stderr


@pytest.fixture(scope="module")
def live_and_file(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, WalkResult]:
    """One walk, shown piece by piece while it was walked, and recorded afterwards."""
    out = tmp_path_factory.mktemp("live")
    log = read_log(folder / "walk.csv").log
    stream = RrdWriter("live")
    view = LiveView(load_config("m5stickc"), rrd=stream)
    result = replay(
        log,
        load_config("m5stickc"),
        chunk_s=0.5,
        speed=np.inf,
        on_update=lambda update: None,
        stop=lambda: False,
        view=view,
    )
    stream.save(out / "live.rrd", blueprint(stream.entities))
    write_recording(result, out / "file.rrd", summary_markdown(summarize(result)))
    return out / "live.rrd", out / "file.rrd", result


def test_live_and_file_show_the_same_things_in_the_same_layout(live_and_file: tuple[Path, Path, WalkResult]) -> None:
    live, file, _ = live_and_file
    assert entities(live) == entities(file)
    names = [[str(tab.name) for tab in question_tabs(entities(path), None)] for path in (live, file)]
    assert names[0] == names[1]
    assert "While walking" in names[0]


def test_live_and_file_hold_the_same_numbers(live_and_file: tuple[Path, Path, WalkResult]) -> None:
    """Every sample, step and state once, whatever the pieces."""

    def rows(path: Path, entity: str, component: str) -> np.ndarray:
        values = []
        for chunk in RrdReader(path).stream().to_chunks():
            batch = chunk.to_record_batch()
            if chunk.entity_path.lstrip("/") == entity and component in batch.schema.names and not chunk.is_static:
                values += [np.asarray(row, dtype=float).ravel() for row in batch.column(component).to_pylist()]
        return np.array([row for row in values if len(row)])

    live, file, _ = live_and_file
    for entity in ("sensors/acc", "sensors/mag", "state/altitude_m/barometer", "state/gyro_bias_deg_s/ekf"):
        name = "Scalars:scalars"
        np.testing.assert_allclose(rows(live, entity, name), rows(file, entity, name), atol=1e-9, err_msg=entity)
    for entity in ("world/online/position", "world/pdr/position", "world/smoothed/position"):
        name = "Points3D:positions"
        np.testing.assert_allclose(rows(live, entity, name), rows(file, entity, name), atol=1e-6, err_msg=entity)


def test_beliefs_end_where_the_walk_was_and_do_not_disturb_it(live_and_file: tuple[Path, Path, WalkResult]) -> None:
    _, _, result = live_and_file
    online, beliefs = result.trajectories["online"], result.beliefs
    assert len(beliefs) >= (len(online) - 1) // 5 - 1
    for belief in beliefs:
        assert belief.first + len(belief.xy_m) == belief.k + 1
        np.testing.assert_allclose(belief.xy_m[-1], online.xy_m[belief.k], atol=0.05)
    unseen = replay(
        result.log,
        result.config,
        chunk_s=0.5,
        speed=np.inf,
        on_update=lambda update: None,
        stop=lambda: False,
        recording=False,
    )
    assert unseen.beliefs == ()
    np.testing.assert_array_equal(unseen.trajectories["online"].xy_m, online.xy_m)


def test_without_rerun_a_walk_is_smoothed_and_says_so(folder: Path, tmp_path: Path) -> None:
    """A Python that has no rerun: a folder early on its path hides the package."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text("import sys\nsys.modules['rerun'] = None\n", "utf-8")
    run = tmp_path / "run"
    printed = fbgraph("smooth", folder / "walk.csv", "--out", run, PYTHONPATH=str(site)).stdout
    assert "rerun-sdk is not installed" in printed
    assert not (run / "recording.rrd").exists()
    assert (run / "smoothed.tum").read_text() == (folder / "smooth" / "smoothed.tum").read_text()
    assert "rerun-sdk" in json.loads((run / "summary.json").read_text())["warnings"][-1]
    for command in (("view", run), ("record", run), ("online", folder / "walk.csv", "--view")):
        assert "rerun-sdk" in fbgraph(*command, code=2, PYTHONPATH=str(site)).stderr


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
    command = [sys.executable, "-m", "fbgraph", "online", "--source", "stdin", "--out", str(run)]
    lines = (folder / "walk.csv").read_bytes()
    subprocess.run(command, input=lines, check=True, capture_output=True, timeout=120)
    assert "raw.csv" in fbgraph("smooth", run / "raw.csv", "--out", run, code=2).stderr
    again = subprocess.run(command, input=b"", check=False, capture_output=True, timeout=120)
    assert again.returncode == 2
    assert (run / "raw.csv").read_bytes() == lines
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
