"""Anchors while walking: each when its time has come, and the frame that they make known.

The walk is solved in its own frame, which begins at the origin. Until the first anchor is passed, the walk is shown as
if it began there: somewhere within a walk of it. The first anchor tells where it did; until two of them tell how their
frame is turned as well, none bends the walk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np

from fbgraph.core.aids import AnchorFrame
from fbgraph.core.checkpoints import Checkpoints, anchor_breadcrumbs
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, turned
from fbgraph.core.trajectory import Breadcrumb, Trajectory
from fbgraph.estimators.aid_factors import anchor_factor, anchor_sigma_m, anchors_centre
from fbgraph.estimators.aided import frame_of
from fbgraph.estimators.anchor_frame import WalkAtAnchors
from fbgraph.front_end.step_track import Step

_TURN_KNOWN_RAD = 0.15


class OnlineAnchors:
    """Anchors of a walk in progress.

    Attributes:
        frame: where their frame lies in the walk's, as far as it is known.
    """

    def __init__(self, anchors: Checkpoints | None, config: GraphConfig) -> None:
        """None of them has been passed yet."""
        self._anchors = anchors
        self._config = config
        self._crumbs: list[int] = []
        self._decided = False
        self.frame: AnchorFrame | None = None
        if anchors is not None and len(anchors):  # until the first is passed, the walk begins there, give or take
            self.frame = AnchorFrame(0.0, 0.0, 0.0, anchors_centre(anchors), free=False)

    def due(
        self, steps: Sequence[Step], walk: Trajectory, first: int, compass: bool
    ) -> list[tuple[int, gtsam.PoseTranslationPrior2D]]:
        """Factors of the anchors whose time has come, each with its breadcrumb: the nearest in time, as in the batch.

        Args:
            steps: all so far, the latest among them.
            walk: as it is known, in its own frame.
            first: the earliest breadcrumb that a factor may still be on.
            compass: whether the walk knows North.
        """
        anchors, config, factors = self._anchors, self._config, []
        while anchors is not None and self._is_due(anchors, steps[-1].t_s):
            i = len(self._crumbs)
            last = len(steps) - 1
            lately_s = np.array([step.t_s for step in steps[max(last - 1, 0) :]])
            nearest = int(anchor_breadcrumbs(anchors.select(slice(i, i + 1)), lately_s)[0])
            self._crumbs.append(max(last - 1, 0) + nearest)
            chosen = [i]
            if not self._decided:
                chosen = self._look(anchors, steps, walk, compass)
            if self._decided and self.frame is not None:
                local = _in_walk(anchors, self.frame)
                factors += [
                    (k, anchor_factor(local, n, k, steps[k], config))
                    for n, k in ((n, self._crumbs[n]) for n in chosen)
                    if k >= first
                ]
        return factors

    def waiting(self, now_s: float) -> bool:
        """Whether an anchor's time has come."""
        return self._anchors is not None and self._is_due(self._anchors, now_s)

    def _is_due(self, anchors: Checkpoints, now_s: float) -> bool:
        return len(self._crumbs) < len(anchors) and float(anchors.t_s[len(self._crumbs)]) <= now_s

    def _look(self, anchors: Checkpoints, steps: Sequence[Step], walk: Trajectory, compass: bool) -> list[int]:
        """Compare the anchors passed so far with the walk; those that agree once the frame is known."""
        crumbs = np.array(self._crumbs)
        passed = anchors.select(slice(0, len(crumbs)))
        sigma_m = np.array([anchor_sigma_m(passed, n, steps[k], self._config) for n, k in enumerate(crumbs.tolist())])
        at_anchors = WalkAtAnchors(walk, crumbs, passed.xy_m, sigma_m)
        fit = at_anchors.fit(compass) if len(crumbs) > 1 else None
        if fit is not None and fit.sigma_turn_rad < _TURN_KNOWN_RAD and 2 * int(fit.agree.sum()) > len(crumbs):
            self._decided = True
            self.frame = frame_of(fit, passed.xy_m, free=False)
            return [int(n) for n in np.flatnonzero(fit.agree)]
        self.frame = frame_of(at_anchors.laid(0.0), passed.xy_m, free=False)
        return []

    def seen(self, crumb: Breadcrumb) -> tuple[float, float, float]:
        """(x, y, yaw) of a breadcrumb of the walk's own frame as seen from the anchors'."""
        if self.frame is None:
            return crumb.x_m, crumb.y_m, crumb.yaw_rad
        x_m, y_m = self.places(np.array([[crumb.x_m, crumb.y_m]]))[0].tolist()
        return x_m, y_m, crumb.yaw_rad - self.frame.turn_rad

    def places(self, xy_m: FloatArray) -> FloatArray:
        """(N, 2) places of the walk's own frame as seen from the anchors'."""
        frame = self.frame
        if frame is None:
            return xy_m
        from_frame = xy_m - np.array((frame.x_m, frame.y_m))
        return np.asarray(turned(from_frame, -frame.turn_rad) + np.array(frame.centre_m))

    def walk(self, trajectory: Trajectory) -> Trajectory:
        """A walk in its own frame as seen from the anchors'."""
        if self.frame is None:
            return trajectory
        xy_m = self.places(trajectory.xy_m)
        yaw_rad = trajectory.yaw_rad - self.frame.turn_rad
        return replace(trajectory, x_m=xy_m[:, 0], y_m=xy_m[:, 1], yaw_rad=yaw_rad)


def _in_walk(anchors: Checkpoints, frame: AnchorFrame) -> Checkpoints:
    """Anchors as seen from the walk's own frame."""
    xy_m = turned(anchors.xy_m - np.array(frame.centre_m), frame.turn_rad) + np.array((frame.x_m, frame.y_m))
    return replace(anchors, x_m=xy_m[:, 0], y_m=xy_m[:, 1])
