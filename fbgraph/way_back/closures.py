"""Closures: which matches of the way back to the way out are good enough to tie the graph together."""

from __future__ import annotations

import math

import numpy as np

from fbgraph.core.config import ReturnConfig
from fbgraph.core.trajectory import Trajectory
from fbgraph.way_back.records import Closure, Match
from fbgraph.way_back.way_out import Outbound

_AT_START_M, _LINGERS_M = 1.5, 3.5  # who has been so near to it for so long has arrived, and may walk on anywhere
_NEAR_M = 2.0, 8.0
_BESIDE_MOST_M = 2.0  # on the other side of a wide corridor nobody keeps his distance: told, but not tied
_OUT_AGAIN_M = 5.0  # who walks out so far again is on another walk, perhaps beside this one


class ClosureMaker:
    """Chooses the matches that may enter the graph: the route followed back without doubt for a while, not too many."""

    def __init__(self, outbound: Outbound, config: ReturnConfig, across_m: float = 0.0) -> None:
        """Nothing is tied yet.

        Args:
            outbound: the way out.
            config: which matches are good enough.
            across_m: how far to the left of the way out, facing out, the way back lies by ``beside_m``.
        """
        self._outbound = outbound
        self._config = config
        self._across_m = across_m
        self._since_m = math.inf
        self._out_m = self._arrived_m = 0.0
        self._over = abs(across_m) > _BESIDE_MOST_M

    def advance(self, k: int, length_m: float, match: Match) -> Closure | None:
        """The closure of breadcrumb ``k``, if its match is good enough and the last one is some way back."""
        config = self._config
        self._since_m += length_m
        self._out_m = 0.0 if match.facing_back or match.off_route else self._out_m + length_m
        self._arrived_m += length_m if match.route_m < _AT_START_M else 0.0
        self._over |= self._out_m >= _OUT_AGAIN_M or self._arrived_m > _LINGERS_M
        away_m = float(self._outbound.route_m[-1]) - match.route_m
        steady = match.steady_m >= config.closure_steady_m and away_m >= config.closure_away_m
        if self._over or not steady or self._since_m < config.closure_every_m:
            return None
        self._since_m = 0.0
        along_m = match.route_m - float(self._outbound.route_m[match.breadcrumb])
        sigma_m = math.hypot(match.sigma_m, config.closure_sigma_m)
        return Closure(match.breadcrumb, k, sigma_m, config.closure_sigma_m, along_m, self._across_m)


def beside_m(trajectory: Trajectory, turned: int) -> float:
    """How far to the left of the way out, facing out, the way back begins: by dead reckoning, just after the turn.

    Over a few metres dead reckoning is good to some decimetres, whatever the heading errors of the whole walk.

    Args:
        trajectory: the walk as far as it is known.
        turned: its breadcrumb where the way out ends.
    """
    walked = trajectory.distance_m
    after = walked[turned] + np.arange(_NEAR_M[0], _NEAR_M[1] + 1e-9, 0.5)
    before = walked[turned] - np.arange(0.0, min(_NEAR_M[1] + 3.0, float(walked[turned])) + 1e-9, 0.25)
    after = after[after <= walked[-1]]
    if len(after) == 0 or len(before) < 8:
        return 0.0
    back, out = (
        np.column_stack([np.interp(at, walked, c) for c in (trajectory.x_m, trajectory.y_m)]) for at in (after, before)
    )
    ahead = np.gradient(out, axis=0)
    ahead = -ahead / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    off = back[:, None] - out
    nearest = np.hypot(off[..., 0], off[..., 1]).argmin(axis=1)
    off = off[np.arange(len(back)), nearest]
    ahead = ahead[nearest]
    return float(np.median(ahead[:, 0] * off[:, 1] - ahead[:, 1] * off[:, 0]))
