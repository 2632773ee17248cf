"""Steps against what legs can do, and the log against its steps."""

from __future__ import annotations

import numpy as np

from fbgraph.core.verdict import Reason
from fbgraph.integrity.evidence import Doubt, Sensed, stepping, stretched_m

_RHYTHM_HZ = (0.7, 3.2)
_RISE_M = 0.18  # how far a body rises and falls in a step; undisturbed: 0.11 at most
_SLOW_HZ, _SLOW_RISE_M = 1.15, 0.12  # who walks slowly rises less
_FASTEST_M_S = 5.0
_UNEXPLAINED_SHARE, _UNEXPLAINED_S = 0.4, 20.0  # undisturbed: a quarter


def rhythm(walk: Sensed) -> list[Doubt]:
    """Nobody walks or runs slower than 0.7 or faster than 3.2 steps a second for long."""
    usual_hz = float(np.median(walk.track.frequency_hz[1:]))
    low, high = _RHYTHM_HZ
    if low <= usual_hz <= high:
        return []
    text = f"{usual_hz:.2f} steps a second are no walk"
    advice = "the clock's unit or rate is wrong, or what was counted were no steps: check the time column"
    weight = low / usual_hz if usual_hz < low else usual_hz / high
    return [Doubt(Reason("steps", weight, text, advice), stretched_m(walk.track, 0.5))]


def rise_of_a_step(walk: Sensed) -> list[Doubt]:
    """A body that bounces so much, so slowly, rises by a²/(2πf)²: legs allow a tenth of a metre."""
    track = walk.track
    if len(track) < 10:
        return []
    usual_hz = float(np.median(track.frequency_hz[1:]))
    rise_m = float(np.median(track.bounce_m_s2[1:] / (2.0 * np.pi * track.frequency_hz[1:]) ** 2))
    limit_m = _SLOW_RISE_M if usual_hz < _SLOW_HZ else _RISE_M
    if rise_m <= limit_m:
        return []
    text = f"by rhythm and bounce the wearer rises {rise_m:.2f} m at every step, legs allow 0.1"
    advice = "the clock runs wrong, or the accelerometer is full of noise or spikes: check both"
    return [Doubt(Reason("steps", rise_m / limit_m, text, advice), stretched_m(track, 0.4))]


def unexplained_time(walk: Sensed) -> list[Doubt]:
    """Moving, but neither steps nor rest: what was walked meanwhile is missing."""
    signals, track = walk.signals, walk.track
    if len(signals) < 2:
        return []
    since = signals.t_s > track.t_s[0]
    walked = stepping(walk)
    rate_hz = walk.config.attitude.rate_hz
    walked_s, open_s = walked.sum() / rate_hz, float((since & ~walked & ~signals.still).sum() / rate_hz)
    share = open_s / max(walked_s + open_s, 1e-9)
    if share <= _UNEXPLAINED_SHARE or open_s <= _UNEXPLAINED_S:
        return []
    text = f"for {open_s:.0f} s of the log the device moved, but no steps were found"
    advice = "what was walked meanwhile is missing: look at the lane of the wearer in the recording"
    sigma_m = np.interp(track.t_s, signals.t_s, np.cumsum(since & ~walked & ~signals.still) / rate_hz) / np.sqrt(2.0)
    return [Doubt(Reason("steps", share / _UNEXPLAINED_SHARE, text, advice), sigma_m)]
