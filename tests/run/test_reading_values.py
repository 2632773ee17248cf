"""A run folder read back: every column where it belongs, every refusal in its words."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.by_hand import way_along
from support.results_by_hand import hand_log, hand_result, with_cov

from fbgraph.core.aids import Told
from fbgraph.core.bounded import RUN_BYTES
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import Config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.georeference import Georeference
from fbgraph.core.sensor_log import Event
from fbgraph.core.tables import read_text
from fbgraph.pipeline import read_told
from fbgraph.run.folder import BREADCRUMB_HEADER, write_tables
from fbgraph.run.inputs import RunInputs
from fbgraph.run.read_run import (
    read_breadcrumbs,
    read_directions,
    read_events,
    read_georeference,
    read_run,
    read_summary,
    score_run,
    trajectory_of,
)
from fbgraph.run.summary import summarize
from fbgraph.way_back.legs import Directions

EL = with_cov(way_along((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), t0_s=1.0))
PDR = way_along((0.0, 0.0), (30.0, 0.0), t0_s=1.0)
T0_S = 1000.0


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run folder with an event at 11 s, which is 10 m along."""
    result = hand_result(
        EL, log=hand_log(events=(Event(11.0, "door"),)), trajectories={"pdr": PDR, "ekf": EL, "smoothed": EL}
    )
    write_tables(result, tmp_path, summarize(result))
    return tmp_path


def edit(run: Path, **changes: Any) -> None:
    """Change entries of the summary by hand, so that its digests no longer hold."""
    summary = json.loads((run / "summary.json").read_text())
    summary.pop("sha256", None)
    (run / "summary.json").write_text(json.dumps(summary | changes))


def directions(run: Path, *given: Any) -> Directions:
    """The way of a run folder."""
    return read_directions(read_run(run), *given)


def test_every_column_of_breadcrumbs_is_read(tmp_path: Path) -> None:
    row = "0,100.5,1.0,2.0,3.0,0.5,0.004,0.3,0.4,0.05,0.6,0.07"
    (tmp_path / "b.csv").write_text(f"{BREADCRUMB_HEADER}\n{row}\n")
    way = read_breadcrumbs(tmp_path / "b.csv")
    columns = (way.t_s, way.x_m, way.y_m, way.z_m, way.yaw_rad, way.gyro_bias_rad_s)
    assert [float(column[0]) for column in columns] == [100.5, 1.0, 2.0, 3.0, 0.5, 0.004]
    assert way.cov_xy_yaw is not None
    assert way.sigma_z_m is not None
    assert way.sigma_z_m[0] == 0.6
    cov = way.cov_xy_yaw[0]
    assert (cov[0, 0], cov[1, 1], cov[2, 2]) == pytest.approx((0.09, 0.16, 0.0049))
    assert cov[0, 1] == cov[1, 0] == 0.05
    assert np.isnan([cov[0, 2], cov[2, 0], cov[1, 2], cov[2, 1]]).all()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("k,t_s\n", "its header is not k,t_s"),
        (f"{BREADCRUMB_HEADER}\n", "no row in it"),
    ],
)
def test_what_is_no_table_of_breadcrumbs_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "b.csv").write_text(text)
    with pytest.raises(DataError, match=f"b.csv: not readable as breadcrumbs: {reason}"):
        read_breadcrumbs(tmp_path / "b.csv")
    with pytest.raises(DataError, match=r"c\.csv: No such file or directory; check the path"):
        read_breadcrumbs(tmp_path / "c.csv")


def test_a_file_of_a_run_is_bounded_and_its_lines_end_in_any_way(tmp_path: Path) -> None:
    with open(tmp_path / "b.csv", "wb") as out:
        out.truncate(RUN_BYTES + 1)
    with pytest.raises(DataError, match=r"b\.csv: 256 MiB or more, the limit is 256 MiB"):
        read_breadcrumbs(tmp_path / "b.csv")
    (tmp_path / "c.csv").write_bytes(b"a\r\nb\rc\n\n")
    assert read_text(tmp_path / "c.csv", "text") == "a\nb\nc\n\n"
    (tmp_path / "c.csv").write_bytes(b"\xff")
    with pytest.raises(DataError, match=r"c\.csv: not readable as text: 'utf-8' codec"):
        read_text(tmp_path / "c.csv", "text")


