"""A walk laid along the corridors of its building, whose direction is known up to right angles.

What is left of a smoothed walk's error is first of all one heading offset d of the whole walk: how the device was held,
and what the compass was off on average. Where corridors are known to run at an axis, modulo 90°, the straight legs tell
it. Each leg lies along a corridor, give or take, or anywhere, so that one across a hall is let go; long ones count
more. With L(d) their likelihood, and beforehand d normal as the mount's, wider by the axis's own sigma:

    p(d | legs) ∝ N(d; 0, σ_mount² + σ_axis²) L(d)     the walk is turned by the mean of d, and keeps its deviation
    ∫ N(d) L(d) dd / mean of L over all axes           how much better the axis explains the legs than any would

So the angle is a state with its prior; it is marginalised on a grid, as it has several peaks, once all else is solved,
for turning a whole walk changes no other residual. Robust factors on single headings were worse on real walks: they
bend legs that share one offset away from each other. If the second is less than 2.5 the axis is refused. A compass that
is off by as much as the axis is wrong cannot be told from one that is right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fbgraph.core.aids import Aids, WalkAxis
from fbgraph.core.building import QUARTER_RAD
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Reason
from fbgraph.estimators.estimates import AxisFit, Residuals, Smoothed
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.turns import find_turns, leg_yaws

_MIN_TURN_RAD = math.radians(20.0)
_MIN_LEG_M = 4.0
_BENT_RAD = math.radians(10.0)  # between the halves of a leg: what bends by more is a curve
_STRAIGHT = 0.4  # of the distance walked: of a path through a park 0.28 at most, in a museum 0.70 at least
_ASKEW_RAD = math.radians(8.0)  # of a leg along a corridor, its share of the compass's error included
_ALONG = 0.85  # of the legs in a building
_ONCE_M, _MOST = 10.0, 3.0  # so many metres of a leg count once, and no leg more often than this
WALK_RAD = math.radians(6.0)
"""Of the heading offset of a whole walk: 4.9° in a museum, 6.5° in a shopping centre."""
_GRID_RAD = math.radians(0.5)
OFFSETS_RAD: FloatArray = _GRID_RAD * np.arange(-90.0, 90.0, dtype=np.float64)
"""(G,) of a walk's heading, modulo 90°; also the axes that are compared."""
_BELIEVED = math.log(2.5)  # by how much the axis must explain the legs better than any other would
_CLEARLY_DEG = 6.0
_CONTRADICTED = 0.0  # any axis explains them better


@dataclass(frozen=True)
class Legs:
    """Straight pieces of a walk.

    Attributes:
        yaw_rad: (N,) direction of each, from place to place.
        length_m: (N,).
        last: (N,) breadcrumb at its end.
    """

    yaw_rad: FloatArray
    length_m: FloatArray
    last: IntArray

    @property
    def counts(self) -> FloatArray:
        """(N,) how often each counts."""
        return np.minimum(self.length_m / _ONCE_M, _MOST)

    def turned(self, turn_rad: float) -> Legs:
        """The same in a frame that is turned clockwise by so much."""
        return replace(self, yaw_rad=self.yaw_rad + turn_rad)

    def off_rad(self, axis_rad: float) -> FloatArray:
        """(N,) by which each lies to the left of the nearest corridor."""
        return fold(self.yaw_rad - axis_rad)

    def likelihood(self, axis_rad: float) -> FloatArray:
        """(G,) of the legs if the walk is turned by each of ``OFFSETS_RAD``, relative to the likeliest; never 0."""
        if not len(self.yaw_rad):
            return np.ones(len(OFFSETS_RAD))
        log = (np.log(_density(fold(self.off_rad(axis_rad) + OFFSETS_RAD[:, None]))) * self.counts).sum(axis=1)
        return np.asarray(np.exp(log - log.max()))


