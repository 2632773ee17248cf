"""Steps unlike any that a calibrated step length was fitted to."""

from __future__ import annotations

import numpy as np

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.step_length import FULL_SURGE_M_S
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.finding import Finding

_FEW_STEPS, _FEW = 5, 0.05  # so many, or so much of the walk, is chance


def calibration_findings(track: StepTrack, config: StepLengthConfig) -> list[Finding]:
    """Sentences on steps outside the cadences and surges that ``fbgraph calibrate`` saw; none if it was not asked.

    Args:
        track: the steps.
        config: with which they were measured.
    """
    surge = np.minimum(track.surge_m_s[1:], FULL_SURGE_M_S)  # beyond that no step is taken for longer
    surges = tuple(min(edge, FULL_SURGE_M_S) for edge in config.calibrated_surge_m_s) if config.kappa_surge else ()
    return [
        *_outside(track, track.frequency_hz[1:], config.calibrated_hz, ("slower", "quicker"), "a second"),
        *_outside(track, surge, surges, ("with less of a surge", "with more of a surge"), "m/s"),
    ]


def _outside(
    track: StepTrack, values: FloatArray, edges: tuple[float, ...], called: tuple[str, str], unit: str
) -> list[Finding]:
    found = []
    for side, name in enumerate(called if edges else ()):
        outside = values > edges[1] if side else values < edges[0]
        count = int(outside.sum())
        if count <= max(_FEW_STEPS, _FEW * len(values)):
            continue
        k = np.flatnonzero(outside) + 1
        text = (
            f"{count} of {len(values)} steps are {name} ({np.median(values[outside]):.2f} {unit}, median) than those "
            f"that the step length was calibrated with ({edges[0]:.2f} to {edges[1]:.2f}): their lengths are a guess; "
            "calibrate with a walk of that kind too"
        )
        found.append(Finding("steps", float(track.start_s[k[0]]), float(track.t_s[k[-1]]), text))
    return found
