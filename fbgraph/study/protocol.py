"""How the ForestBack paper scores a trial (sections Experimental Protocol and Evaluation Metrics), and the results.

The error at a sample k is e_k = |p_k - p̂_k| in the plane, for every sample of the trial; the estimate sets out from
the ground truth's first place, checkpoint A, and is neither turned nor scaled. Between breadcrumbs it is linear.

The paper does not say how it detects turns. ``turns.find_turns`` looks at whole steps, too coarse for corners three
steps apart. Here a turn is where the heading, at the gyroscope's rate and with the method's corrections, changes by
``MIN_TURN_RAD`` (a little over half the course's slightest corner) or more within ``TURN_S``, about two steps; it
agrees with a label of the same side at most ``MATCH_S`` away. The paper's consistency of 99.90 % cannot be of events
(36 trials have 108 labels) and is probably of samples, nearly all of which have no turn; here it is the share of events
that agree: matched / (matched + missed + false).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fbgraph.core.config import Config
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.core.trajectory import Trajectory
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import StepTrack
from fbgraph.study.calibration import StepModel
from fbgraph.study.column_names import DatasetConfig
from fbgraph.study.comparison import Comparison
from fbgraph.study.trial import Path2D, Trial, Turns, walking_direction

LABELS = {
    "logged_pdr": "logged PDR",
    "logged_forestback": "logged ForestBack",
    "pdr": "PDR",
    "ekf": "ForestBack EKF",
    "online": "iSAM2 online",
    "finished": "iSAM2 finished",
    "smoothed": "smoother",
}
"""Methods in the order in which they are shown."""
TURN_S = 1.2
MIN_TURN_RAD = np.radians(25.0)
MATCH_S = 1.0


@dataclass(frozen=True)
class TurnScore:
    """Detected turns against labelled ones; ``late_s`` (matched,) how much later they are."""

    matched: int
    missed: int
    false: int
    late_s: FloatArray


@dataclass(frozen=True)
class MethodResult:
    """What one method made of one trial.

    Attributes:
        xy_m: (N, 2) at the truth's samples.
        error_m: (N,) there.
        heading_error_rad, direction_rad: (K,) of each step, and which way it really went (counter-clockwise from East);
            empty where the method tells no heading.
        turns: as detected from its heading.
    """

    xy_m: FloatArray
    error_m: FloatArray
    heading_error_rad: FloatArray
    direction_rad: FloatArray
    turns: TurnScore

    @property
    def rmse_m(self) -> float:
        """√(mean e²) over all samples."""
        return float(np.sqrt((self.error_m**2).mean()))

    @property
    def mean_m(self) -> float:
        """Mean error."""
        return float(self.error_m.mean())

    @property
    def max_m(self) -> float:
        """Largest error."""
        return float(self.error_m.max())

    @property
    def final_m(self) -> float:
        """Distance between the ends."""
        return float(self.error_m[-1])


@dataclass(frozen=True)
class TrialResult:
    """One trial: ``methods`` in the order of ``LABELS``, fitted on all trials; ``held_out_rmse_m`` by method name, with
    everything fitted on the other trials; ``reference`` the turns that count; ``steps`` detected, ``seconds`` spent.
    """

    trial: Trial
    reference: Turns
    steps: int
    methods: dict[str, MethodResult]
    held_out_rmse_m: dict[str, float]

    @property
    def progress(self) -> FloatArray:
        """(N,) share of the route walked, at each sample."""
        distance = self.trial.truth.distance_m
        return np.asarray(distance / max(float(distance[-1]), 1e-9))


@dataclass(frozen=True)
class StudyResult:
    """The paper's evaluation of a data set.

    Attributes:
        source: the data set.
        simulated: how it was simulated; empty for a real one.
        config: effective, with the fitted parameters.
        layout: of the data set.
        model: the fit on all trials; ``held_out_models`` leave one trial out each.
        trials: results.
        skipped: name and reason of each trial or table that could not be used.
        comparison: everything over all trials.
        notices: what to know before believing it.
    """

    source: str
    simulated: str
    config: Config
    layout: DatasetConfig
    model: StepModel
    held_out_models: tuple[StepModel, ...]
    trials: tuple[TrialResult, ...]
    skipped: tuple[tuple[str, str], ...]
    comparison: Comparison
    notices: tuple[str, ...]

    @property
    def methods(self) -> list[str]:
        """Names of all methods that every trial has, in the order of ``LABELS``."""
        return [name for name in LABELS if all(name in trial.methods for trial in self.trials)]

    @property
    def drawn(self) -> list[str]:
        """The methods that figures show: a finished iSAM2 is the smoother again."""
        return [name for name in self.methods if name != "finished"]

    @property
    def checkpoints(self) -> dict[str, float]:
        """Mean progress at each checkpoint, by name; from the turns where the table names none."""
        named = [trial.trial.checkpoints for trial in self.trials]
        if len(named[0]) > 1 and all(names == named[0] for names in named):
            times, names = [trial.trial.checkpoint_s for trial in self.trials], list(named[0])
        else:
            count = len(self.trials[0].reference.t_s)
            if any(len(trial.reference.t_s) != count for trial in self.trials):
                return {}
            times = [
                np.concatenate((t.trial.truth.t_s[:1], t.reference.t_s, t.trial.truth.t_s[-1:])) for t in self.trials
            ]
            names = [chr(ord("A") + k) for k in range(count + 2)]
        at = [np.interp(t_s, t.trial.truth.t_s, t.progress) for t_s, t in zip(times, self.trials, strict=True)]
        return dict(zip(names, np.mean(at, axis=0).tolist(), strict=True))


def score_trajectory(
    trial: Trial, reference: Turns, trajectory: Trajectory, track: StepTrack, signals: LevelledSignals
) -> MethodResult:
    """Score one of our methods."""
    xy = trajectory.at(trial.truth.t_s)[:, :2]
    xy = xy - xy[0] + trial.truth.xy_m[0]
    # the method's heading at the gyroscope's rate: the gyroscope's own, corrected as the method corrects each step
    correction = np.interp(signals.t_s, track.yaw_s, trajectory.yaw_rad - track.yaw_gyro_rad)
    found = turn_events(signals.t_s, signals.yaw_gyro_rad + correction)
    direction = np.array([_mean_heading(trial.truth, step.start_s, step.t_s) for step in track.steps[1:]])
    return _scored(trial, xy, wrap_angle(trajectory.yaw_rad[1:] - direction), direction, match_turns(found, reference))


def score_logged(trial: Trial, reference: Turns, method: str, track: StepTrack) -> MethodResult:
    """Score what the authors' own method wrote into the table; as it is, in the map's frame."""
    logged = trial.logged[method]
    xy = np.column_stack([np.interp(trial.truth.t_s, logged.t_s, axis) for axis in (logged.x_m, logged.y_m)])
    known = bool(np.isfinite(logged.heading_rad).all())
    heading = logged.heading_rad if known else walking_direction(logged)
    steps = [(step.start_s, step.t_s) for step in track.steps[1:]] if known else []
    direction = np.array([_mean_heading(trial.truth, *span) for span in steps])
    estimate = np.array([_mean_heading(logged, *span) for span in steps])
    found = turn_events(logged.t_s, heading)
    return _scored(trial, xy, wrap_angle(estimate - direction), direction, match_turns(found, reference))


def _scored(
    trial: Trial, xy_m: FloatArray, heading_error_rad: FloatArray, direction_rad: FloatArray, turns: TurnScore
) -> MethodResult:
    error = np.asarray(np.hypot(*(xy_m - trial.truth.xy_m).T))
    return MethodResult(xy_m, error, heading_error_rad, direction_rad, turns)


def _mean_heading(path: Path2D, start_s: float, end_s: float) -> float:
    """Mean direction between two times; at one of them if no sample lies between."""
    between = slice(*np.searchsorted(path.t_s, (start_s, end_s)))
    heading = path.heading_rad[between]
    return float(heading.mean() if len(heading) else np.interp(end_s, path.t_s, path.heading_rad))


def reference_turns(trial: Trial) -> Turns:
    """The labelled turns; those of the ground truth's heading where the table labels none."""
    return turn_events(trial.truth.t_s, trial.truth.heading_rad) if trial.turns is None else trial.turns


