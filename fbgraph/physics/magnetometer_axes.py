"""Unit, hard iron and signs of a magnetometer, and the sign of gravity: what the field's dip tells.

Which signed order of its axes turns with the gyroscope is ``sensor_axes``'s; no turn tells an order from the one with
all signs negated. North of the magnetic equator Earth's field points into the ground (Chulliat et al., The US/UK World
Magnetic Model for 2020-2025, NOAA 2020: 22 to 67 µT strong), so the one that does is taken, and that is said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.core.units import STANDARD_GRAVITY_M_S2
from fbgraph.physics.judgement import Judgement
from fbgraph.physics.sensor_axes import CHIPS, Turning, Vote, simpler, told_axes
from fbgraph.physics.turning import PROPER_ORDERS, SIGNED_ORDERS

_EARTH_UT = 45.0
_FIELD_UT = (18.0, 110.0)  # with iron in the device and around
_IMPOSSIBLE_UT = (6.0, 200.0)  # once the iron in the device is solved
_SCALED_UT = 50.0
_SWALLOWED = 0.1  # of the strength: what is left of it if all is taken for the iron in the device
_CLEAR_DIP = 0.25  # its sine
_FACE_DOWN = 0.5  # of gravity
_ALWAYS = 0.9
_SAMPLES = 10_000  # are enough for a mean
_UNITS = {"µT": 1.0, "nT": 1e-3, "milligauss": 0.1, "gauss": 100.0, "mT": 1e3, "T": 1e6}
_AK_UT = 0.15
"""A count of AK09916 (ICM-20948) and, at 16 bits, AK8963 (MPU-9250)."""


@dataclass(frozen=True)
class Field:
    """What a magnetometer sees without its hard iron.

    Attributes:
        offset: (3,) hard iron, in the sensor's own axes and unit.
        size: usual strength without it, in its unit.
        raw_size: with it.
        down: mean sine of the angle by which its own axes have the field below the accelerometer's horizon.
    """

    offset: FloatArray
    size: float
    raw_size: float
    down: float


def see_field(turning: Turning, gyro_scale: float, vote: Vote, acc: Stream, mag: Stream) -> Field:
    """Solve the hard iron under the axes that were voted for.

    Args:
        acc: m/s², in the device's axes.
        mag: as the file has it.
    """
    offset = np.zeros(3)
    moving = turning.field(gyro_scale)
    axes = vote.axes if vote.culprit == "mag" else np.eye(3)
    if moving is not None:
        order = vote.axes if vote.culprit in ("mag", "gyro") else np.eye(3)
        order = order.T if vote.culprit == "gyro" else order
        h = int(np.abs(SIGNED_ORDERS - order).sum(axis=(1, 2)).argmin())
        offset = PROPER_ORDERS[h % 24].T @ moving.free[h]
    mag = Stream(mag.t_s[:: len(mag) // _SAMPLES + 1], mag.values[:: len(mag) // _SAMPLES + 1])
    field = mag.values - offset
    size = np.linalg.norm(field, axis=1)
    level = np.stack([np.interp(mag.t_s, acc.t_s, column) for column in acc.values.T], axis=1)
    norm = np.maximum(np.linalg.norm(level, axis=1) * size, 1e-12)
    down = -float(np.mean(((field @ axes.T) * level).sum(axis=1) / norm)) if len(mag) else 0.0
    return Field(offset, float(np.median(size)), float(np.median(np.linalg.norm(mag.values, axis=1))), down)


def judge_magnetometer(vote: Vote, seen: Field, mag: Stream, named_scale: float | None = None) -> Judgement:
    """Unit and axes of a magnetometer.

    Args:
        vote: whose axes are not as named.
        seen: the field under them.
        mag: as the file has it.
        named_scale: factor to µT that its name tells.
    """
    unit = _unit(seen, mag, vote, named_scale)
    if vote.culprit != "mag":
        if seen.down < -_CLEAR_DIP:
            text = "magnetic field: it points out of the ground, as only south of the magnetic equator"
            return replace(unit, sure=False, text=_joined(unit.text, text))
        doubt = vote.other if "gyroscope" not in vote.other and "accelerometer" not in vote.other else ""
        text = f"axes: kept as named, the sensors would agree better if {doubt}" if doubt else ""
        return replace(unit, sure=unit.sure and not doubt, text=_joined(unit.text, text))
    clear = abs(seen.down) > _CLEAR_DIP
    axes = vote.axes if seen.down > 0.0 else -vote.axes
    if not clear:
        axes = _known(vote.axes)
    chip = next((name for name, told in CHIPS.items() if ", ".join(told) == told_axes(axes)), "")
    text = f"magnetometer: it turns with the gyroscope only if its axes are {told_axes(axes)}"
    text += f", as an {chip}'s are" if chip else ""
    text += ": turned so" if clear else ", or all of these negated: turned so"
    return replace(
        unit,
        axes=axes,
        by="physics",
        sure=unit.sure and clear,
        margin=min(unit.margin, vote.margin),
        text=_joined(unit.text, text),
    )


def _known(axes: FloatArray) -> FloatArray:
    """Of both signs the one that a known chip has, else the simpler one."""
    for told in CHIPS.values():
        for signed in (axes, -axes):
            if told_axes(signed) == ", ".join(told):
                return signed
    return simpler(axes)


def _unit(seen: Field, mag: Stream, vote: Vote, named_scale: float | None) -> Judgement:
    """The unit by the field's strength, with the hard iron and without."""
    sizes = np.array((seen.size, seen.raw_size))
    fits = [u for u, scale in _UNITS.items() if ((_FIELD_UT[0] < sizes * scale) & (sizes * scale < _FIELD_UT[1])).any()]
    nearest = min(_UNITS, key=lambda unit: abs(np.log(max(seen.size, 1e-30) * _UNITS[unit] / _EARTH_UT)))
    swallowed = seen.size < _SWALLOWED * seen.raw_size  # the field does not turn with the gyroscope
    strength = f"{seen.raw_size:.3g}" + ("" if swallowed else f", {seen.size:.3g} without the device's iron")
    if named_scale is not None:
        named = next((unit for unit, s in _UNITS.items() if np.isclose(s, named_scale)), f"{named_scale:.4g} µT")
        possible = _IMPOSSIBLE_UT[0] < seen.size * named_scale < _IMPOSSIBLE_UT[1]
        if possible or nearest not in fits:
            likely = _IMPOSSIBLE_UT[0] < seen.raw_size * named_scale < _IMPOSSIBLE_UT[1]
            text = "" if likely else f"magnetic field: {strength}, in {named} as named far from Earth's 22 to 67 µT"
            return Judgement(named_scale, named, "name", likely, text=text)
        text = f"magnetic field: {strength}, no field of Earth's in {named} as named: taken as {nearest}"
        return Judgement(_UNITS[nearest], nearest, "physics", True, text=text)
    text = f"magnetic field: no unit in its name, {strength}"
    size = seen.raw_size if swallowed else seen.size
    nearest = min(_UNITS, key=lambda unit: abs(np.log(max(size, 1e-30) * _UNITS[unit] / _EARTH_UT)))
    inside = _FIELD_UT[0] < size * _UNITS[nearest] < _FIELD_UT[1]
    whole = bool((mag.values[:2000] == np.rint(mag.values[:2000])).all())
    if (inside if swallowed else nearest in fits) and not (whole and nearest in ("gauss", "mT", "T")):
        return Judgement(
            _UNITS[nearest], nearest, "physics", inside and not swallowed, text=f"{text}: taken as {nearest}"
        )
    if whole and _FIELD_UT[0] < seen.size * _AK_UT < _FIELD_UT[1] and vote.culprit == "mag":
        unit = f"raw counts of {_AK_UT} µT"
        return Judgement(_AK_UT, unit, "physics", True, text=f"{text}: taken as {unit}")
    scale = _SCALED_UT / max(size, 1e-9)
    return Judgement(scale, "raw counts", "assumed", False, 0.0, f"{text}: scaled to {_SCALED_UT:.0f} µT")


