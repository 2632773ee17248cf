"""Aids before they are believed, and the walk after they were: in the frame of its anchors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import F, X

from fbgraph.core.aids import Aids, AnchorFrame
from fbgraph.core.checkpoints import Checkpoints, anchor_breadcrumbs
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, IntArray, plane_turns, turned
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Reason
from fbgraph.estimators.aid_factors import anchor_sigma_m, anchors_centre
from fbgraph.estimators.anchor_frame import FrameFit, WalkAtAnchors
from fbgraph.estimators.estimates import Residuals
from fbgraph.front_end.step_track import StepTrack

_BETTER = 15.0  # squared standard deviations by which another kind of frame must explain the anchors better
_MUCH = 20.0  # that anchors cost which agree one by one, but perhaps not all together
_OTHER_OFF = 0.25  # of the anchors may contradict it nevertheless
_UNIT_LEAST = 0.25  # nobody's steps are mis-scaled by more
_UNITS = {"millimetres": 1000.0, "centimetres": 100.0, "feet": 3.2808, "kilometres": 0.001, "miles": 1 / 1609.3}
_UNIT_REL = 0.15
_UNIT_FROM = 6
_TURNED_LEAST_RAD = math.radians(10.0)  # compasses indoors are wrong by less
_TURNED_SIGMA_RAD = 0.1
_SIDE_RAD = math.radians(25.0)
_CLOSED_ODDS = 100.0  # that who says so has walked back to the start
_USUAL_SIGMA_M = 0.5
_NUDGE = 1e-6
_ANY_MIRROR = "one axis mirrored"
_LATE_S, _LATE_LEAST = tuple(float(late_s) for late_s in range(-8, 9)), 4
# squared standard deviations, with which a walk at anchors is generous: from here on a clock may be late, and is
_LATE_PERHAPS, _LATE_BETTER = 1.5, 10.0
_MOST_NAMED = 4


@dataclass(frozen=True)
class CheckedAids:
    """Aids as far as they may be believed.

    Attributes:
        aids: the sigma of anchors that contradict the walk is as wide as the contradiction; no closed end that is none.
        doubts: what contradicts the sensors, and what to do.
        notes: what else is worth telling.
    """

    aids: Aids
    doubts: tuple[Reason, ...] = ()
    notes: tuple[str, ...] = ()


def check_aids(aids: Aids, track: StepTrack, alone: Trajectory, config: GraphConfig) -> CheckedAids:
    """Compare aids with the walk that knows nothing of them.

    Args:
        aids: as told.
        track: the steps.
        alone: smoothed without aids, with covariance.
        config: weights.
    """
    doubts: list[Reason] = []
    notes: list[str] = []
    if aids.closed_walk and (reason := _not_closed(alone, config)) is not None:
        doubts.append(reason)
        aids = replace(aids, closed_walk=False)
    if aids.direction_known and aids.anchors is not None:
        anchors, frame, found, note = _anchors_checked(aids.anchors, track, alone, config)
        aids = replace(aids, anchors=anchors, frame=frame)
        doubts += found
        notes += note
    return CheckedAids(aids, tuple(doubts), tuple(notes))


def _not_closed(alone: Trajectory, config: GraphConfig) -> Reason | None:
    """Why a walk said to be closed is not; None if it may be.

    The end is either at the start, give or take what the sensors may be off, or anywhere within half the distance
    walked; the first is what the user said.
    """
    off = alone.xy_m[-1] - alone.xy_m[0]
    cov = np.eye(2) * config.sigma_closure_m**2
    if alone.cov_xy_yaw is not None:
        cov = cov + alone.cov_xy_yaw[-1, :2, :2]
    squared = float(off @ np.linalg.solve(cov, off))
    anywhere_m2 = math.pi * max(0.5 * float(alone.distance_m[-1]), 1.0) ** 2
    spread_m2 = 2.0 * math.pi * math.sqrt(float(np.linalg.det(cov)))
    limit = 2.0 * (math.log(_CLOSED_ODDS) + max(math.log(anywhere_m2 / spread_m2), 0.0))
    if squared <= limit:
        return None
    text = (
        f"closed walk: the sensors put the end {math.hypot(*off):.0f} m away from the start "
        f"({math.sqrt(squared):.0f} sigma): doubted, the walk was not bent to close"
    )
    return Reason(
        "closed_walk", math.sqrt(squared / limit), text, "leave --closed-loop out if the walk ended elsewhere"
    )


def _anchors_checked(
    anchors: Checkpoints, track: StepTrack, alone: Trajectory, config: GraphConfig
) -> tuple[Checkpoints, AnchorFrame | None, list[Reason], list[str]]:
    """Anchors with the sigma they deserve, where their frame lies, what contradicts, and what is worth telling."""
    crumbs = anchor_breadcrumbs(anchors, track.t_s)
    sigma_m = np.array([anchor_sigma_m(anchors, i, track.steps[k], config) for i, k in enumerate(crumbs.tolist())])
    compass = bool(np.isfinite(track.yaw_mag_rad).any())
    walk = WalkAtAnchors(alone, crumbs, anchors.xy_m, sigma_m)
    fit = walk.fit(compass)
    if fit is None:
        return anchors, None, [], ["the anchors are too near to one another to tell how their frame is turned"]
    agreed = fit.agree.all()
    other = ""
    if not anchors.gnss and (not agreed or fit.cost > _MUCH):  # a receiver counts metres East and North
        other = _other_frame(walk, anchors, fit, crumbs, alone, sigma_m, compass)
    if agreed and not other:
        late_s, gain = _late(walk, fit)
        if gain > _LATE_BETTER:
            on_time = replace(anchors, t_s=anchors.t_s - late_s)
            crumbs = anchor_breadcrumbs(on_time, track.t_s)
            fit = WalkAtAnchors(alone, crumbs, anchors.xy_m, sigma_m).fit(compass) or fit
            frame = frame_of(fit, anchors.xy_m, free=True)
            return on_time, frame, [_late_reason(anchors, late_s)], _turned_note(fit, compass, anchors.gnss)
        doubts, notes = _turned_or_mirrored(walk, anchors, fit, compass)
        frame = frame_of(fit, anchors.xy_m, free=True)
        return anchors, replace(frame, sigma_late_s=math.hypot(frame.sigma_late_s, late_s)), doubts, notes
    if other or fit.agree.sum() < 2 or not fit.clear:
        # the frame itself is wrong: the walk is not bent at all, and lies among the anchors as well as it can
        fit = _laid(walk, compass)
        sigma_m = np.full(len(anchors), math.sqrt(len(anchors)) * max(float(np.sqrt((fit.off_m**2).mean())), 1.0))
        frame = frame_of(fit, anchors.xy_m, free=False)
    else:
        sigma_m = np.where(fit.agree, anchors.sigma_m, np.maximum(fit.off_m, sigma_m))
        frame = frame_of(fit, anchors.xy_m, free=True)
    doubted = replace(anchors, sigma_m=np.asarray(sigma_m))
    notes = [] if other else _turned_note(fit, compass, anchors.gnss)
    return doubted, frame, [_contradiction(anchors, fit, other)], notes


def _late(walk: WalkAtAnchors, fit: FrameFit) -> tuple[float, float]:
    """By how much all anchors seem to have been told too late, in whole seconds, and what that explains better."""
    if fit.agree.sum() < _LATE_LEAST:
        return 0.0, 0.0
    costs = {late_s: walk.cost_if_late(fit, late_s) for late_s in _LATE_S}
    best = min(costs, key=lambda late_s: costs[late_s])
    gain = costs[0.0] - costs[best]
    inside = abs(best) < max(_LATE_S)  # else something else is wrong
    return (best, gain) if inside and gain > _LATE_PERHAPS else (0.0, 0.0)


def _late_reason(anchors: Checkpoints, late_s: float) -> Reason:
    """What to say of anchors whose clock is not the log's."""
    way = "late" if late_s > 0 else "early"
    text = (
        f"the anchors disagree with the sensors about time: they fit if all of them are {abs(late_s):.0f} s too {way}"
    )
    advice = "check their clock; they are taken so"
    return Reason("anchors", 1.5, text, advice, float(anchors.t_s[0]), float(anchors.t_s[-1]))


