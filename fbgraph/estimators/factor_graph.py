"""The factor graph: what each step says about the breadcrumbs. Builds factors, never solves.

Node k is a breadcrumb: X(k) Pose2 (x, y, yaw), Z(k) altitude, B(k) the gyroscope's bias about the vertical and its
scale, D(k) drift of air pressure: the height of the isobar that ran through the start. A levelled pedestrian has four
degrees of freedom; Pose3 would add two that nothing measures. X(k)'s yaw is the mean walking direction of the step that
ends at k, so "moved L forward" holds in the frame of k. I(j) is the device's own iron and the usual horizontal strength
of the field, one for each stretch between recalibrations of the magnetometer:

    step length     X(k), X(k-1)        kTk-1 = (-L_k, 0), yaw free          BetweenFactorPose2
    heading         X(k-1), X(k), B(k)  Δyaw + b t + s g = g, gyroscope      LinearContainerFactor(JacobianFactor)
    bias walk       B(k-1), B(k)        bias and scale drift slowly          BetweenFactorVector
    standing still  B(k)                mean yaw rate of a rest is the bias  LinearContainerFactor(JacobianFactor)
    compass         X(k), I(j)          yaw and strength without the iron    LinearContainerFactor(JacobianFactor)
    iron            I(j)                little, Student's t                  PriorFactorVector
    recalibration   I(j-1), I(j)        the iron jumps as was seen           BetweenFactorVector
    barometer       D(k), Z(k)          altitude above the isobar, Huber     BetweenFactorDouble
    climb           Z(k-1), Z(k)        ~0 in one step                       BetweenFactorDouble
    weather         D(k-1), D(k)        the isobar wanders                   BetweenFactorDouble
    anchor          F(0), X(k)          a known place of their frame, Huber  BetweenFactorPose2
    frame's turn    F(0)                usually none, Cauchy                 PoseRotationPrior2D
    closed walk     X(K)                the end is the start                 PoseTranslationPrior2D
    closure         X(i), X(j), L(0)    the same place, L beside it          LinearContainerFactor(JacobianFactor)
    aside           L(0)                ~0 for a way back, Cauchy            PriorFactorDouble

A Pose2's yaw is additive in its tangent space, so the linear heading factor is exact, not an approximation. The compass
is robust by weights and sigmas that are computed beforehand (``heading_chain``): GTSAM has no robust linear factor.
"""

from __future__ import annotations

import math

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, I, X

from fbgraph.core.aids import Aids
from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.aid_factors import add_aids
from fbgraph.estimators.altitude_chain import AltitudeChain, with_gusts_foreseen
from fbgraph.estimators.compass_factors import UNIT_UT, compass_factors, iron_factor, recalibration_factor
from fbgraph.estimators.gyroscope import GyroTurn, gyro_turn
from fbgraph.estimators.heading_chain import HeadingSolution
from fbgraph.estimators.node import Node
from fbgraph.estimators.noise_models import FIXED, FREE_RAD, sigmas
from fbgraph.front_end.step_track import Step, StepTrack

_YAW_ROW = np.array([[0.0, 0.0, 1.0]])
_BACK_ROW = -_YAW_ROW
_ZEROS = np.zeros(2)
_BIAS_ROW = np.array([[1.0, 0.0]])
_SCALE_WALK = 1e-5  # of the scale from step to step: none, but a system that is well conditioned


