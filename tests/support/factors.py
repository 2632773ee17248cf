"""Walks made by hand as graphs, and what a factor says, for tests that compute the same on paper."""

import math
from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np
import numpy.typing as npt
from gtsam.symbol_shorthand import B, D, I, X, Z

from fbgraph.core.aids import Aids
from fbgraph.core.config import GraphConfig
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.compass import compass_readings
from fbgraph.estimators.compass_factors import UNIT_UT, compass_factors, iron_factor
from fbgraph.estimators.factor_graph import GraphBuilder
from fbgraph.estimators.magnetic_field import FieldMemory
from fbgraph.estimators.node import Node
from fbgraph.front_end.step_track import Step, StepTrack
from support.by_hand import hand_step

Array = npt.NDArray[np.float64]
NAN = math.nan


def make_step(**given: Any) -> Step:
    """A step of 0.7 m, half a second long, in silence of every sensor but the gyroscope."""
    return hand_step(**({"length_m": 0.7} | given))


def stand(**given: Any) -> Step:
    """A standing start."""
    return make_step(**({"t_s": 0.0, "yaw_s": 0.0, "length_m": 0.0} | given))


def walk_track(
    yaw_rad: Sequence[float] | Array,
    compass: Sequence[float] | Array | None = None,
    length_m: float = 0.7,
    bias_rad_s: float = 0.0,
    dt_s: float = 0.5,
    altitude_m: Sequence[float] | Array | None = None,
    start: float = 0.4,
) -> StepTrack:
    """A walk of equal steps in these directions; its gyroscope starts at ``start`` and drifts by its bias."""
    steps = [
        stand(yaw_gyro_rad=yaw_rad[0] + start + bias_rad_s * 0.25, yaw_s=0.25)
        if k == 0
        else make_step(
            t_s=k * dt_s,
            start_s=(k - 1) * dt_s,
            yaw_s=(k - 0.5) * dt_s,
            length_m=length_m,
            yaw_gyro_rad=float(yaw_rad[k - 1]) + start + bias_rad_s * (k - 0.5) * dt_s,
            yaw_mag_rad=NAN if compass is None else float(compass[k - 1]),
            mag_norm_ut=NAN if compass is None else 48.0,
            mag_dip_rad=NAN if compass is None else 1.1,
            altitude_m=NAN if altitude_m is None else float(altitude_m[k - 1]),
        )
        for k in range(len(yaw_rad) + 1)
    ]
    return StepTrack(steps)


def graph_of(
    steps: Sequence[Step],
    config: GraphConfig | None = None,
    aids: Aids | None = None,
    compass: bool = True,
    nodes: Sequence[Node] | None = None,
) -> gtsam.NonlinearFactorGraph:
    """The factors of these steps, the compass linearised at the nodes and where the device has no iron."""
    config = config or GraphConfig()
    nodes = nodes or [Node(0.0, 0.0, 0.0, 0.0, 0.0)] * len(steps)
    builder = GraphBuilder(config, aids or Aids(), compass)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, step in enumerate(steps):
        builder.add(step, nodes[k], nodes[k - 1] if k else None, graph, values)
    assert values.size() == 4 * len(steps)
    known = [k for k, step in enumerate(steps) if math.isfinite(step.yaw_mag_rad)]
    if known:
        field = FieldMemory(config.norm_scale_ut, config.dip_scale_rad)
        readings = compass_readings([steps[k] for k in known], field, config)
        usual_ut = float(np.median(readings.level_ut))
        iron_ut = np.tile([0.0, 0.0, usual_ut], (len(known), 1))
        graph.push_back(iron_factor(0, iron_ut[0], usual_ut, config))
        yaw_rad, stretch = np.array([nodes[k].yaw_rad for k in known]), np.zeros(len(known), dtype=np.int64)
        for factor in compass_factors(np.array(known), readings, yaw_rad, stretch, iron_ut, config):
            graph.push_back(factor)
    return graph


def factors_of(graph: gtsam.NonlinearFactorGraph, kind: str, *keys: int) -> list[Any]:
    """The factors of a class on exactly these keys, in this order."""
    every = [graph.at(i) for i in range(graph.size())]
    return [f for f in every if type(f).__name__ == kind and tuple(f.keys()) == keys]


def the_factor(graph: gtsam.NonlinearFactorGraph, kind: str, *keys: int) -> Any:
    """The only one of them."""
    (factor,) = factors_of(graph, kind, *keys)
    return factor


def values_at(*nodes: tuple[float, ...], iron_ut: Sequence[float] | None = None) -> gtsam.Values:
    """Values of breadcrumbs 0, 1, …, each (x, y, z, yaw, bias) and, if it is not 0, the height of the isobar.

    The gyroscope's scale is right; iron and strength of the field are those of the first stretch.
    """
    values = gtsam.Values()
    for k, (x_m, y_m, z_m, yaw_rad, bias, *isobar_m) in enumerate(nodes):
        values.insert(X(k), gtsam.Pose2(x_m, y_m, yaw_rad))
        values.insert(Z(k), z_m)
        values.insert(B(k), np.array([bias, 0.0]))
        values.insert(D(k), isobar_m[0] if isobar_m else 0.0)
    if iron_ut is not None:
        values.insert(I(0), np.array(iron_ut) / UNIT_UT)
    return values


def sigmas_of(factor: Any) -> list[float]:
    """Standard deviations of a factor, under its robust loss if it has one."""
    model = factor.noiseModel()
    model = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
    return [float(sigma) for sigma in model.sigmas()]


def is_robust(factor: Any) -> bool:
    """Whether a factor has a robust loss."""
    return isinstance(factor.noiseModel(), gtsam.noiseModel.Robust)


def seed_of(track: StepTrack, yaw_rad: Array, bias_rad_s: float = 0.0) -> Trajectory:
    """A trajectory of a track's steps in these directions, one for the standing start too."""
    zeros = np.zeros(len(track))
    x_m = np.cumsum(track.length_m * np.cos(yaw_rad))
    y_m = np.cumsum(track.length_m * np.sin(yaw_rad))
    return Trajectory(track.t_s, x_m, y_m, zeros, yaw_rad, zeros + bias_rad_s)
