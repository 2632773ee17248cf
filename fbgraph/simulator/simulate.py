"""Simulated walks with an M5StickC-class wearable (MPU6886, BMM150, BMP280), with exact truth.

``simulate(load_route("obstacle"), seed=1)``. The walker is in ``gait``, the routes are in ``routes``; here are the
world around them (Earth field, iron, air) and what the sensors make of it. Sources of the sensors' numbers: TDK
InvenSense DS-000193 (MPU-6886), Bosch BST-BMM150-DS001, Bosch BST-BMP280-DS001, and the registers that M5Stack's
MPU6886.cpp sets (±8 g, ±2000 °/s, low-pass 218 and 176 Hz).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fbgraph.core.atmosphere import altitude_pressure_hpa, pressure_altitude_m
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray, IntArray, rotate
from fbgraph.core.log import Event, SensorLog, Stream
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from fbgraph.simulator.gait import Motion, Walk, Walker, check_options, plan_walk
from fbgraph.simulator.routes import Route


@dataclass(frozen=True)
class Device:
    """The wearable and how it is carried. Defaults: lying in the hand, top edge forward, tilted up by 20°."""

    tilt_deg: float = 20.0
    """How far the top edge (body y) is raised above the horizon; between -90 and 90."""
    mount_yaw_deg: float = 0.0
    """How far the top edge points to the left of the walking direction."""
    rate_hz: float = 100.0
    """Rows per second; at most 200, as they are stamped in whole milliseconds."""
    mag_rate_hz: float = 22.0
    """New magnetometer samples per second; the BMM150 measures at its own pace."""
    pressure_rate_hz: float = 12.0
    """New barometer samples per second."""
    clock_start_s: float = 5.0
    """The device's clock at the first row, whole milliseconds: how long ago it was switched on."""

    def __post_init__(self) -> None:
        check_options(self, "device", may_be_negative=("tilt_deg", "mount_yaw_deg"))
        if not (1.0 <= self.rate_hz <= 200.0 and self.mag_rate_hz > 0 and self.pressure_rate_hz > 0):
            raise ConfigError("device: rate_hz must be 1 to 200, mag_rate_hz and pressure_rate_hz positive")
        if not abs(self.tilt_deg) < 90:
            raise ConfigError("device: tilt_deg must be between -90 and 90")

    @property
    def h_r_b(self) -> Rotation:
        """From the device's axes to the carrying frame (x forward, y left, z up)."""
        flat = Rotation.from_euler("z", -90, degrees=True)  # body y forward, body x to the right
        return Rotation.from_euler("ZY", (self.mount_yaw_deg, -self.tilt_deg), degrees=True) * flat


@dataclass(frozen=True)
class Inertial:
    """Errors of an inertial sensor, in its SI unit (m/s² or rad/s); standard deviations, the same for each axis."""

    noise: float
    """Of a sample."""
    bias: float
    """Constant, drawn once a walk."""
    bias_walk: float
    """Per root second."""
    scale: float
    """Relative, drawn once a walk."""
    full_scale: float
    """Not an error but the range, to each side; in 2**15 steps."""

    def __post_init__(self) -> None:
        check_options(self, "errors")
        if self.full_scale == 0:
            raise ConfigError("errors: full_scale must be positive")


@dataclass(frozen=True)
class SensorErrors:
    """What is wrong with the sensors; standard deviations unless said otherwise."""

    acc: Inertial = Inertial(
        100e-6 * STANDARD_GRAVITY_M_S2 * 235.0**0.5,
        0.01 * STANDARD_GRAVITY_M_S2,
        2e-5,
        0.003,
        8.0 * STANDARD_GRAVITY_M_S2,
    )
    """100 µg/√Hz over the noise bandwidth of the 218 Hz low-pass, 15 mm/s²; bias 10 mg."""
    gyro: Inertial = Inertial(
        0.004 * DEGREE_RAD * 177.0**0.5, 0.5 * DEGREE_RAD, 0.002 * DEGREE_RAD, 0.003, 2000.0 * DEGREE_RAD
    )
    """0.004 °/s/√Hz over the noise bandwidth of the 176 Hz low-pass, 0.05 °/s; bias 0.5 °/s,
    0.12 °/s more after an hour; scale within ±1 %."""
    mag_noise_ut: float = 0.4
    mag_step_ut: float = 0.3
    """Resolution."""
    hard_iron_ut: float = 1.0
    """What is left of the hard iron after calibration."""
    pressure_noise_hpa: float = 0.013
    """1.3 Pa."""
    pressure_step_hpa: float = 0.0016
    """Resolution, 16-fold oversampling."""
    weather_hpa: float = 0.15
    """Amplitude of the slow change of air pressure, over 20 minutes to 3 hours."""
    mount_deg: float = 3.0
    """How far the device's forward is off the wearer's, drawn once a walk."""
    jitter_s: float = 0.001
    """Of the moment of a row."""
    gyro_delay_s: float = 0.0004
    """Not random: the gyroscope is read in a transaction of its own, this long after the accelerometer."""
    missing_rows: float = 0.0005
    """Not random: share of rows that never arrive."""

    def __post_init__(self) -> None:
        check_options(self, "errors")


