"""Trajectories: distances, places at times, ellipses, and TUM files there and back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.tum_files import read_tum, write_tum


def corner(**given: FloatArray) -> Trajectory:
    """Three to the East, four to the North, one up."""
    t_s, x_m, y_m = np.array([1.0, 2.0, 4.0]), np.array([0.0, 3.0, 3.0]), np.array([0.0, 0.0, 4.0])
    return Trajectory(t_s, x_m, y_m, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.5, 7.0]), np.full(3, 0.01), **given)


def test_distance_is_walked_on_the_map() -> None:
    assert corner().distance_m.tolist() == [0.0, 3.0, 7.0]
    assert corner().xy_m.tolist() == [[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]]
    assert len(corner()) == 3


def test_places_between_breadcrumbs_are_linear_in_time_and_beyond_them_stand() -> None:
    at = corner().at(np.array([0.0, 1.5, 3.0, 9.0]))
    assert np.allclose(at, [(0, 0, 0), (1.5, 0, 0), (3, 2, 0.5), (3, 4, 1)])


def test_until_keeps_the_breadcrumb_it_names_and_what_is_known_of_it() -> None:
    covariance = np.array([np.eye(3) * k for k in range(3)])
    part = corner(cov_xy_yaw=covariance, sigma_z_m=np.arange(3.0)).until(1)
    assert part.t_s.tolist() == [1.0, 2.0]
    assert part.yaw_rad.tolist() == [0.0, 0.5]
    assert part.cov_xy_yaw is not None
    assert part.cov_xy_yaw.shape == (2, 3, 3)
    assert part.sigma_z_m is not None
    assert part.sigma_z_m.tolist() == [0.0, 1.0]
    assert part.sigma_bias_rad_s is None


def test_a_walk_is_turned_about_its_start_with_its_covariance() -> None:
    covariance = np.tile(np.array([[9.0, 1.0, 0.5], [1.0, 4.0, -0.25], [0.5, -0.25, 0.01]]), (3, 1, 1))
    moved = replace(corner(cov_xy_yaw=covariance), x_m=corner().x_m + 7.0, y_m=corner().y_m - 2.0)
    left = moved.turned(np.pi / 2)
    assert left.x_m == pytest.approx([7.0, 7.0, 3.0])
    assert left.y_m == pytest.approx([-2.0, 1.0, 1.0])
    assert left.yaw_rad == pytest.approx(corner().yaw_rad + np.pi / 2)
    assert left.cov_xy_yaw is not None
    expected = [[4.0, -1.0, 0.25], [-1.0, 9.0, 0.5], [0.25, 0.5, 0.01]]
    assert left.cov_xy_yaw[2].tolist() == [pytest.approx(row) for row in expected]
    covariance[:, :2, 2] = covariance[:, 2, :2] = np.nan
    unknown = moved.turned(np.pi / 2).cov_xy_yaw
    assert unknown is not None
    assert unknown[1, :2, :2].tolist() == [pytest.approx(row[:2]) for row in expected[:2]]
    assert corner().turned(1.0).cov_xy_yaw is None


def test_the_longest_axis_of_an_ellipse_wherever_it_points() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    tilted = turn @ np.diag([9.0, 4.0, 100.0]) @ turn.T
    covariance = np.array([np.diag([1.0, 16.0, 0.0]), tilted, np.diag([25.0, 1.0, 0.0])])
    longest = corner(cov_xy_yaw=covariance).longest_sigma_m
    assert longest is not None
    assert longest.tolist() == pytest.approx([4.0, 3.0, 5.0])
    assert corner().longest_sigma_m is None


def test_a_tum_file_has_the_event_clock_places_and_a_quaternion_about_the_vertical(tmp_path: Path) -> None:
    write_tum(tmp_path / "walk.tum", corner(), t0_s=100.0)
    rows = [line.split() for line in (tmp_path / "walk.tum").read_text().splitlines()]
    assert rows[1][:4] == ["102.000000", "3.000000", "0.000000", "0.000000"]
    # half of 0.5 rad: sin 0.25, cos 0.25
    assert rows[1][4:] == ["0.000000000", "0.000000000", "0.247403959", "0.968912422"]
    assert rows[2][3] == "1.000000"


def test_a_tum_file_reads_back_as_it_was(tmp_path: Path) -> None:
    yaw = np.linspace(0.3, 20.0, 40)
    zeros = np.zeros(40)
    walk = Trajectory(np.arange(40.0), np.cos(yaw), np.sin(yaw), 0.1 * yaw, yaw, zeros)
    write_tum(tmp_path / "walk.tum", walk, t0_s=1000.5)
    back = read_tum(tmp_path / "walk.tum", t0_s=1000.5)
    for name in ("t_s", "x_m", "y_m", "z_m", "yaw_rad"):
        assert np.allclose(getattr(back, name), getattr(walk, name), atol=1e-6), name
    assert np.allclose(read_tum(tmp_path / "walk.tum").t_s, walk.t_s + 1000.5)
    assert not back.gyro_bias_rad_s.any()


@pytest.mark.parametrize("text", ["1 2 3\n", "one two three four five six seven eight\n"])
def test_a_file_that_is_no_tum_file_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "walk.tum").write_text(text)
    with pytest.raises(
        DataError, match=r"walk\.tum: line 1: expected 8 numbers \(t x y z qx qy qz qw\), found '(1|one)"
    ):
        read_tum(tmp_path / "walk.tum")
    with pytest.raises(DataError, match=r"nowhere\.tum: No such file or directory; check the path"):
        read_tum(tmp_path / "nowhere.tum")
