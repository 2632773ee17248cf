"""Turns of a walk: where its direction changes for good."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from fbgraph.trajectory import Trajectory

_SIDE_STEPS = 3  # a turn is judged by the mean direction of this many steps before and after


@dataclass(frozen=True)
class Turn:
    """A turn at a breadcrumb: ``angle_rad`` is positive to the left."""

    breadcrumb: int
    t_s: float
    angle_rad: float


def find_turns(trajectory: Trajectory, min_turn_rad: float = np.radians(30.0)) -> list[Turn]:
    """Turns of at least ``min_turn_rad`` between the directions walked some steps before and after.

    Consecutive breadcrumbs whose change exceeds the threshold are one turn; a change of sign begins another.
    """
    yaw = trajectory.yaw_rad[1:]  # the standing start has no direction of its own
    side = _SIDE_STEPS
    if len(yaw) < 2 * side:
        return []
    mean = np.convolve(yaw, np.ones(side) / side, mode="valid")
    change = mean[side:] - mean[:-side]  # at the joint between step j + side - 1 and the next
    big = np.abs(change) >= min_turn_rad
    label = np.where(big, np.sign(change), 0.0)
    edges = np.flatnonzero(np.diff(np.concatenate(([0.0], label, [0.0]))))
    turns = []
    for lo, hi in itertools.pairwise(edges):
        if label[lo] == 0.0:
            continue
        at = int(lo + np.argmax(np.abs(change[lo:hi])))
        before, after = mean[max(int(lo) - 1, 0)], mean[min(int(hi) + side, len(mean) - 1)]
        turns.append(Turn(at + side, float(trajectory.t_s[at + side]), float(after - before)))
    return [turn for turn in turns if abs(turn.angle_rad) >= min_turn_rad]
