"""Standing still, and what it tells: the gyroscope's bias about the vertical."""

from __future__ import annotations

import math

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.levelled_signals import LevelledSignals

_REST_TRIM_S = 0.75
_REST_FLOOR_RAD_S = 2e-4  # no rest tells the bias better than this
_SWAY_RAD = 0.03  # a hand that holds still turns by this much
_UNSETTLED_RAD = 0.04  # the compass's error just after walking, before the tilt has settled
_REST_LIMIT_S = 60.0  # of a longer rest only the last minute is kept


class Rests:
    """Standing still, and what the yaw rate then was: the gyroscope's bias about the vertical.

    A hand never holds quite still, but at one place the compass turns exactly as the hand does, whatever iron is near:
    the slope of (gyroscope - compass) over a rest is the bias.
    """

    def __init__(self, rate_hz: float, settle_s: float) -> None:
        """Rests on a grid of ``rate_hz``; after walking the tilt settles with the time constant ``settle_s``."""
        self._rate_hz = rate_hz
        self._settle_s = settle_s
        self._moved = False
        self._limit = int(_REST_LIMIT_S * rate_hz)
        self._t_s = self._yaw_gyro = self._yaw_mag = np.empty(0)
        self._done: list[tuple[int, float, float, float]] = []  # end index, rate, sigma, duration
        self._last_index: int | None = None
        self._breaks: list[int] = []  # the last grid index before every gap of the log

    def push(self, signals: LevelledSignals) -> None:
        """Take the next signals."""
        if len(signals) == 0:
            return
        index = signals.index if self._last_index is None else np.concatenate(([self._last_index], signals.index))
        new = len(index) - len(signals)
        holes = np.flatnonzero(index[1:] - index[:-1] > 1)
        self._breaks += index[holes].tolist()
        self._last_index = int(signals.index[-1])
        after_holes = set(
            (holes + 1 - new).tolist()
        )  # where a rest goes on after a gap, nobody knows what went on in it
        edges = np.union1d(
            np.flatnonzero(signals.still[1:] != signals.still[:-1]) + 1, [h for h in after_holes if h > 0]
        )
        edges = edges.astype(int)
        for lo, hi in zip(np.concatenate(([0], edges)), np.concatenate((edges, [len(signals)])), strict=True):
            if lo in after_holes:
                self._close(int(signals.index[lo]))
            if signals.still[lo]:
                self._t_s = np.concatenate((self._t_s, signals.t_s[lo:hi]))[-self._limit :]
                self._yaw_gyro = np.concatenate((self._yaw_gyro, signals.yaw_gyro_rad[lo:hi]))[-self._limit :]
                self._yaw_mag = np.concatenate((self._yaw_mag, signals.yaw_mag_rad[lo:hi]))[-self._limit :]
            else:
                self._close(int(signals.index[lo]))
                # (at the log's start it takes a while until the window can tell)
                self._moved |= bool(signals.index[hi - 1] > 2 * self._rate_hz)

    def _close(self, index: int) -> None:
        if len(self._t_s) == 0:
            return
        # the window calls a rest over only after the first movement; and after walking the tilt, and with it the
        # compass, takes a while to settle: leave both out
        begin = min(2 * self._settle_s, 0.4 * len(self._t_s) / self._rate_hz) if self._moved else 0.0
        unsettled_rad = _UNSETTLED_RAD * math.exp(-begin / self._settle_s) if self._moved else 0.0
        lo, hi = int(begin * self._rate_hz), len(self._t_s) - int(_REST_TRIM_S * self._rate_hz)
        t_s, yaw_gyro, yaw_mag = self._t_s[lo:hi], self._yaw_gyro[lo:hi], self._yaw_mag[lo:hi]
        self._moved = True
        self._t_s = self._yaw_gyro = self._yaw_mag = np.empty(0)
        if hi - lo < self._rate_hz:
            return
        rate, sigma = _slope_of(t_s, yaw_gyro, _SWAY_RAD)
        if np.isfinite(yaw_mag).all():
            relative, sigma_relative = _slope_of(t_s, np.unwrap(yaw_gyro - yaw_mag), unsettled_rad)
            weight = sigma**2 / (sigma**2 + sigma_relative**2)
            rate, sigma = rate + weight * (relative - rate), sigma * sigma_relative / math.hypot(sigma, sigma_relative)
        self._done.append((index, rate, sigma, float(t_s[-1] - t_s[0])))

    def take(self, before_index: int) -> tuple[float, float, float]:
        """Rate, sigma, duration of the rests that ended before this index and were not taken yet."""
        ended = [rest for rest in self._done if rest[0] <= before_index]
        self._done = [rest for rest in self._done if rest[0] > before_index]
        if not ended:
            return float("nan"), float("nan"), 0.0
        weights = np.array([1.0 / rest[2] ** 2 for rest in ended])
        rates = np.array([rest[1] for rest in ended])
        total = float(weights.sum())
        return float((weights * rates).sum() / total), total**-0.5, sum(rest[3] for rest in ended)

    def unbroken_between(self, first: int, last: int) -> bool:
        """Whether the log has no gap between two grid indices."""
        return not any(first <= before < last for before in self._breaks)


def _slope_of(t_s: FloatArray, angle_rad: FloatArray, systematic_rad: float) -> tuple[float, float]:
    """Least-squares slope of an angle over a rest, rad/s, and its standard deviation.

    Samples a second apart count as independent; ``systematic_rad`` is how far the angle itself may move meanwhile.
    """
    centred = t_s - t_s.mean()
    rate = float((centred * angle_rad).sum() / (centred**2).sum())
    scatter = float(np.std(angle_rad - angle_rad.mean() - rate * centred))
    duration_s = float(t_s[-1] - t_s[0])
    random = math.sqrt(12.0 / max(duration_s, 1.0)) * scatter / duration_s
    return rate, math.hypot(random, systematic_rad / duration_s) + _REST_FLOOR_RAD_S
