"""A device turned in the hand, or worn the wrong way round: the walk goes on as it went, offline and online."""

import math
from functools import cache

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.pipeline import reconstruct
from fbgraph.simulator.disturbances import turned_in_hand
from fbgraph.simulator.routes import Route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import Device, SimulateOptions

CONFIG = load_config("m5stickc", ["returning.out_and_back=false"])
CORNER = Route("corner", np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [30.0, 20.0, 0.0]]), np.zeros(3), ("1", "2", "3"))


@cache
def walk(turned_deg: float = 0.0, mount_yaw_deg: float = 0.0, tilt_deg: float = 20.0) -> SimulatedWalk:
    options = SimulateOptions(device=Device(rate_hz=50.0, mount_yaw_deg=mount_yaw_deg, tilt_deg=tilt_deg))
    made = simulate(CORNER, options, seed=4)
    return turned_in_hand(made, math.radians(turned_deg), 15.0) if turned_deg else made


def off_m(way: Trajectory, made: SimulatedWalk) -> float:
    """How far the breadcrumbs are off at most, from the first on."""
    x, y = (np.interp(way.t_s, made.t_s, axis) for axis in (made.x_m, made.y_m))
    return float(np.hypot(way.x_m - way.x_m[0] - (x - x[0]), way.y_m - way.y_m[0] - (y - y[0])).max())


@pytest.mark.parametrize("turned_deg", [90.0, -120.0])
def test_all_estimators_walk_on_where_the_device_is_turned(turned_deg: float) -> None:
    made = walk(turned_deg)
    result = reconstruct(made.log, CONFIG)
    for name, limit_m in (("pdr", 8.0), ("ekf", 8.0), ("smoothed", 5.0)):
        assert off_m(result.trajectories[name], made) < limit_m
    (reason,) = (reason for reason in result.integrity.reasons if reason.kind == "carrying")
    assert "turned in the hand at 1" in reason.text
    assert reason.start_s == pytest.approx(15.0, abs=2.0)
    assert result.smoothed.trajectory.longest_sigma_m is not None
    straight = reconstruct(walk().log, CONFIG)
    assert straight.smoothed.trajectory.longest_sigma_m is not None
    assert result.smoothed.trajectory.longest_sigma_m[-1] > 1.2 * straight.smoothed.trajectory.longest_sigma_m[-1]
    assert not [reason for reason in straight.integrity.reasons if reason.kind == "carrying"]


def test_a_device_worn_the_wrong_way_round_walks_where_its_wearer_walks() -> None:
    made = walk(mount_yaw_deg=180.0, tilt_deg=75.0)
    result = reconstruct(made.log, CONFIG)
    assert off_m(result.smoothed.trajectory, made) < 5.0
    (reason,) = (reason for reason in result.integrity.reasons if reason.kind == "carrying")
    assert "device.mount does not fit" in reason.text


@pytest.mark.parametrize(("turned_deg", "mount_deg"), [(90.0, 0.0), (0.0, 180.0)])
def test_online_the_steps_since_are_walked_again(turned_deg: float, mount_deg: float) -> None:
    made = walk(turned_deg, mount_deg)
    smoother = OnlineSmoother(CONFIG)
    edges_s = np.arange(0.0, made.log.duration_s + 5.0, 5.0)
    for start_s, end_s in zip(edges_s[:-1].tolist(), edges_s[1:].tolist(), strict=True):
        smoother.feed(made.log.between(start_s if start_s else -np.inf, end_s))
    assert off_m(smoother.estimate(), made) < 5.0  # once it is known
    assert off_m(smoother.causal, made) > 6.0  # before
    finished, batch = smoother.finish().trajectory, reconstruct(made.log, CONFIG).smoothed.trajectory
    assert np.allclose(finished.xy_m, batch.xy_m, atol=0.02)
    assert finished.cov_xy_yaw is not None
    assert batch.cov_xy_yaw is not None
    assert np.allclose(finished.cov_xy_yaw, batch.cov_xy_yaw, rtol=0.02, atol=1e-4)
