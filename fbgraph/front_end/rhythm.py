"""The wearer's rhythm: how the acceleration of the last seconds repeats itself, told six times a second.

Causal and chunk-invariant. The grid's samples are averaged to 25 Hz; of the last seconds the correlation with
themselves at every lag is kept as running sums, once for the strength of the acceleration (which a turn of the device
leaves alone) and once for its direction (which shows the stride: left is not right).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.front_end.levelled_signals import LevelledSignals, gaps
from fbgraph.front_end.running_sums import WindowMeans, WindowMoments

FRAME_S = 0.16
"""Time between two frames, where the grid's rate is a multiple of 25 Hz."""
_MEAN_HZ, _EACH = 25.0, 4  # of which every fourth becomes a frame
_BLOCK = 512  # means at once: what the processor's cache holds
_SHORTEST_S, _LONGEST_S = 0.28, 1.64  # periods between which a rhythm is looked for
_STRIDE_S = 2.4  # the longest lag at which a stride is compared with the one before
_SHORT_WINDOW_S, _LONG_WINDOW_S, _LONG_LAG_S = 1.6, 2.8, 0.8
_LEVEL_S, _MOVED_S = 4.0, 2.0
_FLOOR_M_S2 = 0.05  # of acceleration that counts as noise
_FIRST_TOP, _FIRST_TOP_FAST, _FAST_S = 0.8, 0.87, 0.4  # the shortest lag this near the best is the period
_HALF_TOP, _HALF_TOP_SWUNG = 0.6, 0.25  # of a stride's correlation, at half of it: then it holds two steps
_NEAR = np.arange(-2, 3)  # lags
_SLOW_S, _SWUNG_RAD_S, _LIMB_RAD_S = 0.8, 0.5, 0.8


@dataclass(frozen=True)
class Frames:
    """Rhythm at N moments, each told by the samples up to it.

    Attributes:
        index: (N,) grid index of the last sample that a frame has seen.
        period_s: (N,) time from step to step.
        strength: (N,) correlation of |acc| one period (or stride) apart, -1 to 1.
        stride: (N,) correlation of the acceleration, direction and all, one stride apart.
        single: (N,) whether nothing repeats within a period: one top a step.
        breadth: (N,) 0 if the device moves to and fro on one line, up to 2/3 if alike in all directions.
        moved_m_s2: (N,) standard deviation of the acceleration over two seconds, all axes.
        swing_rad_s: (N,) mean rate of tilting over two seconds.
    """

    index: IntArray
    period_s: FloatArray
    strength: FloatArray
    stride: FloatArray
    single: BoolArray
    breadth: FloatArray
    moved_m_s2: FloatArray
    swing_rad_s: FloatArray

    def __len__(self) -> int:
        return len(self.index)

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """All of them, in the order in which they make frames."""
        return [getattr(self, name) for name in _FRAMES]

    @staticmethod
    def concatenate(pieces: list[Frames]) -> Frames:
        """Pieces in order as one."""
        if len(pieces) == 1:
            return pieces[0]
        return Frames(*[np.concatenate([getattr(piece, name) for piece in pieces]) for name in _FRAMES])

    def tail(self, count: int) -> Frames:
        """The last ``count`` frames."""
        start = max(len(self) - count, 0)
        return Frames(*[getattr(self, name)[start:] for name in _FRAMES])


_FRAMES = tuple(f.name for f in fields(Frames))


def no_frames() -> Frames:
    """None."""
    none = np.empty(0)
    return Frames(np.empty(0, dtype=np.int64), none, none, none, np.empty(0, dtype=np.bool_), none, none, none)


