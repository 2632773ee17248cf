"""Each field of summary.json, of a walk made by hand; and the same for people."""

import math
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest
from support.by_hand import way_along
from support.results_by_hand import T0_S, changed, hand_log, hand_result, with_cov

import fbgraph
from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.georeference import Georeference
from fbgraph.core.sensor_log import Event
from fbgraph.run.inputs import RunInputs
from fbgraph.run.summary import return_entry, summarize, summary_markdown, warnings
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.records import Closure, ReturnUpdate, TurnBack

EL = way_along((0.0, 0.0), (20.0, 0.0), (20.0, 10.0), t0_s=1.0)  # 60 steps, from 1 s to 31 s
WAY = with_cov(
    replace(EL, z_m=np.interp(np.arange(61.0), (0, 30, 60), (0.0, -2.0, 1.5)), gyro_bias_rad_s=np.linspace(0, 0.01, 61))
)
PDR = way_along((0.0, 0.0), (30.0, 0.0), t0_s=1.0)
TRUTH = checkpoints(
    T0_S + np.array([1.0, 11.0, 21.0, 31.0]),
    np.array([0.0, 10.0, 20.0, 20.0]),
    np.array([0.0, 0.0, 1.0, 12.0]),
    source="truth.csv",
    georeference=Georeference(49.0, 11.0),
)
TURNED = TurnBack(40, 21.0, 25.0)


def told_back(t_s: float, remaining_m: float, off_route: bool = False, arrived: bool = False) -> ReturnUpdate:
    return ReturnUpdate(t_s, 50, 30, 16.0, 15.0, remaining_m, 0.0, None, None, 0.3, off_route, arrived, "straight on")


RETURNING = (
    told_back(26.0, 9.0),
    told_back(27.0, 8.0, off_route=True),
    told_back(28.0, 7.0, off_route=True),
    told_back(29.0, 3.0, arrived=True),
    told_back(30.0, 2.5),
)


def made(**given: Any) -> WalkResult:
    rest = changed(61, [0, 31], 1.25, 0.0)
    log = hand_log(
        62.0, name="walk", counts={"acc_duplicate": 3}, events=(Event(4.5, "door"),), notices=("something assumed",)
    )
    usual: dict[str, Any] = {
        "log": log,
        "trajectories": {"pdr": PDR, "ekf": EL, "smoothed": WAY},
        "smoothed": {"closures": (Closure(3, 50, 1.0, 1.0),) * 2},
        "told": Told(truth=TRUTH),
        "seconds": {"steps": 0.12345, "smoother": 2.0},
        "inputs": RunInputs(log="/logs/walk.csv"),
        "failed": {"online": "too late"},
        "turn_back": TURNED,
        "returning": RETURNING,
    }
    return hand_result(WAY, EL, {"rest_s": rest, "chained": [k != 17 for k in range(61)]}, **(usual | given))


@pytest.fixture(scope="module")
def summary() -> dict[str, Any]:
    return summarize(made())


LENGTHS = {"fbgraph": fbgraph.__version__, "steps": 60, "walk_s": 30.0, "distance_m": pytest.approx(30.0), "turns": 1}
STATE = {
    "altitude_range_m": pytest.approx([-2.0, 1.5]),
    "end_2sigma_m": pytest.approx(0.8),
    "gyro_bias_deg_s": pytest.approx(math.degrees(0.01)),
    "rest_s": 2.5,
    "failed": {"online": "too late"},
    "closed_walk": False,
    "anchors": 0,
    "truth": "truth.csv",
    "gnss": None,
    "axis": None,
    "declination": None,
    "georeference": {"lat_deg": pytest.approx(49.0), "lon_deg": pytest.approx(11.0)},
    "inputs": {"log": "/logs/walk.csv"}
    | dict.fromkeys(("format", "truth", "anchors", "origin"))
    | {"closed_walk": False},
    "seconds": {"steps": 0.123, "smoother": 2.0},
    "versions": {name: version(name) for name in ("gtsam", "numpy", "scipy", "vqf")},
    "solver": {"iterations": 2, "error_initial": 9.0, "error_final": 2.0, "errors": [9.0, 4.0, 2.0], "factors": 99},
    "return": {
        "turn_back": {"breadcrumb": 40, "t_s": T0_S + 21.0, "known_t_s": T0_S + 25.0},
        "steps": 5,
        "off_route_steps": 2,
        "arrived_t_s": T0_S + 29.0,
        "remaining_m": 2.5,
        "closures": 2,
        "closures_doubted": 0,
    },
}
LOG = {
    "name": "walk",
    "format": "m5stickc",
    "duration_s": pytest.approx(62.0),
    "t0_s": T0_S,
    "rates_hz": {"acc": 100.0, "gyro": 100.0, "mag": 50.0, "pressure": 10.0},
    "samples": {"acc": 6201, "gyro": 6201, "mag": 3101, "pressure": 621},
    "counts": {"acc_duplicate": 3},
    "reading": {},
    "events": [{"t_s": T0_S + 4.5, "label": "door"}],
}


