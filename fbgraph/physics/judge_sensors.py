"""All sensors of one log judged together: units, signs and axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fbgraph.core.sensor_log import Stream
from fbgraph.physics.judgement import Judged, Judgement
from fbgraph.physics.magnetometer_axes import judge_gravity_sign, judge_magnetometer, see_field
from fbgraph.physics.sensor_axes import Turning, Vote, told_axes, vote
from fbgraph.physics.sensor_units import judge_accelerometer, judge_gyroscope_unit, judge_pressure

_NAMES = {"acc": "accelerometer", "gyro": "gyroscope"}


def judge_sensors(
    acc: Stream,
    gyro: Stream,
    mag: Stream | None = None,
    pressure: Stream | None = None,
    named_scales: dict[str, float] | None = None,
) -> Judged:
    """Judge what was read of one device.

    Args:
        acc: (N, 3) as the file has it, as are the others; finite, times in seconds strictly increasing.
        named_scales: by ``acc``, ``gyro``, ``mag``, ``pressure``: factor to SI that names tell; none where they do not.

    Returns:
        Scales and axes: SI in the device's axes is ``scale * values @ axes.T``.
    """
    named = named_scales or {}
    unit = judge_accelerometer(acc, named.get("acc"))
    air = judge_pressure(pressure.values, named.get("pressure")) if pressure is not None and len(pressure) else None
    mag = mag if mag is not None and len(mag) > 1 and len(acc) else None  # without gravity no dip
    forces = Stream(acc.t_s, acc.values * unit.scale)
    turning = Turning.of(forces, gyro, mag)
    if unit.gravity_removed:
        turning = replace(turning, acc=turning.acc.none())
    turn_unit = judge_gyroscope_unit(turning, forces, gyro, named.get("gyro"))
    voted = vote(turning, turn_unit.scale)
    acc_now, gyro_now = _with_axes("acc", unit, voted), _with_axes("gyro", turn_unit, voted)
    forces = Stream(forces.t_s, forces.values @ acc_now.axes.T)
    seen = see_field(turning, turn_unit.scale, voted, forces, mag) if mag is not None else None
    compass = None
    if mag is not None and seen is not None:
        compass = judge_magnetometer(voted, seen, mag, named.get("mag"))
    if not unit.gravity_removed:
        sign = judge_gravity_sign(forces, seen)
        if not sign.straight and mag is not None and seen is not None:  # the field is right, then
            compass = judge_magnetometer(voted, replace(seen, down=-seen.down), mag, named.get("mag"))
        acc_now = replace(
            acc_now,
            axes=sign.axes @ acc_now.axes,
            by=acc_now.by if sign.straight else sign.by,
            sure=acc_now.sure and sign.sure and (sign.straight or voted.sure),
            text="; ".join(text for text in (acc_now.text, sign.text) if text),
        )
    return Judged(acc_now, gyro_now, compass, air, voted.sure or voted.culprit != "none")


def _with_axes(sensor: str, unit: Judgement, voted: Vote) -> Judgement:
    """The sensor's unit, and its axes as voted."""
    name = _NAMES[sensor]
    if voted.culprit != sensor:
        if name not in voted.other:
            return unit
        text = f"axes: kept as named, accelerometer and gyroscope would agree better if {voted.other}"
        return replace(unit, sure=False, text="; ".join(t for t in (unit.text, text) if t))
    mirrored = np.linalg.det(voted.axes) < 0.0
    text = f"{name}: it contradicts the other sensors unless its axes are {told_axes(voted.axes)}: turned so"
    text += " (it was mirrored)" if mirrored else ""
    text += ", or the other one is wrong: without a magnetometer nothing tells" if voted.ambiguous else ""
    return replace(
        unit,
        axes=voted.axes,
        by="assumed" if voted.ambiguous else "physics",
        sure=unit.sure and voted.sure,
        margin=min(unit.margin, voted.margin),
        text="; ".join(t for t in (unit.text, text) if t),
    )
