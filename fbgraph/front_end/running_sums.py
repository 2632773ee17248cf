"""Running sums over streams: means over grid intervals, moments over sliding windows; chunk-invariant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.core.sensor_log import Stream

AnyArray = NDArray[Any]


class IntervalMean:
    """Brings a stream to the grid as the mean over each grid interval, which keeps the integral exact.

    The running integral of the stream (trapezoids) is interpolated at the grid times: for a gyroscope of any rate and
    jitter the angle turned is the same before and after.
    """

    def __init__(self, width: int, max_gap_s: float) -> None:
        self._max_gap_s = max_gap_s
        self._last: FloatArray = np.empty((0, width))
        self._t_s = np.empty(0)
        self._integral = np.empty((0, width))
        self._gap_before: BoolArray = np.empty(0, dtype=np.bool_)

    @property
    def empty(self) -> bool:
        """Whether no sample has come yet."""
        return len(self._t_s) == 0

    @property
    def first_s(self) -> float:
        """Time of the first sample that is kept."""
        return float(self._t_s[0])

    @property
    def last_s(self) -> float:
        """Time of the latest sample."""
        return float(self._t_s[-1])

    def push(self, stream: Stream) -> None:
        """Take the next samples."""
        if len(stream) == 0:
            return
        if self.empty:
            t_s, values, carry = stream.t_s, stream.values, np.zeros((1, stream.values.shape[1]))
            lead_gap = np.array([False])
        else:
            t_s = np.concatenate((self._t_s[-1:], stream.t_s))
            values = np.concatenate((self._last, stream.values))
            carry = self._integral[-1:]
            lead_gap = np.empty(0, dtype=np.bool_)
        dt_s = t_s[1:] - t_s[:-1]
        integral = np.empty(values.shape)
        integral[:1] = carry
        np.multiply(0.5 * (values[1:] + values[:-1]), dt_s[:, None], out=integral[1:])
        np.add.accumulate(integral, axis=0, out=integral)
        if not self.empty:
            t_s, integral = t_s[1:], integral[1:]
        self._t_s = np.concatenate((self._t_s, t_s))
        self._integral = np.concatenate((self._integral, integral))
        self._gap_before = np.concatenate((self._gap_before, lead_gap, dt_s > self._max_gap_s))
        self._last = stream.values[-1:]

    def silences(self, least_s: float) -> list[tuple[float, float]]:
        """Last and next time of every silence among the samples kept that is longer than this."""
        if self._t_s[-1] - self._t_s[0] <= least_s:
            return []
        at = np.flatnonzero(self._t_s[1:] - self._t_s[:-1] > least_s)
        return list(zip(self._t_s[at].tolist(), self._t_s[at + 1].tolist(), strict=True))

    def means(self, index: IntArray, dt_s: float) -> tuple[FloatArray, BoolArray]:
        """(N, D) means over the grid interval that ends at each index, and (N,) whether no gap touches it."""
        if len(index) == 0:
            return np.empty((0, self._integral.shape[1])), np.empty(0, dtype=np.bool_)
        ends = np.asarray(np.concatenate((index[:1] - 1, index)) * dt_s, dtype=np.float64)
        at_ends = interp_columns(ends, self._t_s, self._integral)
        means = (at_ends[1:] - at_ends[:-1]) / dt_s
        if not self._gap_before.any():
            return means, np.ones(len(index), dtype=np.bool_)
        bracket = np.minimum(self._t_s.searchsorted(ends), len(self._t_s) - 1)
        in_gap = self._gap_before[bracket]
        return means, ~(in_gap[1:] | in_gap[:-1])

    def forget(self, before_s: float) -> None:
        """Drop samples that no grid point from this time on needs."""
        start = max(int(self._t_s.searchsorted(before_s, side="right")) - 1, 0)
        self._t_s, self._integral = self._t_s[start:], self._integral[start:]
        self._gap_before = self._gap_before[start:]


class WindowMeans:
    """Means over sliding windows of several lengths, by differences of running sums."""

    def __init__(self, width: int, windows: Sequence[int]) -> None:
        self._windows = tuple(windows)
        self._longest = max(windows)
        self._sums = np.zeros((1, width))
        self._origin: FloatArray | None = None

    def push(self, values: FloatArray) -> FloatArray:
        """(N, D) samples in; (N, W D) means out, of the first window, then of the next."""
        if self._origin is None:
            self._origin = values[0].copy()  # sums of deviations keep their digits for days
        known, width, count = len(self._sums), values.shape[1], len(values)
        history = np.empty((known + count, width))
        history[:known] = self._sums
        np.subtract(values, self._origin, out=history[known:])
        np.add.accumulate(history[known - 1 :], axis=0, out=history[known - 1 :])
        sums, means = history[known:], np.empty((count, width * len(self._windows)))
        for i, window in enumerate(self._windows):
            mean = means[:, i * width : (i + 1) * width]
            if known >= window:  # every window is full
                np.subtract(sums, history[known - window : known - window + count], out=mean)
                mean /= window
            else:
                now = np.arange(known, known + count)
                then = np.maximum(now - window, 0)
                np.subtract(sums, history[then], out=mean)
                mean /= (now - then)[:, None]
            mean += self._origin
        self._sums = history[-self._longest :]
        return means


class WindowMoments:
    """Mean and variance over a sliding window of samples, by differences of running sums."""

    def __init__(self, width: int, window: int) -> None:
        self._window = window
        self._sums = np.zeros((1, 2 * width))
        self._origin: FloatArray | None = None

    def push(self, values: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """(N, D) samples in; (N, D) mean, (N, D) variance and (N,) number of samples in the window out."""
        width = values.shape[1]
        if len(values) == 0:
            return values, values, np.empty(0, dtype=np.int64)
        if self._origin is None:
            self._origin = values[0].copy()  # sums of deviations keep their digits for days
        known, end = len(self._sums), len(self._sums) + len(values)
        history = np.empty((end, 2 * width))
        history[:known] = self._sums
        np.subtract(values, self._origin, out=history[known:, :width])
        np.square(history[known:, :width], out=history[known:, width:])
        np.add.accumulate(history[known - 1 :], axis=0, out=history[known - 1 :])
        sums = history[known:]
        if known == self._window:  # every window is full
            count = np.full(len(values), known, dtype=np.int64)
            moments = (sums - history[: len(values)]) / known
        else:
            now = np.arange(known, end, dtype=np.int64)
            then = np.maximum(now - self._window, 0)
            count = now - then
            moments = (sums - history[then]) / count[:, None]
        mean = moments[:, :width]
        variance = moments[:, width:]
        variance -= np.square(mean)
        np.maximum(variance, 0.0, out=variance)
        self._sums = history[-self._window :]
        return mean + self._origin, variance, count


class Latest:
    """The latest rows of some arrays that grow at their ends; what is kept of them is copied now and then only."""

    def __init__(self) -> None:
        """None yet."""
        self._room: list[AnyArray] = []
        self._end = 0

    def extend(self, arrays: Sequence[AnyArray], keep: int) -> list[AnyArray]:
        """Take the next rows, as many of each array; returns them after the last ``keep`` of those before.

        Args:
            arrays: the same ones in the same order every time.
            keep: rows.
        """
        count, kept = len(arrays[0]), min(self._end, keep)
        if not self._room or self._end + count > len(self._room[0]):
            # what was given away stays as it is: these are others
            room = [np.empty((kept + count + keep, *more.shape[1:]), dtype=more.dtype) for more in arrays]
            for new, old in zip(room, self._room, strict=False):
                new[:kept] = old[self._end - kept : self._end]
            self._room, self._end = room, kept
        begin, start = self._end - kept, self._end
        self._end = end = start + count
        for whole, more in zip(self._room, arrays, strict=True):
            whole[start:end] = more
        return [whole[begin:end] for whole in self._room]


def interp_columns(at_s: FloatArray, t_s: FloatArray, values: FloatArray) -> FloatArray:
    """``np.interp`` for every column."""
    out = np.empty((len(at_s), values.shape[1]))
    for i in range(values.shape[1]):
        out[:, i] = np.interp(at_s, t_s, values[:, i])
    return out
