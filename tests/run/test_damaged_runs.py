"""A damaged run is refused in one line that names the file; what is not refused is what it was."""

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands import fbgraph as command
from support.damage import WRONG, damage, places, with_value

import fbgraph
from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.config import load_config
from fbgraph.core.errors import DataError, FbgraphError
from fbgraph.core.georeference import Georeference
from fbgraph.core.tum_files import read_tum
from fbgraph.pipeline import write_run
from fbgraph.readers.places import read_checkpoints
from fbgraph.recording.side_by_side import require_walk
from fbgraph.reruns import repeat_run
from fbgraph.run.folder import claimed_run
from fbgraph.run.inputs import RunInputs
from fbgraph.run.read_run import read_directions, read_georeference, read_run, score_run
from fbgraph.session import replay_log
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.way_back.gpx_geojson import format_directions

READ = ("pdr.tum", "ekf.tum", "smoothed.tum", "online.tum", "breadcrumbs.csv", "summary.json", "config.toml")
TRUTH = checkpoints(np.array([8.0, 20.0, 40.0]), np.array([0.0, 5.0, 10.0]), np.array([0.0, 5.0, 0.0]), source="truth")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with everything in it, its way back and all four estimators."""
    walk = simulate(load_route("square"), seed=2)
    told = Told(truth=walk.checkpoints, origin=Georeference(49.5, 11.1))
    result = replay_log(walk.log, load_config("m5stickc"), told, inputs=RunInputs(log="walk.csv", origin=(49.5, 11.1)))
    out = tmp_path_factory.mktemp("whole") / "run"
    with claimed_run(out) as claim:
        write_run(result, claim, recording=False)
    return out


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    """The run, to be damaged."""
    return Path(shutil.copytree(whole, tmp_path / "run"))


@pytest.fixture
def old(run: Path) -> Path:
    """A run as it was written before digests and failed estimators were noted, to be damaged."""
    edit(run, lambda summary: [summary.pop(name) for name in ("sha256", "failed")])
    return run


def edit(run: Path, change: Callable[[dict[str, Any]], object]) -> None:
    path = run / "summary.json"
    summary = json.loads(path.read_text())
    change(summary)
    path.write_text(json.dumps(summary, indent=2) + "\n")


def edit_line(path: Path, number: int, change: Callable[[str], str]) -> None:
    """Change a line of a file; 1 is the first, as in messages."""
    lines = path.read_text().split("\n")
    lines[number - 1] = change(lines[number - 1])
    path.write_text("\n".join(lines))


def cell(index: int, value: str, separator: str = " ") -> Callable[[str], str]:
    """Puts a value into a column of a line."""

    def change(line: str) -> str:
        cells = line.split(separator)
        cells[index] = value
        return separator.join(cells)

    return change


def answers(folder: Path, truth: Checkpoints = TRUTH) -> str:
    """Everything that a run's readers say, as JSON that must know no nan and no infinity."""
    run, walk = read_run(folder), fbgraph.load_run(folder)
    way = read_directions(run).reversed()
    said = {
        "summary": dict(walk.summary),
        "shown": [repr(walk), walk._repr_html_(), str(walk.findings)],
        "loaded": {
            n: np.column_stack((t.t_s, t.xy_m, t.z_m, t.yaw_rad)).tolist() for n, t in walk.trajectories.items()
        },
        "guide": [
            format_directions(way, kind, "metric", read_georeference(run.summary)) for kind in ("json", "geojson")
        ],
        "scores": score_run(run, truth),
        "inputs": RunInputs.from_summary(run.summary, folder).as_dict(),
    }
    return json.dumps(said, allow_nan=False, sort_keys=True)


def outcome(folder: Path) -> tuple[str, str]:
    """What a run's readers say, or why they refuse it."""
    try:
        return answers(folder), ""
    except FbgraphError as error:
        return "", str(error)


def refusal(folder: Path) -> str:
    with pytest.raises(DataError) as refused:
        answers(folder)
    assert "\n" not in str(refused.value)
    assert str(refused.value).endswith("smooth the log again")
    return str(refused.value)