def _turned_or_mirrored(
    walk: WalkAtAnchors, anchors: Checkpoints, fit: FrameFit, compass: bool
) -> tuple[list[Reason], list[str]]:
    """What to say of a frame that is turned, and of one that may be mirrored as well."""
    notes = _turned_note(fit, compass, anchors.gnss)
    if not notes or anchors.gnss:
        return [], notes
    other = walk.fit(compass, mirrored=True)
    words = "" if other is None or not other.agree.all() else _mirrored_words(other.turn_rad, compass)
    if other is None or not words or other.cost > fit.cost + _BETTER:
        return [], notes
    if words == _ANY_MIRROR:
        return [], [f"{notes[0]}; its axes may be mirrored instead, which these anchors do not tell"]
    text = (
        f"the anchors contradict the compass: either their frame is turned by {math.degrees(abs(fit.turn_rad)):.0f}°, "
        f"which is taken so, or it has {words}"
    )
    advice = "check the file's columns, or name an anchor more, beside the line through the others"
    return [Reason("anchors", 1.5, text, advice, float(anchors.t_s[0]), float(anchors.t_s[-1]))], notes


def frame_of(fit: FrameFit, anchors_m: FloatArray, free: bool) -> AnchorFrame:
    """Where the anchors' frame lies in the walk's."""
    centre = anchors_m.mean(axis=0)
    x_m, y_m = turned(centre - fit.shift_m, -fit.turn_rad).tolist()
    return AnchorFrame(x_m, y_m, -fit.turn_rad, (float(centre[0]), float(centre[1])), free)