def straight_legs(trajectory: Trajectory) -> Legs:
    """The legs of a walk that are long enough to have a direction, and do not bend.

    None of a walk that bends most of the way: what is straight of it is so by chance.
    """
    edges = [0, *(turn.breadcrumb for turn in find_turns(trajectory, _MIN_TURN_RAD)), len(trajectory) - 1]
    yaw_rad, xy_m = leg_yaws(trajectory, edges), trajectory.xy_m
    legs = [
        (yaw, float(np.hypot(*(xy_m[hi] - xy_m[lo]))), hi)
        for (lo, hi), yaw in zip(pairwise(edges), yaw_rad.tolist(), strict=True)
        if hi > lo + 2 and not _bends(xy_m[lo], xy_m[(lo + hi) // 2], xy_m[hi])
    ]
    table = np.array([leg for leg in legs if leg[1] >= _MIN_LEG_M], dtype=float).reshape(-1, 3)
    if table[:, 1].sum() < _STRAIGHT * float(trajectory.distance_m[-1]):
        table = table[:0]
    return Legs(table[:, 0], table[:, 1], table[:, 2].astype(np.int64))


def _bends(first_m: FloatArray, middle_m: FloatArray, last_m: FloatArray) -> bool:
    """Whether a leg's halves have directions of their own."""
    (ax, ay), (bx, by) = middle_m - first_m, last_m - middle_m
    return bool(abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by)) > _BENT_RAD)


def fold(angle_rad: FloatArray) -> FloatArray:
    """The same angles up to right angles, in [-45°, 45°)."""
    return (angle_rad + 0.5 * QUARTER_RAD) % QUARTER_RAD - 0.5 * QUARTER_RAD


def _density(off_rad: FloatArray) -> FloatArray:
    """Of a leg's direction against the nearest corridor."""
    return _ALONG * _normal(off_rad, _ASKEW_RAD) + (1.0 - _ALONG) / QUARTER_RAD


def _normal(off_rad: FloatArray, sigma_rad: float) -> FloatArray:
    return np.exp(-0.5 * (off_rad / sigma_rad) ** 2) / (sigma_rad * math.sqrt(2.0 * math.pi))


def lay_along_axis(smoothed: Smoothed, track: StepTrack, aids: Aids, config: GraphConfig) -> Smoothed:
    """A smoothed walk turned to the axis of its building; as it was where that is refused, or where nobody named one.

    Args:
        smoothed: with all other aids.
        track: the steps.
        aids: what was told; an anchor is where the walk is turned about, and two of them know its direction better.
        config: weights: how far a whole walk may be turned.

    Returns:
        The walk with ``axis`` and what its legs have to complain about; a doubt where they contradict the axis.
    """
    axis, walk = aids.axis, smoothed.trajectory
    if axis is None:
        return smoothed
    legs = straight_legs(walk)
    why = _useless(legs, track, aids)
    if why:
        return replace(smoothed, axis=AxisFit(why=why, legs=len(legs.yaw_rad)), notes=(*smoothed.notes, _note(why)))
    fit = fit_axis(legs, axis, config)
    if fit.log_odds < _BELIEVED:
        return _refused(smoothed, legs, axis, fit)
    pivot_m = walk.xy_m[0]
    if aids.anchors is not None:
        pivot_m = aids.anchors.xy_m[0]
    off_rad, along = legs.off_rad(axis.yaw_rad) + fit.turned_rad, _along(legs, axis, fit.turned_rad)
    table = Residuals("axis", legs.last, off_rad / _ASKEW_RAD, along)
    spread_rad = fit.sigma_rad if aids.anchors is None else None
    return replace(
        smoothed,
        trajectory=turned_walk(walk, fit.turned_rad, pivot_m, config.sigma_mount_rad, spread_rad),
        residuals=(*smoothed.residuals, table),
        axis=replace(fit, used=True, along=int((along > 0.5).sum())),
    )


