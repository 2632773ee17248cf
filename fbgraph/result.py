"""WalkResult: everything a run found out about one walk. Written by the pipeline, read by whoever shows it."""

from __future__ import annotations

from dataclasses import dataclass, field

from fbgraph.attitude import LevelledSignals
from fbgraph.checkpoints import Checkpoints
from fbgraph.config import Config
from fbgraph.log import SensorLog
from fbgraph.matching import ReturnUpdate
from fbgraph.smoother import Smoothed
from fbgraph.steps import StepTrack
from fbgraph.trajectory import Trajectory
from fbgraph.turnback import TurnBack

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
    turn_back: TurnBack | None = None
    returning: tuple[ReturnUpdate, ...] = ()
