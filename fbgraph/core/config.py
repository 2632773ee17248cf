"""Configuration: typed, immutable, unknown keys refused at any depth.

Precedence: built-in defaults < ``--config`` (a preset's name or a TOML file) < ``--set a.b=value`` < flags. The
effective configuration is written into every run as ``config.toml``. Presets in ``configs/`` hold only what differs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import tomli_w
from pydantic import Field, field_serializer, field_validator

from fbgraph.core.config_text import override, read_tables
from fbgraph.core.sections import Section, validated

# bounds keep out what no walk needs and no computer could do; within them anything may be tried
Positive = Annotated[float, Field(gt=0, le=1e4)]
NonNegative = Annotated[float, Field(ge=0, le=1e4)]
Share = Annotated[float, Field(gt=0, lt=0.5)]
Coefficient = Annotated[float, Field(ge=-100.0, le=100.0)]
Seconds = Annotated[float, Field(gt=0, le=3600.0)]
BriefSeconds = Annotated[float, Field(gt=0, le=10.0)]
"""No longer than the front end remembers."""
Metres = Annotated[float, Field(gt=0, le=10.0)]
"""Of a step."""
MicroTesla = Annotated[float, Field(ge=-5000.0, le=5000.0)]
Sigma = Annotated[float, Field(ge=1e-6, le=1e9)]


STUDY_TABLE = "dataset"
"""The table of a configuration file that says how a data set of trials is laid out; see ``study.column_names``."""


class DeviceConfig(Section):
    """How the device is carried."""

    mount: tuple[float, float, float] = (0.0, 0.70710678, -0.70710678)
    """Body direction whose horizontal projection points where the person walks (top edge and back of the device)."""
    declination_deg: Annotated[float | None, Field(ge=-180.0, le=180.0)] = None
    """Magnetic declination, positive East; added to the compass so that y is true North. None, written ``auto``, looks
    it up where the place is known (``core.earth_field``); elsewhere y is magnetic North."""
    declination_by: Annotated[str, Field(max_length=300)] = ""
    """Where a declination that was looked up comes from; written by the run, and not read but told."""
    iron_ut: tuple[MicroTesla, MicroTesla, MicroTesla] = (0.0, 0.0, 0.0)
    """The device's own iron (hard iron), body axes; taken off the magnetometer. What is left has
    ``graph.sigma_iron_ut``. ``fbgraph calibrate`` finds it."""
    gyro_scale: Annotated[float, Field(ge=-0.3, le=0.3)] = 0.0
    """Share by which the gyroscope shows too much of a turn; taken out. What is left has ``graph.sigma_gyro_scale``."""

    @field_validator("declination_deg", mode="before")
    @classmethod
    def _looked_up(cls, value: object) -> object:
        return None if value == "auto" else value

    @field_serializer("declination_deg")
    def _as_written(self, value: float | None) -> float | str:
        return "auto" if value is None else value  # TOML knows no null

    @field_validator("mount")
    @classmethod
    def _points_somewhere(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if not 1e-3 < math.hypot(*value) < 1e3:
            raise ValueError("expected a direction: three numbers, not all of them zero")
        return value


class AttitudeConfig(Section):
    """Levelling, compass and altitude."""

    rate_hz: Annotated[float, Field(ge=10.0, le=1000.0)] = 100.0
    """Common rate to which the inertial streams are brought."""
    max_gap_s: Seconds = 0.5
    """A longer silence of accelerometer or gyroscope is a gap: nothing is integrated across it."""
    level_tau_s: Seconds = 3.0
    """Time constant of the accelerometer correction in vqf."""
    still_window_s: Seconds = 1.5
    """Length of the window over which stillness is judged."""
    still_acc_m_s2: Positive = 0.35
    """Largest standard deviation of |acc| while standing still."""
    still_gyro_rad_s: Positive = 0.12
    """Largest standard deviation of the angular rate while standing still (a hand trembles)."""
    altitude_tau_s: Seconds = 1.0
    """Time constant of the altitude low-pass."""


class StepsConfig(Section):
    """Step detection (paper, section Step Detection Algorithm)."""

    smoothing_s: Seconds = 0.15
    """Moving average of |acc|, N samples of the paper."""
    window_s: Seconds = 4.0
    """Sliding window of the mean and deviation in T_s = mean + lambda * sigma."""
    lambda_sigma: NonNegative = 0.2
    """λ of the paper."""
    min_interval_s: Seconds = 0.33
    """Refractory interval T_min."""
    max_interval_s: BriefSeconds = 1.2
    """A longer interval between peaks is a pause, not a step."""
    min_rise_m_s2: Positive = 0.8
    """A maximum must stand this far above the valley before it."""
    min_run: Annotated[int, Field(ge=2, le=1000)] = 4
    """Steps come in runs of at least this many."""
    min_bout: Annotated[int, Field(ge=2, le=1000)] = 2
    """Or in bouts of at least this many, where the device is held calmly."""
    min_push_m_s: Positive = 0.5
    """And goes somewhere meanwhile at least this fast."""
    min_rhythm: Annotated[float, Field(ge=-1.0, le=1.0)] = 0.55
    """Correlation of |acc| one step apart that a run must show."""
    floor_rise_m_s2: Positive = 0.15
    """In a steady rhythm a maximum needs to stand out by a share of the wearer's own bounce only, and by this."""
    min_breadth: NonNegative = 0.012
    """Who moves to and fro on one line (1 - |C|²/(tr C)² of the acceleration's covariance C) does not walk."""
    steady_s: Seconds = 6.0
    """A device that swings with every stride for so long is carried, however much it swings."""
    max_tilt_rate_rad_s: Positive = 3.0
    """A device that tilts faster than this on average over a step is being shaken, not carried."""
    max_wobble_rad: Positive = 1.3
    """A device whose yaw goes back and forth by more than this within two seconds is being shaken, not carried."""
    spin_window_s: BriefSeconds = 3.0
    max_spin_rad: Positive = 4.2
    """Who turns further than this within spin_window_s turns on the spot."""


