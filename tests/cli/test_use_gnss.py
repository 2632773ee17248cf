"""``--use-gnss`` and a phone's Location file: what becomes of the fixes, noted and repeated."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands import fbgraph as command

import fbgraph
from fbgraph.core.georeference import Georeference
from fbgraph.readers import read_log
from fbgraph.readers.cleaning import LogFile
from fbgraph.readers.places import gnss_of
from fbgraph.reruns import repeat_run
from fbgraph.simulator.files import write_m5stickc_csv

HERE = Georeference(49.46, 11.11)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated walk, and what a receiver with errors of 2 m found on it, in Sensor Logger's form."""
    folder = tmp_path_factory.mktemp("gnss")
    walk = fbgraph.simulate("square", seed=3)
    write_m5stickc_csv(walk.log, folder / "walk.csv")
    t_s = np.arange(walk.t_s[0], walk.t_s[-1], 1.0)
    rng = np.random.default_rng(5)
    xy_m = np.column_stack([np.interp(t_s, walk.t_s, axis) for axis in (walk.x_m, walk.y_m)])
    lat_lon_deg = HERE.geodetic_deg(xy_m + rng.normal(0.0, 2.0, xy_m.shape))
    lines = ["time,seconds_elapsed,horizontalAccuracy,longitude,latitude"]
    lines += [
        f"{round((walk.log.t0_s + t) * 1e9)},{t:.3f},3.03,{lon:.9f},{lat:.9f}"
        for t, (lat, lon) in zip(t_s.tolist(), lat_lon_deg.tolist(), strict=True)
    ]
    (folder / "Location.csv").write_text("\n".join(lines), "utf-8")
    return folder / "walk.csv"


def summary_of(folder: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((folder / "summary.json").read_text("utf-8"))
    return loaded


def test_all_fixes_are_anchors_and_a_run_repeats_that(walk: Path, tmp_path: Path) -> None:
    command("smooth", walk, "--out", tmp_path / "all", "--use-gnss", "all", "--no-recording")
    summary = summary_of(tmp_path / "all")
    fixes = gnss_of(walk)
    assert fixes is not None
    assert summary["gnss"]["fixes"] == len(fixes)
    assert summary["gnss"]["used"] == summary["anchors"] == int(np.ceil(np.ptp(fixes.t_s) / 10.0))
    assert (summary["gnss"]["used_as"], summary["inputs"]["use_gnss"]) == ("all", "all")
    assert summary["gnss"]["sigma_m"] == pytest.approx(np.sqrt(6.0) * 2.0, rel=0.01)
    assert summary["truth"] is None
    again = repeat_run(tmp_path / "all")  # refuses another walk
    assert again.told.anchors is not None
    assert len(again.told.anchors) == summary["anchors"]


def test_the_first_fix_places_the_walk_on_earth(walk: Path, tmp_path: Path) -> None:
    truth = walk.parent / "Location.csv"
    command("online", walk, "--out", tmp_path, "--use-gnss", "start", "--truth", truth, "--no-recording")
    summary = summary_of(tmp_path)
    assert (summary["anchors"], summary["gnss"]["used_as"]) == (1, "start")
    assert summary["georeference"]["lat_deg"] == pytest.approx(HERE.lat_deg, abs=1e-4)
    assert summary["declination"]["deg"] == pytest.approx(4.4, abs=0.5)
    assert summary["truth"].endswith("Location.csv (GNSS, 2.0 m 1σ on each axis)")
    assert summary["estimators"]["smoothed"]["score"]["rmse_m"] < 6.0


def test_fixes_that_a_log_carries_score_it_unless_they_are_used(walk: Path) -> None:
    log = read_log(walk).log
    fixes = gnss_of(walk)
    done = fbgraph.smooth(LogFile(log, None, fixes))
    assert done.summary["gnss"]["used_as"] == "truth"
    assert done.summary["estimators"]["smoothed"]["score"]["label"] == "unaided"
    assert 1.0 < done.summary["estimators"]["smoothed"]["score"]["rmse_m"] < 6.0
    assert done.summary["anchors"] == 0


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--use-gnss", "some"], 2, "--use-gnss some: expected none, start, ends or all"),
        (["--use-gnss", "all", "--anchors", "places.csv"], 2, "leave out --anchors"),
        (["--use-gnss", "ends"], 3, "no GNSS fixes in the log and no Location.csv beside it"),
    ],
)
def test_what_cannot_be_used_is_told(walk: Path, tmp_path: Path, options: list[str], code: int, said: str) -> None:
    alone = tmp_path / "walk.csv"
    alone.write_bytes(walk.read_bytes())
    assert said in command("smooth", alone, "--out", tmp_path / "run", *options, code=code).stderr
    assert not (tmp_path / "run").exists()


def test_a_live_walk_takes_no_fixes_and_help_shows_an_example(tmp_path: Path) -> None:
    live = command("online", "--source", "stdin", "--out", tmp_path / "live", "--use-gnss", "all", code=2)
    assert "--use-gnss needs a LOG" in live.stderr
    text = " ".join(command("smooth", "--help").stdout.replace("│", " ").split())
    assert "Example: --use-gnss start" in text
