"""The magnetic field against Earth's, and the compass's turns against the gyroscope's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.verdict import Reason
from fbgraph.front_end.step_track import StepTrack
from fbgraph.integrity.evidence import UNKNOWN_TURN_RAD, Doubt, Sensed, turned_m

_EARTH_UT = (18.0, 80.0)  # 22 to 67 on the ground, anywhere; iron nearby adds or takes some
_FEW = 20  # steps with a compass; of fewer nothing is said
_UPSIDE_DOWN_RAD = np.radians(-15.0)
_LAG_STEPS = 4  # a corner takes about as many
_LONGEST_STEP_S = 1.2
_SLOPES = np.arange(-1.6, 2.61, 0.05)
_SLOPE_OFF = 0.3  # iron at a corner changes it by 0.25 at most
_SLOPE_SIGMAS = 3.0
_MIRRORED = -0.3


@dataclass(frozen=True)
class TurnSlope:
    """How the compass turns where the gyroscope turns.

    Attributes:
        slope: compass over gyroscope: 1 if both are right, -1 if one is mirrored, 0 if the compass does not turn.
        sigma: its standard deviation.
        agreement: concentration of what is left, 1 if nothing is.
        turn_rad: how much was turned, root mean square of all stretches of four steps.
    """

    slope: float
    sigma: float
    agreement: float
    turn_rad: float


def field_strength(walk: Sensed) -> list[Doubt]:
    """Earth's field is 22 to 67 µT strong; what is far from it is no field of Earth's, or has another unit."""
    norm = walk.track.mag_norm_ut[np.isfinite(walk.track.mag_norm_ut)]
    if len(norm) < _FEW:
        return []
    usual = float(np.median(norm))
    low, high = _EARTH_UT
    if low <= usual <= high:
        return []
    weight = low / max(usual, 1e-6) if usual < low else usual / high
    text = f"the magnetic field is {usual:.3g} µT strong, Earth's is 22 to 67"
    advice = "the magnetometer needs calibrating (hard iron), its unit is wrong, or iron went with it the whole way"
    heading_rad = UNKNOWN_TURN_RAD if usual > high else 0.0  # a wrong unit leaves the direction as it was
    sigma_m = turned_m(walk.track, heading_rad)
    return [Doubt(Reason("magnetometer", min(weight, 50.0), text, advice), sigma_m)]


def field_upside_down(walk: Sensed) -> list[Doubt]:
    """North of the magnetic equator the field points into the ground: if it does not, an axis is mirrored."""
    dip = walk.track.mag_dip_rad[np.isfinite(walk.track.mag_dip_rad)]
    if len(dip) < _FEW or (usual := float(np.median(dip))) > _UPSIDE_DOWN_RAD:
        return []
    text = (
        f"the magnetic field points {-np.degrees(usual):.0f}° out of the ground, as it does only south of the equator"
    )
    advice = "if you were not there, accelerometer or magnetometer is mirrored; if you were, say where with --origin"
    return [
        Doubt(Reason("magnetometer", usual / _UPSIDE_DOWN_RAD, text, advice), turned_m(walk.track, UNKNOWN_TURN_RAD))
    ]


def compass_against_gyroscope(walk: Sensed) -> list[Doubt]:
    """Where the gyroscope turns by so much, the compass must turn by as much, and the same way."""
    found = turn_slope(walk.track)
    if found is None:
        return []
    off = abs(found.slope - 1.0)
    if off <= _SLOPE_OFF + _SLOPE_SIGMAS * found.sigma or found.agreement < 0.5:
        return []
    if found.slope < _MIRRORED:
        text = "compass and gyroscope turn opposite ways"
        advice = "an axis of one of them is mirrored or swapped: check the order and the signs of their columns"
    elif found.slope < _SLOPE_OFF:
        text = "the compass does not turn where the gyroscope does"
        advice = "a magnet goes with the device, or the magnetometer hangs: calibrate it, or leave it out"
    else:
        text = f"the compass turns {found.slope:.1f} times as far as the gyroscope"
        advice = "the gyroscope's scale, unit or range or the clock is wrong, or iron goes with the device: check them"
    weight = off / (_SLOPE_OFF + _SLOPE_SIGMAS * found.sigma)
    sigma_m = turned_m(walk.track, min(off, 1.0) * UNKNOWN_TURN_RAD)
    return [Doubt(Reason("compass_turns", 1.0 + weight, text, advice), sigma_m)]


def turn_slope(track: StepTrack) -> TurnSlope | None:
    """Circular regression of the compass's turns over four steps on the gyroscope's; None where too little is known.

    The slope is where the differences of both, whatever their common rate (the gyroscope's bias), agree best; its
    standard deviation is that of linear regression, every stretch counted once.
    """
    yaw, mag, t_s = track.yaw_gyro_rad, track.yaw_mag_rad, track.yaw_s
    k = np.arange(1, len(track) - _LAG_STEPS)
    last = k + _LAG_STEPS
    gaps = np.cumsum(track.chained == 0)
    known = np.isfinite(mag[k]) & np.isfinite(mag[last]) & (gaps[k] == gaps[last])
    known &= t_s[last] - t_s[k] < _LAG_STEPS * _LONGEST_STEP_S
    k, last = k[known], last[known]
    if len(k) < _FEW:
        return None
    turned, by_compass = yaw[last] - yaw[k], mag[last] - mag[k]
    turn_rad = float(np.std(turned))
    agreement = _agreement(turned, by_compass)
    best = int(agreement.argmax())
    scatter_rad = np.sqrt(max(-2.0 * np.log(agreement[best]), 1e-6))
    sigma = scatter_rad / (max(turn_rad, 1e-6) * np.sqrt(len(k) / _LAG_STEPS))
    return TurnSlope(float(_SLOPES[best]), float(sigma), float(agreement[best]), turn_rad)


def _agreement(turned_rad: FloatArray, by_compass_rad: FloatArray) -> FloatArray:
    """(S,) mean resultant length of (compass - slope x gyroscope) for each slope."""
    left = by_compass_rad[None, :] - _SLOPES[:, None] * turned_rad[None, :]
    return np.asarray(np.hypot(np.cos(left).mean(axis=1), np.sin(left).mean(axis=1)))
