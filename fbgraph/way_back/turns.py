"""Turns of a walk: where its direction changes for good."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.core.trajectory import Trajectory

MIN_TURN_RAD = math.radians(30.0)
_SHORTEST_STEPS = 3  # fewer steps in a direction of their own are part of a turn
_LONGEST_STEPS = 1000  # pieces that end so long ago are not looked at again: the cost would grow with the square
_TURN_STEPS = 2  # steps on either side of a turn that may still be turning
_ARC_PACES = 3.5  # two turns the same way about a shorter leg are one
_ARC_RAD = math.radians(150.0)  # if they make more than this, they are one only about a leg that is
_U_TURN_PACES = 2.5  # shorter than this: the landing of a staircase has room for two
_STUMBLE_PACES = 1.5  # a shorter leg aside is no leg
_MIN_SIGMA_RAD = math.radians(3.0)  # nobody walks straighter
_PENALTY = 3.0


@dataclass(frozen=True)
class Turn:
    """A turn at a breadcrumb: ``angle_rad`` is positive to the left."""

    breadcrumb: int
    t_s: float
    angle_rad: float


def find_turns(trajectory: Trajectory, min_turn_rad: float = MIN_TURN_RAD) -> list[Turn]:
    """Where the direction walked changes for good by at least ``min_turn_rad``.

    The yaw of the steps is cut into pieces of constant direction by penalised least squares; a piece must pay for
    itself in units of the variance of the yaw from step to step, so an unsteady walk needs more evidence. Then the
    weakest change goes first until every one that is left is a turn, and two turns hardly apart become one. A gradual
    curve becomes several turns.
    """
    yaw = trajectory.yaw_rad[1:]  # the standing start has no direction of its own
    count = len(yaw)
    if count < 2 * _SHORTEST_STEPS:
        return []
    walked = trajectory.distance_m
    walked = walked / max(float(np.median(np.diff(walked))), 1e-6)
    # robust: most steps do not turn
    sigma = max(float(np.median(np.abs(np.diff(yaw)))) / (0.6745 * math.sqrt(2.0)), _MIN_SIGMA_RAD)
    edges = [0, *_change_points(yaw, _PENALTY * sigma**2 * math.log(count)), count]
    for at in range(1, len(edges) - 1):
        _place(edges, at, trajectory)
    while len(edges) > 2:
        turn = wrap_angle(np.diff(leg_yaws(trajectory, edges)))
        paces, total = np.diff(walked[edges])[1:-1], np.abs(turn[:-1] + turn[1:])
        longest = np.where(total < _ARC_RAD, _ARC_PACES, _U_TURN_PACES)
        short = np.flatnonzero(paces < np.where(turn[:-1] * turn[1:] > 0, longest, _STUMBLE_PACES))
        gone = int(np.argmin(np.abs(turn))) + 1
        if abs(turn[gone - 1]) >= min_turn_rad:
            if not len(short):
                return [
                    Turn(k, float(trajectory.t_s[k]), float(angle)) for k, angle in zip(edges[1:-1], turn, strict=True)
                ]
            gone = int(short[0]) + (1 if abs(turn[short[0]]) < abs(turn[short[0] + 1]) else 2)
        del edges[gone]
        for at in (gone - 1, gone):
            if 0 < at < len(edges) - 1:
                _place(edges, at, trajectory)
    return []


def leg_yaws(trajectory: Trajectory, edges: Sequence[int]) -> FloatArray:
    """Directions between successive ``edges`` (breadcrumbs): from place to place, without the steps that turn."""
    lo, hi = np.array(edges[:-1]), np.array(edges[1:])
    trim = np.minimum(_TURN_STEPS, (hi - lo - 1) // 2)
    lo, hi = lo + np.where(lo == edges[0], 0, trim), hi - np.where(hi == edges[-1], 0, trim)
    way_m = trajectory.xy_m[hi] - trajectory.xy_m[lo]
    return np.asarray(np.arctan2(way_m[:, 1], way_m[:, 0]))


def _change_points(values: FloatArray, penalty: float) -> list[int]:
    """Cuts of the piecewise constant fit that minimises squares + penalty a piece (PELT: Killick et al. 2012)."""
    count = len(values)
    total = np.concatenate(([0.0], np.cumsum(values)))
    square = np.concatenate(([0.0], np.cumsum(values**2)))
    best, last = np.full(count + 1, np.inf), np.zeros(count + 1, dtype=int)
    best[0] = -penalty
    starts = np.zeros(1, dtype=int)
    for end in range(_SHORTEST_STEPS, count + 1):
        misfit = square[end] - square[starts] - (total[end] - total[starts]) ** 2 / (end - starts)
        cost = best[starts] + misfit
        at = int(np.argmin(cost))
        best[end], last[end] = cost[at] + penalty, starts[at]
        starts = np.append(starts[cost <= best[end]][-_LONGEST_STEPS:], end - _SHORTEST_STEPS + 1)
    cuts = []
    cut = int(last[count])
    while cut > 0:
        cuts.append(cut)
        cut = int(last[cut])
    return cuts[::-1]


def _place(edges: list[int], at: int, trajectory: Trajectory) -> None:
    """Move an edge to where the direction of the leg before it best gives way to that of the leg after it."""
    lo, hi = edges[at - 1], edges[at + 1]
    before, after = leg_yaws(trajectory, edges)[at - 1 : at + 1]
    steps = trajectory.yaw_rad[lo + 1 : hi + 1]
    gain = np.abs(wrap_angle(steps - before)) - np.abs(wrap_angle(steps - after))
    edges[at] = lo + 1 + int(np.argmin(np.cumsum(gain)[:-1]))
