"""How a simulated walker moves: steps along a route, and the exact motion of a device in the hand or on the trunk.

The walker's own motion is a quintic spline through its steps; the device adds bounce and sway, which are harmonics of
the stride. All of it is twice differentiable in closed form, so that simulated sensors are exact derivatives of truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import PPoly

from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.simulator.routes import Route, SmoothPath, round_corners

_SETTLE_S = 0.5  # the body's swing dies away after the last step of a bout
_BLOCK = 2**14  # samples at once: what the processor's cache holds
_MIN_TURN_RAD = np.radians(10.0)  # a smaller bend of the route is not listed as a turn
_COLUMNS = ("x_m", "y_m", "z_m", "yaw_rad", "distance_m", "phase", "swing", "strike", "shake")
_YAW_AT, _DISTANCE_AT, _PHASE_AT = (_COLUMNS.index(name) for name in ("yaw_rad", "distance_m", "phase"))

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


def check_options(options: object, name: str, may_be_negative: tuple[str, ...] = ()) -> None:
    """Refuse options that are not finite numbers, or negative where that cannot be.

    Raises:
        ConfigError: naming the option.
    """
    for option, value in vars(options).items():
        if isinstance(value, float | int) and not (np.isfinite(value) and (value >= 0 or option in may_be_negative)):
            raise ConfigError(f"{name}: {option} cannot be {value}")


@dataclass(frozen=True)
class Walker:
    """Who walks, and how. Defaults: an adult at 1.3 m/s with the device held in front of the body."""

    cadence_hz: float = 1.8
    """Steps per second on level straights."""
    alpha_m: float = 0.35
    """Step length is alpha + beta * cadence + gamma * slope, the paper's model; slope as in StepLengthConfig."""
    beta_m_s: float = 0.20
    """Metres per hertz of cadence; 0 together with gamma for steps of constant length."""
    gamma_m: float = -1.75
    """Metres per unit slope, slope = |climb rate| / flat walking speed; never positive."""
    gait_variation: float = 1.0
    """Scales all that is irregular about a walker: the six below. 0 is a metronome."""
    person_sigma: float = 0.04
    """Relative standard deviation of this wearer's step length from the model's, drawn once a walk."""
    cadence_sigma: float = 0.025
    """Relative standard deviation of cadence; half of its variance changes slowly, over some ten steps."""
    length_sigma: float = 0.03
    """Relative standard deviation of step length about the model."""
    swing_sigma: float = 0.1
    """Relative standard deviation of the bounce of a step; three times that for the jolt of its heel strike."""
    tremor_deg: float = 0.1
    """Amplitude of the hand's own tremble, also when standing."""
    attitude_drift_deg: float = 2.0
    """How far the device slowly wanders in the hand, about each axis, over some 40-100 steps."""
    bounce_m_s2: float = 1.8
    """Amplitude of vertical acceleration at the step frequency, at the usual cadence."""
    asymmetry: float = 0.1
    """Difference between left and right steps, relative to the bounce."""
    sway_deg: float = 2.5
    """Yaw sway of the device with every stride, amplitude; pitch and roll follow."""
    turn_length_m: float = 1.4
    """Length of the arc into which a corner is rounded: two steps."""
    start_hold_s: float = 3.0
    """Standing still before the first step."""
    end_hold_s: float = 2.0
    """Standing still after the last; at least half a second."""
    shake_s: float = 0.0
    """Shaking and turning on the spot before anything else: 0, or at least 4."""

    def __post_init__(self) -> None:
        check_options(self, "walker", may_be_negative=("alpha_m", "beta_m_s", "gamma_m"))
        if not 0.5 <= self.cadence_hz <= 4.0:
            raise ConfigError(f"walker: nobody walks {self.cadence_hz} steps a second (0.5 to 4)")
        slow_m, fast_m = self.flat_length_m(0.4 * self.cadence_hz), self.flat_length_m(1.2 * self.cadence_hz)
        if min(slow_m, fast_m) < 0.1 or self.gamma_m > 0:
            raise ConfigError("walker: alpha, beta and gamma give steps shorter than 0.1 m, or longer ones on stairs")
        if 0 < self.shake_s < 4 or self.turn_length_m < 0.1:
            raise ConfigError("walker: shake_s must be 0 or at least 4, turn_length_m at least 0.1")

    def flat_length_m(self, cadence_hz: float) -> float:
        """Step length on level ground."""
        return self.alpha_m + self.beta_m_s * cadence_hz

    def step_length_m(self, cadence_hz: float, grade: float) -> float:
        """Step length where the path rises by ``grade`` (tangent): L = flat + gamma * (grade * L / flat)."""
        flat = self.flat_length_m(cadence_hz)
        return flat / (1.0 - self.gamma_m * abs(grade) / flat)


