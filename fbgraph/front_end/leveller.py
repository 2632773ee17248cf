"""From raw streams to levelled signals on one clock: yaw, compass, altitude, stillness.

``Leveller`` is causal and chunk-invariant: fed a log whole or in pieces of any size, cut at any time, it returns the
same samples. Everything in it is therefore either element-wise or strictly sequential (running sums with a carry).
"""

from __future__ import annotations

import math

import numpy as np
from vqf import VQF

from fbgraph.core.atmosphere import pressure_altitude_m
from fbgraph.core.config import AttitudeConfig, DeviceConfig
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray, rotate, wrap_angle
from fbgraph.core.sensor_log import SensorLog, Stream, empty_stream
from fbgraph.front_end.field_jumps import FieldJumps
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.running_sums import IntervalMean, WindowMoments, interp_columns

_LONG_SILENCE_S = 60.0  # of a shorter one every grid point is looked at
_PRESSURE_MEDIAN = 5  # samples; rejects single outliers of slow barometers
_FROZEN_SAMPLES, _FROZEN_S = 40, 8.0  # a barometer that repeats itself to the last digit for longer has stopped
_YES = np.array([True])
_STALE_S = 10.0  # nor does a reading hold for longer


class Leveller:
    """Streams in, levelled signals out; see the module's text for what it promises."""

    def __init__(self, device: DeviceConfig, config: AttitudeConfig) -> None:
        self._config = config
        self._dt_s = 1.0 / config.rate_hz
        mount = np.asarray(device.mount, dtype=float)
        self._mount_b = mount / np.linalg.norm(mount)
        self._iron_b = np.asarray(device.iron_ut, dtype=float)
        self._gyro_gain = 1.0 - device.gyro_scale
        self._north_rad = np.pi / 2.0 - np.radians(device.declination_deg or 0.0)
        self._acc = IntervalMean(3, config.max_gap_s)
        self._gyro = IntervalMean(3, config.max_gap_s)
        self._mag = empty_stream(3)
        self._pressure = empty_stream(1)
        self._altitude = empty_stream(1)
        self._repeated = (np.nan, np.nan, 0)  # the latest pressure, since when it has been the same, how often
        self._next_index: int | None = None
        self._vqf = VQF(self._dt_s, tauAcc=config.level_tau_s)
        self._yaw_wrapped: float | None = None
        self._yaw_gyro = 0.0
        self._bias_yaw = 0.0
        window = max(round(config.still_window_s * config.rate_hz), 2)
        self._still_window = window
        self._still = WindowMoments(4, window)
        self._jumps = FieldJumps()
        self._levelled_s = -np.inf

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
        pieces = [self._means(index) for index in self._certain_indices(final)]
        index, acc_b, gyro_b, mag_b = (
            parts[0] if len(parts) == 1 else np.concatenate(parts) for parts in zip(*pieces, strict=True)
        )
        t_s = np.asarray(index * self._dt_s, dtype=np.float64)
        signals = self._level(index, t_s, acc_b, gyro_b, mag_b)
        self._forget()
        return signals

    def _means(self, index: IntArray) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Grid points of a run of consecutive indices at which no sensor was silent, and what it measured there."""
        t_s: FloatArray = np.asarray(index * self._dt_s, dtype=np.float64)
        acc_b, acc_ok = self._acc.means(index, self._dt_s)
        gyro_b, gyro_ok = self._gyro.means(index, self._dt_s)
        mag_b = _interpolate(self._mag, t_s, self._config.max_gap_s) - self._iron_b
        gyro_b *= self._gyro_gain
        keep = acc_ok & gyro_ok
        if keep.all():
            return index, acc_b, gyro_b, mag_b
        return index[keep], acc_b[keep], gyro_b[keep], mag_b[keep]

    def _certain_indices(self, final: bool) -> list[IntArray]:
        """Grid indices that no later sample can change, in runs; those inside long silences are left out."""
        if self._acc.empty or self._gyro.empty:
            return [np.empty(0, dtype=np.int64)]
        frontier_s = min(self._acc.last_s, self._gyro.last_s)
        if not final:
            mag_s = self._mag.t_s[-1] if len(self._mag) else -np.inf
            frontier_s = min(frontier_s, max(mag_s, frontier_s - self._config.max_gap_s))
        if self._next_index is None:
            first_s = max(self._acc.first_s, self._gyro.first_s)
            self._next_index = int(np.ceil(first_s / self._dt_s)) + 1
        # a grid point at the very frontier waits, lest rounding put it beyond the last sample
        end = int(np.floor(frontier_s / self._dt_s + (1e-6 if final else -1e-6))) + 1
        begin, self._next_index = self._next_index, max(end, self._next_index)
        runs = []
        for before_s, after_s in self._acc.silences(_LONG_SILENCE_S):
            # a few points on either side are left to ``means``, which knows exactly where the silence is
            last, first = int(before_s / self._dt_s) + 2, int(after_s / self._dt_s) - 2
            if begin < last and first < self._next_index:
                runs.append(np.arange(begin, last, dtype=np.int64))
                begin = first
        return [*runs, np.arange(begin, self._next_index, dtype=np.int64)]

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
        motion = np.empty((len(index), 4))  # strength of the acceleration, turning
        motion[:, 0], motion[:, 1:] = np.sqrt((acc_b**2).sum(axis=1)), gyro_b
        return LevelledSignals(
            index=index,
            t_s=t_s,
            acc_norm_m_s2=motion[:, 0],
            acc_n_m_s2=acc_walk,
            mount_up_rad=np.arctan2(forward_n[:, 2], np.hypot(forward_n[:, 0], forward_n[:, 1])),
            tilt_rate_rad_s=np.hypot(gyro_n[:, 0], gyro_n[:, 1]),
            yaw_gyro_rad=yaw_gyro,
            yaw_mag_rad=yaw_mag,
            mag_norm_ut=np.sqrt((mag_b**2).sum(axis=1)),
            mag_dip_rad=np.arctan2(-mag_n[:, 2], mag_horizontal),
            altitude_m=_hold(self._altitude, t_s),
            field_jump_ut=self._field_jumps(t_s, mag_n, yaw_vqf),
            still=self._stillness(motion),
        )

    def _field_jumps(self, t_s: FloatArray, mag_n: FloatArray, yaw_rad: FloatArray) -> FloatArray:
        """(N, 2) jumps of the magnetometer's zero where they became certain, in the frame of ``compass``."""
        jumps = np.zeros((len(t_s), 2))
        if len(t_s) == 0:
            return jumps
        # looked for at the magnetometer's samples, not between them
        lo, hi = self._mag.t_s.searchsorted((self._levelled_s, t_s[-1]), side="right")
        sampled = self._mag.t_s[lo:hi]
        self._levelled_s = float(t_s[-1])
        at = t_s.searchsorted(sampled)
        if len(at) > 1:
            at = at[np.concatenate((_YES, at[1:] != at[:-1]))]
        at = at[np.isfinite(mag_n[at, 0])]
        cos, sin = math.cos(self._north_rad), math.sin(self._north_rad)
        for known_s, ahead, left in self._jumps.push(t_s[at], mag_n[at], yaw_rad[at]):
            jumps[np.searchsorted(t_s, known_s)] = (cos * ahead + sin * left, cos * left - sin * ahead)
        return jumps

    def _unwrap(self, yaw_wrapped: FloatArray) -> FloatArray:
        if len(yaw_wrapped) == 0:
            return yaw_wrapped
        change = np.empty(len(yaw_wrapped))
        change[0] = yaw_wrapped[0] - (yaw_wrapped[0] if self._yaw_wrapped is None else self._yaw_wrapped)
        np.subtract(yaw_wrapped[1:], yaw_wrapped[:-1], out=change[1:])
        yaw = _summed(self._yaw_gyro, wrap_angle(change))
        self._yaw_wrapped, self._yaw_gyro = float(yaw_wrapped[-1]), float(yaw[-1])
        return yaw

    def _bias_angle(self, bias_up_rad_s: FloatArray) -> FloatArray:
        """The yaw that vqf took out as gyroscope bias: the estimators carry the bias as a state of their own."""
        angle = _summed(self._bias_yaw, bias_up_rad_s * self._dt_s)
        self._bias_yaw = float(angle[-1]) if len(angle) else self._bias_yaw
        return angle

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
        sliding = window.values[np.arange(len(pressure))[:, None] + np.arange(_PRESSURE_MEDIAN), 0]
        # (np.median takes a tenth of a millisecond more, at every piece of a live log)
        altitude = pressure_altitude_m(np.sort(sliding, axis=1)[:, _PRESSURE_MEDIAN // 2])
        altitude[self._frozen(pressure)] = np.nan
        self._altitude = _append(self._altitude, Stream(pressure.t_s, altitude[:, None]))
        self._pressure = _tail(window, _PRESSURE_MEDIAN - 1)

    def _frozen(self, pressure: Stream) -> BoolArray:
        """(N,) whether each sample has been the same for too long to be a measurement."""
        values, t_s = pressure.values[:, 0], pressure.t_s
        last, since_s, count = self._repeated
        changed = values != np.concatenate(([last], values[:-1]))  # also at the very first, whose predecessor is nan
        if changed.all():
            self._repeated = float(values[-1]), float(t_s[-1]), 1
            return np.zeros(len(values), dtype=np.bool_)
        at = np.arange(len(values))
        begin = np.maximum.accumulate(np.where(changed, at, -1))
        repeats = np.where(begin < 0, count + at + 1, at - begin + 1)
        since = np.where(begin < 0, since_s, t_s[np.maximum(begin, 0)])
        self._repeated = float(values[-1]), float(since[-1]), int(repeats[-1])
        return np.asarray((repeats > _FROZEN_SAMPLES) & (t_s - since > _FROZEN_S))

    def _forget(self) -> None:
        """Drop samples that no later grid point can need."""
        if self._next_index is None:
            return
        done_s = (self._next_index - 1) * self._dt_s
        self._acc.forget(done_s - self._dt_s)
        self._gyro.forget(done_s - self._dt_s)
        self._mag = _since(self._mag, done_s)
        self._altitude = _since(self._altitude, done_s)


def _summed(start: float, values: FloatArray) -> FloatArray:
    """(N,) running sum that goes on from ``start``."""
    sums = np.empty(len(values) + 1)
    sums[0], sums[1:] = start, values
    return np.asarray(np.add.accumulate(sums)[1:])


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
    values = interp_columns(t_s, stream.t_s, stream.values)
    if not inside.all():
        values[~inside] = np.nan
    return values


def _hold(stream: Stream, t_s: FloatArray) -> FloatArray:
    """(N,) the latest sample at or before each time; nan before the first, and where it is too old."""
    if len(stream) == 0:
        return np.full(len(t_s), np.nan)
    at = stream.t_s.searchsorted(t_s, side="right") - 1
    held = np.maximum(at, 0)
    return np.where((at >= 0) & (t_s - stream.t_s[held] < _STALE_S), stream.values[held, 0], np.nan)