def judge_gravity_sign(acc: Stream, seen: Field | None) -> Judgement:
    """Whether an accelerometer shows gravity itself (iOS) where others show the force against it: axes all negated.

    No turn tells. But nobody carries a screen face down all the way under a field that then points into the sky: if
    both are seen together, the sign is turned; face down alone is only said.

    Args:
        acc: m/s², axes as voted for.
        seen: the field under them; None without a magnetometer.
    """
    kept = Judgement(1.0, "", "name", True)
    if not len(acc):
        return kept
    seconds = np.floor(acc.t_s - acc.t_s[0])
    first = np.flatnonzero(np.diff(seconds, prepend=-1.0))
    mean = np.add.reduceat(acc.values, first) / np.diff(np.append(first, len(acc)))[:, None]
    if float((mean[:, 2] < -_FACE_DOWN * STANDARD_GRAVITY_M_S2).mean()) < _ALWAYS:
        return kept
    if seen is not None and seen.down < -_CLEAR_DIP:
        text = "accelerometer: face down all the way under a field that points into the sky: its sign is iOS's, turned"
        return replace(kept, by="physics", axes=-np.eye(3), margin=abs(seen.down) / _CLEAR_DIP, text=text)
    text = "accelerometer: face down all the way, or its sign is iOS's and turns come out mirrored"
    if seen is not None and seen.down > _CLEAR_DIP:  # the field agrees with it
        return replace(kept, text="accelerometer: face down all the way")
    return replace(kept, by="assumed", sure=False, text=text)


def _joined(*texts: str) -> str:
    return "; ".join(text for text in texts if text)
