"""Whether anchors fit the walk: how their frame is turned, which of them contradict it, and what would explain that.

Places of anchors are compared with those of the walk without them, whose errors grow with the distance walked and are
alike for neighbouring steps. The frame's place and turn are free; an anchor agrees if it lies within five standard
deviations of where the sensors and the anchors that agree put it. The largest such company is looked for from pairs
(Fischler and Bolles 1981), for a frame as told and for one that is mirrored or in other units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from fbgraph.core.geometry import BoolArray, FloatArray, IntArray, turned, wrap_scalar
from fbgraph.core.trajectory import Trajectory

_CONTRADICTS = 25.0  # squared standard deviations
_SCALE, _SCALE_HERE, _SCALE_M = 0.06, 0.05, 10.0  # of a walk's length; of a stretch; over which it stays the same
_TURN_HERE, _TURN_M = 0.08, 30.0  # of its direction besides what the walk knows; over which that stays the same
_PRESS_S = 0.7  # people press buttons early and late
_PIECES = 240
_MOST, _MOST_PAIRS = 40, 40
_SHORT_M = 3.0  # places nearer to each other tell no direction
_TURNED_RAD, _TURNED_MOST = 0.2, 9.0  # a frame is usually that of the compass, but may be any
_ODD = 15.0  # by how much another kind of frame must be better
_FREE = np.array([1e6, 1e6, 1e2, 1e2])  # variances of what is not known: place, turn, unit
_ROUNDS = 5
_CLEAR = 9.0  # by how much a company must explain the anchors better than another
_AT_ONCE, _NEIGHBOURS = 20, 10
_SWAP = np.array([[0.0, 1.0], [1.0, 0.0]])


@dataclass(frozen=True)
class FrameFit:
    """Anchors on a walk: ``anchor = shift + scale * R(turn) * place``, mirrored before if so.

    Attributes:
        turn_rad: by which the walk is turned to lie in the anchors' frame, anticlockwise.
        sigma_turn_rad: its standard deviation.
        shift_m: (2,) the walk's origin in the anchors' frame.
        scale: of the anchors' unit; 1 for metres.
        mirrored: whether x and y are exchanged before.
        agree: (M,) which anchors agree with the walk and each other.
        off_m: (M,) how far each anchor is from where the sensors and those that agree put it.
        cost: squared standard deviations, an anchor that contradicts counted as 25.
        clear: whether no other company of anchors explains them nearly as well.
    """

    turn_rad: float
    sigma_turn_rad: float
    shift_m: FloatArray
    scale: float
    mirrored: bool
    agree: BoolArray
    off_m: FloatArray
    cost: float
    clear: bool = True


class WalkAtAnchors:
    """A walk without anchors at the moments of M anchors, and how its errors there hang together."""

    def __init__(self, walk: Trajectory, crumbs: IntArray, anchors_m: FloatArray, sigma_m: FloatArray) -> None:
        """Anchors and where the walk was at them.

        Args:
            walk: smoothed without anchors.
            crumbs: (M,) its breadcrumbs at the anchors.
            anchors_m: (M, 2) places in their own frame.
            sigma_m: (M,) of x and y each.
        """
        self._centres = walk.xy_m[crumbs].mean(axis=0), anchors_m.mean(axis=0)
        self.here_m, self.there_m = walk.xy_m[crumbs] - self._centres[0], anchors_m - self._centres[1]
        self._walk, self._crumbs = walk, crumbs
        span_s = max(float(walk.t_s[-1] - walk.t_s[0]), 1.0)
        late_m = _PRESS_S * float(walk.distance_m[-1]) / span_s
        self._variance = np.repeat(sigma_m**2 + late_m**2, 2)
        self._drifts: dict[tuple[int, ...], FloatArray] = {}

    def fit(self, compass: bool, mirrored: bool = False, scaled: bool = False) -> FrameFit | None:
        """The frame with which most anchors agree; None if no two of them tell a direction.

        Args:
            compass: whether the walk knows North, as frames usually do.
            mirrored: try a frame whose x and y are exchanged.
            scaled: try a frame in any unit.
        """
        here = self.here_m @ _SWAP if mirrored else self.here_m
        chosen = np.unique(np.linspace(0, len(here) - 1, min(len(here), _MOST)).round().astype(int))
        fits = [self._grown(here, chosen, pair, scaled) for pair in self._pairs(here, chosen)]
        if not fits:
            return None
        if compass and not mirrored:
            usual = [min((wrap_scalar(fit.turn_rad) / _TURNED_RAD) ** 2, _TURNED_MOST) for fit in fits]
            fits = [replace(fit, cost=fit.cost + odd) for fit, odd in zip(fits, usual, strict=True)]
        best = min(fits, key=lambda fit: fit.cost)
        others = [fit.cost for fit in fits if (fit.agree & ~best.agree).any()]
        best = replace(best, clear=min(others, default=math.inf) - best.cost > _CLEAR)
        if len(chosen) < len(here):
            best = self._rest_judged(here, chosen, best)
        centre = self._centres[0][::-1] if mirrored else self._centres[0]
        shift = best.shift_m + self._centres[1] - best.scale * turned(centre, best.turn_rad)
        return replace(best, mirrored=mirrored, shift_m=shift)

    def cost_if_late(self, fit: FrameFit, late_s: float) -> float:
        """What a fit would cost if all anchors were told too late by so many seconds."""
        walk = self._walk
        xy_m = walk.at(walk.t_s[self._crumbs] - late_s)[:, :2] - self._centres[0]
        chosen = np.flatnonzero(fit.agree)[:_MOST]
        shift = fit.shift_m - self._centres[1] + turned(self._centres[0], fit.turn_rad)
        moved = replace(fit, shift_m=shift)
        return self._refined(xy_m, chosen, moved, scaled=False).cost

    def _rest_judged(self, here: FloatArray, chosen: IntArray, fit: FrameFit) -> FrameFit:
        """Of more anchors than are compared with one another, the rest by their neighbours among those that were."""
        agree, off_m = fit.agree.copy(), fit.off_m.copy()
        rest = np.setdiff1d(np.arange(len(here)), chosen)
        trusted = chosen[agree[chosen]]
        free = np.diag(_FREE[:3] if fit.scale == 1.0 else _FREE)
        for some in np.array_split(rest, -(-len(rest) // _AT_ONCE)):
            near = trusted[np.argsort(np.abs(trusted - np.median(some)))[:_NEIGHBOURS]]
            both = np.concatenate((some, near))
            known = np.arange(len(both)) >= len(some)
            off, slope = _against(
                here[both], self.there_m[both], fit.turn_rad, fit.shift_m, fit.scale, fit.scale != 1.0
            )
            whole = self._covariance(both, fit.scale) + slope @ free @ slope.T
            away, squared = predicted(whole, off, known)
            agree[some] = squared[~known] < _CONTRADICTS
            off_m[some] = fit.scale * np.hypot(*away[~known].T)
        return replace(fit, agree=agree, off_m=off_m, cost=fit.cost + _CONTRADICTS * float((~agree[rest]).sum()))

    def _covariance(self, which: IntArray, scale: float) -> FloatArray:
        """(2M, 2M) of the places of these anchors against those of the walk, in its metres."""
        rows = np.column_stack((2 * which, 2 * which + 1)).ravel()
        key = tuple(which.tolist())
        if key not in self._drifts:  # every pair grows among the same
            self._drifts[key] = _drift(self._walk, self._crumbs[which])
        return self._drifts[key] + np.diag(self._variance[rows] / scale**2)

    def laid(self, turn_rad: float) -> FrameFit:
        """The walk turned by an angle and laid among all anchors by their centre; none of them agrees."""
        shift = self._centres[1] - turned(self._centres[0], turn_rad)
        off_m = np.hypot(*(self.there_m - turned(self.here_m, turn_rad)).T)
        nobody = np.zeros(len(off_m), dtype=bool)
        return FrameFit(turn_rad, math.pi, shift, 1.0, False, nobody, off_m, math.inf)

    def _pairs(self, here: FloatArray, chosen: IntArray) -> list[tuple[int, int]]:
        """Pairs to start from, far apart first among neighbours in time."""
        pairs = [
            (i, j)
            for i, j in combinations(chosen.tolist(), 2)
            if np.hypot(*(here[i] - here[j])) > _SHORT_M and np.hypot(*(self.there_m[i] - self.there_m[j])) > 1e-9
        ]
        stride = max(len(pairs) // _MOST_PAIRS, 1)
        return pairs[::stride]

    def _grown(self, here: FloatArray, chosen: IntArray, pair: tuple[int, int], scaled: bool) -> FrameFit:
        """The company that grows from a pair."""
        i, j = pair
        (x, y), (u, v) = here[j] - here[i], self.there_m[j] - self.there_m[i]
        turn = math.atan2(v, u) - math.atan2(y, x)
        scale = math.hypot(u, v) / math.hypot(x, y) if scaled else 1.0
        shift = 0.5 * (self.there_m[i] + self.there_m[j]) - scale * turned(0.5 * (here[i] + here[j]), turn)
        agree = np.zeros(len(here), dtype=bool)
        agree[[i, j]] = True
        fit = FrameFit(turn, math.pi, shift, scale, False, agree, np.zeros(len(here)), math.inf)
        return self._refined(here, chosen, fit, scaled)

    def _refined(self, here: FloatArray, chosen: IntArray, fit: FrameFit, scaled: bool) -> FrameFit:
        """Those of ``chosen`` that agree with a frame, and the frame by them, in turns."""
        walk = self._covariance(chosen, fit.scale)
        here, there, agree = here[chosen], self.there_m[chosen], fit.agree[chosen]
        turn, shift, scale = fit.turn_rad, fit.shift_m, fit.scale
        free = np.diag(_FREE if scaled else _FREE[:3])
        for _ in range(_ROUNDS):
            off, slope = _against(here, there, turn, shift, scale, scaled)
            whole = walk + slope @ free @ slope.T
            agree = _company(predicted(whole, off, agree)[1], agree)
            inside = np.repeat(agree, 2)
            known = free @ slope[inside].T @ np.linalg.inv(whole[np.ix_(inside, inside)])
            move = known @ off[inside]
            shift = shift + scale * turned(move[:2], turn)
            turn += float(np.clip(move[2], -0.5, 0.5))
            scale *= math.exp(float(np.clip(move[3], -0.5, 0.5))) if scaled else 1.0
        off, slope = _against(here, there, turn, shift, scale, scaled)
        whole = walk + slope @ free @ slope.T
        away, squared = predicted(whole, off, agree)
        if agree.sum() == 2 and squared[agree].max() > _CONTRADICTS:  # which of the two nobody can tell
            agree = np.zeros_like(agree)
        full, off_m = np.zeros(len(fit.agree), dtype=bool), np.zeros(len(fit.agree))
        full[chosen], off_m[chosen] = agree, scale * np.hypot(*away.T)
        left = float(off[inside] @ np.linalg.solve(whole[np.ix_(inside, inside)], off[inside]))
        return replace(
            fit,
            turn_rad=wrap_scalar(turn),
            sigma_turn_rad=math.sqrt(max(float((free - known @ slope[inside] @ free)[2, 2]), 1e-12)),
            shift_m=shift,
            scale=scale,
            agree=full,
            off_m=off_m,
            cost=left + _CONTRADICTS * float((~agree).sum()) if agree.any() else math.inf,
        )


def _against(
    here: FloatArray, there: FloatArray, turn_rad: float, shift_m: FloatArray, scale: float, scaled: bool
) -> tuple[FloatArray, FloatArray]:
    """(2M,) anchors less places of the walk, in its frame, and (2M, 3 or 4) how place, turn and unit move them."""
    back = turned(there - shift_m, -turn_rad) / scale
    moved, swung = np.tile(np.eye(2), (len(here), 1)), np.column_stack((-back[:, 1], back[:, 0])).reshape(-1, 1)
    slopes = (moved, swung, back.reshape(-1, 1)) if scaled else (moved, swung)
    return (back - here).ravel(), np.hstack(slopes)


def predicted(whole: FloatArray, off: FloatArray, agree: BoolArray) -> tuple[FloatArray, FloatArray]:
    """(M, 2) how far each place is from where the others that agree put it, and (M,) the same squared, in sigma.

    Of one that agrees itself, without solving for each anew: with P the inverse of their covariance, it is off by
    ``inv(P_ii) (P off)_i``, whose covariance is ``inv(P_ii)`` (Rasmussen and Williams 2006, section 5.4.2).
    """
    away: FloatArray = np.zeros((len(agree), 2))
    squared: FloatArray = np.zeros(len(agree))
    if not agree.any():
        return away, squared
    inside = np.repeat(agree, 2)
    within, across = whole[np.ix_(inside, inside)], whole[np.ix_(~inside, inside)]
    if agree.sum() > 1:
        inverse = np.asarray(np.linalg.inv(within), dtype=float)
        pulls = (inverse @ off[inside]).reshape(-1, 2)
        away[agree] = np.linalg.solve(_blocks(inverse), pulls[:, :, None])[:, :, 0]
        squared[agree] = (pulls * away[agree]).sum(axis=1)
    if not agree.all():
        gain = np.linalg.solve(within, across.T).T
        away[~agree] = (off[~inside] - gain @ off[inside]).reshape(-1, 2)
        left = np.asarray(whole[np.ix_(~inside, ~inside)] - gain @ across.T, dtype=float)
        pull = np.linalg.solve(_blocks(left), away[~agree][:, :, None])[:, :, 0]
        squared[~agree] = (pull * away[~agree]).sum(axis=1)
    return away, squared


def _blocks(matrix: FloatArray) -> FloatArray:
    """(M, 2, 2) of those along the diagonal of (2M, 2M)."""
    every = np.arange(len(matrix) // 2)
    return np.asarray(matrix.reshape(len(every), 2, len(every), 2)[every, :, every])


def _company(squared: FloatArray, agree: BoolArray) -> BoolArray:
    """Who agrees next: without the worst of them if that one contradicts, else with all who agree with them."""
    worst = int(np.argmax(np.where(agree, squared, -1.0)))
    if agree.sum() > 2 and squared[worst] > _CONTRADICTS:
        smaller = agree.copy()
        smaller[worst] = False
        return smaller
    return agree | (squared < _CONTRADICTS)


def _drift(walk: Trajectory, crumbs: IntArray) -> FloatArray:
    """(2M, 2M) covariance of a walk's places at M breadcrumbs against its first, by the distance walked."""
    walked = walk.distance_m
    edges = np.unique(np.concatenate((np.linspace(0.0, walked[-1], _PIECES), walked[crumbs])))
    path = np.column_stack([np.interp(edges, walked, axis) for axis in (walk.x_m, walk.y_m)])
    if len(edges) < 2:
        return np.zeros((2 * len(crumbs), 2 * len(crumbs)))
    piece, middle = np.diff(path, axis=0), 0.5 * (edges[1:] + edges[:-1])
    before = (edges[1:] <= walked[crumbs][:, None] + 1e-9).astype(float)
    apart = np.abs(middle[:, None] - middle)
    yaw = 0.0 if walk.cov_xy_yaw is None else np.sqrt(np.interp(middle, walked, walk.cov_xy_yaw[:, 2, 2]))
    sigma = np.hypot(_TURN_HERE, yaw) * np.ones(len(middle))
    along = _SCALE**2 + _SCALE_HERE**2 * np.exp(-apart / _SCALE_M)
    across = sigma[:, None] * sigma * np.exp(-apart / _TURN_M)
    ahead = (before[:, None, :] * piece.T).reshape(-1, len(piece))
    aside = (before[:, None, :] * np.column_stack((-piece[:, 1], piece[:, 0])).T).reshape(-1, len(piece))
    return np.asarray(ahead @ along @ ahead.T + aside @ across @ aside.T)
