"""Results of walks made by hand: what no estimator found, so that every number of them is known."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fbgraph.core.config import Config
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.estimates import Residuals, Smoothed
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.walk_result import WalkResult
from support.by_hand import steps_of, way_along

T0_S = 1000.0
"""The event clock when the log begins."""


def hand_log(duration_s: float = 60.0, **given: Any) -> SensorLog:
    """A log at 100, 100, 50 and 10 Hz that nobody looks at."""

    def stream(rate_hz: float, width: int) -> Stream:
        t_s = np.arange(0.0, duration_s + 1e-9, 1.0 / rate_hz)
        return Stream(t_s, np.zeros((len(t_s), width)))

    usual: dict[str, Any] = {
        "name": "hand",
        "format": "m5stickc",
        "t0_s": T0_S,
        "acc": stream(100.0, 3),
        "gyro": stream(100.0, 3),
    }
    return SensorLog(**(usual | {"mag": stream(50.0, 3), "pressure": stream(10.0, 1)} | given))


def hand_signals(duration_s: float = 60.0, still: BoolArray | None = None) -> LevelledSignals:
    """Ten a second, nothing in them but time and stillness."""
    count = round(duration_s * 10) + 1
    nothing = np.zeros(count)
    index = np.arange(count, dtype=np.int64)
    columns = (index, index / 10.0, nothing, np.zeros((count, 3)), *(nothing,) * 8)
    return LevelledSignals(*columns, still=np.zeros(count, dtype=bool) if still is None else still)


def with_cov(way: Trajectory, sigma_x_m: float = 0.3, sigma_y_m: float = 0.4, yaw_rad: float = 0.05) -> Trajectory:
    """The same covariance everywhere, along the axes."""
    cov = np.tile(np.diag([sigma_x_m**2, sigma_y_m**2, yaw_rad**2]), (len(way), 1, 1))
    return replace(way, cov_xy_yaw=cov)


def residuals(name: str, weights: dict[int, float]) -> Residuals:
    """Factors of one kind at these breadcrumbs, with what the robust loss left of each."""
    k = np.array(list(weights), dtype=np.int64)
    return Residuals(name, k, np.ones(len(k)), np.array(list(weights.values())))


def hand_result(
    way: Trajectory | None = None,
    ekf: Trajectory | None = None,
    steps: Mapping[str, Sequence[Any] | npt.NDArray[Any]] | None = None,
    smoothed: dict[str, Any] | None = None,
    **given: Any,
) -> WalkResult:
    """A walk that was smoothed to ``way``; 50 steps East if nobody says otherwise."""
    way = way if way is not None else way_along((0.0, 0.0), (25.0, 0.0), t0_s=1.0)
    solved = Smoothed(way, np.array([9.0, 4.0, 2.0]), 99, ())
    usual: dict[str, Any] = {
        "log": hand_log(),
        "config": Config(),
        "signals": hand_signals(),
        "track": StepTrack(steps_of(way, **(steps or {}))),
        "trajectories": {"pdr": way, "ekf": way if ekf is None else ekf, "smoothed": way},
        "smoothed": replace(solved, **(smoothed or {})),
    }
    return WalkResult(**(usual | given))


def changed(count: int, where: slice | Sequence[int], value: float, usual: float) -> FloatArray:
    """A column that is ``usual`` everywhere but there."""
    column = np.full(count, usual)
    column[where] = value
    return column
