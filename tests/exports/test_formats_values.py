"""Each format, read back by its own library: the numbers of a walk made by hand."""

import io
import json
import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import gpxpy
import gtsam
import numpy as np
import pytest
from evo.tools import file_interface
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from pyarrow import parquet
from support.by_hand import way_along
from support.hostile import TEXTS, unseen
from support.results_by_hand import hand_log, hand_result

from fbgraph.core.aids import Told
from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.georeference import Georeference
from fbgraph.core.sensor_log import Event, empty_stream
from fbgraph.core.verdict import Integrity, Reason
from fbgraph.exports import FORMATS, exporter
from fbgraph.exports.exported_walk import ExportedWalk, exported_walk
from fbgraph.pipeline import write_files
from fbgraph.run.read_run import read_run

T0_S = 1_700_000_000.0  # 2023-11-14 22:13:20 UTC
START = Georeference(60.0, 20.0)
M_DEG = 180.0 / (math.pi * 6_371_000.0)
# 12.5 m East, 12.5 m North, a metre up; doubt grows, mostly across
FLAT = way_along((0.0, 0.0), (12.5, 0.0), (12.5, 12.5), t0_s=1.0)
COUNT = len(FLAT)
COV = np.zeros((COUNT, 3, 3))
COV[:, 0, 0], COV[:, 1, 1] = 0.01 * np.arange(COUNT), 0.04 * np.arange(COUNT)
COV[:, 0, 1] = COV[:, 1, 0] = 0.005 * np.arange(COUNT)
COV[:, 2, 2] = 0.01
WAY = replace(FLAT, z_m=np.linspace(0.0, 1.0, COUNT), cov_xy_yaw=COV, sigma_z_m=np.full(COUNT, 0.3))
DOUBT = Integrity("doubtful", (Reason("mag", 2.0, "the <compass> & gyroscope disagree", "walk again"),), 2.0)


def made(folder: Path, **given: Any) -> Path:
    """A run folder of a walk that was smoothed by hand."""
    folder.mkdir(parents=True)
    usual: dict[str, Any] = {"log": hand_log(t0_s=T0_S, events=(Event(1.0, "door"), Event(13.5, "=corner<b>")))}
    usual |= {"config": load_config("m5stickc", ["device.declination_deg=0"]), "told": Told(origin=START)}
    write_files(hand_result(WAY, replace(FLAT, y_m=FLAT.y_m + 1.0), **(usual | given)), folder, recording=False)
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("exports") / "run")


def walk_of(run: Path, format_: str, estimator: str = "smoothed", **given: Any) -> ExportedWalk:
    return exported_walk(read_run(run), estimator, format_, needs_place=exporter(format_).ON_EARTH, **given)


def written(run: Path, format_: str, estimator: str = "smoothed", **given: Any) -> tuple[bytes, list[str]]:
    out = io.BytesIO()
    notes = exporter(format_).write(walk_of(run, format_, estimator, **given), out)
    return out.getvalue(), notes


def metres(lon: float, lat: float) -> tuple[float, float]:
    """East and North of the start; half a per cent for the Earth not being a sphere."""
    return (lon - 20.0) / M_DEG * math.cos(math.radians(60.0)), (lat - 60.0) / M_DEG


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_says_what_it_is(name: str) -> None:
    module = exporter(name)
    assert 10 < len(module.DESCRIPTION) < 100
    assert module.SUFFIX.startswith(".")
    assert (name in ("mcap", "parquet"), name in ("gpx", "geojson", "kml")) == (module.BINARY, module.ON_EARTH)


def test_tum_and_csv_are_the_runs_own_files(run: Path) -> None:
    for name in ("smoothed", "ekf", "pdr"):
        assert written(run, "tum", name) == ((run / f"{name}.tum").read_bytes(), [])
    assert written(run, "csv")[0] == (run / "breadcrumbs.csv").read_bytes()


def test_what_an_estimator_does_not_say_is_nan(run: Path) -> None:
    row = written(run, "csv", "ekf")[0].decode().splitlines()[3].split(",")
    assert row[:5] == ["2", f"{T0_S + 2.0:.6f}", "1.000000", "1.000000", "0.000000"]
    assert row[6:] == ["nan"] * 6


