"""Steps as the estimators get them: one by one, and as columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fbgraph.core.geometry import FloatArray

MIN_RATE_HZ = 12.5
"""Slower samples do not show every step: four for each of 3.2 steps a second, the quickest that are told."""
LOOK_BACK_S = 12.0
"""Past signals that finding and measuring a step may look at."""
FIRST_LOOK_BACK_S = 2.0 * LOOK_BACK_S
"""The same before the first of all, which may be a swing that only a walk soon after it shows to be part of it."""


@dataclass(frozen=True)
class Peak:
    """A detected step before it is measured; ``first`` if it opens a run of steps.

    Attributes:
        index, start_index: where it ends and begins.
        first: whether it opens a run of steps.
        doubt: relative standard deviation of its length beyond the model's, shared by the steps of a stretch.
        count: for how many steps it stands; more than one where they were not told apart.
        share: of the length of an ordinary step.
        swung: whether the device swings with a limb or in a bag, whose bounce is not the wearer's.
    """

    index: int
    start_index: int
    first: bool
    doubt: float = 0.0
    count: float = 1.0
    share: float = 1.0
    swung: bool = False


@dataclass(frozen=True, slots=True)
class Step:
    """One breadcrumb: a step that ends at ``t_s``; the first of a walk is the standing start (length 0).

    Angles of the gyroscope share an arbitrary start; nan says that a sensor was silent.
    """

    t_s: float
    """End of the step, seconds since log start."""
    start_s: float
    """Begin of the step."""
    length_m: float
    """Adaptive length α + β f + γ s (paper, Parameter Selection) + β₂ f² + κ √surge (``step_length``)."""
    frequency_hz: float
    """Step frequency f, over this step and the one before."""
    slope: float
    """|climb rate| over flat walking speed, s."""
    shortened_m: float
    """By how much the slope term γ s changed the length."""
    bounce_m_s2: float
    """Peak-to-peak vertical acceleration."""
    surge_m_s: float
    """How much the horizontal speed goes to and fro (``step_length``)."""
    doubt_m: float
    """Standard deviation of the length beyond the model's, and of the way it went: walking whose steps were not
    resolved. 0 of an ordinary step."""
    yaw_s: float
    """Time to which the mean headings refer, the middle of the step."""
    yaw_gyro_rad: float
    """Mean walking direction over the step by the gyroscope, its bias still in it, unwrapped."""
    yaw_mag_rad: float
    """Mean walking direction over the step by the compass."""
    mag_norm_ut: float
    """Mean strength of the magnetic field over the step."""
    mag_dip_rad: float
    """Mean dip of the magnetic field over the step."""
    altitude_m: float
    """Mean barometric altitude over the step, standard atmosphere."""
    altitude_sigma_m: float
    """Its standard deviation, from the scatter of the last seconds; nan if unknown."""
    gusty: bool
    """Whether air pressure has been going to and fro lately, as in wind."""
    carried_m: float
    """Altitude gained since the step before without a step: a lift, an escalator. 0 if none."""
    blown_m: float
    """What pressure did since the step before, as altitude, that neither legs nor lifts do. 0 if nothing."""
    chained: bool
    """False if a gap in the log lies before it, so that the gyroscope says nothing about the turn since."""
    rest_rate_rad_s: float
    """Mean yaw rate while standing still since the step before, i.e. the gyroscope's bias."""
    rest_sigma_rad_s: float
    """Its standard deviation."""
    rest_s: float
    """How long that rest was, 0 if there was none."""
    rest_drift_rad: float
    """What the bias added to the gyroscope's angle during that rest."""
    rest_drift_sigma_rad: float
    """Its standard deviation."""
    jump_x_ut: float
    """By how much the magnetometer's zero jumped since the step before, as the device calibrated it anew or a magnet
    came to stay: horizontal component along (cos m, -sin m) at m = 0 (``estimators.compass``)."""
    jump_y_ut: float
    """The other horizontal component."""
    gait_yaw_rad: float = math.nan
    """Which way the legs push, left of the device's forward, by this step and the one before (``gait_direction``)."""
    push_m_s2: float = math.nan
    """Amplitude of that push."""
    side_forward_m_s2: float = math.nan
    side_left_m_s2: float = math.nan
    """What else the device does at the step's frequency, a quarter of a step after the push."""
    mount_up_rad: float = math.nan
    """Elevation of ``device.mount`` above the horizon: straight up or down it points nowhere."""
    tilt_rate_rad_s: float = math.nan
    """Mean angular rate about horizontal axes."""
    mount_rad: float = 0.0
    """By how much the directions were turned from the device's forward to the way one walks (``carrying``)."""
    sigma_turned_rad: float = 0.0
    """Standard deviation of what changed of that with this step; of the start, beyond ``graph.sigma_mount_rad``."""


class StepTrack:
    """All steps of a walk, entry 0 the standing start: ``track.steps[k].length_m`` is ``track.length_m[k]``.

    Every field of ``Step`` is a column here too, (K+1,) floats.
    """

    def __init__(self, steps: Sequence[Step]) -> None:
        self.steps = tuple(steps)
        self._columns: dict[str, FloatArray] = {}

    def __len__(self) -> int:
        return len(self.steps)

    def __getattr__(self, name: str) -> FloatArray:
        if name not in Step.__slots__:
            raise AttributeError(f"a step has no {name!r}; it has {', '.join(Step.__slots__)}")
        if name not in self._columns:
            self._columns[name] = np.array([getattr(step, name) for step in self.steps], dtype=float)
        return self._columns[name]
