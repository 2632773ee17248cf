"""Steps: found in levelled signals, measured one by one, the same offline and online.

``FrontEnd`` chains the leveller, the paper's step detector and the measurement of each step. It is causal and
chunk-invariant: cut the log anywhere, the steps stay the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.core.config import Config, StepLengthConfig, StepsConfig
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.core.log import SensorLog
from fbgraph.front_end.leveller import LevelledSignals, Leveller, WindowMoments
from fbgraph.front_end.rests import Rests

_ALTITUDE_WINDOW_S = 5.0  # climb is judged over this long
_WOBBLE_WINDOW_S, _WOBBLE_STEP_S = 2.0, 0.1
_BUFFER_S = 12.0  # past signals that measuring a step may look at


@dataclass(frozen=True, slots=True)
class Step:
    """One breadcrumb: a step that ends at ``t_s``; the first of a walk is the standing start (length 0).

    Angles of the gyroscope share an arbitrary start; nan says that a sensor was silent.

    Attributes:
        t_s, start_s: end and begin of the step.
        length_m: adaptive length α + β f + γ s (paper, Parameter Selection) + κ bounce^(1/4).
        frequency_hz, slope, bounce_m_s2: what it was computed from; bounce is peak-to-peak vertical acceleration.
        shortened_m: by how much the slope term γ s changed the length.
        yaw_s: time to which the mean headings refer, the middle of the step.
        yaw_gyro_rad: mean walking direction over the step by the gyroscope, its bias still in it, unwrapped.
        yaw_mag_rad: mean walking direction over the step by the compass.
        mag_norm_ut, mag_dip_rad: mean strength and dip of the field over the step.
        altitude_m: mean barometric altitude over the step, standard atmosphere.
        chained: False if a gap in the log lies before it, so that the gyroscope says nothing about the turn since.
        rest_rate_rad_s: mean yaw rate while standing still since the step before, i.e. the gyroscope's bias.
        rest_sigma_rad_s: its standard deviation.
        rest_s: how long that rest was, 0 if there was none.
    """

    t_s: float
    start_s: float
    length_m: float
    frequency_hz: float
    slope: float
    shortened_m: float
    bounce_m_s2: float
    yaw_s: float
    yaw_gyro_rad: float
    yaw_mag_rad: float
    mag_norm_ut: float
    mag_dip_rad: float
    altitude_m: float
    chained: bool
    rest_rate_rad_s: float
    rest_sigma_rad_s: float
    rest_s: float


@dataclass(frozen=True)
class StepTrack:
    """All steps of a walk as columns, (K+1,) each, entry 0 the standing start; names as in ``Step``."""

    t_s: FloatArray
    start_s: FloatArray
    length_m: FloatArray
    frequency_hz: FloatArray
    slope: FloatArray
    shortened_m: FloatArray
    bounce_m_s2: FloatArray
    yaw_s: FloatArray
    yaw_gyro_rad: FloatArray
    yaw_mag_rad: FloatArray
    mag_norm_ut: FloatArray
    mag_dip_rad: FloatArray
    altitude_m: FloatArray
    chained: FloatArray
    rest_rate_rad_s: FloatArray
    rest_sigma_rad_s: FloatArray
    rest_s: FloatArray
    steps: tuple[Step, ...]

    def __len__(self) -> int:
        return len(self.steps)

    @staticmethod
    def of(steps: list[Step]) -> StepTrack:
        """Columns of a list of steps."""
        names = Step.__slots__
        return StepTrack(
            **{n: np.array([getattr(s, n) for s in steps], dtype=float) for n in names}, steps=tuple(steps)
        )


class FrontEnd:
    """Samples in, steps out."""

    def __init__(self, config: Config) -> None:
        self._leveller = Leveller(config.device, config.attitude)
        self._detector = StepDetector(config.steps, config.attitude.rate_hz)
        self._gauge = StepGauge(config.step_length, config.attitude.rate_hz, config.attitude.level_tau_s)

    def feed(self, piece: SensorLog) -> tuple[list[Step], LevelledSignals]:
        """Take the next samples; return the steps they complete and the signals they level."""
        return self._advance(self._leveller.feed(piece))

    def finish(self) -> tuple[list[Step], LevelledSignals]:
        """What was held back for samples that will not come."""
        return self._advance(self._leveller.finish())

    def _advance(self, signals: LevelledSignals) -> tuple[list[Step], LevelledSignals]:
        self._gauge.push(signals)
        return [s for run in self._detector.push(signals) for s in self._gauge.measure(run)], signals


def detect_steps(log: SensorLog, config: Config) -> tuple[StepTrack, LevelledSignals]:
    """Steps and levelled signals of a whole log.

    Raises:
        DataError: no steps in it.
    """
    front_end = FrontEnd(config)
    steps, signals = front_end.feed(log)
    last_steps, last_signals = front_end.finish()
    steps += last_steps
    if not steps:
        raise DataError(
            f"{log.name}: no step found in {log.duration_s:.1f} s; nobody walks in this log, or steps.min_rise_m_s2 "
            "or steps.lambda_sigma is too high for this device"
        )
    return StepTrack.of(steps), LevelledSignals.concatenate([signals, last_signals])


def flat_length_m(config: StepLengthConfig, frequency_hz: float, bounce_m_s2: float) -> float:
    """Length of a step on the level: α + β f (paper) + κ bounce^(1/4) (Weinberg)."""
    return float(config.alpha_m + config.beta_m_s * frequency_hz + config.kappa * bounce_m_s2**0.25)


@dataclass(frozen=True)
class Peak:
    """A detected step before it is measured; ``first`` if it opens a run of steps."""

    index: int
    start_index: int
    first: bool


class StepDetector:
    """The paper's detector over a sliding window (section Step Detection Algorithm).

    A step is a local maximum of the moving average of |acc| that exceeds T_s = μ + λ σ and comes later than T_min
    after the one before. Two conditions of ours keep hands from walking: the maximum stands out from the valley
    before it, and steps come in runs, without the device being shaken or spun meanwhile.
    """

    def __init__(self, config: StepsConfig, rate_hz: float) -> None:
        self._config = config
        self._rate_hz = rate_hz
        smoothing = max(round(config.smoothing_s * rate_hz), 1)
        self._smooth = WindowMoments(1, smoothing)
        self._delay = (smoothing - 1) // 2  # of a moving average over the past
        self._window = WindowMoments(1, round(config.window_s * rate_hz))
        self._past = _Past()
        self._pending: list[int] = []
        self._walking = False

    def push(self, signals: LevelledSignals) -> list[list[Peak]]:
        """Take the next signals; return the runs, or continuations of runs, that they confirm."""
        if len(signals) == 0:
            return []
        smooth = self._smooth.push(signals.acc_norm_m_s2[:, None])[0][:, 0]
        mean, variance, _ = self._window.push(smooth[:, None])
        threshold = mean[:, 0] + self._config.lambda_sigma * np.sqrt(variance[:, 0])
        past = self._past.extend(signals, smooth, threshold)
        runs = []
        value = past.smooth
        # the last sample waits for its successor, so each is judged once, with one sample of delay
        peak = (value[1:-1] > value[:-2]) & (value[1:-1] >= value[2:]) & (value[1:-1] > past.threshold[1:-1])
        for at in np.flatnonzero(peak) + 1:
            if past.index[at] > past.judged:
                run = self._judge(int(at), past)
                if run:
                    runs.append(run)
        past.judged = int(past.index[-2]) if len(past.index) > 1 else past.judged
        past.trim(int(_BUFFER_S * self._rate_hz))
        return runs

    def _judge(self, at: int, past: _Past) -> list[Peak]:
        """One local maximum above the threshold: the peaks that it confirms, if any."""
        config, rate = self._config, self._rate_hz
        # the moving average lags behind; but a step never happened in a gap of the log, or before it
        window = past.index[max(at - self._delay, 0) : at + 1]
        holes = np.flatnonzero(np.diff(window) > 1)
        index = int(window[holes[-1] + 1 if len(holes) else 0])
        previous = self._pending[-1] if self._pending else None
        if previous is not None and index - previous <= config.min_interval_s * rate:
            return []
        in_run = previous is not None and index - previous <= config.max_interval_s * rate
        reach = index - previous if previous is not None and in_run else int(0.6 * rate)
        since = max(at - reach, 0)
        if past.smooth[at] - past.smooth[since : at + 1].min() < config.min_rise_m_s2:
            return []
        if self._handled(at, since, past):
            self._pending, self._walking = [], False
            return []
        if not in_run:
            self._pending, self._walking = [index], False
            return []
        self._pending.append(index)
        if self._walking:
            confirmed = self._pending[-2:]
            self._pending = confirmed
            return [Peak(confirmed[1], confirmed[0], first=False)]
        if len(self._pending) < config.min_run:
            return []
        self._walking = True
        # the first step of a run began about one step duration before its peak
        starts = [2 * self._pending[0] - self._pending[1], *self._pending]
        self._pending, run = self._pending[-2:], self._pending
        return [Peak(end, start, first=start == starts[0]) for start, end in zip(starts, run, strict=False)]

    def _handled(self, at: int, since: int, past: _Past) -> bool:
        """Whether the device is being shaken or spun rather than carried."""
        config, rate = self._config, self._rate_hz
        spun = abs(past.yaw[at] - past.yaw[max(at - int(config.spin_window_s * rate), 0)])
        tenth = max(int(_WOBBLE_STEP_S * rate), 1)
        yaw = past.yaw[max(at - int(_WOBBLE_WINDOW_S * rate), 0) : at + 1][::-tenth]
        wobble = np.abs(np.diff(yaw)).sum() - abs(yaw[-1] - yaw[0])
        tilt_rate = past.tilt_rate[since : at + 1].mean()
        return bool(
            spun > config.max_spin_rad or wobble > config.max_wobble_rad or tilt_rate > config.max_tilt_rate_rad_s
        )


class _Past:
    """Recent signals that the detector looks back on."""

    def __init__(self) -> None:
        self.index = np.empty(0, dtype=np.int64)
        self.smooth = self.threshold = self.yaw = self.tilt_rate = np.empty(0)
        self.judged = -1

    def extend(self, signals: LevelledSignals, smooth: FloatArray, threshold: FloatArray) -> _Past:
        self.index = np.concatenate((self.index, signals.index))
        self.smooth = np.concatenate((self.smooth, smooth))
        self.threshold = np.concatenate((self.threshold, threshold))
        self.yaw = np.concatenate((self.yaw, signals.yaw_gyro_rad))
        self.tilt_rate = np.concatenate((self.tilt_rate, signals.tilt_rate_rad_s))
        return self

    def trim(self, count: int) -> None:
        self.index, self.smooth, self.threshold = self.index[-count:], self.smooth[-count:], self.threshold[-count:]
        self.yaw, self.tilt_rate = self.yaw[-count:], self.tilt_rate[-count:]


class StepGauge:
    """Measures what each detected step says: its length, direction, field, altitude and the rest before it."""

    def __init__(self, length: StepLengthConfig, rate_hz: float, settle_s: float) -> None:
        self._length = length
        self._rate_hz = rate_hz
        self._signals: LevelledSignals | None = None
        self._rests = Rests(rate_hz, settle_s)
        self._last_end: int | None = None
        self._last_interval: int | None = None

    def push(self, signals: LevelledSignals) -> None:
        """Take the next signals, before the peaks found in them."""
        self._rests.push(signals)
        known = signals if self._signals is None else LevelledSignals.concatenate([self._signals, signals])
        self._signals = (
            known
            if len(signals) > int(_BUFFER_S * self._rate_hz)
            else known.tail(int(_BUFFER_S * self._rate_hz) + len(signals))
        )

    def measure(self, run: list[Peak]) -> list[Step]:
        """The steps of a run, the standing start before the very first of all."""
        steps: list[Step] = []
        for peak in run:
            interval = peak.index - peak.start_index
            stride = interval if peak.first or self._last_interval is None else (interval + self._last_interval) / 2
            first_of_walk = self._last_end is None
            step = self._measure_one(peak, frequency_hz=self._rate_hz / stride)
            if first_of_walk:
                steps.append(_standing_start(step, self._altitude_before(peak)))
            steps.append(step)
            self._last_end, self._last_interval = peak.index, interval
        return steps

    def _measure_one(self, peak: Peak, frequency_hz: float) -> Step:
        signals = self._signals
        assert signals is not None  # push comes before measure
        lo, hi = np.searchsorted(signals.index, (peak.start_index + 1, peak.index + 1))
        lo = min(lo, hi - 1)
        yaw_gyro = signals.yaw_gyro_rad[lo:hi]
        yaw_gyro_rad = float(yaw_gyro.mean())
        offset = signals.yaw_mag_rad[lo:hi] - yaw_gyro
        offset = offset[np.isfinite(offset)]
        yaw_mag_rad = float("nan")
        if len(offset):
            mean_offset = np.arctan2(np.sin(offset).mean(), np.cos(offset).mean())
            yaw_mag_rad = float(wrap_angle(np.asarray(yaw_gyro_rad + mean_offset)))
        bounce = float(np.ptp(signals.acc_n_m_s2[lo:hi, 2]))
        slope = self._slope(signals, hi, frequency_hz, bounce)
        length = flat_length_m(self._length, frequency_hz, bounce) + self._length.gamma_m * slope
        rest_rate, rest_sigma, rest_s = self._rests.take(peak.index)
        # a hole in the index between this step and the one before is a gap in the log
        since = np.searchsorted(signals.index, self._last_end) if self._last_end is not None else lo
        chained = bool(signals.index[hi - 1] - signals.index[since] == hi - 1 - since)
        if self._last_end is not None and signals.index[0] > self._last_end:
            chained = self._rests.unbroken_since(self._last_end)
        return Step(
            t_s=peak.index / self._rate_hz,
            start_s=peak.start_index / self._rate_hz,
            length_m=max(length, self._length.shortest_m),
            frequency_hz=frequency_hz,
            slope=slope,
            shortened_m=abs(self._length.gamma_m * slope),
            bounce_m_s2=bounce,
            yaw_s=float(signals.t_s[lo:hi].mean()),
            yaw_gyro_rad=yaw_gyro_rad,
            yaw_mag_rad=yaw_mag_rad,
            mag_norm_ut=_mean_finite(signals.mag_norm_ut[lo:hi]),
            mag_dip_rad=_mean_finite(signals.mag_dip_rad[lo:hi]),
            altitude_m=_mean_finite(signals.altitude_m[lo:hi]),
            chained=chained,
            rest_rate_rad_s=rest_rate,
            rest_sigma_rad_s=rest_sigma,
            rest_s=rest_s,
        )

    def _altitude_before(self, peak: Peak) -> float:
        """Mean altitude of the seconds before the first step: the reference of the whole walk."""
        assert self._signals is not None
        lo, hi = np.searchsorted(
            self._signals.t_s, (peak.start_index / self._rate_hz - 5.0, peak.index / self._rate_hz)
        )
        return _mean_finite(self._signals.altitude_m[lo:hi])

    def _slope(self, signals: LevelledSignals, end: int, frequency_hz: float, bounce_m_s2: float) -> float:
        """|climb rate| over flat walking speed; 0 within what air pressure does by itself."""
        start = max(end - int(_ALTITUDE_WINDOW_S * self._rate_hz), 0)
        altitude = signals.altitude_m[start:end]
        third = max(len(altitude) // 3, 1)
        rise_m = altitude[-third:].mean() - altitude[:third].mean()
        span_s = (len(altitude) - third) / self._rate_hz
        climb_m_s = abs(rise_m) / span_s if span_s > 0 else 0.0
        if not climb_m_s > self._length.min_climb_m_s:  # also when it is nan
            return 0.0
        flat_speed = max(flat_length_m(self._length, frequency_hz, bounce_m_s2), self._length.shortest_m) * frequency_hz
        return float(climb_m_s / flat_speed)


def _standing_start(first: Step, altitude_m: float) -> Step:
    """The breadcrumb before the first step: same direction, no length, where the step began."""
    nan = float("nan")
    return Step(
        t_s=first.start_s,
        start_s=first.start_s,
        length_m=0.0,
        frequency_hz=first.frequency_hz,
        slope=0.0,
        shortened_m=0.0,
        bounce_m_s2=first.bounce_m_s2,
        yaw_s=first.yaw_s,
        yaw_gyro_rad=first.yaw_gyro_rad,
        yaw_mag_rad=nan,
        mag_norm_ut=nan,
        mag_dip_rad=nan,
        altitude_m=altitude_m,
        chained=True,
        rest_rate_rad_s=nan,
        rest_sigma_rad_s=nan,
        rest_s=0.0,
    )


def _mean_finite(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")