def test_gpx_has_places_heights_and_times(run: Path) -> None:
    text, notes = written(run, "gpx", start_height_m=100.0)
    document = gpxpy.parse(text.decode())
    points = document.tracks[0].segments[0].points
    assert len(points) == COUNT
    assert metres(points[-1].longitude, points[-1].latitude) == pytest.approx((12.5, 12.5), rel=5e-3)
    assert (points[0].longitude, points[0].latitude) == (20.0, 60.0)
    assert [point.elevation for point in points] == pytest.approx(100.0 + WAY.z_m, abs=6e-4)
    assert points[0].time == datetime(2023, 11, 14, 22, 13, 21, tzinfo=UTC)
    assert (points[-1].time - points[0].time).total_seconds() == 25.0  # type: ignore[operator]
    door, corner = document.waypoints
    assert (door.name, corner.name) == ("door", "=corner<b>")
    assert metres(corner.longitude, corner.latitude) == pytest.approx((12.5, 0.0), rel=5e-3, abs=0.01)
    assert notes == []
    assert "heights are above the start" in " ".join(written(run, "gpx")[1])


def test_geojson_has_a_point_a_breadcrumb_with_its_sigma(run: Path) -> None:
    document = json.loads(written(run, "geojson")[0])
    line, *points = document["features"]
    assert line["geometry"]["type"] == "LineString"
    assert line["geometry"]["coordinates"] == [point["geometry"]["coordinates"] for point in points[:COUNT]]
    last = points[COUNT - 1]["properties"]
    assert metres(*points[COUNT - 1]["geometry"]["coordinates"]) == pytest.approx((12.5, 12.5), rel=5e-3)
    assert (last["k"], last["t_s"], last["time"]) == (50, T0_S + 26.0, "2023-11-14T22:13:46.000Z")
    assert (last["sigma_x_m"], last["sigma_y_m"]) == pytest.approx((math.sqrt(0.5), math.sqrt(2.0)), abs=1e-6)
    assert (last["cov_xy_m2"], last["sigma_z_m"], last["z_m"]) == pytest.approx((0.25, 0.3, 1.0), abs=1e-6)
    assert (points[0]["properties"]["heading_deg"], last["heading_deg"]) == (90.0, 0.0)
    assert [point["properties"]["label"] for point in points[COUNT:]] == ["door", "=corner<b>"]
    silent = json.loads(written(run, "geojson", "ekf")[0])["features"][1]["properties"]
    assert (silent["sigma_x_m"], silent["sigma_yaw_rad"]) == (None, None)


def test_kml_has_a_line_and_points(run: Path) -> None:
    root = Xml.fromstring(written(run, "kml", start_height_m=5.0)[0])
    space = {"k": "http://www.opengis.net/kml/2.2"}
    line = (root.findtext(".//k:LineString/k:coordinates", "", space)).split()
    assert len(line) == COUNT
    lon, lat, height = (float(number) for number in line[-1].split(","))
    assert (*metres(lon, lat), height) == pytest.approx((12.5, 12.5, 6.0), rel=5e-3)
    names = [mark.findtext("k:name", "", space) for mark in root.iterfind("k:Document/k:Placemark", space)]
    assert names == ["hand (smoothed)", "door", "=corner<b>"]
    crumbs = root.findall(".//k:Folder/k:Placemark", space)
    assert [mark.findtext("k:Point/k:coordinates", "", space) for mark in crumbs] == line
    assert crumbs[-1].findtext("k:TimeStamp/k:when", "", space) == "2023-11-14T22:13:46.000Z"
    known = {
        one.attrib["name"]: float(one.findtext("k:value", "", space))
        for one in crumbs[-1].iter(f"{{{space['k']}}}Data")
    }
    assert known["sigma_y_m"] == pytest.approx(math.sqrt(2.0), abs=1e-6)


