"""The Python face: what ``import fbgraph`` offers gives what the command gives."""

import json
import re
import runpy
import subprocess
import sys
import venv
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import fbgraph
from fbgraph.simulator.files import write_m5stickc_csv, write_truth_csv

ROOT = Path(__file__).parents[1]
SIMULATED = fbgraph.simulate("obstacle", seed=3)
CLIENT = """
from pathlib import Path
import numpy as np
import fbgraph

walk: fbgraph.Walk = fbgraph.smooth(Path("walk.csv"), truth="truth.csv", config="m5stickc")
smoothed: fbgraph.Trajectory = walk.trajectories["smoothed"]
last_m: float = float(smoothed.x_m[-1])
table = smoothed.to_dataframe()
columns: list[str] = list(table.columns)
errors: dict[str, float] = {name: float(score["rmse_m"]) for name, score in walk.scores.items()}
texts: list[str] = [finding.text for finding in walk.findings]
kept: Path = walk.save("runs/walk", recording=False)
loaded: fbgraph.Walk = fbgraph.load_run(kept)
log: fbgraph.SensorLog = fbgraph.read_log("walk.csv").log
config: fbgraph.Config = fbgraph.load_config("m5stickc", ["online.window_steps=200"])
online = fbgraph.OnlineSmoother(config)
places: list[tuple[float, float]] = [(update.x_m, update.y_m) for update in online.feed(log)]
finished: fbgraph.Walk = online.finish()
simulated: fbgraph.SensorLog = fbgraph.simulate("square", seed=1).log
shift = np.abs(finished.trajectories["smoothed"].xy_m - smoothed.xy_m).max()
"""


@pytest.fixture(scope="module")
def walk() -> fbgraph.Walk:
    return fbgraph.smooth(SIMULATED.log, truth=SIMULATED.checkpoints, config="m5stickc")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    write_m5stickc_csv(SIMULATED.log, folder / "walk.csv")
    write_truth_csv(SIMULATED, folder / "truth.csv")
    return folder


def xy_m(walk: fbgraph.Walk, name: str = "smoothed") -> Any:
    return walk.trajectories[name].xy_m


def test_a_walk_is_the_same_from_path_text_table_and_log(files: Path) -> None:
    path = files / "walk.csv"
    known = xy_m(fbgraph.smooth(path))
    table = pd.read_csv(path)
    dated = table.drop(columns="t_ms").set_index(pd.to_datetime(table["t_ms"], unit="ms"))
    for log in (str(path), fbgraph.read_log(path), fbgraph.read_log(path).log, table, dated):
        assert np.array_equal(xy_m(fbgraph.smooth(log)), known)


def test_a_table_in_si_units_needs_no_guess() -> None:
    log = SIMULATED.log
    columns: dict[str, Any] = {"t_s": log.acc.t_s + log.t0_s}
    for i, axis in enumerate("xyz"):
        columns |= {f"acc_{axis}_ms2": log.acc.values[:, i], f"gyro_{axis}_rads": log.gyro.values[:, i]}
    read = fbgraph.log_from_dataframe(pd.DataFrame(columns))
    assert np.allclose(read.acc.values, log.acc.values)
    assert np.allclose(read.gyro.values, log.gyro.values)
    assert np.allclose(read.acc.t_s, log.acc.t_s, atol=1e-6)
    assert not [notice for notice in read.notices if "unit" in notice]


def test_an_empty_table_is_refused() -> None:
    with pytest.raises(fbgraph.DataError, match="DataFrame is empty"):
        fbgraph.smooth(pd.DataFrame({"t_s": []}))


def test_it_says_what_the_command_says(files: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "fbgraph", "smooth", str(files / "walk.csv"), "--json", "--no-recording"]
    command += ["--truth", str(files / "truth.csv"), "--out", str(tmp_path / "run")]
    said = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    walk = fbgraph.smooth(files / "walk.csv", truth=files / "truth.csv")
    for name in ("out", "seconds"):
        said.pop(name)
    assert said == json.loads(json.dumps({name: value for name, value in walk.summary.items() if name != "seconds"}))
    assert walk.scores["smoothed"] == said["estimators"]["smoothed"]["score"]
    assert [finding.text for finding in walk.findings] == [entry["text"] for entry in said["findings"]]


def test_a_saved_walk_comes_back(walk: fbgraph.Walk, tmp_path: Path) -> None:
    loaded = fbgraph.load_run(walk.save(tmp_path / "run", recording=False))
    assert repr(loaded) == repr(walk)
    assert loaded.summary == json.loads(json.dumps(walk.summary))
    for name, trajectory in walk.trajectories.items():
        assert np.abs(loaded.trajectories[name].xy_m - trajectory.xy_m).max() < 1e-6
        assert np.abs(loaded.trajectories[name].t_s - trajectory.t_s).max() < 2e-6
    copy = fbgraph.load_run(loaded.save(tmp_path / "copy"))
    assert np.array_equal(xy_m(copy), xy_m(loaded))


