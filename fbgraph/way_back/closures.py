"""Closures: which matches of the way back to the way out are good enough to tie the graph together."""

from __future__ import annotations

import math

from fbgraph.core.config import ReturnConfig
from fbgraph.way_back.records import Closure, Match
from fbgraph.way_back.way_out import Outbound


class ClosureMaker:
    """Chooses the matches that may enter the graph: the route followed back without doubt for a while, not too many."""

    def __init__(self, outbound: Outbound, config: ReturnConfig) -> None:
        self._outbound = outbound
        self._config = config
        self._since_m = math.inf

    def advance(self, k: int, length_m: float, match: Match) -> Closure | None:
        """The closure of breadcrumb ``k``, if its match is good enough and the last one is some way back."""
        config = self._config
        self._since_m += length_m
        away_m = float(self._outbound.route_m[-1]) - match.route_m
        steady = match.steady_m >= config.closure_steady_m and away_m >= config.closure_away_m
        if not steady or self._since_m < config.closure_every_m:
            return None
        self._since_m = 0.0
        along_m = match.route_m - float(self._outbound.route_m[match.breadcrumb])
        sigma_m = math.hypot(match.sigma_m, config.closure_sigma_m)
        return Closure(match.breadcrumb, k, sigma_m, config.closure_sigma_m, along_m)
