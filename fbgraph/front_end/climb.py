"""What of a change of air pressure a walker made: slope by steps, lifts without them, and what is neither.

A barometer measures the weather, doors, gusts and thumbs too. What legs can do sets them apart: they climb no faster
than 0.75 m/s and a quarter of a metre a step, for seconds on end and in one direction; a lift or an escalator moves who
does not step, smoothly and over metres. Anything else is air.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import BoolArray, FloatArray, mean_of
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_length import flat_length_m
from fbgraph.front_end.step_track import LOOK_BACK_S, Peak

_EVERY_S = 0.25  # altitude is looked at so often
_SLOPE_S, _SLOPE_AT_LEAST_S = 5.0, 3.0  # climb is judged over this long
MEMORY_S = 40.0
"""A step's pressure is judged in the light of what pressure did this long before."""
_LEGS_M_S, _LEGS_M = 0.75, 0.25  # nobody climbs faster, nor higher in a step
_NOISE_M = 0.6  # two readings of a still device may differ by this
_LEAP_M = _LEGS_M_S * 1.0 + _NOISE_M  # in a second
_ROUGH_S = 20.0
_LINE_S = 8.0  # air moves to and fro about a line through so long
_TURN_S = 3.0  # for how long pressure goes one way at least
_GUST_M_S, _GUST_S = 0.15, 8.0  # pressure that goes so fast one way, then within so long the other, is turning
_RESTLESS = 2  # such turns within the memory; a walker turns on the top of stairs once
_FACTS = 4.0  # a climb stands out from the scatter about it by so many of its standard deviations
_LIFT_M_S, _LIFT_M, _LIFT_S = 0.2, 2.0, 2.0  # the slowest escalator, the lowest floor, the quickest ride
_CREEP_M_S = 0.05  # a ride begins and ends gently
_RIDE_M_S, _RIDE_S = 0.9, 4.0  # who climbs faster for so long does not do it by the steps seen meanwhile
_REST_S = 1800.0  # of a longer rest only the end is looked at
_AIR_M_S = 5.0  # nobody is carried faster
_STRIDE = 2.0  # steps
_CADENCE_STEPS = 8  # a slow last step belongs to a climb that the faster ones before it made


@dataclass(frozen=True, slots=True)
class Air:
    """What pressure says at a step; metres of the standard atmosphere.

    Attributes:
        slope: |climb rate| over flat walking speed, 0 within what air does by itself.
        sigma_m: standard deviation of the step's altitude, from the scatter of the last seconds; nan if unknown.
        gusty: pressure has been going to and fro for ``MEMORY_S``.
        carried_m: climbed since the step before without a step: a lift, an escalator. 0 if none.
        blown_m: what pressure did since then that neither legs nor lifts do. 0 if nothing.
    """

    slope: float
    sigma_m: float
    gusty: bool
    carried_m: float
    blown_m: float


