"""The command line as a user meets it: what is typed, what is printed, what is written, how it ends."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.commands import fbgraph, fbgraph_process

from fbgraph.core.tum_files import read_tum


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated M5StickC log; its truth lies beside it."""
    folder = tmp_path_factory.mktemp("walk")
    fbgraph("simulate", folder / "walk.csv", "--route", "square", "--seed", 3)
    return folder / "walk.csv"


def test_smooth_writes_the_run_folder_and_says_what_it_found(walk: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    printed = fbgraph_process("smooth", walk, "--out", out, "--truth", walk.with_name("walk_truth.csv")).stdout
    assert {path.name for path in out.iterdir()} == {
        *("pdr.tum", "ekf.tum", "smoothed.tum", "breadcrumbs.csv", "summary.json", "config.toml", "recording.rrd"),
        "truth.tum",
    }
    for word in ("steps", "turns", "altitude", "pdr", "ekf", "smoothed", "RMSE", "unaided", str(out)):
        assert word in printed
    summary = json.loads((out / "summary.json").read_text())
    smoothed = read_tum(out / "smoothed.tum")
    assert len(smoothed) == summary["steps"] + 1
    assert summary["estimators"]["smoothed"]["score"]["rmse_m"] < 4.0
    crumbs = np.genfromtxt(out / "breadcrumbs.csv", delimiter=",", names=True)
    assert crumbs.dtype.names == (
        *("k", "t_s", "x_m", "y_m", "z_m", "yaw_rad", "gyro_bias_rad_s"),
        *("sigma_x_m", "sigma_y_m", "cov_xy_m2", "sigma_z_m", "sigma_yaw_rad"),
    )
    assert np.allclose(crumbs["x_m"], smoothed.x_m, atol=1e-5)
    assert np.allclose(crumbs["t_s"], smoothed.t_s, atol=1e-5)
    # the run's own configuration gives the same run
    again = tmp_path / "again"
    fbgraph("smooth", walk, "--out", again, "--config", out / "config.toml", "--no-recording")
    assert (again / "smoothed.tum").read_text() == (out / "smoothed.tum").read_text()


def test_json_is_json_and_logs_go_elsewhere(walk: Path, tmp_path: Path) -> None:
    done = fbgraph("smooth", walk, "--out", tmp_path / "run", "--json", "--no-recording")
    summary = json.loads(done.stdout)
    assert summary["out"] == str(tmp_path / "run")
    assert done.stderr == ""
    scored = json.loads(
        fbgraph("evaluate", tmp_path / "run", "--truth", walk.with_name("walk_truth.csv"), "--json").stdout
    )
    assert set(scored) == {"pdr", "ekf", "smoothed"}
    assert scored["smoothed"]["label"] == "unaided"


def test_the_same_command_again_replaces_its_run_and_nothing_else(walk: Path, tmp_path: Path) -> None:
    for _ in range(2):
        fbgraph("smooth", walk, "--out", tmp_path / "run", "--no-recording")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    done = fbgraph("smooth", walk, "--out", tmp_path / "mine", "--no-recording", code=2)
    assert "not a run folder" in done.stderr
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years of work"


def test_out_defaults_to_runs_and_the_log_name(walk: Path, tmp_path: Path) -> None:
    fbgraph("smooth", walk, "--no-recording", cwd=tmp_path)
    assert (tmp_path / "runs" / "walk" / "smoothed.tum").is_file()


def test_closed_loop_and_anchors_are_labelled(walk: Path, tmp_path: Path) -> None:
    truth = walk.with_name("walk_truth.csv")
    closed = json.loads(
        fbgraph(
            "smooth", walk, "--out", tmp_path / "a", "--closed-loop", "--truth", truth, "--json", "--no-recording"
        ).stdout
    )
    assert closed["estimators"]["smoothed"]["score"]["label"] == "closed"
    assert np.hypot(*closed["estimators"]["smoothed"]["end_m"][:2]) < 2.0
    assert closed["estimators"]["ekf"]["score"]["label"] == "unaided"
    rows = truth.read_text().splitlines()
    anchors = tmp_path / "anchors.csv"
    anchors.write_text("t_s,x_m,y_m\n" + "\n".join(",".join(row.split(",")[:3]) for row in rows[1::60]) + "\n")
    anchored = json.loads(
        fbgraph(
            "smooth", walk, "--out", tmp_path / "b", "--anchors", anchors, "--truth", truth, "--json", "--no-recording"
        ).stdout
    )
    assert anchored["estimators"]["smoothed"]["score"]["label"] == "anchored"
    assert anchored["estimators"]["smoothed"]["score"]["rmse_m"] < 0.7


def test_the_same_seed_simulates_the_same_walk(tmp_path: Path) -> None:
    for name in ("a", "b"):
        fbgraph("simulate", tmp_path / f"{name}.csv", "--route", "obstacle", "--seed", 5)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert (tmp_path / "a_truth.csv").read_bytes() == (tmp_path / "b_truth.csv").read_bytes()


def test_config_prints_what_was_set_and_refuses_what_it_does_not_know() -> None:
    assert "lambda_sigma = 0.9" in fbgraph("config", "--set", "steps.lambda_sigma=0.9").stdout
    assert json.loads(fbgraph("config", "--config", "m5stickc", "--json").stdout)["step_length"]["kappa_surge"] == 0.0
    assert "steps.lamda" in fbgraph("config", "--set", "steps.lamda=1", code=2).stderr
    assert "nosuch" in fbgraph("config", "--config", "nosuch", code=2).stderr


def test_formats_and_version() -> None:
    names = {entry["name"] for entry in json.loads(fbgraph("formats", "--json").stdout)}
    assert {"m5stickc", "getsensordata", "indoor_location"} <= names
    assert fbgraph("--version").stdout.startswith("fbgraph 0.")
    fbgraph("smooth", "--nonsense", code=2)


def test_a_walk_without_magnetometer_and_barometer(walk: Path, tmp_path: Path) -> None:
    lines = walk.read_text().splitlines()
    bare = tmp_path / "bare.csv"
    bare.write_text("\n".join(",".join(line.split(",")[:7]) for line in lines) + "\n")
    printed = fbgraph("smooth", bare, "--out", tmp_path / "run").stdout
    assert "no magnetometer" in printed
    assert "no barometer" in printed
    smoothed = read_tum(tmp_path / "run" / "smoothed.tum")
    assert np.isfinite(smoothed.xy_m).all()
    assert np.allclose(smoothed.z_m, 0.0)
