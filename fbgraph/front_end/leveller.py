"""From raw streams to levelled signals on one clock: yaw, compass, altitude, stillness.

``Leveller`` is causal and chunk-invariant: fed a log whole or in pieces of any size, cut at any time, it returns the
same samples. Everything in it is therefore either element-wise or strictly sequential (running sums with a carry).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from vqf import VQF

from fbgraph.core.config import AttitudeConfig, DeviceConfig
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray, rotate, wrap_angle
from fbgraph.core.log import SensorLog, Stream, empty_stream

_PRESSURE_MEDIAN = 5  # samples; rejects single outliers of slow barometers


@dataclass(frozen=True)
class LevelledSignals:
    """Signals of a piece of walk on a uniform grid (silent where the inertial sensors were).

    Attributes:
        index: (N,) grid index; ``t_s = index / rate_hz``. Consecutive except across gaps.
        acc_norm_m_s2: (N,) magnitude of specific force.
        acc_n_m_s2: (N, 3) specific force in the levelled frame turned to face the walking direction: forward, left, up.
        tilt_rate_rad_s: (N,) magnitude of the angular rate about horizontal axes: shaking, not turning.
        yaw_gyro_rad: (N,) walking direction by the gyroscope alone, unwrapped, arbitrary start; its bias still in it.
        yaw_mag_rad: (N,) walking direction by the compass, wrapped, nan where there is no magnetometer sample.
        mag_norm_ut: (N,) strength of the field, nan where unknown.
        mag_dip_rad: (N,) angle of the field below the horizon, nan where unknown.
        altitude_m: (N,) by the standard atmosphere; nan before the first barometer sample.
        still: (N,) whether the device has been standing still for the whole still window.
    """

    index: IntArray
    t_s: FloatArray
    acc_norm_m_s2: FloatArray
    acc_n_m_s2: FloatArray
    tilt_rate_rad_s: FloatArray
    yaw_gyro_rad: FloatArray
    yaw_mag_rad: FloatArray
    mag_norm_ut: FloatArray
    mag_dip_rad: FloatArray
    altitude_m: FloatArray
    still: BoolArray

    def __len__(self) -> int:
        return len(self.index)

    def head(self, count: int) -> LevelledSignals:
        """The first ``count`` samples."""
        return LevelledSignals(*[getattr(self, name)[:count] for name in _SIGNALS])

    def tail(self, count: int) -> LevelledSignals:
        """The last ``count`` samples."""
        start = max(len(self) - count, 0)
        return LevelledSignals(*[getattr(self, name)[start:] for name in _SIGNALS])

    @staticmethod
    def concatenate(pieces: list[LevelledSignals]) -> LevelledSignals:
        """Pieces in order as one."""
        if len(pieces) == 1:
            return pieces[0]
        return LevelledSignals(*[np.concatenate([getattr(p, name) for p in pieces]) for name in _SIGNALS])


_SIGNALS = tuple(f.name for f in fields(LevelledSignals))


def pressure_altitude_m(pressure_hpa: FloatArray) -> FloatArray:
    """Altitude in the ICAO standard atmosphere (only differences of it are used).

    h = (T0 / L) (1 - (p / p0)^(R L / g)), ICAO Doc 7488; p in hPa, h in m.
    """
    return 44330.77 * (1.0 - (pressure_hpa / 1013.25) ** 0.190263)


class Leveller:
    """Streams in, levelled signals out; see the module's text for what it promises."""

    def __init__(self, device: DeviceConfig, config: AttitudeConfig) -> None:
        self._config = config
        self._dt_s = 1.0 / config.rate_hz
        mount = np.asarray(device.mount, dtype=float)
        self._mount_b = mount / np.linalg.norm(mount)
        self._north_rad = np.pi / 2.0 - np.radians(device.declination_deg)
        self._acc = _IntervalMean(3, config.max_gap_s)
        self._gyro = _IntervalMean(3, config.max_gap_s)
        self._mag = empty_stream(3)
        self._pressure = empty_stream(1)
        self._altitude = empty_stream(1)
        self._next_index: int | None = None
        self._vqf = VQF(self._dt_s, tauAcc=config.level_tau_s)
        self._yaw_wrapped: float | None = None
        self._yaw_gyro = 0.0
        self._bias_yaw = 0.0
        window = max(round(config.still_window_s * config.rate_hz), 2)
        self._still_window = window
        self._still = WindowMoments(4, window)

    def feed(self, piece: SensorLog) -> LevelledSignals:
        """Take the next samples and return what became certain by them.

        Args:
            piece: samples later than all those before; any stream may be empty.

        Returns:
            Grid samples up to the last time that accelerometer and gyroscope (and, within ``max_gap_s``, the
            magnetometer) have reached.
        """
        self._acc.push(piece.acc)
        self._gyro.push(piece.gyro)
        self._mag = _append(self._mag, piece.mag)
        self._push_pressure(piece.pressure)
        return self._advance(final=False)

    def finish(self) -> LevelledSignals:
        """What was held back waiting for a magnetometer sample."""
        return self._advance(final=True)

    def _advance(self, final: bool) -> LevelledSignals:
        index = self._certain_indices(final)
        t_s: FloatArray = np.asarray(index * self._dt_s, dtype=np.float64)
        acc_b, acc_ok = self._acc.means(index, self._dt_s)
        gyro_b, gyro_ok = self._gyro.means(index, self._dt_s)
        mag_b = _interpolate(self._mag, t_s, self._config.max_gap_s)
        keep = acc_ok & gyro_ok
        if not keep.all():
            index, t_s, acc_b, gyro_b, mag_b = index[keep], t_s[keep], acc_b[keep], gyro_b[keep], mag_b[keep]
        signals = self._level(index, t_s, np.ascontiguousarray(acc_b), np.ascontiguousarray(gyro_b), mag_b)
        self._forget()
        return signals

    def _certain_indices(self, final: bool) -> IntArray:
        """Grid indices that no later sample can change."""
        if self._acc.empty or self._gyro.empty:
            return np.empty(0, dtype=np.int64)
        frontier_s = min(self._acc.last_s, self._gyro.last_s)
        if not final:
            mag_s = self._mag.t_s[-1] if len(self._mag) else -np.inf
            frontier_s = min(frontier_s, max(mag_s, frontier_s - self._config.max_gap_s))
        if self._next_index is None:
            first_s = max(self._acc.first_s, self._gyro.first_s)
            self._next_index = int(np.ceil(first_s / self._dt_s)) + 1
        # a grid point at the very frontier waits, lest rounding put it beyond the last sample
        end = int(np.floor(frontier_s / self._dt_s + (1e-6 if final else -1e-6))) + 1
        index = np.arange(self._next_index, max(end, self._next_index), dtype=np.int64)
        self._next_index = max(end, self._next_index)
        return index

    def _level(
        self, index: IntArray, t_s: FloatArray, acc_b: FloatArray, gyro_b: FloatArray, mag_b: FloatArray
    ) -> LevelledSignals:
        if len(index):
            state = self._vqf.updateBatch(gyro_b, acc_b)
            quat, bias_b = state["quat6D"], state["bias"]
        else:
            quat, bias_b = np.empty((0, 4)), np.empty((0, 3))
        body = np.empty((len(index), 3, 5))
        body[:, :, 0] = self._mount_b
        body[:, :, 1], body[:, :, 2], body[:, :, 3], body[:, :, 4] = bias_b, acc_b, gyro_b, mag_b
        world = rotate(quat, body)
        forward_n, bias_n, acc_n, gyro_n, mag_n = (world[:, :, i] for i in range(5))
        yaw_vqf = np.arctan2(forward_n[:, 1], forward_n[:, 0])
        yaw_gyro = self._unwrap(yaw_vqf) + self._bias_angle(bias_n[:, 2])
        cos, sin = np.cos(yaw_vqf), np.sin(yaw_vqf)
        acc_walk = np.empty((len(index), 3))
        acc_walk[:, 0] = cos * acc_n[:, 0] + sin * acc_n[:, 1]
        acc_walk[:, 1] = cos * acc_n[:, 1] - sin * acc_n[:, 0]
        acc_walk[:, 2] = acc_n[:, 2]
        mag_horizontal = np.hypot(mag_n[:, 0], mag_n[:, 1])
        # vqf's world is turned by an unknown angle; the field's own azimuth in it tells which way North is
        yaw_mag = wrap_angle(yaw_vqf + self._north_rad - np.arctan2(mag_n[:, 1], mag_n[:, 0]))
        acc_norm = np.sqrt((acc_b**2).sum(axis=1))
        return LevelledSignals(
            index=index,
            t_s=t_s,
            acc_norm_m_s2=acc_norm,
            acc_n_m_s2=acc_walk,
            tilt_rate_rad_s=np.hypot(gyro_n[:, 0], gyro_n[:, 1]),
            yaw_gyro_rad=yaw_gyro,
            yaw_mag_rad=yaw_mag,
            mag_norm_ut=np.sqrt((mag_b**2).sum(axis=1)),
            mag_dip_rad=np.arctan2(-mag_n[:, 2], mag_horizontal),
            altitude_m=_hold(self._altitude, t_s),
            still=self._stillness(np.concatenate((acc_norm[:, None], gyro_b), axis=1)),
        )

    def _unwrap(self, yaw_wrapped: FloatArray) -> FloatArray:
        if len(yaw_wrapped) == 0:
            return yaw_wrapped
        previous = yaw_wrapped[0] if self._yaw_wrapped is None else self._yaw_wrapped
        change = wrap_angle(yaw_wrapped - np.concatenate(([previous], yaw_wrapped[:-1])))
        yaw = np.cumsum(np.concatenate(([self._yaw_gyro], change)))[1:]
        self._yaw_wrapped, self._yaw_gyro = float(yaw_wrapped[-1]), float(yaw[-1])
        return yaw

    def _bias_angle(self, bias_up_rad_s: FloatArray) -> FloatArray:
        """The yaw that vqf took out as gyroscope bias: the estimators carry the bias as a state of their own."""
        angle = np.cumsum(np.concatenate(([self._bias_yaw], bias_up_rad_s * self._dt_s)))
        self._bias_yaw = float(angle[-1])
        return angle[1:]

    def _stillness(self, signals: FloatArray) -> BoolArray:
        _, variance, count = self._still.push(signals)
        steady = np.sqrt(variance[:, 0]) < self._config.still_acc_m_s2
        steady &= np.sqrt(variance[:, 1:].sum(axis=1)) < self._config.still_gyro_rad_s
        return np.asarray(steady & (count == self._still_window))

    def _push_pressure(self, pressure: Stream) -> None:
        """Running median of five samples, then altitude."""
        if len(pressure) == 0:
            return
        if len(self._pressure) == 0:  # so that the first samples have five to choose from
            lead = np.full(_PRESSURE_MEDIAN - 1, pressure.t_s[0])
            self._pressure = Stream(lead, np.repeat(pressure.values[:1], _PRESSURE_MEDIAN - 1, axis=0))
        window = _append(self._pressure, pressure)
        sliding = np.lib.stride_tricks.sliding_window_view(window.values[:, 0], _PRESSURE_MEDIAN)
        altitude = pressure_altitude_m(np.median(sliding, axis=1))
        self._altitude = _append(self._altitude, Stream(pressure.t_s, altitude[:, None]))
        self._pressure = _tail(window, _PRESSURE_MEDIAN - 1)

    def _forget(self) -> None:
        """Drop samples that no later grid point can need."""
        if self._next_index is None:
            return
        done_s = (self._next_index - 1) * self._dt_s
        self._acc.forget(done_s - self._dt_s)
        self._gyro.forget(done_s - self._dt_s)
        self._mag = _since(self._mag, done_s)
        self._altitude = _since(self._altitude, done_s)


