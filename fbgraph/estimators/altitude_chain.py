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
from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import D, Z

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.noise_models import FIXED, HUBER, huber, sigmas
from fbgraph.front_end.climb import MEMORY_S
from fbgraph.front_end.step_track import Step, StepTrack

_SHORTEST_S = 1e-3  # two steps at one time
_CARRIED_REL = 0.1  # error of a ride's height as the front end saw it
_FALL_M_S = 5.0  # nobody moves up or down faster
_BLOWN_REL = 3.0  # a leap of pressure is the air's, whatever its size


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
            reference_m = step.altitude_sigma_m if math.isfinite(step.altitude_sigma_m) else 0.0
            graph.push_back(gtsam.PriorFactorDouble(Z(0), 0.0, sigmas(FIXED)))
            graph.push_back(gtsam.PriorFactorDouble(D(0), 0.0, sigmas(math.hypot(FIXED, reference_m))))
            return
        passed_s = max(step.t_s - previous.t_s, _SHORTEST_S)
        climb_m = math.hypot(config.sigma_climb_m, _CARRIED_REL * step.carried_m)
        if not step.chained:
            climb_m = math.hypot(climb_m, config.sigma_gap_m_s * passed_s)
        weather_m = math.hypot(config.sigma_weather_m * math.sqrt(passed_s), _BLOWN_REL * step.blown_m)
        graph.add(gtsam.BetweenFactorDouble(Z(k - 1), Z(k), step.carried_m, sigmas(climb_m)))
        graph.add(gtsam.BetweenFactorDouble(D(k - 1), D(k), -step.blown_m, sigmas(weather_m)))
        if math.isfinite(step.altitude_m):
            measured_m = step.altitude_m - self._altitude_0
            graph.add(gtsam.BetweenFactorDouble(D(k), Z(k), measured_m, huber(HUBER, self._sigma_m(step))))

    def _sigma_m(self, step: Step) -> float:
        """Of a step's altitude. Gusts last: as many steps as one takes know no more of altitude than one."""
        config = self._config
        if not step.altitude_sigma_m > 0.0:  # also when it is not known
            return config.sigma_altitude_m
        shared = math.sqrt(1.0 + config.gust_s * step.frequency_hz)
        return math.hypot(config.sigma_altitude_m, step.altitude_sigma_m * shared)


def weather_sigma_m(t_s: FloatArray, config: GraphConfig) -> FloatArray:
    """(N,) what a steady change of the weather since the first of these times adds to the sigma of altitude, metres.

    Its rate, ``sigma_weather_m_s``, is the same all along a walk, so that no state of the graph can show it. It lasts
    for ``weather_turns_s`` on average (first-order Gauss-Markov process), so its part levels off after as long.
    """
    lasts_s = config.weather_turns_s
    return np.asarray(config.sigma_weather_m_s * lasts_s * -np.expm1((t_s[0] - t_s) / lasts_s))


def air_sigma_m(track: StepTrack) -> FloatArray:
    """(N,) sigma of altitude from changes of pressure that no step, lift or gust explains, metres.

    They are taken for the air's own. If they were not (somebody ran up an escalator, or was driven uphill), altitude is
    off by all of them, which should not lie beyond two of this.
    """
    slow = np.abs(track.blown_m) < _FALL_M_S * np.diff(track.t_s, prepend=track.t_s[0])
    return np.asarray(0.5 * np.abs(np.cumsum(np.where(slow, track.blown_m, 0.0))))


def with_gusts_foreseen(steps: Sequence[Step]) -> list[Step]:
    """The steps as they are known afterwards: gusts had begun by the time that they were noticed."""
    known: list[Step] = []
    gusty: Step | None = None
    for step in reversed(steps):
        gusty = step if step.gusty else gusty
        if gusty is not None and gusty.t_s - step.t_s <= MEMORY_S:
            step = replace(step, altitude_sigma_m=max(gusty.altitude_sigma_m, step.altitude_sigma_m))
        known.append(step)
    return known[::-1]
