"""Whether the last metres of a walk pass the metres before them once more, the other way round, and how sure that is.

The walk is laid beside itself, backwards, by local alignment (Smith and Waterman 1981,
doi 10.1016/0022-2836(81)90087-5), one row at a time: every place passed lately has a score, which grows as long as the
walk comes by there against its earlier direction. The best alignment is then weighed as one of three hypotheses: that
this is the way back, that the walk goes on anywhere, and that it goes on along another lane beside the first, as in a
search pattern, where everything but the distance between the lanes and the magnetic field is as on a way back.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fbgraph.core.geometry import FloatArray, IntArray, wrap_angle, wrap_scalar

GRID_M = 0.5
"""Distance between rows."""

_WINDOW = 200  # rows back, at most: enough for a way back of 45 m, which is known long before
_TURN = 18  # rows in which one may turn
_ABOUT_RAD = 1.0  # facing back, when it begins
_ROW = 1.2  # what a row of a way back adds to its score, less what does not fit
_SLIP = 0.5  # what it costs that one of both ways is a row longer there
_NEAR_M, _FACING_RAD, _ALIKE = 8.5, 0.45, 0.5  # what fits: distance, direction, share of the field's own scatter
_FIELD_ROWS, _FIELD_LEAST_UT = 80, 1.5

# Hypotheses. The way back: on the line of the way out, or on the other side of a corridor; another lane: a metre away
# or more, and not much more as a rule; anywhere: within six metres to either side, facing anything.
_LINE_M, _CORRIDOR_M, _LANE_M, _LANES_M, _ASIDE_M = 0.4, 2.2, 1.0, 3.0, 12.0
_ALONG_M = 2.0  # the way back against the way out, by steps that differ and some made on the spot
_RECKONED_M, _RECKONED_REL = 0.4, 0.02  # dead reckoning over the turn, and on
_OFF_RAD, _OFF_EACH_M, _OFF_MOST_M, _OFF_RANGE_RAD = 0.2, 3.0, 16.0, 2.1
_CHANGED, _NOISE_UT = 0.7, 0.7  # share of the field's own scatter, from one side of a corridor to the other; sensor
_APART_LENGTHS = 3.0  # samples of the field tell something new after so many of its lengths
_LENGTH_M = 0.7, 2.5
_AGAINST = -1.5  # whatever the field says in one such sample: iron is carried past, too
_OFFSET_UT, _OFFSET_REL, _OFFSET_AGAINST = 1.0, 0.4, -2.0
# log: who turns about returns more often than combs the place; less is believed where no field may object
_LANE_ODDS = 0.8, 1.6
_FEW = 8


class Row(NamedTuple):
    """A place of the walk: metres, radians, and the magnetic field down, along and across magnetic North, µT or nan."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    down_ut: float
    level_ut: float
    across_ut: float


@dataclass(frozen=True)
class Aligned:
    """The best alignment so far.

    Attributes:
        score: how well it fits.
        back: (R,) rows after the turn, one after the other.
        out: (R,) the rows before it that they pass again.
    """

    score: float
    back: IntArray
    out: IntArray

    @property
    def turn(self) -> float:
        """Where between rows the turn was: in the middle of what lies between both ways."""
        return 0.5 * float(self.back[0] + self.out[0])


