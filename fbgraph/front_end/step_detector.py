"""Step detection: the paper's detector over a sliding window, led by the wearer's rhythm."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from fbgraph.core.config import StepsConfig
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.rhythm import FRAME_S, Frames, Rhythm, no_frames
from fbgraph.front_end.running_sums import Latest, WindowMeans, WindowMoments
from fbgraph.front_end.step_track import FIRST_LOOK_BACK_S, LOOK_BACK_S, Peak

_WOBBLE_WINDOW_S, _WOBBLE_STEP_S = 2.0, 0.1
_TRUSTED = 0.5  # correlation of |acc| from which a rhythm leads the detector
_FILLED = 0.6  # and from which a missing top is a step all the same
_STEADY, _UNSTEADY = 0.7, 0.55  # of a swing that repeats itself with every stride, and of one that no longer does
_REFRACTORY, _LONGEST = 0.6, 2.2  # periods
_SURE = 0.75  # and from which its tops may be lower than any hand's
_SLOW_S = 0.85  # a longer period has several maxima a step, unless they are averaged over twice as long
_WEAK_TOPS = 2  # more of them are needed then
_RISE_SIGMA = 0.7  # of a sinusoid, a quarter of its height
_RUNNING_S, _RUNNING_M_S2 = 0.38, 2.0  # nobody takes so quick steps and hardly moves
_SWUNG_RAD_S = 0.8  # and of one on a limb
_CARRIED_RAD_S = 0.5  # mean tilting of a device that is held, not swung
_HELD_BACK_S, _REMEMBERED_S = 10.0, LOOK_BACK_S - 1.0  # tops that a run may yet confirm; how far back a step may begin
_LONG_AFTER_S = 60.0
_SWUNG_S = FIRST_LOOK_BACK_S - 1.0  # how far back a swing before any step may end
_BEFORE_S = 12.0  # a swing this soon before the first steps is part of the walk
_FRAMES_KEPT = int(2.0 * LOOK_BACK_S / FRAME_S)
_FILL_S = 0.4  # of a shorter period the half cannot be told from the whole
_BOUT_INTERVAL_S = (0.4, 1.1)
_BOUT_TILT_RAD_S = 0.5
_LOST, _LOST_TOPS = 0.4, 8  # a walk without a rhythm for so many tops is none
_DEAD_RAD_S = 0.008  # a gyroscope that shows less tells nothing
_LEAST_SWING = 0.015, 0.01  # rad/s, and for each m/s²: nobody carries a device without turning it a little
_BOUT_BREADTH = 0.015
_PUSH_S = 0.6, 0.5  # before the first top of a bout and after the last
_BOUT_DOUBT, _SWUNG_DOUBT = 0.35, 0.15
_ONSET_S, _ONSET_SHARE, _ONSET_DOUBT = 3.2, 0.6, 0.5
_UNRESOLVED_DOUBT, _UNRESOLVED_SHARE = 0.8, 0.6  # a limb's swing, too brief to be sure that it went anywhere
_BOUT_SHARE = 0.8  # who sets off and comes to a stand at once takes short steps


@dataclass(frozen=True, slots=True)
class _Top:
    """A maximum that may become a step: where, whether the device was handled or held calmly meanwhile, the rhythm.

    ``weak`` is one that only the rhythm makes a step.
    """

    index: int
    handled: bool
    calm: bool
    weak: bool
    frame: _Frame


class StepDetector:
    """The paper's detector over a sliding window (section Step Detection Algorithm), led by the wearer's rhythm.

    A step is a local maximum of the moving average of |acc| that exceeds T_s = μ + λ σ and comes later than T_min
    after the one before. Where the acceleration repeats itself, T_min, the average and how far a maximum must stand
    out follow its period; where a top is missing in a steady rhythm the step is set between its neighbours. What keeps
    hands from walking: who walks does not move to and fro on one line, steps come in runs (or in short bouts of a
    device held calmly), and a device that is shaken or spun is not carried, unless it swings with the stride.
    """

    def __init__(self, config: StepsConfig, rate_hz: float) -> None:
        self._config = config
        self._rate_hz = rate_hz
        smoothing = max(round(config.smoothing_s * rate_hz), 1)
        self._smooth = WindowMeans(1, (smoothing, 2 * smoothing))
        self._delay = (smoothing - 1) // 2, (2 * smoothing - 1) // 2  # of a moving average over the past
        window = max(round(config.window_s * rate_hz), 1)
        self._window = WindowMoments(2, window)
        self._rhythm = Rhythm(rate_hz)
        self._past = _Past()
        self._pending: list[_Top] = []
        self._walking = False
        self._told = 0  # grid index up to which steps were told
        self._swung: Peak | None = None  # before any step: the walk, or the handling that goes before it
        self._lost = 0  # tops since the walk had a rhythm

    def push(self, signals: LevelledSignals) -> list[list[Peak]]:
        """Take the next signals; return the runs, or continuations of runs, that they confirm."""
        if len(signals) == 0:
            return []
        smooth = self._smooth.push(signals.acc_norm_m_s2[:, None])
        mean, variance, _ = self._window.push(smooth)
        sigma = np.sqrt(variance)
        threshold = mean + self._config.lambda_sigma * sigma
        past, known = self._past, len(self._past.index)
        past.extend(signals, smooth, threshold, sigma, self._rhythm.push(signals))
        runs: list[list[Peak]] = []
        # the last sample waits for its successor, so each is judged once, with one sample of delay
        begin = max(known - 2, 0)
        value, slow = past.smooth[begin:], past.slow[begin + 1 : -1]
        peak = (value[1:-1] > value[:-2]) & (value[1:-1] >= value[2:]) & (value[1:-1] > past.threshold[begin + 1 : -1])
        at_peaks = np.flatnonzero(np.where(slow, peak[:, 1], peak[:, 0])) + begin + 1
        for at in at_peaks[past.index[at_peaks] > past.judged].tolist():
            now = int(past.index[at])
            runs += self._begun(self._after_silence(now) + self._judge(at, past), now)
            self._told = runs[-1][-1].index if runs else self._told
        past.judged = int(past.index[-2]) if len(past.index) > 1 else past.judged
        runs += self._begun(self._after_silence(past.judged + 1), past.judged + 1)
        self._told = runs[-1][-1].index if runs else self._told
        past.trim(int(LOOK_BACK_S * self._rate_hz))
        return runs

    def finish(self) -> list[list[Peak]]:
        """The bout, or the swing, that nothing follows."""
        now = self._past.judged
        runs = self._begun(self._after_silence(now + int(_LONG_AFTER_S * self._rate_hz)), now)
        swung = self._remembered(now)
        return [[swung]] if not runs and not self._told and swung is not None else runs

    def _remembered(self, now: int) -> Peak | None:
        """The swing before any step, unless its end is so long ago that its signals are gone."""
        swung = self._swung
        return swung if swung is not None and now - swung.index < int(_SWUNG_S * self._rate_hz) else None

    def _begun(self, runs: list[list[Peak]], now: int) -> list[list[Peak]]:
        """Runs, without a swing that no walk follows: before they walk, people shake and turn what they carry."""
        if self._told or not runs:
            return runs
        if len(runs) == 1 and runs[0][0].doubt == _UNRESOLVED_DOUBT:
            self._swung = runs[0][0]
            return []
        swung, self._swung = self._remembered(now), None
        near = swung is not None and runs[0][0].start_index - swung.index < int(_BEFORE_S * self._rate_hz)
        return [[swung], *runs] if near and swung is not None else runs

    def _after_silence(self, index: int) -> list[list[Peak]]:
        """What ended before it became a run.

        Tops of a device that was held calmly and went somewhere are a bout; a swing that repeated itself for a while
        is walking whose steps are not resolved: one long step, whose doubt is nearly as large as itself.
        """
        config, rate, tops = self._config, self._rate_hz, self._pending
        if not tops or index - tops[-1].index <= int(2.0 * config.max_interval_s * rate):
            return []
        self._pending, walking, self._walking = [], self._walking, False
        if walking or len(tops) < config.min_bout:
            return []
        marks = [top.index for top in tops]
        gaps_s = np.diff(marks) / rate
        even = _BOUT_INTERVAL_S[0] <= gaps_s.min() <= gaps_s.max() <= _BOUT_INTERVAL_S[1]
        calm = even and all(top.calm for top in tops)
        if calm and self._past.pushed_m_s(marks[0], marks[-1], rate) >= config.min_push_m_s:
            return [[replace(peak, doubt=_BOUT_DOUBT, share=_BOUT_SHARE) for peak in _peaks(marks)]]
        rhythm = max(tops, key=lambda top: top.frame.steady_s).frame
        if len(tops) < config.min_run or rhythm.steady_s < 0.5 * config.steady_s:
            return []
        count = (marks[-1] - marks[0]) / (rhythm.period_s * rate)
        return [[Peak(marks[-1], marks[0], True, _UNRESOLVED_DOUBT, count, _UNRESOLVED_SHARE, swung=True)]]

    def _judge(self, at: int, past: _Past) -> list[list[Peak]]:
        """One local maximum above the threshold: the peaks that it confirms, if any."""
        config, rate, frame = self._config, self._rate_hz, past.frame_at(at)
        slow = int(past.slow[at])
        led = frame.strength > _TRUSTED and (frame.period_s > _RUNNING_S or frame.moved_m_s2 > _RUNNING_M_S2)
        # the moving average lags behind; but a step never happened in a gap of the log, or before it
        window = past.index[max(at - self._delay[slow], 0) : at + 1]
        holes = np.flatnonzero(np.diff(window) > 1)
        index = int(window[holes[-1] + 1 if len(holes) else 0])
        since_s = (index - self._pending[-1].index) / rate if self._pending else np.inf
        refractory_s, longest_s = config.min_interval_s, config.max_interval_s
        if led:
            short_s = _REFRACTORY * frame.period_s
            refractory_s = short_s if slow else min(short_s, refractory_s)
            longest_s = max(longest_s, _LONGEST * frame.period_s) if frame.strength > _SURE else longest_s
        if since_s <= refractory_s:
            return []
        in_run = since_s <= longest_s
        since = max(at - (round(since_s * rate) if in_run else int(0.6 * rate * (1 + slow))), 0)
        rise = past.smooth[at, slow] - past.smooth[since : at + 1, slow].min()
        if rise < self._least_rise(past.sigma[at, slow], frame if led and frame.strength > _SURE else None):
            return []
        if frame.strength > _TRUSTED and frame.bare(config.min_breadth):
            self._pending, self._walking = [], False
            return []
        handled = self._handled(at, since, past) and not frame.steady_s >= config.steady_s
        tilt = past.tilt_rate[since : at + 1].mean()
        calm = max(tilt, frame.swing_rad_s) < _BOUT_TILT_RAD_S and frame.breadth > _BOUT_BREADTH
        calm = calm and rise >= config.min_rise_m_s2
        flushed = [] if in_run else self._after_silence(index + int(_LONG_AFTER_S * rate))
        return flushed + self._follow(
            _Top(index, handled, bool(calm), bool(rise < config.min_rise_m_s2), frame), in_run, frame
        )

    def _follow(self, top: _Top, in_run: bool, frame: _Frame) -> list[list[Peak]]:
        """The steps that a top confirms after those before it."""
        config = self._config
        if not in_run:
            self._pending, self._walking = [top], False
            return []
        self._lost = 0 if frame.strength > _LOST else self._lost + 1
        if (top.handled or self._lost > _LOST_TOPS) and self._walking:
            self._pending, self._walking = [], False
        self._pending.append(top)
        if self._walking:
            before, self._pending = self._pending[-2], self._pending[-1:]
            marks = self._filled([before.index, top.index], frame)
            return [[frame.peak(end, start, first=False) for start, end in itertools.pairwise(marks)]]
        swung = frame.steady_s >= config.steady_s
        if not swung:
            handled = [i for i, held in enumerate(self._pending) if held.handled]
            tops = self._pending[handled[-1] + 1 :] if handled else self._pending
            least = config.min_run + _WEAK_TOPS * any(held.weak for held in tops[-config.min_run :])
            if len(tops) < least or max(held.frame.strength for held in tops) < config.min_rhythm:
                limit = int(_HELD_BACK_S * self._rate_hz)
                self._pending = [held for held in self._pending if held.index > top.index - limit]
                return []
        else:
            tops = self._pending
        self._walking, self._pending = True, self._pending[-1:]
        run = [
            frame.peak(peak.index, peak.start_index, peak.first)
            for peak in _peaks(self._filled([held.index for held in tops], frame))
        ]
        if any(held.weak for held in tops):
            onset = self._onset(run[0], frame, top.index)
            run = [*onset, replace(run[0], first=not onset), *run[1:]]
        return [run]

    def _onset(self, first: Peak, frame: _Frame, now: int) -> list[Peak]:
        """What was walked before a rhythm that alone makes steps was known: one long step, in doubt."""
        end, rate = first.start_index, self._rate_hz
        earliest = max(end - int(_ONSET_S * rate), now - int(_REMEMBERED_S * rate), self._told)
        start = self._past.moved_since(end, earliest, _ONSET_SHARE * frame.moved_m_s2)
        count = (end - start) / (frame.period_s * rate)
        return [Peak(end, start, True, _ONSET_DOUBT, count)] if count >= 1.0 else []

    def _filled(self, marks: list[int], frame: _Frame) -> list[int]:
        """Steps set evenly where a steady rhythm leaves one or two out."""
        if frame.strength < _FILLED or frame.period_s < _FILL_S:
            return marks
        out, period = marks[:1], frame.period_s * self._rate_hz
        for end in marks[1:]:
            start = out[-1]
            steps = (end - start) / period
            count = round(steps)
            if 2 <= count <= 3 and abs(steps - count) < 0.3 and self._past.whole(start, end):
                out += [start + round((end - start) * i / count) for i in range(1, count)]
            out.append(end)
        return out

    def _least_rise(self, sigma: float, frame: _Frame | None) -> float:
        """How far a top must stand out from the valley before it, m/s²."""
        config = self._config
        if frame is None:
            return config.min_rise_m_s2
        rise = max(_RISE_SIGMA * sigma, config.floor_rise_m_s2)
        return rise if frame.swing_rad_s > _CARRIED_RAD_S else min(rise, config.min_rise_m_s2)

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


def _peaks(marks: list[int]) -> list[Peak]:
    """A run from its tops; its first step began about one step duration before its top."""
    starts = [2 * marks[0] - marks[1], *marks]
    return [Peak(end, start, first=i == 0) for i, (start, end) in enumerate(zip(starts, marks, strict=False))]


@dataclass(frozen=True, slots=True)
class _Frame:
    """The rhythm at one moment."""

    period_s: float
    strength: float
    breadth: float
    moved_m_s2: float
    swing_rad_s: float
    steady_s: float

    def bare(self, min_breadth: float) -> bool:
        """Whether a rhythm has nothing of a walk: to and fro on one line, or no turn of the device at all."""
        least_rad_s = _LEAST_SWING[0] + _LEAST_SWING[1] * self.moved_m_s2
        return self.breadth < min_breadth or _DEAD_RAD_S < self.swing_rad_s < least_rad_s

    def peak(self, index: int, start_index: int, first: bool) -> Peak:
        """A step in this rhythm; nobody knows how far a limb's swing carries its wearer."""
        swung = self.swing_rad_s > _SWUNG_RAD_S
        return Peak(index, start_index, first, doubt=_SWUNG_DOUBT if swung else 0.0, swung=swung)


