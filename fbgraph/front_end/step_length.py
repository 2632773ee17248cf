"""How long a step is by its rhythm and bounce."""

from __future__ import annotations

from fbgraph.core.config import StepLengthConfig


def flat_length_m(config: StepLengthConfig, frequency_hz: float, bounce_m_s2: float) -> float:
    """Length of a step on the level: α + β f (paper) + κ bounce^(1/4) (Weinberg)."""
    return float(config.alpha_m + config.beta_m_s * frequency_hz + config.kappa * bounce_m_s2**0.25)
