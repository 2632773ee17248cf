"""Recordings: Rerun accepts them, equal walks give equal ones, and what is in them is what was found."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import Chunk, RrdReader
from support.commands import rrd
from support.recordings import TIMELINES, cells, chunks_of, column, shown, tabs, views

from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.colors import COLORS, LABELS
from fbgraph.core.config import load_config
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Event, SensorLog, Stream, empty_stream
from fbgraph.pipeline import reconstruct
from fbgraph.readers import read_log
from fbgraph.recording.map_frame import Frame
from fbgraph.recording.recorder import write_recording
from fbgraph.run.metrics import score
from fbgraph.run.walk_result import ESTIMATORS, WalkResult
from fbgraph.session import replay_log
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import SimulateOptions

T0_S = 1000.0
PATHS = ("pdr", "ekf", "smoothed")


def straight_walk(seconds: float = 30.0, *, aided: bool = True) -> SensorLog:
    """Stand for 6 s, then walk North at 1.8 steps a second, the device flat and facing North."""
    rng = np.random.default_rng(7)
    t_s = np.arange(0.0, seconds, 0.01)
    count = len(t_s)
    walks, step = t_s > 6.0, 2.0 * np.pi * 1.8 * t_s
    bounce = np.where(walks, 2.5 * np.sin(step), 0.0)
    push, sway = np.where(walks, 1.2 * np.cos(step), 0.0), np.where(walks, 0.8 * np.sin(0.5 * step), 0.0)
    acc = np.column_stack((sway, push, 9.81 + bounce)) + rng.normal(0.0, 0.02, (count, 3))
    gyro = rng.normal(0.0, 0.003, (count, 3))
    gyro[:, 0] += np.where(walks, 0.2 * np.cos(step), 0.0)
    mag = np.array((0.0, 20.0, -40.0)) + rng.normal(0.0, 0.3, (count, 3))
    pressure = 1000.0 + rng.normal(0.0, 0.02, (count, 1))
    return SensorLog(
        name="straight",
        format="synthetic",
        t0_s=T0_S,
        acc=Stream(t_s, acc),
        gyro=Stream(t_s, gyro),
        mag=Stream(t_s, mag) if aided else empty_stream(3),
        pressure=Stream(t_s, pressure) if aided else empty_stream(1),
        events=(Event(4.0, "button"), Event(20.0, "button again")) if aided else (),
        notices=("made up",) if aided else (),
    )


def truth_of(log: SensorLog) -> Checkpoints:
    """A place every 7 s along 1.1 m/s North, surveyed in a frame far from the log's, the last one passed twice."""
    t_s = np.array((6.0, 13.0, 20.0, 27.0, 28.0))
    y_m = 1.1 * (np.minimum(t_s, 27.0) - 6.0)
    return checkpoints(t_s + log.t0_s, np.full(5, 500.0), 200.0 + y_m, source="made up")


@pytest.fixture(scope="module")
def walk() -> WalkResult:
    log = straight_walk()
    return reconstruct(log, load_config(), Told(truth_of(log), closed_walk=True))


@pytest.fixture(scope="module")
def bare_walk() -> WalkResult:
    return reconstruct(straight_walk(aided=False), load_config())


@pytest.fixture(scope="module")
def recorded(walk: WalkResult, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Chunk]]:
    return record(walk, tmp_path_factory.mktemp("recorded") / "walk.rrd")


def record(result: WalkResult, path: Path) -> dict[str, list[Chunk]]:
    """Write it, have Rerun check it, read it back by entity."""
    write_recording(result, path, "# A walk\n\nMostly straight.")
    verified = rrd("verify", path)
    assert verified.returncode == 0, verified.stderr
    return chunks_of(path)


TABS = {
    "The walk": ("map/smoothed/path", "map/smoothed/ellipses", "map/truth", "map/legend", "lanes/wearer", "summary"),
    "Did heading go wrong?": (
        *(f"state/yaw_deg/{name}" for name in (*PATHS, "compass", "smoothed_2sigma")),
        *("state/magnetic_disturbance_deg", "state/gyro_bias_deg_s/smoothed_2sigma", "state/gyro_bias_deg_s/rest"),
        *("state/field/norm_ut", "state/field/dip_deg", "lanes/compass"),
    ),
    "Did steps go wrong?": (
        *("steps", "state/acc_norm_m_s2", "state/step_length_m/measured", "state/step_length_m/smoothed"),
        *("state/step_frequency_hz", "legs/length_percent"),
    ),
    "Altitude": ("state/altitude_m/barometer", "state/altitude_m/smoothed", "state/altitude_m/smoothed_2sigma"),
    "Error": (*(f"error_m/{name}" for name in PATHS), "uncertainty_m/smoothed_2sigma", "legs/direction_deg"),
    "The way back": ("map/return/legs", "return/instructions"),
    "The graph": ("residuals", "state/compass_trust", "graph", "solver"),
    "3-D": ("world/smoothed/path", "world/pdr/path", "world/truth/path"),
    "Raw sensors": tuple(f"sensors/{name}" for name in ("acc", "gyro", "mag", "pressure")),
    "Summary": ("summary", "events"),
}
"""What each question is answered by; a group stands for what lies below it."""


