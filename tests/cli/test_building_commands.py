"""``--building-axis`` and ``--building``: a walk laid along corridors, labelled, noted and repeated."""

import json
from pathlib import Path
from typing import Any

import pytest
from support.commands import fbgraph as command

import fbgraph
from fbgraph import load_run
from fbgraph.core.building import Building, BuildingAxis
from fbgraph.core.building_files import write_building
from fbgraph.reruns import repeat_run


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated walk round a block whose streets run North and East; its truth lies beside it."""
    folder = tmp_path_factory.mktemp("walk")
    command("simulate", folder / "walk.csv", "--route", "square", "--seed", "3")
    return folder / "walk.csv"


def smoothed(walk: Path, out: Path, *options: object, code: int = 0) -> dict[str, Any]:
    truth = walk.with_name("walk_truth.csv")
    command("smooth", walk, "--out", out, "--truth", truth, "--no-recording", *options, code=code)
    loaded: dict[str, Any] = json.loads((out / "summary.json").read_text("utf-8"))
    return loaded


def test_a_walk_is_laid_along_its_axis_and_labelled(walk: Path, tmp_path: Path) -> None:
    alone = smoothed(walk, tmp_path / "alone")
    summary = smoothed(walk, tmp_path / "laid", "--building-axis", "90,1")
    assert alone["axis"] is None
    axis = summary["axis"]
    assert (axis["used"], axis["legs"], axis["legs_along"], axis["north"]) == (True, 3, 3, "magnetic")
    assert (axis["heading_deg"], axis["sigma_deg"], axis["why_not"]) == (0.0, 1.0, None)
    before, after = (one["estimators"]["smoothed"]["score"] for one in (alone, summary))
    assert (before["label"], after["label"]) == ("unaided", "axis")
    assert after["turned_deg"] - before["turned_deg"] == pytest.approx(axis["turned_deg"], abs=0.01)
    assert abs(after["turned_deg"]) < abs(before["turned_deg"])
    assert after["rmse_m"] < before["rmse_m"]
    assert after["aligned_rmse_m"] == pytest.approx(before["aligned_rmse_m"])
    for name in ("pdr", "ekf"):
        assert summary["estimators"][name] == alone["estimators"][name]
    assert [f["text"][:39] for f in summary["findings"] if f["kind"] == "axis"] == [
        "by the building's axis the walk is turn"
    ]
    assert any("counted from magnetic North" in text for text in summary["warnings"])
    assert repeat_run(tmp_path / "laid").told.building is not None  # refuses another walk
    printed = command("evaluate", tmp_path / "laid").stdout
    assert " axis " in printed


def test_an_axis_that_is_wrong_is_refused_and_the_walk_stays(walk: Path, tmp_path: Path) -> None:
    alone = smoothed(walk, tmp_path / "alone")
    for degrees in (20, 45):
        summary = smoothed(walk, tmp_path / str(degrees), "--building-axis", degrees)
        assert not summary["axis"]["used"]
        assert "straight legs lie" in summary["axis"]["why_not"]
        assert summary["integrity"]["verdict"] == "doubtful"
        assert [reason["kind"] for reason in summary["integrity"]["reasons"]] == ["axis"]
        assert summary["estimators"]["smoothed"]["end_m"] == alone["estimators"]["smoothed"]["end_m"]
        assert summary["estimators"]["smoothed"]["score"]["label"] == "axis"


def test_a_buildings_file_counts_from_its_own_north(walk: Path, tmp_path: Path) -> None:
    file = tmp_path / "b.toml"
    write_building(Building(axis=BuildingAxis(heading_deg=12.0, north="true", declination_deg=12.0)), file)
    summary = smoothed(walk, tmp_path / "a", "--building", file)
    assert (summary["axis"]["used"], summary["axis"]["heading_deg"]) == (True, 0.0)
    assert not any("magnetic North" in text for text in summary["warnings"])
    assert summary["inputs"]["building"] == str(file)
    turned = smoothed(walk, tmp_path / "b", "--building", file, "--set", "device.declination_deg=12")
    assert (turned["axis"]["heading_deg"], turned["axis"]["north"]) == (12.0, "true")
    assert turned["axis"]["turned_deg"] == pytest.approx(summary["axis"]["turned_deg"], abs=0.1)


def test_an_online_walk_is_laid_when_it_is_over(walk: Path, tmp_path: Path) -> None:
    axis = "--building-axis", "0,1"
    command("online", walk, "--out", tmp_path / "run", "--no-recording", "--chunk", "5", *axis)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text("utf-8"))
    assert summary["axis"]["used"]
    offline = smoothed(walk, tmp_path / "offline", *axis)
    assert summary["axis"]["turned_deg"] == pytest.approx(offline["axis"]["turned_deg"], abs=0.2)
    assert summary["estimators"]["smoothed"]["end_m"] == pytest.approx(
        offline["estimators"]["smoothed"]["end_m"], abs=0.2
    )


def test_the_same_from_python(walk: Path) -> None:
    building = Building(axis=BuildingAxis(heading_deg=0.0, sigma_deg=1.0))
    once = fbgraph.smooth(walk, building=building)
    assert once.summary["axis"]["used"]
    online = fbgraph.OnlineSmoother(building=building)
    online.feed(fbgraph.read_log(walk).log)
    assert online.finish().summary["axis"]["turned_deg"] == pytest.approx(once.summary["axis"]["turned_deg"], abs=0.2)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--building-axis", "north"), "expected DEG[,SIGMA]"),
        (("--building", "gone.toml"), "gone.toml: No such file"),
        (("--building", "gone.toml", "--building-axis", "3"), "leave out --building-axis"),
    ],
)
def test_what_is_no_building_is_told_before_the_log_is_read(
    options: tuple[str, ...], says: str, tmp_path: Path
) -> None:
    done = command("smooth", tmp_path / "no.csv", "--out", tmp_path / "run", *options, code=2)
    assert says in done.stderr


def test_many_walks_along_one_axis(walk: Path, tmp_path: Path) -> None:
    file = tmp_path / "b.toml"
    write_building(Building(axis=BuildingAxis(heading_deg=0.0, sigma_deg=1.0)), file)
    fbgraph.batch(walk, out=tmp_path / "file", workers=0, recording=False, building=str(file))
    fbgraph.batch(walk, out=tmp_path / "text", workers=0, recording=False, building_axis="0,1")
    by_file, by_text = (load_run(tmp_path / name / "runs" / "walk").summary for name in ("file", "text"))
    assert by_file["axis"]["used"]
    assert by_file["axis"] == by_text["axis"]
    assert (by_file["inputs"]["building"], by_text["inputs"]["building_axis"]) == (str(file), "0,1")
    done = command("batch", walk, "--out", tmp_path / "no", "--building", tmp_path / "gone.toml", code=2)
    assert "gone.toml: No such file" in done.stderr
