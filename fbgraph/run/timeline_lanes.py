"""Lanes: what the wearer, the compass and the way back did when, as changes of state over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fbgraph.core.checkpoints import anchor_breadcrumbs
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.estimators.magnetic_field import FieldMemory
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.records import ReturnUpdate

Lane = list[tuple[float, str | None]]
"""Changes of state in order of time: since when (seconds), what; None is nothing to tell."""


STANDING, WALKING, MOVING = "standing still", "walking", "moving, no steps"


TRUSTED, DOUBTED = "consistent", "doubted"


ON_ROUTE, OFF_ROUTE, ARRIVED = "way back", "off route", "arrived"


DOUBTED_BELOW = 0.5  # of the usual pull; a compass that is left less is doubted


_SHORT_STEPS = 2  # a stretch of fewer is not worth telling


_BRIDGED_STEPS = 3  # and a break of fewer does not end one


_SHOWN_S = 1.0  # how long a moment is shown


_BLINK_S = 1.0  # a shorter stretch of neither standing nor walking is neither's end


def wearer_lane(signals: LevelledSignals, track: StepTrack, still_window_s: float) -> Lane:
    """What the wearer did: ``STANDING``, ``WALKING``, ``MOVING`` (by hand or foot, but no steps were found).

    Args:
        signals: for how long to tell.
        track: the steps.
        still_window_s: how long before it is known standing still begins.
    """
    t_s = signals.t_s
    if len(t_s) == 0:
        return []

    def covered(start_s: FloatArray, end_s: FloatArray) -> BoolArray:
        """Which samples lie in any of these stretches."""
        edges = np.zeros(len(t_s) + 1, dtype=np.int64)
        np.add.at(edges, np.searchsorted(t_s, start_s), 1)
        np.add.at(edges, np.searchsorted(t_s, end_s), -1)
        return np.asarray(np.cumsum(edges)[:-1] > 0)

    rate_hz = 1.0 / np.median(np.diff(t_s)) if len(t_s) > 1 else 1.0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], signals.still, [False])).astype(int)))
    # stillness is known at the end of its window
    still = covered(t_s[edges[::2]] - still_window_s, t_s[edges[1::2] - 1] + 1.0 / rate_hz)
    walking = covered(track.start_s[1:], track.t_s[1:])
    state = np.where(walking, 2, np.where(still, 1, 0))
    names = (MOVING, STANDING, WALKING)
    lane: Lane = []
    at = np.flatnonzero(np.diff(state, prepend=-1))
    for i, end in zip(at, [*at[1:], len(t_s)], strict=True):
        blink = lane and state[i] == 0 and end - i < _BLINK_S * rate_hz
        if not blink and (not lane or lane[-1][1] != names[state[i]]):
            lane.append((float(t_s[i]), names[state[i]]))
    return lane


def compass_inflation(result: WalkResult) -> FloatArray:
    """(K+1,) by what the field's deviation multiplied the compass variance at each step; nan without a compass."""
    graph = result.config.graph
    memory = FieldMemory(graph.norm_scale_ut, graph.dip_scale_rad)
    steps = result.track.steps
    return np.array([memory.inflation(step) if np.isfinite(step.yaw_mag_rad) else np.nan for step in steps])


def compass_trust(result: WalkResult) -> FloatArray:
    """(K+1,) share of its usual pull that the smoother left the compass at each step; nan without a compass.

    The field's deviation from its recent usual divides it (``compass_inflation``), the robust loss multiplies it.
    """
    weight = np.ones(len(result.track))
    for residuals in result.smoothed.residuals:
        if residuals.name == "compass":
            weight[residuals.k] = residuals.weight
    return np.asarray(weight / compass_inflation(result))


def stretches(flags: BoolArray) -> list[tuple[int, int]]:
    """First and last index of runs of true flags; short breaks are bridged, single flags dropped."""
    at = np.flatnonzero(flags)
    if len(at) == 0:
        return []
    runs = np.split(at, np.flatnonzero(np.diff(at) > _BRIDGED_STEPS) + 1)
    return [(int(run[0]), int(run[-1])) for run in runs if len(run) >= _SHORT_STEPS]


def compass_lane(result: WalkResult) -> Lane:
    """Where the smoother believed the compass, and where it left it less than half its pull."""
    trust = compass_trust(result)
    known = np.flatnonzero(np.isfinite(trust))
    if len(known) == 0:
        return []
    t_s = result.track.t_s
    lane: Lane = [(float(result.track.start_s[known[0]]), TRUSTED)]
    for first, last in stretches(trust < DOUBTED_BELOW):
        lane += [(float(result.track.start_s[first]), DOUBTED), (float(t_s[last]), TRUSTED)]
    return [*lane, (float(t_s[known[-1]]), None)]


def places_lane(result: WalkResult) -> Lane:
    """When the walk was told where it was: at anchors, where it met itself, and at its end if that is its start."""
    track, lane = result.track, []
    told = [("closed walk", len(track) - 1)] if result.told.closed_walk else []
    told += [("closure", closure.j) for closure in result.smoothed.closures]
    if (anchors := result.aids.anchors) is not None:
        told += [("anchor", k) for k in anchor_breadcrumbs(anchors, track.t_s).tolist()]
    for name, k in sorted(told, key=lambda one: one[1]):
        lane += [(float(track.start_s[k]), name), (float(track.t_s[k]) + _SHOWN_S, None)]
    return lane


def returning_lane(updates: Sequence[ReturnUpdate]) -> Lane:
    """On the way back: ``ON_ROUTE``, ``OFF_ROUTE``, ``ARRIVED``."""
    lane: Lane = []
    for update in updates:
        state = OFF_ROUTE if update.off_route else ON_ROUTE
        if update.arrived or (lane and lane[-1][1] == ARRIVED):
            state = ARRIVED
        if not lane or lane[-1][1] != state:
            lane.append((update.t_s, state))
    return lane