def test_no_damage_goes_unseen(whole: Path, tmp_path: Path) -> None:
    rng, before, refused = random.Random(1), answers(whole), 0
    run = Path(shutil.copytree(whole, tmp_path / "run"))
    for _ in range(400):
        name = rng.choice([*READ, "summary.json"])
        done = damage(run / name, rng)
        said, why = outcome(run)
        assert name in why if why else said == before, (name, done, why)
        refused += bool(why)
        shutil.copyfile(whole / name, run / name)
    assert refused > 350


def test_without_digests_what_is_read_twice_is_right_and_all_is_finite(whole: Path, old: Path, tmp_path: Path) -> None:
    rng, before = random.Random(2), fbgraph.load_run(whole).trajectories["smoothed"].xy_m
    kept = Path(shutil.copytree(old, tmp_path / "kept"))
    for _ in range(300):
        name = rng.choice([*READ, "summary.json"])
        done = damage(old / name, rng)
        said, why = outcome(old)
        after = before if why else np.array(json.loads(said)["loaded"]["smoothed"])[:, 1:3]
        assert np.abs(after - before).max() < 1e-5, (name, done)
        assert name in (why or name) or "this run does not know its own" in str(why), done  # where it lies, by its name
        shutil.copyfile(kept / name, old / name)


def test_every_field_of_another_kind_is_refused_or_not_read(old: Path) -> None:
    path = old / "summary.json"
    summary = json.loads(path.read_text())
    rng = random.Random(3)
    for place in places(summary):
        path.write_text(json.dumps(with_value(summary, place, rng.choice(WRONG))))
        why = outcome(old)[1]
        assert "summary.json" in (why or "summary.json") or place == ("georeference",), why  # which may be unknown


def test_older_and_newer_summaries_are_read(old: Path) -> None:
    before = answers(old)
    edit(old, lambda s: (s.update(mood="sunny"), s["inputs"].update(weather=1), s["findings"][0].update(color="red")))
    assert fbgraph.load_run(old).findings
    edit(old, lambda s: (s.pop("mood"), s["inputs"].pop("weather"), s["findings"][0].pop("color")))
    assert answers(old) == before
    edit(old, lambda s: [s.pop(name) for name in ("findings", "inputs", "georeference", "anchors", "walk_s")])
    assert fbgraph.load_run(old).findings == []


@pytest.mark.parametrize(
    ("name", "number", "change", "cause"),
    [
        ("smoothed.tum", 7, cell(1, "nan"), "smoothed.tum: line 7: not all of its numbers are finite"),
        ("pdr.tum", 7, cell(0, "1.0"), "pdr.tum: line 7: its time is not later"),
        ("ekf.tum", 7, cell(1, "1e15"), "ekf.tum: line 7: 1e+15 m from the breadcrumb before"),
        ("ekf.tum", 7, cell(3, "-500.0"), "ekf.tum: line 7"),
        ("ekf.tum", 7, cell(6, "0.9"), "ekf.tum: line 7: its quaternion"),
        ("ekf.tum", 7, cell(4, "0.1"), "ekf.tum: line 7: its quaternion"),
        ("online.tum", 7, cell(2, "1e15"), "estimators.online.distance_m"),
        ("online.tum", 7, cell(2, "1_5"), "online.tum: line 7: expected 8 numbers"),
        ("online.tum", 7, lambda line: line[:-12], "online.tum: line 7: expected 8 numbers"),
        ("pdr.tum", 7, lambda line: "", "breadcrumbs, but by summary.json"),
        ("breadcrumbs.csv", 7, cell(0, "6", ","), "breadcrumbs.csv: line 7: its number k"),
        ("breadcrumbs.csv", 7, cell(2, "9.5", ","), "breadcrumbs.csv: line 7: its x_m is not that of smoothed.tum"),
        ("breadcrumbs.csv", 7, cell(5, "9.5", ","), "breadcrumbs.csv: line 7: its yaw_rad is not"),
        ("breadcrumbs.csv", 7, cell(6, "inf", ","), "breadcrumbs.csv: line 7: not all of its numbers are finite"),
        ("breadcrumbs.csv", 7, cell(7, "-0.1", ","), "breadcrumbs.csv: line 7: its standard deviations"),
        ("breadcrumbs.csv", 7, cell(8, "nan", ","), "breadcrumbs.csv: line 7: its standard deviations"),
        ("breadcrumbs.csv", 7, cell(8, "1e15", ","), "breadcrumbs.csv: line 7: its standard deviations"),
        ("breadcrumbs.csv", 7, cell(9, "80.0", ","), "breadcrumbs.csv: line 7: its cov_xy_m2"),
        ("breadcrumbs.csv", 7, cell(10, "nan", ","), "breadcrumbs.csv: line 7: its sigma_z_m"),
        ("breadcrumbs.csv", 1, lambda line: line + ",mood", "header"),
        ("config.toml", 7, lambda line: "declination_deg = 500", "config.toml: device.declination_deg"),
        ("config.toml", 2, lambda line: "mount = " + "9" * 5000, "config.toml: not TOML"),
    ],
)
def test_what_is_wrong_is_named_by_its_line(
    old: Path, name: str, number: int, change: Callable[[str], str], cause: str
) -> None:
    edit_line(old / name, number, change)
    assert cause in refusal(old)