def test_a_table_of_breadcrumbs_holds_their_ellipses(walk: fbgraph.Walk) -> None:
    trajectory = walk.trajectories["smoothed"]
    assert trajectory.cov_xy_yaw is not None
    row = trajectory.to_dataframe().iloc[-1]
    axis = np.array([np.cos(row.ellipse_yaw_rad), np.sin(row.ellipse_yaw_rad)])
    normal = np.array([-axis[1], axis[0]])
    cov = row.ellipse_major_m**2 * np.outer(axis, axis) + row.ellipse_minor_m**2 * np.outer(normal, normal)
    assert np.allclose(cov, trajectory.cov_xy_yaw[-1, :2, :2])
    assert row.sigma_x_m == pytest.approx(cov[0, 0] ** 0.5)
    assert row.cov_xy_m2 == pytest.approx(cov[0, 1])
    assert row.ellipse_major_m >= row.ellipse_minor_m
    bare = walk.trajectories["pdr"].to_dataframe()
    assert bare[["sigma_x_m", "ellipse_major_m", "sigma_z_m"]].isna().to_numpy().all()


def test_online_pieces_of_either_kind_end_where_the_batch_does(files: Path) -> None:
    batch = fbgraph.smooth(files / "walk.csv")
    table = pd.read_csv(files / "walk.csv")
    told = []
    online = fbgraph.OnlineSmoother("m5stickc")
    for start in range(0, len(table), 170):
        told += online.feed(table.iloc[start : start + 170])
    finished = online.finish()
    assert [update.k for update in told] == list(range(len(told)))
    assert len(finished.trajectories["online"]) == len(batch.trajectories["smoothed"])
    assert np.abs(xy_m(finished) - xy_m(batch)).max() < 1e-4
    by_log = fbgraph.OnlineSmoother("m5stickc")
    by_log.feed(fbgraph.read_log(files / "walk.csv").log)
    assert np.abs(xy_m(by_log.finish()) - xy_m(batch)).max() < 1e-4


def test_kinds_of_pieces_are_not_mixed() -> None:
    online = fbgraph.OnlineSmoother("m5stickc")
    with pytest.raises(fbgraph.ConfigError, match="nothing was fed"):
        online.finish()
    online.feed(SIMULATED.log.between(0.0, 1.0))
    with pytest.raises(fbgraph.ConfigError, match="one kind only"):
        online.feed(pd.DataFrame({"t_s": [0.0], "ax": [1.0]}))


def test_a_walk_shows_itself(walk: fbgraph.Walk) -> None:
    steps = walk.summary["steps"]
    assert re.fullmatch(rf"<Walk obstacle-3: \d+ s, {steps} steps, [\d.]+ m, [\d.]+ m RMSE>", repr(walk))
    shown = walk._repr_html_()
    assert shown.count("<polyline") == len(walk.trajectories)
    assert f"{walk.scores['ekf']['rmse_m']:.2f}" in shown


def test_every_offered_name_is_there() -> None:
    assert {"smooth", "load_run", "OnlineSmoother", "Trajectory", "ConfigError"} <= set(dir(fbgraph))
    for name in fbgraph.__all__:
        assert getattr(fbgraph, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'smoth'"):
        _ = getattr(fbgraph, "smo" + "th")


def test_the_example_runs_and_the_notebook_is_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    written = subprocess.run(
        [sys.executable, "-c", "import example_notebook as n; print(n.notebook(), end='')"],
        cwd=ROOT / "scripts",
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    saved = (ROOT / "scripts" / "example.ipynb").read_text("utf-8")
    assert saved == written, "scripts/example_notebook.py writes it again"
    cells = [cell for cell in json.loads(saved)["cells"] if cell["cell_type"] == "code"]
    script = tmp_path / "cells.py"
    script.write_text("\n".join("".join(cell["source"]) for cell in cells), "utf-8")
    ran = runpy.run_path(str(script))
    assert ran["apart_m"] < 1e-4
    assert (ran["folder"] / "walk.png").stat().st_size > 10_000


def test_a_typed_client_passes_against_the_installed_wheel(tmp_path: Path) -> None:
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    wheel = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(tmp_path), str(ROOT)]
    subprocess.run(wheel, check=True, capture_output=True)
    venv.create(tmp_path / "venv", with_pip=False)
    python = tmp_path / "venv" / "bin" / "python"
    (built,) = tmp_path.glob("*.whl")
    subprocess.run([*pip, "--python", str(python), "install", "--no-deps", str(built)], check=True)
    site = next((tmp_path / "venv" / "lib").glob("python*/site-packages"))
    (site / "libraries.pth").write_text(f"{Path(np.__file__).parents[1]}\n")
    client = tmp_path / "client.py"
    client.write_text(CLIENT)
    mypy = [sys.executable, "-m", "mypy", "--strict", "--python-executable", str(python)]
    mypy += ["--cache-dir", str(ROOT / ".mypy_cache"), client.name]
    done = subprocess.run(mypy, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    client.write_text(CLIENT.replace("last_m: float", "last_m: str"))
    wrong = subprocess.run(mypy, cwd=tmp_path, capture_output=True, text=True)
    assert "Incompatible types" in wrong.stdout
