"""Trees of iSAM2, and what is left of breadcrumbs that leave one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import gtsam
import numpy as np

from fbgraph.core.config import OnlineConfig
from fbgraph.core.errors import EstimationError

_KEEP = 1e6  # a relinearisation threshold that is never reached: positions and biases are linear given yaw
_ANCHORED_M = 0.5  # but how far a robust anchor is believed depends on the place
_AIRED_M = 0.2  # and how far a robust barometer is on the altitude


def new_tree(config: OnlineConfig, *, by_qr: bool, places_known: bool) -> gtsam.ISAM2:
    """An empty tree that relinearises on yaw and altitude alone: positions and biases are linear given yaw.

    Args:
        config: iSAM2's thresholds.
        by_qr: whether to eliminate by QR instead of Cholesky.
        places_known: whether anchors will come: then places are no longer linear given yaw.
    """
    params = gtsam.ISAM2Params()
    if by_qr:
        params.setFactorization("QR")
    gauss_newton = gtsam.ISAM2GaussNewtonParams()
    gauss_newton.setWildfireThreshold(config.wildfire)
    params.setOptimizationParams(gauss_newton)
    thresholds = gtsam.ISAM2ThresholdMap()
    place = _ANCHORED_M if places_known else _KEEP
    thresholds.insert(("x", np.array([place, place, config.relinearize_yaw_rad])))
    thresholds.insert(("z", np.array([_AIRED_M])))
    thresholds.insert(("b", np.array([_KEEP, _KEEP])))
    thresholds.insert(("i", np.array([_KEEP, _KEEP, _KEEP])))
    thresholds.insert(("d", np.array([_AIRED_M])))
    params.setRelinearizeThreshold(thresholds)
    params.relinearizeSkip = config.relinearize_skip
    return gtsam.ISAM2(params)


@contextmanager
def solving(where: str) -> Iterator[None]:
    """Says where iSAM2 failed.

    Raises:
        EstimationError: it did.
    """
    try:
        yield
    except RuntimeError as error:
        raise EstimationError(f"iSAM2 failed at {where}: {str(error).strip().splitlines()[0]}") from error


def eliminated(
    graph: gtsam.NonlinearFactorGraph,
    gone: gtsam.Ordering,
    kept: Mapping[int, int],
    at: gtsam.Values,
    *,
    by_qr: bool,
) -> gtsam.NonlinearFactorGraph:
    """What factors say of some of their states once the others are gone; exact, to first order.

    Args:
        graph: the factors.
        gone: the others, in the order in which to eliminate them; extended if by QR.
        kept: the states that stay, of so many numbers each.
        at: where to linearise.
        by_qr: by one dense QR decomposition, which sees a thread that Cholesky does not.
    """
    linear, prior = graph.linearize(at), gtsam.NonlinearFactorGraph()
    if not by_qr:
        _, remaining = linear.eliminatePartialSequential(gone)
        for i in range(remaining.size()):
            prior.push_back(gtsam.LinearContainerFactor(remaining.at(i), at))
        return prior
    for key in kept:
        gone.push_back(key)
    a, b = linear.jacobian(gone)
    size = sum(kept.values())
    triangle = np.asarray(np.linalg.qr(np.column_stack((a, b)), mode="r"))
    left = triangle[: a.shape[1]][-size:]
    columns = np.split(left[:, -size - 1 : -1], np.cumsum([*kept.values()])[:-1], axis=1)
    terms = list(zip(kept, columns, strict=True))
    # the one class that takes any number of terms; a conditional of all of them is a factor on them
    factor = gtsam.GaussianConditional(terms, len(terms), left[:, -1], gtsam.noiseModel.Unit.Create(size))
    prior.push_back(gtsam.LinearContainerFactor(gtsam.JacobianFactor(factor), at))
    return prior
