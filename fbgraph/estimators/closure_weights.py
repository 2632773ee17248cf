"""Closures by graduated non-convexity: good ones win together and bad ones lose; and a way back beside the way out.

All closures are believed at first, and what then contradicts the rest is let go little by little (truncated least
squares after Yang et al., Graduated Non-Convexity for Robust Spatial Perception, RA-L 2020). A loss that is robust from
the start would throw all of them away where the walk has drifted by more than their sigma. Other factors keep theirs.

How far the way back lies beside the way out is a state, L(0): nobody walks back in one's own
footprints, and a lane beside the last one is no way back. Dead reckoning round the turn tells; the closures then tie
direction and distance, not the place across.

A closure is linear in that state and nearly so in two poses that lie close together: it is linearised where it is, anew
in each round.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.estimates import Residuals
from fbgraph.estimators.noise_models import sigmas
from fbgraph.way_back.records import Closure

_INLIER = 9.0  # squared standard deviations within which a closure is believed
_FASTER = 1.4  # by how much each round is less forgiving
_MOST_ROUNDS = 40
_ASIDE_M = 0.5  # how far beside the way out people walk back; but they may walk anywhere
_LEAST_M = 0.2
_FIRST_ITERATIONS, _ITERATIONS = 20, 3
_LEAST_WEIGHT = 1e-6


@dataclass(frozen=True)
class WeighedClosures:
    """Closures and what is left of each.

    Attributes:
        closures: as found.
        weights: (N,) 0 to 1.
    """

    closures: tuple[Closure, ...]
    weights: FloatArray

    def add_to(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        """Add their factors, linearised at ``values``, and the states that they need."""
        if not values.exists(L(0)):
            values.insert(L(0), self.closures[0].across_m)
        loss = gtsam.noiseModel.mEstimator.Cauchy.Create(1.0)
        model = gtsam.noiseModel.Robust.Create(loss, sigmas(_ASIDE_M))
        graph.push_back(gtsam.PriorFactorDouble(L(0), 0.0, model))
        for closure, weight in zip(self.closures, self.weights.tolist(), strict=True):
            if weight > _LEAST_WEIGHT:
                graph.push_back(beside_factor(closure, weight, values))

    def residuals(self, values: gtsam.Values) -> Residuals:
        """What each of them still has to complain about."""
        k = np.array([closure.j for closure in self.closures], dtype=np.int64)
        return Residuals("closure", k, self.off(values), self.weights)

    def off(self, values: gtsam.Values) -> FloatArray:
        """(N,) by how many standard deviations each is not met."""
        return np.array([math.hypot(*_error(closure, values)) for closure in self.closures])


def weigh(
    base: gtsam.NonlinearFactorGraph, values: gtsam.Values, closures: Sequence[Closure], by_qr: bool
) -> tuple[WeighedClosures, gtsam.Values]:
    """Which closures are believed, and values near the solution with them.

    Args:
        base: all other factors.
        values: where to start.
        closures: at least one.
        by_qr: whether the system is too loose for Cholesky's decomposition.

    Raises:
        RuntimeError: GTSAM finds the system indeterminate.
    """
    state = WeighedClosures(tuple(closures), np.ones(len(closures)))
    values = _solved(base, gtsam.Values(values), state, by_qr, _FIRST_ITERATIONS)
    values = _solved(base, values, state, by_qr, _ITERATIONS)
    squared = state.off(values) ** 2
    if squared.max() <= _INLIER:
        return state, values
    forgiving = _INLIER / (2.0 * float(squared.max()) - _INLIER)
    for _ in range(_MOST_ROUNDS):
        low, high = forgiving / (forgiving + 1.0) * _INLIER, (forgiving + 1.0) / forgiving * _INLIER
        between = np.sqrt(_INLIER * forgiving * (forgiving + 1.0) / np.maximum(squared, 1e-9)) - forgiving
        weights = np.where(squared <= low, 1.0, np.where(squared >= high, 0.0, between))
        state = WeighedClosures(state.closures, weights)
        values = _solved(base, values, state, by_qr, _ITERATIONS)
        squared = state.off(values) ** 2
        if np.all((weights == 0.0) | (weights == 1.0)):
            break
        forgiving *= _FASTER
    return state, values


def _solved(
    base: gtsam.NonlinearFactorGraph, values: gtsam.Values, state: WeighedClosures, by_qr: bool, iterations: int
) -> gtsam.Values:
    """A few iterations from ``values``."""
    graph = gtsam.NonlinearFactorGraph(base)
    state.add_to(graph, values)
    params = gtsam.LevenbergMarquardtParams()
    if by_qr:
        params.setLinearSolverType("MULTIFRONTAL_QR")
    params.setMaxIterations(iterations)
    params.setRelativeErrorTol(1e-4)
    return gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()


def beside_factor(closure: Closure, weight: float, values: gtsam.Values) -> gtsam.LinearContainerFactor:
    """Breadcrumb j is at the place of i, L(0) to its left.

    Args:
        closure: which.
        weight: of it, more than 0.
        values: linearisation point.
    """
    first, second = values.atPose2(X(closure.i)), values.atPose2(X(closure.j))
    place = first.between(second)
    scale = np.sqrt(weight) / np.array(_sigmas_m(closure))
    by_first = np.array([[-1.0, 0.0, place.y()], [0.0, -1.0, -place.x()]])
    by_second = np.array(
        [
            [math.cos(place.theta()), -math.sin(place.theta()), 0.0],
            [math.sin(place.theta()), math.cos(place.theta()), 0.0],
        ]
    )
    by_aside = np.array([[0.0], [-1.0]])
    rows = [part * scale[:, None] for part in (by_first, by_second, by_aside)]
    error = np.array(_error(closure, values)) * np.sqrt(weight)
    keys = X(closure.i), X(closure.j), L(0)
    unit = gtsam.noiseModel.Unit.Create(2)
    jacobian = gtsam.JacobianFactor(keys[0], rows[0], keys[1], rows[1], keys[2], rows[2], -error, unit)
    point = gtsam.Values()
    point.insert(keys[0], first)
    point.insert(keys[1], second)
    point.insert(keys[2], values.atDouble(keys[2]))
    return gtsam.LinearContainerFactor(jacobian, point)


def _sigmas_m(closure: Closure) -> tuple[float, float]:
    """Along, and across beside what the whole way back shares."""
    return closure.sigma_along_m, math.sqrt(max(closure.sigma_across_m**2 - _ASIDE_M**2, _LEAST_M**2))


def _error(closure: Closure, values: gtsam.Values) -> tuple[float, float]:
    """Estimate less measurement in standard deviations, along and across."""
    place = values.atPose2(X(closure.i)).between(values.atPose2(X(closure.j)))
    aside_m = values.atDouble(L(0)) if values.exists(L(0)) else closure.across_m
    along, across = _sigmas_m(closure)
    return (place.x() - closure.along_m) / along, (place.y() - aside_m) / across
