"""Step detection: the paper's detector over a sliding window."""

from __future__ import annotations

import numpy as np

from fbgraph.core.config import StepsConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.running_sums import WindowMoments
from fbgraph.front_end.step_track import LOOK_BACK_S, Peak

_WOBBLE_WINDOW_S, _WOBBLE_STEP_S = 2.0, 0.1


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
        self._window = WindowMoments(1, max(round(config.window_s * rate_hz), 1))
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
        past.trim(int(LOOK_BACK_S * self._rate_hz))
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
