"""Walks given to a window of iSAM2 step by step, and their graph at once."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import gtsam
import numpy as np

from fbgraph.core.aids import Aids
from fbgraph.core.checkpoints import anchor_breadcrumbs
from fbgraph.core.config import GraphConfig, OnlineConfig
from fbgraph.estimators.aid_factors import anchor_factor
from fbgraph.estimators.factor_graph import GraphBuilder, build_graph
from fbgraph.estimators.heading_chain import solve_heading
from fbgraph.estimators.isam_window import IsamWindow
from fbgraph.estimators.node import Node
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.records import Closure
from support.factors import Array, seed_of

CONFIG = GraphConfig()
EXACT = OnlineConfig(window_steps=10, relinearize_skip=1, relinearize_yaw_rad=1e-3, wildfire=1e-6)


def next_node(track: StepTrack, k: int, nodes: Sequence[Node]) -> Node:
    """Dead reckoning from the latest breadcrumb."""
    step = track.steps[k]
    if k == 0:
        return Node(0.0, 0.0, 0.0, float(track.yaw_mag_rad[1]), 0.0)
    last, before = nodes[-1], track.steps[k - 1]
    yaw = last.yaw_rad + step.yaw_gyro_rad - before.yaw_gyro_rad - last.bias_rad_s * (step.yaw_s - before.yaw_s)
    x_m, y_m = last.x_m + step.length_m * math.cos(yaw), last.y_m + step.length_m * math.sin(yaw)
    return Node(x_m, y_m, last.z_m, yaw, last.bias_rad_s)


def walked(
    track: StepTrack,
    online: OnlineConfig = EXACT,
    closures: Mapping[int, Closure] | None = None,
    aids: Aids | None = None,
    glimpse: bool = False,
    judged: Collection[int] = (),
    config: GraphConfig = CONFIG,
) -> IsamWindow:
    """A window after a walk.

    Args:
        track: the walk.
        online: size and thresholds.
        closures: each is given once the breadcrumb that is its key is in.
        aids: anchors.
        glimpse: whether to look at every step.
        judged: breadcrumbs at which it is asked whether the magnetometer's zero jumped, as online.
        config: weights of the graph.
    """
    aids = aids or Aids()
    window, builder = IsamWindow(online, config, aids.places_known), GraphBuilder(config, aids, compass=True)
    near = anchor_breadcrumbs(aids.anchors, track.t_s).tolist() if aids.anchors is not None else []
    for k, step in enumerate(track.steps):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        node = next_node(track, k, window.nodes)
        builder.add(step, node, window.nodes[-1] if k else None, graph, values)
        for i in (i for i, at in enumerate(near) if at == k and aids.anchors is not None):
            assert aids.anchors is not None
            graph.push_back(anchor_factor(aids.anchors, i, k, step, config))
        window.add(graph, values, node, step)
        window.close([closures[k]] if closures and k in closures else [])
        if k in judged:
            known, first = window.refresh()[window.first :], window.first
            seed = np.array([node.yaw_rad for node in known]), np.array([node.bias_rad_s for node in known])
            heading = solve_heading(StepTrack(track.steps[first : k + 1]), [seed], config)
            if len(heading.jumps_ut) or window.misjudged(heading):
                window.recalibrate(heading)
        if glimpse:
            window.glimpse()
    return window


def batch_graph(
    track: StepTrack, yaw_rad: Array, aids: Aids | None = None
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """The graph of a whole walk, its compass made where the headings alone see it."""
    seed = seed_of(track, yaw_rad)
    heading = solve_heading(track, [(yaw_rad, np.zeros(len(track)))], CONFIG)
    return build_graph(track, replace(seed, yaw_rad=heading.yaw_rad), heading, CONFIG, aids or Aids())
