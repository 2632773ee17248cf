"""What a step says about altitude: air pressure is altitude only as far as the weather holds still.

The barometer measures how far breadcrumb k lies above the isobar that ran through the start. That surface of equal
pressure sinks and rises with the weather, so it has a height of its own, D(k), beside the breadcrumb's, Z(k):

    barometer       D(k), Z(k)      Z - D = altitude above the start's isobar, Huber    BetweenFactorDouble
    climb           Z(k-1), Z(k)    ~0 in one step                                      BetweenFactorDouble
    weather         D(k-1), D(k)    the isobar wanders, with the root of time           BetweenFactorDouble

Steps climb, the weather takes its time: what changes within some steps is told to Z, what changes while nobody steps
to D. A pressure that rises steadily cannot be told from a gentle slope by any of these; ``weather_sigma_m`` adds it
to the result.
"""

from __future__ import annotations

import math

import gtsam
import numpy as np
from gtsam.symbol_shorthand import D, Z

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.noise_models import FIXED, HUBER, huber, sigmas
from fbgraph.front_end.step_track import Step

_SHORTEST_S = 1e-3  # two steps at one time


class AltitudeChain:
    """Altitude's factors, one step at a time; keeps the barometer's first reading, from which it counts."""

    def __init__(self, config: GraphConfig) -> None:
        """Of one walk, with these weights."""
        self._config = config
        self._altitude_0 = math.nan

    def add(self, k: int, step: Step, previous: Step | None, graph: gtsam.NonlinearFactorGraph) -> None:
        """Add what a step says of altitude.

        Args:
            k: index of its breadcrumb.
            step: the step.
            previous: the one before; None for the standing start.
            graph: extended in place.
        """
        config = self._config
        if math.isnan(self._altitude_0):
            self._altitude_0 = step.altitude_m
        if previous is None:
            graph.push_back(gtsam.PriorFactorDouble(Z(0), 0.0, sigmas(FIXED)))
            graph.push_back(gtsam.PriorFactorDouble(D(0), 0.0, sigmas(FIXED)))
            return
        passed_s = max(step.t_s - previous.t_s, _SHORTEST_S)
        climb_m, weather_m = config.sigma_climb_m, config.sigma_weather_m * math.sqrt(passed_s)
        if not step.chained:
            climb_m = math.hypot(climb_m, config.sigma_gap_m_s * passed_s)
        graph.push_back(gtsam.BetweenFactorDouble(Z(k - 1), Z(k), 0.0, sigmas(climb_m)))
        graph.push_back(gtsam.BetweenFactorDouble(D(k - 1), D(k), 0.0, sigmas(weather_m)))
        if math.isfinite(step.altitude_m):
            measured_m = step.altitude_m - self._altitude_0
            model = huber(HUBER, config.sigma_altitude_m)
            graph.push_back(gtsam.BetweenFactorDouble(D(k), Z(k), measured_m, model))


def weather_sigma_m(t_s: FloatArray, config: GraphConfig) -> FloatArray:
    """(N,) what a steady change of the weather since the first of these times adds to the sigma of altitude, metres.

    Its rate, ``sigma_weather_m_s``, is the same all along a walk, so that no state of the graph can show it. It lasts
    for ``weather_turns_s`` on average (first-order Gauss-Markov process), so its part levels off after as long.
    """
    lasts_s = config.weather_turns_s
    return np.asarray(config.sigma_weather_m_s * lasts_s * -np.expm1((t_s[0] - t_s) / lasts_s))
