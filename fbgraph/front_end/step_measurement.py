"""What a detected step says: length, direction, field, altitude, and the rest before it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import FloatArray, mean_of, wrap_scalar
from fbgraph.front_end.climb import ClimbGauge
from fbgraph.front_end.gait_direction import GaitDirection
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.rests import Rests
from fbgraph.front_end.running_sums import Latest
from fbgraph.front_end.step_length import FITTED_HZ, FITTED_SURGE_M_S, FULL_SURGE_M_S, flat_length_m, surge_of
from fbgraph.front_end.step_track import FIRST_LOOK_BACK_S, LOOK_BACK_S, Peak, Step

_UNUSUAL_DOUBT = 0.25
_LIMB_BOUNCE_M_S2 = 12.0  # a limb swings more than its wearer bounces
_SHARED_DOUBT_M = 20.0  # steps of a stretch share their doubt until it is this large
_AT_ONCE_S = 1.2  # whose first step ends within it was walking as the log began, or set out with it


class StepGauge:
    """Measures what each detected step says: its length, direction, field, altitude and the rest before it."""

    def __init__(self, length: StepLengthConfig, rate_hz: float, settle_s: float) -> None:
        self._length = length
        self._rate_hz = rate_hz
        self._signals: LevelledSignals | None = None
        self._latest = Latest()
        self._rests = Rests(rate_hz, settle_s)
        self._climb = ClimbGauge(length, rate_hz)
        self._gait = GaitDirection()
        self._last_end: int | None = None
        self._last_interval: float | None = None
        self._doubted_m = 0.0  # of the stretch of doubtful steps so far, one sigma

    def push(self, signals: LevelledSignals) -> None:
        """Take the next signals, before the peaks found in them."""
        self._rests.push(signals)
        self._climb.push(signals)
        back_s = LOOK_BACK_S if self._last_end is not None else FIRST_LOOK_BACK_S
        self._signals = LevelledSignals(*self._latest.extend(signals.arrays, int(back_s * self._rate_hz)))

    def measure(self, run: list[Peak]) -> list[Step]:
        """The steps of a run, the standing start before the very first of all."""
        steps: list[Step] = []
        for peak in run:
            interval = (peak.index - peak.start_index) / peak.count
            stride = interval if peak.first or self._last_interval is None else (interval + self._last_interval) / 2
            first_of_walk = self._last_end is None
            step = self._measure_one(peak, frequency_hz=self._rate_hz / stride)
            if first_of_walk:
                steps.append(_standing_start(step, self._altitude_before(peak)))
                # a rest before the walk tells the bias, but no turn between two steps
                step = replace(step, rest_drift_rad=0.0, rest_drift_sigma_rad=0.0, jump_x_ut=0.0, jump_y_ut=0.0)
                if peak.index < _AT_ONCE_S * self._rate_hz:  # what was walked before the log began, or half seen
                    step = replace(step, doubt_m=math.hypot(step.doubt_m, self._length.start_doubt_m))
            steps.append(step)
            self._last_end, self._last_interval = peak.index, interval
        return steps

    def _measure_one(self, peak: Peak, frequency_hz: float) -> Step:
        signals = self._signals
        assert signals is not None  # push comes before measure
        lo, hi = signals.index.searchsorted((peak.start_index + 1, peak.index + 1)).tolist()
        lo = min(lo, hi - 1)
        yaw_gyro = signals.yaw_gyro_rad[lo:hi]
        yaw_gyro_rad = float(mean_of(yaw_gyro))
        offset = signals.yaw_mag_rad[lo:hi] - yaw_gyro
        sin = float(mean_of(np.sin(offset)))
        if math.isnan(sin):
            offset = offset[np.isfinite(offset)]
            sin = float(mean_of(np.sin(offset))) if len(offset) else math.nan
        yaw_mag_rad = wrap_scalar(yaw_gyro_rad + math.atan2(sin, mean_of(np.cos(offset)))) if len(offset) else math.nan
        up = signals.acc_n_m_s2[lo:hi, 2]
        bounce = float(up.max() - up.min())
        bounce = min(bounce, _LIMB_BOUNCE_M_S2) if peak.swung else bounce
        surge = FULL_SURGE_M_S
        if hi - lo == peak.index - peak.start_index and peak.count == 1.0:
            surge = surge_of(signals.acc_n_m_s2[lo:hi, :2], self._rate_hz)
        rest = self._rests.take(peak.index)
        # a hole in the index between this step and the one before is a gap in the log
        since = int(signals.index.searchsorted(self._last_end)) if self._last_end is not None else lo
        chained = bool(signals.index[hi - 1] - signals.index[since] == hi - 1 - since)
        if self._last_end is not None and signals.index[0] > self._last_end:
            chained = self._rests.unbroken_between(self._last_end, peak.index)
        altitude_m = _mean_finite(signals.altitude_m[lo:hi])
        air = self._climb.judge(peak, altitude_m, frequency_hz, surge, chained)
        each_m = flat_length_m(self._length, frequency_hz, surge) + self._length.gamma_m * air.slope
        length = max(each_m, self._length.shortest_m) * peak.count * peak.share
        jumped = np.add.reduce(signals.field_jump_ut[since + 1 : hi], axis=0).tolist()
        return Step(
            t_s=peak.index / self._rate_hz,
            start_s=peak.start_index / self._rate_hz,
            length_m=length,
            frequency_hz=frequency_hz,
            slope=air.slope,
            shortened_m=abs(self._length.gamma_m * air.slope) * peak.count,
            bounce_m_s2=bounce,
            surge_m_s=surge,
            doubt_m=self._doubt_m(peak, length, frequency_hz, surge),
            yaw_s=float(mean_of(signals.t_s[lo:hi])),
            yaw_gyro_rad=yaw_gyro_rad,
            yaw_mag_rad=yaw_mag_rad,
            mag_norm_ut=_mean_finite(signals.mag_norm_ut[lo:hi]),
            mag_dip_rad=_mean_finite(signals.mag_dip_rad[lo:hi]),
            altitude_m=altitude_m,
            altitude_sigma_m=air.sigma_m,
            gusty=air.gusty,
            carried_m=air.carried_m,
            blown_m=air.blown_m,
            chained=chained,
            rest_rate_rad_s=rest.rate_rad_s,
            rest_sigma_rad_s=rest.sigma_rad_s,
            rest_s=rest.duration_s,
            rest_drift_rad=rest.drift_rad,
            rest_drift_sigma_rad=rest.drift_sigma_rad,
            jump_x_ut=jumped[0],
            jump_y_ut=jumped[1],
            **self._gait.push(signals, peak)._asdict(),
        )

    def _doubt_m(self, peak: Peak, length_m: float, frequency_hz: float, surge_m_s: float) -> float:
        """What a step adds to the doubt of its stretch, whose steps are wrong together: √(Σ² now - Σ² before)."""
        usual = FITTED_HZ[0] <= frequency_hz <= FITTED_HZ[1]
        usual = usual and (surge_m_s <= FITTED_SURGE_M_S or self._length.kappa_surge == 0.0)
        doubt = peak.doubt if usual else math.hypot(peak.doubt, _UNUSUAL_DOUBT)
        before = 0.0 if doubt == 0 or self._doubted_m > _SHARED_DOUBT_M else self._doubted_m
        self._doubted_m = before + doubt * length_m if doubt > 0 else 0.0
        return math.sqrt(max(self._doubted_m**2 - before**2, 0.0))

    def _altitude_before(self, peak: Peak) -> float:
        """Mean altitude of the seconds before the first step: the reference of the whole walk."""
        assert self._signals is not None
        lo, hi = np.searchsorted(
            self._signals.t_s, (peak.start_index / self._rate_hz - 5.0, peak.index / self._rate_hz)
        )
        return _mean_finite(self._signals.altitude_m[lo:hi])


def _standing_start(first: Step, altitude_m: float) -> Step:
    """The breadcrumb before the first step: same direction, no length, where the step began."""
    return replace(
        first,
        t_s=first.start_s,
        length_m=0.0,
        slope=0.0,
        shortened_m=0.0,
        doubt_m=0.0,
        yaw_mag_rad=math.nan,
        mag_norm_ut=math.nan,
        mag_dip_rad=math.nan,
        altitude_m=altitude_m,
        carried_m=0.0,
        blown_m=0.0,
        chained=True,
        rest_rate_rad_s=math.nan,
        rest_sigma_rad_s=math.nan,
        rest_s=0.0,
        rest_drift_rad=0.0,
        rest_drift_sigma_rad=0.0,
        jump_x_ut=0.0,
        jump_y_ut=0.0,
    )


def _mean_finite(values: FloatArray) -> float:
    mean = float(mean_of(values)) if len(values) else math.nan
    if math.isfinite(mean):
        return mean
    finite = values[np.isfinite(values)]
    return float(mean_of(finite)) if len(finite) else math.nan
