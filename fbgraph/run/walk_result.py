"""WalkResult: everything a run found out about one walk. Written by the pipeline, read by whoever shows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fbgraph.core.aids import Aids, Told
from fbgraph.core.config import Config
from fbgraph.core.earth_field import EarthField, earth_field, walk_day
from fbgraph.core.geometry import FloatArray
from fbgraph.core.georeference import Georeference
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Integrity
from fbgraph.estimators.estimates import Belief, Smoothed
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.inputs import RunInputs
from fbgraph.way_back.records import ReturnUpdate, TurnBack

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
        told: truth (for scoring and showing only), anchors, a closed end; on the clock ``t_s + log.t0_s``.
        seconds: wall time by stage.
        beliefs: what the online smoother took the walk to be, at times while it was walked.
        inputs: what was read and asked for, so that the run can be made again.
        turn_back: where the way out ended, if that is known.
        returning: what was told at each step of the way back.
        failed: why, by name of an estimator that failed or is withheld; then ``smoothed`` holds the EKF's walk.
        integrity: how far the smoothed walk may be believed; its covariance is widened accordingly.
    """

    log: SensorLog
    config: Config
    signals: LevelledSignals
    track: StepTrack
    trajectories: dict[str, Trajectory]
    smoothed: Smoothed
    told: Told = field(default_factory=Told)
    seconds: dict[str, float] = field(default_factory=dict)
    beliefs: tuple[Belief, ...] = ()
    inputs: RunInputs = field(default_factory=RunInputs)
    turn_back: TurnBack | None = None
    returning: tuple[ReturnUpdate, ...] = ()
    failed: Mapping[str, str] = field(default_factory=dict)
    integrity: Integrity = field(default_factory=Integrity)

    @property
    def best(self) -> str:
        """Name of the estimator to believe."""
        return "ekf" if "smoothed" in self.failed else "smoothed"

    @property
    def aids(self) -> Aids:
        """What the smoother was told, its anchors in seconds since log start."""
        return self.told.aids(self.log.t0_s, self.config.device.declination_deg)

    @property
    def expected_field(self) -> EarthField | None:
        """What an undisturbed magnetometer sees where the walk was, None if nobody knows where that is."""
        where = self.told.place
        return None if where is None else earth_field(where, walk_day(self.log.t0_s))

    @property
    def truth_shift_m(self) -> FloatArray:
        """(2,) what brings the truth into the walk's frame: the smoothed walk agrees at the first checkpoint.

        Anchors have already brought the walk into the truth's frame; then it is zero, as it is without truth.
        """
        truth = self.told.truth
        if truth is None or self.told.anchors is not None or len(truth) == 0:
            return np.zeros(2)
        first = self.smoothed.trajectory.at(truth.t_s[:1] - self.log.t0_s)[0, :2]
        return np.asarray(first - truth.xy_m[0])

    @property
    def georeference(self) -> Georeference | None:
        """Where on Earth the world frame lies: by the user, by anchors, else (to show, never to estimate) by truth."""
        smoothed = self.smoothed.trajectory
        if self.told.origin is not None:
            return self.told.origin.moved(-float(smoothed.x_m[0]), -float(smoothed.y_m[0]))
        for places in (self.told.anchors, self.told.truth):
            if places is not None and places.georeference is not None:
                dx_m, dy_m = (0.0, 0.0) if places is self.told.anchors else self.truth_shift_m.tolist()
                return places.georeference.moved(-dx_m, -dy_m)
        return None