class Retracing:
    """Rows in; how the walk retraces itself; causal, and at the same cost however long the walk."""

    def __init__(self) -> None:
        self._rows = np.empty((len(Row._fields), 256))
        self._count = 0
        self._scores: FloatArray = np.empty(0)  # of the newest rows before the last
        # of these rows: the first of the window, and how each score came about
        self._came: deque[tuple[int, IntArray]] = deque(maxlen=2 * _WINDOW)
        self._best = (-math.inf, -1)

    def advance(self, row: Row) -> float:
        """Take the next row, ``GRID_M`` further on; the score of the best alignment that ends there, -inf if none."""
        if self._count == self._rows.shape[1]:
            self._rows = np.concatenate((self._rows, np.empty_like(self._rows)), axis=1)
        self._rows[:, self._count] = row
        self._count += 1
        first = max(self._count - 1 - _WINDOW, 0)
        yaw = self._rows[3, first : self._count]
        if len(self._scores) == 0 and np.cos(row.yaw_rad - yaw[-_TURN:]).min() > -math.cos(_ABOUT_RAD):
            return -math.inf  # nobody has turned about
        n = len(yaw)
        off = np.abs(wrap_angle(row.yaw_rad - yaw - math.pi))
        before = np.full(n + 2, -math.inf)
        if len(self._scores):
            before[: n - 1] = self._scores[-(n - 1) :]
        ways = np.full((4, n), -math.inf)
        ways[0], ways[1], ways[2] = before[:n] - _SLIP, before[1 : n + 1], before[2:] - _SLIP
        ways[3, -_TURN - 1 :] = np.where(off[-_TURN - 1 :] < _ABOUT_RAD, 0.0, -math.inf)
        came = ways.argmax(axis=0)
        scores = ways[came, np.arange(n)] + _ROW - self._misfit(row, first, off)
        scores[scores <= 0.0] = -math.inf
        best = int(scores.argmax())
        if scores[best] == -math.inf:
            self._scores, self._best = np.empty(0), (-math.inf, -1)
            self._came.clear()
        else:
            self._scores, self._best = scores, (float(scores[best]), first + best)
            self._came.append((first, came))
        return self._best[0]

    def _misfit(self, row: Row, first: int, off: FloatArray) -> FloatArray:
        """What speaks against passing each row of the window again."""
        x, y, down = (self._rows[i, first : self._count] for i in (0, 1, 4))
        misfit = ((row.x_m - x) ** 2 + (row.y_m - y) ** 2) / _NEAR_M**2
        misfit += 0.25 * np.minimum((off / _FACING_RAD) ** 2, 9.0)
        if math.isfinite(row.down_ut):
            lately_ut = down[-_FIELD_ROWS:]
            scatter_ut = max(float(lately_ut[np.isfinite(lately_ut)].std()), _FIELD_LEAST_UT)
            unlike = np.minimum(((row.down_ut - down) / (_ALIKE * scatter_ut)) ** 2, 9.0)
            misfit += np.nan_to_num(unlike) / 15.0
        return np.asarray(misfit)

    def aligned(self) -> Aligned:
        """The best alignment that ends at the last row.

        Raises:
            ValueError: there is none.
        """
        score, out = self._best
        if out < 0:
            raise ValueError("no alignment ends here")
        back, path = self._count - 1, []
        for first, came in reversed(self._came):
            path.append((back, out))
            way = int(came[out - first])
            if way == 3:
                break
            back, out = back - 1, out + way
        rows = np.array(path[::-1])
        return Aligned(score, rows[:, 0], rows[:, 1])

    def log_odds(self, aligned: Aligned) -> float:
        """How much more likely than walking on, anywhere or along another lane, an alignment makes the way back."""
        back, out = self._rows[:, aligned.back], self._rows[:, aligned.out]
        length_m = GRID_M * len(aligned.back)
        dx, dy, yaw = back[0] - out[0], back[1] - out[1], out[3]
        across_m = abs(float((np.cos(yaw) * dy - np.sin(yaw) * dx).mean()))
        off = wrap_angle(back[3] - yaw - math.pi)
        returns, lanes = _beside(across_m, length_m)
        known = np.isfinite(back[4:] + out[4:]).all(axis=0)
        field, odds = 0.0, _LANE_ODDS[0]
        if known.sum() >= _FEW:
            field = _field_odds(back[4:, known], out[4:, known], length_m)
            field += self._offset_odds(float((back[4] - out[4])[known].mean()))
            odds = _LANE_ODDS[1]
        facing = math.log(_OFF_RANGE_RAD * _normal(0.0, _OFF_RAD)) - 0.5 * float((off**2).mean()) / _OFF_RAD**2
        anywhere = facing * min(length_m, _OFF_MOST_M) / _OFF_EACH_M + math.log(_ASIDE_M * returns) + field
        along = math.log(returns / lanes) + field + odds
        slid = -0.5 * float(np.abs(np.cos(yaw) * dx + np.sin(yaw) * dy).mean() / _ALONG_M) ** 2
        return slid - float(np.logaddexp(-anywhere, -along))

    def climbed_m(self, aligned: Aligned) -> float:
        """How far apart in height both ways are where the alignment ends."""
        return float(np.abs(self._rows[2, aligned.back] - self._rows[2, aligned.out])[-6:].mean())

    def _offset_odds(self, offset_ut: float) -> float:
        """Of the vertical field's mean on both ways, to which the device adds the same, other places another."""
        down_ut = self._rows[4, max(self._count - _WINDOW, 0) : self._count]
        scatter_ut = float(down_ut[np.isfinite(down_ut)].std())
        same, other = (math.hypot(_OFFSET_UT, share * scatter_ut) for share in (_OFFSET_REL, math.sqrt(2.0)))
        return max(math.log(other / same) - 0.5 * offset_ut**2 * (same**-2 - other**-2), _OFFSET_AGAINST)


def _normal(value: float, sigma: float) -> float:
    return math.exp(-0.5 * (value / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))


def _beside(across_m: float, length_m: float) -> tuple[float, float]:
    """Densities of how far beside the way out one walks: on the way back, and along another lane."""
    sigma_m = math.hypot(_RECKONED_M, _RECKONED_REL * length_m)
    line, corridor = (_normal(across_m, math.hypot(each_m, sigma_m)) for each_m in (_LINE_M, _CORRIDOR_M))
    # lanes beyond the nearest become fewer exponentially; dead reckoning blurs that
    beyond = _LANE_M + sigma_m**2 / _LANES_M - across_m
    lanes = math.exp((beyond - 0.5 * sigma_m**2 / _LANES_M) / _LANES_M) * math.erfc(beyond / (math.sqrt(2) * sigma_m))
    return 0.5 * (line + corridor), max(0.25 * lanes / _LANES_M, 1e-5)


def _field_odds(back_ut: FloatArray, out_ut: FloatArray, length_m: float) -> float:
    """Of the (3, R) magnetic field along both ways, but for a constant: what the device itself adds."""
    both_ut = np.stack((back_ut, out_ut))
    own = 0.5 * both_ut.var(axis=2).sum(axis=0)
    steep = 0.5 * (np.diff(both_ut) ** 2).mean(axis=2).sum(axis=0) / GRID_M**2
    every_m = _APART_LENGTHS * np.clip(np.sqrt(own / np.maximum(steep, 1e-9)), *_LENGTH_M)
    same, other = _CHANGED**2 * own + _NOISE_UT**2, 2.0 * own + _NOISE_UT**2
    each = 0.5 * np.log(other / same) - 0.5 * (back_ut - out_ut).var(axis=1) * (1.0 / same - 1.0 / other)
    return float((np.maximum(each, _AGAINST) / every_m).sum()) * length_m


def between(before: Row, after: Row, share: float) -> Row:
    """The row so far on the way from one to the next; the field is nan where either does not know it."""
    turned = wrap_scalar(after.yaw_rad - before.yaw_rad)
    mixed = [a + share * (b - a) for a, b in zip(before, after, strict=True)]
    return Row(*mixed)._replace(yaw_rad=before.yaw_rad + share * turned)
