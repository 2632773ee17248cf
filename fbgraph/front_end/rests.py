"""Standing still, and what it tells: the gyroscope's bias about the vertical."""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left
from dataclasses import dataclass, replace

import numpy as np

from fbgraph.core.geometry import FloatArray, wrap_angle, wrap_scalar
from fbgraph.front_end.levelled_signals import LevelledSignals, gaps

_REST_TRIM_S = 0.75
_REST_FLOOR_RAD_S = 2e-4  # no rest tells the bias better than this
_SWAY_RAD = 0.03  # a hand that holds still turns by this much
_UNSETTLED_RAD = 0.04  # the compass's error just after walking, before the tilt has settled
_REST_LIMIT_S = 60.0  # of a longer rest only the last minute tells the bias at its end
_END_S = 1.5  # over which the angle at either end of a rest is taken
_STILL_S = 60.0  # a hand that holds still wanders further the longer it does
_COMPASS_RAD = 0.04  # of a compass at rest, over an end
_FULL_TURN_RAD = 0.8  # a third of half a turn: the gyroscope still tells how often it turned
_SHUFFLED_RAD = 0.1  # where the wearer shuffled meanwhile and holds the device a little differently


@dataclass(frozen=True)
class Rest:
    """What standing still told; of several rests between two steps, all of them together.

    Attributes:
        rate_rad_s, sigma_rad_s: the gyroscope's bias about the vertical at its end, and standard deviation.
        duration_s: its length, without the ends that were left out.
        drift_rad, drift_sigma_rad: what the bias added to the gyroscope's angle meanwhile, and standard deviation.
    """

    rate_rad_s: float = math.nan
    sigma_rad_s: float = math.nan
    duration_s: float = 0.0
    drift_rad: float = 0.0
    drift_sigma_rad: float = 0.0


@dataclass(frozen=True)
class _Piece:
    """One stretch of standing still.

    Attributes:
        ended: grid index by which it was over.
        begin_s, end_s: without the ends that were left out.
        told: by itself.
        begin_rad, end_rad: gyroscope less compass at its ends, nan without compass.
        unsettled_rad: how wrong the compass still was at its begin.
    """

    ended: int
    begin_s: float
    end_s: float
    told: Rest
    begin_rad: float
    end_rad: float
    unsettled_rad: float