class _IntervalMean:
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
        return len(self._t_s) == 0

    @property
    def first_s(self) -> float:
        return float(self._t_s[0])

    @property
    def last_s(self) -> float:
        return float(self._t_s[-1])

    def push(self, stream: Stream) -> None:
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
        area = 0.5 * (values[1:] + values[:-1]) * dt_s[:, None]
        integral = np.cumsum(np.concatenate((carry, area)), axis=0)
        if not self.empty:
            t_s, integral = t_s[1:], integral[1:]
        self._t_s = np.concatenate((self._t_s, t_s))
        self._integral = np.concatenate((self._integral, integral))
        self._gap_before = np.concatenate((self._gap_before, lead_gap, dt_s > self._max_gap_s))
        self._last = stream.values[-1:]

    def means(self, index: IntArray, dt_s: float) -> tuple[FloatArray, BoolArray]:
        """(N, D) means over the grid interval that ends at each index, and (N,) whether no gap touches it."""
        if len(index) == 0:
            return np.empty((0, self._integral.shape[1])), np.empty(0, dtype=np.bool_)
        ends = np.asarray(np.concatenate((index[:1] - 1, index)) * dt_s, dtype=np.float64)
        at_ends = _interp_columns(ends, self._t_s, self._integral)
        bracket = np.minimum(np.searchsorted(self._t_s, ends), len(self._t_s) - 1)
        in_gap = self._gap_before[bracket]
        return (at_ends[1:] - at_ends[:-1]) / dt_s, ~(in_gap[1:] | in_gap[:-1])

    def forget(self, before_s: float) -> None:
        start = max(int(np.searchsorted(self._t_s, before_s, side="right")) - 1, 0)
        self._t_s, self._integral = self._t_s[start:], self._integral[start:]
        self._gap_before = self._gap_before[start:]


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
        centred = values - self._origin
        both = np.concatenate((centred, centred**2), axis=1)
        sums = np.cumsum(np.concatenate((self._sums[-1:], both)), axis=0)[1:]
        history = np.concatenate((self._sums, sums))
        now = np.arange(len(self._sums), len(history), dtype=np.int64)
        then = np.maximum(now - self._window, 0)
        count = now - then
        moments = (sums - history[then]) / count[:, None]
        mean = moments[:, :width]
        variance = np.maximum(moments[:, width:] - mean**2, 0.0)
        self._sums = history[-self._window :]
        return mean + self._origin, variance, count


