"""WalkResult: everything a run found out about one walk. Written by the pipeline, read by whoever shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import Config
from fbgraph.core.geometry import FloatArray
from fbgraph.core.georeference import Georeference
from fbgraph.core.log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.online import Belief
from fbgraph.estimators.smoother import Smoothed
from fbgraph.front_end.front_end import StepTrack
from fbgraph.front_end.leveller import LevelledSignals
from fbgraph.way_back.matcher import ReturnUpdate
from fbgraph.way_back.turn_back import TurnBack

ESTIMATORS = ("pdr", "ekf", "smoothed", "online")
"""Names of trajectories, in the order in which they are shown."""


@dataclass(frozen=True)
class WalkResult:
    """One walk, reconstructed.

    Attributes:
        log: what the sensors said.
        config: the effective configuration.
        signals: the log, levelled.
        track: the steps all estimators worked on.
        trajectories: by estimator name, in the order of ``ESTIMATORS``; those that were run.
        smoothed: the smoother's account of itself.
        truth: known places, for scoring and showing only; on the clock ``t_s + log.t0_s``.
        anchors: known places that entered the graph.
        closed_walk: whether the smoother was told that the walk ends where it began.
        seconds: wall time by stage.
        origin: where on Earth the walk began, if the user said so.
        beliefs: what the online smoother took the walk to be, at times while it was walked.
        inputs: what was read and asked for, so that the run can be made again.
        turn_back: where the way out ended, if that is known.
        returning: what was told at each step of the way back.
    """

    log: SensorLog
    config: Config
    signals: LevelledSignals
    track: StepTrack
    trajectories: dict[str, Trajectory]
    smoothed: Smoothed
    truth: Checkpoints | None = None
    anchors: Checkpoints | None = None
    closed_walk: bool = False
    seconds: dict[str, float] = field(default_factory=dict)
    origin: Georeference | None = None
    beliefs: tuple[Belief, ...] = ()
    inputs: Mapping[str, Any] = field(default_factory=dict)
    turn_back: TurnBack | None = None
    returning: tuple[ReturnUpdate, ...] = ()

    @property
    def truth_shift_m(self) -> FloatArray:
        """(2,) what brings the truth into the walk's frame: the smoothed walk agrees at the first checkpoint.

        Anchors have already brought the walk into the truth's frame; then it is zero, as it is without truth.
        """
        if self.truth is None or self.anchors is not None or len(self.truth) == 0:
            return np.zeros(2)
        first = self.smoothed.trajectory.at(self.truth.t_s[:1] - self.log.t0_s)[0, :2]
        return np.asarray(first - self.truth.xy_m[0])

    @property
    def georeference(self) -> Georeference | None:
        """Where on Earth the world frame lies: by the user, by anchors, else (to show, never to estimate) by truth."""
        smoothed = self.smoothed.trajectory
        if self.origin is not None:
            return self.origin.moved(-float(smoothed.x_m[0]), -float(smoothed.y_m[0]))
        for places in (self.anchors, self.truth):
            if places is not None and places.georeference is not None:
                dx_m, dy_m = (0.0, 0.0) if places is self.anchors else self.truth_shift_m.tolist()
                return places.georeference.moved(-dx_m, -dy_m)
        return None