class Rests:
    """Standing still, and what the yaw rate then was: the gyroscope's bias about the vertical.

    A hand never holds quite still, but at one place the compass turns exactly as the hand does, whatever iron is near:
    the slope of (gyroscope - compass) over a rest is the bias, and its change from begin to end what the bias added.
    """

    def __init__(self, rate_hz: float, settle_s: float) -> None:
        """Rests on a grid of ``rate_hz``; after walking the tilt settles with the time constant ``settle_s``."""
        self._rate_hz = rate_hz
        self._settle_s = settle_s
        self._moved = False
        self._limit = int(_REST_LIMIT_S * rate_hz)
        self._begin_limit = int((2 * settle_s + _END_S) * rate_hz)
        self._begin = self._last = np.empty((0, 3))  # time, yaw by gyroscope, yaw by compass: of its begin and end
        self._done: list[_Piece] = []
        self._jumps_s: list[float] = []  # when the magnetometer's zero jumped
        self._last_index: int | None = None
        self._breaks: list[int] = []  # the last grid index before every gap of the log

    def push(self, signals: LevelledSignals) -> None:
        """Take the next signals."""
        if len(signals) == 0:
            return
        index = signals.index if self._last_index is None else np.concatenate(([self._last_index], signals.index))
        new = len(index) - len(signals)
        holes = gaps(index)
        self._breaks += [int(index[hole - 1]) for hole in holes]
        if signals.field_jump_ut.any():
            self._jumps_s += signals.t_s[signals.field_jump_ut.any(axis=1)].tolist()
        self._last_index = int(signals.index[-1])
        # where a rest goes on after a gap, nobody knows what went on in it
        after_holes = {hole - new for hole in holes}
        turns = (np.flatnonzero(signals.still[1:] != signals.still[:-1]) + 1).tolist()
        edges = sorted({0, *turns, *(h for h in after_holes if h > 0), len(signals)})
        for lo, hi in itertools.pairwise(edges):
            if lo in after_holes:
                self._close(int(signals.index[lo]))
            if signals.still[lo]:
                self._keep(signals, lo, hi)
            else:
                self._close(int(signals.index[lo]))
                # (at the log's start it takes a while until the window can tell)
                self._moved |= bool(signals.index[hi - 1] > 2 * self._rate_hz)

    def _keep(self, signals: LevelledSignals, lo: int, hi: int) -> None:
        rows = np.column_stack((signals.t_s[lo:hi], signals.yaw_gyro_rad[lo:hi], signals.yaw_mag_rad[lo:hi]))
        self._begin = np.concatenate((self._begin, rows[: max(self._begin_limit - len(self._begin), 0)]))
        self._last = np.concatenate((self._last, rows))[-self._limit :]

    def _close(self, index: int) -> None:
        begin, last = self._begin, self._last
        if len(last) == 0:
            return
        self._begin = self._last = np.empty((0, 3))
        moved, self._moved = self._moved, True
        # the window calls a rest over only after the first movement; and after walking the tilt, and with it the
        # compass, takes a while to settle: leave both out
        duration_s = float(last[-1, 0] - begin[0, 0])
        settling_s = min(2 * self._settle_s, 0.4 * duration_s) if moved else 0.0
        unsettled_rad = _UNSETTLED_RAD * math.exp(-settling_s / self._settle_s) if moved else 0.0
        since_s, until_s = begin[0, 0] + settling_s, last[-1, 0] - _REST_TRIM_S
        if until_s - since_s < 1.0:
            return
        if self._jumped(float(begin[0, 0]), float(last[-1, 0])):  # then it is no turn that the compass shows
            begin[:, 2] = last[:, 2] = np.nan
        begin, last = (rows[(rows[:, 0] >= since_s) & (rows[:, 0] <= until_s)] for rows in (begin, last))
        rate, sigma = _slope_of(last[:, 0], last[:, 1], _SWAY_RAD)
        if np.isfinite(last[:, 2]).all():
            wander_rad = math.hypot(unsettled_rad, _COMPASS_RAD)
            relative, sigma_relative = _slope_of(last[:, 0], np.unwrap(last[:, 1] - last[:, 2]), wander_rad)
            weight = sigma**2 / (sigma**2 + sigma_relative**2)
            rate, sigma = rate + weight * (relative - rate), sigma * sigma_relative / math.hypot(sigma, sigma_relative)
        begin_s, end_s = float(begin[0, 0]), float(last[-1, 0])
        told = Rest(rate, sigma, end_s - begin_s, *_drift(begin, last, unsettled_rad))
        ends = _relative(begin[begin[:, 0] <= begin_s + _END_S]), _relative(last[last[:, 0] >= end_s - _END_S])
        self._done.append(_Piece(index, begin_s, end_s, told, *ends, unsettled_rad))

    def take(self, before_index: int) -> Rest:
        """The rests that ended before this index and were not taken yet, as one."""
        ended = [piece for piece in self._done if piece.ended <= before_index]
        self._done = [piece for piece in self._done if piece.ended > before_index]
        if not ended:
            return Rest()
        weights = np.array([1.0 / piece.told.sigma_rad_s**2 for piece in ended])
        rate = float(weights @ np.array([piece.told.rate_rad_s for piece in ended]) / weights.sum())
        # what is wrong with one of them, a hand that sways or iron nearby, is wrong with the others too
        sigma = math.sqrt(len(ended) / float(weights.sum()))
        rest_s, drift, drift_sigma = (
            sum(getattr(piece.told, name) for piece in ended) for name in ("duration_s", "drift_rad", "drift_sigma_rad")
        )
        each = Rest(rate, sigma, rest_s, drift, drift_sigma)
        jumped = self._jumped(ended[0].begin_s, ended[-1].end_s)
        self._jumps_s = [t_s for t_s in self._jumps_s if t_s > ended[-1].end_s]
        return each if jumped else _across(ended, each)

    def _jumped(self, since_s: float, until_s: float) -> bool:
        """Whether the magnetometer was calibrated anew, or a magnet came to stay, meanwhile."""
        return any(since_s <= t_s <= until_s for t_s in self._jumps_s)

    def unbroken_between(self, first: int, last: int) -> bool:
        """Whether the log has no gap between two grid indices."""
        at = bisect_left(self._breaks, first)  # a link that stutters for two days breaks a log 100,000 times
        return at == len(self._breaks) or self._breaks[at] >= last