@dataclass(frozen=True)
class Environment:
    """The world: magnetic field, iron, air."""

    field_ut: float = 45.0
    dip_deg: float = 60.0
    """Inclination, down toward North."""
    declination_deg: float = 0.0
    """Of magnetic North, positive East."""
    irons_per_100m: float = 12.0
    """How many magnetic dipoles lie in floor and walls, per 100 m of one lap."""
    iron_ut: float = 6.0
    """What one of them adds where the route passes nearest: 0.5 to 1.5 times this, and up to twice that on its axis."""
    pressure_hpa: float = 1008.0
    """At the start."""

    def __post_init__(self) -> None:
        check_options(self, "environment", may_be_negative=("dip_deg", "declination_deg"))
        if not 300 < self.pressure_hpa < 1100:
            raise ConfigError("environment: pressure_hpa must be between 300 and 1100")

    @property
    def field_n(self) -> FloatArray:
        """(3,) the Earth's field in µT, world frame."""
        dip, declination = self.dip_deg * DEGREE_RAD, self.declination_deg * DEGREE_RAD
        level = np.cos(dip)
        return self.field_ut * np.array([level * np.sin(declination), level * np.cos(declination), -np.sin(dip)])


@dataclass(frozen=True)
class SimulateOptions:
    """Everything but the route and the seed."""

    walker: Walker = field(default_factory=Walker)
    device: Device = field(default_factory=Device)
    errors: SensorErrors = field(default_factory=SensorErrors)
    environment: Environment = field(default_factory=Environment)
    noise: float = 1.0
    """Scales all of ``errors``; 0 is perfect sensors: no rounding, saturation, jitter, missing rows or iron either."""
    anomalies: float = 1.0
    """Scales the iron by itself."""
    duration_s: float | None = None
    """Repeat the route so often that the walk lasts as near to this as whole laps can (at least one)."""

    def __post_init__(self) -> None:
        if not (0 <= self.noise < np.inf and 0 <= self.anomalies < np.inf):
            raise ConfigError("noise and anomalies must be 0 or more")
        if self.duration_s is not None and not 0 < self.duration_s < np.inf:
            raise ConfigError(f"duration_s must be positive, not {self.duration_s}")


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
        ConfigError: a seed that is negative, a duration that would take too many laps.
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
    walk = plan_walk(route, options.walker, gait_rng)
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
    walker, device = options.walker, options.device
    longer, turned = np.clip(rng.standard_normal(2), -2.5, 2.5).tolist()
    scale = 1.0 + walker.gait_variation * walker.person_sigma * longer
    lengths = {name: scale * getattr(walker, name) for name in ("alpha_m", "beta_m_s", "gamma_m")}
    mount_deg = device.mount_yaw_deg + options.noise * options.errors.mount_deg * turned
    return replace(options, walker=replace(walker, **lengths), device=replace(device, mount_yaw_deg=mount_deg))


def _laps_for(route: Route, walker: Walker, duration_s: float) -> int:
    """The whole number of laps, at least one, whose walk comes nearest to this duration."""
    if duration_s > 86_400:
        raise ConfigError(f"a simulated walk lasts at most a day, not {duration_s:g} s")
    metronome, rng = replace(walker, gait_variation=0.0), np.random.default_rng(0)
    one_s, two_s = (plan_walk(route.repeated(laps), metronome, rng).end_s for laps in (1, 2))
    return max(1, round((duration_s - one_s) / (two_s - one_s)) + 1)


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
