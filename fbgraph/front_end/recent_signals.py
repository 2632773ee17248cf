"""What the step detector looks back on: recent signals, and the wearer's rhythm at each moment of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.rhythm import FRAME_S, Frames, no_frames
from fbgraph.front_end.running_sums import Latest
from fbgraph.front_end.step_track import LOOK_BACK_S, Peak

FILLED = 0.6
"""Correlation of |acc| from which a missing top is a step all the same."""
SURE = 0.75
"""And from which its tops may be lower than any hand's."""
CARRIED_RAD_S = 0.5
"""Mean tilting of a device that is held, not swung, at most."""
FILL_S = 0.4
"""Of a shorter period the half cannot be told from the whole."""
_STEADY, _UNSTEADY = 0.7, 0.55  # of a swing that repeats itself with every stride, and of one that no longer does
_SLOW_S = 0.85  # a longer period has several maxima a step, unless they are averaged over twice as long
_SWUNG_RAD_S = 0.8  # and of one on a limb
_FRAMES_KEPT = int(2.0 * LOOK_BACK_S / FRAME_S)
_SWINGS_BACK = 0.75  # of how far an arm is away after half a stride, how far after a whole one
_DEAD_RAD_S = 0.008  # a gyroscope that shows less tells nothing
_LEAST_SWING = 0.015, 0.01  # rad/s, and for each m/s²: nobody carries a device without turning it a little
_PUSH_S = 0.6, 0.5  # before the first top of a bout and after the last
_SWUNG_DOUBT = 0.15


@dataclass(frozen=True, slots=True)
class Gait:
    """The rhythm at one moment, as ``rhythm.Frames`` has them; ``steady_s`` as ``Recent.steady``."""

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

    @property
    def walked(self) -> bool:
        """Whether it is a walker's: steady, and the device is kept level."""
        return self.strength > SURE and self.swing_rad_s < CARRIED_RAD_S and FILL_S < self.period_s < _SLOW_S

    def peak(self, index: int, start_index: int, first: bool) -> Peak:
        """A step in this rhythm; nobody knows how far a limb's swing carries its wearer."""
        swung = self.swing_rad_s > _SWUNG_RAD_S
        return Peak(index, start_index, first, doubt=_SWUNG_DOUBT if swung else 0.0, swung=swung)


NO_GAIT = Gait(1.0, 0.0, 1.0, 0.0, 0.0, 0.0)
_NO = np.array([False])


def _is_slow(frames: Frames) -> BoolArray:
    """(N,) whether the moving average over twice as long shows the tops."""
    return frames.single & (frames.period_s > _SLOW_S) & (frames.strength > FILLED)


class Recent:
    """Recent signals that the detector looks back on.

    As ``LevelledSignals`` have them; ``smooth`` (N, 2) are moving averages of |acc|, with ``threshold`` and ``sigma``,
    ``steady`` (F,) the seconds since the swing of a frame began to repeat itself with every stride.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self.index = np.empty(0, dtype=np.int64)
        self.smooth = self.threshold = self.sigma = np.empty((0, 2))
        self.yaw = self.tilt_rate = np.empty(0)
        self.level = np.empty((0, 2))
        self.frames, self.steady = no_frames(), np.empty(0)
        self.judged = -1
        self._steady = 0.0
        self._frame_slow = np.zeros(1, dtype=np.bool_)
        self._latest, self._latest_frames = Latest(), Latest()

    def extend(self, signals: LevelledSignals, smooth: FloatArray, threshold: FloatArray, sigma: FloatArray) -> None:
        """Take the next signals."""
        level, yaw, tilt_rate = signals.acc_n_m_s2[:, :2], signals.yaw_gyro_rad, signals.tilt_rate_rad_s
        more = (signals.index, smooth, threshold, sigma, yaw, level, tilt_rate)
        (self.index, self.smooth, self.threshold, self.sigma, self.yaw, self.level, self.tilt_rate) = (
            self._latest.extend(more, len(self.index))
        )

    def hear(self, frames: Frames) -> None:
        """Take the next frames."""
        if len(frames) == 0:
            return
        more = (*frames.arrays, self._steadiness(frames))
        *columns, self.steady = self._latest_frames.extend(more, len(self.frames))
        self.frames = Frames(*columns)
        # the last for what comes before all frames
        self._frame_slow = np.concatenate((self._frame_slow[:-1], _is_slow(frames), _NO))

    def is_slow(self, index: IntArray) -> BoolArray:
        """(N,) whether the moving average over twice as long shows the tops at these grid indices."""
        return np.asarray(self._frame_slow[self.frames.index.searchsorted(index, side="right") - 1])

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

    def swings(self, at: int, frame: Gait) -> bool:
        """Whether the yaw goes back and forth with the stride, as an arm does: once in two steps, and comes back."""
        if not frame.walked:
            return False
        stride = round(2.0 * frame.period_s * self._rate_hz)
        since = at - 2 * stride
        if since < 0 or self.index[at] - self.index[since] > 2 * stride:
            return False
        yaw = self.yaw[since : at + 1]
        now, before, between = yaw[stride:], yaw[:-stride], yaw[stride // 2 : -(stride - stride // 2)]
        back, away = (now - before).std(), (now - between).std()
        return bool(back < _SWINGS_BACK * away)

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

    def frame_at(self, at: int) -> Gait:
        """The rhythm as it was known at a sample."""
        frames = self.frames
        i = int(np.searchsorted(frames.index, self.index[at], side="right")) - 1
        if i < 0:
            return NO_GAIT
        return Gait(
            float(frames.period_s[i]),
            float(frames.strength[i]),
            float(frames.breadth[i]),
            float(frames.moved_m_s2[i]),
            float(frames.swing_rad_s[i]),
            float(self.steady[i]),
        )

    def trim(self, count: int) -> None:
        """Forget all but the last ``count`` samples."""
        self.index, self.yaw, self.tilt_rate = self.index[-count:], self.yaw[-count:], self.tilt_rate[-count:]
        self.smooth, self.threshold, self.sigma = self.smooth[-count:], self.threshold[-count:], self.sigma[-count:]
        self.level = self.level[-count:]
        if len(self.frames) > 2 * _FRAMES_KEPT:
            self.frames, self.steady = self.frames.tail(_FRAMES_KEPT), self.steady[-_FRAMES_KEPT:]
            self._frame_slow = self._frame_slow[-_FRAMES_KEPT - 1 :]