@pytest.mark.parametrize(
    ("path", "value", "cause"),
    [
        (("steps",), "5", "summary.json: steps: Input should be a valid integer (got '5')"),
        (("steps",), 5, "by summary.json 5 steps"),
        (("log",), None, "summary.json: log: "),
        (("log", "t0_s"), [], "summary.json: log.t0_s: "),
        (("log", "t0_s"), 1e9, "log.t0_s"),
        (("log", "duration_s"), 10.0, "log.duration_s"),
        (("log", "events", 1, "label"), 5, "summary.json: log.events."),
        (("estimators",), {}, "summary.json: estimators: "),
        (("estimators", "online", "end_m", 1), 77.0, "online.tum: gives"),
        (("estimators", "pdr", "distance_m"), float("nan"), "summary.json: estimators.pdr.distance_m"),
        (("estimators", "gps"), {"distance_m": 1.0, "end_m": [0.0, 0.0, 0.0]}, "summary.json: estimators.gps"),
        (("distance_m",), 12.0, "notes distance_m as 12"),
        (("walk_s",), 12.0, "notes walk_s as 12"),
        (("altitude_range_m",), [0.0, 99.0], "altitude_range_m"),
        (("georeference", "lat_deg"), 91.0, "summary.json: georeference.lat_deg"),
        (("inputs", "log"), "a\x00b", "summary.json: inputs.log"),
        (("inputs", "online_chunk_s"), 0.0, "summary.json: inputs.online_chunk_s"),
        (("findings", 0, "text"), 5, "summary.json: findings.0.text"),
        (("sha256",), [], "summary.json: sha256"),
    ],
)
def test_what_is_wrong_is_named_by_its_field(old: Path, path: tuple[Any, ...], value: object, cause: str) -> None:
    file = old / "summary.json"
    file.write_text(json.dumps(with_value(json.loads(file.read_text()), path, value)))
    assert cause in refusal(old)


@pytest.mark.parametrize("text", ["", "[]", "5", '{"log": ', "[" * 100_000, '{"steps": ' + "9" * 5000 + "}"])
def test_what_is_no_summary_is_told(run: Path, text: str) -> None:
    (run / "summary.json").write_text(text)
    assert "summary.json" in refusal(run)