class GraphBuilder:
    """Turns steps into factors and first values, one step at a time, for batch and online alike.

    It keeps only what a step's factors need from the steps before: the last step. What the compass says is added with
    ``compass_factors``, as it is to be said anew when more is known of the device's own iron.
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
        self.compass = compass
        aided = aids.places_known or aids.closed_walk
        shared = config.sigma_length_scale * math.sqrt(config.aided_length_steps) if aided else 0.0
        self._sigma_length_rel = math.hypot(config.sigma_length_rel, shared)
        self._k = -1
        self._previous: Step | None = None
        self._altitude = AltitudeChain(config)

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
        node.insert_into(values, k)
        if previous is None or previous_node is None:
            self._add_start(node, graph)
        else:
            self._add_length(k, step, previous, graph)
            self._add_heading(k, step, previous, node, previous_node, graph)
        self._altitude.add(k, step, previous, graph)
        self._previous = step

    def rewind(self, k: int, previous: Step | None) -> None:
        """Go on anew with breadcrumb ``k``, after the step ``previous``."""
        self._k, self._previous = k - 1, previous

    def _add_start(self, node: Node, graph: gtsam.NonlinearFactorGraph) -> None:
        graph.push_back(gtsam.PoseTranslationPrior2D(X(0), gtsam.Pose2(), sigmas(FIXED, FIXED)))
        model = sigmas(self._config.sigma_bias_rad_s, self._config.sigma_gyro_scale)
        graph.push_back(gtsam.PriorFactorVector(B(0), np.zeros(2), model))
        sigma = FREE_RAD if self.compass else FIXED
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
        graph.add(
            gtsam.BetweenFactorPose2(X(k), X(k - 1), gtsam.Pose2(-step.length_m, 0.0, 0.0), sigmas(along, across, turn))
        )

    def _add_heading(
        self, k: int, step: Step, previous: Step, node: Node, previous_node: Node, graph: gtsam.NonlinearFactorGraph
    ) -> None:
        config = self._config
        turn = gyro_turn(previous, step, config)
        if step.chained:
            graph.add(heading_factor(k, turn, node, previous_node))
        model = sigmas(turn.drift_rad_s, _SCALE_WALK)
        graph.add(gtsam.BetweenFactorVector(B(k - 1), B(k), _ZEROS, model))
        if step.rest_s > 0:
            graph.push_back(rest_factor(k, step, node))


def build_graph(
    track: StepTrack,
    seed: Trajectory,
    heading: HeadingSolution,
    config: GraphConfig,
    aids: Aids,
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The graph of a whole walk, and the first values of its nodes.

    Args:
        track: the steps.
        seed: a trajectory near the answer, where the solver starts and headings are linearised.
        heading: what is known of the device's iron and the gyroscope's scale, and which stretches to tell apart.
        config: weights.
        aids: anchors and a closed end.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    builder = GraphBuilder(config, aids, compass=bool(np.isfinite(track.yaw_mag_rad[1])))
    isobar_m = -np.cumsum(track.blown_m)  # near enough to start from
    columns = np.column_stack((seed.x_m, seed.y_m, seed.z_m, seed.yaw_rad, seed.gyro_bias_rad_s, isobar_m))
    previous = None
    for step, row in zip(with_gusts_foreseen(track.steps), columns.tolist(), strict=True):
        x_m, y_m, z_m, yaw_rad, bias_rad_s, near_m = row
        node = Node(x_m, y_m, z_m, yaw_rad, bias_rad_s, near_m, heading.gyro_scale)
        builder.add(step, node, previous, graph, values)
        previous = node
    known = np.isfinite(track.yaw_mag_rad)
    if known.any():
        _add_compass(graph, values, np.flatnonzero(known), seed.yaw_rad[known], heading, config)
    add_aids(graph, values, track, aids, config)
    return graph, values


def _add_compass(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    k: IntArray,
    yaw_rad: FloatArray,
    heading: HeadingSolution,
    config: GraphConfig,
) -> None:
    """Add what the compass said on a whole walk, and the iron of its device.

    Args:
        graph, values: extended in place.
        k: (N,) breadcrumbs of which the magnetometer was heard.
        yaw_rad: (N,) their headings, where the factors are linearised and judged.
        heading: readings and iron.
        config: weights.
    """
    for j, iron_ut in enumerate(heading.iron_ut):
        values.insert(I(j), iron_ut / UNIT_UT)
        graph.push_back(iron_factor(j, iron_ut, heading.usual_ut, config))
        if j > 0:
            graph.push_back(recalibration_factor(j, heading.jumps_ut[j - 1], config.sigma_iron_jump_ut))
    stretch = heading.stretch[k]
    for factor in compass_factors(k, heading.readings, yaw_rad, stretch, heading.iron_ut[stretch], config):
        graph.push_back(factor)


def heading_factor(k: int, turn: GyroTurn, node: Node, previous: Node) -> gtsam.LinearContainerFactor:
    """The EKF's prediction as a factor: (θ_k - θ_{k-1}) + b_k t + s g = g, what the gyroscope turned.

    Args:
        k: index of the later breadcrumb.
        turn: by the gyroscope, between the middles of the two steps.
        node, previous: linearisation point; the true yaw must lie within π of it, nothing else depends on it.
    """
    by_gyroscope = np.array([[turn.moving_s, turn.turned_rad]])
    biased = turn.moving_s * node.bias_rad_s + turn.turned_rad * node.gyro_scale
    right = np.array([turn.turned_rad - (node.yaw_rad - previous.yaw_rad) - biased])
    model = sigmas(turn.sigma_rad)
    jacobian = gtsam.JacobianFactor(X(k - 1), _BACK_ROW, X(k), _YAW_ROW, B(k), by_gyroscope, right, model)
    point = gtsam.Values()
    point.insert_or_assign(X(k - 1), pose2=previous.pose)
    point.insert_or_assign(X(k), pose2=node.pose)
    point.insert(B(k), node.gyroscope)
    return gtsam.LinearContainerFactor(jacobian, point)


def rest_factor(k: int, step: Step, node: Node) -> gtsam.LinearContainerFactor:
    """The mean yaw rate of a rest is the bias."""
    residual = np.array([step.rest_rate_rad_s - node.bias_rad_s])
    jacobian = gtsam.JacobianFactor(B(k), _BIAS_ROW, residual, sigmas(step.rest_sigma_rad_s))
    point = gtsam.Values()
    point.insert(B(k), node.gyroscope)
    return gtsam.LinearContainerFactor(jacobian, point)
