"""When somebody turns back: the walk retraces itself, the other way round."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from fbgraph.core.config import ReturnConfig, StepLengthConfig
from fbgraph.core.geometry import FloatArray, wrap_angle, wrap_scalar
from fbgraph.core.trajectory import Trajectory
from fbgraph.front_end.step_track import Step, StepTrack
from fbgraph.way_back.records import Crumb, TurnBack
from fbgraph.way_back.retracing import GRID_M, Retracing, Row, between
from fbgraph.way_back.way_out import field_of, level_length_m

_FITS = 4.0  # an alignment worth weighing
_REACH = 0.8  # share of it that the way out must have been retraced by: steps differ, and some are made on the spot
_BEYOND_DOUBT = 1.75  # log odds: six to one
_BEYOND_DOUBT_TO_TIE = 2.5  # twelve to one: what is tied together changes the walk, and nobody is there to object
_LATE_REACH = 0.5  # share of the way by which the way before must have been retraced
_SLACK_M = 3.0  # steps lost, or made on the spot, while turning
_FLOOR_M = 1.2  # a landing of a staircase turns back too, but the flights are not at one height
_REVERSED_RAD = math.radians(50.0)
_REVERSED_SHARE = 0.85
_YAW_M = 1.5  # a radian counts like so many metres
_LATELY_M, _LATELY_RAD = 2.5, math.radians(30.0)
_LATE_M, _LATE_LEAST_M = 15.0, 1.2


class TurnBackDetector:
    """Breadcrumbs in; tells that the walk leads back over its own way, once that is beyond doubt.

    Shorter returns are left alone: who looks into a dead end and goes on is not on the way back. When it is told,
    ``retraced_m`` have been walked back, or more where place, direction and magnetic field left it open
    (``retracing``): beside the way out a walk may be on the other side of a corridor, or on another lane.
    """

    def __init__(self, retraced_m: float, log_odds: float = _BEYOND_DOUBT) -> None:
        """A detector.

        Args:
            retraced_m: how much must have been walked back before it is believed.
            log_odds: what is beyond doubt: of the way back against walking on.
        """
        self._retraced_m = retraced_m
        self._log_odds = log_odds
        self._retracing = Retracing()
        self._last: tuple[float, Row] | None = None
        self._rows = 0
        self._t_s: list[float] = []
        self._walked_m: list[float] = []

    def advance(self, crumb: Crumb) -> TurnBack | None:
        """Take the next breadcrumb, from the very first on; the turn-back if it is now known."""
        self._t_s.append(crumb.t_s)
        self._walked_m.append(crumb.walked_m)
        row = Row(crumb.x_m, crumb.y_m, crumb.z_m, crumb.yaw_rad, crumb.down_ut, crumb.level_ut, crumb.across_ut)
        before_m, before = self._last or (crumb.walked_m, row)
        self._last = (crumb.walked_m, row)
        found = None
        while found is None and self._rows * GRID_M <= crumb.walked_m:
            share = (self._rows * GRID_M - before_m) / max(crumb.walked_m - before_m, 1e-9)
            score = self._retracing.advance(between(before, row, share))
            self._rows += 1
            if score > _FITS:
                found = self._judged()
        return found

    def _judged(self) -> TurnBack | None:
        """The turn-back by the best alignment, if it is beyond doubt."""
        aligned = self._retracing.aligned()
        turned_m = GRID_M * aligned.turn
        back_m, out_m = (self._rows - 1) * GRID_M - turned_m, turned_m - GRID_M * float(aligned.out[-1])
        if back_m < self._retraced_m - 0.5 * GRID_M or out_m < _REACH * self._retraced_m:
            return None
        if self._retracing.climbed_m(aligned) >= _FLOOR_M or self._retracing.log_odds(aligned) < self._log_odds:
            return None
        k = max(bisect_right(self._walked_m, turned_m) - 1, 1)
        return TurnBack(k, self._t_s[k], self._t_s[-1])


def find_turn_back(
    trajectory: Trajectory, track: StepTrack, length: StepLengthConfig, config: ReturnConfig
) -> TurnBack | None:
    """The first turn-back of a whole walk.

    Args:
        trajectory: an estimate of the walk.
        track: its steps.
        length: as the steps were measured.
        config: how much of the way must have been walked back.
    """
    detector = TurnBackDetector(config.retraced_m, _BEYOND_DOUBT_TO_TIE)
    walked_m = 0.0
    columns = trajectory.x_m, trajectory.y_m, trajectory.z_m, trajectory.yaw_rad
    for k, step in enumerate(track.steps):
        walked_m += level_length_m(step, length)
        place = [float(axis[k]) for axis in columns]
        found = detector.advance(crumb_of(step, place, walked_m))
        if found is not None:
            return found
    return None


def crumb_of(step: Step, place: Sequence[float], walked_m: float) -> Crumb:
    """What the search looks at of a step, its estimated place (x, y, z, yaw), and the distance walked until then."""
    x_m, y_m, z_m, yaw_rad = place
    down_ut, level_ut = field_of(step)
    across_ut = level_ut * math.sin(wrap_scalar(step.yaw_mag_rad - yaw_rad))
    return Crumb(step.t_s, x_m, y_m, z_m, yaw_rad, walked_m, down_ut, level_ut, across_ut)


def reversal(xyz_m: FloatArray, yaw_rad: FloatArray, walked_m: FloatArray, apart_m: float) -> int:
    """Where the way out ends, for one who says "back" a little late: the breadcrumb after which all lead back.

    Args:
        xyz_m: (K + 1, 3) all breadcrumbs so far.
        yaw_rad, walked_m: (K + 1,) their direction and the distance walked as if on the level.
        apart_m: how far from the way out the way back may be, on average.

    Returns:
        Its index; the last one's if the walk was not reversed in its last 15 m.
    """
    last = len(yaw_rad) - 1
    table = np.column_stack((xyz_m, yaw_rad, walked_m))
    best = (apart_m, last)
    for k in range(int(np.searchsorted(walked_m, walked_m[last] - _LATE_M)), last):
        back_m = float(walked_m[last] - walked_m[k])
        if back_m >= _LATE_LEAST_M:
            best = min(best, (_apart_m(table, k, back_m), k))
    return best[1]


def _apart_m(table: FloatArray, turned: int, back_m: float) -> float:
    """Mean distance of the way after a breadcrumb from the way before it; infinite if it does not lead back.

    Args:
        table: (N, 5) x, y, z, yaw, distance walked.
        turned: the breadcrumb.
        back_m: how far after it to look.
    """
    walked = table[:, 4]
    after = walked[turned] + np.arange(min(GRID_M, back_m), back_m + 1e-9, GRID_M)
    before = walked[turned] - np.arange(0.0, min(back_m + _SLACK_M, walked[turned] - walked[0]) + 1e-9, GRID_M)
    back, there = (np.array([np.interp(at, walked, c) for c in table[:, :4].T]) for at in (after, before))
    off = np.abs(wrap_angle(back[3][:, None] - there[3] - np.pi))
    apart = np.hypot(back[0][:, None] - there[0], back[1][:, None] - there[1])
    apart[np.abs((after - walked[turned])[:, None] - (walked[turned] - before)) > _SLACK_M] = np.inf
    nearest = np.hypot(apart, _YAW_M * off).argmin(axis=1)
    each = np.arange(len(nearest))
    apart_m, off, climbed = apart[each, nearest], off[each, nearest], np.abs(back[2] - there[2][nearest])
    late = slice(-round(_LATELY_M / GRID_M), None)
    leads_back = (
        walked[turned] - before[nearest[-1]] >= _LATE_REACH * back_m
        and (off < _REVERSED_RAD).mean() >= _REVERSED_SHARE
        and off[late].mean() < _LATELY_RAD
        and climbed[late].mean() < _FLOOR_M
    )
    # at its end above all: who leaves the way out has not turned back
    return float(max(apart_m.mean(), apart_m[late].mean() / 1.5)) if leads_back else math.inf
