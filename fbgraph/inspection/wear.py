"""How a device was worn, from how it tilts and in which rhythm: held, in a bag, on a leg, on a swinging arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.rhythm import Frames, Rhythm

_MOVING_M_S2 = 0.7
_FEWEST = 40  # frames, some six seconds of movement
_RHYTHM = 0.5  # correlation of |acc| one step apart, from which somebody walks
_LEG_RAD_S, _LIMB_RAD_S, _BAG_RAD_S = 1.3, 0.8, 0.45  # mean tilting: RIDI's leg 1.5, bag 0.6, hand and chest 0.2 to 0.4
_ONE_A_STEP = 0.5  # share of frames with one top a step: hand and chest 0.9 or more, RIDI's bag 0.2, leg 0.03
_YAW_SWING_RAD = 0.35  # root mean square, of an arm that swings about the vertical; others: 0.2 at most


@dataclass(frozen=True)
class Wear:
    """How a device was worn.

    Attributes:
        how: ``held`` (in hand before the body, or strapped to the trunk), ``bag`` (or a loose pocket), ``leg`` (or a
            trouser pocket), ``swinging`` (on an arm), or ``not told``.
        why: for people.
        tilt_rate_deg_s: usual rate at which it tilted while it moved; nan if it hardly moved.
        step_s: usual time from step to step, nan likewise.
        one_top_a_step: share of the time in which each step shows one maximum, and not two, or one a stride.
    """

    how: str
    why: str
    tilt_rate_deg_s: float = float("nan")
    step_s: float = float("nan")
    one_top_a_step: float = float("nan")


def worn(signals: LevelledSignals, rate_hz: float) -> Wear:
    """Judge how a device was worn.

    Args:
        signals: of the whole log.
        rate_hz: of their grid.
    """
    frames = Rhythm(rate_hz).push(signals)
    moving = frames.moved_m_s2 > _MOVING_M_S2
    walking = moving & (frames.strength > _RHYTHM)
    if walking.sum() < _FEWEST:
        return Wear("not told", "nobody walks long enough in it")
    tilt = float(np.median(frames.swing_rad_s[walking]))
    step_s, single = float(np.median(frames.period_s[walking])), float(frames.single[walking].mean())
    numbers = (round(float(np.degrees(tilt)), 1), round(step_s, 3), round(single, 2))
    tops = "one top a step" if single > _ONE_A_STEP else "a stride shows, not a step"
    seen = f"it tilts at {np.degrees(tilt):.0f} °/s, {tops}"
    yaw = _yaw_swing_rad(signals, frames, walking)
    if tilt > _LEG_RAD_S and single < _ONE_A_STEP:
        return Wear("leg", f"{seen}: on a leg or in a trouser pocket", *numbers)
    if tilt > _LIMB_RAD_S or yaw > _YAW_SWING_RAD:
        turned = f", and turns to and fro by {np.degrees(yaw) * np.sqrt(2.0):.0f}°" if yaw > _YAW_SWING_RAD else ""
        return Wear("swinging", f"{seen}{turned}: on an arm that swings", *numbers)
    if tilt > _BAG_RAD_S and single < _ONE_A_STEP:
        return Wear("bag", f"{seen}: in a bag or a loose pocket", *numbers)
    if single > _ONE_A_STEP:
        return Wear("held", f"{seen}: in a hand that keeps it level, or strapped to the trunk", *numbers)
    return Wear("not told", f"{seen}: neither as in a hand nor as on a limb", *numbers)


def _yaw_swing_rad(
    signals: LevelledSignals, frames: Frames, walking: np.ndarray[tuple[int], np.dtype[np.bool_]]
) -> float:
    """Root mean square of the yaw about its own course over two steps, where somebody walks."""
    step_s = float(np.median(frames.period_s[walking]))
    each = max(round(2.0 * step_s / max(float(np.median(np.diff(signals.t_s))), 1e-3)), 1)
    if len(signals) <= 2 * each:
        return 0.0
    yaw = signals.yaw_gyro_rad - signals.yaw_gyro_rad[0]
    course = np.convolve(yaw, np.full(each, 1.0 / each), mode="same")
    at = np.clip(np.searchsorted(signals.index, frames.index[walking]), each, len(yaw) - each - 1)
    return float(np.sqrt(np.median((yaw - course)[at] ** 2)))
