"""The factor graph: what each step says about the breadcrumbs. Builds factors, never solves.

Node k is a breadcrumb: X(k) Pose2 (x, y, yaw), Z(k) altitude, B(k) gyro bias about the vertical, D(k) drift of air
pressure: the height of the isobar that ran through the start. A levelled pedestrian has four degrees of freedom; Pose3
would add two that nothing measures. X(k)'s yaw is the mean walking direction of the step that ends at k, so "moved L
forward" holds in the frame of k:

    step length     X(k), X(k-1)        kTk-1 = (-L_k, 0), yaw free          BetweenFactorPose2
    heading         X(k-1), X(k), B(k)  Δyaw + b Δt = gyro increment         LinearContainerFactor(JacobianFactor)
    bias walk       B(k-1), B(k)        b drifts slowly                      BetweenFactorDouble
    compass         X(k)                yaw = compass, Huber, by quality     PoseRotationPrior2D
    barometer       D(k), Z(k)          altitude above the isobar, Huber     BetweenFactorDouble
    climb           Z(k-1), Z(k)        ~0 in one step                       BetweenFactorDouble
    weather         D(k-1), D(k)        the isobar wanders                   BetweenFactorDouble
    standing still  B(k)                mean yaw rate of a rest is the bias  PriorFactorDouble
    anchor          X(k)                a known place, Huber                 PoseTranslationPrior2D
    closed walk     X(K)                the end is the start                 PoseTranslationPrior2D
    closure         X(i), X(j)          the same place again, Cauchy         BetweenFactorPose2

A Pose2's yaw is additive in its tangent space, so the linear heading factor is exact, not an approximation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, D, X, Z

from fbgraph.core.aids import Aids
from fbgraph.core.config import GraphConfig
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.aid_factors import add_aids
from fbgraph.estimators.altitude_chain import AltitudeChain
from fbgraph.estimators.magnetic_field import FieldMemory
from fbgraph.estimators.noise_models import FIXED, FREE_RAD, sigmas
from fbgraph.front_end.step_track import Step, StepTrack
from fbgraph.way_back.records import Closure

_FREE_M = 1000.0
_YAW_ROW = np.array([[0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class Node:
    """A value of every state of one breadcrumb."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    bias_rad_s: float
    isobar_m: float = 0.0

    @property
    def pose(self) -> gtsam.Pose2:
        """As a gtsam.Pose2."""
        return gtsam.Pose2(self.x_m, self.y_m, self.yaw_rad)


