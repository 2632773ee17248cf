"""When somebody turns back: the walk retraces itself, the other way round."""

from __future__ import annotations

import math

import numpy as np

from fbgraph.core.config import ReturnConfig, StepLengthConfig
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.core.trajectory import Trajectory
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.records import Crumb, TurnBack
from fbgraph.way_back.way_out import level_length_m

_GRID_M = 0.5
_SLACK_M = 3.0  # steps lost, or made on the spot, while turning
_FLOOR_M = 1.2  # a landing of a staircase turns back too, but the flights are not at one height
_REVERSED_RAD = math.radians(50.0)
_REVERSED_SHARE = 0.85
_YAW_M = 1.5  # a radian counts like so many metres
_LATELY_M, _LATELY_RAD = 2.5, math.radians(30.0)
_LATE_M, _LATE_LEAST_M = 15.0, 1.2


class TurnBackDetector:
    """Breadcrumbs in; tells that the last ``retraced_m`` of the walk lie on what was walked just before.

    Shorter returns are left alone: who looks into a dead end and goes on is not on the way back.
    """

    def __init__(self, retraced_m: float, apart_m: float) -> None:
        """A detector.

        Args:
            retraced_m: how much must have been walked back before it is believed.
            apart_m: how far from the way out the way back may be, on average.
        """
        self._retraced_m = retraced_m
        self._apart_m = apart_m
        self._crumbs: list[Crumb] = []

    def advance(self, crumb: Crumb) -> TurnBack | None:
        """Take the next breadcrumb, from the very first on; the turn-back if it is now known."""
        crumbs, need_m = self._crumbs, self._retraced_m
        crumbs.append(crumb)
        turned = self._index(crumb.walked_m - need_m)
        if turned < 1 or crumbs[turned].walked_m < need_m:
            return None
        mirrored = (self._index(crumbs[turned].walked_m - need_m - slack_m) for slack_m in (-_SLACK_M, 0.0, _SLACK_M))
        if all(math.cos(crumb.yaw_rad - crumbs[max(k, 0)].yaw_rad) > 0.0 for k in mirrored):
            return None  # the common case, cheaply
        first = max(self._index(crumbs[turned].walked_m - need_m - _SLACK_M), 0)
        recent = np.array([(c.t_s, c.x_m, c.y_m, c.z_m, c.yaw_rad, c.walked_m) for c in crumbs[first:]])
        walked = recent[:, 5]
        best = (self._apart_m, -1)
        for k in range(int(np.searchsorted(walked, walked[-1] - need_m - 1.0)), len(walked)):
            if walked[-1] - walked[k] < need_m:
                break
            best = min(best, (_apart_m(recent[:, 1:], k, need_m, 0.7), k))
        if best[1] < 0:
            return None
        return TurnBack(first + best[1], float(recent[best[1], 0]), crumb.t_s)

    def _index(self, walked_m: float) -> int:
        """Last breadcrumb at or before a distance walked; -1 if none."""
        k = len(self._crumbs) - 1
        while k >= 0 and self._crumbs[k].walked_m > walked_m:
            k -= 1
        return k


def find_turn_back(
    trajectory: Trajectory, track: StepTrack, length: StepLengthConfig, config: ReturnConfig
) -> TurnBack | None:
    """The first turn-back of a whole walk.

    Args:
        trajectory: an estimate of the walk.
        track: its steps.
        length: as the steps were measured.
        config: how much of the way must have been walked back, and how near to the way out.
    """
    detector = TurnBackDetector(config.retraced_m, config.apart_m)
    walked = np.cumsum([level_length_m(step, length) for step in track.steps])
    columns = (track.t_s, trajectory.x_m, trajectory.y_m, trajectory.z_m, trajectory.yaw_rad, walked)
    for row in np.column_stack(columns).tolist():
        found = detector.advance(Crumb(*row))
        if found is not None:
            return found
    return None


def reversal(xyz_m: FloatArray, yaw_rad: FloatArray, walked_m: FloatArray, apart_m: float) -> int:
    """Where the way out ends, for one who says "back" a little late: the breadcrumb after which all lead back.

    Args:
        xyz_m: (K + 1, 3) all breadcrumbs so far.
        yaw_rad, walked_m: (K + 1,) their direction and the distance walked as if on the level.
        apart_m: as in ``TurnBackDetector``.

    Returns:
        Its index; the last one's if the walk was not reversed in its last 15 m.
    """
    last = len(yaw_rad) - 1
    table = np.column_stack((xyz_m, yaw_rad, walked_m))
    best = (apart_m, last)
    for k in range(int(np.searchsorted(walked_m, walked_m[last] - _LATE_M)), last):
        back_m = float(walked_m[last] - walked_m[k])
        if back_m >= _LATE_LEAST_M:
            best = min(best, (_apart_m(table, k, back_m, 0.5), k))
    return best[1]


def _apart_m(table: FloatArray, turned: int, back_m: float, reach: float) -> float:
    """Mean distance of the way after a breadcrumb from the way before it; infinite if it does not lead back.

    Args:
        table: (N, 5) x, y, z, yaw, distance walked.
        turned: the breadcrumb.
        back_m: how far after it to look.
        reach: share of it by which the way before must have been retraced.
    """
    walked = table[:, 4]
    after = walked[turned] + np.arange(min(_GRID_M, back_m), back_m + 1e-9, _GRID_M)
    before = walked[turned] - np.arange(0.0, min(back_m + _SLACK_M, walked[turned] - walked[0]) + 1e-9, _GRID_M)
    back, there = (np.array([np.interp(at, walked, c) for c in table[:, :4].T]) for at in (after, before))
    off = np.abs(wrap_angle(back[3][:, None] - there[3] - np.pi))
    apart = np.hypot(back[0][:, None] - there[0], back[1][:, None] - there[1])
    apart[np.abs((after - walked[turned])[:, None] - (walked[turned] - before)) > _SLACK_M] = np.inf
    nearest = np.hypot(apart, _YAW_M * off).argmin(axis=1)
    each = np.arange(len(nearest))
    apart_m, off, climbed = apart[each, nearest], off[each, nearest], np.abs(back[2] - there[2][nearest])
    late = slice(-round(_LATELY_M / _GRID_M), None)
    leads_back = (
        walked[turned] - before[nearest[-1]] >= reach * back_m
        and (off < _REVERSED_RAD).mean() >= _REVERSED_SHARE
        and off[late].mean() < _LATELY_RAD
        and climbed[late].mean() < _FLOOR_M
    )
    # at its end above all: who leaves the way out has not turned back
    return float(max(apart_m.mean(), apart_m[late].mean() / 1.5)) if leads_back else math.inf