def turn_events(t_s: FloatArray, heading_rad: FloatArray) -> Turns:
    """Where the heading (N,), unwrapped, changes by at least ``MIN_TURN_RAD`` within ``TURN_S``."""
    ends = [np.interp(t_s + by, t_s, heading_rad) for by in (TURN_S / 2.0, -TURN_S / 2.0)]
    change = ends[0] - ends[1]
    side = np.where(np.abs(change) >= MIN_TURN_RAD, np.sign(change), 0.0)
    edges = np.flatnonzero(np.diff(np.concatenate(([0.0], side, [0.0]))))
    runs = [(lo, hi) for lo, hi in pairwise(edges.tolist()) if side[lo] != 0.0]
    at = np.array([lo + np.argmax(np.abs(change[lo:hi])) for lo, hi in runs], dtype=np.int64)
    return Turns(t_s[at], side[at])


def match_turns(found: Turns, reference: Turns) -> TurnScore:
    """Pair detected with labelled turns, nearest pairs first."""
    apart = found.t_s[:, None] - reference.t_s[None, :]
    distance = np.where(found.side[:, None] * reference.side[None, :] < 0, np.inf, np.abs(apart))
    late = []
    while distance.size and distance.min() <= MATCH_S:
        f, r = np.unravel_index(int(np.argmin(distance)), distance.shape)
        late.append(float(apart[f, r]))
        distance[f, :] = distance[:, r] = np.inf
    return TurnScore(len(late), len(reference.t_s) - len(late), len(found.t_s) - len(late), np.array(late))
