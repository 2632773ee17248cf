"""The way back followed along the way out, step by step: live behind a guide, or over a whole walk."""

from __future__ import annotations

from collections.abc import Sequence

from fbgraph.core.config import ReturnConfig, StepLengthConfig
from fbgraph.core.trajectory import Trajectory
from fbgraph.front_end.step_track import Step, StepTrack
from fbgraph.way_back.closures import ClosureMaker, beside_m
from fbgraph.way_back.matcher import RouteMatcher
from fbgraph.way_back.records import Closure, Match, TurnBack
from fbgraph.way_back.way_out import Outbound, field_of, gap_before_s, level_length_m


class RouteFollower:
    """Steps after the turn-back in; where on the way out they are, and which may be tied to it; causal."""

    def __init__(
        self, outbound: Outbound, length: StepLengthConfig, config: ReturnConfig, across_m: float = 0.0
    ) -> None:
        """A follower that stands at the end of the way out.

        Args:
            outbound: the way out.
            length: as the steps were measured.
            config: of the matcher.
            across_m: how far beside the way out the way back begins, from ``closures.beside_m``.
        """
        self._length = length
        self._matcher = RouteMatcher(outbound, config)
        self._closures = ClosureMaker(outbound, config, across_m)

    def advance(self, steps: Sequence[Step], k: int, yaw_rad: float) -> tuple[Match, Closure | None]:
        """Take the next step; return where it is, and its closure if it is worth one.

        Args:
            steps: all of the walk so far.
            k: index of the step.
            yaw_rad: its direction by the estimator.
        """
        step = steps[k]
        level_m = level_length_m(step, self._length)
        gap_s = gap_before_s(steps, k)
        match = self._matcher.advance(step.length_m, level_m, yaw_rad, field_of(step), step.altitude_m, gap_s)
        return match, self._closures.advance(k, step.length_m, match)


def find_closures(
    trajectory: Trajectory, track: StepTrack, turned: TurnBack | None, length: StepLengthConfig, config: ReturnConfig
) -> tuple[Closure, ...]:
    """Closures of a walk out and back; none if it does not turn back.

    Args:
        trajectory: an estimate of the walk, without closures.
        track: its steps.
        turned: from ``find_turn_back``.
        length: as the steps were measured.
        config: of the matcher.
    """
    if turned is None:
        return ()
    outbound = Outbound.of(trajectory, track.steps, length, turned.breadcrumb)
    follower = RouteFollower(outbound, length, config, beside_m(trajectory, turned.breadcrumb))
    found = (
        follower.advance(track.steps, k, float(trajectory.yaw_rad[k]))[1]
        for k in range(turned.breadcrumb + 1, len(track))
    )
    return tuple(closure for closure in found if closure is not None)
