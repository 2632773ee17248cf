"""Which way the legs push on real walks: RIDI's against the pose of its cameras, and no turn in the hand on any."""

from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.geometry import FloatArray, rotate, wrap_angle
from fbgraph.front_end.detect_steps import detect_steps
from fbgraph.front_end.step_track import StepTrack
from fbgraph.readers import read_log


def true_mount_rad(path: Path, track: StepTrack) -> FloatArray:
    """(K+1,) which way one walked, left of ``device.mount``, by the cameras; nan where one stood."""
    pose = np.genfromtxt(path, delimiter=",", names=True)
    t_s = pose["time"] - pose["time"][0]
    quat = np.column_stack([pose[f"ori_{axis}"] for axis in "wxyz"])
    forward = rotate(quat, np.array([0.0, 1.0, -1.0]))
    yaw = np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))
    ends = [
        np.interp(t, t_s, pose["pos_x"]) + 1j * np.interp(t, t_s, pose["pos_y"]) for t in (track.start_s, track.t_s)
    ]
    moved = ends[1] - ends[0]
    device = np.interp((track.start_s + track.t_s) / 2.0, t_s, yaw)
    return np.where(np.abs(moved) > 0.3, wrap_angle(np.angle(moved) - device), np.nan)


@pytest.mark.parametrize(
    ("name", "off_deg"),
    [
        ("dan_handheld1", 10),
        ("ruixuan_handheld2", 10),
        ("dan_body1", 10),
        ("hao_body2", 10),
        ("dan_leg1", 20),
        ("dan_bag2", 30),
    ],
)
def test_the_push_points_where_one_walks_whatever_way_the_device_is_worn(
    shared_data: Path, name: str, off_deg: float
) -> None:
    path = shared_data / "ridi" / f"{name}.csv.gz"
    track, _ = detect_steps(read_log(path).log, load_config("phone"))
    off = np.exp(1j * (track.gait_yaw_rad - true_mount_rad(path, track))) * track.push_m_s2
    mean = off[np.isfinite(off)].mean()
    assert abs(np.degrees(np.angle(mean))) < off_deg
    assert abs(mean) > 0.85 * np.nanmean(track.push_m_s2)  # most strides agree
    mount = np.nanmean(np.exp(1j * true_mount_rad(path, track)))
    sigma = np.hypot(track.sigma_turned_rad[0], 0.07)
    assert abs(wrap_angle(track.mount_rad[0] - np.angle(mount))) < 3.0 * sigma
    assert not track.sigma_turned_rad[1:].any()


def test_nobody_turned_the_phone_in_the_museum(shared_data: Path) -> None:
    paths = sorted((shared_data / "ipin2023").glob("*.gz"))
    for path in paths:
        if "Trial51" not in path.name:  # on stairs, which push otherwise
            track, _ = detect_steps(read_log(path).log, load_config("phone"))
            assert not track.sigma_turned_rad.any(), path.name
            assert abs(np.angle(np.nanmean(track.push_m_s2 * np.exp(1j * track.gait_yaw_rad)))) < 0.3
