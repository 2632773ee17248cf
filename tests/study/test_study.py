"""The paper's evaluation by one command: the same numbers from simulation and from its exported trials."""

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from fbgraph.cli import main
from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.study.calibration import Evidence, fit
from fbgraph.study.column_names import load_layout
from fbgraph.study.comparison import interval_of_mean, paired
from fbgraph.study.course import simulated_trials
from fbgraph.study.dataset import read_dataset
from fbgraph.study.protocol import LABELS, match_turns, turn_events
from fbgraph.study.report import summary
from fbgraph.study.run_study import run_study, study_files, study_folder
from fbgraph.study.trial import Turns

CONFIG = load_config("forestback")
LAYOUT = load_layout("forestback")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The whole study of 36 simulated trials, and what it printed as JSON."""
    out = tmp_path_factory.mktemp("study") / "out"
    command = [sys.executable, "-m", "fbgraph", "study", "simulated", "--seed", "1", "--out", str(out), "--json"]
    return out, json.loads(subprocess.run(command, capture_output=True, check=True).stdout)


def test_the_smoother_beats_the_papers_method_on_the_papers_course(simulated: tuple[Path, dict[str, Any]]) -> None:
    _, found = simulated
    overall = found["overall"]
    assert found["trials"] == 36
    assert found["samples"] == pytest.approx(42_474, rel=0.05)
    assert overall["pdr"]["rmse_m"] == pytest.approx(1.129, rel=0.1)  # what the noise was set by
    assert overall["ekf"]["rmse_m"] < overall["pdr"]["rmse_m"]
    assert overall["smoothed"]["rmse_m"] <= 0.85 * overall["ekf"]["rmse_m"]
    assert overall["smoothed"]["held_out_rmse_m"] <= 0.85 * overall["ekf"]["held_out_rmse_m"]
    assert overall["smoothed"]["turn_consistency_percent"] >= 99.9
    assert overall["finished"]["rmse_m"] == pytest.approx(overall["smoothed"]["rmse_m"], abs=1e-3)
    by_pair = {(pair["better"], pair["worse"]): pair for pair in found["paired"]}
    assert by_pair["smoothed", "ekf"]["high_m"] < 0.0


def test_every_output_is_there_and_says_that_it_is_simulated(simulated: tuple[Path, dict[str, Any]]) -> None:
    out, found = simulated
    assert {path.name for path in out.iterdir()} == {
        *("report.html", "table.csv", "table.md", "table.tex", "trials.csv", "summary.json", "config.toml"),
        *("study.rrd", "figures", "trials"),
    }
    figures = sorted(path.stem for path in (out / "figures").glob("*.png"))
    assert figures == ["heading", "heatmap", "progress", "rmse", "trajectory"]
    assert all(path.read_bytes()[:4] == b"\x89PNG" for path in (out / "figures").iterdir())
    report = (out / "report.html").read_text()
    assert report.count("data:image/png;base64,") == len(figures)
    assert report.count("src=") == len(figures)  # and nothing to be fetched
    assert "href=" not in report
    assert "://" not in report
    for text in (report, (out / "table.md").read_text(), (out / "table.tex").read_text(), json.dumps(found)):
        assert "imulated" in text
    rows = list(csv.DictReader((out / "trials.csv").read_text().splitlines()))
    assert len(rows) == 36 * 5
    assert all(row["simulated"] == "1" for row in rows)
    assert all((out / "trials" / f"trial_{k:02d}.csv").read_text().startswith("# simulated") for k in range(1, 37))
    assert b"SIMULATED" in (out / "study.rrd").read_bytes()
    rerun = Path(sys.executable).with_name("rerun")
    assert subprocess.run([rerun, "rrd", "verify", out / "study.rrd"], capture_output=True, check=False).returncode == 0


def test_the_exported_trials_give_the_same_numbers(simulated: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    out, found = simulated
    shutil.copytree(out / "trials", tmp_path / "copy")
    again = summary(run_study(read_dataset(tmp_path / "copy", LAYOUT), CONFIG))
    for key in again.keys() - {"source"}:
        assert json.loads(json.dumps(again[key])) == found[key], key
    assert again["simulated"]  # the tables say so themselves


@pytest.fixture(scope="module")
def few(simulated: tuple[Path, dict[str, Any]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three trials with the authors' outputs and current, one in which nobody walks, one that is no trial."""
    folder = tmp_path_factory.mktemp("few")
    for k in (1, 2, 3):
        table = pd.read_csv(simulated[0] / "trials" / f"trial_{k:02d}.csv", comment="#")
        table = table.assign(pdr_x=table["gt_x_m"], pdr_y=table["gt_y_m"] + 0.1 * k, fb_x=table["gt_x_m"] + 0.05 * k)
        table.assign(fb_y=table["gt_y_m"], current_ma=60.0 + k).to_csv(folder / f"trial_{k}.csv", index=False)
    still = np.random.default_rng(0).normal(table[[f"acc_{axis}_ms2" for axis in "xyz"]].iloc[0], 0.02, (len(table), 3))
    table.assign(**dict(zip(("acc_x_ms2", "acc_y_ms2", "acc_z_ms2"), still.T, strict=True))).to_csv(
        folder / "trial_4.csv", index=False
    )
    (folder / "notes.csv").write_text("a,b\n1,2\n")
    return folder