def test_half_a_trajectory_with_a_summary_to_match_is_still_told_by_the_others(old: Path) -> None:
    path = old / "smoothed.tum"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[: len(lines) // 2]))
    assert "smoothed.tum: " in refusal(old)
    edit(old, lambda s: s.update(steps=len(lines) // 2 - 1))
    assert "breadcrumbs, but by summary.json" in refusal(old)


def test_a_digit_that_contradicts_nothing_is_told_by_the_digests(run: Path) -> None:
    edit_line(run / "pdr.tum", 7, cell(3, "0.123456"))
    assert "pdr.tum: not as it was written" in refusal(run)


def test_another_layout_and_other_line_ends_are_no_damage(run: Path) -> None:
    before = answers(run)
    (run / "summary.json").write_text(json.dumps(json.loads((run / "summary.json").read_text())))
    for name in ("pdr.tum", "breadcrumbs.csv", "config.toml"):
        (run / name).write_bytes((run / name).read_bytes().replace(b"\n", b"\r\n"))
    assert answers(run) == before


def test_a_log_whose_name_is_not_utf8_is_read_back(old: Path) -> None:
    edit(old, lambda s: (s["log"].update(name="w\udc9b"), s["inputs"].update(log="/tmp/w\udc9b.csv")))
    run = read_run(old)
    assert read_directions(run).name == "w\udc9b (smoothed)"
    assert RunInputs.from_summary(run.summary, old).log == "/tmp/w\udc9b.csv"


def test_standard_deviations_may_all_be_unknown(old: Path) -> None:
    path = old / "breadcrumbs.csv"
    header, *rows = path.read_text().splitlines()
    path.write_text("\n".join([header, *(",".join([*row.split(",")[:7], *["nan"] * 5]) for row in rows)]) + "\n")
    assert read_directions(read_run(old)).sigma_m is None


def test_a_damaged_run_is_not_recorded(run: Path) -> None:
    edit_line(run / "ekf.tum", 7, cell(1, "1e15"))
    with pytest.raises(DataError, match=r"ekf\.tum: line 7"):
        repeat_run(run)


@pytest.mark.parametrize(
    ("rows", "cause"),
    [
        (["8,0,0", "nan,1,1"], "t_s is not a number"),
        (["8,0,0", "20,inf,1"], "x_m is not a number"),
        (["8,0,0", "20,1e200,1"], "none on Earth|nobody can"),
        (["8,0,0"], "at least two"),
        (["1e300,0,0", "2e300,1,1"], "no clock shows"),
        (["20,0,0", "1e300,1,1"], "no clock shows"),
    ],
)
def test_truth_that_cannot_be_is_one_line(whole: Path, tmp_path: Path, rows: list[str], cause: str) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("\n".join(["t_s,x_m,y_m", *rows]) + "\n")
    with pytest.raises(DataError, match=cause) as refused:
        score_run(read_run(whole), read_checkpoints(path))
    assert "truth.csv" in str(refused.value)


def test_truth_in_any_order_and_twice_scores_the_same(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("t_s,x_m,y_m\n40,10,0\n8,0,0\n20,5,5\n")
    assert score_run(read_run(whole), read_checkpoints(path)) == score_run(read_run(whole), TRUTH)
    path.write_text("t_s,x_m,y_m\n8,0,0\n8,0,0\n20,5,5\n20,5,5\n40,10,0\n")
    assert score_run(read_run(whole), read_checkpoints(path))["pdr"]["checkpoints"] == 4


def test_tum_files_of_other_tools_are_read(tmp_path: Path) -> None:
    path = tmp_path / "other.tum"
    path.write_text("# t x y z q\n\n1 0 0 0 0 0 0.707107 0.707107\n2 1 0 0 0 0 -0.707107 -0.707107")
    np.testing.assert_allclose(np.degrees(read_tum(path).yaw_rad), [90.0, 450.0 - 360.0], atol=1e-3)


def test_a_line_twice_is_told(tmp_path: Path) -> None:
    path = tmp_path / "twice.tum"
    path.write_text("1 0 0 0 0 0 0 1\n" * 2)
    with pytest.raises(DataError, match="line 2: its time is not later"):
        read_tum(path)


def test_the_command_line_says_it_in_one_line(run: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("t_s,x_m,y_m\n8,0,0\n40,10,0\n")
    edit_line(run / "smoothed.tum", 7, cell(1, "nan"))
    for arguments in (("guide", run), ("evaluate", run, "--truth", truth, "--json"), ("record", run)):
        done = command(*arguments, code=3)
        assert done.stdout == ""
        assert done.stderr.count("\n") == 1
        assert "smoothed.tum: line 7" in done.stderr
    (run / "recording.rrd").write_bytes(b"")
    assert "recording.rrd" in command("view", run, code=3).stderr


@pytest.mark.parametrize("data", [b"", b"RRF2", b"RRF2" + bytes(1000)])
def test_a_damaged_recording_is_told(run: Path, data: bytes) -> None:
    (run / "recording.rrd").write_bytes(data)
    with pytest.raises(DataError, match=r"recording\.rrd"):
        require_walk(run / "recording.rrd")