class ClimbGauge:
    """Remembers the altitude of the last minute and judges it at each step; causal, the same in any pieces."""

    def __init__(self, length: StepLengthConfig, rate_hz: float) -> None:
        """A gauge of signals at this rate; ``length`` says how slope is told from speed."""
        self._length = length
        self._rate_hz = rate_hz
        self._stride = max(round(_EVERY_S * rate_hz), 1)
        self._every_s = self._stride / rate_hz
        self._at = np.empty(0, dtype=np.int64)  # multiples of the stride
        self._altitude_m = np.empty(0)
        self._frequencies_hz: list[float] = []
        self._last_end: int | None = None
        self._last_altitude_m = math.nan
        self._looked = -1, np.empty(0)  # the latest grid index looked back from, and what was seen

    def push(self, signals: LevelledSignals) -> None:
        """Take the next signals, before the steps found in them."""
        if len(signals) == 0:
            return
        chosen = np.flatnonzero(signals.index % self._stride == 0)
        if len(chosen) == 0:
            return
        self._at = np.concatenate((self._at, signals.index[chosen] // self._stride))
        self._altitude_m = np.concatenate((self._altitude_m, signals.altitude_m[chosen]))
        # a ride may have begun at the last step, and steps of a run become known a few seconds late
        since_index = signals.index[0] if self._last_end is None else min(signals.index[0], self._last_end)
        since_index = max(since_index, signals.index[0] - round(_REST_S * self._rate_hz))
        self._looked = -1, self._looked[1]
        start = self._at.searchsorted(since_index // self._stride - self._samples(LOOK_BACK_S + MEMORY_S))
        self._at, self._altitude_m = self._at[start:], self._altitude_m[start:]

    def judge(self, peak: Peak, altitude_m: float, frequency_hz: float, surge_m_s: float, chained: bool) -> Air:
        """What pressure says at the next step.

        Args:
            peak: the step.
            altitude_m: its mean altitude.
            frequency_hz, surge_m_s: how it was walked.
            chained: whether the log has no gap since the step before.
        """
        self._frequencies_hz = [*self._frequencies_hz[1 - _CADENCE_STEPS :], frequency_hz]
        climb_m_s, gusty = self._climb_m_s(peak.index), self._gusts(peak.index)
        legs_m_s = min(_LEGS_M_S, _LEGS_M * max(self._frequencies_hz))
        slope = 0.0
        resolved = peak.count <= _STRIDE  # else nobody saw the steps that might have climbed
        if self._length.min_climb_m_s < abs(climb_m_s) <= legs_m_s and resolved and not gusty:  # never when it is nan
            level_m = max(flat_length_m(self._length, frequency_hz, surge_m_s), self._length.shortest_m)
            slope = abs(climb_m_s) / (level_m * frequency_hz)
        carried_m = blown_m = 0.0
        if self._last_end is not None and chained and math.isfinite(altitude_m - self._last_altitude_m):
            changed_m = altitude_m - self._last_altitude_m
            if peak.start_index - self._last_end > self._rate_hz:
                carried_m = self._carried(self._last_end, peak.start_index)
            elif not gusty and self._riding(peak.index):
                carried_m = changed_m
            rest_m = changed_m - carried_m
            too_high = abs(rest_m) > _LEGS_M * max(peak.count, 1.0) + _NOISE_M
            if too_high or (abs(climb_m_s) > legs_m_s and carried_m == 0.0):
                blown_m = rest_m
        self._last_end, self._last_altitude_m = peak.index, altitude_m
        return Air(slope, self._scatter(peak.index, gusty), gusty, carried_m, blown_m)

    def _scatter(self, index: int, gusty: bool) -> float:
        """Standard deviation of altitude about a line through the last seconds; in gusts, through the memory."""
        recent = self._before(index, MEMORY_S if gusty else _LINE_S)
        return _line(recent, self._every_s)[1] if len(recent) >= self._samples(1.0) else math.nan

    def _riding(self, index: int) -> bool:
        """Whether altitude runs smoothly and faster than legs: steps that are none, or that happen in a lift."""
        altitude_m, half = self._before(index, _RIDE_S), self._samples(0.5)
        if len(altitude_m) < self._samples(_RIDE_S):
            return False
        rise_m = abs(altitude_m[-1] - altitude_m[0])
        sudden_m = np.abs(altitude_m[half:] - altitude_m[:-half]).max()
        return bool(rise_m > _RIDE_M_S * _RIDE_S and sudden_m < min(0.5 * rise_m, 0.5 * _AIR_M_S))

    def _samples(self, duration_s: float) -> int:
        return max(round(duration_s / self._every_s), 1)

    def _between(self, first_index: int, last_index: int) -> FloatArray:
        """Altitude at every multiple of the stride from one grid index to another, nan where the log was silent."""
        first, last = -(-first_index // self._stride), last_index // self._stride
        lo, hi = self._at.searchsorted((first, last + 1)).tolist()
        if hi - lo == last - first + 1:
            return self._altitude_m[lo:hi]
        values = np.full(max(last - first + 1, 0), np.nan)
        values[self._at[lo:hi] - first] = self._altitude_m[lo:hi]
        return values

    def _before(self, index: int, duration_s: float) -> FloatArray:
        """The last so many seconds before a grid index, without what lies before a silence."""
        if self._looked[0] != index:  # asked several times a step: the longest holds the others
            values = self._between(index - (self._samples(MEMORY_S) - 1) * self._stride, index)
            if math.isnan(np.add.reduce(values)):
                values = values[np.flatnonzero(np.isnan(values))[-1] + 1 :]
            self._looked = index, values
        known = self._looked[1]
        return known[max(len(known) - self._samples(duration_s) + (index % self._stride > 0), 0) :]

    def _leaps(self, altitude_m: FloatArray) -> BoolArray:
        """(N,) whether altitude changed within the second before by more than legs and noise do."""
        second = self._samples(1.0)
        leaps = np.zeros(len(altitude_m), dtype=bool)
        leaps[second:] = np.abs(altitude_m[second:] - altitude_m[:-second]) > _LEAP_M
        return leaps

    def _climb_m_s(self, index: int) -> float:
        """Rate of a steady climb or descent over the last seconds; nan if there is none."""
        window = self._before(index, _SLOPE_S)
        if len(window) < self._samples(_SLOPE_AT_LEAST_S):
            return math.nan
        third = len(window) // 3
        rate = float(mean_of(window[-third:]) - mean_of(window[:third])) / ((len(window) - third) * self._every_s)
        # samples a second apart count as independent
        sigma = math.sqrt(12.0) * self._roughness(index) / (len(window) * self._every_s) ** 1.5
        return rate if abs(rate) > _FACTS * sigma else math.nan

    def _roughness(self, index: int) -> float:
        """How far altitude strays from a line over a few seconds: the last, and usually of late if that is more."""
        altitude_m, count = self._before(index, _ROUGH_S), self._samples(_SLOPE_S)
        if len(altitude_m) < count:
            return _line(altitude_m, self._every_s)[1]
        scatter: list[float] = off_lines(altitude_m, count).tolist()
        ordered = sorted(scatter)  # (np.median is slow)
        middle = 0.5 * (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2])
        return max(middle, scatter[-1])

    def _gusts(self, index: int) -> bool:
        """Whether pressure has been going to and fro lately."""
        altitude_m = self._steadied(self._before(index, MEMORY_S))
        second, lag = self._samples(1.0), self._samples(_TURN_S)
        if len(altitude_m) <= lag + second:
            return False
        summed = np.cumsum(altitude_m)
        smooth = (summed[second:] - summed[:-second]) / second
        rate = (smooth[lag:] - smooth[:-lag]) / (lag * self._every_s)
        moving = np.flatnonzero(np.abs(rate) > _GUST_M_S)
        if len(moving) <= _RESTLESS:  # a turn has a side before it
            return False
        sign = np.sign(rate[moving])
        turns = (sign[1:] != sign[:-1]) & ((moving[1:] - moving[:-1]) * self._every_s < _GUST_S)
        return int(turns.sum()) >= _RESTLESS

    def _steadied(self, altitude_m: FloatArray) -> FloatArray:
        """The same without its leaps."""
        if len(altitude_m) < 2 or altitude_m.max() - altitude_m.min() <= _LEAP_M:
            return altitude_m
        leaping, second = self._leaps(altitude_m), self._samples(1.0)
        change = np.zeros(len(altitude_m))
        np.subtract(altitude_m[1:], altitude_m[:-1], out=change[1:])
        if leaping.any():
            change[(np.flatnonzero(leaping)[:, None] - np.arange(second)).ravel()] = 0.0
        return np.asarray(np.add.accumulate(change))

    def _carried(self, first_index: int, last_index: int) -> float:
        """Rise between two grid indices at which nobody stepped: the smooth rides among what pressure did."""
        altitude_m = self._between(max(first_index, last_index - round(_REST_S * self._rate_hz)), last_index)
        second, half = self._samples(1.0), self._samples(0.5)
        if len(altitude_m) <= 2 * second or np.isnan(altitude_m).any():
            return 0.0
        rate = (altitude_m[second:] - altitude_m[:-second]) / (second * self._every_s)
        direction = np.where(np.abs(rate) > _CREEP_M_S, np.sign(rate), 0.0)
        edges = np.flatnonzero(np.diff(direction, prepend=0.0, append=0.0)).tolist()
        rides_m: list[float] = []
        for first, last in itertools.pairwise(edges):
            ride_m = altitude_m[first : last + second]  # rates are named by where they begin
            rise_m = float(ride_m[-1] - ride_m[0])
            moving_s = float((np.abs(rate[first:last]) > _LIFT_M_S).sum()) * self._every_s
            sudden_m = float(np.abs(ride_m[half:] - ride_m[:-half]).max())
            smooth = sudden_m < max(0.5 * abs(rise_m), _NOISE_M) and sudden_m < 0.5 * _AIR_M_S
            if direction[first] and abs(rise_m) >= _LIFT_M and moving_s >= _LIFT_S and smooth:
                rides_m.append(rise_m)
        to_and_fro = sum(a * b < 0.0 for a, b in itertools.pairwise(rides_m))
        total_m = sum(rides_m)
        return total_m if abs(total_m) >= _LIFT_M and to_and_fro < _RESTLESS else 0.0


def _line(values: FloatArray, every_s: float) -> tuple[float, float]:
    """Slope of the least-squares line through equidistant values, per second, and the deviation from it."""
    t_s, squared = _times(len(values), every_s)
    rate = float(t_s @ values) / squared
    off = values - rate * t_s
    off -= mean_of(off)
    return rate, math.sqrt(mean_of(off * off))


@lru_cache(maxsize=512)
def _times(count: int, every_s: float) -> tuple[FloatArray, float]:
    """(N,) equidistant times about their middle, and the sum of their squares."""
    t_s = (np.arange(count) - (count - 1) / 2.0) * every_s
    return np.asarray(t_s, dtype=np.float64), float(t_s @ t_s)


def off_lines(values: FloatArray, count: int) -> FloatArray:
    """Deviation from its least-squares line, of every ``count`` equidistant values that follow each other."""
    sums = np.zeros((3, len(values) + 1))
    t, each = _times(len(values), 1.0)[0], sums[:, 1:]
    np.subtract(values, values[0], out=each[0])
    np.multiply(each[0], each[0], out=each[1])
    np.multiply(each[0], t, out=each[2])
    np.add.accumulate(sums, axis=1, out=sums)
    total, squares, moment = sums[:, count:] - sums[:, :-count]
    moment -= (t[: len(moment)] + (count - 1) / 2.0) * total
    squares -= total * total / count + moment * moment / _times(count, 1.0)[1]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0) / count))
