"""What checks look at, and what they find."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fbgraph.core.aids import Aids
from fbgraph.core.config import Config
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Reason
from fbgraph.estimators.estimates import Smoothed
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import StepTrack


class Evidence(Protocol):
    """A walk as far as its run goes; ``run.walk_result.WalkResult`` is one. No truth: that only scores."""

    @property
    def log(self) -> SensorLog:
        """What the sensors said."""

    @property
    def config(self) -> Config:
        """The effective configuration."""

    @property
    def signals(self) -> LevelledSignals:
        """The log, levelled."""

    @property
    def track(self) -> StepTrack:
        """The steps."""

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """By estimator name."""

    @property
    def smoothed(self) -> Smoothed:
        """The smoother's account of itself."""

    @property
    def aids(self) -> Aids:
        """What the smoother was told, in seconds since log start."""

    @property
    def failed(self) -> Mapping[str, str]:
        """Why, by name of an estimator that failed."""


@dataclass(frozen=True)
class Doubt:
    """What a check found.

    Attributes:
        reason: in words.
        sigma_m: (K+1,) by how much each breadcrumb's place may be off for this reason, one sigma a axis; None for what
            the covariance already allows.
        sigma_z_m: (K+1,) the same of its altitude.
        withhold: the walk is worth nothing for this reason.
    """

    reason: Reason
    sigma_m: FloatArray | None = None
    sigma_z_m: FloatArray | None = None
    withhold: bool = False


Check = Callable[[Evidence], Sequence[Doubt]]


def turned_m(trajectory: Trajectory, heading_rad: float, start_s: float = -np.inf) -> FloatArray:
    """(K+1,) how far breadcrumbs may be off where from ``start_s`` on the heading is off by an unknown ``heading_rad``.

    Growing with the distance walked, as an error that goes with the heading does on a straight walk; sideways, so half
    of its square on each axis.
    """
    walked_m = trajectory.distance_m - np.interp(start_s, trajectory.t_s, trajectory.distance_m)
    return np.asarray(np.maximum(walked_m, 0.0) * min(heading_rad, np.pi) / np.sqrt(2.0))


def stretched_m(trajectory: Trajectory, length_rel: float, start_s: float = -np.inf) -> FloatArray:
    """(K+1,) the same where steps are off by this share of their length."""
    walked_m = trajectory.distance_m - np.interp(start_s, trajectory.t_s, trajectory.distance_m)
    return np.asarray(np.maximum(walked_m, 0.0) * length_rel / np.sqrt(2.0))
