"""What can be set about a simulated walk: the wearable, the errors of its sensors, the world around it.

Sources of the sensors' numbers: TDK InvenSense DS-000193 (MPU-6886), Bosch BST-BMM150-DS001, Bosch BST-BMP280-DS001,
and the registers that M5Stack's MPU6886.cpp sets (±8 g, ±2000 °/s, low-pass 218 and 176 Hz).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from fbgraph.simulator.gait import Walker, check_options


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
    gaits: Mapping[int, Walker] = field(default_factory=dict)
    """Other ways of walking, by the index of the waypoint from which on they are walked; one comes to a stand there.
    Of these walkers only cadence, step length, bounce and sway count, and what is irregular about their steps."""
    duration_s: float | None = None
    """Repeat the route so often that the walk lasts as near to this as whole laps can (at least one)."""

    def __post_init__(self) -> None:
        if not (0 <= self.noise < np.inf and 0 <= self.anomalies < np.inf):
            raise ConfigError("noise and anomalies must be 0 or more")
        if self.duration_s is not None and not 0 < self.duration_s < np.inf:
            raise ConfigError(f"duration_s must be positive, not {self.duration_s}")