@pytest.mark.parametrize("name", [*LENGTHS, *STATE])
def test_a_field_says(summary: dict[str, Any], name: str) -> None:
    assert summary[name] == (LENGTHS | STATE)[name]


@pytest.mark.parametrize("name", list(LOG))
def test_a_field_of_the_log_says(summary: dict[str, Any], name: str) -> None:
    assert summary["log"][name] == LOG[name]


def test_no_field_is_without_a_test(summary: dict[str, Any]) -> None:
    elsewhere = {"log", "estimators", "findings", "warnings", "integrity"}
    assert summary.keys() == {*LENGTHS, *STATE} | elsewhere
    assert summary["log"].keys() == LOG.keys()


def test_estimators_are_described_one_by_one(summary: dict[str, Any]) -> None:
    pdr, ekf, smoothed = (summary["estimators"][name] for name in ("pdr", "ekf", "smoothed"))
    assert [entry["distance_m"] for entry in (pdr, ekf, smoothed)] == pytest.approx([30.0] * 3)
    assert pdr["end_m"] == pytest.approx([30.0, 0.0, 0.0])
    assert smoothed["end_m"] == pytest.approx([20.0, 10.0, 1.5])
    assert [entry["turns"] for entry in (pdr, ekf, smoothed)] == [0, 1, 1]


def test_each_is_scored_against_the_truth(summary: dict[str, Any]) -> None:
    """Off by 0, 1 and 2 m at the checkpoints after the first; PDR by 0, 1 and √(10² + 12²)."""
    pdr, smoothed = (summary["estimators"][name]["score"] for name in ("pdr", "smoothed"))
    assert (smoothed["label"], smoothed["checkpoints"]) == ("unaided", 3)
    assert smoothed["rmse_m"] == pytest.approx(math.sqrt(5 / 3))
    assert (smoothed["mean_m"], smoothed["max_m"], smoothed["final_m"]) == pytest.approx((1.0, 2.0, 2.0))
    assert pdr["final_m"] == pytest.approx(math.hypot(10.0, 12.0))


def test_labels_say_what_the_smoother_was_told() -> None:
    for told, label in (
        (Told(truth=TRUTH, closed_walk=True), "closed"),
        (Told(truth=TRUTH, anchors=TRUTH.select(slice(0, 2))), "anchored"),
    ):
        found = summarize(made(told=told))
        assert found["estimators"]["smoothed"]["score"]["label"] == label
        assert found["estimators"]["ekf"]["score"]["label"] == "unaided"
        assert (found["closed_walk"], found["anchors"]) == ((True, 0) if label == "closed" else (False, 2))


def test_findings_and_warnings_are_listed(summary: dict[str, Any]) -> None:
    assert [finding["kind"] for finding in summary["findings"]] == ["truth", "gap", "closure", "altitude", "gyro_bias"]
    assert summary["findings"][0].keys() == {"kind", "start_s", "end_s", "text"}
    assert summary["warnings"] == warnings(made())


def test_what_is_not_known_is_none() -> None:
    found = summarize(made(told=Told(), turn_back=None, returning=()))
    assert (found["truth"], found["return"], found["georeference"]) == (None, None, None)
    assert "score" not in found["estimators"]["smoothed"]
    bare = hand_result(EL)
    assert summarize(bare)["end_2sigma_m"] is None
    one = summarize(made(told=Told(truth=TRUTH.select(slice(0, 1)))))
    assert "score" not in one["estimators"]["smoothed"]
    assert "score" in summarize(made(told=Told(truth=TRUTH.select(slice(0, 2)))))["estimators"]["smoothed"]


