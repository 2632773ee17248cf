"""What goes wrong on real walks, done to a simulated one: its log changes, and its truth where that changes too.

Each function takes a walk and returns another; they can be done one after another. Nothing here is known to an
estimator. Times are seconds since log start, vectors are in the device's axes unless said otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fbgraph.core.atmosphere import altitude_pressure_hpa, pressure_altitude_m
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream, empty_stream
from fbgraph.simulator.simulate import SimulatedWalk

SENSORS = ("acc", "gyro", "mag", "pressure")
"""Names of a log's streams."""
Frame = Callable[[FloatArray], FloatArray]
"""From places (N, 2) in the walk's frame to the same places in another."""
_BY_S = 0.05  # half the span over which rates and accelerations are taken


def ease(t_s: FloatArray, start_s: float, length_s: float) -> FloatArray:
    """(N,) 0 before the start, 1 after so long, and smooth between: 6 s⁵ - 15 s⁴ + 10 s³."""
    s = np.clip((t_s - start_s) / length_s, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 + s * (6.0 * s - 15.0)))


def _with(walk: SimulatedWalk, streams: dict[str, Any]) -> SimulatedWalk:
    return replace(walk, log=replace(walk.log, **streams))


def changed(walk: SimulatedWalk, sensor: str, change: Callable[[Stream], FloatArray]) -> SimulatedWalk:
    """The walk with other values of a sensor, as many as there were."""
    stream: Stream = getattr(walk.log, sensor)
    return _with(walk, {sensor: Stream(stream.t_s, change(stream))})


def offset(
    walk: SimulatedWalk, sensor: str, amount: FloatArray | float, since_s: float = 0.0, until_s: float = np.inf
) -> SimulatedWalk:
    """Something added, always or for a time: iron in the case, a compass calibrated anew, a gyroscope's bias.

    Args:
        walk: the walk.
        sensor: one of ``SENSORS``.
        amount: (3,) or a number, in the sensor's unit.
        since_s, until_s: when.
    """

    def change(stream: Stream) -> FloatArray:
        there = (stream.t_s >= since_s) & (stream.t_s < until_s)
        return np.asarray(stream.values + there[:, None] * np.asarray(amount))

    return changed(walk, sensor, change)


def mixed(walk: SimulatedWalk, sensor: str, matrix: FloatArray) -> SimulatedWalk:
    """A sensor that is scaled, or whose axes are swapped or negated: ``matrix`` (3, 3) times each vector."""
    return changed(walk, sensor, lambda stream: stream.values @ matrix.T)


def frozen(walk: SimulatedWalk, sensor: str, since_s: float, until_s: float = np.inf) -> SimulatedWalk:
    """A sensor that repeats its last sample for a time."""

    def change(stream: Stream) -> FloatArray:
        row, end = np.searchsorted(stream.t_s, (since_s, until_s))
        values = stream.values.copy()
        values[row:end] = values[max(row - 1, 0)]
        return values

    return changed(walk, sensor, change)


def spikes(walk: SimulatedWalk, sensor: str, share: float, size: float, rng: np.random.Generator) -> SimulatedWalk:
    """A sensor some of whose samples are far off: normal numbers of standard deviation ``size`` are added."""

    def change(stream: Stream) -> FloatArray:
        hit = rng.random(len(stream)) < share
        return stream.values + hit[:, None] * rng.normal(0.0, size, stream.values.shape)

    return changed(walk, sensor, change)


def without(walk: SimulatedWalk, sensor: str) -> SimulatedWalk:
    """A device that lacks the magnetometer or the barometer."""
    width = getattr(walk.log, sensor).values.shape[1]
    return _with(walk, {sensor: empty_stream(width)})


def gap(walk: SimulatedWalk, start_s: float, length_s: float) -> SimulatedWalk:
    """A log that lacks all samples of a time."""

    def kept(stream: Stream) -> Stream:
        there = (stream.t_s < start_s) | (stream.t_s >= start_s + length_s)
        return Stream(stream.t_s[there], stream.values[there])

    return _with(walk, {name: kept(getattr(walk.log, name)) for name in SENSORS})