def _laid(walk: WalkAtAnchors, compass: bool) -> FrameFit:
    """The walk laid among all anchors by their centre, turned only if it does not know North."""
    here, there = walk.here_m, walk.there_m
    turn = 0.0
    if not compass:
        dot, cross = (here * there).sum(), (here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0]).sum()
        turn = math.atan2(cross, dot)
    return walk.laid(turn)


def _turned_note(fit: FrameFit, compass: bool, gnss: bool) -> list[str]:
    """A sentence on a frame that is not the compass's; a receiver's is that of true North."""
    least = max(_TURNED_LEAST_RAD, 2.0 * math.hypot(_TURNED_SIGMA_RAD, fit.sigma_turn_rad))
    if not compass or abs(fit.turn_rad) < least:
        return []
    # the walk turned anticlockwise to lie in the frame: the frame's y axis lies clockwise of North
    way = "East" if fit.turn_rad > 0 else "West"
    degrees = math.degrees(abs(fit.turn_rad))
    if gnss:
        return [
            f"by GNSS the walk is turned by {degrees:.0f} ± {math.degrees(2.0 * fit.sigma_turn_rad):.0f}° (2σ) to the "
            f"{'left' if fit.turn_rad > 0 else 'right'} of where the compass puts it: how the device was held, or iron"
        ]
    return [
        f"the anchors' frame is turned by {degrees:.0f} ± {math.degrees(2.0 * fit.sigma_turn_rad):.0f}° (2σ) against "
        f"magnetic North, its y axis to the {way}: the result is in the anchors' frame"
    ]


def _other_frame(
    walk: WalkAtAnchors,
    anchors: Checkpoints,
    told: FrameFit,
    crumbs: IntArray,
    alone: Trajectory,
    sigma_m: FloatArray,
    compass: bool,
) -> str:
    """What the anchors would be if they were right, empty if nothing explains them better than being wrong."""
    count = len(anchors)
    kinds: list[tuple[FrameFit | None, str]] = []
    if count > 2:
        kinds.append((walk.fit(compass, mirrored=True), ""))
    kinds.append((walk.fit(compass, scaled=True), ""))
    if count > 2:
        kinds.append((walk.fit(compass, mirrored=True, scaled=True), ""))
    if (exchanged := anchors.exchanged()) is not None:
        on_earth = WalkAtAnchors(alone, crumbs, exchanged.xy_m, sigma_m)
        kinds.append((on_earth.fit(compass), "latitude and longitude exchanged"))
    best, words = told.cost - _BETTER, ""
    for fit, name in kinds:
        if fit is None or (~fit.agree).sum() > _OTHER_OFF * count or fit.agree.sum() < told.agree.sum():
            continue
        off = fit.cost - 25.0 * float((~fit.agree).sum())
        if fit.cost < best and off < max(2.0 * count, 4.0) + 9.0 and (text := name or _kind_of(fit, compass)):
            best, words = fit.cost, text
    return words


