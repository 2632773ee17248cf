"""Step detection: the paper's detector over a sliding window, led by the wearer's rhythm."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from fbgraph.core.config import StepsConfig
from fbgraph.core.geometry import mean_of
from fbgraph.front_end.levelled_signals import LevelledSignals, gaps
from fbgraph.front_end.recent_signals import CARRIED_RAD_S, FILL_S, FILLED, SURE, Gait, Recent
from fbgraph.front_end.rhythm import Rhythm
from fbgraph.front_end.running_sums import WindowMeans, WindowMoments
from fbgraph.front_end.step_track import FIRST_LOOK_BACK_S, LOOK_BACK_S, Peak

_WOBBLE_WINDOW_S, _WOBBLE_STEP_S = 2.0, 0.1
_TRUSTED = 0.5  # correlation of |acc| from which a rhythm leads the detector
_REFRACTORY, _LONGEST = 0.6, 2.2  # periods
_WEAK_TOPS = 2  # more of them are needed then
_RISE_SIGMA = 0.7  # of a sinusoid, a quarter of its height
_RUNNING_S, _RUNNING_M_S2 = 0.38, 2.0  # nobody takes so quick steps and hardly moves
_HELD_BACK_S, _REMEMBERED_S = 10.0, LOOK_BACK_S - 1.0  # tops that a run may yet confirm; how far back a step may begin
_LONG_AFTER_S = 60.0
_SWUNG_S = FIRST_LOOK_BACK_S - 1.0  # how far back a swing before any step may end
_BEFORE_S = 12.0  # a swing this soon before the first steps is part of the walk
_BOUT_INTERVAL_S = (0.4, 1.1)
_BOUT_TILT_RAD_S = 0.5
_LOST, _LOST_TOPS = 0.4, 8  # a walk without a rhythm for so many tops is none
_SWUNG_STRIDES = 2.0  # that tell a swing
_BOUT_BREADTH = 0.015
_BOUT_DOUBT = 0.35
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
    frame: Gait


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
        self._past = Recent(rate_hz)
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
        past.extend(signals, smooth, threshold, sigma)
        runs: list[list[Peak]] = []
        # the last sample waits for its successor, so each is judged once, with one sample of delay
        begin = max(known - 2, 0)
        value = past.smooth[begin:]
        peak = (value[1:-1] > value[:-2]) & (value[1:-1] >= value[2:]) & (value[1:-1] > past.threshold[begin + 1 : -1])
        rows = np.flatnonzero(peak[:, 0] | peak[:, 1])
        index = past.index[rows + begin + 1]
        # the rhythm of what follows a top is heard later, lest its step wait for it
        past.hear(self._rhythm.push(signals, int(index[-1]) if len(index) else None))
        slow = past.is_slow(index)
        shown = np.where(slow, peak[rows, 1], peak[rows, 0]) & (index > past.judged)
        for row, now, scale in zip(rows[shown].tolist(), index[shown].tolist(), slow[shown].tolist(), strict=True):
            runs += self._begun(self._after_silence(now) + self._judge(row + begin + 1, int(scale), past), now)
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

    def _judge(self, at: int, slow: int, past: Recent) -> list[list[Peak]]:
        """One local maximum above the threshold, of this moving average: the peaks that it confirms, if any."""
        config, rate, frame = self._config, self._rate_hz, past.frame_at(at)
        led = frame.strength > _TRUSTED and (frame.period_s > _RUNNING_S or frame.moved_m_s2 > _RUNNING_M_S2)
        # the moving average lags behind; but a step never happened in a gap of the log, or before it
        window = past.index[max(at - self._delay[slow], 0) : at + 1]
        holes = gaps(window)
        index = int(window[holes[-1] if holes else 0])
        since_s = (index - self._pending[-1].index) / rate if self._pending else np.inf
        refractory_s, longest_s = config.min_interval_s, config.max_interval_s
        if led:
            short_s = _REFRACTORY * frame.period_s
            refractory_s = short_s if slow else min(short_s, refractory_s)
            longest_s = max(longest_s, _LONGEST * frame.period_s) if frame.strength > SURE else longest_s
        if since_s <= refractory_s:
            return []
        in_run = since_s <= longest_s
        since = max(at - (round(since_s * rate) if in_run else int(0.6 * rate * (1 + slow))), 0)
        rise = past.smooth[at, slow] - past.smooth[since : at + 1, slow].min()
        if rise < self._least_rise(past.sigma[at, slow], frame if led and frame.strength > SURE else None):
            return []
        if frame.strength > _TRUSTED and frame.bare(config.min_breadth):
            self._pending, self._walking = [], False
            return []
        tilt = float(mean_of(past.tilt_rate[since : at + 1]))
        handled = not frame.steady_s >= config.steady_s and self._handled(at, tilt, past, frame)
        calm = max(tilt, frame.swing_rad_s) < _BOUT_TILT_RAD_S and frame.breadth > _BOUT_BREADTH
        calm = calm and rise >= config.min_rise_m_s2
        doubted = in_run and not handled and any(top.handled for top in self._pending)
        if doubted and past.swings(at, frame):  # so it did while that could not be told yet
            since_swung = index - int(_SWUNG_STRIDES * 2.0 * frame.period_s * rate)
            self._pending = [replace(top, handled=top.handled and top.index < since_swung) for top in self._pending]
        flushed = [] if in_run else self._after_silence(index + int(_LONG_AFTER_S * rate))
        return flushed + self._follow(
            _Top(index, handled, bool(calm), bool(rise < config.min_rise_m_s2), frame), in_run, frame
        )

    def _follow(self, top: _Top, in_run: bool, frame: Gait) -> list[list[Peak]]:
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

    def _onset(self, first: Peak, frame: Gait, now: int) -> list[Peak]:
        """What was walked before a rhythm that alone makes steps was known: one long step, in doubt."""
        end, rate = first.start_index, self._rate_hz
        earliest = max(end - int(_ONSET_S * rate), now - int(_REMEMBERED_S * rate), self._told)
        start = self._past.moved_since(end, earliest, _ONSET_SHARE * frame.moved_m_s2)
        count = (end - start) / (frame.period_s * rate)
        return [Peak(end, start, True, _ONSET_DOUBT, count)] if count >= 1.0 else []

    def _filled(self, marks: list[int], frame: Gait) -> list[int]:
        """Steps set evenly where a steady rhythm leaves one or two out."""
        if frame.strength < FILLED or frame.period_s < FILL_S:
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

    def _least_rise(self, sigma: float, frame: Gait | None) -> float:
        """How far a top must stand out from the valley before it, m/s²."""
        config = self._config
        if frame is None:
            return config.min_rise_m_s2
        rise = max(_RISE_SIGMA * sigma, config.floor_rise_m_s2)
        return rise if frame.swing_rad_s > CARRIED_RAD_S else min(rise, config.min_rise_m_s2)

    def _handled(self, at: int, tilt_rate: float, past: Recent, frame: Gait) -> bool:
        """Whether the device is being shaken or spun rather than carried."""
        config, rate = self._config, self._rate_hz
        spun = abs(past.yaw[at] - past.yaw[max(at - int(config.spin_window_s * rate), 0)])
        tenth = max(int(_WOBBLE_STEP_S * rate), 1)
        yaw = past.yaw[max(at - int(_WOBBLE_WINDOW_S * rate), 0) : at + 1][::-tenth].tolist()
        wobble = sum(abs(b - a) for a, b in itertools.pairwise(yaw)) - abs(yaw[-1] - yaw[0])
        return bool(
            spun > config.max_spin_rad
            or tilt_rate > config.max_tilt_rate_rad_s
            or (wobble > config.max_wobble_rad and not past.swings(at, frame))
        )


def _peaks(marks: list[int]) -> list[Peak]:
    """A run from its tops; its first step began about one step duration before its top."""
    starts = [2 * marks[0] - marks[1], *marks]
    return [Peak(end, start, first=i == 0) for i, (start, end) in enumerate(zip(starts, marks, strict=False))]