def test_euroc_is_read_by_evo(run: Path, tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_bytes(written(run, "euroc")[0])
    back = file_interface.read_euroc_csv_trajectory(tmp_path / "data.csv")
    assert back.timestamps == pytest.approx(WAY.t_s + T0_S, abs=1e-6)
    assert back.positions_xyz == pytest.approx(np.column_stack((WAY.x_m, WAY.y_m, WAY.z_m)), abs=1e-6)
    assert back.orientations_quat_wxyz[-1] == pytest.approx([math.sqrt(0.5), 0, 0, math.sqrt(0.5)])
    assert (tmp_path / "data.csv").read_text().splitlines()[1].startswith("1700000001000000000,0.000000,")


def covariance(graph: gtsam.NonlinearFactorGraph, edge: int) -> FloatArray:
    factor = graph.at(edge)
    assert isinstance(factor, gtsam.BetweenFactorPose2)
    model = factor.noiseModel()
    assert isinstance(model, gtsam.noiseModel.Gaussian)
    return np.asarray(model.covariance())


def test_g2o_is_read_by_gtsam(run: Path, tmp_path: Path) -> None:
    walk, turn_rad = walk_of(run, "g2o"), 0.5
    with open(tmp_path / "walk.g2o", "wb") as out:
        assert exporter("g2o").write(replace(walk, trajectory=walk.trajectory.turned(turn_rad)), out) == []
    graph, values = gtsam.readG2o(str(tmp_path / "walk.g2o"), False)
    assert (graph.size(), values.size()) == (COUNT - 1, COUNT)
    assert graph.error(values) < 1e-6
    pose = values.atPose2(COUNT - 1)
    turned = gtsam.Rot2(turn_rad).matrix()
    assert pose.translation() == pytest.approx(turned @ (12.5, 12.5), abs=1e-5)
    assert pose.theta() == pytest.approx(math.pi / 2 + turn_rad, abs=1e-6)
    grown = np.zeros((2, 2))
    for k in range(graph.size()):  # what each edge says of its end, in the world
        cov = covariance(graph, k)
        turn = values.atPose2(k + 1).rotation().matrix()
        grown += turn @ cov[:2, :2] @ turn.T
        assert cov[2, 2] == pytest.approx(0.02**2)  # yaw is no less sure at the end: one step's own
    assert grown == pytest.approx(turned @ COV[-1, :2, :2] @ turned.T, abs=1e-4)


def test_g2o_without_covariance_takes_a_step_s_own(run: Path, tmp_path: Path) -> None:
    text, notes = written(run, "g2o", "ekf")
    (tmp_path / "walk.g2o").write_bytes(text)
    graph, _ = gtsam.readG2o(str(tmp_path / "walk.g2o"), False)
    along = (0.05 * 0.5) ** 2 + 0.05**2  # the preset's
    assert np.diag(covariance(graph, 3)) == pytest.approx([along, 0.05**2, 0.02**2], rel=1e-6)
    assert "ekf gives no covariance" in notes[0]


def test_parquet_has_units_and_nulls(run: Path) -> None:
    table = parquet.read_table(io.BytesIO(written(run, "parquet")[0]))
    assert table.column_names == (run / "breadcrumbs.csv").read_text().splitlines()[0].split(",")
    breadcrumbs = np.loadtxt(run / "breadcrumbs.csv", delimiter=",", skiprows=1)
    assert np.column_stack([column.to_numpy() for column in table.columns]) == pytest.approx(breadcrumbs, abs=1e-9)
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert (units["k"], units["t_s"], units["x_m"], units["cov_xy_m2"]) == ("1", "s", "m", "m^2")
    assert (units["yaw_rad"], units["gyro_bias_rad_s"], units["sigma_yaw_rad"]) == ("rad", "rad/s", "rad")
    assert (table.schema.metadata[b"name"], table.schema.metadata[b"clock"]) == (b"hand", b"Unix time")
    assert parquet.read_table(io.BytesIO(written(run, "parquet", "pdr")[0]))["sigma_x_m"].null_count == COUNT


def messages(data: bytes) -> dict[str, list[tuple[str, int, Any]]]:
    """(schema, time, message) of each topic."""
    found: dict[str, list[tuple[str, int, Any]]] = {}
    reader = make_reader(io.BytesIO(data), validate_crcs=True, decoder_factories=[DecoderFactory()])
    for schema, channel, message, decoded in reader.iter_decoded_messages():
        assert schema is not None
        found.setdefault(channel.topic, []).append((schema.name, message.log_time, decoded))
    return found


def test_mcap_has_poses_covariance_places_and_events(run: Path) -> None:
    data, notes = written(run, "mcap")
    found = messages(data)
    assert {topic: (len(rows), rows[0][0]) for topic, rows in found.items()} == {
        "/tf": (COUNT, "foxglove.FrameTransform"),
        "/pose": (COUNT, "foxglove.PoseInFrame"),
        "/odometry": (COUNT, "foxglove.Odometry"),
        "/path": (1, "foxglove.PosesInFrame"),
        "/fix": (COUNT, "foxglove.LocationFix"),
        "/events": (2, "foxglove.Log"),
    }
    assert any(note.startswith("without the sensors: ") for note in notes)  # this run had no file
    last = found["/odometry"][-1]
    assert last[1] == last[2].timestamp.ToNanoseconds() == 1_700_000_026_000_000_000
    pose = last[2].pose
    assert (pose.position.x, pose.position.y, pose.position.z) == pytest.approx((12.5, 12.5, 1.0))
    assert (pose.orientation.z, pose.orientation.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)
    cov = np.reshape(last[2].pose_covariance, (6, 6))
    assert np.diag(cov) == pytest.approx([0.5, 2.0, 0.09, 0.0, 0.0, 0.01], abs=1e-5)
    assert cov[0, 1] == cov[1, 0] == pytest.approx(0.25, abs=1e-5)
    moved = found["/tf"][-1][2]
    assert (moved.parent_frame_id, moved.child_frame_id, moved.translation.x) == ("walk", "walker", 12.5)
    assert len(found["/path"][0][2].poses) == COUNT
    fix = found["/fix"][-1][2]
    assert metres(fix.longitude, fix.latitude) == pytest.approx((12.5, 12.5), rel=5e-3)
    assert (fix.position_covariance_type, fix.heading) == (3, pytest.approx(0.0, abs=1e-6))
    assert [row[2].message for row in found["/events"]] == ["door", "=corner<b>"]


def test_of_an_estimator_without_covariance_mcap_claims_none(run: Path) -> None:
    found = messages(written(run, "mcap", "ekf")[0])
    assert found["/fix"][0][2].position_covariance_type == 0
    assert not np.any(found["/odometry"][-1][2].pose_covariance)


def test_a_clock_of_its_own_gives_no_dates(tmp_path: Path) -> None:
    run = made(tmp_path / "run", log=hand_log(t0_s=-40.0, events=(Event(2.0, "x"),)))
    text, notes = written(run, "gpx")
    assert {point.time for point in gpxpy.parse(text.decode()).tracks[0].segments[0].points} == {None}
    assert "the log's clock does not show the date: no time of day is written" in notes
    data, notes = written(run, "mcap")
    assert messages(data)["/pose"][0][1] == 0  # at -39 s of its clock
    assert "the log's clock begins before zero: times are 39 s later than its" in notes


def test_true_north_is_found_and_heights_without_a_barometer_are_not(tmp_path: Path) -> None:
    config = load_config("m5stickc", [])
    run = made(tmp_path / "run", config=config, told=Told(), log=hand_log(t0_s=T0_S, pressure=empty_stream(1)))
    walk = walk_of(run, "gpx", start=START)
    assert walk.placed is not None
    assert walk.placed.field is not None
    turn = -math.radians(walk.placed.field.declination_deg)
    assert math.degrees(turn) == pytest.approx(-8.6, abs=0.7)  # Åland
    text, notes = written(run, "gpx", start=START)
    last = gpxpy.parse(text.decode()).tracks[0].segments[0].points[-1]
    x_m, y_m = 12.5 * (math.cos(turn) - math.sin(turn)), 12.5 * (math.sin(turn) + math.cos(turn))
    assert metres(last.longitude, last.latitude) == pytest.approx((x_m, y_m), rel=5e-3)
    assert last.elevation is None
    assert notes == ["no barometer: heights are left out"]
    with pytest.raises(ConfigError, match="kml needs latitude and longitude"):
        walk_of(run, "kml")


def test_without_a_compass_there_is_no_map(tmp_path: Path) -> None:
    run = made(tmp_path / "run", log=hand_log(t0_s=T0_S, mag=empty_stream(3)))
    with pytest.raises(ConfigError, match="geojson: the log has no magnetometer"):
        walk_of(run, "geojson", start=START)
    assert "/fix" not in messages(written(run, "mcap", start=START)[0])


@pytest.mark.parametrize("name", FORMATS)
def test_hostile_names_and_labels_do_nothing(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    run = hostile_run(tmp_path_factory)
    data, _ = written(run, name)
    if name == "mcap":
        labels = [row[2].message for row in messages(data)["/events"]]
        assert unseen("".join(labels)) == set()
    elif name == "parquet":
        assert unseen(parquet.read_table(io.BytesIO(data)).schema.metadata[b"name"].decode()) == set()
    else:
        assert unseen(data.decode()) == set()
    if name == "geojson":
        assert json.loads(data)["features"][0]["properties"]["name"] == " ".join(TEXTS)
    if name == "kml":
        assert not list(Xml.fromstring(data).iter("script"))


_hostile: dict[str, Path] = {}


def hostile_run(factory: pytest.TempPathFactory) -> Path:
    if "run" not in _hostile:
        events = tuple(Event(2.0 + k, text) for k, text in enumerate(TEXTS))
        log = replace(hand_log(t0_s=T0_S, events=events), name=" ".join(TEXTS))
        _hostile["run"] = made(factory.mktemp("hostile") / "run", log=log, integrity=DOUBT)
    return _hostile["run"]


def test_a_doubtful_walk_says_so_in_what_is_written(tmp_path: Path) -> None:
    run = made(tmp_path / "run", integrity=DOUBT)
    said = "Do not rely on this walk: its position is doubtful. the <compass> & gyroscope disagree: walk again."
    assert (gpxpy.parse(written(run, "gpx")[0].decode()).description or "").startswith(said)
    assert json.loads(written(run, "geojson")[0])["features"][0]["properties"]["caution"] == said
    assert parquet.read_table(io.BytesIO(written(run, "parquet")[0])).schema.metadata[b"caution"].decode() == said
    (about,) = make_reader(io.BytesIO(written(run, "mcap")[0])).iter_metadata()
    assert about.metadata["caution"].startswith(said)
    assert said in Xml.fromstring(written(run, "kml")[0]).findtext(".//{*}description", "")