def clock_runs(walk: SimulatedWalk, factor: float) -> SimulatedWalk:
    """A clock that runs so much too fast; the truth is told on it too, with the lengths that were really walked."""

    def of(stream: Stream) -> Stream:
        return Stream(stream.t_s * factor, stream.values)

    t0_s = walk.log.t0_s
    passed_s = t0_s + (walk.checkpoints.t_s - t0_s) * factor
    events = tuple(replace(event, t_s=event.t_s * factor) for event in walk.log.events)
    walk = _with(walk, {name: of(getattr(walk.log, name)) for name in SENSORS} | {"events": events})
    return replace(
        walk,
        t_s=walk.t_s * factor,
        steps=replace(walk.steps, t_s=walk.steps.t_s * factor),
        turns=replace(walk.turns, t_s=walk.turns.t_s * factor),
        checkpoints=replace(walk.checkpoints, t_s=passed_s),
    )


def weather(walk: SimulatedWalk, hpa_per_hour: float) -> SimulatedWalk:
    """Air pressure that rises steadily while nobody climbs."""
    return changed(walk, "pressure", lambda air: air.values + hpa_per_hour * air.t_s[:, None] / 3600.0)


def door_pulses(walk: SimulatedWalk, at_s: Sequence[float], hpa: float, length_s: float) -> SimulatedWalk:
    """Pressure that is higher for a moment: doors, gusts, a thumb on the vent."""
    for when_s in at_s:
        walk = offset(walk, "pressure", hpa, when_s, when_s + length_s)
    return walk


def wind(walk: SimulatedWalk, hpa: float, lasting_s: float, rng: np.random.Generator) -> SimulatedWalk:
    """Gusts on the barometer: noise of a standard deviation, forgotten after so long (Ornstein-Uhlenbeck)."""

    def change(air: Stream) -> FloatArray:
        drive, gusts = rng.standard_normal(len(air)), np.zeros(len(air))
        keep = np.exp(-np.diff(air.t_s, prepend=-np.inf) / lasting_s)
        for k in range(len(air)):
            gusts[k] = keep[k] * gusts[k - 1] + np.sqrt(1.0 - keep[k] ** 2) * drive[k]
        return air.values + hpa * gusts[:, None]

    return changed(walk, "pressure", change)


def lift(walk: SimulatedWalk, rise_m: float, start_s: float, length_s: float) -> SimulatedWalk:
    """A lift that takes the standing wearer up or down: pressure, acceleration and truth.

    Args:
        walk: the walk; its wearer should stand still then.
        rise_m: up positive.
        start_s, length_s: when it starts and how long it goes.
    """

    def rise(t_s: FloatArray) -> FloatArray:
        return rise_m * ease(t_s, start_s, length_s)

    def pressed(air: Stream) -> FloatArray:
        return altitude_pressure_hpa(pressure_altitude_m(air.values[:, 0]) + rise(air.t_s))[:, None]

    def pushed(acc: Stream) -> FloatArray:
        bend = rise(acc.t_s + _BY_S) - 2.0 * rise(acc.t_s) + rise(acc.t_s - _BY_S)
        return acc.values + bend[:, None] / _BY_S**2 * up_b(walk, acc.t_s)

    walk = changed(changed(walk, "pressure", pressed), "acc", pushed)
    after, steps = rise(walk.t_s), walk.steps
    lifted = np.zeros_like(steps.xyz_m)
    lifted[:, 2] = rise(steps.t_s)
    up = np.zeros_like(walk.device_m)
    up[:, 2] = after
    passed_m = rise(walk.checkpoints.t_s - walk.log.t0_s)
    return replace(
        walk,
        z_m=walk.z_m + after,
        device_m=walk.device_m + up,
        steps=replace(steps, xyz_m=steps.xyz_m + lifted),
        checkpoints=replace(walk.checkpoints, z_m=walk.checkpoints.z_m + passed_m),
    )


@dataclass(frozen=True)
class Burst:
    """A hand that goes up and down for a while: ``size_m`` to each side, ``hz`` times a second."""

    start_s: float
    length_s: float
    hz: float
    size_m: float

    def accel_m_s2(self, t_s: FloatArray) -> FloatArray:
        """(N,) upward; it swells and dies away."""
        done = np.clip((t_s - self.start_s) / self.length_s, 0.0, 1.0)
        rate = 2.0 * np.pi * self.hz
        return np.asarray(np.sqrt(np.sin(np.pi * done)) * self.size_m * rate**2 * np.sin(rate * (t_s - self.start_s)))


