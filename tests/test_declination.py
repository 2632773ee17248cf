"""A walk where the compass does not point to true North: batch, online, live, made again, and on the map."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import gpxpy
import numpy as np
import pytest
from support.commands import fbgraph, fbgraph_process, rrd

import fbgraph as face
from fbgraph.core.aids import Told
from fbgraph.core.config import load_config
from fbgraph.core.georeference import Georeference
from fbgraph.pipeline import reconstruct
from fbgraph.run.read_run import read_run
from fbgraph.run.summary import summary_markdown
from fbgraph.session import replay_log
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import Device, Environment, SimulateOptions

ORIGIN = "61.2,-149.9"
ANCHORAGE = Georeference(61.2, -149.9)
JULY_2022_S = datetime(2022, 7, 2, 12, tzinfo=UTC).timestamp()
DECLINATION_RAD = math.radians(15.2)  # there, then
LOG = simulate(
    load_route("straight"),
    SimulateOptions(device=Device(clock_start_s=JULY_2022_S), environment=Environment(declination_deg=15.2)),
    seed=2,
).log
CONFIG = load_config("m5stickc")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("north") / "walk.csv"
    write_m5stickc_csv(LOG, path)
    return path


@pytest.fixture(scope="module")
def placed(log: Path) -> Path:
    out = log.parent / "placed"
    said = fbgraph("smooth", log, "--origin", ORIGIN, "--out", out).stdout
    assert "declination 15.2° East at 61.2, -149.9 by the World Magnetic Model (WMM-2020, 2022-07-02)\n" in said
    return out


@pytest.fixture(scope="module")
def unplaced(log: Path) -> Path:
    out = log.parent / "unplaced"
    assert "declination" not in fbgraph("smooth", log, "--out", out, "--no-recording").stdout
    return out


def end(run: Path, estimator: str = "smoothed") -> complex:
    walked = read_run(run).trajectories[estimator]
    return complex(*(walked.xy_m[-1] - walked.xy_m[0]).tolist())


def track(run: Path, *arguments: object) -> tuple[complex, str]:
    """Where the walk ended as seen from its start, by its GPX, and what was said on stderr."""
    back = fbgraph("guide", run, "--format", "gpx", *arguments)
    points = gpxpy.parse(back.stdout).tracks[0].segments[0].points
    (ends,) = ANCHORAGE.local_m(np.array([[points[0].latitude, points[0].longitude]])).tolist()
    return complex(*ends), back.stderr


def test_the_origin_turns_every_estimator_to_true_north(placed: Path, unplaced: Path) -> None:
    for estimator in ("ekf", "smoothed"):
        turn = np.angle(end(placed, estimator) / end(unplaced, estimator))
        assert turn == pytest.approx(-DECLINATION_RAD, abs=1e-3)
    assert abs(np.degrees(np.angle(end(placed)))) < 6.0  # the route goes East
    assert json.loads((placed / "summary.json").read_text())["declination"]["deg"] == 15.2
    assert json.loads((unplaced / "summary.json").read_text())["declination"] is None


def test_the_walk_is_made_again_with_what_was_looked_up(placed: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.rrd"
    fbgraph("record", placed, "--out", again)
    assert rrd("compare", placed / "recording.rrd", again).returncode == 0
    summary = json.loads((placed / "summary.json").read_text())
    assert "\nDeclination 15.2° East at 61.2, -149.9 by the World Magnetic Model" in summary_markdown(summary)


def test_set_by_hand_it_is_not_looked_up(log: Path, unplaced: Path, tmp_path: Path) -> None:
    by_hand = tmp_path / "run"
    setting = ("--set", "device.declination_deg=0")
    said = fbgraph("smooth", log, "--origin", ORIGIN, *setting, "--out", by_hand, "--no-recording").stdout
    assert "declination 0.0° East, as it was set\n" in said
    assert end(by_hand) == pytest.approx(end(unplaced), abs=1e-6)
    placed_there, said = track(by_hand, "--origin", ORIGIN)
    assert placed_there == pytest.approx(end(by_hand), abs=0.05)
    assert said == ""


def test_on_the_map_the_walk_lies_by_true_north_whenever_its_place_was_told(placed: Path, unplaced: Path) -> None:
    told_before, nothing = track(placed)
    told_now, said = track(unplaced, "--origin", ORIGIN)
    assert nothing == ""
    assert said.startswith("fbgraph: the walk was smoothed towards magnetic North; on the map it is turned by the decl")
    assert "15.2° East at 61.2, -149.9" in said
    assert told_before == pytest.approx(end(placed), abs=0.05)
    assert told_now == pytest.approx(told_before, abs=0.1)
    line = json.loads(fbgraph("guide", unplaced, "--format", "geojson", "--origin", ORIGIN).stdout)
    lon_deg, lat_deg = line["features"][0]["geometry"]["coordinates"][0]
    (there,) = ANCHORAGE.local_m(np.array([[lat_deg, lon_deg]])).tolist()
    assert complex(*there) == pytest.approx(told_now, abs=0.05)


def test_directions_to_read_say_which_north_they_mean(placed: Path, unplaced: Path) -> None:
    needle = "headings are from true North; a compass needle there points 15.2° East of it\n"
    assert needle in fbgraph("guide", placed).stderr
    assert fbgraph("guide", unplaced, "--origin", ORIGIN).stderr == ""  # headings as the compass shows them


def test_online_live_and_resumed_are_turned_alike(placed: Path, tmp_path: Path) -> None:
    whole = reconstruct(LOG, CONFIG, Told(origin=ANCHORAGE))
    replayed = replay_log(LOG, CONFIG, Told(origin=ANCHORAGE), chunk_s=1.0)
    for result in (whole, replayed):
        assert result.config.device.declination_deg == 15.2
        assert result.expected_field is not None
        assert result.expected_field.strength_ut == pytest.approx(55.15, abs=0.01)
    between = replayed.trajectories["smoothed"].xy_m - whole.trajectories["smoothed"].xy_m
    assert np.abs(between).max() < 0.01
    lines = (placed.parent / "walk.csv").read_text()
    live, once = tmp_path / "live", ("online", "--source", "stdin", "--no-recording")
    half = lines[: len(lines) // 2]
    fbgraph_process(*once, "--origin", ORIGIN, "--out", live, stdin=lines)
    noted = load_config(str(live / "config.toml")).device
    assert noted.declination_deg is not None
    assert 10.0 < noted.declination_deg < 15.2  # that of today
    assert str(datetime.now(UTC).year) in noted.declination_by
    turn = np.angle(end(live) / end(placed))
    assert turn == pytest.approx(DECLINATION_RAD - math.radians(noted.declination_deg), abs=2e-3)
    for name in ("summary.json", "smoothed.tum"):
        (live / name).unlink()
    (live / "raw.csv").write_text(half)
    fbgraph_process(*once, "--resume", live, stdin=lines[len(half) :])  # without its origin: the configuration knows
    assert load_config(str(live / "config.toml")).device == noted


def test_from_python(placed: Path) -> None:
    walk = face.smooth(placed.parent / "walk.csv", origin=(61.2, -149.9), config="m5stickc")
    assert walk.summary["declination"]["deg"] == 15.2
    online = face.OnlineSmoother("m5stickc", origin=(61.2, -149.9), t0_s=LOG.t0_s)
    online.feed(LOG)
    finished = online.finish()
    assert finished.summary["declination"] == walk.summary["declination"]
    assert finished.summary["inputs"]["origin"] == [61.2, -149.9]
    lasting = replace(LOG, mag=replace(LOG.mag, t_s=LOG.mag.t_s[:0], values=LOG.mag.values[:0]))
    assert face.smooth(lasting, origin=(61.2, -149.9), config="m5stickc").summary["declination"] is None