def _kind_of(fit: FrameFit, compass: bool) -> str:
    """In words how anchors differ from metres East and North; empty if they do not."""
    words = []
    if fit.mirrored:
        words.append(_mirrored_words(fit.turn_rad, compass))
    if abs(math.log(fit.scale)) > _UNIT_LEAST:
        near = [name for name, unit in _UNITS.items() if abs(math.log(fit.scale / unit)) < _UNIT_REL]
        if not near and len(fit.agree) < _UNIT_FROM:
            return ""  # so few are explained by many units
        words.append(f"{near[0]} instead of metres" if near else f"a unit of {1.0 / fit.scale:.3g} m instead of metres")
    return " and ".join(words)


def _mirrored_words(turn_rad: float, compass: bool) -> str:
    """Which mirror image it is; only the compass tells."""
    sides = {0.0: "x and y exchanged", 0.5: "x counted to the West", -0.5: "y counted to the South"}
    sides |= {1.0: "x and y exchanged and negated", -1.0: "x and y exchanged and negated"}
    for half_turns, words in sides.items():
        if compass and abs(turn_rad - math.pi * half_turns) < _SIDE_RAD:
            return words
    return _ANY_MIRROR


def _contradiction(anchors: Checkpoints, fit: FrameFit, other: str) -> Reason:
    """What to say of anchors that contradict the sensors."""
    off = ~fit.agree
    count, far_m = int(off.sum()), float(fit.off_m[off].max()) if off.any() else 0.0
    which = ", ".join(f"{t_s:.0f} s" for t_s in anchors.t_s[off][:_MOST_NAMED]) + (", …" if count > _MOST_NAMED else "")
    start_s, end_s = (float(t_s) for t_s in (anchors.t_s[off][0], anchors.t_s[off][-1]))
    text = f"{count} of {len(anchors)} anchors contradict the sensors by up to {far_m:.0f} m (at {which} of the log)"
    if other:
        advice = f"with {other} they would fit: check the file's columns and units; until then none of them is believed"
        return Reason("anchors", 3.0, text, advice, start_s, end_s)
    if count == len(anchors):
        advice = "which of them nobody can tell: check times, columns and units; none of them is believed"
        return Reason("anchors", 3.0, text, advice, start_s, end_s)
    return Reason("anchors", 2.0, f"{text}: doubted", "check their times and places", start_s, end_s)


def in_anchors_frame(
    trajectory: Trajectory, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, frame: AnchorFrame
) -> Trajectory:
    """A walk solved with a frame F, as seen from it: places, directions and their covariance.

    Args:
        trajectory: in the walk's frame, with covariance.
        graph, values: as solved.
        frame: whose centre the anchors were counted from.
    """
    pose = values.atPose2(F(0))
    cos, sin = math.cos(pose.theta()), math.sin(pose.theta())
    back = np.array([[cos, sin], [-sin, cos]])
    from_frame = trajectory.xy_m - (pose.x(), pose.y())
    xy_m = turned(from_frame, -pose.theta()) + frame.centre_m
    cov = trajectory.cov_xy_yaw
    if cov is not None:
        count = len(trajectory)
        own, cross = _with_frame(graph, values, count, trajectory.yaw_rad)
        # x' = R^T (x - t): moved by x, by t, and by the turn about t
        slope = np.zeros((count, 3, 3))
        slope[:, 0, 0] = slope[:, 1, 1] = slope[:, 2, 2] = -1.0
        slope[:, 0, 2], slope[:, 1, 2] = from_frame[:, 1], -from_frame[:, 0]
        mixed = cross @ slope.transpose(0, 2, 1)
        cov = cov + mixed + mixed.transpose(0, 2, 1) + slope @ own @ slope.transpose(0, 2, 1)
        whole = np.eye(3)
        whole[:2, :2] = back
        cov = whole @ cov @ whole.T
        for late_s in (-frame.sigma_late_s, frame.sigma_late_s):
            late_m = np.column_stack([np.interp(trajectory.t_s + late_s, trajectory.t_s, c) for c in xy_m.T]) - xy_m
            cov[:, :2, :2] += 0.5 * late_m[:, :, None] * late_m[:, None, :]
    return replace(
        trajectory, x_m=xy_m[:, 0], y_m=xy_m[:, 1], yaw_rad=trajectory.yaw_rad - pose.theta(), cov_xy_yaw=cov
    )