@pytest.mark.parametrize("name", TABS)
def test_each_tab_shows_what_answers_its_question(recorded: dict[str, list[Chunk]], name: str) -> None:
    tab = tabs(set(recorded))[name]
    seen = [shown(view, recorded) for view in views(tab)]
    assert seen
    assert all(seen), "a view without content"
    for group in TABS[name]:
        assert any(e == group or e.startswith(f"{group}/") for some in seen for e in some), group


def test_tabs_are_those_of_the_walk_and_everything_is_on_one_of_them(recorded: dict[str, list[Chunk]]) -> None:
    found = tabs(set(recorded))
    assert list(found) == list(TABS)
    seen = {e for tab in found.values() for view in views(tab) for e in shown(view, recorded)}
    # what would clutter the space is on the map only
    assert {e.replace("world/", "map/") for e in set(recorded) - seen} <= seen


def seconds(t: object) -> float:
    assert isinstance(t, timedelta)
    return t.total_seconds()


def test_every_chunk_is_on_its_timelines_and_none_on_the_wall_clock(recorded: dict[str, list[Chunk]]) -> None:
    only_time = ("sensors/", "state/acc_norm_m_s2")
    for entity, chunks in recorded.items():
        for chunk in chunks:
            expected = {"time"} if entity.startswith(only_time) else set(TIMELINES)
            assert set(chunk.timeline_names) == (set() if chunk.is_static else expected), entity


def test_positions_on_all_timelines(walk: WalkResult, recorded: dict[str, list[Chunk]]) -> None:
    chunks = recorded["world/smoothed/position"]
    smoothed = walk.smoothed.trajectory
    positions = column(chunks, "Points3D:positions")
    np.testing.assert_allclose(positions[:, :2], smoothed.xy_m, atol=1e-4)
    assert cells(chunks, "step") == list(range(len(smoothed)))
    np.testing.assert_allclose(column(chunks, "distance_cm")[:, 0], 100.0 * smoothed.distance_m, atol=0.51)
    np.testing.assert_allclose([seconds(t) for t in cells(chunks, "time")], smoothed.t_s, atol=1e-6)


def test_sensors_keep_every_sample(walk: WalkResult, recorded: dict[str, list[Chunk]]) -> None:
    for name, resolution in (("acc", 1e-3), ("gyro", 3e-4), ("mag", 0.02), ("pressure", 1e-3)):
        values = column(recorded[f"sensors/{name}"], "Scalars:scalars")
        np.testing.assert_allclose(values, getattr(walk.log, name).values, atol=resolution)


def test_map_is_north_up_and_truth_is_moved_onto_the_walk(walk: WalkResult, recorded: dict[str, list[Chunk]]) -> None:
    scale = column(recorded["map"], "Transform3D:scale", static=True)
    assert scale.tolist() == [[1.0, -1.0, 1.0]]
    places = column(recorded["world/truth/path"], "LineStrips3D:strips", static=True).reshape(-1, 3)
    smoothed = walk.smoothed.trajectory
    truth = walk.told.truth
    assert truth is not None
    first = smoothed.at(truth.t_s[:1] - T0_S)[0]
    np.testing.assert_allclose(places[0], first, atol=1e-4)
    np.testing.assert_allclose(np.diff(places[:, 1]), np.diff(truth.y_m), atol=1e-4)


def test_errors_are_the_scored_ones(walk: WalkResult, recorded: dict[str, list[Chunk]]) -> None:
    truth = walk.told.truth
    assert truth is not None
    for name in PATHS:
        error_m = column(recorded[f"error_m/{name}"], "Scalars:scalars")[:, 0]
        expected = score(walk.trajectories[name], truth, T0_S)
        assert np.sqrt((error_m**2).mean()) == pytest.approx(expected.rmse_m)