@dataclass(frozen=True)
class Walk:
    """A walk as planned step by step.

    Attributes:
        t_s: (K,) times of the spline's knots, increasing; the last is after the end of the walk.
        knots: (K, 9) the columns ``_COLUMNS`` there. ``phase`` counts steps (a heel strike at every whole number),
            ``swing`` is how much the body swings and ``strike`` how hard the heels strike (0 standing), ``shake`` how
            much the device is shaken.
        is_step: (K,) whether a step ends at this knot.
        step_length_m: one for each step.
        turns: (time, signed angle) of every corner.
        passed_s: (M,) when each waypoint was reached.
        end_s: end of the log.
    """

    t_s: FloatArray
    knots: FloatArray
    is_step: BoolArray
    step_length_m: FloatArray
    turns: tuple[tuple[float, float], ...]
    passed_s: FloatArray
    end_s: float

    @property
    def distance_m(self) -> FloatArray:
        """(K,) walked up to each knot."""
        return np.asarray(self.knots[:, _DISTANCE_AT])


def plan_walk(route: Route, walker: Walker, rng: np.random.Generator) -> Walk:
    """Walk a route step by step."""
    stops = route.stops()
    leg = route.waypoints_m[1] - route.waypoints_m[0]
    yaw = float(np.arctan2(leg[1], leg[0]))
    t = walker.shake_s + walker.start_hold_s + float(route.pause_s[0])
    here = np.array([*route.waypoints_m[0], yaw, 0.0, 0.5, 0.0, 0.0, 0.0])
    times, knots, is_step, lengths = [np.zeros(1)], [here[None]], [np.zeros(1)], []
    turns: list[tuple[float, float]] = []

    def stand_until(when_s: float, yaw_rad: float, shake: float = 0.0) -> None:
        if when_s > times[-1][-1] + 1e-6:
            knot = knots[-1][-1:].copy()
            knot[0, [_YAW_AT, -1]] = yaw_rad, shake
            times.append(np.array([when_s]))
            knots.append(knot)
            is_step.append(np.zeros(1))

    if walker.shake_s:
        around = yaw + 2.0 * np.pi * max(1, round(walker.shake_s / 12.0))
        for when_s, yaw_rad in ((1.0, yaw), (walker.shake_s / 2.0, around), (walker.shake_s - 1.0, yaw)):
            stand_until(when_s, yaw_rad, 1.0)
        stand_until(walker.shake_s, yaw)
    stand_until(t, yaw)
    passed = [t]
    pace = _Pace(walker, rng)
    for start, stop in pairwise(stops):
        yaw = float(knots[-1][-1, _YAW_AT])
        waypoints_m = route.waypoints_m[start : stop + 1] + (knots[-1][-1, :3] - route.waypoints_m[start])
        if walker.gait_variation == 0:
            waypoints_m = pace.fitted(waypoints_m, yaw)
        path = round_corners(waypoints_m, walker.turn_length_m, yaw)
        if abs(angle := float(path.yaw_rad[0]) - yaw) > 1e-9:
            if abs(angle) >= _MIN_TURN_RAD:
                turns.append((t + 0.35 + 0.25 * abs(angle), angle))
            t += 0.7 + 0.5 * abs(angle)
            stand_until(t, float(path.yaw_rad[0]))
        step_t, step_s, swing, strike = pace.steps(path, t)
        reached = np.interp(path.waypoint_s_m[1:], np.append(0.0, step_s), np.append(t, step_t))
        passed += reached.tolist()
        bends = np.diff(path.yaw_rad)[1::2]
        turns += [
            (at, by) for at, by in zip(reached.tolist(), bends.tolist(), strict=False) if abs(by) >= _MIN_TURN_RAD
        ]
        lengths.append(np.diff(step_s, prepend=0.0))
        first = np.floor(knots[-1][-1, _PHASE_AT]) + 1.0
        phase = first + np.append(np.arange(len(step_t)), len(step_t) - 0.5)  # who stands is between two steps
        s, rest = np.append(step_s, step_s[-1]), np.zeros(len(step_s) + 1)
        swing, strike = np.append(swing, 0.0), np.append(strike, 0.0)
        times.append(np.append(step_t, step_t[-1] + _SETTLE_S))
        knots.append(np.column_stack((*path.at(s), knots[-1][-1, _DISTANCE_AT] + s, phase, swing, strike, rest)))
        is_step.append(np.append(np.ones(len(step_t)), 0.0))
        t = float(step_t[-1]) + max(_SETTLE_S, float(route.pause_s[stop]))
        stand_until(t, float(path.yaw_rad[-1]))
    t += max(walker.end_hold_s - (t - float(passed[-1])), 0.0)
    stand_until(t + 1.0, float(knots[-1][-1, _YAW_AT]))  # samples may be read a little after the end
    return Walk(
        t_s=np.concatenate(times),
        knots=np.concatenate(knots),
        is_step=np.concatenate(is_step) > 0,
        step_length_m=np.concatenate(lengths),
        turns=tuple(turns),
        passed_s=np.array(passed),
        end_s=t,
    )


