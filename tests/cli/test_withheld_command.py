"""A walk that its own check doubts or withholds, as a user meets it: exit codes, files, words."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.commands import fbgraph

import fbgraph as package
from fbgraph.core.sensor_log import Stream
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import SimulateOptions

LEFT = {"pdr.tum", "ekf.tum", "summary.json", "config.toml"}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One walk, its gyroscope as it was, with a third of its rate, and stuck from the middle on."""
    folder = tmp_path_factory.mktemp("logs")
    log = simulate(load_route("square"), SimulateOptions(duration_s=60.0), seed=11).log
    rate, middle = log.gyro.values, int(0.4 * len(log.gyro))
    stuck = np.concatenate((rate[:middle], np.tile(rate[middle], (len(rate) - middle, 1))))
    for name, values in (("sound", rate), ("slow", 0.3 * rate), ("stuck", stuck)):
        write_m5stickc_csv(replace(log, gyro=Stream(log.gyro.t_s, values)), folder / f"{name}.csv")
    return folder


@pytest.fixture(scope="module")
def withheld(logs: Path) -> Path:
    """A run of the walk that is withheld."""
    fbgraph("smooth", logs / "stuck.csv", "--out", logs / "withheld", code=4)
    return logs / "withheld"


def test_a_sound_walk_says_so(logs: Path, tmp_path: Path) -> None:
    printed = fbgraph("smooth", logs / "sound.csv", "--out", tmp_path / "run", "--no-recording").stdout
    assert "sound: nothing in the log contradicts this walk\n" in printed
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["integrity"] == {"verdict": "sound", "widened": 1.0, "reasons": []}
    assert summary["warnings"] == []
    assert "doubtful" not in fbgraph("guide", tmp_path / "run").stdout


def test_a_withheld_walk_ends_with_exit_4_and_leaves_what_there_is_to_look_at(withheld: Path) -> None:
    assert {path.name for path in withheld.iterdir()} == LEFT | {"recording.rrd"}
    summary = json.loads((withheld / "summary.json").read_text())
    assert summary["integrity"]["verdict"] == "withheld"
    assert summary["failed"]["smoothed"].startswith("withheld, the gyroscope repeats one sample")
    assert set(summary["estimators"]) == {"pdr", "ekf"}
    weights = [reason["weight"] for reason in summary["integrity"]["reasons"]]
    assert weights == sorted(weights, reverse=True)
    texts = [finding["text"] for finding in summary["findings"]]
    assert any(text.startswith("the gyroscope repeats one sample") for text in texts)


def test_it_is_said_on_the_terminal(logs: Path, tmp_path: Path) -> None:
    done = fbgraph("smooth", logs / "stuck.csv", "--out", tmp_path / "run", "--no-recording", code=4)
    assert "withheld: this is no walk to go by\n  - the gyroscope repeats one sample" in done.stdout
    assert "no smoothed trajectory: withheld" in done.stderr
    assert "--force writes it all the same" in done.stderr
    assert done.stderr.count("\n") == 1


def test_force_writes_it_all_the_same_and_again(logs: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    fbgraph("smooth", logs / "stuck.csv", "--out", out, "--no-recording", "--force")
    assert {path.name for path in out.iterdir()} == LEFT | {"smoothed.tum", "breadcrumbs.csv"}
    summary = json.loads((out / "summary.json").read_text())
    assert summary["integrity"]["verdict"] == "withheld"
    assert summary["inputs"]["forced"] is True
    assert summary["failed"] == {}
    fbgraph("record", out)
    guided = fbgraph("guide", out).stdout
    assert guided.startswith("Do not rely on this way: its position is withheld.\nthe gyroscope repeats one sample")


def test_directions_of_a_withheld_walk_need_another_estimator(withheld: Path) -> None:
    done = fbgraph("guide", withheld, code=3)
    assert "only pdr, ekf; it was withheld: the gyroscope repeats one sample" in done.stderr
    assert "Do not rely on this way" in fbgraph("guide", withheld, "--estimator", "ekf").stdout


def test_a_run_that_was_withheld_is_recorded_again(withheld: Path, tmp_path: Path) -> None:
    fbgraph("record", withheld, "--out", tmp_path / "again.rrd")
    assert (tmp_path / "again.rrd").stat().st_size > 0


def test_a_doubtful_walk_is_written_and_said_to_be_doubtful(logs: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    printed = fbgraph("smooth", logs / "slow.csv", "--out", out, "--no-recording").stdout
    at = printed.index("doubtful: something in the log contradicts this walk; its uncertainty is widened")
    assert "the compass turns 2.6 times as far as the gyroscope" in printed[at:]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["integrity"]["verdict"] == "doubtful"
    assert summary["integrity"]["widened"] > 3.0
    way = json.loads(fbgraph("guide", out, "--format", "json").stdout)
    assert way["integrity"]["verdict"] == "doubtful"
    assert "caution" in fbgraph("guide", out, "--format", "geojson", "--origin", "49,11").stdout
    assert "position is doubtful" in fbgraph("guide", out, "--format", "gpx", "--origin", "49,11").stdout


def test_following_says_when_the_position_is_doubtful(logs: Path, tmp_path: Path) -> None:
    log = logs / "slow.csv"
    lines = fbgraph("online", log, "--out", tmp_path / "run", "--follow", "--no-recording").stdout.splitlines()
    steps = [i for i, line in enumerate(lines) if " s " in line[:10]]
    assert max(len(lines[i]) for i in steps) <= 60
    assert lines[steps[10] + 1 : steps[11]] == []
    assert lines[steps[-1] + 1] == "  position doubtful"
    assert any(line.startswith("  position doubtful: the compass turns") for line in lines)
    rows = fbgraph("online", log, "--out", tmp_path / "run", "--json", "--no-recording").stdout.splitlines()
    assert "caution" not in json.loads(rows[10])
    assert "as far as the gyroscope" in json.loads(rows[-2])["caution"]


def test_online_withholds_too(logs: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    fbgraph("online", logs / "stuck.csv", "--out", out, "--no-recording", code=4)
    assert {path.name for path in out.iterdir()} == LEFT | {"online.tum"}
    fbgraph("online", logs / "stuck.csv", "--out", out, "--no-recording", "--force")
    assert (out / "smoothed.tum").is_file()


def test_python_is_told_as_well(logs: Path, tmp_path: Path) -> None:
    walk = package.smooth(logs / "stuck.csv")
    assert walk.integrity.verdict == "withheld"
    assert set(walk.trajectories) == {"pdr", "ekf"}
    folder = walk.save(tmp_path / "run", recording=False)
    assert package.load_run(folder).integrity == walk.integrity
    forced = package.smooth(logs / "stuck.csv", force=True)
    assert "smoothed" in forced.trajectories


def test_a_withheld_walk_is_exported_as_another_estimators_and_with_a_warning(withheld: Path) -> None:
    assert (
        "it was withheld: the gyroscope repeats one sample" in fbgraph("export", withheld, "--to", "csv", code=3).stderr
    )
    done = fbgraph("export", withheld, "--to", "csv", "--estimator", "ekf")
    assert "Do not rely on this walk: its position is withheld." in done.stderr