def test_a_sensor_that_is_not_there_has_no_rate() -> None:
    log = hand_log()
    no_mag = replace(log, mag=log.mag.between(0.0, 0.01), pressure=log.pressure.between(0.0, 0.11))
    found = summarize(made(log=no_mag))["log"]
    assert found["rates_hz"] == {"acc": 100.0, "gyro": 100.0, "pressure": 10.0}
    assert found["samples"]["mag"] == 1


def test_rates_have_two_digits() -> None:
    log = hand_log()
    slow = replace(log.mag, t_s=log.mag.t_s * 1.2345)  # 40.502 a second
    assert summarize(made(log=replace(log, mag=slow)))["log"]["rates_hz"]["mag"] == 40.5
    faster = replace(log.mag, t_s=log.mag.t_s * 0.6)  # 83.3333
    assert summarize(made(log=replace(log, mag=faster)))["log"]["rates_hz"]["mag"] == 83.33


def test_a_return_that_did_not_arrive() -> None:
    entry = return_entry(made(returning=RETURNING[:3]))
    assert entry is not None
    assert (entry["arrived_t_s"], entry["remaining_m"], entry["steps"]) == (None, 7.0, 3)
    nothing = return_entry(made(returning=()))
    assert nothing is not None
    assert (nothing["remaining_m"], nothing["steps"], nothing["off_route_steps"]) == (None, 0, 0)


def warned(steps: int = 50, notices: tuple[str, ...] = (), truth: Any = None, **columns: Any) -> list[str]:
    """Warnings of a walk that stood still once, in an even field, with a compass."""
    count = steps + 1
    usual = {"mag_norm_ut": np.full(count, 50.0), "yaw_mag_rad": np.zeros(count), "mag_dip_rad": np.ones(count)}
    usual["rest_s"] = changed(count, [0], 1.0, 0.0)
    way = way_along((0.0, 0.0), (0.5 * steps, 0.0), t0_s=1.0)
    return warnings(hand_result(way, steps=usual | columns, log=hand_log(notices=notices), told=Told(truth=truth)))


def test_a_good_walk_has_no_warning_but_its_readers() -> None:
    assert warned() == []
    assert warned(notices=("assumed", "missing")) == ["assumed", "missing"]


def test_fewer_than_ten_steps_are_few() -> None:
    assert warned(steps=10) == []
    assert warned(steps=9) == ["only 9 steps"]


def test_one_checkpoint_is_no_truth() -> None:
    assert warned(truth=TRUTH.select(slice(0, 1))) == [
        "not scored: the truth has one checkpoint, and the walk is moved to agree with the first"
    ]
    assert warned(truth=TRUTH) == []


def test_gaps_are_counted() -> None:
    chained = [k not in (3, 9) for k in range(51)]
    assert warned(chained=chained) == [
        "2 gap(s) in the log during the walk: direction across them rests on the compass alone"
    ]
    assert warned(chained=chained, yaw_mag_rad=np.full(51, math.nan)) == [
        "2 gap(s) in the log during the walk: direction across them is not known: there is no compass"
    ]


def test_who_never_stood_still_has_an_unknown_bias() -> None:
    text = "the wearer never stood still: the gyroscope's bias "
    assert warned(rest_s=np.zeros(51)) == [text + "was found from the compass alone"]
    assert warned(rest_s=np.zeros(51), yaw_mag_rad=np.full(51, math.nan)) == [
        text + "is not known: there is no compass either"
    ]


