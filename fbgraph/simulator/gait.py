"""A simulated walker, and the plan of the steps by which one walks a route.

``plan_walk`` gives the times and places of the steps; ``body_motion`` moves the body through them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.simulator.routes import Route, SmoothPath, round_corners

KNOT_COLUMNS = ("x_m", "y_m", "z_m", "yaw_rad", "distance_m", "phase", "sway", "swing", "strike", "shake")
"""Of ``Walk.knots``."""
_SETTLE_S = 0.5  # the body's swing dies away after the last step of a bout
_MIN_TURN_RAD = np.radians(10.0)  # a smaller bend of the route is not listed as a turn
_YAW_AT, _DISTANCE_AT, _PHASE_AT = (KNOT_COLUMNS.index(name) for name in ("yaw_rad", "distance_m", "phase"))


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
        knots: (K, 10) the columns ``KNOT_COLUMNS`` there. ``phase`` counts steps (a heel strike at every whole number),
            ``sway`` is how much the device turns for how far it swings (1 in the walker's usual gait), ``swing`` how
            much the body swings and ``strike`` how hard the heels strike (0 standing), ``shake`` how much the device
            is shaken.
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


def plan_walk(
    route: Route, walker: Walker, rng: np.random.Generator, gaits: Mapping[int, Walker] | None = None
) -> Walk:
    """The steps that walk a route, from standing before its start to standing after its end.

    Args:
        route: where to, and how long to pause there.
        walker: who walks.
        rng: draws what is irregular about the steps.
        gaits: other ways of walking, by the index of the waypoint from which on they are walked; the walker comes to a
            stand there.

    Raises:
        ConfigError: a gait that begins where the walker does not come to a stand.
    """
    gaits, stops = gaits or {}, route.stops()
    if not set(gaits) <= set(stops[:-1]):
        raise ConfigError(f"a gait changes where the walker stands (waypoints {stops[:-1]}), not at {sorted(gaits)}")
    plan = _Plan(route, walker, rng)
    plan.wait()
    for start, stop in pairwise(stops):
        if start in gaits:
            plan.change_gait(gaits[start])
        plan.walk(start, stop)
    return plan.finished()


class _Plan:
    """A walk while it is being planned, from one stop of the route to the next."""

    def __init__(self, route: Route, walker: Walker, rng: np.random.Generator) -> None:
        """The walker stands at the start, facing the first leg."""
        self._route, self._walker, self._pace = route, walker, _Pace(walker, rng)
        self._usual, self._swing, self._sway = walker, 1.0, 1.0
        leg = route.waypoints_m[1] - route.waypoints_m[0]
        self._yaw = float(np.arctan2(leg[1], leg[0]))
        self._t = walker.shake_s + walker.start_hold_s + float(route.pause_s[0])
        here = np.array([*route.waypoints_m[0], self._yaw, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0])
        self._times, self._knots, self._is_step = [np.zeros(1)], [here[None]], [np.zeros(1)]
        self._lengths: list[FloatArray] = []
        self._turns: list[tuple[float, float]] = []
        self._passed: list[float] = []

    def wait(self) -> None:
        """Shake the device if the walker does, then stand until the first step."""
        walker, yaw = self._walker, self._yaw
        if walker.shake_s:
            around = yaw + 2.0 * np.pi * max(1, round(walker.shake_s / 12.0))
            for when_s, yaw_rad in ((1.0, yaw), (walker.shake_s / 2.0, around), (walker.shake_s - 1.0, yaw)):
                self._stand_until(when_s, yaw_rad, 1.0)
            self._stand_until(walker.shake_s, yaw)
        self._stand_until(self._t, yaw)
        self._passed.append(self._t)

    def change_gait(self, walker: Walker) -> None:
        """Walk on in another way: another cadence and step length, another bounce and sway."""
        usual = self._usual
        self._walker = walker
        self._pace.change(walker)
        # the swing is in metres; what the walker gives is its acceleration at the usual cadence
        self._swing = (walker.bounce_m_s2 / usual.bounce_m_s2) * (usual.cadence_hz / walker.cadence_hz) ** 2
        self._sway = walker.sway_deg / usual.sway_deg / self._swing

    def walk(self, start: int, stop: int) -> None:
        """Walk from one stop to the next (indices of waypoints), and pause there."""
        route, walker = self._route, self._walker
        yaw = float(self._knots[-1][-1, _YAW_AT])
        waypoints_m = route.waypoints_m[start : stop + 1] + (self._knots[-1][-1, :3] - route.waypoints_m[start])
        if walker.gait_variation == 0:
            waypoints_m = self._pace.fitted(waypoints_m, yaw)
        path = round_corners(waypoints_m, walker.turn_length_m, yaw)
        self._turn_on_the_spot(yaw, float(path.yaw_rad[0]))
        step_t, step_s, swing, strike = self._pace.steps(path, self._t)
        self._pass_waypoints(path, step_t, step_s)
        self._lengths.append(np.diff(step_s, prepend=0.0))
        self._add_steps(path, step_t, step_s, swing, strike)
        self._t = float(step_t[-1]) + max(_SETTLE_S, float(route.pause_s[stop]))
        self._stand_until(self._t, float(path.yaw_rad[-1]))

    def finished(self) -> Walk:
        """The walk, after standing still at its end."""
        t = self._t
        t += max(self._walker.end_hold_s - (t - float(self._passed[-1])), 0.0)
        self._stand_until(t + 1.0, float(self._knots[-1][-1, _YAW_AT]))  # samples may be read a little after the end
        return Walk(
            t_s=np.concatenate(self._times),
            knots=np.concatenate(self._knots),
            is_step=np.concatenate(self._is_step) > 0,
            step_length_m=np.concatenate(self._lengths),
            turns=tuple(self._turns),
            passed_s=np.array(self._passed),
            end_s=t,
        )

    def _stand_until(self, when_s: float, yaw_rad: float, shake: float = 0.0) -> None:
        if when_s > self._times[-1][-1] + 1e-6:
            knot = self._knots[-1][-1:].copy()
            knot[0, [_YAW_AT, -1]] = yaw_rad, shake
            self._times.append(np.array([when_s]))
            self._knots.append(knot)
            self._is_step.append(np.zeros(1))

    def _turn_on_the_spot(self, from_rad: float, to_rad: float) -> None:
        if abs(angle := to_rad - from_rad) > 1e-9:
            if abs(angle) >= _MIN_TURN_RAD:
                self._turns.append((self._t + 0.35 + 0.25 * abs(angle), angle))
            self._t += 0.7 + 0.5 * abs(angle)
            self._stand_until(self._t, to_rad)

    def _pass_waypoints(self, path: SmoothPath, step_t: FloatArray, step_s: FloatArray) -> None:
        """When the waypoints are reached, and the turns at them."""
        reached = np.interp(path.waypoint_s_m[1:], np.append(0.0, step_s), np.append(self._t, step_t))
        self._passed += reached.tolist()
        bends = np.diff(path.yaw_rad)[1::2]
        self._turns += [
            (at, by) for at, by in zip(reached.tolist(), bends.tolist(), strict=False) if abs(by) >= _MIN_TURN_RAD
        ]

    def _add_steps(
        self, path: SmoothPath, step_t: FloatArray, step_s: FloatArray, swing: FloatArray, strike: FloatArray
    ) -> None:
        """A knot at each step, and one where the body has settled after the last."""
        first = np.floor(self._knots[-1][-1, _PHASE_AT]) + 1.0
        phase = first + np.append(np.arange(len(step_t)), len(step_t) - 0.5)  # who stands is between two steps
        s, rest = np.append(step_s, step_s[-1]), np.zeros(len(step_s) + 1)
        swing, strike = (self._swing * np.append(size, 0.0) for size in (swing, strike))
        sway = np.full(len(s), self._sway)
        distance = self._knots[-1][-1, _DISTANCE_AT] + s
        self._times.append(np.append(step_t, step_t[-1] + _SETTLE_S))
        self._knots.append(np.column_stack((*path.at(s), distance, phase, sway, swing, strike, rest)))
        self._is_step.append(np.append(np.ones(len(step_t)), 0.0))


class _Pace:
    """Chooses the steps; remembers the slow part of the cadence from one bout to the next."""

    def __init__(self, walker: Walker, rng: np.random.Generator) -> None:
        self._walker, self._rng, self._slow = walker, rng, 0.0

    def change(self, walker: Walker) -> None:
        """Go on as this walker."""
        self._walker = walker

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
