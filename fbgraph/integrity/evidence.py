"""What checks look at, and what they find."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fbgraph.core.aids import Aids
from fbgraph.core.config import Config
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Reason
from fbgraph.estimators.estimates import Smoothed
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import StepTrack


class Sensed(Protocol):
    """What sensors and steps said, of a whole walk or, while it goes on, of its last minute."""

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


class Evidence(Sensed, Protocol):
    """A walk as far as its run goes; ``run.walk_result.WalkResult`` is one. No truth: that only scores."""

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


SensedCheck = Callable[[Sensed], Sequence[Doubt]]
Check = Callable[[Evidence], Sequence[Doubt]]

UNKNOWN_TURN_RAD = np.pi / 2.0
"""One sigma of a heading of which nothing is known: spread evenly over the circle it would be 1.8 rad."""


def turned_m(track: StepTrack, heading_rad: float, start_s: float = -np.inf) -> FloatArray:
    """(K+1,) how far breadcrumbs may be off where from ``start_s`` on the heading is off by an unknown ``heading_rad``.

    Growing with the distance walked, as an error that lasts does on a straight walk; sideways, so half of its square on
    each axis.
    """
    return np.asarray(_walked_m(track, start_s) * min(heading_rad, UNKNOWN_TURN_RAD) / np.sqrt(2.0))


def stretched_m(track: StepTrack, length_rel: float, start_s: float = -np.inf) -> FloatArray:
    """(K+1,) the same where steps are off by this share of their length."""
    return np.asarray(_walked_m(track, start_s) * length_rel / np.sqrt(2.0))


def _walked_m(track: StepTrack, start_s: float) -> FloatArray:
    """(K+1,) distance walked since ``start_s``; 0 before."""
    walked_m = np.cumsum(track.length_m)
    return np.asarray(np.maximum(walked_m - np.interp(start_s, track.t_s, walked_m), 0.0))


def stepping(walk: Sensed) -> BoolArray:
    """(N,) which samples lie within a step."""
    t_s, track = walk.signals.t_s, walk.track
    edges = np.zeros(len(t_s) + 1, dtype=np.int64)
    np.add.at(edges, np.searchsorted(t_s, track.start_s[1:]), 1)
    np.add.at(edges, np.searchsorted(t_s, track.t_s[1:]), -1)
    return np.asarray(np.cumsum(edges)[:-1] > 0)