class CarryingConfig(Section):
    """How the device may be carried otherwise than ``device.mount`` says, and how likely that is beforehand."""

    turned_in_hand: Share = 0.007
    """Of fast turns, those that are the device's and not the wearer's."""
    turned_in_corner: Share = 0.0015
    """Those that are partly one and partly the other."""
    turned_unseen: Share = 5e-4
    """Of steps, those on which both cancel."""
    held_any_way: Share = 0.08
    """Of walks with the device in hand or on the chest, those on which ``device.mount`` points elsewhere altogether."""
    worn_any_way: Share = 0.3
    """The same of a device worn in a bag or on a limb."""
    sigma_held_rad: Sigma = 0.1
    """How well ``device.mount`` points where one walks otherwise, in hand or on the chest."""
    sigma_worn_rad: Sigma = 0.6
    """And in a bag or on a limb."""
    worn_up_rad: Sigma = 0.66
    """A mount that points further up or down than this is that of a device worn upright."""
    worn_tilt_rate_rad_s: Sigma = 1.0
    """A device that tilts faster than this all along is worn on a limb."""


class StepLengthConfig(Section):
    """L = alpha + beta * f + gamma * slope (paper, section Parameter Selection) + beta2 * f² + kappa * √surge.

    f is the step frequency. The last two terms are ours (``front_end.step_length``): who takes longer steps at the
    same cadence surges more.
    With both of them 0 it is the paper's model. Defaults are fitted to phones in hand and on the chest.
    """

    constant_m: Metres = 0.64
    """L0 of the baseline PDR."""
    alpha_m: Coefficient = -1.077
    beta_m_s: Coefficient = 1.302
    """Metres per hertz of step frequency."""
    beta2_m_s2: Coefficient = -0.334
    """Metres per square of it: beyond 2 Hz quicker steps are shorter ones, but for runners."""
    gamma_m: Coefficient = -1.75
    """Metres per unit slope; slope = |climb rate| / flat walking speed, so stairs shorten the step."""
    kappa_surge: Coefficient = 1.075
    """Metres per square root of the surge: how much the horizontal speed goes to and fro in a step, in m/s."""
    min_climb_m_s: NonNegative = 0.12
    """A slower change of altitude is taken for air pressure, not for slope."""
    start_doubt_m: NonNegative = 1.6
    """Standard deviation of the first step of a log that begins in the middle of a walk: a part of it is missing, the
    tilt has not settled, and who sets out with the log takes shorter steps than the model knows."""
    shortest_m: Metres = 0.15
    """No step is shorter, whatever the slope."""
    calibrated_hz: tuple[NonNegative, NonNegative] | tuple[()] = ()
    """Lowest and highest step frequency to which ``fbgraph calibrate`` fitted the coefficients; empty if it did not.
    Steps outside are told."""
    calibrated_surge_m_s: tuple[NonNegative, NonNegative] | tuple[()] = ()
    """The same of the surge."""

    @field_validator("calibrated_hz", "calibrated_surge_m_s")
    @classmethod
    def _in_order(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if value and value[0] > value[1]:
            raise ValueError("expected the lowest and the highest")
        return value


class EkfConfig(Section):
    """The paper's heading filter, state [yaw, gyro bias]."""

    sigma_yaw_step_rad: Sigma = 0.03
    """Process noise of yaw per step (body sway, gyroscope noise)."""
    sigma_bias_walk_rad_s: Sigma = 1e-4
    """Process noise of the bias per root second."""
    sigma_bias_rad_s: Sigma = 0.02
    """Initial standard deviation of the bias before any rest."""
    sigma_mag_rad: Sigma = 0.35
    """Compass noise in an undisturbed field, one step."""
    norm_scale_ut: Sigma = 6.0
    dip_scale_rad: Sigma = 0.15
    """Deviation of strength and dip from their recent usual that doubles the compass variance."""
    gate_sigma: Sigma = 2.0
    """An innovation beyond this many deviations is down-weighted by its square."""
    altitude_tau_s: Seconds = 3.0
    """Time constant of the altitude filter."""


class GraphConfig(Section):
    """Weights of the factors."""

    sigma_length_rel: Sigma = 0.08
    """Step length, relative, one step to the next."""
    sigma_slope_rel: NonNegative = 0.5
    """Error of what the slope term adds to a step, relative."""
    sigma_lateral_m: Sigma = 0.05
    """Sideways error of a step."""
    sigma_length_scale: NonNegative = 0.06
    """Length error common to all steps of a walk: a wearer walks longer or shorter than the model's."""
    aided_length_steps: Positive = 30.0
    """With anchors or a closed end the common length error is spread over steps, as if it changed after so many."""
    sigma_mount_rad: NonNegative = 0.07
    """Heading error common to the whole walk: how the device is held, and the compass itself."""
    sigma_yaw_step_rad: Sigma = 0.02
    """Yaw change of a step by the gyroscope."""
    sigma_bias_rad_s: Sigma = 0.004
    """Gyroscope bias before any rest; phones take most of it out themselves, an M5StickC does not."""
    sigma_bias_walk_rad_s: Sigma = 1e-4
    """Bias random walk per root second."""
    sigma_gyro_scale: Sigma = 0.015
    """Scale of the gyroscope: of a turn, this share too much or too little."""
    sigma_mag_rad: Sigma = 0.26
    """Compass against true heading, where iron is near."""
    mag_correlation_m: Positive = 6.0
    """Distance walked over which a compass error stays the same."""
    sigma_iron_ut: Sigma = 1.0
    """The device's own iron, each horizontal component; heavy-tailed, for some devices are not calibrated at all."""
    sigma_iron_jump_ut: Sigma = 1.5
    """How well a jump of it is seen, where the device calibrates its magnetometer anew."""
    sigma_field_ut: Sigma = 20.0
    """Usual horizontal strength of the field, against the median of the walk."""
    mag_huber: Sigma = 1.0
    """Compass residuals beyond this many sigma_mag_rad count linearly (Huber)."""
    norm_scale_ut: Sigma = 20.0
    dip_scale_rad: Sigma = 0.5
    """Deviation of strength and dip from their usual that doubles the compass variance."""
    sigma_gap_m_s: Sigma = 1.5
    """Where the log is silent the wearer may have walked at this speed, in any direction."""
    sigma_gap_yaw_rad_s: Sigma = 1.0
    """And turned at this rate, up to facing anywhere."""
    sigma_altitude_m: Sigma = 0.25
    """Barometric altitude of one step, in still air."""
    gust_s: NonNegative = 2.0
    """How long a gust lasts."""
    sigma_climb_m: Sigma = 0.12
    """Change of altitude in one step."""
    sigma_weather_m: Sigma = 0.02
    """Drift of air pressure, as altitude, per root second: weather, ventilation, a device that warms up."""
    sigma_weather_m_s: NonNegative = 2.3e-3
    """Rate of the weather that is the same all along a walk, as altitude; 1 hPa an hour."""
    weather_turns_s: Annotated[float, Field(gt=0, le=1e7)] = 36_000.0
    """How long the weather keeps such a rate."""
    sigma_anchor_m: Sigma = 0.5
    """Anchors that give no sigma of their own."""
    sigma_closure_m: Sigma = 1.0
    """How close to its start a closed walk ends."""


class SolverConfig(Section):
    """Levenberg-Marquardt."""

    max_iterations: Annotated[int, Field(ge=1, le=100_000)] = 100
    relative_error: Positive = 1e-12


class OnlineConfig(Section):
    """iSAM2."""

    window_steps: Annotated[int, Field(ge=10, le=10_000_000)] = 150
    """Breadcrumbs that later steps may still move; the tree holds up to twice as many."""
    relinearize_yaw_rad: Positive = 0.05
    """A breadcrumb whose yaw has moved further is linearised anew."""
    relinearize_skip: Annotated[int, Field(ge=1, le=1_000_000)] = 5
    """Look for such breadcrumbs every so many steps."""
    wildfire: Sigma = 0.02
    """Changes below this (rad, m) are not passed on to older breadcrumbs until somebody asks for them."""


class ReturnConfig(Section):
    """The way back: when it begins, and how it is matched to the way out."""

    at: str = "never"
    """When the way back begins: never, auto (it is noticed), event, event:NAME (a button's) or seconds since start."""
    out_and_back: bool = True
    """Of a whole log: look for a turn-back and tie the way back to the way out."""
    retraced_m: Positive = 11.0
    """How much must have been walked back before a turn-back is believed."""
    apart_m: Positive = 1.5
    """How far from the way out the way back may be, on average, where one says late that one has turned."""
    corridor_m: Positive = 2.5
    """Who is further from the route than this, beyond doubt, is off it."""
    drift_m: Positive = 0.12
    """Dead reckoning on the way back drifts by this after one metre, growing with the square root of the distance."""
    sigma_pull_m: Sigma = 2.5
    """How little a step on the route says about the drift; larger believes dead reckoning more."""
    sigma_place_m: Sigma = 3.0
    """Place against the route."""
    sigma_turn_rad: Sigma = 0.35
    """Direction of a step against that of the route."""
    sigma_mag_ut: Sigma = 2.5
    """Magnetic field against that of the way out at the same place."""
    sigma_altitude_m: Sigma = 0.7
    """Altitude against that of the way out."""
    sigma_step_rel: Sigma = 0.15
    """Length of a step against the same stretch on the way out."""
    arrived_m: Positive = 3.5
    """Who has no more than this left, some five steps, has arrived."""
    closure_doubt_m: Positive = 0.8
    """A match that may be further off than this (one sigma) never enters the graph."""
    closure_steady_m: Positive = 4.0
    """Nor one before the route has been followed for so long."""
    closure_every_m: Positive = 3.0
    closure_away_m: NonNegative = 8.0
    """Nor one this close to the turn-back, where nobody knows what milling about did to the distance."""
    closure_sigma_m: Positive = 0.7
    """How near the way back is to the way out, besides the doubt of the match."""

    @field_validator("at", mode="before")
    @classmethod
    def _when(cls, value: object) -> str:
        text = str(value).strip()
        if text not in ("never", "auto", "event") and not (text.startswith("event:") and text[6:].strip()):
            try:
                seconds = float(text)
            except ValueError:
                seconds = math.nan
            if not 0.0 <= seconds < math.inf:
                raise ValueError("expected never, auto, event, event:NAME or seconds since log start (--return-at)")
        return text


class Config(Section):
    """The whole configuration."""

    device: DeviceConfig = DeviceConfig()
    attitude: AttitudeConfig = AttitudeConfig()
    steps: StepsConfig = StepsConfig()
    carrying: CarryingConfig = CarryingConfig()
    step_length: StepLengthConfig = StepLengthConfig()
    ekf: EkfConfig = EkfConfig()
    graph: GraphConfig = GraphConfig()
    solver: SolverConfig = SolverConfig()
    online: OnlineConfig = OnlineConfig()
    returning: ReturnConfig = ReturnConfig()


def load_config(source: str | Path | None = None, overrides: Iterable[str] = ()) -> Config:
    """The effective configuration.

    Args:
        source: a preset's name or the path of a TOML file; None for the defaults. A ``[dataset]`` table in it is
            left to ``fbgraph study``, which alone knows data sets.
        overrides: ``a.b=value`` strings, values in TOML notation (a bare word is taken as a string).

    Raises:
        ConfigError: no such preset or file, not TOML, an unknown key or an invalid value, with its dotted path.
    """
    values = {} if source is None else read_tables(str(source))
    values.pop(STUDY_TABLE, None)
    return validated(Config, override(values, overrides), str(source or "--set"))


def dump_toml(config: Config) -> str:
    """The configuration as TOML, every key."""
    return tomli_w.dumps(config.model_dump(mode="json"))
