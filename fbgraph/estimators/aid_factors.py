"""Factors of what is known besides the sensors: anchors, a closed end, the same place met again."""

from __future__ import annotations

import math
from collections.abc import Sequence

import gtsam
from gtsam.symbol_shorthand import X

from fbgraph.core.aids import Aids
from fbgraph.core.checkpoints import Checkpoints, anchor_breadcrumbs
from fbgraph.core.config import GraphConfig
from fbgraph.estimators.noise_models import FREE_RAD, HUBER, sigmas
from fbgraph.front_end.step_track import Step, StepTrack
from fbgraph.way_back.records import Closure

_CAUCHY = 1.0
_FIXED_FACTOR = 1.5  # of a closure's sigma, where the earlier breadcrumb can no longer move


def add_aids(
    graph: gtsam.NonlinearFactorGraph,
    track: StepTrack,
    aids: Aids,
    closures: Sequence[Closure],
    config: GraphConfig,
) -> None:
    """Add to the graph of a whole walk what is known of it besides the sensors.

    Args:
        graph: extended in place.
        track: the steps.
        aids: anchors and a closed end.
        closures: breadcrumbs at the places of earlier ones.
        config: weights.
    """
    if aids.anchors is not None:
        for i, k in enumerate(anchor_breadcrumbs(aids.anchors, track.t_s).tolist()):
            graph.push_back(anchor_factor(aids.anchors, i, k, track.steps[k], config))
    if aids.closed_walk:
        graph.push_back(closed_walk_factor(len(track) - 1, config))
    for closure in closures:
        graph.push_back(closure_factor(closure))


def anchor_factor(
    anchors: Checkpoints, i: int, k: int, step: Step, config: GraphConfig
) -> gtsam.PoseTranslationPrior2D:
    """Anchor i at breadcrumb k, the nearest in time; robust (Huber), for people press buttons late.

    The breadcrumb may be half a step away from where the anchor was passed, which adds to its sigma.

    Args:
        anchors: known places.
        i: which of them.
        k: index of the breadcrumb.
        step: the step that ends there.
        config: what to believe of anchors without a sigma of their own.
    """
    own_m = float(anchors.sigma_m[i])
    sigma_m = math.hypot(config.sigma_anchor_m if math.isnan(own_m) else own_m, 0.5 * step.length_m)
    huber = gtsam.noiseModel.mEstimator.Huber.Create(HUBER)
    model = gtsam.noiseModel.Robust.Create(huber, sigmas(sigma_m, sigma_m))
    place = gtsam.Pose2(float(anchors.x_m[i]), float(anchors.y_m[i]), 0.0)
    return gtsam.PoseTranslationPrior2D(X(k), place, model)


def closed_walk_factor(last: int, config: GraphConfig) -> gtsam.PoseTranslationPrior2D:
    """The walk ends, at breadcrumb ``last``, where it began."""
    return gtsam.PoseTranslationPrior2D(X(last), gtsam.Pose2(), sigmas(config.sigma_closure_m, config.sigma_closure_m))


def closure_factor(closure: Closure) -> gtsam.BetweenFactorPose2:
    """BetweenFactorPose2 on X(i), X(j), yaw left free; robust (Cauchy), for a wrong match is worse than none."""
    place = gtsam.Pose2(closure.along_m, 0.0, math.pi)  # facing the other way
    model = _cauchy(closure.sigma_along_m, closure.sigma_across_m, FREE_RAD)
    return gtsam.BetweenFactorPose2(X(closure.i), X(closure.j), place, model)


def closure_prior(closure: Closure, x_m: float, y_m: float, yaw_rad: float) -> gtsam.PoseTranslationPrior2D:
    """The same where breadcrumb ``i`` is fixed at a place and direction: a robust prior on X(j)."""
    sigma_m = _FIXED_FACTOR * math.hypot(closure.sigma_along_m, closure.sigma_across_m) / math.sqrt(2.0)
    x_m, y_m = x_m + closure.along_m * math.cos(yaw_rad), y_m + closure.along_m * math.sin(yaw_rad)
    return gtsam.PoseTranslationPrior2D(X(closure.j), gtsam.Pose2(x_m, y_m, 0.0), _cauchy(sigma_m, sigma_m))


def _cauchy(*sigma: float) -> gtsam.noiseModel.Robust:
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(_CAUCHY), sigmas(*sigma))
