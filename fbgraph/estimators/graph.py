"""The factor graph: what each step says about the breadcrumbs. Builds factors, never solves.

Node k is a breadcrumb: X(k) Pose2 (x, y, yaw), Z(k) altitude, B(k) gyro bias about the vertical. A levelled pedestrian
has four degrees of freedom; Pose3 would add two that nothing measures. X(k)'s yaw is the mean walking direction of the
step that ends at k, so "moved L forward" holds in the frame of k:

    step length     X(k), X(k-1)        kTk-1 = (-L_k, 0), yaw free          BetweenFactorPose2
    heading         X(k-1), X(k), B(k)  Δyaw + b Δt = gyro increment         LinearContainerFactor(JacobianFactor)
    bias walk       B(k-1), B(k)        b drifts slowly                      BetweenFactorDouble
    compass         X(k)                yaw = compass, Huber, by quality     PoseRotationPrior2D
    barometer       Z(k)                altitude above the start, Huber      PriorFactorDouble
    climb           Z(k-1), Z(k)        ~0 in one step                       BetweenFactorDouble
    standing still  B(k)                mean yaw rate of a rest is the bias  PriorFactorDouble
    anchor          X(k)                a known place, Huber                 PoseTranslationPrior2D
    closed walk     X(K)                the end is the start                 PoseTranslationPrior2D
    closure         X(i), X(j)          the same place again, Cauchy         BetweenFactorPose2

A Pose2's yaw is additive in its tangent space, so the linear heading factor is exact, not an approximation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, X, Z

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.estimators.field import FieldMemory
from fbgraph.front_end.front_end import Step

Graph = Any  # gtsam.NonlinearFactorGraph; the wheel's stubs are incomplete
Values = Any  # gtsam.Values

_FREE_RAD = 100.0  # a standard deviation that says nothing, yet keeps the system well conditioned
_FREE_M = 1000.0
_FIXED = 1e-3  # metres and radians; the origin
_YAW_ROW = np.array([[0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class Node:
    """A value of every state of one breadcrumb."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    bias_rad_s: float

    @property
    def pose(self) -> Any:
        """As a gtsam.Pose2."""
        return gtsam.Pose2(self.x_m, self.y_m, self.yaw_rad)


class GraphBuilder:
    """Turns steps into factors and first values, one step at a time, for batch and online alike.

    It keeps only what a step's factors need from the steps before: the last step and the field's recent usual.
    """

    def __init__(
        self,
        config: GraphConfig,
        compass: bool = True,
        free_origin: bool = False,
        turned: bool = False,
        aided: bool = False,
    ) -> None:
        """A builder for one walk.

        Args:
            config: weights.
            compass: whether the first step has one; else the first direction is the reference of all others.
            free_origin: places are known in a frame of their own, so the first breadcrumb is not its origin.
            turned: of these places there are at least two, so that they also tell the walk's direction.
            aided: places are known: let the steps stretch by the error they share, as no node carries it.
        """
        self._config = config
        self._compass = compass
        self._free_origin = free_origin
        self._turned = turned
        shared = config.sigma_length_scale * math.sqrt(config.aided_length_steps) if aided else 0.0
        self._sigma_length_rel = math.hypot(config.sigma_length_rel, shared)
        self._k = -1
        self._previous: Step | None = None
        self._field = FieldMemory(config.norm_scale_ut, config.dip_scale_rad)
        self._altitude_0 = math.nan
        self._huber = gtsam.noiseModel.mEstimator.Huber
        self._barometer = gtsam.noiseModel.Robust.Create(self._huber.Create(1.345), _sigmas(config.sigma_altitude_m))

    def add(self, step: Step, node: Node, previous_node: Node | None, graph: Graph, values: Values) -> None:
        """Add the factors and the first values of the next breadcrumb.

        Args:
            step: the next step; the first one is the standing start.
            node: where to start the solver, and the linearisation point of the heading factor: near the answer.
            previous_node: the same of the breadcrumb before; None for the first.
            graph, values: extended in place.
        """
        self._k += 1
        k, previous = self._k, self._previous
        values.insert(X(k), node.pose)
        values.insert(Z(k), node.z_m)
        values.insert(B(k), node.bias_rad_s)
        if previous is None or previous_node is None:
            self._add_start(node, graph)
        else:
            self._add_length(k, step, previous, graph)
            self._add_heading(k, step, previous, node, previous_node, graph)
        self._add_compass(k, step, graph)
        self._add_altitude(k, step, graph)
        self._previous = step

    def _add_start(self, node: Node, graph: Graph) -> None:
        sigma = _FREE_M if self._free_origin else _FIXED
        graph.push_back(gtsam.PoseTranslationPrior2D(X(0), gtsam.Pose2(), _sigmas(sigma, sigma)))
        graph.push_back(gtsam.PriorFactorDouble(Z(0), 0.0, _sigmas(_FIXED)))
        graph.push_back(gtsam.PriorFactorDouble(B(0), 0.0, _sigmas(self._config.sigma_bias_rad_s)))
        sigma = _FREE_RAD if self._compass or self._turned else _FIXED
        graph.push_back(gtsam.PoseRotationPrior2D(X(0), gtsam.Rot2(node.yaw_rad), _sigmas(sigma)))

    def _add_length(self, k: int, step: Step, previous: Step, graph: Graph) -> None:
        config = self._config
        along = math.hypot(self._sigma_length_rel * step.length_m, config.sigma_slope_rel * step.shortened_m)
        across = config.sigma_lateral_m
        if not step.chained:
            along = across = config.sigma_gap_m_s * (step.t_s - previous.t_s)
        graph.push_back(
            gtsam.BetweenFactorPose2(
                X(k), X(k - 1), gtsam.Pose2(-step.length_m, 0.0, 0.0), _sigmas(along, across, _FREE_RAD)
            )
        )

    def _add_heading(self, k: int, step: Step, previous: Step, node: Node, previous_node: Node, graph: Graph) -> None:
        config = self._config
        dt_s = step.yaw_s - previous.yaw_s
        increment = step.yaw_gyro_rad - previous.yaw_gyro_rad
        sigma = config.sigma_yaw_step_rad if step.chained else math.pi
        graph.push_back(heading_factor(k, increment, dt_s, sigma, node, previous_node))
        drift = config.sigma_bias_walk_rad_s * math.sqrt(max(dt_s, 1e-3))
        graph.push_back(gtsam.BetweenFactorDouble(B(k - 1), B(k), 0.0, _sigmas(drift)))
        if step.rest_s > 0:
            graph.push_back(gtsam.PriorFactorDouble(B(k), step.rest_rate_rad_s, _sigmas(step.rest_sigma_rad_s)))

    def _add_compass(self, k: int, step: Step, graph: Graph) -> None:
        if not math.isfinite(step.yaw_mag_rad):
            return
        config = self._config
        sigma = config.sigma_mag_rad * math.sqrt(self._field.inflation(step))
        # compass errors are those of the place: N correlated steps know as much as N (1 - a) / (1 + a) free ones
        # (information of a first-order Gauss-Markov process with a = exp(-L / correlation length))
        a = math.exp(-max(step.length_m, 0.05) / config.mag_correlation_m)
        inflation = math.sqrt((1.0 + a) / (1.0 - a))
        huber = self._huber.Create(config.mag_huber / inflation)
        model = gtsam.noiseModel.Robust.Create(huber, _sigmas(sigma * inflation))
        graph.push_back(gtsam.PoseRotationPrior2D(X(k), gtsam.Rot2(step.yaw_mag_rad), model))

    def _add_altitude(self, k: int, step: Step, graph: Graph) -> None:
        config = self._config
        if math.isnan(self._altitude_0):
            self._altitude_0 = step.altitude_m
        if k > 0:
            graph.push_back(gtsam.BetweenFactorDouble(Z(k - 1), Z(k), 0.0, _sigmas(config.sigma_climb_m)))
        if k > 0 and math.isfinite(step.altitude_m):
            graph.push_back(gtsam.PriorFactorDouble(Z(k), step.altitude_m - self._altitude_0, self._barometer))


