"""What the accuracy table is made of, and that a mean that got worse is told."""

import csv
import shutil
import tomllib
from pathlib import Path

import accuracy
import numpy as np
import pytest
from scored_walks import FoundLog, ModeScore, ScoredWalk, errors_after_first, find_logs, with_buildings

from fbgraph.core.building_files import parse_building_axis
from fbgraph.core.checkpoints import checkpoints


def walk(name: str, ekf_m: float, errors_m: list[float], nees: list[float]) -> ScoredWalk:
    error = np.array(errors_m)
    rmse_m = float(np.sqrt((error**2).mean()))
    return ScoredWalk("hall", name, "sound", {"unaided": ModeScore(2.0, ekf_m, 1.5, rmse_m, error, np.array(nees))})


WALKS = [
    walk("a", 3.0, [1.0, 1.0, 1.0], [0.1, 7.0, 2.0]),
    walk("b", 4.0, [2.0, 2.0], [1.0, 1.0]),
    walk("c", 5.0, [3.0], [6.1]),
]


def test_a_mean_is_over_logs_and_circles_over_checkpoints() -> None:
    row = accuracy.mean_row("hall", WALKS)
    assert row["unaided"] == pytest.approx(2.0)
    assert row["less ekf unaided"] == pytest.approx(-2.0)
    assert (row["unaided low"], row["unaided high"]) == pytest.approx((-2.0, -2.0))
    assert (row["ce50"], row["ce75"], row["ce95"]) == (1.0, 2.0, 3.0)
    assert (row["inside_95"], row["of"], row["checkpoints"]) == (4, 6, 6)
    assert row["nees"] == pytest.approx(17.2 / 6.0)
    assert row["verdict"] == "3 sound"


def test_the_interval_of_the_difference_holds_the_spread_of_logs() -> None:
    rng = np.random.default_rng(3)
    many = [walk(str(k), 3.0, [3.0 + d], [1.0]) for k, d in enumerate(rng.normal(0.0, 0.5, 100).tolist())]
    row = accuracy.mean_row("hall", many)
    assert row["unaided high"] - row["unaided low"] == pytest.approx(2 * 1.96 * 0.5 / 10.0, rel=0.2)


def test_a_track_in_a_frame_of_its_own_is_fitted_over_its_first_five_seconds() -> None:
    t_s = np.arange(0.0, 20.5, 0.5)
    truth = checkpoints(t_s + 1e9, t_s, np.where(t_s > 10.0, t_s - 10.0, 0.0))
    turned = (truth.x_m + 1j * truth.y_m) * np.exp(0.7j) + 5.0 - 3.0j
    late = np.where(t_s > 15.0, 2.0, 0.0)
    errors = errors_after_first(np.column_stack((turned.real, turned.imag + late)), truth)
    assert len(errors) == (t_s > 5.0).sum()
    np.testing.assert_allclose(errors, late[t_s > 5.0], atol=1e-6)


def test_logs_are_found_in_folders_and_folders_of_sensor_files_are_logs(tmp_path: Path) -> None:
    for name in ("mine/walk.csv", "mine/walk_truth.csv", "mine/README.md", "lab/one/acc.csv", "lab/one/gyr.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = [(str(one.path.relative_to(tmp_path)), one.group) for one in find_logs(tmp_path)]
    assert found == [("lab/one", "lab"), ("mine/walk.csv", "mine")]
    assert [one.group for one in find_logs(tmp_path / "mine")] == ["mine"]


def test_logs_get_the_building_that_is_named_and_few_tell_none(tmp_path: Path) -> None:
    found = [FoundLog(tmp_path / str(k), "lab") for k in range(4)]
    assert [one.building for one in with_buildings(found)] == [None] * 4
    named = parse_building_axis("70,2")
    assert [one.building for one in with_buildings(found, named)] == [named] * 4


def test_a_mean_may_be_three_per_cent_worse_and_no_more(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "baseline.toml"

    def now(by: float) -> dict[str, accuracy.Row]:
        row = accuracy.as_baseline(WALKS)
        return {"hall": row | {"mean_m": {mode: by * value for mode, value in row["mean_m"].items()}}}

    assert accuracy.write_baseline(file, now(1.0), "") == 0
    assert accuracy.check(file, now(1.029)) == 0
    assert accuracy.check(file, now(1.04)) == 1
    assert "FAILED: hall, unaided: 2.00 → 2.08 m, 4.0 % worse" in capsys.readouterr().out
    assert accuracy.write_baseline(file, now(1.04), " ") == 1
    assert accuracy.write_baseline(file, now(1.04), "stairs are told") == 0
    assert accuracy.check(file, now(1.04)) == 0
    assert "accepted: stairs are told" in capsys.readouterr().out
    assert accuracy.check(file, now(1.05)) == 1
    assert accuracy.write_baseline(file, now(1.0), "") == 0
    assert accuracy.check(file, now(1.04)) == 1
    other = {"hall": accuracy.as_baseline(WALKS[:2])}
    assert accuracy.check(file, other) == 2


def test_real_logs_are_scored_saved_and_checked(shared_data: Path, tmp_path: Path) -> None:
    floor = shared_data / "indoor-location" / "site1" / "F1"
    logs = ("5dd9fd63c5b77e0006b173e0.txt.gz", "5dd9fd4fc5b77e0006b173d0.txt.gz", "5dd9e7c6c5b77e0006b17339.txt.gz")
    for name in logs:
        (tmp_path / "logs").mkdir(exist_ok=True)
        shutil.copyfile(floor / name, tmp_path / "logs" / name)
    (tmp_path / "logs" / "nothing.csv").write_text("a,b\n1,2\n")
    out, baseline = tmp_path / "table.csv", tmp_path / "baseline.toml"
    asked = [str(tmp_path / "logs"), "--baseline", str(baseline)]
    assert accuracy.main([*asked, "--out", str(out), "--write-baseline"]) == 0
    *rows, mean = list(csv.DictReader(out.open(encoding="utf-8")))
    assert [row["log"] for row in rows] == sorted(name.partition(".")[0] for name in logs)
    for mode in ("pdr", "ekf", "online", "unaided", "aligned", "anchored", "start_place"):
        assert float(mean[mode]) == pytest.approx(np.mean([float(row[mode]) for row in rows]), abs=1e-3)
    assert float(mean["aligned"]) < float(mean["unaided"])
    assert mean["axis"] == ""  # three walks tell no axis
    assert float(mean["unaided_low"]) <= float(mean["less_ekf_unaided"]) <= float(mean["unaided_high"])
    held = tomllib.loads(baseline.read_text("utf-8"))
    better = {mode: 0.9 * value for mode, value in held["logs"]["mean_m"].items()}
    now = {"logs": held["logs"] | {"mean_m": better}}
    assert accuracy.write_baseline(baseline, now, "") == 0
    assert accuracy.check(baseline, held) == 1