def _across(pieces: list[_Piece], each: Rest) -> Rest:
    """A pause of several rests: by each of them, or by the compass at its ends alone, whichever tells more.

    Between two rests of one pause the wearer shuffles and handles the device, but stays at one place, where the
    compass knows the turn of the whole pause; the gyroscope's angle meanwhile is as wrong as its bias times the time.
    """
    first, last = pieces[0], pieces[-1]
    span_s = last.end_s - first.begin_s
    moving_s = span_s - each.duration_s
    expected = each.drift_rad + each.rate_rad_s * moving_s
    sigma = math.hypot(first.unsettled_rad, _COMPASS_RAD, _SHUFFLED_RAD)
    offset = last.end_rad - first.begin_rad
    expected_sigma = math.hypot(each.drift_sigma_rad, each.sigma_rad_s * moving_s)
    if not math.isfinite(offset) or expected_sigma < sigma:
        return each
    drift = expected + wrap_scalar(offset - expected)
    if expected_sigma > _FULL_TURN_RAD:  # by how many full turns the gyroscope is wrong, nobody knows
        return replace(each, duration_s=span_s, drift_rad=drift, drift_sigma_rad=sigma)
    return Rest(drift / span_s, math.hypot(sigma / span_s, _REST_FLOOR_RAD_S), span_s, drift, sigma)


def _relative(rows: FloatArray) -> float:
    """Mean of gyroscope less compass over some samples."""
    off = rows[:, 1] - rows[:, 2]
    return float(rows[0, 1] - rows[0, 2] + np.asarray(wrap_angle(off - off[0])).mean())


def _drift(begin: FloatArray, last: FloatArray, unsettled_rad: float) -> tuple[float, float]:
    """What the bias added to the gyroscope's angle over a rest, and its standard deviation.

    By the hand, which holds still; and by the compass, which turns as the hand does.

    Args:
        begin, last: (N, 3) time, yaw by gyroscope, yaw by compass, of the first and the last part of the rest.
        unsettled_rad: how wrong the compass still was at its begin.
    """
    first, final = begin[begin[:, 0] <= begin[0, 0] + _END_S], last[last[:, 0] >= last[-1, 0] - _END_S]
    span_s = float(last[-1, 0] - begin[0, 0])
    # both ends are means over a second or two, taken at their middles: what lies outside counts at the same rate
    between_s = float(final[:, 0].mean() - first[:, 0].mean())
    stretch = span_s / max(between_s, 0.5 * span_s)
    by_gyro = float(final[:, 1].mean() - first[:, 1].mean())
    still_sigma = _SWAY_RAD * math.sqrt(1.0 + span_s / _STILL_S)
    turns = np.concatenate((first[:, 2], final[:, 2]))
    if not np.isfinite(turns).all():
        return by_gyro * stretch, still_sigma
    ends = [math.atan2(float(np.sin(part[:, 2]).mean()), float(np.cos(part[:, 2]).mean())) for part in (first, final)]
    turned = wrap_scalar(ends[1] - ends[0])
    compass_sigma = math.hypot(unsettled_rad, _COMPASS_RAD)
    weight = still_sigma**2 / (still_sigma**2 + compass_sigma**2)
    sigma = max(math.sqrt(weight) * compass_sigma, (1.0 - weight) * abs(turned))
    return (by_gyro - weight * turned) * stretch, sigma


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