ROW = "0,100.5,1.0,2.0,3.0,0.5,0.004,0.3,0.4,0.05,0.6,0.07"


@pytest.mark.parametrize(
    ("cells", "reason"),
    [
        ("1,2,3", "line 3: expected 12 numbers"),
        (ROW.replace("100.5", "x"), "line 3: expected 12 numbers"),
        (ROW, "line 3: its number k does not follow that of the line before"),
        ("1" + ROW[1:], "line 3: its time is not later than that of the line before"),
        ("1,inf" + ROW[7:], "line 3: not all of its numbers are finite"),
        ("1,1e308" + ROW[7:], r"line 3: a number of it is beyond 1e\+15"),
        ("1,101,-2e15" + ROW[11:], r"line 3: a number of it is beyond 1e\+15"),
        ("1,4.1e9" + ROW[7:], "line 3: its time is none that a clock shows"),
        ("1,101" + ROW[7:].replace("0.07", "-0.07"), "line 3: its standard deviations cannot be"),
        ("1,101" + ROW[7:].replace("0.4,", "1e6,"), "line 3: its standard deviations cannot be"),
        ("1,101" + ROW[7:].replace("0.6,", "nan,"), "line 3: its sigma_z_m cannot be"),
        ("1,101" + ROW[7:].replace("0.05,", "0.12001,"), "line 3: its cov_xy_m2 cannot be"),
        ("1,101" + ROW[7:].replace("0.05,", "nan,"), "line 3: its cov_xy_m2 cannot be"),
    ],
)
def test_a_row_that_cannot_be_is_told_by_its_line(tmp_path: Path, cells: str, reason: str) -> None:
    (tmp_path / "b.csv").write_text(f"{BREADCRUMB_HEADER}\n{ROW}\n{cells}\n")
    with pytest.raises(DataError, match=f"b.csv: {reason}"):
        read_breadcrumbs(tmp_path / "b.csv")


def test_a_row_that_may_be_is_read_and_one_cut_off_is_not(tmp_path: Path) -> None:
    second = "1,101" + ROW[7:].replace("0.05,", "-0.12,").replace("0.6,", "999999,")
    (tmp_path / "b.csv").write_text(f"{BREADCRUMB_HEADER}\n{ROW}\n{second}\n")
    assert len(read_breadcrumbs(tmp_path / "b.csv")) == 2
    (tmp_path / "b.csv").write_text(f"{BREADCRUMB_HEADER}\n{ROW}\n{second}")
    with pytest.raises(DataError, match="line 3: cut off in its middle"):
        read_breadcrumbs(tmp_path / "b.csv")


def test_trajectories_are_on_the_event_clock(run: Path) -> None:
    saved = read_run(run)
    assert saved.folder == run
    assert set(saved.digests) == {path.name for path in run.iterdir()}
    assert saved.read_config() == Config()
    assert trajectory_of(saved, "pdr").x_m[-1] == pytest.approx(30.0)
    assert trajectory_of(saved, "pdr").t_s[0] == pytest.approx(T0_S + 1.0)
    smoothed = trajectory_of(saved, "smoothed")
    assert smoothed.cov_xy_yaw is not None
    assert smoothed.cov_xy_yaw[7, 1, 1] == pytest.approx(0.16)
    with pytest.raises(ConfigError, match="unknown estimator 'gps': expected one of pdr, ekf, smoothed, online"):
        trajectory_of(saved, "gps")
    with pytest.raises(DataError, match="this run has no online trajectory, only pdr, ekf, smoothed"):
        trajectory_of(saved, "online")


def test_events_have_a_time_and_the_logs_own_label() -> None:
    events = [{"t_s": 7, "label": " a\x00b "}, {"t_s": 8.5, "label": "\x07"}, {"t_s": 9, "label": " \t"}]
    assert read_events({"log": {"events": events}}) == [(7.0, " a\x00b "), (8.5, "\x07")]
    assert read_events({"log": {"events": 3}}) == read_events({"log": {}}) == []  # early versions counted them