class Rhythm:
    """Levelled signals in, frames out; begins anew after every gap of the log."""

    def __init__(self, rate_hz: float) -> None:
        self._every = max(round(rate_hz / _MEAN_HZ), 1)
        self._mean_s = self._every / rate_hz
        self._index: IntArray = np.empty(0, dtype=np.int64)  # of samples of a frame that is not full
        self._samples = np.empty((0, 5))
        self._next = 0  # of the samples, this index should follow
        self._windows = _Windows(self._mean_s)

    def push(self, signals: LevelledSignals, until: int | None = None) -> Frames:
        """The frames that these samples fill.

        Args:
            signals: the next ones.
            until: frames that end after this grid index may come with the next samples; None for all now.
        """
        if len(signals) == 0:
            return no_frames()
        known = len(self._index)
        index = np.concatenate((self._index, signals.index))
        samples = np.empty((len(index), 5))
        samples[:known] = self._samples
        samples[known:, 0], samples[known:, 4] = signals.acc_norm_m_s2, signals.tilt_rate_rad_s
        samples[known:, 1:4] = signals.acc_n_m_s2
        out, frame = [], self._every * _EACH
        if int(index[0]) != self._next:  # a gap lies between the pieces
            self._windows = _Windows(self._mean_s)
        cuts = [0, *gaps(index), len(index)]
        if until is not None and len(cuts) == 2:
            cuts[1] = min(max(until + 1 - int(index[0]), 0), len(index))
        for lo, hi in itertools.pairwise(cuts):
            if lo:
                self._windows = _Windows(self._mean_s)
            # frames end where the grid index is a multiple, however the samples come
            first = lo + int(-index[lo] % frame)
            full = first + max((hi - first) // frame, 0) * frame
            for at in range(first, full, _BLOCK * self._every):
                end = min(at + _BLOCK * self._every, full)
                out.append(self._frames(index[at:end], samples[at:end]))
        self._index, self._samples = index[full:], samples[full:]
        self._next = int(self._index[0]) if len(self._index) else int(index[-1]) + 1
        return Frames.concatenate(out) if out else no_frames()

    def _frames(self, index: IntArray, samples: FloatArray) -> Frames:
        """Of samples that fill them."""
        parts = samples.reshape(-1, self._every, samples.shape[1])
        total = parts[:, 0].copy()
        for i in range(1, self._every):
            total += parts[:, i]
        means = total / self._every
        return self._windows.push(index[self._every * _EACH - 1 :: self._every * _EACH], means[:, :4], means[:, 4])


class _Windows:
    """Running sums over the means of an unbroken piece of log."""

    def __init__(self, mean_s: float) -> None:
        self._mean_s = mean_s
        self._lags = np.arange(round(_SHORTEST_S / mean_s), round(_STRIDE_S / mean_s) + 1)
        self._searched = int(np.searchsorted(self._lags, round(_LONGEST_S / mean_s), side="right"))
        long = self._lags * mean_s > _LONG_LAG_S + 1e-9
        self._window = np.where(long, round(_LONG_WINDOW_S / mean_s), round(_SHORT_WINDOW_S / mean_s))
        self._reach = int(self._window.max())
        self._most = int(self._lags.max())
        # of columns: where a lag was known, back from a mean; of frames: sums and energies to be subtracted
        self._back = self._most - self._lags[:, None]
        self._windows = np.concatenate((self._window, self._window))[:, None]
        self._rows = np.arange(2 * len(self._lags))[:, None]
        self._floor = (self._window * _FLOOR_M_S2**2)[:, None]
        self._share = np.where(self._lags[: self._searched] * mean_s < _FAST_S, _FIRST_TOP_FAST, _FIRST_TOP)
        self._level = WindowMeans(4, (round(_LEVEL_S / mean_s),))
        self._moved = WindowMoments(7, round(_MOVED_S / mean_s))
        self._acc = np.zeros((self._most, 4))
        self._sums = np.zeros((2 * len(self._lags), 1))
        self._energy = np.zeros((2, 1))

    def push(self, index: IntArray, acc: FloatArray, tilt_rate: FloatArray) -> Frames:
        """(4 N, 4) mean |acc|, forward, left, up and (4 N,) tilt rate of the next N frames."""
        acc = acc - self._level.push(acc)
        moving = np.empty((len(acc), 7))
        moving[:, :3], moving[:, 6] = acc[:, 1:], tilt_rate
        np.multiply(acc[:, 1:2], acc[:, 2:4], out=moving[:, 3:5])
        np.multiply(acc[:, 2], acc[:, 3], out=moving[:, 5])
        mean, variance, _ = self._moved.push(moving)
        mean, variance = mean[_EACH - 1 :: _EACH], variance[_EACH - 1 :: _EACH]
        breadth, moved = _breadth(mean, variance)
        known = np.concatenate((self._acc, acc))
        self._acc = known[-self._most :]
        norm, whole = self._correlations(known, len(acc)).transpose(0, 2, 1)
        period, strength, single = self._period(norm[:, : self._searched], mean[:, 6])
        rows = np.arange(len(index))
        at = np.rint(2.0 * period / self._mean_s).astype(int) - self._lags[0]
        near = np.minimum(np.maximum(at[:, None] + _NEAR, 0), len(self._lags) - 1)
        stride = whole[rows[:, None], near].max(axis=1)
        return Frames(index, period, strength, stride, single, breadth, moved, mean[:, 6])

    def _correlations(self, known: FloatArray, count: int) -> FloatArray:
        """(2, lags, N) of |acc| and of the vector at every lag, over the window of each, at every frame."""
        most, lags, window = self._most, self._lags[:, None], self._window[:, None]
        columns = np.ascontiguousarray(known.T)
        products = columns[:, None, most:] * columns[:, self._back + np.arange(count)]
        sums = _continued(self._sums, products)
        square = columns[:, most:] ** 2
        energies = _continued(self._energy, square[:, None])
        told = np.arange(_EACH - 1, count, _EACH)
        end, end_e = sums.shape[1] - count + told, energies.shape[1] - count + told
        part = sums[:, end] - sums[self._rows, np.maximum(end - self._windows, 0)]
        ends = np.empty((4, len(lags), len(told)), dtype=np.int64)
        ends[0] = end_e
        np.subtract(end_e, window, out=ends[1])
        np.subtract(end_e, lags, out=ends[2])
        np.subtract(ends[2], window, out=ends[3])
        now, then, lag, lag_then = energies[:, np.maximum(ends, 0)].transpose(1, 0, 2, 3)
        self._sums = sums[:, -self._reach - 1 :]
        self._energy = energies[:, -self._reach - most - 1 :]
        power = np.maximum((now - then) * (lag - lag_then), 0.0)
        return np.asarray(part.reshape(power.shape) / (np.sqrt(power) + self._floor))

    def _period(self, r: FloatArray, swing: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Time from step to step, its correlation, and whether it holds a single top."""
        lags, rows = self._lags[: self._searched], np.arange(len(r))
        top = np.zeros(r.shape, dtype=bool)
        top[:, 1:-1] = (r[:, 1:-1] >= r[:, :-2]) & (r[:, 1:-1] > r[:, 2:])
        height = np.where(top, r, -1.0)
        best = height.max(axis=1)
        at = (height >= self._share * best[:, None]).argmax(axis=1)
        at = np.where(best > 0, at, height.argmax(axis=1))
        strength = height[rows, at]
        period = lags[at].astype(float)
        left, right = r[rows, np.maximum(at - 1, 0)], r[rows, np.minimum(at + 1, len(lags) - 1)]
        bend = left - 2.0 * strength + right
        curved = (bend < -1e-9) & (strength > 0)
        period += np.where(curved, 0.5 * (left - right) / np.where(curved, bend, -1.0), 0.0)
        half = np.rint(period / 2.0).astype(int) - lags[0]
        near = np.minimum(np.maximum(half[:, None] + _NEAR, 0), len(lags) - 1)
        within = height[rows[:, None], near].max(axis=1) / np.maximum(strength, 0.05)
        slow = period * self._mean_s > _SLOW_S
        two = within > np.where(swing > _SWUNG_RAD_S, _HALF_TOP_SWUNG, _HALF_TOP)
        halved = slow & (two | (swing > _LIMB_RAD_S))
        return np.where(halved, period / 2.0, period) * self._mean_s, strength, ~halved & (within < 0.2)


def _continued(sums: FloatArray, values: FloatArray) -> FloatArray:
    """(2 R, K+N) running sums of |acc| and of the vector, and how they go on; term by term, as chunks must not matter.

    Args:
        sums: (2 R, K) so far.
        values: (4, R, N) to be added up, of |acc| and of the three axes.
    """
    rows, known = values.shape[1], sums.shape[1]
    out = np.empty((2 * rows, known + values.shape[2]))
    out[:, :known] = sums
    out[:rows, known:] = values[0]
    vector = out[rows:, known:]
    np.add(values[1], values[2], out=vector)
    vector += values[3]
    np.add.accumulate(out[:, known - 1 :], axis=1, out=out[:, known - 1 :])
    return out


def _breadth(mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """1 - |C|² / (tr C)² of the covariance of the three axes, and √tr C."""
    trace = variance[:, 0] + variance[:, 1] + variance[:, 2]
    square = variance[:, 0] ** 2 + variance[:, 1] ** 2 + variance[:, 2] ** 2
    for column, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        square += 2.0 * (mean[:, 3 + column] - mean[:, i] * mean[:, j]) ** 2
    return 1.0 - square / np.maximum(trace, 1e-9) ** 2, np.sqrt(trace)
