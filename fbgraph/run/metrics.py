"""How far off a trajectory is from known places. Definitions as in the paper (Evaluation Metrics) and the README."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, wrap_scalar
from fbgraph.core.trajectory import Trajectory
from fbgraph.way_back.turns import MIN_TURN_RAD, Turn, find_turns

Alignment = Literal["start", "rigid", "none"]
_LEG_M, _LEG_SIGMAS = 2.0, 8.0
_MOST_M = 1e8  # any frame on Earth lies within
_LATEST_S = 1e12  # the seconds of any clock do
_TURN_STEPS, _TURN_RAD = 3.0, float(np.radians(30.0))  # how near a found turn must be to be the true one


@dataclass(frozen=True)
class Score:
    """Horizontal error over the scored checkpoints, metres: e_k = |p_k - p̂_k|, k = 1 … M.

    Attributes:
        rmse_m: √(Σ e² / M), Euclidean in the plane (√2 larger than errors averaged over the axes too).
        mean_m, max_m: Σ e / M and max e.
        final_m: at the last one, e_M.
        checkpoints: how many were scored, M.
        final_percent: 100 e_M / d, where d is the distance that the estimate walks between the first checkpoint and
            the last; None where it walks none. Drift in per cent of the distance, as in Foxlin, Pedestrian Tracking
            with Shoe-Mounted Inertial Sensors, IEEE CG&A 25(6), 2005.
        ce50_m, ce75_m, ce95_m: circular error: the radius of the smallest circle around the truth that holds at least
            so many per cent of the errors, CE_p = e_(⌈p M⌉) of the sorted ones (ISO/IEC 18305:2016, Test and
            evaluation of localization and tracking systems).
        third_quartile_m: the 75 % quantile, linear between sorted errors, as the EvAAL and IPIN competitions rank
            (Potortì et al., Comparing the Performance of Indoor Localization Systems through the EvAAL Framework,
            Sensors 17(10), 2017); floors are not estimated, so no wrong floor is penalised.
        growth_m_s: how fast the error grows: the slope b of the least-squares line e = a + b t; where the walk was
            moved to agree at the first checkpoint, that one counts with its error of nought. None if all were passed
            at one time.
    """

    rmse_m: float
    mean_m: float
    max_m: float
    final_m: float
    checkpoints: int
    final_percent: float | None
    ce50_m: float
    ce75_m: float
    ce95_m: float
    third_quartile_m: float
    growth_m_s: float | None

    def as_dict(self) -> dict[str, float | None]:
        """For JSON."""
        return asdict(self)


def checkpoint_errors(
    trajectory: Trajectory,
    truth: Checkpoints,
    t0_s: float = 0.0,
    alignment: Alignment = "start",
    log_s: tuple[float, float] | None = None,
) -> FloatArray:
    """Horizontal errors at the checkpoints.

    Args:
        trajectory: the estimate; between breadcrumbs it is taken as linear, before its first and after its last the
            wearer stood there.
        truth: known places on the clock ``t_s + t0_s``.
        t0_s: brings the trajectory's clock to the truth's.
        log_s: when the log begins and ends, on the trajectory's clock; as the trajectory does if None.
        alignment: ``start`` moves the estimate (no rotation, no scale) so that it agrees at the first checkpoint and
            scores those after it; ``rigid`` moves and turns it for the best fit over all; ``none`` takes it as it is.

    Returns:
        (M - 1,) for ``start``, (M,) otherwise; metres.

    Raises:
        DataError: fewer than two checkpoints, or none of the walk: truth of another log or clock.
    """
    offset_m = checkpoint_offsets(trajectory, truth, t0_s, alignment, log_s)
    return np.asarray(np.hypot(*offset_m.T))


def checkpoint_offsets(
    trajectory: Trajectory,
    truth: Checkpoints,
    t0_s: float = 0.0,
    alignment: Alignment = "start",
    log_s: tuple[float, float] | None = None,
) -> FloatArray:
    """How far East and North of the checkpoints the estimate is; arguments, length and errors as ``checkpoint_errors``.

    Returns:
        (M - 1, 2) for ``start``, (M, 2) otherwise; metres.
    """
    estimate = _places_at(trajectory, truth, t0_s, log_s)
    if alignment == "start":
        difference = estimate - truth.xy_m
        return np.asarray((difference - difference[0])[1:])
    if alignment == "rigid":
        return rigid_fit(estimate, truth.xy_m).offset_m
    return np.asarray(estimate - truth.xy_m)


def _places_at(
    trajectory: Trajectory, truth: Checkpoints, t0_s: float, log_s: tuple[float, float] | None
) -> FloatArray:
    """(M, 2) where the estimate is at the checkpoints; arguments and errors as ``checkpoint_errors``."""
    if len(truth) < 2:
        raise DataError(f"{truth.source}: scoring needs at least two checkpoints, found {len(truth)}")
    if truth.doubt:
        raise DataError(f"{truth.source}: {truth.doubt}")
    if np.abs(truth.xy_m).max() > _MOST_M:
        raise DataError(f"{truth.source}: a place {np.abs(truth.xy_m).max():.3g} m from the origin is none on Earth")
    t_s = truth.t_s - t0_s
    if np.abs(t_s).max() > _LATEST_S:
        raise DataError(f"{truth.source}: a place at {truth.t_s[np.abs(t_s).argmax()]:.3g} s, which no clock shows")
    begin_s, end_s = log_s or (float(trajectory.t_s[0]), float(trajectory.t_s[-1]))
    inside_s = t_s[(t_s >= begin_s) & (t_s <= end_s)]
    # who stood still before the first step and after the last walked in between
    if len(inside_s) == 0 or inside_s[0] > trajectory.t_s[-1] or inside_s[-1] < trajectory.t_s[0]:
        raise DataError(
            f"{truth.source}: its times {truth.t_s[0]:.1f} … {truth.t_s[-1]:.1f} s lie outside "
            f"the walk ({trajectory.t_s[0] + t0_s:.1f} … {trajectory.t_s[-1] + t0_s:.1f} s): "
            "another log's truth, or another clock"
        )
    return trajectory.at(t_s)[:, :2]


@dataclass(frozen=True)
class RigidFit:
    """A walk moved and turned, never stretched nor mirrored, onto the truth.

    Attributes:
        offset_m: (M, 2) fitted estimate less truth, East and North.
        turn_rad: how far the estimate is turned from the truth, counter-clockwise, within ±π; None if it cannot be
            told because all places are one.
        spread_m: √(mean squared distance of the true places from their middle): what a turn is multiplied with.
    """

    offset_m: FloatArray
    turn_rad: float | None
    spread_m: float

    @property
    def rmse_m(self) -> float:
        """What is left."""
        return float(np.sqrt((self.offset_m**2).sum(axis=1).mean()))


def rigid_fit(points: FloatArray, targets: FloatArray) -> RigidFit:
    """Fit points to targets in the least-squares sense: min over R, t of Σ |q_k - R p_k - t|².

    Umeyama, Least-Squares Estimation of Transformation Parameters Between Two Point Patterns, IEEE PAMI 13(4), 1991,
    with scale 1; in the plane, with complex p' and q' taken from their means, R is the turn by arg Σ conj(p') q'.

    Args:
        points, targets: (M, 2), p and q.
    """
    a = (points - points.mean(axis=0)) @ (1.0, 1.0j)
    b = (targets - targets.mean(axis=0)) @ (1.0, 1.0j)
    together = np.vdot(a, b)
    left = a * np.exp(1j * np.angle(together)) - b
    known = abs(together) > 1e-12 * max(1.0, float(np.linalg.norm(a)) * float(np.linalg.norm(b)))
    return RigidFit(
        np.column_stack((left.real, left.imag)),
        -float(np.angle(together)) if known else None,
        float(np.sqrt((np.abs(b) ** 2).mean())),
    )


def fit_to_truth(
    trajectory: Trajectory, truth: Checkpoints, t0_s: float = 0.0, log_s: tuple[float, float] | None = None
) -> RigidFit:
    """The best rigid fit over all checkpoints; arguments and errors as in ``checkpoint_errors``."""
    return rigid_fit(_places_at(trajectory, truth, t0_s, log_s), truth.xy_m)


def score(
    trajectory: Trajectory,
    truth: Checkpoints,
    t0_s: float = 0.0,
    alignment: Alignment = "start",
    log_s: tuple[float, float] | None = None,
) -> Score:
    """Errors at the checkpoints, summed up; arguments and errors as in ``checkpoint_errors``."""
    errors = checkpoint_errors(trajectory, truth, t0_s, alignment, log_s)
    t_s = truth.t_s - t0_s
    walked_m = float(np.diff(np.interp(t_s[[0, -1]], trajectory.t_s, trajectory.distance_m))[0])
    ce_m = np.quantile(errors, (0.5, 0.75, 0.95), method="inverted_cdf").tolist()
    return Score(
        rmse_m=float(np.sqrt((errors**2).mean())),
        mean_m=float(errors.mean()),
        max_m=float(errors.max()),
        final_m=float(errors[-1]),
        checkpoints=len(errors),
        final_percent=100.0 * float(errors[-1]) / walked_m if walked_m > 0.0 else None,
        ce50_m=ce_m[0],
        ce75_m=ce_m[1],
        ce95_m=ce_m[2],
        third_quartile_m=float(np.quantile(errors, 0.75)),
        growth_m_s=_slope(t_s, np.append(np.zeros(len(t_s) - len(errors)), errors)),
    )


def _slope(t_s: FloatArray, errors_m: FloatArray) -> float | None:
    """Of the least-squares line of errors over time, metres a second; None if there is only one time."""
    since_s = t_s - t_s.mean()
    square = float(since_s @ since_s)
    return float(since_s @ errors_m) / square if square > 0.0 else None


@dataclass(frozen=True)
class LegErrors:
    """Error of each leg between consecutive checkpoints: what a position error is made of.

    Attributes:
        start_s, end_s: (L,) since log start.
        length_rel: (L,) estimated over true length, minus 1.
        yaw_rad: (L,) estimated minus true direction, counter-clockwise.
    """

    start_s: FloatArray
    end_s: FloatArray
    length_rel: FloatArray
    yaw_rad: FloatArray


def leg_errors(
    trajectory: Trajectory, truth: Checkpoints, t0_s: float = 0.0, min_leg_m: float | None = None
) -> LegErrors:
    """Straight from checkpoint to checkpoint, estimated against true; arguments as in ``checkpoint_errors``.

    Args:
        trajectory, truth, t0_s: as there.
        min_leg_m: checkpoints closer to the one before are skipped: their direction is that of the survey's error; 2 m
            if None, and eight standard deviations of a receiver's fixes.
    """
    t_s = truth.t_s - t0_s
    places = truth.xy_m
    chosen = leg_ends(truth, min_leg_m)
    estimated = np.diff(trajectory.at(t_s[chosen])[:, :2], axis=0) @ (1.0, 1j)
    true = np.diff(places[chosen], axis=0) @ (1.0, 1j)
    ratio = estimated / true
    return LegErrors(t_s[chosen[:-1]], t_s[chosen[1:]], np.abs(ratio) - 1.0, np.angle(ratio))


def leg_ends(truth: Checkpoints, min_leg_m: float | None = None) -> list[int]:
    """Indices of the checkpoints between which legs lie; ``min_leg_m`` as in ``leg_errors``."""
    if min_leg_m is None:
        min_leg_m = max(_LEG_M, _LEG_SIGMAS * float(np.median(truth.sigma_m))) if truth.gnss else _LEG_M
    chosen = [0]
    for i, place in enumerate(truth.xy_m.tolist()):
        if math.dist(place, truth.xy_m[chosen[-1]]) >= min_leg_m:
            chosen.append(i)
    return chosen


@dataclass(frozen=True)
class TurnScore:
    """Turns found against true ones.

    Attributes:
        found: number of true turns that were found.
        missed: (time, angle) of true turns that were not.
        phantom: turns that are not there.
        error_rad: (found,) angle found less the true one.
    """

    found: int
    missed: tuple[tuple[float, float], ...]
    phantom: tuple[Turn, ...]
    error_rad: FloatArray


def score_turns(trajectory: Trajectory, t_s: FloatArray, angle_rad: FloatArray) -> TurnScore:
    """Score the turns of a trajectory (the paper's turn-event detection consistency, section Evaluation Metrics).

    True turns are those of at least 30°. One is found by the nearest turn not yet taken that is at most three
    breadcrumbs away and whose angle is within 30°; left about and right about are the same. Distance is in breadcrumbs,
    for in a pause no time is right: who turns about after half a minute's rest does so between two of them.

    Args:
        trajectory: on the clock of the true turns.
        t_s, angle_rad: (T,) middles and signed angles of the true turns.
    """
    real = np.abs(angle_rad) >= MIN_TURN_RAD
    free, missed, errors = find_turns(trajectory), [], []
    at = np.interp(t_s[real], trajectory.t_s, np.arange(len(trajectory)))
    for k, when_s, angle in zip(at.tolist(), t_s[real].tolist(), angle_rad[real].tolist(), strict=True):
        near = [
            turn
            for turn in free
            if abs(turn.breadcrumb - k) <= _TURN_STEPS and abs(wrap_scalar(turn.angle_rad - angle)) <= _TURN_RAD
        ]
        if near:
            best = min(near, key=lambda turn: abs(turn.breadcrumb - k))
            free.remove(best)
            errors.append(wrap_scalar(best.angle_rad - angle))
        else:
            missed.append((when_s, angle))
    return TurnScore(len(errors), tuple(missed), tuple(free), np.array(errors))
