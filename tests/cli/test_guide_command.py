"""``fbgraph guide``: the way back as it is printed and exported, and that following it leads to the start."""

import csv
import io
import json
import math
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import gpxpy
import numpy as np
import pytest

from fbgraph import cli
from fbgraph.core.config import load_config
from fbgraph.core.sensor_log import Event
from fbgraph.pipeline import reconstruct, write_run
from fbgraph.readers import read_log
from fbgraph.run.folder import claimed_run
from fbgraph.run.read_run import read_directions, read_run
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.way_back.texts import instructions

CONFIG = load_config("m5stickc", ["device.declination_deg=0"])  # so that maps and readers walk the same way
Guide = Callable[..., str]
AWKWARD, SHOWN = "Café <A&B>\x07\n", r"Café <A&B>\x07\n"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk down a flight of stairs and back; its waypoints are events of the log, and one has an awkward name."""
    log = simulate(load_route("stairs"), seed=4).log
    events = tuple(replace(e, label=AWKWARD) if e.label == "3" else e for e in log.events)
    folder = tmp_path_factory.mktemp("guidance") / "run"
    with claimed_run(folder) as claim:
        write_run(reconstruct(replace(log, events=events), CONFIG), claim, recording=False)
    return folder


@pytest.fixture
def guide(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Guide:
    """``fbgraph guide`` as typed: what it prints on stdout, or on stderr if it fails as it should."""

    def call(*arguments: object, code: int = 0) -> str:
        monkeypatch.setattr(sys, "argv", ["fbgraph", "guide", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        assert (ended.value.code or 0) == code, printed.err
        assert (printed.out if code else printed.err) == ""
        return printed.err if code else printed.out

    return call


def test_the_text_leads_from_the_end_over_every_turn_to_the_start(guide: Guide, run: Path) -> None:
    text = guide(run)
    lines = [line.strip() for line in text.splitlines() if line[:3].strip().isdigit()]
    assert text.startswith("Way back of stairs-4 (smoothed): ")
    assert len(lines) == 7  # five turns
    assert lines[0].startswith("1. At “11”, turn around: face ")
    assert "past “10”" not in text  # at a turn, so said there
    assert lines[1].startswith("2. At “10”, “9”, turn left 90°, then ")
    assert f"past “{SHOWN}”" in lines[4]
    assert "3 m down on the first" in lines[1]
    assert "3 m up between" in lines[4]
    assert lines[6].startswith("7. You are back at the start, at “1”.")
    assert "This leg: ±" in text
    assert guide(run) == text


def test_json_headings_and_lengths_lead_to_the_start(guide: Guide, run: Path) -> None:
    found = json.loads(guide(run, "--format", "json"))
    x_m, y_m, _ = found["start_m"]
    remaining_m = found["length_m"]
    for leg in found["legs"]:
        heading = math.radians(leg["heading_deg"])
        x_m, y_m = x_m + leg["length_m"] * math.sin(heading), y_m + leg["length_m"] * math.cos(heading)
        remaining_m -= leg["length_m"]
        assert leg["remaining_m"] == pytest.approx(remaining_m, abs=0.01)
        assert math.dist((x_m, y_m), leg["end_m"][:2]) < 1.5
        assert leg["steps"] == round(leg["length_m"] / found["pace_m"])
        assert 0 < leg["sigma_along_m"] < leg["length_m"]
        assert 0 < leg["sigma_across_m"] < leg["length_m"]
    assert found["legs"][-1]["end_m"] == pytest.approx([0, 0, 0], abs=0.01)
    turns = [leg["turn_deg"] for leg in found["legs"]]
    assert turns[0] is None
    assert turns[1:3] == pytest.approx([90, -90], abs=10)
    assert [climb["rise_m"] for climb in found["legs"][1]["climbs"]] == pytest.approx([-3], abs=0.5)
    marks = [mark["label"] for leg in found["legs"] for mark in leg["landmarks"]]
    assert marks == ["11", "10", "9", "8", "7", "6", "5", "4", AWKWARD, "2", "1"]
    assert "back at the start" in found["arrival"]


def test_csv_is_a_row_a_leg(guide: Guide, run: Path) -> None:
    rows = list(csv.DictReader(io.StringIO(guide(run, "--format", "csv"))))
    found = json.loads(guide(run, "--format", "json"))
    assert [row["instruction"] for row in rows] == [leg["instruction"] for leg in found["legs"]]
    assert [float(row["length_m"]) for row in rows] == [leg["length_m"] for leg in found["legs"]]
    assert float(rows[-1]["remaining_m"]) == 0.0
    assert f"{SHOWN} after" in "".join(row["landmarks"] for row in rows)


def test_gpx_has_route_track_and_landmarks_on_the_ground(guide: Guide, run: Path, tmp_path: Path) -> None:
    out = tmp_path / "back.gpx"
    assert guide(run, "--format", "gpx", "--origin", "-33.9,151.2", "--out", out) == ""
    document = gpxpy.parse(out.read_text("utf-8"))
    found = json.loads(guide(run, "--format", "json"))
    (route,), (track,) = document.routes, document.tracks
    assert [point.description for point in route.points] == [
        *(leg["instruction"] for leg in found["legs"]),
        found["arrival"],
    ]
    assert (route.points[-1].latitude, route.points[-1].longitude) == pytest.approx((-33.9, 151.2), abs=1e-6)
    assert track.get_points_no() == len((run / "breadcrumbs.csv").read_text().splitlines()) - 1
    assert track.length_2d() == pytest.approx(found["length_m"], rel=0.02)
    assert SHOWN in [point.name for point in document.waypoints]


def test_geojson_is_longitude_first_and_unbroken(guide: Guide, run: Path) -> None:
    found = json.loads(guide(run, "--format", "geojson", "--origin", "48.1,11.5"))
    lines = [f["geometry"]["coordinates"] for f in found["features"] if f["properties"]["kind"] == "leg"]
    assert len(lines) == 6
    assert all(before[-1] == after[0] for before, after in pairwise(lines))
    assert lines[-1][-1] == pytest.approx([11.5, 48.1], abs=1e-6)
    kinds = [f["properties"]["kind"] for f in found["features"]]
    assert (kinds.count("landmark"), kinds.count("start"), kinds.count("arrival")) == (11, 1, 1)
    east_m = (lines[0][0][0] - 11.5) * math.cos(math.radians(48.1)) * 111_320
    assert east_m == pytest.approx(json.loads(guide(run, "--format", "json"))["start_m"][0], abs=0.1)


def test_a_run_that_knows_where_it_is_needs_no_origin(guide: Guide, run: Path, tmp_path: Path) -> None:
    placed = tmp_path / "placed"
    shutil.copytree(run, placed)
    edit_summary(placed, lambda s: s.update(georeference={"lat_deg": 10.0, "lon_deg": 20.0}))
    assert json.loads(guide(placed, "--format", "geojson"))["features"][5]["geometry"]["coordinates"][-1] == [20, 10]
    edit_summary(placed, lambda s: s.update(georeference={"lat_deg": "somewhere"}))
    assert "georeference" in guide(placed, "--format", "gpx", code=3)


def test_units_and_pace_are_the_walkers(guide: Guide, run: Path) -> None:
    length_m = json.loads(guide(run, "--format", "json"))["length_m"]
    printed = guide(run, "--units", "steps", "--pace-m", "0.5")
    assert f"{round(length_m / 0.5)} steps ({length_m:.0f} m)" in printed.splitlines()[0]
    assert f"{length_m:.0f} m ({round(length_m / 0.5)} steps)" in guide(run, "--pace-m", "0.5").splitlines()[0]


def test_other_estimators_lead_back_too_without_claiming_an_uncertainty(guide: Guide, run: Path) -> None:
    for name in ("ekf", "pdr"):
        assert "You are back at the start" in guide(run, "--estimator", name)
        legs = json.loads(guide(run, "--estimator", name, "--format", "json"))["legs"]
        assert {leg["sigma_along_m"] for leg in legs} == {None}


def test_a_run_that_only_counts_its_events_has_no_landmarks(guide: Guide, run: Path, tmp_path: Path) -> None:
    old = tmp_path / "old"
    shutil.copytree(run, old)
    edit_summary(old, lambda s: s["log"].update(events=11))
    assert "“" not in guide(old)


def test_without_a_compass_only_turns_are_told(guide: Guide, run: Path, tmp_path: Path) -> None:
    blind = tmp_path / "blind"
    shutil.copytree(run, blind)
    edit_summary(blind, lambda s: s["log"]["samples"].update(mag=0))
    text = guide(blind)
    assert "turn around, then walk" in text
    assert "heading" not in text
    assert "face" not in text
    assert json.loads(guide(blind, "--format", "json"))["legs"][0]["heading_deg"] is None
    assert "North" in guide(blind, "--format", "gpx", "--origin", "1,2", code=2)


def edit_summary(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = folder / "summary.json"
    summary = json.loads(path.read_text())
    summary.pop("sha256", None)  # what is edited is as it was written no more
    change(summary)
    path.write_text(json.dumps(summary))


@pytest.mark.parametrize(
    ("arguments", "code", "cause"),
    [
        (("--pace-m", "0"), 2, "pace"),
        (("--pace-m", "-1"), 2, "pace"),
        (("--pace-m", "nan"), 2, "pace"),
        (("--units", "feet"), 2, "metric or steps"),
        (("--format", "kml"), 2, "geojson"),
        (("--estimator", "magic"), 2, "smoothed"),
        (("--estimator", "online"), 3, "no online trajectory, only pdr, ekf, smoothed"),
        (("--format", "gpx"), 2, "--origin"),
        (("--format", "geojson"), 2, "--origin"),
        (("--format", "gpx", "--origin", "north"), 2, "LAT,LON"),
        (("--format", "gpx", "--origin", "91,0"), 2, "LAT,LON"),
        (("--format", "gpx", "--origin", "nan,0"), 2, "LAT,LON"),
        (("--out", "."), 2, "current folder"),
        (("--out", "/dev/null/back.txt"), 2, "cannot write"),
    ],
)
def test_what_cannot_be_is_one_line(
    guide: Guide,
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    code: int,
    cause: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    told = guide(run, *arguments, code=code)
    assert cause in told
    assert told.count("\n") == 1


def test_a_folder_without_a_walk_is_bad_data(guide: Guide, run: Path, tmp_path: Path) -> None:
    assert "not a run folder" in guide(tmp_path, code=3)
    assert "not a run folder" in guide(tmp_path / "nothing", code=3)
    broken = tmp_path / "broken"
    shutil.copytree(run, broken)
    lines = (broken / "breadcrumbs.csv").read_text().splitlines()
    for content, cause in (
        (lines[:3], "2 breadcrumbs"),
        (lines[:1], "breadcrumbs"),
        (lines[1:], "header"),
        ([], "header"),
    ):
        (broken / "breadcrumbs.csv").write_text("\n".join(content) + "\n")
        assert cause in guide(broken, code=3)
    (broken / "breadcrumbs.csv").unlink()
    assert "No such file" in guide(broken, code=3)


def test_a_real_walk_out_and_back_is_told_by_its_corridors(shared_data: Path, tmp_path: Path) -> None:
    file = read_log(shared_data / "ipin2023" / "TrainingTrial22_repetition02.txt.gz")
    log = replace(file.log, events=(Event(0.0, "before the walk"),))
    with claimed_run(tmp_path / "run") as claim:
        write_run(reconstruct(log, load_config("phone")), claim, recording=False)
    back = read_directions(read_run(tmp_path / "run")).reversed()
    turns = [math.degrees(back.turn_rad(i)) for i in range(1, len(back.legs))]
    assert np.abs(turns) == pytest.approx([90, 90, 90, 180, 90, 90, 90], abs=12)
    assert instructions(back)[-1] == "You are back at the start, at “before the walk”."