def heading_factor(k: int, increment_rad: float, dt_s: float, sigma_rad: float, node: Node, previous: Node) -> Any:
    """The EKF's prediction as a factor: (θ_k - θ_{k-1}) + b_k Δt = gyroscope increment.

    Args:
        k: index of the later breadcrumb.
        increment_rad: what the gyroscope integrated between the middles of the two steps, its bias still in it.
        dt_s: time between these middles.
        sigma_rad: standard deviation of the increment.
        node, previous: linearisation point; the true yaw must lie within π of it, nothing else depends on it.
    """
    residual = increment_rad - (node.yaw_rad - previous.yaw_rad) - node.bias_rad_s * dt_s
    jacobian = gtsam.JacobianFactor(
        X(k - 1),
        -_YAW_ROW,
        X(k),
        _YAW_ROW,
        B(k),
        np.array([[dt_s]]),
        np.array([residual]),
        _sigmas(sigma_rad),
    )
    point = gtsam.Values()
    point.insert(X(k - 1), previous.pose)
    point.insert(X(k), node.pose)
    point.insert(B(k), node.bias_rad_s)
    return gtsam.LinearContainerFactor(jacobian, point)


def anchor_factor(k: int, x_m: float, y_m: float, sigma_m: float) -> Any:
    """The wearer was here at breadcrumb k, give or take sigma_m; robust, for people press buttons late."""
    model = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(1.345), _sigmas(sigma_m, sigma_m))
    return gtsam.PoseTranslationPrior2D(X(k), gtsam.Pose2(x_m, y_m, 0.0), model)


def anchor_factors(
    anchors: Checkpoints, t0_s: float, t_s: FloatArray, length_m: FloatArray, config: GraphConfig
) -> list[Any]:
    """Anchors at the breadcrumbs nearest in time; the distance walked meanwhile adds to their sigma."""
    factors = []
    crumbs = anchor_breadcrumbs(anchors, t0_s, t_s).tolist()
    for k, x_m, y_m, sigma_m in zip(crumbs, anchors.x_m, anchors.y_m, anchors.sigma_m, strict=True):
        sigma = anchor_sigma(float(sigma_m), float(length_m[k]) if k > 0 else 0.0, config)
        factors.append(anchor_factor(k, float(x_m), float(y_m), sigma))
    return factors


def anchor_breadcrumbs(anchors: Checkpoints, t0_s: float, t_s: FloatArray) -> IntArray:
    """(M,) indices of the breadcrumbs nearest in time to M anchors."""
    return np.asarray(np.abs(t_s[None, :] - (anchors.t_s - t0_s)[:, None]).argmin(axis=1))


def anchor_sigma(sigma_m: float, length_m: float, config: GraphConfig) -> float:
    """Standard deviation of an anchor at the breadcrumb nearest in time, which may be half a step away."""
    return math.hypot(config.sigma_anchor_m if math.isnan(sigma_m) else sigma_m, 0.5 * length_m)


def closed_walk_factor(last: int, config: GraphConfig) -> Any:
    """The walk ends where it began."""
    return gtsam.PoseTranslationPrior2D(X(last), gtsam.Pose2(), _sigmas(config.sigma_closure_m, config.sigma_closure_m))


@lru_cache(maxsize=512)  # most steps have the same
def _sigmas(*values: float) -> Any:
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))
