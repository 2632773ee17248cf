"""The axis of a building from walks in it, of which no truth is known.

Each walk says how likely its straight legs are for every axis, modulo 90°, whichever heading offset it has
(``building_axis``, with offsets as wide as whole walks show); one in five may follow no axis at all. Walks are
independent, so their evidence multiplies; against it stands that none of them follows any axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.building_axis import OFFSETS_RAD, WALK_RAD, Legs, fold

_FOLLOWS = 0.8  # of the walks
_RESAMPLED = 200
_LEAST_SIGMA_RAD = math.radians(0.5)  # of the grid, and of what is built


@dataclass(frozen=True)
class LearnedAxis:
    """An axis and how sure it is.

    Attributes:
        yaw_rad: counter-clockwise from East, in [-45°, 45°).
        sigma_rad: standard deviation: of the evidence, or of the answers of other choices of as many walks.
        log_odds: logarithm of how much likelier the walks are if they have one axis in common than if they have none.
    """

    yaw_rad: float
    sigma_rad: float
    log_odds: float


def votes_of(legs: Legs) -> FloatArray:
    """(G,) logarithm of how much likelier a walk's legs are if its building's axis is each of ``OFFSETS_RAD``.

    Against legs that lie anywhere; zeros of a walk without a straight leg.
    """
    likelihood = legs.likelihood(0.0)
    turns = fold(
        OFFSETS_RAD[:, None] + OFFSETS_RAD
    )  # an axis at a, and a walk that must be turned by d to lie along it
    prior = np.exp(-0.5 * (turns / WALK_RAD) ** 2)
    evidence = prior @ likelihood / (prior.sum(axis=1) * float(likelihood.mean()))
    return np.asarray(np.log(_FOLLOWS * evidence + (1.0 - _FOLLOWS)))


def learn_axis(votes: Sequence[FloatArray]) -> LearnedAxis:
    """The axis that walks have in common.

    Args:
        votes: of each walk, from ``votes_of``; at least one.
    """
    each = np.array(votes)
    whole = each.sum(axis=0)
    evidence = np.exp(whole - whole.max())
    best = float(OFFSETS_RAD[int(whole.argmax())])
    off_rad = fold(OFFSETS_RAD - best)
    mean = float((evidence * off_rad).sum() / evidence.sum())
    spread = float((evidence * (off_rad - mean) ** 2).sum() / evidence.sum())
    counts = np.random.default_rng(0).multinomial(len(each), np.full(len(each), 1.0 / len(each)), size=_RESAMPLED)
    others = fold(OFFSETS_RAD[(counts @ each).argmax(axis=1)] - best)
    sigma_rad = math.sqrt(max(spread, float((others**2).mean()), _LEAST_SIGMA_RAD**2))
    log_odds = float(whole.max()) + math.log(float(evidence.mean()))
    return LearnedAxis(float(fold(np.array(best + mean))), sigma_rad, log_odds)
