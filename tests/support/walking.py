"""Walks fed to the online smoother, and how far two trajectories are apart."""

import itertools

import numpy as np

from fbgraph.core.config import load_config
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.estimates import Update
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.simulator.routes import Route
from fbgraph.way_back.guide import ReturnGuide


def feed(smoother: OnlineSmoother, log: SensorLog, chunk_s: float) -> list[Update]:
    """Give it the log in pieces."""
    edges = [-np.inf, *np.arange(chunk_s, log.duration_s, chunk_s).tolist(), np.inf]
    return [update for lo, hi in itertools.pairwise(edges) for update in smoother.feed(log.between(lo, hi))]


def walked(log: SensorLog, chunk_s: float = 0.5) -> Trajectory:
    """The finished walk of a wearable's log."""
    smoother = OnlineSmoother(load_config("m5stickc"))
    feed(smoother, log, chunk_s)
    return smoother.finish().trajectory


def guided(log: SensorLog, at: str, chunk_s: float = 0.5, device: str = "m5stickc") -> ReturnGuide:
    """The guide after a walk, told that the way back begins ``at``."""
    config = load_config(device, [f'returning.at="{at}"'])
    guide = ReturnGuide(config)
    smoother = OnlineSmoother(config, companion=guide)
    feed(smoother, log, chunk_s)
    smoother.finish()
    return guide


def differences(a: Trajectory, b: Trajectory) -> tuple[float, float]:
    """RMS horizontal distance in metres, RMS yaw difference in degrees."""
    assert len(a) == len(b)
    yaw = (a.yaw_rad - b.yaw_rad + np.pi) % (2 * np.pi) - np.pi
    return float(np.sqrt(((a.xy_m - b.xy_m) ** 2).sum(axis=1).mean())), float(np.degrees(np.sqrt((yaw**2).mean())))


def route(*rows: tuple[float, ...]) -> Route:
    """x, y and, where given, the pause."""
    table = np.array([(*row, 0.0)[:3] for row in rows], dtype=float)
    xyz_m = np.column_stack((table[:, :2], np.zeros(len(table))))
    return Route("test", xyz_m, table[:, 2], tuple(str(k) for k in range(len(rows))))
