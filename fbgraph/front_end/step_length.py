"""How long a step is on the level, by its rhythm and by how much it surges.

    L = α + β f + β₂ f² + κ √min(v, v₀)

α + β f is the paper's (section Parameter Selection). The rest is ours. At every step the body slows down as the foot
lands and speeds up as it pushes off: v, the surge, is how much its horizontal speed goes to and fro, and who shuffles
hardly surges. A root of what the body does in a step gives its length since Weinberg (Analog Devices AN-602, 2002: the
fourth root of how far the vertical acceleration goes); but a hand that holds a phone loosely doubles what is vertical
and leaves the horizontal alone, so the same v serves in hand, on the chest, in a bag and in a pocket. It saturates at
v₀, for a limb swings more than its wearer surges.

Fitted to 92 real walks (museum of ipin2023, indoor-location site 1, RIDI's hand and chest), each kind of walk with the
same weight; the mean RMSE of the smoother's headings with these lengths, in metres, and RIDI's distances:

    each floor or walk left out      museum 1.73, shopping centre 4.03, RIDI within 3 % (bag 5 %, leg 3 %)
    each data set left out           museum 1.95, shopping centre 4.20, RIDI within 10 %
    α + β f + κ bounce^(1/4), refitted, the same:             1.86, 5.14, 12 %
    α + β f + β₂ f² + κ √(vertical speed), the same:          3.39, 11.3, 33 %
"""

from __future__ import annotations

import math

import numpy as np

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import FloatArray, mean_of

FULL_SURGE_M_S = 0.2
"""v₀; also that of a step whose surge is not known."""
FITTED_HZ = (1.1, 2.4)
"""Cadences at which step lengths were measured; nobody knows the runner's and the groper's."""
FITTED_SURGE_M_S = 1.0
"""The most that was seen at a step of known length, on a leg."""


def flat_length_m(config: StepLengthConfig, frequency_hz: float, surge_m_s: float) -> float:
    """Length of a step on the level."""
    f = cadence_of(config, frequency_hz)
    paper_m = config.alpha_m + config.beta_m_s * f
    return float(paper_m + config.beta2_m_s2 * f**2 + config.kappa_surge * min(surge_m_s, FULL_SURGE_M_S) ** 0.5)


def cadence_of(config: StepLengthConfig, frequency_hz: float) -> float:
    """The f of a step: a cadence beyond those measured counts as the nearest, but in the paper's line."""
    if config.beta2_m_s2 != 0.0:
        return min(max(frequency_hz, FITTED_HZ[0]), FITTED_HZ[1])
    # a length that shrinks with cadence does so within the cadences it was measured at
    most_hz = FITTED_HZ[1] if config.beta_m_s < 0.0 else math.inf
    return min(frequency_hz, most_hz)


def surge_of(acc_level_m_s2: FloatArray, rate_hz: float) -> float:
    """Peak to peak of the horizontal speed about its mean, as a sinusoid of the same power has it, m/s.

    Args:
        acc_level_m_s2: (N, 2) horizontal acceleration of one step, whose mean (the walker's, and a device's that is
            not quite levelled) is taken out.
        rate_hz: of the samples.
    """
    speed = np.add.accumulate(acc_level_m_s2 - mean_of(acc_level_m_s2), axis=0) / rate_hz
    speed -= mean_of(speed)
    ahead, aside = mean_of(speed * speed).tolist()
    return math.sqrt(8.0 * (ahead + aside))
