"""Closures: the wearer is where an earlier breadcrumb was dropped; found by matching the way back to the way out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from fbgraph.core.config import ReturnConfig, StepLengthConfig
from fbgraph.core.trajectory import Trajectory
from fbgraph.front_end.front_end import StepTrack
from fbgraph.way_back.matcher import Match, RouteMatcher
from fbgraph.way_back.turn_back import Crumb, TurnBack, TurnBackDetector
from fbgraph.way_back.way_out import Outbound, field_of, gap_before_s, level_length_m

_FREE_RAD = 100.0
_CAUCHY = 1.0
_FIXED_FACTOR = 1.5  # of sigma, where the earlier breadcrumb can no longer move


@dataclass(frozen=True, slots=True)
class Closure:
    """Breadcrumb ``j`` is at the place of the earlier breadcrumb ``i``.

    Attributes:
        i, j: breadcrumbs.
        sigma_along_m, sigma_across_m: standard deviations along the direction walked at ``i`` and across it.
        along_m: how far beyond ``i``, in that direction, ``j`` is.
    """

    i: int
    j: int
    sigma_along_m: float
    sigma_across_m: float
    along_m: float = 0.0


def closure_factor(closure: Closure) -> Any:
    """BetweenFactorPose2 on X(i), X(j), yaw left free; robust (Cauchy), for a wrong match is worse than none."""
    place = gtsam.Pose2(closure.along_m, 0.0, math.pi)  # facing the other way
    sigmas = (closure.sigma_along_m, closure.sigma_across_m, _FREE_RAD)
    return gtsam.BetweenFactorPose2(X(closure.i), X(closure.j), place, _robust(*sigmas))


def closure_prior(closure: Closure, x_m: float, y_m: float, yaw_rad: float) -> Any:
    """The same where breadcrumb ``i`` is fixed at a place and direction: a robust prior on X(j)."""
    sigma = _FIXED_FACTOR * math.hypot(closure.sigma_along_m, closure.sigma_across_m) / math.sqrt(2.0)
    x_m, y_m = x_m + closure.along_m * math.cos(yaw_rad), y_m + closure.along_m * math.sin(yaw_rad)
    return gtsam.PoseTranslationPrior2D(X(closure.j), gtsam.Pose2(x_m, y_m, 0.0), _robust(sigma, sigma))


def _robust(*sigmas: float) -> Any:
    cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(_CAUCHY)
    return gtsam.noiseModel.Robust.Create(cauchy, gtsam.noiseModel.Diagonal.Sigmas(np.array(sigmas)))


class ClosureMaker:
    """Chooses the matches that may enter the graph: the route followed back without doubt for a while, not too many."""

    def __init__(self, outbound: Outbound, config: ReturnConfig) -> None:
        self._outbound = outbound
        self._config = config
        self._since_m = math.inf

    def advance(self, k: int, length_m: float, match: Match) -> Closure | None:
        """The closure of breadcrumb ``k``, if its match is good enough and the last one is some way back."""
        config = self._config
        self._since_m += length_m
        away_m = float(self._outbound.route_m[-1]) - match.route_m
        steady = match.steady_m >= config.closure_steady_m and away_m >= config.closure_away_m
        if not steady or self._since_m < config.closure_every_m:
            return None
        self._since_m = 0.0
        along_m = match.route_m - float(self._outbound.route_m[match.breadcrumb])
        sigma_m = math.hypot(match.sigma_m, config.closure_sigma_m)
        return Closure(match.breadcrumb, k, sigma_m, config.closure_sigma_m, along_m)


def find_turn_back(
    trajectory: Trajectory, track: StepTrack, length: StepLengthConfig, config: ReturnConfig
) -> TurnBack | None:
    """The first turn-back of a whole walk."""
    detector = TurnBackDetector(config.retraced_m, config.apart_m)
    walked = np.cumsum([level_length_m(step, length) for step in track.steps])
    columns = (track.t_s, trajectory.x_m, trajectory.y_m, trajectory.z_m, trajectory.yaw_rad, walked)
    for row in np.column_stack(columns).tolist():
        found = detector.advance(Crumb(*row))
        if found is not None:
            return found
    return None


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
    steps = list(track.steps)
    outbound = Outbound.of(trajectory, steps, length, turned.breadcrumb)
    matcher, maker = RouteMatcher(outbound, config), ClosureMaker(outbound, config)
    found = []
    for k in range(turned.breadcrumb + 1, len(steps)):
        step = steps[k]
        level_m = level_length_m(step, length)
        yaw_rad, gap_s = float(trajectory.yaw_rad[k]), gap_before_s(steps, k)
        match = matcher.advance(step.length_m, level_m, yaw_rad, field_of(step), step.altitude_m, gap_s)
        closure = maker.advance(k, step.length_m, match)
        if closure is not None:
            found.append(closure)
    return tuple(found)