def test_where_on_earth_is_read() -> None:
    summary = {"georeference": {"lat_deg": 49.5, "lon_deg": 11}}
    assert read_georeference(summary) == Georeference(49.5, 11.0)
    assert read_georeference({}) is read_georeference({"georeference": None}) is None


def test_the_way_of_a_run_has_its_landmarks_and_its_name(run: Path) -> None:
    way = directions(run)
    assert way.name == "hand (smoothed)"
    assert [leg.length_m for leg in way.legs] == pytest.approx([20.0, 10.0])
    ((mark,), ()) = (leg.landmarks for leg in way.legs)
    assert mark.label == "door"
    assert mark.after_m == pytest.approx(10.0)
    assert way.compass
    assert way.legs[0].sigma_along_m is not None
    assert way.pace_m == pytest.approx(0.5)
    assert way.sigma_m == pytest.approx(1.0)
    assert len(directions(run, "pdr", 0.7).legs) == 1
    assert directions(run, "pdr", 0.7).pace_m == 0.7
    assert directions(run, "pdr").legs[0].sigma_along_m is None


def test_the_weights_are_those_of_the_runs_own_configuration(run: Path) -> None:
    edit(run)
    config = (run / "config.toml").read_text()
    steps_m = 0.08 * 0.5 * math.sqrt(40)
    for scale, free_m in ((0.01, math.hypot(steps_m, 0.2)), (0.02, math.hypot(steps_m, 0.4)), (0.06, 0.6)):
        # with the usual weights it is more than the 0.3 m of both ends together
        (run / "config.toml").write_text(config.replace("sigma_length_scale = 0.06", f"sigma_length_scale = {scale}"))
        along = directions(run).legs[0].sigma_along_m
        assert along == pytest.approx(math.hypot(free_m, 0.5 / math.sqrt(6.0)), abs=1e-4)


def test_without_a_compass_only_anchors_know_north(run: Path) -> None:
    summary = json.loads((run / "summary.json").read_text())
    log = {**summary["log"], "samples": {"mag": 0}}
    for anchors, compass in ((0, False), (1, False), (2, True)):
        edit(run, log=log, anchors=anchors)
        assert directions(run).compass == compass
        assert not directions(run, "pdr").compass
    edit(run, log={**log, "samples": {"mag": 1}}, anchors=0)
    assert directions(run, "pdr").compass


def test_breadcrumbs_of_another_walk_are_refused(run: Path) -> None:
    edit(run, steps=59)
    with pytest.raises(
        DataError, match=r"pdr\.tum: 61 breadcrumbs, but by summary\.json 59 steps; smooth the log again"
    ):
        read_run(run)


def test_a_run_is_as_it_was_written_or_its_digests_tell(run: Path) -> None:
    text = (run / "config.toml").read_text()
    (run / "config.toml").write_text(text.replace("sigma_mag_rad", "# \nsigma_mag_rad"))
    with pytest.raises(DataError, match=r"config\.toml: not as it was written: .*; smooth the log again"):
        directions(run)
    (run / "config.toml").write_text(text)
    assert directions(run).legs
    summary = json.loads((run / "summary.json").read_text())
    (run / "summary.json").write_text(json.dumps(summary | {"turns": 77}))
    with pytest.raises(DataError, match=r"summary\.json: not as it was written: .*; smooth the log again"):
        read_run(run)
    edit(run, turns=77)
    assert read_run(run).digests == {}
    assert "sha256" not in read_summary(run)


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="not a run folder"):
        read_summary(tmp_path)
    for text, why in (
        ("[]", "not a summary, but a JSON list"),
        ("{", "not readable as JSON"),
        ('{"log": {}}', r"log\.name: Field required"),
    ):
        (tmp_path / "summary.json").write_text(text)
        with pytest.raises(DataError, match=rf"summary\.json: {why}.*; smooth the log again"):
            read_summary(tmp_path)
    (tmp_path / "summary.json").unlink()
    (tmp_path / "raw.csv").write_text("")
    with pytest.raises(DataError, match="a live walk that has not ended"):
        read_summary(tmp_path)


