"""Noise models that the factors share."""

from __future__ import annotations

from functools import lru_cache

import gtsam
import numpy as np

FREE_RAD = 100.0
"""A standard deviation that says nothing, yet keeps the system well conditioned."""
HUBER = 1.345
"""Threshold of Huber's loss: 95 % efficient where errors are normal."""


@lru_cache(maxsize=512)  # most steps have the same
def sigmas(*values: float) -> gtsam.noiseModel.Diagonal:
    """A diagonal noise model of these standard deviations."""
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))
