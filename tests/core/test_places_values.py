"""Checkpoints: their order, clock, frame, the breadcrumbs nearest to them, and what a file may say."""

from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.aids import Aids, Told
from fbgraph.core.checkpoints import Checkpoints, anchor_breadcrumbs, checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.georeference import Georeference
from fbgraph.readers.places import read_checkpoints

NUREMBERG = Georeference(49.4613, 11.1110)


def three(georeference: Georeference | None = None) -> Checkpoints:
    t_s, x_m, y_m = np.array([30.0, 10.0, 20.0]), np.array([3.0, 1.0, 2.0]), np.array([-3.0, -1.0, -2.0])
    return checkpoints(t_s, x_m, y_m, floor=np.array([3.0, 1.0, 2.0]), source="places.csv", georeference=georeference)


def test_checkpoints_are_in_order_of_time_and_say_nan_where_nothing_is_known() -> None:
    places = three()
    assert len(places) == 3
    assert places.t_s.tolist() == [10.0, 20.0, 30.0]
    assert places.xy_m.tolist() == [[1.0, -1.0], [2.0, -2.0], [3.0, -3.0]]
    assert places.floor.tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(places.z_m).all()
    assert np.isnan(places.sigma_m).all()
    assert checkpoints(np.zeros(2), np.array([1.0, 2.0]), np.zeros(2)).x_m.tolist() == [1.0, 2.0]  # in order as given


def test_since_moves_times_back_and_nothing_else() -> None:
    places = three().since(8.0)
    assert places.t_s.tolist() == [2.0, 12.0, 22.0]
    assert places.x_m.tolist() == [1.0, 2.0, 3.0]
    assert places.source == "places.csv"


def test_a_choice_keeps_all_columns() -> None:
    places = three().select(slice(1, 3))
    assert (places.t_s.tolist(), places.x_m.tolist(), places.y_m.tolist()) == ([20.0, 30.0], [2.0, 3.0], [-2.0, -3.0])
    assert places.floor.tolist() == [2.0, 3.0]
    assert len(places.sigma_m) == len(places.z_m) == 2


def test_a_frame_is_another_where_both_are_known_on_earth() -> None:
    here = three(georeference=NUREMBERG)
    there = three(georeference=NUREMBERG.moved(100.0, -40.0))
    moved = here.in_frame_of(there)
    # 100 m further East and 40 m further South than the other's origin
    assert np.allclose(moved.x_m, np.array([1.0, 2.0, 3.0]) - 100.0, atol=0.01)
    assert np.allclose(moved.y_m, np.array([-1.0, -2.0, -3.0]) + 40.0, atol=0.01)
    assert moved.georeference == there.georeference
    assert here.in_frame_of(None) is here
    assert here.in_frame_of(three()) is here
    assert three().in_frame_of(here).georeference is None


def test_each_anchor_goes_to_the_breadcrumb_nearest_in_time() -> None:
    at = checkpoints(np.array([-5.0, 1.4, 1.6, 2.0, 9.0]), np.zeros(5), np.zeros(5))
    assert anchor_breadcrumbs(at, np.array([0.0, 1.0, 2.0, 3.0])).tolist() == [0, 1, 2, 2, 3]


def test_places_of_another_log_are_refused_with_five_seconds_of_grace() -> None:
    places = three()
    places.require_within(15.0, 25.0)
    places.require_within(-100.0, 100.0)
    with pytest.raises(
        DataError, match=r"places\.csv: the anchor at 10\.0 s lies outside the log \(15\.1 to 30\.0 s\)"
    ):
        places.require_within(15.1, 30.0)
    with pytest.raises(DataError, match=r"the anchor at 30\.0 s"):
        places.require_within(10.0, 24.9)


def test_anchors_tell_the_place_and_two_of_them_the_direction() -> None:
    places = three()
    known = {n: Aids(places.select(slice(0, n))) for n in (1, 2)}
    assert [(a.places_known, a.direction_known) for a in (Aids(), known[1], known[2])] == [
        (False, False),
        (True, False),
        (True, True),
    ]


def test_what_a_user_tells_becomes_what_an_estimator_may_know() -> None:
    told = Told(truth=three(), anchors=three(), closed_walk=True)
    aids = told.aids(8.0)
    assert aids.anchors is not None
    assert aids.anchors.t_s.tolist() == [2.0, 12.0, 22.0]
    assert aids.closed_walk
    assert Told(truth=three()).aids(8.0) == Aids(None, False)


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "places.csv"
    path.write_text(text)
    return path


def test_a_file_may_have_every_column_in_any_order_and_comments(tmp_path: Path) -> None:
    text = "# surveyed\ny_m, t_s, x_m, sigma_m, floor, z_m\n2, 20, 1, 0.3, -1, 4.5\n5, 10, 4, , 2, \n"
    places = read_checkpoints(written(tmp_path, text))
    assert places.t_s.tolist() == [10.0, 20.0]
    assert places.xy_m.tolist() == [[4.0, 5.0], [1.0, 2.0]]
    assert places.floor.tolist() == [2.0, -1.0]
    assert np.array_equal(places.z_m, [np.nan, 4.5], equal_nan=True)
    assert np.array_equal(places.sigma_m, [np.nan, 0.3], equal_nan=True)
    assert places.source == str(tmp_path / "places.csv")


def test_the_columns_of_ipin_are_understood(tmp_path: Path) -> None:
    text = "t_app_s,checkpoint,lat_deg,lon_deg,floor,east_m,north_m\n5.5,1,49.4613,11.1110,0,10,20\n"
    places = read_checkpoints(written(tmp_path, text))
    assert (places.t_s.tolist(), places.xy_m.tolist()) == ([5.5], [[10.0, 20.0]])
    assert places.georeference is not None
    there = places.georeference.geodetic_deg(np.array([[10.0, 20.0]]))
    assert np.allclose(there, [[49.4613, 11.1110]], atol=1e-7)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("t_s,x_m\n1,2\n", r"no column y_m \(found t_s, x_m\)"),
        ("t_s,lat_deg\n1,2\n", "no column x_m, y_m"),
        ("t_s,x_m,y_m\n", "a header and no checkpoint"),
        ("t_s,x_m,y_m\n1,2,3\n4,north,6\n", "row 2 after the header: x_m is not a number"),
        ("t_s,x_m,y_m\n,2,3\n", "row 1 after the header: t_s is not a number"),
        ("t_s,lat_deg,lon_deg\n1,49,11\n2,,11\n", "row 2 after the header: lat_deg is not a number"),
        ("", "not a readable checkpoint CSV"),
    ],
)
def test_a_file_that_says_less_is_refused_with_the_cause(tmp_path: Path, text: str, cause: str) -> None:
    with pytest.raises(DataError, match=cause):
        read_checkpoints(written(tmp_path, text))


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"nowhere\.csv: No such file or directory; check the path"):
        read_checkpoints(tmp_path / "nowhere.csv")
