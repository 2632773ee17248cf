"""Places that nobody can have been at: told with rows, places and speed; anchors are refused, truth scores nobody."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fbgraph
from fbgraph.core import bounded
from fbgraph.core import checkpoints as module
from fbgraph.core.aids import Told
from fbgraph.core.bounded import CONFIG_BYTES, LONGEST_LINE, PLACES_BYTES
from fbgraph.core.checkpoints import anchor_breadcrumbs, checkpoints
from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.georeference import Georeference, along_ground_m
from fbgraph.pipeline import reconstruct
from fbgraph.readers.places import read_checkpoints
from fbgraph.run.metrics import checkpoint_errors
from fbgraph.run.summary import summarize
from fbgraph.session import replay_log

WALK = fbgraph.simulate("square", seed=7).log


def doubt_of(t_s: list[float], x_m: list[float], sigma_m: list[float] | None = None) -> str:
    """What is said of places on a line."""
    sigma = None if sigma_m is None else np.array(sigma_m)
    return checkpoints(np.array(t_s), np.array(x_m), np.zeros(len(t_s)), sigma_m=sigma).doubt


def table(folder: Path, text: str) -> Path:
    path = folder / "places.csv"
    path.write_text(text)
    return path


def test_12_5_m_s_and_a_kilometre_are_possible_and_a_metre_more_is_not() -> None:
    assert doubt_of([0, 10], [0, 1125]) == ""
    assert "1.126 km in 10 s" in doubt_of([0, 10], [0, 1126])
    assert doubt_of([0, 0], [0, 1000]) == ""
    assert "1.001 km in 0 s: nobody" in doubt_of([0, 0], [0, 1001])
    assert doubt_of([0], [1e9]) == doubt_of([], []) == ""


def test_a_sigma_makes_room_and_one_that_is_not_given_makes_none() -> None:
    assert doubt_of([0, 10], [0, 1125 + 300], [100, np.nan]) == ""
    assert doubt_of([0, 10], [0, 1125 + 301], [100, np.nan]) != ""
    assert doubt_of([0, 10], [0, 1125], [np.nan, np.nan]) == ""


def test_rows_are_those_of_the_file_whatever_its_order() -> None:
    said = doubt_of([20, 10, 0], [5000, 2, 0])
    assert said.startswith("from row 2 (2.00, 0.00 m) to row 1 (5000.00, 0.00 m) it is 4.998 km in 10 s")
    assert "which is 500 m/s: nobody can; check both rows' places and times" in said


@pytest.mark.parametrize("x_m", [np.inf, 1e300, -1e308])
def test_places_beyond_any_number_are_doubted_too(x_m: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        said = doubt_of([0, 1e-9, 20], [0, x_m, -x_m])
    assert "nobody can; check both rows' places and times" in said
    assert len(said) < 200


def test_a_distance_beyond_any_number_is_told_in_short() -> None:
    assert doubt_of([0, 1e-5], [0, 1e308]) == (
        "from row 1 (0.00, 0.00 m) to row 2 (1e+308, 0.00 m) it is 1e+305 km in 1e-05 s, which is inf m/s: "
        "nobody can; check both rows' places and times"
    )


def test_a_wrong_digit_in_a_latitude_names_row_place_and_speed(tmp_path: Path) -> None:
    path = table(tmp_path, "t_s,lat_deg,lon_deg\n0,49.461,11.111\n20,49.4611,11.1112\n40,6.4612,11.1112\n")
    places = read_checkpoints(path)
    assert "from row 2 (49.461100, 11.111200°) to row 3 (6.461200, 11.111200°)" in places.doubt
    assert "it is 4781 km in 20 s, which is 2.39e+05 m/s" in places.doubt
    with pytest.raises(DataError, match=r"places\.csv: from row 2"):
        places.require_possible()


def test_the_other_side_of_the_earth_is_far_away(tmp_path: Path) -> None:
    antipode = read_checkpoints(table(tmp_path, "t_s,lat_deg,lon_deg\n0,49,11\n20,-49,-169\n"))
    assert "it is 2.002e+04 km" in antipode.doubt
    assert along_ground_m(np.array([0.0, 0.0, 90.0]), np.array([0.0, 90.0, 17.0])) == pytest.approx(
        10_007_543, rel=1e-6
    )


@pytest.mark.parametrize(
    ("lat", "lon", "said"),
    [("90", "180", ""), ("-90", "-180", ""), ("90.1", "11", "lat_deg 90.1 is not within ±90"), ("49", "-180.5", "lon")],
)
def test_latitudes_and_longitudes_are_on_earth(lat: str, lon: str, said: str, tmp_path: Path) -> None:
    path = table(tmp_path, f"t_s,lat_deg,lon_deg\n0,{lat},{lon}\n")
    if said:
        with pytest.raises(DataError, match=rf"row 1 after the header: {said}"):
            read_checkpoints(path)
    else:
        assert len(read_checkpoints(path)) == 1


def end_s() -> float:
    return WALK.t0_s + float(WALK.acc.t_s[-1])


def test_impossible_anchors_are_refused_and_impossible_truth_scores_nobody() -> None:
    t_s = np.array([WALK.t0_s + 1.0, end_s() - 1.0])
    far = checkpoints(t_s, np.array([0.0, 50_000.0]), np.zeros(2), source="far.csv")
    config = load_config("m5stickc")
    with pytest.raises(DataError, match=r"far\.csv: from row 1"):
        reconstruct(WALK, config, Told(anchors=far))
    with pytest.raises(DataError, match=r"far\.csv: from row 1"):
        replay_log(WALK, config, Told(anchors=far))
    with pytest.raises(DataError, match=r"far\.csv: from row 1"):
        fbgraph.OnlineSmoother(anchors=far)
    for result in (reconstruct(WALK, config, Told(truth=far)), replay_log(WALK, config, Told(truth=far), chunk_s=1.0)):
        summary = summarize(result)
        assert any(text.startswith("not scored: far.csv: from row 1") for text in summary["warnings"])
        assert not any("score" in entry for entry in summary["estimators"].values())
        with pytest.raises(DataError, match=r"from row 1"):
            checkpoint_errors(result.trajectories["ekf"], far, WALK.t0_s)


def test_times_of_another_millennium_are_another_clock() -> None:
    late = checkpoints(np.array([1.0, 1e9]), np.zeros(2), np.zeros(2), source="late.csv")
    with pytest.raises(DataError, match=r"late\.csv: the anchor at .* lies outside the log"):
        reconstruct(WALK, load_config("m5stickc"), Told(anchors=late))


def test_an_origin_far_from_the_anchors_is_told_and_a_near_one_is_not() -> None:
    t_s = np.array([WALK.t0_s + 1.0, end_s() - 1.0])
    here = checkpoints(t_s, np.zeros(2), np.zeros(2), georeference=Georeference(49.0, 11.0))
    far_m = 1000.0 + 12.5 * 60.0
    for metres, told in ((far_m - 10.0, 0), (far_m + 10.0, 1)):
        origin = Georeference(49.0 + np.degrees(metres / 6_371_000.0), 11.0)
        assert len(Told(anchors=here, origin=origin).disagreements(60.0)) == told
    said = Told(truth=here, anchors=here, origin=Georeference(6.0, 11.0)).disagreements(60.0)
    assert said[0].startswith(
        "the origin (6.000000, 11.000000) and the first anchor (49.000000, 11.000000) are 4781 km"
    )
    assert len(said) == 2
    result = reconstruct(WALK, load_config("m5stickc"), Told(anchors=here, origin=Georeference(6.0, 11.0)))
    assert said[0] in summarize(result)["warnings"]
    assert here.georeference is not None
    moved = replace(here, georeference=here.georeference.moved(-30_000.0, 0.0), x_m=here.x_m + 30_000.0)
    assert Told(anchors=moved, origin=Georeference(49.0, 11.0)).disagreements(60.0) == []  # a frame begins anywhere


def test_more_anchors_than_a_walk_has_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    many = checkpoints(np.arange(4.0), np.zeros(4), np.zeros(4), source="many.csv")
    monkeypatch.setattr(module, "_MOST_ANCHORS", 4)
    many.require_possible()
    monkeypatch.setattr(module, "_MOST_ANCHORS", 3)
    with pytest.raises(DataError, match=r"many\.csv: 4 anchors, the limit is 3"):
        many.require_possible()


def test_anchors_go_to_the_breadcrumb_nearest_in_time_without_a_table_of_all_by_all() -> None:
    rng = np.random.default_rng(2)
    for t_s in (np.array([5.0]), np.array([0.0, 1.0, 1.0, 2.0, 4.0]), np.sort(rng.integers(0, 300, 80) / 2.0)):
        at_s = np.concatenate(([-9.0, 999.0], t_s, np.arange(0.0, 150.0, 0.25)))
        there = checkpoints(at_s, np.zeros(len(at_s)), np.zeros(len(at_s)))
        nearest = np.abs(t_s[None, :] - there.t_s[:, None]).argmin(axis=1)
        assert anchor_breadcrumbs(there, t_s).tolist() == nearest.tolist()


def test_tables_of_places_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    head = "t_s,x_m,y_m\n"
    wide = "0,0,0" + "," * (LONGEST_LINE - 5)
    with pytest.raises(DataError, match=r"a line of 65536 bytes and 65534 columns; the limits .* are 65536 and 4096"):
        read_checkpoints(table(tmp_path, head + wide + "\n"))
    assert len(read_checkpoints(table(tmp_path, f"#{'x' * (LONGEST_LINE - 1)}\n{head}0,0,0\n"))) == 1
    with pytest.raises(DataError, match="a line of 65537 bytes"):
        read_checkpoints(table(tmp_path, f"#{'x' * LONGEST_LINE}\n{head}0,0,0\n"))
    monkeypatch.setattr(bounded, "MOST_PLACES", 3)
    assert len(read_checkpoints(table(tmp_path, head + "0,0,0\n" * 2))) == 2
    with pytest.raises(DataError, match="4 lines, the limit of a checkpoint CSV is 3"):
        read_checkpoints(table(tmp_path, head + "0,0,0\n" * 3))
    huge = tmp_path / "huge.csv"
    with open(huge, "wb") as out:
        out.truncate(PLACES_BYTES + 1)
    with pytest.raises(DataError, match=r"huge\.csv: 64 MiB or more, the limit is 64 MiB"):
        read_checkpoints(huge)
    with pytest.raises(DataError, match="is a device"):
        read_checkpoints("/dev/zero")


@pytest.mark.parametrize("size", [CONFIG_BYTES, CONFIG_BYTES + 1])
def test_a_configuration_of_64_kib_is_read_and_a_larger_one_is_not(size: int, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    text = "[steps]\nlambda_sigma = 0.5\n#"
    path.write_text(text + "x" * (size - len(text)))
    if size <= CONFIG_BYTES:
        assert load_config(path).steps.lambda_sigma == 0.5
    else:
        with pytest.raises(ConfigError, match=r"neither a preset .* nor a readable file .*64 KiB or more"):
            load_config(path)