def test_every_trajectory_of_a_run_is_scored(run: Path) -> None:
    places = checkpoints(T0_S + np.array([1.0, 31.0]), np.array([5.0, 25.0]), np.array([0.0, 13.0]))
    scores = score_run(read_run(run), places)
    assert list(scores) == ["pdr", "ekf", "smoothed"]
    assert scores["smoothed"]["rmse_m"] == pytest.approx(3.0)
    assert scores["pdr"]["rmse_m"] == pytest.approx(math.hypot(10.0, 13.0))
    assert scores["smoothed"]["label"] == "unaided"
    edit(run, closed_walk=True)
    assert score_run(read_run(run), places)["smoothed"]["label"] == "closed"
    edit(run, anchors=3)
    anchored = score_run(read_run(run), places)["smoothed"]
    assert (anchored["label"], anchored["final_m"]) == ("anchored", pytest.approx(math.hypot(5.0, 3.0)))


def test_inputs_are_noted_and_read_back(tmp_path: Path) -> None:
    inputs = RunInputs.of(
        tmp_path / "a" / ".." / "log.csv",
        "m5stickc",
        tmp_path / "t.csv",
        tmp_path / "a.csv",
        True,
        Georeference(49.0, 11.0),
    )
    root = tmp_path.resolve()
    noted = inputs.as_dict()
    assert noted == {
        "log": str(root / "log.csv"),
        "format": "m5stickc",
        "truth": str(root / "t.csv"),
        "anchors": str(root / "a.csv"),
        "closed_walk": True,
        "origin": [49.0, 11.0],
    }
    assert RunInputs.from_summary({"inputs": json.loads(json.dumps(noted))}, tmp_path) == inputs
    assert RunInputs.of(None).as_dict() == dict.fromkeys(("log", "format", "truth", "anchors", "origin")) | {
        "closed_walk": False
    }


def test_a_replay_notes_its_pieces_too() -> None:
    replayed = RunInputs(log="x", online_chunk_s=0.1, until_s=12.5)
    assert (replayed.as_dict()["online_chunk_s"], replayed.as_dict()["until_s"]) == (0.1, 12.5)
    assert "until_s" not in RunInputs(log="x", until_s=12.5).as_dict()
    assert RunInputs.from_summary({"inputs": replayed.as_dict()}, Path("run")) == replayed


def test_inputs_that_say_too_little_are_refused_and_what_is_newer_is_left_out() -> None:
    for summary in ({}, {"inputs": None}, {"inputs": {"log": ""}}, {"inputs": {"log": None}}):
        with pytest.raises(
            DataError, match=r"run: by its summary\.json its log was no file, or .*; smooth the log again"
        ):
            RunInputs.from_summary(summary, Path("run"))
    newer = {"inputs": {"log": "x", "origin": [1, 2], "speed": 2}}
    assert RunInputs.from_summary(newer, Path("run")) == RunInputs(log="x", origin=(1.0, 2.0))


@pytest.mark.parametrize("wrong", [{"origin": [1.0]}, {"origin": "x"}, {"log": 3}, {"log": "a\x00b"}, {"max_size": 0}])
def test_inputs_that_cannot_be_are_refused_with_their_summary(run: Path, wrong: dict[str, Any]) -> None:
    edit(run, inputs={"log": "x"} | wrong)
    with pytest.raises(DataError, match=rf"summary\.json: inputs\.{next(iter(wrong))}: .*; smooth the log again"):
        read_summary(run)


def test_what_was_named_is_told(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("t_s,x_m,y_m\n1,2,3\n")
    (tmp_path / "a.csv").write_text("t_s,x_m,y_m\n4,5,6\n7,8,9\n")
    named = RunInputs.of(None, None, tmp_path / "t.csv", tmp_path / "a.csv", True, Georeference(49.0, 11.0))
    told = read_told(named)
    assert told.truth is not None
    assert told.anchors is not None
    assert (len(told.truth), len(told.anchors)) == (1, 2)
    assert (told.truth.t_s[0], told.truth.x_m[0], told.truth.y_m[0]) == (1.0, 2.0, 3.0)
    assert (told.closed_walk, told.origin) == (True, Georeference(49.0, 11.0))
    assert read_told(RunInputs()) == Told()