def test_equal_walks_give_equal_recordings_and_others_do_not(walk: WalkResult, tmp_path: Path) -> None:
    first, second, other = tmp_path / "a.rrd", tmp_path / "b.rrd", tmp_path / "c.rrd"
    log = straight_walk()
    again = reconstruct(log, load_config(), Told(truth_of(log), closed_walk=True))
    for result, path in ((walk, first), (again, second), (replace(walk, told=Told(walk.told.truth)), other)):
        write_recording(result, path, "the same")
    compared = rrd("compare", first, second)
    assert compared.returncode == 0, compared.stderr
    assert rrd("compare", first, other).returncode != 0
    ids = [RrdReader(path).recordings()[0].recording_id for path in (first, second)]
    assert ids[0] == ids[1]
    assert ids[0].startswith("straight-")


def test_walk_without_compass_barometer_and_truth(bare_walk: WalkResult, tmp_path: Path) -> None:
    found = set(record(bare_walk, tmp_path / "bare.rrd"))
    absent = (
        *("sensors/mag", "sensors/pressure", "state/field", "state/altitude_m", "error_m", "world/truth", "events"),
        *("geo", "legs", "state/magnetic_disturbance_deg", "residuals/compass", "map/believed"),
    )
    assert not [entity for entity in found if entity.startswith(absent)]
    assert (
        not {
            "state/yaw_deg/compass",
            "world/anchors/places",
            "world/smoothed/closed_walk",
            "lanes/compass",
            "lanes/known_places",
            "map/events",
            "world/events",
        }
        & found
    )
    assert {f"world/{name}/path" for name in PATHS} <= found


def test_anchors_keep_their_frame_and_the_others_set_out_with_the_smoothed(tmp_path: Path) -> None:
    log = straight_walk()
    truth = truth_of(log)
    result = reconstruct(log, load_config(), Told(truth, truth.select(slice(0, None, 2))))
    chunks = record(result, tmp_path / "anchored.rrd")
    places = column(chunks["map/truth/path"], "LineStrips2D:strips", static=True).reshape(-1, 2)
    np.testing.assert_allclose(places, truth.xy_m, atol=1e-4)
    anchors = column(chunks["map/anchors/places"], "Points2D:positions", static=True).reshape(-1, 2)
    np.testing.assert_allclose(anchors, truth.xy_m[::2], atol=1e-4)
    edges = column(chunks["map/anchors/edges"], "LineStrips2D:strips", static=True).reshape(-1, 2, 2)
    np.testing.assert_allclose(edges[:, 0], truth.xy_m[::2], atol=1e-4)
    np.testing.assert_allclose(edges[:, 1], result.smoothed.trajectory.at(truth.t_s[::2] - T0_S)[:, :2], atol=1.0)
    start = column(chunks["map/smoothed/position"], "Points2D:positions")[0]
    for name in PATHS:
        np.testing.assert_allclose(column(chunks[f"map/{name}/position"], "Points2D:positions")[0], start, atol=1e-4)


def test_headings_are_within_half_a_turn_of_the_smoothed(walk: WalkResult, tmp_path: Path) -> None:
    pdr = walk.trajectories["pdr"]
    turned = replace(walk, trajectories={**walk.trajectories, "pdr": replace(pdr, yaw_rad=pdr.yaw_rad + 8.0 * np.pi)})
    chunks = record(turned, tmp_path / "turned.rrd")
    yaw_deg = column(chunks["state/yaw_deg/smoothed"], "Scalars:scalars")
    np.testing.assert_allclose(yaw_deg[:, 0], np.degrees(walk.smoothed.trajectory.yaw_rad))
    assert np.abs(column(chunks["state/yaw_deg/pdr"], "Scalars:scalars") - yaw_deg).max() < 30.0
    assert np.abs(column(chunks["state/yaw_deg/compass"], "Scalars:scalars") - 90.0).max() < 30.0


def test_truth_of_another_log_is_shown_but_not_scored(walk: WalkResult, tmp_path: Path) -> None:
    assert walk.told.truth is not None
    late = walk.told.truth.since(-1e6)
    found = set(record(replace(walk, told=Told(late)), tmp_path / "late.rrd"))
    assert "world/truth/checkpoints" in found
    assert not [entity for entity in found if entity.startswith("error_m")]


def test_online_estimate_is_shown_where_there_is_one(walk: WalkResult, tmp_path: Path) -> None:
    more = replace(walk, trajectories={**walk.trajectories, "online": walk.trajectories["ekf"]})
    found = set(record(more, tmp_path / "online.rrd"))
    assert {"world/online/path", "map/online/position", "state/yaw_deg/online", "error_m/online"} <= found


