"""Factors of what is known besides the sensors: anchors, a closed end, the same place met again."""

from __future__ import annotations

import math

import gtsam
import numpy as np
from gtsam.symbol_shorthand import F, X

from fbgraph.core.aids import Aids, AnchorFrame
from fbgraph.core.checkpoints import Checkpoints, anchor_breadcrumbs
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import turned
from fbgraph.estimators.noise_models import FREE_RAD, HUBER, sigmas
from fbgraph.front_end.step_track import Step, StepTrack
from fbgraph.way_back.records import Closure

_CAUCHY = 1.0
_TURNED_RAD = 0.2  # a frame that is the compass's is turned by its error, declination and how the device is held
_KNOWN = 1e-3  # radians
_BESIDE = 0.5
_FIXED_FACTOR = 1.5  # of a closure's sigma, where the earlier breadcrumb can no longer move


def add_aids(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    track: StepTrack,
    aids: Aids,
    config: GraphConfig,
) -> None:
    """Add to the graph of a whole walk what is known of it besides the sensors.

    Args:
        graph, values: extended in place.
        track: the steps.
        aids: anchors and a closed end.
        config: weights.
    """
    if aids.closed_walk:
        graph.push_back(closed_walk_factor(len(track) - 1, config))
    anchors = aids.anchors
    if anchors is None or len(anchors) == 0:
        return
    crumbs = anchor_breadcrumbs(anchors, track.t_s).tolist()
    frame = aids.frame or frame_at(anchors, values.atPose2(X(crumbs[0])))
    values.insert(F(0), gtsam.Pose2(frame.x_m, frame.y_m, frame.turn_rad))
    graph.push_back(_turn_prior(frame, compass=bool(np.isfinite(track.yaw_mag_rad).any())))
    for i, k in enumerate(crumbs):
        graph.push_back(framed_anchor_factor(anchors, i, k, track.steps[k], frame, config))


def frame_at(anchors: Checkpoints, first: gtsam.Pose2) -> AnchorFrame:
    """A frame that is not turned, and whose first anchor lies at a place of the walk."""
    return AnchorFrame(first.x(), first.y(), 0.0, anchors_centre(anchors), free=len(anchors) > 1)


def anchors_centre(anchors: Checkpoints) -> tuple[float, float]:
    """The place from which anchors are counted where nothing else is known: that of the first."""
    return float(anchors.x_m[0]), float(anchors.y_m[0])


def _turn_prior(frame: AnchorFrame, compass: bool) -> gtsam.PoseRotationPrior2D:
    """How a frame is turned: usually as the compass, but it may be a building's (a loss that soon gives way)."""
    if not frame.free:
        return gtsam.PoseRotationPrior2D(F(0), gtsam.Rot2(frame.turn_rad), sigmas(_KNOWN))
    if not compass:
        return gtsam.PoseRotationPrior2D(F(0), gtsam.Rot2(frame.turn_rad), sigmas(FREE_RAD))
    return gtsam.PoseRotationPrior2D(F(0), gtsam.Rot2(), _cauchy(_TURNED_RAD))


def framed_anchor_factor(
    anchors: Checkpoints, i: int, k: int, step: Step, frame: AnchorFrame, config: GraphConfig
) -> gtsam.BetweenFactorPose2:
    """The same as ``anchor_factor`` as seen from the anchors' frame F, whose place and turn are states.

    Args:
        anchors, i, k, step, config: as there.
        frame: whose centre the anchors are counted from.
    """
    sigma_m = anchor_sigma_m(anchors, i, step, config)
    huber = gtsam.noiseModel.mEstimator.Huber.Create(HUBER)
    model = gtsam.noiseModel.Robust.Create(huber, sigmas(sigma_m, sigma_m, FREE_RAD))
    x_m, y_m = float(anchors.x_m[i]) - frame.centre_m[0], float(anchors.y_m[i]) - frame.centre_m[1]
    return gtsam.BetweenFactorPose2(F(0), X(k), gtsam.Pose2(x_m, y_m, 0.0), model)


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
    sigma_m = anchor_sigma_m(anchors, i, step, config)
    huber = gtsam.noiseModel.mEstimator.Huber.Create(HUBER)
    model = gtsam.noiseModel.Robust.Create(huber, sigmas(sigma_m, sigma_m))
    place = gtsam.Pose2(float(anchors.x_m[i]), float(anchors.y_m[i]), 0.0)
    return gtsam.PoseTranslationPrior2D(X(k), place, model)


def anchor_sigma_m(anchors: Checkpoints, i: int, step: Step, config: GraphConfig) -> float:
    """Standard deviation of anchor i against the breadcrumb nearest in time, on each axis."""
    own_m = float(anchors.sigma_m[i])
    return math.hypot(config.sigma_anchor_m if math.isnan(own_m) else own_m, 0.5 * step.length_m)


def closed_walk_factor(last: int, config: GraphConfig) -> gtsam.PoseTranslationPrior2D:
    """The walk ends, at breadcrumb ``last``, where it began."""
    return gtsam.PoseTranslationPrior2D(X(last), gtsam.Pose2(), sigmas(config.sigma_closure_m, config.sigma_closure_m))


def closure_factor(closure: Closure) -> gtsam.BetweenFactorPose2:
    """BetweenFactorPose2 on X(i), X(j), yaw left free; robust (Cauchy), for a wrong match is worse than none."""
    place = gtsam.Pose2(closure.along_m, closure.across_m, math.pi)  # facing the other way
    model = _cauchy(closure.sigma_along_m, _across_sigma_m(closure), FREE_RAD)
    return gtsam.BetweenFactorPose2(X(closure.i), X(closure.j), place, model)


def closure_prior(closure: Closure, x_m: float, y_m: float, yaw_rad: float) -> gtsam.PoseTranslationPrior2D:
    """The same where breadcrumb ``i`` is fixed at a place and direction: a robust prior on X(j)."""
    sigma_m = _FIXED_FACTOR * math.hypot(closure.sigma_along_m, _across_sigma_m(closure)) / math.sqrt(2.0)
    x_m, y_m = turned(np.array((closure.along_m, closure.across_m)), yaw_rad) + np.array((x_m, y_m))
    return gtsam.PoseTranslationPrior2D(X(closure.j), gtsam.Pose2(x_m, y_m, 0.0), _cauchy(sigma_m, sigma_m))


def _across_sigma_m(closure: Closure) -> float:
    """A way back that lies beside the way out does so by nobody knows quite how much."""
    return math.hypot(closure.sigma_across_m, _BESIDE * closure.across_m)


def _cauchy(*sigma: float) -> gtsam.noiseModel.Robust:
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(_CAUCHY), sigmas(*sigma))
