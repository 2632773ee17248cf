"""Simulated walks with an M5StickC-class wearable (MPU6886, BMM150, BMP280), with exact truth.

``simulate(load_route("obstacle"), seed=1)``. The walker is in ``gait`` and ``body_motion``, the routes are in
``routes``, what can be set in ``simulate_options``; here are the iron on the way and what the sensors make of it all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fbgraph.core.atmosphere import altitude_pressure_hpa, pressure_altitude_m
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray, IntArray, rotate
from fbgraph.core.sensor_log import Event, SensorLog, Stream
from fbgraph.core.units import STANDARD_GRAVITY_M_S2
from fbgraph.simulator.body_motion import Motion
from fbgraph.simulator.gait import Walk, Walker, plan_walk
from fbgraph.simulator.routes import Route
from fbgraph.simulator.simulate_options import Inertial, SimulateOptions

_LONGEST_S = 86_400.0


@dataclass(frozen=True)
class TrueSteps:
    """The steps: ``t_s`` (K,) when each ends (heel strike), ``length_m`` (K,) along the path, ``xyz_m`` (K, 3)."""

    t_s: FloatArray
    length_m: FloatArray
    xyz_m: FloatArray


@dataclass(frozen=True)
class TrueTurns:
    """The corners: ``t_s`` (T,) their middles, ``angle_rad`` (T,) signed, left positive, ``x_m``, ``y_m`` (T,)."""

    t_s: FloatArray
    angle_rad: FloatArray
    x_m: FloatArray
    y_m: FloatArray


@dataclass(frozen=True)
class SimulatedWalk:
    """A log and what really happened.

    Attributes:
        log: what the sensors saw.
        t_s: (N,) an even grid at the device's rate, on the log's clock (0 at its first row).
        x_m, y_m, z_m: (N,) the walker, world frame; smooth, without the device's bounce and sway.
        yaw_rad: (N,) walking direction, unwrapped; where the walker faces. In corners the velocity is up to 10° off it.
        device_m: (N, 3) the device, with bounce and sway; (0, 0, 0) at the start like the walker.
        quat_wxyz: (N, 4) the device's attitude nRb.
        steps, turns: in order of time, ``t_s`` on the log's clock.
        checkpoints: the route's waypoints, on the log's event clock (``t_s + log.t0_s``): where the walker really was
            when nearest to each, which at a rounded corner is inside of it.
        labels: names of the checkpoints; the log has them as events too.
    """

    log: SensorLog
    t_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray
    yaw_rad: FloatArray
    device_m: FloatArray
    quat_wxyz: FloatArray
    steps: TrueSteps
    turns: TrueTurns
    checkpoints: Checkpoints
    labels: tuple[str, ...]


def simulate(route: Route, options: SimulateOptions | None = None, seed: int = 0) -> SimulatedWalk:
    """Walk a route with a wearable.

    Args:
        route: from ``routes.load_route``.
        options: defaults if None.
        seed: the same seed gives the same walk; any other different steps, errors and iron.

    Raises:
        ConfigError: a seed that is negative, or a walk of more than a day.
    """
    if seed < 0:
        raise ConfigError(f"the seed must be 0 or more, not {seed}")
    options = options or SimulateOptions()
    # streams of their own, so that a change of one option leaves all else as it was
    streams = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(9)]
    gait_rng, sway_rng, *world_rngs, person_rng = streams
    options = _someone(options, person_rng)
    lap = route
    if options.duration_s is not None:
        route = route.repeated(_laps_for(route, options.walker, options.duration_s))
    _require_a_day(route, options.walker)
    walk = plan_walk(route, options.walker, gait_rng, options.gaits)
    motion = Motion(walk, options.walker, sway_rng)

    t_s = np.arange(int(walk.end_s * options.device.rate_hz) + 1) / options.device.rate_hz
    pose = motion.walker_pose(t_s)
    carried = motion.device(t_s)
    n_r_b = Rotation.from_quat(np.roll(carried.quat_wxyz, -1, axis=1)) * options.device.h_r_b

    irons = _place_irons(motion, walk, lap, options, world_rngs[0])
    passed = motion.walker_pose(walk.passed_s)
    log = _record(motion, t_s, irons, options, world_rngs[1:])
    pressed = np.minimum(np.searchsorted(log.acc.t_s, walk.passed_s), len(log.acc) - 1)
    log = replace(
        log,
        name=f"{Path(route.name).stem}-{seed}",
        events=tuple(
            Event(when_s, label) for when_s, label in zip(log.acc.t_s[pressed].tolist(), route.labels, strict=True)
        ),
        notices=(f"simulated: route {route.name}, seed {seed}",),
    )
    turn_s, turn_rad = np.array(walk.turns).reshape(-1, 2).T
    where = motion.walker_pose(turn_s)
    knots = walk.knots[walk.is_step]
    return SimulatedWalk(
        log=log,
        t_s=t_s,
        x_m=pose[:, 0],
        y_m=pose[:, 1],
        z_m=pose[:, 2],
        yaw_rad=pose[:, 3],
        device_m=carried.xyz_m,
        quat_wxyz=np.roll(n_r_b.as_quat(), 1, axis=1),
        steps=TrueSteps(walk.t_s[walk.is_step], walk.step_length_m, knots[:, :3]),
        turns=TrueTurns(turn_s, turn_rad, where[:, 0], where[:, 1]),
        checkpoints=checkpoints(
            walk.passed_s + log.t0_s, passed[:, 0], passed[:, 1], passed[:, 2], source=f"simulated route {route.name}"
        ),
        labels=route.labels,
    )


def _someone(options: SimulateOptions, rng: np.random.Generator) -> SimulateOptions:
    """The options with this wearer's own step length and way of holding the device."""
    device = options.device
    longer, turned = np.clip(rng.standard_normal(2), -2.5, 2.5).tolist()

    def own(walker: Walker) -> Walker:
        scale = 1.0 + walker.gait_variation * walker.person_sigma * longer
        return replace(walker, **{name: scale * getattr(walker, name) for name in ("alpha_m", "beta_m_s", "gamma_m")})

    return replace(
        options,
        walker=own(options.walker),
        gaits={waypoint: own(walker) for waypoint, walker in options.gaits.items()},
        device=replace(device, mount_yaw_deg=device.mount_yaw_deg + options.noise * options.errors.mount_deg * turned),
    )