def gestures(walk: SimulatedWalk, bursts: Sequence[Burst]) -> SimulatedWalk:
    """A standing wearer who talks with the hands: up and down, without a walker's push forward and sway."""

    def change(acc: Stream) -> FloatArray:
        up = sum((burst.accel_m_s2(acc.t_s) for burst in bursts), np.zeros(len(acc)))
        return acc.values + up[:, None] * up_b(walk, acc.t_s)

    return changed(walk, "acc", change)


def vibration(
    walk: SimulatedWalk, start_s: float, length_s: float, size_m_s2: float, hz: float, rng: np.random.Generator
) -> SimulatedWalk:
    """An engine under the seat: a shaking of so much (standard deviation an axis) around a rate, in all axes."""

    def change(acc: Stream) -> FloatArray:
        there = (acc.t_s >= start_s) & (acc.t_s < start_s + length_s)
        rates = hz * rng.uniform(0.8, 1.25, (6, 3))
        phases = rng.uniform(0.0, 2.0 * np.pi, (6, 3))
        waves = np.sin(2.0 * np.pi * rates * acc.t_s[:, None, None] + phases).sum(axis=1)
        return np.asarray(acc.values + there[:, None] * size_m_s2 / np.sqrt(3.0) * waves)

    return changed(walk, "acc", change)


def turned_in_hand(walk: SimulatedWalk, angle_rad: float, at_s: float, length_s: float = 0.8) -> SimulatedWalk:
    """A device that is turned about the vertical in the hand and stays so, while its wearer walks on as before.

    Args:
        walk: the walk.
        angle_rad: counter-clockwise seen from above.
        at_s, length_s: when the turn begins, and how long it takes.
    """
    axis = up_b(walk, np.zeros(1))[0]

    def angle(t_s: FloatArray) -> FloatArray:
        return angle_rad * ease(t_s, at_s, length_s)

    def turned(stream: Stream) -> FloatArray:
        return np.asarray(Rotation.from_rotvec(-angle(stream.t_s)[:, None] * axis).apply(stream.values))

    def turning(gyro: Stream) -> FloatArray:
        rate = (angle(gyro.t_s + _BY_S) - angle(gyro.t_s - _BY_S)) / (2.0 * _BY_S)
        return np.asarray(turned(gyro) + rate[:, None] * axis)

    new_r_b = Rotation.from_quat(np.roll(walk.quat_wxyz, -1, axis=1))
    new_r_b = new_r_b * Rotation.from_rotvec(angle(walk.t_s)[:, None] * axis)
    walk = changed(changed(changed(walk, "acc", turned), "mag", turned), "gyro", turning)
    return replace(walk, quat_wxyz=np.roll(new_r_b.as_quat(), 1, axis=1))


def up_b(walk: SimulatedWalk, t_s: FloatArray) -> FloatArray:
    """(N, 3) where up is in the device's axes at these times."""
    rows = np.clip(np.searchsorted(walk.t_s, t_s), 0, len(walk.t_s) - 1)
    w, x, y, z = walk.quat_wxyz[rows].T
    return np.column_stack((2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x**2 + y**2)))


def surveyed(
    walk: SimulatedWalk,
    t_s: FloatArray,
    errors_m: FloatArray,
    frame: Frame = lambda xy_m: xy_m,
    sigma_m: FloatArray | None = None,
) -> Checkpoints:
    """Anchors: where the walker was at these times, as a survey tells it.

    Args:
        walk: the walk.
        t_s: (M,) seconds since log start.
        errors_m: (M, 2) of the survey, added in the walk's frame.
        frame: the frame in which the survey tells it.
        sigma_m: (M,) what the survey says of its errors, in its frame; None if nothing.

    Returns:
        On the log's event clock, as a file of anchors is.
    """
    xy_m = np.column_stack([np.interp(t_s, walk.t_s, axis) for axis in (walk.x_m, walk.y_m)])
    x_m, y_m = frame(xy_m + errors_m).T
    return checkpoints(t_s + walk.log.t0_s, x_m, y_m, sigma_m=sigma_m, source="survey")


def in_frame(walk: SimulatedWalk, frame: Frame) -> SimulatedWalk:
    """The walk with the truth of its plan (``x_m``, ``y_m``) told in another frame; nothing else is changed."""
    x_m, y_m = frame(np.column_stack((walk.x_m, walk.y_m))).T
    return replace(walk, x_m=x_m, y_m=y_m)
