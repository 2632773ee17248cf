"""How far the magnetic field at a step is from its recent usual: the sign of iron nearby."""

from __future__ import annotations

from collections import deque

from fbgraph.front_end.step_track import Step

_MEMORY_STEPS = 30


class FieldMemory:
    """Medians of strength and dip over the last steps."""

    def __init__(self, norm_scale_ut: float, dip_scale_rad: float) -> None:
        """The deviations that each count as 1."""
        self._norm_scale_ut = norm_scale_ut
        self._dip_scale_rad = dip_scale_rad
        self._norms_ut: deque[float] = deque(maxlen=_MEMORY_STEPS)
        self._dips_rad: deque[float] = deque(maxlen=_MEMORY_STEPS)

    def inflation(self, step: Step) -> float:
        """By what to multiply the compass variance at this step: 1 + (Δnorm / scale)² + (Δdip / scale)²."""
        self._norms_ut.append(step.mag_norm_ut)
        self._dips_rad.append(step.mag_dip_rad)
        norm = (step.mag_norm_ut - _middle(self._norms_ut)) / self._norm_scale_ut
        dip = (step.mag_dip_rad - _middle(self._dips_rad)) / self._dip_scale_rad
        return 1.0 + norm**2 + dip**2


def _middle(values: deque[float]) -> float:
    return sorted(values)[len(values) // 2]