class GraphBuilder:
    """Turns steps into factors and first values, one step at a time, for batch and online alike.

    It keeps only what a step's factors need from the steps before: the last step and the field's recent usual.
    """

    def __init__(self, config: GraphConfig, aids: Aids, compass: bool) -> None:
        """A builder for one walk.

        Args:
            config: weights.
            aids: where places are known the first breadcrumb is not the origin, and the steps may stretch by the error
                they share, as no node carries it.
            compass: whether the first step has one; else the first direction is the reference of all others.
        """
        self._config = config
        self._aids = aids
        self._compass = compass
        aided = aids.places_known or aids.closed_walk
        shared = config.sigma_length_scale * math.sqrt(config.aided_length_steps) if aided else 0.0
        self._sigma_length_rel = math.hypot(config.sigma_length_rel, shared)
        self._k = -1
        self._previous: Step | None = None
        self._field = FieldMemory(config.norm_scale_ut, config.dip_scale_rad)
        self._altitude = AltitudeChain(config)
        self._huber = gtsam.noiseModel.mEstimator.Huber

    def add(
        self,
        step: Step,
        node: Node,
        previous_node: Node | None,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
    ) -> None:
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
        values.insert(D(k), node.isobar_m)
        if previous is None or previous_node is None:
            self._add_start(node, graph)
        else:
            self._add_length(k, step, previous, graph)
            self._add_heading(k, step, previous, node, previous_node, graph)
        self._add_compass(k, step, graph)
        self._altitude.add(k, step, previous, graph)
        self._previous = step

    def _add_start(self, node: Node, graph: gtsam.NonlinearFactorGraph) -> None:
        sigma = _FREE_M if self._aids.places_known else FIXED
        graph.push_back(gtsam.PoseTranslationPrior2D(X(0), gtsam.Pose2(), sigmas(sigma, sigma)))
        graph.push_back(gtsam.PriorFactorDouble(B(0), 0.0, sigmas(self._config.sigma_bias_rad_s)))
        sigma = FREE_RAD if self._compass or self._aids.direction_known else FIXED
        graph.push_back(gtsam.PoseRotationPrior2D(X(0), gtsam.Rot2(node.yaw_rad), sigmas(sigma)))

    def _add_length(self, k: int, step: Step, previous: Step, graph: gtsam.NonlinearFactorGraph) -> None:
        config = self._config
        along = math.hypot(
            self._sigma_length_rel * step.length_m, config.sigma_slope_rel * step.shortened_m, step.doubt_m
        )
        across, turn = math.hypot(config.sigma_lateral_m, step.doubt_m), FREE_RAD
        if not step.chained:
            silent_s = step.t_s - previous.t_s
            along = across = config.sigma_gap_m_s * silent_s
            turn = min(config.sigma_gap_yaw_rad_s * silent_s, math.pi)
        graph.push_back(
            gtsam.BetweenFactorPose2(X(k), X(k - 1), gtsam.Pose2(-step.length_m, 0.0, 0.0), sigmas(along, across, turn))
        )

    def _add_heading(
        self, k: int, step: Step, previous: Step, node: Node, previous_node: Node, graph: gtsam.NonlinearFactorGraph
    ) -> None:
        config = self._config
        dt_s = step.yaw_s - previous.yaw_s
        if step.chained:
            increment = step.yaw_gyro_rad - previous.yaw_gyro_rad
            graph.push_back(heading_factor(k, increment, dt_s, config.sigma_yaw_step_rad, node, previous_node))
        drift = config.sigma_bias_walk_rad_s * math.sqrt(max(dt_s, 1e-3))
        graph.push_back(gtsam.BetweenFactorDouble(B(k - 1), B(k), 0.0, sigmas(drift)))
        if step.rest_s > 0:
            graph.push_back(gtsam.PriorFactorDouble(B(k), step.rest_rate_rad_s, sigmas(step.rest_sigma_rad_s)))

    def _add_compass(self, k: int, step: Step, graph: gtsam.NonlinearFactorGraph) -> None:
        if not math.isfinite(step.yaw_mag_rad):
            return
        config = self._config
        sigma = config.sigma_mag_rad * math.sqrt(self._field.inflation(step))
        # compass errors are those of the place: N correlated steps know as much as N (1 - a) / (1 + a) free ones
        # (information of a first-order Gauss-Markov process with a = exp(-L / correlation length))
        a = math.exp(-max(step.length_m, 0.05) / config.mag_correlation_m)
        inflation = math.sqrt((1.0 + a) / (1.0 - a))
        huber = self._huber.Create(config.mag_huber / inflation)
        model = gtsam.noiseModel.Robust.Create(huber, sigmas(sigma * inflation))
        graph.push_back(gtsam.PoseRotationPrior2D(X(k), gtsam.Rot2(step.yaw_mag_rad), model))


def build_graph(
    track: StepTrack, seed: Trajectory, config: GraphConfig, aids: Aids, closures: Sequence[Closure] = ()
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The graph of a whole walk, and the first values of its nodes.

    Args:
        track: the steps.
        seed: a trajectory near the answer, where the solver starts and headings are linearised.
        config: weights.
        aids: anchors and a closed end.
        closures: breadcrumbs at the places of earlier ones.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    builder = GraphBuilder(config, aids, compass=bool(np.isfinite(track.yaw_mag_rad[1])))
    columns = np.column_stack((seed.x_m, seed.y_m, seed.z_m, seed.yaw_rad, seed.gyro_bias_rad_s))
    previous = None
    for step, row in zip(track.steps, columns.tolist(), strict=True):
        node = Node(*row)
        builder.add(step, node, previous, graph, values)
        previous = node
    add_aids(graph, track, aids, closures, config)
    return graph, values


def heading_factor(
    k: int, increment_rad: float, dt_s: float, sigma_rad: float, node: Node, previous: Node
) -> gtsam.LinearContainerFactor:
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
        sigmas(sigma_rad),
    )
    point = gtsam.Values()
    point.insert(X(k - 1), previous.pose)
    point.insert(X(k), node.pose)
    point.insert(B(k), node.bias_rad_s)
    return gtsam.LinearContainerFactor(jacobian, point)