def test_what_the_authors_logged_is_scored_and_a_trial_without_steps_is_named(few: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = study_files(str(few), out, CONFIG, LAYOUT)
    overall = result.comparison.overall
    assert list(overall) == list(LABELS)
    assert overall["logged_pdr"].rmse_m == pytest.approx(0.2)
    assert overall["logged_forestback"].rmse_m == pytest.approx(0.1)
    assert overall["logged_forestback"].improvement_percent == pytest.approx(50.0)
    assert overall["logged_forestback"].turn_consistency_percent == 100.0
    assert result.comparison.current is not None
    assert result.comparison.current.mean_ma == pytest.approx(62.0, abs=0.2)
    skipped = dict(result.skipped)
    assert skipped["trial_4"].startswith("no step")
    assert skipped["notes"].startswith("no column for acc_x")
    report = (out / "report.html").read_text()
    assert "trial_4</b>: no step" in report
    assert "logged ForestBack" in report
    for text in (
        report.split("</style>")[1].replace(str(out), ""),
        (out / "table.md").read_text(),
        (out / "table.tex").read_text(),
    ):
        assert "imulated" not in text
    assert not (out / "trials").exists()


def test_a_map_whose_north_is_another_is_noticed(few: Path, tmp_path: Path) -> None:
    for k in (1, 2):
        table = pd.read_csv(few / f"trial_{k}.csv")
        east = table.assign(
            gt_x_m=table["gt_y_m"], gt_y_m=-table["gt_x_m"], gt_heading_rad=table["gt_heading_rad"] - np.pi / 2
        )
        east.drop(columns=["pdr_x", "fb_x"]).to_csv(tmp_path / f"{k}.csv", index=False)
    (notice,) = [n for n in run_study(read_dataset(tmp_path, LAYOUT), CONFIG).notices if "map_yaw_deg" in n]
    found_deg = float(notice.split("map_yaw_deg=")[1].split(",")[0])
    assert found_deg == pytest.approx(90.0, abs=15.0)
    turned = load_layout("forestback", [f"dataset.map_yaw_deg={found_deg}"])
    result = run_study(read_dataset(tmp_path, turned), CONFIG)
    assert not any("map_yaw_deg" in n for n in result.notices)
    assert result.comparison.overall["smoothed"].rmse_m < 2.0


def test_bad_requests_end_in_one_line(
    few: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine"
    (mine / "trials").mkdir(parents=True)
    mapping = tmp_path / "m.toml"
    mapping.write_text("[dataset.columns]\naccx = 'a'\n")
    for code, arguments in (
        (3, (tmp_path / "nowhere", "--out", tmp_path / "o")),
        (3, (few / "notes.csv", "--out", tmp_path / "o")),
        (3, (few / "trial_4.csv", "--out", tmp_path / "o")),
        (2, (few, "--out", mine)),
        (2, (few, "--out", tmp_path / "o", "--mapping", mapping)),
        (2, (few, "--out", tmp_path / "o", "--seed", 1)),
        (2, ("simulated", "--out", tmp_path / "o", "--seed", -1)),
    ):
        monkeypatch.setattr(sys, "argv", ["fbgraph", "study", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == code
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert said.startswith("fbgraph: ")
    assert not (tmp_path / "o").exists()
    assert list(tmp_path.glob(".*")) == []


def test_a_study_never_replaces_what_it_reads(few: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="would replace"):
        study_files(str(few), few, CONFIG, LAYOUT)

    def give_up() -> None:
        with study_folder(tmp_path / "half") as folder:
            (folder / "report.html").write_text("x")
            raise DataError("on purpose")

    with pytest.raises(DataError, match="on purpose"):
        give_up()
    assert list(tmp_path.iterdir()) == []


def test_step_lengths_are_fitted_by_least_squares_and_lambda_by_counts() -> None:
    rng = np.random.default_rng(1)
    frequency, slope = rng.uniform(1.5, 2.2, 40), rng.uniform(0.0, 0.3, 40)
    rows = np.column_stack((frequency, slope, 0.3 + 0.2 * frequency - 1.1 * slope))
    flat = np.column_stack((frequency, np.zeros(40), 0.3 + 0.2 * frequency))
    counts = {0.1: 3, 0.4: 0, 0.9: 0, 1.0: 5}
    model = fit({value: [Evidence(rows, wrong)] for value, wrong in counts.items()}, CONFIG)
    assert (model.alpha_m, model.beta_m_s, model.gamma_m) == pytest.approx((0.3, 0.2, -1.1))
    assert model.constant_m == pytest.approx(rows[:, 2].mean())
    assert model.lambda_sigma == 0.4  # no step too many or too few, and nearest to the configured 0.2
    level = fit({0.2: [Evidence(flat, None)]}, CONFIG)
    assert level.kept == ("gamma_m",)
    assert level.gamma_m == CONFIG.step_length.gamma_m
    applied = level.apply(CONFIG).step_length
    assert (applied.beta2_m_s2, applied.kappa_surge) == (0.0, 0.0)
    with pytest.raises(DataError, match="nothing to fit"):
        fit({0.2: [Evidence(np.empty((0, 3)), 4)]}, CONFIG)


def test_turns_are_found_in_a_heading_and_paired_with_labels() -> None:
    t_s = np.arange(0.0, 12.0, 0.01)
    heading = np.interp(t_s, [3.0, 4.0, 6.0, 7.0, 9.0, 10.0], np.radians([45.0, 0.0, 0.0, -90.0, -90.0, -70.0]))
    found = turn_events(t_s, heading + np.radians(3.0) * np.sin(2 * np.pi * 0.9 * t_s))
    assert found.side.tolist() == [-1.0, -1.0]  # the last bend is too slight
    assert np.allclose(found.t_s, [3.5, 6.5], atol=0.2)
    score = match_turns(found, Turns(np.array([3.4, 6.4, 9.5]), np.array([-1.0, 1.0, 1.0])))
    assert (score.matched, score.missed, score.false) == (1, 2, 1)
    assert score.late_s[0] == pytest.approx(0.1, abs=0.2)
    nothing = match_turns(Turns(np.empty(0), np.empty(0)), Turns(np.empty(0), np.empty(0)))
    assert (nothing.matched, nothing.missed, nothing.false) == (0, 0, 0)


def test_comparisons_are_paired() -> None:
    rng = np.random.default_rng(2)
    worse = rng.uniform(0.5, 3.0, 30)
    better = worse - rng.uniform(0.0, 0.2, 30)
    pair = paired("smoothed", "ekf", better, worse)
    assert pair.wins == pair.trials == 30
    assert pair.low_m < pair.difference_m < pair.high_m < 0.0
    assert pair.wilcoxon_p < 1e-6
    assert pair.t_p < 1e-6
    same = paired("a", "b", worse, worse)
    assert np.isnan(same.t_p)
    assert np.isnan(interval_of_mean(np.array([1.0, 2.0]))).all()
    assert interval_of_mean(np.full(5, 2.0)) == (2.0, 2.0)


def test_the_course_never_repeats_a_trial_and_always_repeats_a_seed() -> None:
    (_, one, _), (_, two, _) = simulated_trials(1, 2)
    ((_, again, _),) = simulated_trials(1, 1)
    assert np.array_equal(one.device_m, again.device_m)
    assert not np.array_equal(one.steps.length_m, two.steps.length_m)
    assert one.labels == ("A", "B", "C", "D", "E")
    assert len(one.turns.t_s) == 3
