"""The exact motion of a simulated walker's body, and of a device in the hand or on the trunk.

The walker's own motion is a quintic spline through its steps; the device adds bounce and sway, which are harmonics of
the stride. All of it is twice differentiable in closed form, so that simulated sensors are exact derivatives of truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from fbgraph.core.geometry import FloatArray
from fbgraph.simulator.gait import KNOT_COLUMNS, Walk, Walker

_BLOCK = 2**14  # samples at once: what the processor's cache holds
_YAW_AT, _DISTANCE_AT, _PHASE_AT = (KNOT_COLUMNS.index(name) for name in ("yaw_rad", "distance_m", "phase"))

# Harmonics of the stride (2 = once a step): share of Walker.bounce_m_s2, and phase at the heel strike. Set by eye and
# spectrum to the hand-held and chest-worn walks of RIDI (Yan, Shan, Furukawa 2018). The trunk is lowest at the heel
# strike, slowly loaded and quickly unloaded; forward it brakes, then pushes off; sideways it sways with the stride.
_Waves = Mapping[float, tuple[float, float]]
_UP: _Waves = {2: (1.0, 0.0)}
_UP_STRIKE: _Waves = {4: (0.3, -0.9), 6: (0.3, -2.2), 8: (0.2, -3.5), 10: (0.13, -4.7)}
_UP_LIMP: _Waves = {1: (0.7, 0.4), 3: (1.5, -0.5)}  # times asymmetry
_FORWARD: _Waves = {2: (0.45, 1.6)}
_FORWARD_STRIKE: _Waves = {4: (0.22, 0.6), 6: (0.25, -0.3), 8: (0.2, -1.2), 10: (0.15, -2.0)}
_LEFT: _Waves = {1: (0.25, 0.8), 3: (0.12, 0.2)}
_LEFT_STRIKE: _Waves = {5: (0.13, -0.4), 7: (0.1, -1.0)}
_SWAY: tuple[tuple[_Waves, _Waves], ...] = (  # yaw, pitch, roll: share of Walker.sway_deg
    ({1: (1.0, 0.3)}, {3: (0.07, 0.0), 5: (0.05, 1.0)}),
    ({1: (0.15, 1.0), 2: (0.25, -0.8)}, {4: (0.1, 0.3), 6: (0.08, -1.5), 10: (0.03, -2.5)}),
    ({1: (0.4, -1.2), 2: (0.12, 0.5)}, {5: (0.07, 0.0), 6: (0.06, -2.0), 9: (0.03, 1.5)}),
)
_SHAKE: tuple[tuple[_Waves, _Waves], ...] = (  # size and phase at each rate in rad/s, as the IPIN 2023 logs begin
    ({4.6: (0.17, 0.0), 15.0: (0.015, 1.0)}, {4.1: (0.8, 0.0), 6.9: (0.4, 2.0)}),  # x in metres, yaw in radians
    ({5.3: (0.15, 1.0), 17.0: (0.012, 2.0)}, {4.7: (0.7, 2.0), 7.3: (0.4, 0.0)}),  # y, pitch
    ({4.9: (0.18, 2.0), 13.0: (0.015, 0.0)}, {3.7: (0.7, 1.0), 6.1: (0.5, 0.0)}),  # z, roll
)


@dataclass(frozen=True)
class Jet:
    """A quantity over time with its first two derivatives, each (N,)."""

    value: FloatArray
    rate: FloatArray
    accel: FloatArray

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.value + other.value, self.rate + other.rate, self.accel + other.accel)

    def __mul__(self, other: Jet | float) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.value * other, self.rate * other, self.accel * other)
        return Jet(
            self.value * other.value,
            self.rate * other.value + self.value * other.rate,
            self.accel * other.value + 2.0 * self.rate * other.rate + self.value * other.accel,
        )

    def waves(self, waves: _Waves) -> Jet:
        """Sum of share * cos(multiple * self + phase)."""
        value, slope, bend = np.zeros((3, len(self.value)))
        for multiple, (share, phase) in waves.items():
            angle = multiple * self.value + phase
            cos, sin = share * np.cos(angle), (share * multiple) * np.sin(angle)
            value += cos
            slope -= sin
            bend -= multiple**2 * cos
        return Jet(value, slope * self.rate, bend * self.rate**2 + slope * self.accel)


@dataclass(frozen=True)
class DeviceMotion:
    """The device at N moments: place and acceleration (N, 3) in the world frame, attitude nRh and rate in h.

    h is the carrying frame: x forward, y left, z up where it is level and does not sway. How the device sits in it is
    its mount.
    """

    xyz_m: FloatArray
    accel_n: FloatArray
    quat_wxyz: FloatArray
    rate_h: FloatArray


class Motion:
    """The motion of walker and device at any time of a walk; all derivatives exact."""

    def __init__(self, walk: Walk, walker: Walker, rng: np.random.Generator) -> None:
        self._walker = walker
        self._curves = _spline(walk)

        def irregular(slowest: float, fastest: float, size_deg: float) -> list[_Waves]:
            size = np.radians(size_deg) * walker.gait_variation / 2.0
            rates, phases = 2.0 * np.pi * rng.uniform(slowest, fastest, (3, 2)), rng.uniform(0.0, 2.0 * np.pi, (3, 2))
            return [
                {rate: (size, phase) for rate, phase in zip(*axis, strict=True)}
                for axis in zip(rates.tolist(), phases.tolist(), strict=True)
            ]

        # wandering by steps, so that it rests with the walker; trembling by seconds
        self._drift = irregular(1.0 / 100.0, 1.0 / 40.0, walker.attitude_drift_deg)
        self._tremor = irregular(0.4, 3.0, walker.tremor_deg)

    def walker_pose(self, t_s: FloatArray) -> FloatArray:
        """(N, 4) x, y, z and walking direction (unwrapped) of the walker, without bounce and sway."""
        return np.asarray(self._curves(t_s)[:, :4])

    def device(self, t_s: FloatArray) -> DeviceMotion:
        """The device, which moves about the walker's pose and coincides with it when standing."""
        parts = [self._device(t_s[i : i + _BLOCK]) for i in range(0, len(t_s), _BLOCK)]
        names = ("xyz_m", "accel_n", "quat_wxyz", "rate_h")
        return DeviceMotion(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def _device(self, t_s: FloatArray) -> DeviceMotion:
        curve = self._jets(t_s)
        x, y, z = self._position(curve)
        yaw, pitch, roll = self._angles(curve)
        (cy, cp, cr), (sy, sp, sr) = ([f(a.value / 2.0) for a in (yaw, pitch, roll)] for f in (np.cos, np.sin))
        quat = (
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        )
        sin_p, cos_p, sin_r, cos_r = np.sin(pitch.value), np.cos(pitch.value), np.sin(roll.value), np.cos(roll.value)
        rate = (
            roll.rate - yaw.rate * sin_p,
            pitch.rate * cos_r + yaw.rate * cos_p * sin_r,
            yaw.rate * cos_p * cos_r - pitch.rate * sin_r,
        )
        return DeviceMotion(
            xyz_m=np.column_stack((x.value, y.value, z.value)),
            accel_n=np.column_stack((x.accel, y.accel, z.accel)),
            quat_wxyz=np.column_stack(quat),
            rate_h=np.column_stack(rate),
        )

    def _jets(self, t_s: FloatArray) -> dict[str, Jet]:
        value, rate, accel = (np.ascontiguousarray(self._curves(t_s, nu).T) for nu in (0, 1, 2))
        jets = {name: Jet(value[i], rate[i], accel[i]) for i, name in enumerate(KNOT_COLUMNS)}
        jets["stride"] = jets["phase"] * np.pi
        jets["time"] = Jet(t_s, np.ones(len(t_s)), np.zeros(len(t_s)))
        return jets

    def _position(self, curve: dict[str, Jet]) -> tuple[Jet, Jet, Jet]:
        """x, y, z in metres."""
        walker = self._walker

        def swing(swing: _Waves, strike: _Waves, size_m_s2: float) -> Jet:
            usual = np.pi * walker.cadence_hz
            in_metres = [
                {multiple: (-share / (multiple * usual) ** 2, phase) for multiple, (share, phase) in part.items()}
                for part in (swing, strike)
            ]
            return _swing(curve, *in_metres) * size_m_s2

        up = swing(_UP, _UP_STRIKE, walker.bounce_m_s2) + swing(_UP_LIMP, {}, walker.bounce_m_s2 * walker.asymmetry)
        forward = swing(_FORWARD, _FORWARD_STRIKE, walker.bounce_m_s2)
        left = swing(_LEFT, _LEFT_STRIKE, walker.bounce_m_s2)
        cos, sin = curve["yaw_rad"].waves({1: (1.0, 0.0)}), curve["yaw_rad"].waves({1: (1.0, -np.pi / 2.0)})
        x = curve["x_m"] + forward * cos + left * sin * -1.0
        y = curve["y_m"] + forward * sin + left * cos
        z = curve["z_m"] + up
        if walker.shake_s:
            x, y, z = (
                axis + curve["shake"] * curve["time"].waves(shaking)
                for axis, (shaking, _) in zip((x, y, z), _SHAKE, strict=True)
            )
        return x, y, z

    def _angles(self, curve: dict[str, Jet]) -> tuple[Jet, Jet, Jet]:
        """Yaw, pitch (about the left axis) and roll (about the forward axis) of h, turned in this order."""
        angles = [
            _swing(curve, swing, strike) * curve["sway"] * np.radians(self._walker.sway_deg)
            + curve["phase"].waves(self._drift[axis])
            + curve["time"].waves(self._tremor[axis])
            for axis, (swing, strike) in enumerate(_SWAY)
        ]
        if self._walker.shake_s:
            angles = [
                angle + curve["shake"] * curve["time"].waves(turning)
                for angle, (_, turning) in zip(angles, _SHAKE, strict=True)
            ]
        return curve["yaw_rad"] + angles[0], angles[1], angles[2]


def _swing(curve: dict[str, Jet], swing: _Waves, strike: _Waves) -> Jet:
    """What swings with the stride, some of it with how hard the heels strike."""
    return curve["swing"] * curve["stride"].waves(swing) + curve["strike"] * curve["stride"].waves(strike)


def _spline(walk: Walk) -> PPoly:
    """Quintic Hermite spline, a curve for each column, with continuous acceleration through the knots of a walk."""
    t, knots = walk.t_s, walk.knots
    rate, accel = np.zeros_like(knots), np.zeros_like(knots)
    for column in (KNOT_COLUMNS.index("z_m"), _YAW_AT, _DISTANCE_AT, _PHASE_AT):
        rate[:, column] = _knot_rates(t, knots[:, column])
    yaw, speed, turning = knots[:, _YAW_AT], rate[:, _DISTANCE_AT], rate[:, _YAW_AT]
    rate[:, 0], rate[:, 1] = speed * np.cos(yaw), speed * np.sin(yaw)
    accel[:, 0], accel[:, 1] = -speed * turning * np.sin(yaw), speed * turning * np.cos(yaw)
    dt = np.diff(t)[:, None]
    rise = np.diff(knots, axis=0)
    v0, v1, a0, a1 = rate[:-1] * dt, rate[1:] * dt, accel[:-1] * dt**2, accel[1:] * dt**2
    coefficients = np.stack(
        (
            (6.0 * rise - 3.0 * (v1 + v0) - (a0 - a1) / 2.0) / dt**5,
            (-15.0 * rise + 7.0 * v1 + 8.0 * v0 + (3.0 * a0 - 2.0 * a1) / 2.0) / dt**4,
            (10.0 * rise - 4.0 * v1 - 6.0 * v0 - (3.0 * a0 - a1) / 2.0) / dt**3,
            a0 / 2.0 / dt**2,
            v0 / dt,
            knots[:-1],
        )
    )
    return PPoly(coefficients, t)


def _knot_rates(t_s: FloatArray, values: FloatArray) -> FloatArray:
    """Rates that never overshoot (Fritsch & Butland 1984): harmonic mean of the neighbouring slopes, 0 at extremes."""
    slope = np.diff(values) / np.diff(t_s)
    before, after = slope[:-1], slope[1:]
    same = before * after > 0
    inner = np.where(same, 2.0 * before * after / np.where(same, before + after, 1.0), 0.0)
    return np.concatenate(([0.0], inner, [0.0]))
