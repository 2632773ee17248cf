"""What each factor of a solved graph still has to complain about, and how far a robust loss has silenced it.

A residual is the estimate minus the measurement, divided by the factor's standard deviation: within ±2 is what its
sigma promised. A robust factor's weight (of Huber's or Cauchy's loss) says which share of its pull was left: 1 all of
it, 0.3 a third.
"""

from __future__ import annotations

from typing import Any

import gtsam
import numpy as np

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.compass import compass_residuals
from fbgraph.estimators.estimates import FACTOR_KINDS, Residuals
from fbgraph.estimators.heading_chain import HeadingSolution
from fbgraph.front_end.step_track import StepTrack

_X, _Z, _B, _D, _I, _F, _L = (ord(letter) for letter in "xzbdifl")  # states


def compass_table(
    track: StepTrack, trajectory: Trajectory, heading: HeadingSolution, config: GraphConfig
) -> tuple[Residuals, ...]:
    """Residuals of compass and field strength, whose robust loss stands in their weights and not in the graph.

    Args:
        track: the steps.
        trajectory: the solution.
        heading: the same's iron.
        config: weights.
    """
    k = np.flatnonzero(np.isfinite(track.yaw_mag_rad))
    if len(k) == 0:
        return ()
    iron_ut = heading.iron_ut[heading.stretch[k]]
    off = compass_residuals(heading.readings, trajectory.yaw_rad[k], iron_ut, config)
    return (
        Residuals("compass", k, off.across_rad / heading.readings.sigma_rad, off.across_weight),
        Residuals("field_strength", k, off.strength_rel / heading.readings.sigma_rad, off.strength_weight),
    )


def factor_residuals(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, others: tuple[Residuals, ...] = ()
) -> tuple[Residuals, ...]:
    """Residuals of every factor, by kind; kinds that the graph lacks are left out.

    Args:
        graph: built by ``build_graph``.
        values: where to evaluate it: the solution.
        compass: from ``compass_table``.
    """
    rows: dict[str, list[tuple[int, float, float]]] = {name: [] for name in FACTOR_KINDS}
    for i in range(graph.size()):
        factor = graph.at(i)
        keys = list(map(gtsam.Symbol, factor.keys()))
        k = max(key.index() for key in keys)
        kind, states = type(factor).__name__, {key.chr() for key in keys}
        if _I in states:
            continue  # the compass: see ``compass_table``
        if _L in states or states == {_F}:
            continue  # closures are weighed by themselves; how the anchors' frame lies is no complaint
        whitened, weight = _whitened(factor, values)
        consecutive = _F not in states and len(keys) > 1 and abs(keys[0].index() - keys[1].index()) == 1
        if kind == "BetweenFactorPose2" and consecutive:
            # the factor sees k-1 from k, where forward is negative
            rows["step_length"].append((k, -float(whitened[0]), weight))
            rows["step_sideways"].append((k, -float(whitened[1]), weight))
        elif (name := "anchor" if _F in states else _name(kind, states, k, factor)) is not None:
            # of the gyroscope the bias, of a place how far
            single = len(whitened) == 1 or _B in states
            value = float(whitened[0]) if single else float(np.hypot(whitened[0], whitened[1]))
            rows[name].append((k, value, weight))
    tables = {name: np.array(row) for name, row in rows.items() if row}
    found = {name: Residuals(name, t[:, 0].astype(np.int64), t[:, 1], t[:, 2]) for name, t in tables.items()}
    found |= {table.name: table for table in others}
    return tuple(found[name] for name in FACTOR_KINDS if name in found)


def _name(kind: str, states: set[int], k: int, factor: Any) -> str | None:
    """Which row of the graph's table a factor is; None for the priors that fix the origin."""
    if kind == "PoseTranslationPrior2D":
        if _is_robust(factor):
            return "anchor"
        return "closed_walk" if k > 0 else None
    if kind == "PriorFactorDouble":
        return None
    if kind == "LinearContainerFactor":
        return "heading" if _X in states else "standing_still"
    if kind == "BetweenFactorDouble":
        if _Z in states:
            return "barometer" if _D in states else "climb"
        return "weather"
    # the bias drifts from zero to its first value
    return {
        "BetweenFactorPose2": "closure",
        "BetweenFactorVector": "bias_drift",
        "PriorFactorVector": "bias_drift",
    }.get(kind)


def _is_robust(factor: Any) -> bool:
    return hasattr(factor, "noiseModel") and isinstance(factor.noiseModel(), gtsam.noiseModel.Robust)


def _whitened(factor: Any, values: gtsam.Values) -> tuple[FloatArray, float]:
    """The error in standard deviations and its robust weight."""
    if not hasattr(factor, "unwhitenedError"):  # a linear container: its right-hand side is the negative error
        linear = factor.linearize(values)
        return -linear.get_model().whiten(linear.getb()), 1.0
    model, error = factor.noiseModel(), factor.unwhitenedError(values)
    if isinstance(model, gtsam.noiseModel.Robust):
        whitened = model.noise().whiten(error)
        loss: Any = model.robust()  # the stubs' base class knows no weight
        return whitened, float(loss.weight(float(np.linalg.norm(whitened))))
    return model.whiten(error), 1.0