def _append(stream: Stream, more: Stream) -> Stream:
    if len(more) == 0:
        return stream
    return Stream(np.concatenate((stream.t_s, more.t_s)), np.concatenate((stream.values, more.values)))


def _tail(stream: Stream, count: int) -> Stream:
    return Stream(stream.t_s[-count:], stream.values[-count:])


def _since(stream: Stream, t_s: float) -> Stream:
    """The samples from the last one at or before t_s."""
    start = max(int(np.searchsorted(stream.t_s, t_s, side="right")) - 1, 0)
    return Stream(stream.t_s[start:], stream.values[start:])


def _interpolate(stream: Stream, t_s: FloatArray, max_gap_s: float) -> FloatArray:
    """(N, D) linear between samples, nan outside them and across gaps."""
    width = stream.values.shape[1]
    if len(stream) < 2 or len(t_s) == 0:
        return np.full((len(t_s), width), np.nan)
    after = np.searchsorted(stream.t_s, t_s)
    inside = (after > 0) & (after < len(stream))
    after = np.minimum(np.maximum(after, 1), len(stream) - 1)
    inside &= stream.t_s[after] - stream.t_s[after - 1] <= max_gap_s
    values = _interp_columns(t_s, stream.t_s, stream.values)
    values[~inside] = np.nan
    return values


def _interp_columns(at_s: FloatArray, t_s: FloatArray, values: FloatArray) -> FloatArray:
    """``np.interp`` for every column."""
    out = np.empty((len(at_s), values.shape[1]))
    for i in range(values.shape[1]):
        out[:, i] = np.interp(at_s, t_s, values[:, i])
    return out


def _hold(stream: Stream, t_s: FloatArray) -> FloatArray:
    """(N,) the latest sample at or before each time; nan before the first."""
    if len(stream) == 0:
        return np.full(len(t_s), np.nan)
    at = np.searchsorted(stream.t_s, t_s, side="right") - 1
    return np.where(at >= 0, stream.values[np.maximum(at, 0), 0], np.nan)
