"""Which way the legs push, by the horizontal acceleration of the steps, against the device's own forward.

Walking lifts the trunk once a step and, a good quarter of a step later, pushes it forward: the part of the horizontal
acceleration that follows the vertical one by that much points where one walks, wherever on the body the device is
(Kourogi & Kurata, PLANS 2014; Roy, Wang & Choudhury, WalkCompass, MobiSys 2014). Sway goes with the stride, half as
fast, and a device that leans lets the vertical itself into the horizontal, in phase with it; both are apart from it.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fbgraph.core.geometry import FloatArray, mean_of
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import Peak

_LAG_RAD = math.radians(75.0)
"""By which the push follows the bounce: on 94 real walks in hand, on the chest, in bag and pocket it lies between 10
and 120 degrees, and 75 turns none of them by more than 60."""
_FEWEST = 4  # samples of a step that show its beat
_SETTING_OFF = 3  # steps that speed up: what pushes the whole body is not the legs' beat


@dataclass(frozen=True, slots=True)
class Beat:
    """Acceleration of one step at the step's own frequency: complex amplitudes, phase counted from its begin, m/s²."""

    end: int
    forward: complex
    left: complex
    up: complex


class Push(NamedTuple):
    """Which way the legs pushed at a step, nan if it is not known, and how the device was held: as in ``Step``."""

    mount_up_rad: float
    tilt_rate_rad_s: float
    gait_yaw_rad: float = math.nan
    push_m_s2: float = math.nan
    side_forward_m_s2: float = math.nan
    side_left_m_s2: float = math.nan


class GaitDirection:
    """Tells steps which way the legs pushed. Two steps are looked at: over them what goes with the stride is gone."""

    def __init__(self) -> None:
        self._before: Beat | None = None
        self._steps = 0  # of this run

    def push(self, signals: LevelledSignals, peak: Peak) -> Push:
        """The push of the next step, if it followed upon another, and how the device was held meanwhile.

        Args:
            signals: among them all those of the step.
            peak: where it began and ended.
        """
        lo, hi = signals.index.searchsorted((peak.start_index + 1, peak.index + 1)).tolist()
        self._steps = 1 if peak.first else self._steps + 1
        beat = beat_of(signals, lo, hi, peak) if self._steps > _SETTING_OFF else None
        before, self._before = self._before, beat
        lo = min(lo, hi - 1)
        held = float(mean_of(signals.mount_up_rad[lo:hi])), float(mean_of(signals.tilt_rate_rad_s[lo:hi]))
        if beat is None or before is None or before.end != peak.start_index:
            return Push(*held)
        up = beat.up + before.up
        if abs(up) == 0.0:
            return Push(*held)
        turn = 0.5 * (up / abs(up)).conjugate() * cmath.exp(-1j * _LAG_RAD)
        forward, left = (beat.forward + before.forward) * turn, (beat.left + before.left) * turn
        return Push(
            *held,
            gait_yaw_rad=math.atan2(left.real, forward.real),
            push_m_s2=math.hypot(left.real, forward.real),
            side_forward_m_s2=forward.imag,
            side_left_m_s2=left.imag,
        )


def beat_of(signals: LevelledSignals, lo: int, hi: int, peak: Peak) -> Beat | None:
    """The beat of a step, rows ``lo`` to ``hi`` of the signals.

    None with a gap in it, too few samples or several steps; nor has who sets off and stops at once a beat.
    """
    if peak.count > 1 or peak.share < 1 or hi - lo != peak.index - peak.start_index or hi - lo < _FEWEST:
        return None
    cos, sin = _circle(hi - lo)
    acc: FloatArray = signals.acc_n_m_s2[lo:hi]
    real, imag = mean_of(acc * cos).tolist(), mean_of(acc * sin).tolist()
    forward, left, up = (complex(2.0 * a, -2.0 * b) for a, b in zip(real, imag, strict=True))
    return Beat(peak.index, forward, left, up)


@lru_cache(maxsize=256)
def _circle(count: int) -> tuple[FloatArray, FloatArray]:
    """(N, 1) cosine and sine once round; of so few lengths that steps have."""
    phase = (2.0 * np.pi / count) * np.arange(1, count + 1)[:, None]
    return np.cos(phase), np.sin(phase)