class _Pace:
    """Chooses the steps; remembers the slow part of the cadence from one bout to the next."""

    def __init__(self, walker: Walker, rng: np.random.Generator) -> None:
        self._walker, self._rng, self._slow = walker, rng, 0.0

    def steps(self, path: SmoothPath, start_s: float) -> tuple[FloatArray, ...]:
        """Times, distances along the path, swings and strikes of the steps that walk it from end to end.

        Every step follows the walker's model, but the last two share what is left of the path between them.
        """
        return self._steps(path, start_s, float(path.s_m[-1]))

    def fitted(self, waypoints_m: FloatArray, yaw_rad: float) -> FloatArray:
        """The waypoints stretched on the plan, by less than a step, so that whole steps lead along them.

        A metronome makes no half steps.
        """
        for _ in range(8):
            path = round_corners(waypoints_m, self._walker.turn_length_m, yaw_rad)
            total_m = float(path.s_m[-1])
            _, ends_m, _, _ = self._steps(
                path, 0.0, total_m + 2.0 * self._walker.flat_length_m(self._walker.cadence_hz)
            )
            ratio = float(ends_m[np.argmin(np.abs(ends_m - total_m))]) / total_m
            waypoints_m = waypoints_m.copy()
            waypoints_m[:, :2] = waypoints_m[0, :2] + ratio * (waypoints_m[:, :2] - waypoints_m[0, :2])
        return waypoints_m

    def _steps(self, path: SmoothPath, start_s: float, total_m: float) -> tuple[FloatArray, ...]:
        """``steps`` along a path taken to be ``total_m`` long."""
        walker = self._walker
        usual_m = walker.flat_length_m(walker.cadence_hz)
        t, s, closing = start_s, 0.0, False
        out: list[tuple[float, float, float, float]] = []
        while total_m - s > 1e-6:
            left_m = total_m - s
            ahead_m = min(usual_m, left_m)
            grade = float(path.z(s + ahead_m / 2) - path.z(s)) / (ahead_m / 2)
            turn_rad = abs(float(path.yaw(s + ahead_m) - path.yaw(s)))
            slow, fast, longer, swinging, striking = self._variation()
            cadence = walker.cadence_hz * float(np.exp(np.clip(slow + fast, -0.4, 0.4)))
            cadence *= (1.0 - 0.15 * min(turn_rad / 0.8, 1.0)) * (1.0 - 0.15 * min(abs(grade) / 0.5, 1.0))
            halt = 0.8 if left_m < 1.2 * usual_m and walker.gait_variation > 0 else 1.0
            cadence *= 0.65 if not out else halt  # setting off, coming to a stand
            length = walker.step_length_m(cadence, grade) * min(max(1.0 + longer, 0.5), 1.5)
            if closing or left_m < length * (1.0 + 1e-3):
                length = left_m
            elif left_m < length * (2.0 - 1e-3):
                length, closing = left_m / 2.0, True
            t, s = t + 1.0 / cadence, s + length
            # an inverted pendulum's bounce goes with the square of its step
            swing = (min(length, walker.flat_length_m(cadence)) / usual_m) ** 2 if abs(grade) < 0.1 else 1.0
            swing = min(max(swing * (1.0 + swinging), 0.6), 1.6)
            out.append((t, s, swing, swing * min(max(1.0 + striking, 0.0), 2.0)))
        return tuple(np.array(out).T)

    def _variation(self) -> tuple[float, ...]:
        """Log-cadence (slow part and fast part), and relative length, swing and strike of the next step."""
        walker, scale = self._walker, self._walker.gait_variation
        drive, *fast = np.clip(self._rng.standard_normal(5), -2.5, 2.5).tolist()
        cadence_sigma, keep = walker.cadence_sigma / np.sqrt(2.0), 0.9
        self._slow = keep * self._slow + cadence_sigma * np.sqrt(1.0 - keep**2) * drive
        sigmas = (cadence_sigma, walker.length_sigma, walker.swing_sigma, 3.0 * walker.swing_sigma)
        return scale * self._slow, *(scale * sigma * value for sigma, value in zip(sigmas, fast, strict=True))


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
        jets = {name: Jet(value[i], rate[i], accel[i]) for i, name in enumerate(_COLUMNS)}
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
            _swing(curve, swing, strike) * np.radians(self._walker.sway_deg)
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
    for column in (_COLUMNS.index("z_m"), _YAW_AT, _DISTANCE_AT, _PHASE_AT):
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
