"""What each factor of a solved graph still has to complain about, and how far a robust loss has silenced it.

A residual is the estimate minus the measurement, divided by the factor's standard deviation: within ±2 is what its
sigma promised. A robust factor's weight (of Huber's or Cauchy's loss) says which share of its pull was left: 1 all of
it, 0.3 a third.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.estimates import FACTOR_KINDS, Residuals

_Z, _D = ord("z"), ord("d")  # of altitude nodes, and of the isobar's


def factor_residuals(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> tuple[Residuals, ...]:
    """Residuals of every factor, by kind; kinds that the graph lacks are left out.

    Args:
        graph: built by ``build_graph``.
        values: where to evaluate it: the solution.
    """
    rows: dict[str, list[tuple[int, float, float]]] = {name: [] for name in FACTOR_KINDS}
    for i in range(graph.size()):
        factor = graph.at(i)
        keys = [gtsam.Symbol(key) for key in factor.keys()]  # noqa: SIM118  a factor is no mapping
        k = max(key.index() for key in keys)
        kind, whitened, weight = type(factor).__name__, *_whitened(factor, values)
        consecutive = len(keys) > 1 and abs(keys[0].index() - keys[1].index()) == 1
        if kind == "BetweenFactorPose2" and consecutive:
            # the factor sees k-1 from k, where forward is negative
            rows["step_length"].append((k, -float(whitened[0]), weight))
            rows["step_sideways"].append((k, -float(whitened[1]), weight))
        elif (name := _name(kind, keys, k, factor)) is not None:
            value = float(whitened[0]) if len(whitened) == 1 else float(np.hypot(whitened[0], whitened[1]))
            rows[name].append((k, value, weight))
    return tuple(
        Residuals(name, table[:, 0].astype(np.int64), table[:, 1], table[:, 2])
        for name, table in ((name, np.array(row)) for name, row in rows.items() if row)
    )


def _name(kind: str, keys: Sequence[gtsam.Symbol], k: int, factor: Any) -> str | None:
    """Which row of the graph's table a factor is; None for the priors that fix the origin."""
    states = [key.chr() for key in keys]
    if kind == "PoseTranslationPrior2D":
        if _is_robust(factor):
            return "anchor"
        return "closed_walk" if k > 0 else None
    if kind == "PriorFactorDouble":
        if k == 0:  # the bias drifts from zero to its first value
            return None if states[0] in (_Z, _D) else "bias_drift"
        return "standing_still"
    if kind == "BetweenFactorDouble":
        if _Z in states:
            return "barometer" if _D in states else "climb"
        return "weather" if _D in states else "bias_drift"
    if kind == "PoseRotationPrior2D":
        return "compass" if k > 0 else None
    return {"BetweenFactorPose2": "closure", "LinearContainerFactor": "heading"}.get(kind)


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