def _laps_for(route: Route, walker: Walker, duration_s: float) -> int:
    """The whole number of laps, at least one, whose walk comes nearest to this duration."""
    if duration_s > _LONGEST_S:
        raise ConfigError(f"a simulated walk lasts at most a day, not {duration_s:g} s")
    _require_a_day(route, walker)
    metronome, rng = replace(walker, gait_variation=0.0), np.random.default_rng(0)
    one_s, two_s = (plan_walk(route.repeated(laps), metronome, rng).end_s for laps in (1, 2))
    return max(1, round((duration_s - one_s) / (two_s - one_s)) + 1)


def _require_a_day(route: Route, walker: Walker) -> None:
    """Refuse a route that takes longer, before it is planned step by step.

    Raises:
        ConfigError: it does, at the walker's pace on level straights.
    """
    pace_m_s = walker.cadence_hz * walker.flat_length_m(walker.cadence_hz)
    least_s = route.length_m / pace_m_s + float(route.pause_s.sum())
    if least_s > _LONGEST_S:
        raise ConfigError(f"a simulated walk lasts at most a day, and {route.name} takes {least_s / 3600.0:.4g} h")


@dataclass(frozen=True)
class Irons:
    """Magnetic dipoles: ``place_m`` (I, 3), ``moment`` (I, 3) in µT·m³, world frame."""

    place_m: FloatArray
    moment: FloatArray

    def field_n(self, xyz_m: FloatArray) -> FloatArray:
        """(N, 3) what they add to the field at these places, in µT, world frame."""
        total = np.zeros_like(xyz_m)
        for place, moment in zip(self.place_m, self.moment, strict=True):
            away = xyz_m - place
            square = (away**2).sum(axis=1) + 0.3**2  # iron has a size: no pole to walk through
            total += 3.0 * away * (away @ moment / square**2.5)[:, None] - moment / square[:, None] ** 1.5
        return total


def _place_irons(motion: Motion, walk: Walk, lap: Route, options: SimulateOptions, rng: np.random.Generator) -> Irons:
    """Half of them in the floor, half in the walls, beside random places of the first lap."""
    environment = options.environment
    count = round(environment.irons_per_100m * lap.length_m / 100.0)
    lap_m = float(np.interp(walk.passed_s[len(lap.waypoints_m) - 1], walk.t_s, walk.distance_m))
    beside = motion.walker_pose(np.interp(rng.uniform(0.0, lap_m, count), walk.distance_m, walk.t_s))
    in_floor = rng.random(count) < 0.5
    sideways = np.where(
        in_floor, rng.uniform(-1.0, 1.0, count), rng.choice((-1.0, 1.0), count) * rng.uniform(1, 2.5, count)
    )
    below = np.where(in_floor, rng.uniform(1.0, 1.3, count), rng.uniform(-0.8, 0.8, count))
    offset = np.column_stack((-sideways * np.sin(beside[:, 3]), sideways * np.cos(beside[:, 3]), -below))
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # seen from the side at distance r a dipole adds moment / r³
    strength = environment.iron_ut * rng.uniform(0.5, 1.5, count) * np.linalg.norm(offset, axis=1) ** 3
    strength *= options.anomalies if options.noise > 0 else 0.0
    return Irons(beside[:, :3] + offset, direction * strength[:, None])