_NO = np.array([False])
_NO_RHYTHM = _Frame(1.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def _is_slow(frames: Frames) -> BoolArray:
    """(N,) whether the moving average over twice as long shows the tops."""
    return frames.single & (frames.period_s > _SLOW_S) & (frames.strength > _FILLED)


class _Past:
    """Recent signals that the detector looks back on."""

    def __init__(self) -> None:
        self.index = np.empty(0, dtype=np.int64)
        self.smooth = self.threshold = self.sigma = np.empty((0, 2))
        self.yaw = self.tilt_rate = np.empty(0)
        self.level = np.empty((0, 2))
        self.slow: BoolArray = np.empty(0, dtype=np.bool_)
        self.frames, self.steady = no_frames(), np.empty(0)
        self.judged = -1
        self._steady = 0.0
        self._frame_slow = np.zeros(1, dtype=np.bool_)
        self._latest, self._latest_frames = Latest(), Latest()

    def extend(
        self, signals: LevelledSignals, smooth: FloatArray, threshold: FloatArray, sigma: FloatArray, frames: Frames
    ) -> None:
        if len(frames):
            more = (*frames.arrays, self._steadiness(frames))
            *columns, self.steady = self._latest_frames.extend(more, len(self.frames))
            self.frames = Frames(*columns)
            # the last for what comes before all frames
            self._frame_slow = np.concatenate((self._frame_slow[:-1], _is_slow(frames), _NO))
        slow = self._frame_slow[np.searchsorted(self.frames.index, signals.index, side="right") - 1]
        level, yaw, tilt_rate = signals.acc_n_m_s2[:, :2], signals.yaw_gyro_rad, signals.tilt_rate_rad_s
        more = (signals.index, smooth, threshold, sigma, yaw, level, tilt_rate, slow)
        (self.index, self.smooth, self.threshold, self.sigma, self.yaw, self.level, self.tilt_rate, self.slow) = (
            self._latest.extend(more, len(self.index))
        )

    def _steadiness(self, frames: Frames) -> FloatArray:
        """(N,) seconds since the swing began to repeat itself with every stride."""
        lost = (frames.strength < _UNSTEADY) | (frames.stride < _UNSTEADY)
        good = (frames.strength > _STEADY) & (frames.stride > _STEADY)
        out = np.empty(len(frames))
        for i, (bad, fine) in enumerate(zip(lost.tolist(), good.tolist(), strict=True)):
            self._steady = 0.0 if bad else self._steady + FRAME_S * fine
            out[i] = self._steady
        return out

    def pushed_m_s(self, first: int, last: int, rate_hz: float) -> float:
        """How fast the device went somewhere about these indices, who stood before and after."""
        lo, hi = np.searchsorted(self.index, (first - _PUSH_S[0] * rate_hz, last + _PUSH_S[1] * rate_hz))
        acc = self.level[lo:hi]
        if len(acc) == 0:
            return 0.0
        speed = np.cumsum(acc - acc.mean(axis=0), axis=0) / rate_hz
        return float(np.hypot(*np.ptp(speed, axis=0)))

    def moved_since(self, end: int, earliest: int, least_m_s2: float) -> int:
        """From which grid index on, up to ``end`` and not before ``earliest``, the device moved so much."""
        frames = self.frames
        resting = (frames.index <= end) & ~((frames.index > earliest) & (frames.moved_m_s2 > least_m_s2))
        at = np.flatnonzero(resting)
        begun = max(int(frames.index[at[-1]]), earliest) if len(at) else end
        return begun if begun < end and self.whole(begun, end) else end

    def whole(self, first: int, last: int) -> bool:
        """Whether the log has no gap between two grid indices."""
        lo, hi = np.searchsorted(self.index, (first, last))
        return bool(hi - lo == last - first)

    def frame_at(self, at: int) -> _Frame:
        """The rhythm as it was known at a sample."""
        frames = self.frames
        i = int(np.searchsorted(frames.index, self.index[at], side="right")) - 1
        if i < 0:
            return _NO_RHYTHM
        return _Frame(
            float(frames.period_s[i]),
            float(frames.strength[i]),
            float(frames.breadth[i]),
            float(frames.moved_m_s2[i]),
            float(frames.swing_rad_s[i]),
            float(self.steady[i]),
        )

    def trim(self, count: int) -> None:
        self.index, self.yaw, self.tilt_rate = self.index[-count:], self.yaw[-count:], self.tilt_rate[-count:]
        self.smooth, self.threshold, self.sigma = self.smooth[-count:], self.threshold[-count:], self.sigma[-count:]
        self.slow, self.level = self.slow[-count:], self.level[-count:]
        if len(self.frames) > 2 * _FRAMES_KEPT:
            self.frames, self.steady = self.frames.tail(_FRAMES_KEPT), self.steady[-_FRAMES_KEPT:]
            self._frame_slow = self._frame_slow[-_FRAMES_KEPT - 1 :]