def test_a_way_back_shows_its_closures_and_what_was_told(tmp_path: Path) -> None:
    walk = simulate(load_route("out-and-back", 2.0), SimulateOptions(), seed=2)
    config = load_config("m5stickc", ["returning.at=auto"])
    result = replay_log(walk.log, config, chunk_s=1.0)
    assert result.returning
    assert result.smoothed.closures
    chunks = record(result, tmp_path / "back.rrd")
    edges = column(chunks["map/closures"], "LineStrips2D:strips", static=True).reshape(-1, 2, 2)
    ends = [(closure.j, closure.i) for closure in result.smoothed.closures]
    np.testing.assert_allclose(edges, result.smoothed.trajectory.xy_m[np.array(ends)], atol=1e-4)
    remaining = column(chunks["return/remaining_m"], "Scalars:scalars")[:, 0]
    np.testing.assert_allclose(remaining, [update.remaining_m for update in result.returning])
    assert {"map/return/match", "return/told", "return/cross_track_m", "lanes/way_back"} <= set(chunks)


def test_an_hour_fits(tmp_path: Path) -> None:
    """41 MB for 360,000 samples of four sensors at full rate, noise and all: from how much 3 minutes more add."""
    sizes = []
    for seconds in (60.0, 240.0):
        write_recording(reconstruct(straight_walk(seconds), load_config()), tmp_path / "long.rrd", "")
        sizes.append((tmp_path / "long.rrd").stat().st_size)
    assert (sizes[1] - sizes[0]) * 20 < 41e6


def test_file_that_cannot_be_written(walk: WalkResult, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="absent"):
        write_recording(walk, tmp_path / "absent" / "walk.rrd", "")


def test_real_walk(shared_data: Path, tmp_path: Path) -> None:
    file = read_log(shared_data / "ipin2023" / "TrainingTrial01_repetition03.txt.gz")
    result = reconstruct(file.log, load_config(), Told(file.truth))
    path = tmp_path / "real.rrd"
    found = record(result, path)
    assert len(RrdReader(path).blueprints()) == 1
    assert {"error_m/smoothed", "state/altitude_m/smoothed_2sigma", "state/gyro_bias_deg_s/rest"} <= set(found)


def test_places_passed_again_share_a_label(walk: WalkResult, tmp_path: Path) -> None:
    """Truth is shown at the walk's own altitude; truth too dense for labels has none."""
    smoothed = walk.smoothed.trajectory
    climbed = replace(smoothed, z_m=np.where(smoothed.t_s > 24.0, 4.0, 0.0))
    climb = replace(walk, smoothed=replace(walk.smoothed, trajectory=climbed))
    t_s, x_m = T0_S + np.array((6.0, 13.0, 20.0, 27.0)), np.array((0.0, 5.0, 0.1, 5.0))
    told = Told(checkpoints(t_s, x_m, np.zeros(4)))
    marked = record(replace(climb, told=told), tmp_path / "labels.rrd")["map/truth/checkpoints"]
    assert cells(marked, "Points2D:labels", static=True) == [["1, 3", "2", "4"]]
    dense = np.linspace(6.0, 27.0, 500)
    told = Told(checkpoints(T0_S + dense, np.zeros(500), 1.1 * dense))
    assert "map/truth/checkpoints" not in record(replace(walk, told=told), tmp_path / "dense.rrd")


def test_laps_are_taken_off_and_walking_along_the_cut_does_not_flicker(walk: WalkResult, tmp_path: Path) -> None:
    smoothed = walk.smoothed.trajectory
    count = len(smoothed)

    def shown_deg(yaw_rad: FloatArray) -> FloatArray:
        turned = replace(smoothed, yaw_rad=yaw_rad)
        result = replace(
            walk,
            smoothed=replace(walk.smoothed, trajectory=turned),
            trajectories={**walk.trajectories, "smoothed": turned},
        )
        chunks = record(result, tmp_path / "turned.rrd")
        return column(chunks["state/yaw_deg/smoothed"], "Scalars:scalars")[:, 0]

    assert np.abs(shown_deg(np.linspace(0.0, 40.0 * np.pi, count))).max() <= 271.0
    west = np.pi + 0.2 * np.sin(np.arange(count, dtype=np.float64))
    assert np.abs(np.diff(shown_deg(west))).max() < 25.0


def test_frame_holds_the_walk_and_its_legend() -> None:
    frame = Frame.around(np.array(((0.0, 0.0), (60.0, 20.0))))
    assert frame.size_m == 60.0
    assert frame.legend_x_m > 60.0
    assert frame.scale_bar_m == 10.0
    tiny = Frame.around(np.zeros((3, 2)))
    assert tiny.size_m == 4.0
    assert tiny.scale_bar_m == 0.5


def test_every_estimator_has_its_own_colour() -> None:
    assert len({COLORS[name] for name in ESTIMATORS}) == len(ESTIMATORS)
    assert set(ESTIMATORS) == set(LABELS)