def _record(
    motion: Motion, t_s: FloatArray, irons: Irons, options: SimulateOptions, rngs: list[np.random.Generator]
) -> SensorLog:
    """Read the sensors at about these times; name, events and notices are left to the caller."""
    device, errors, noise = options.device, options.errors, options.noise
    sampling_rng, acc_rng, gyro_rng, mag_rng, air_rng = rngs
    read_s = row_s = t_s
    if noise > 0:
        jitter_s = noise * errors.jitter_s * sampling_rng.standard_normal(len(t_s))
        jitter_s[0] = 0.0
        there = sampling_rng.random(len(t_s)) >= min(noise * errors.missing_rows, 0.5)
        there[[0, -1]] = True
        read_s = (t_s + np.clip(jitter_s, -0.3 / device.rate_hz, 0.3 / device.rate_hz))[there]
        row_s = np.floor(read_s * 1000.0 + 1e-6) / 1000.0

    at_acc, at_gyro = motion.device(read_s), motion.device(read_s + noise * errors.gyro_delay_s)
    to_h = at_acc.quat_wxyz * (1.0, -1.0, -1.0, -1.0)
    to_b = device.h_r_b.as_matrix()  # of row vectors: v_h @ h_r_b = b_r_h v_h
    acc = rotate(to_h, at_acc.accel_n + np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])) @ to_b
    gyro = at_gyro.rate_h @ to_b
    mag_rows = _rows_with_news(read_s, device.mag_rate_hz)
    field_n = options.environment.field_n + irons.field_n(at_acc.xyz_m[mag_rows])
    mag = rotate(to_h[mag_rows], field_n) @ to_b
    air_rows = _rows_with_news(read_s, device.pressure_rate_hz)
    start_m = pressure_altitude_m(options.environment.pressure_hpa)
    pressure = altitude_pressure_hpa(start_m + at_acc.xyz_m[air_rows, 2])
    if noise > 0:
        acc = _measured(acc, errors.acc, noise, device.rate_hz, acc_rng)
        gyro = _measured(gyro, errors.gyro, noise, device.rate_hz, gyro_rng)
        mag += noise * errors.hard_iron_ut * mag_rng.standard_normal(3)
        mag += noise * errors.mag_noise_ut * mag_rng.standard_normal(mag.shape)
        mag = _rounded(mag, errors.mag_step_ut)
        pressure += noise * errors.weather_hpa * _weather(read_s[air_rows], air_rng)
        pressure += noise * errors.pressure_noise_hpa * air_rng.standard_normal(len(pressure))
        pressure = _rounded(pressure, errors.pressure_step_hpa)
    return SensorLog(
        name="",
        format="m5stickc",
        t0_s=round(device.clock_start_s, 3),
        acc=Stream(row_s, acc),
        gyro=Stream(row_s, gyro),
        mag=Stream(row_s[mag_rows], mag),
        pressure=Stream(row_s[air_rows], pressure[:, None]),
        counts={"rows": len(t_s), "missing": len(t_s) - len(row_s)},
    )


def _rows_with_news(read_s: FloatArray, rate_hz: float) -> IntArray:
    """Rows at which a sensor with a pace of its own has a new sample."""
    rows = np.unique(np.searchsorted(read_s, np.arange(0.0, read_s[-1], 1.0 / rate_hz)))
    return rows[rows < len(read_s)]


def _measured(true: FloatArray, spec: Inertial, noise: float, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """(N, 3) what an inertial sensor makes of (N, 3) true values: wrong, rounded and within its range."""
    scale, bias = rng.standard_normal((2, 3))
    values = true * (1.0 + noise * spec.scale * scale) + noise * spec.bias * bias
    values += np.cumsum(rng.standard_normal(true.shape), axis=0) * (noise * spec.bias_walk / np.sqrt(rate_hz))
    values += noise * spec.noise * rng.standard_normal(true.shape)
    step = spec.full_scale / 2**15
    return np.asarray(np.clip(np.round(values / step), -(2**15), 2**15 - 1) * step)


def _rounded(values: FloatArray, step: float) -> FloatArray:
    return np.asarray(np.round(values / step) * step if step else values)


def _weather(t_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(N,) a slow drift, 0 at the start, of amplitude about 1."""
    drift = np.zeros(len(t_s))
    for period_s, phase in zip(rng.uniform(1200.0, 10_800.0, 3), rng.uniform(0.0, 2.0 * np.pi, 3), strict=True):
        drift += (np.sin(2.0 * np.pi * t_s / period_s + phase) - np.sin(phase)) / 3.0**0.5
    return drift