def test_the_summary_for_people(summary: dict[str, Any]) -> None:
    lines = summary_markdown(summary).splitlines()
    assert lines[:6] == [
        "# walk",
        "**Sound: nothing in the log contradicts this walk.**",
        "",
        "62 s of log, 60 steps, 30 m as smoothed, 1 turn, altitude -2.0 to +1.5 m.",
        "",
        "The smoothed walk ends 20.0 m East and 10.0 m North of its start, ± 0.8 m (2σ).",
    ]
    assert lines[7].startswith("The gyroscope's bias by the smoother +0.57 °/s")
    rows = [line for line in lines if line.startswith("| ")]
    assert rows == [
        "| estimator | ends East, North (m) | RMSE (m) | max (m) | last (m) | told of |",
        "| PDR | 30.0, 0.0 | 9.04 | 15.62 | 15.62 | nothing |",
        "| EKF | 20.0, 10.0 | 1.29 | 2.00 | 2.00 | nothing |",
        "| smoothed | 20.0, 10.0 | 1.29 | 2.00 | 2.00 | nothing; found 2 closures |",
    ]
    assert "Errors are horizontal, at the truth's checkpoints after the first; “last” is at the last of them." in lines
    at = lines.index("## Warnings")
    assert lines[at + 1 : at + 3] == [
        "- the online trajectory is missing, its estimator failed: too late",
        "- something assumed",
    ]
    worth = lines[lines.index("## Worth a look") + 1 :]
    assert worth[0] == "- 1 to 31 s: the smoothed walk is further from the truth than its 2σ at 2 of 3 checkpoints"
    assert worth[1] == "- 9 s: gap in the log: direction across it is the compass's"


def test_where_a_walk_ends_in_words() -> None:
    south_west = summarize(made(told=Told(), smoothed={"trajectory": EL}))
    south_west["estimators"]["smoothed"]["end_m"] = [-3.04, -0.04, 0.0]
    assert "ends 3.0 m West and 0.0 m North of its start.\n" in summary_markdown(south_west)
    south_west["estimators"]["smoothed"]["end_m"] = [0.0, -0.06, 0.0]
    assert "ends 0.0 m East and 0.1 m South of its start.\n" in summary_markdown(south_west)
    assert "| smoothed | 0.0, -0.1 | – | – | – | no truth |" in summary_markdown(south_west)
    anchored = summarize(made(told=Told(anchors=TRUTH)))
    assert "ends at 20.0 East, 10.0 North in the anchors' frame, ± 0.8 m (2σ)." in summary_markdown(anchored)


def test_a_finding_of_a_second_is_a_moment(summary: dict[str, Any]) -> None:
    two = [
        {"kind": "gap", "start_s": 5.0, "end_s": 5.99, "text": "short"},
        {"kind": "gap", "start_s": 5.0, "end_s": 6.01, "text": "long"},
    ]
    page = summary_markdown({**summary, "findings": two, "warnings": [], "turns": 2})
    assert "- 5 s: short\n- 5 to 6 s: long\n" in page
    assert "## Warnings" not in page
    assert "2 turns" in page
    assert "## Worth a look" not in summary_markdown({**summary, "findings": []})


def test_a_world_frame_lies_on_earth_by_user_anchors_or_truth() -> None:
    """Truth a kilometre North-East of the walk: its frame begins South-West of the walk (to 20 cm: North turns)."""
    origin = Georeference(49.5, 11.5)
    moved = replace(WAY, x_m=WAY.x_m + 100.0, y_m=WAY.y_m - 50.0)
    by_user = summarize(made(told=Told(origin=origin, truth=TRUTH), smoothed={"trajectory": moved}))["georeference"]
    start = Georeference(**by_user).geodetic_deg(np.array([[100.0, -50.0]]))[0]
    assert start == pytest.approx([49.5, 11.5], abs=1e-7)
    far = replace(TRUTH, x_m=TRUTH.x_m + 700.0, y_m=TRUTH.y_m + 800.0)
    by_truth = made(told=Told(truth=far)).georeference
    assert by_truth is not None
    assert by_truth.geodetic_deg(np.array([[-700.0, -800.0]]))[0] == pytest.approx([49.0, 11.0], abs=3e-6)
    by_anchors = made(told=Told(truth=far, anchors=far)).georeference
    assert by_anchors is not None
    assert (by_anchors.lat_deg, by_anchors.lon_deg) == pytest.approx((49.0, 11.0))


def test_the_truth_is_moved_to_agree_at_its_first_checkpoint() -> None:
    far = replace(TRUTH, x_m=TRUTH.x_m + 700.0, y_m=TRUTH.y_m + 800.0, t_s=TRUTH.t_s + 2.0)
    assert made(told=Told(truth=far)).truth_shift_m == pytest.approx([2.0 - 700.0, -800.0])
    assert made(told=Told(truth=far, anchors=far)).truth_shift_m == pytest.approx([0.0, 0.0])
    assert made(told=Told()).truth_shift_m == pytest.approx([0.0, 0.0])
