"""Noise models that the factors share."""

from __future__ import annotations

from functools import lru_cache

import gtsam
import numpy as np

FREE_RAD = 100.0
"""A standard deviation that says nothing, yet keeps the system well conditioned."""
FIXED = 1e-3
"""Metres and radians; a standard deviation of what is known, as the origin is."""
HUBER = 1.345
"""Threshold of Huber's loss: 95 % efficient where errors are normal."""


@lru_cache(maxsize=512)  # most steps have the same
def sigmas(*values: float) -> gtsam.noiseModel.Diagonal:
    """A diagonal noise model of these standard deviations."""
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))


def huber(bend: float, *values: float) -> gtsam.noiseModel.Robust:
    """The same, counted linearly beyond ``bend`` of them."""
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Huber.Create(bend), sigmas(*values))