def solved_frame(values: gtsam.Values, aids: Aids) -> AnchorFrame | None:
    """Where the anchors' frame was found to lie; None without anchors."""
    if not values.exists(F(0)) or aids.anchors is None:
        return None
    pose = values.atPose2(F(0))
    told = aids.frame or AnchorFrame(0.0, 0.0, 0.0, anchors_centre(aids.anchors), free=False)
    return replace(told, x_m=pose.x(), y_m=pose.y(), turn_rad=pose.theta())


def in_walks_frame(trajectory: Trajectory, frame: AnchorFrame | None) -> Trajectory:
    """A walk in the anchors' frame, back in its own, without its covariance."""
    if frame is None:
        return trajectory
    xy_m = turned(trajectory.xy_m - frame.centre_m, frame.turn_rad) + np.array((frame.x_m, frame.y_m))
    yaw_rad = trajectory.yaw_rad + frame.turn_rad
    return replace(trajectory, x_m=xy_m[:, 0], y_m=xy_m[:, 1], yaw_rad=yaw_rad, cov_xy_yaw=None)


def told_residuals(residuals: Sequence[Residuals], told: Aids | None, used: Aids) -> tuple[Residuals, ...]:
    """Residuals of anchors against the sigma that they came with: what was widened counts as weight."""
    if told is None or told.anchors is None or used.anchors is None or told.anchors is used.anchors:
        return tuple(residuals)
    own_m = np.nan_to_num(told.anchors.sigma_m, nan=_USUAL_SIGMA_M)
    ratio = np.minimum(own_m / np.nan_to_num(used.anchors.sigma_m, nan=_USUAL_SIGMA_M), 1.0)
    return tuple(
        replace(kind, whitened=kind.whitened / ratio, weight=kind.weight * ratio**2) if kind.name == "anchor" else kind
        for kind in residuals
    )


def _with_frame(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, count: int, yaw_rad: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(3, 3) covariance of F and (N, 3, 3) of each breadcrumb with F, both as (x, y, yaw) of the walk's frame.

    A column of the inverse of the information is the answer to a push of one on one component: three solutions of the
    linear system, rather than a joint marginal for every breadcrumb.
    """
    linear = graph.linearize(values)
    still = linear.optimize()
    own, cross = np.zeros((3, 3)), np.zeros((count, 3, 3))
    for column in range(3):
        pushed = gtsam.GaussianFactorGraph()
        pushed.push_back(linear)
        row = np.zeros((1, 3))
        row[0, column] = _NUDGE
        pushed.add(F(0), row, np.array([1.0 / _NUDGE]), gtsam.noiseModel.Unit.Create(1))
        moved = pushed.optimize()
        own[:, column] = moved.at(F(0)) - still.at(F(0))
        cross[:, :, column] = [moved.at(X(k)) - still.at(X(k)) for k in range(count)]
    turn = plane_turns(np.append(yaw_rad, values.atPose2(F(0)).theta()))
    return np.asarray(turn[-1] @ own @ turn[-1].T), np.asarray(turn[:-1] @ cross @ turn[-1].T)