def fit_axis(legs: Legs, axis: WalkAxis, config: GraphConfig) -> AxisFit:
    """By how much the legs ask a walk to be turned, how sure that is, and whether the axis explains them."""
    prior_rad = math.hypot(config.sigma_mount_rad, axis.sigma_rad)
    likelihood = legs.likelihood(axis.yaw_rad)
    prior = _normal(OFFSETS_RAD, max(prior_rad, _GRID_RAD)) * _GRID_RAD
    evidence = float((prior * likelihood).sum())
    posterior = prior * likelihood / evidence
    mean = float(posterior @ OFFSETS_RAD)
    variance = float(posterior @ (OFFSETS_RAD - mean) ** 2)
    share = WALK_RAD**2 / (WALK_RAD**2 + axis.sigma_rad**2)  # of what the legs ask the axis itself may be to blame
    return AxisFit(
        turned_rad=share * mean,
        sigma_rad=math.sqrt(share**2 * variance + share * axis.sigma_rad**2),
        log_odds=math.log(evidence / float(likelihood.mean())),
        legs=len(legs.yaw_rad),
    )


def _along(legs: Legs, axis: WalkAxis, turn_rad: float) -> FloatArray:
    """(N,) how likely each leg lies along a corridor, once the walk is turned."""
    off_rad = fold(legs.off_rad(axis.yaw_rad) + turn_rad)
    return _ALONG * _normal(off_rad, _ASKEW_RAD) / _density(off_rad)


def _useless(legs: Legs, track: StepTrack, aids: Aids) -> str:
    """Why an axis tells nothing of a walk; empty if it may."""
    if aids.direction_known:
        return "the anchors tell the walk's direction"
    if not np.isfinite(track.yaw_mag_rad).any():
        return "without a compass nobody knows which of its right angles the walk followed"
    if not len(legs.yaw_rad):
        return f"too little of the walk is straight for {_MIN_LEG_M:.0f} m or more"
    return ""


def _note(why: str) -> str:
    return f"the building's axis was not used: {why}"


def _refused(smoothed: Smoothed, legs: Legs, axis: WalkAxis, fit: AxisFit) -> Smoothed:
    """The walk as it was, and why: its legs run another way, or tell too little."""
    asked_rad = float(OFFSETS_RAD[int(legs.likelihood(axis.yaw_rad).argmax())])
    count, degrees = len(legs.yaw_rad), abs(math.degrees(asked_rad))
    whose = f"the walk's {count} straight legs" if count > 1 else "the walk's only straight leg"
    if degrees < _CLEARLY_DEG:
        why = f"{whose} tell{'' if count > 1 else 's'} too little"
    else:
        lie, side = "lie" if count > 1 else "lies", "right" if asked_rad > 0 else "left"
        why = f"{whose} {lie} {degrees:.0f}° to the {side} of it, more than compass and axis are off"
    refused = replace(smoothed, axis=replace(fit, turned_rad=0.0, why=why))
    if fit.log_odds > _CONTRADICTED or degrees < _CLEARLY_DEG:
        return replace(refused, notes=(*smoothed.notes, _note(why)))
    advice = "check its heading and from which North it is counted, or leave it out"
    return replace(refused, doubts=(*smoothed.doubts, Reason("axis", 1.0 - fit.log_odds, _note(why), advice)))


def turned_walk(
    walk: Trajectory, turn_rad: float, pivot_m: FloatArray, sigma_mount_rad: float, sigma_rad: float | None
) -> Trajectory:
    """A walk turned about a place, with its covariance.

    Args:
        walk: to be turned.
        turn_rad: anticlockwise.
        pivot_m: (2,) what stays where it is.
        sigma_mount_rad: of the turn as the covariance has it, about the pivot; what the turn's own replaces.
        sigma_rad: how well the turn is known; None to leave the covariance as wide as it was.
    """
    laid = walk.turned(turn_rad, pivot_m)
    if laid.cov_xy_yaw is None or sigma_rad is None:
        return laid
    x_m, y_m = (laid.xy_m - pivot_m).T
    swung = np.column_stack((-y_m, x_m, np.ones(len(laid))))
    more = (sigma_rad**2 - sigma_mount_rad**2) * swung[:, :, None] * swung[:, None, :]
    return replace(laid, cov_xy_yaw=laid.cov_xy_yaw + more)
