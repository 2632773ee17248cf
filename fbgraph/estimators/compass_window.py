"""The compass readings of the latest breadcrumbs, online: kept, so that they can be said anew when more is known.

A compass factor is linear in the device's own iron, and its robust weight a number: both were right for what was
believed when the step was made. When the iron turns out to be another, or the window moves, they are made again.

The iron is a state of every twenty breadcrumbs, tied to the one before: were it one for all, iSAM2 would look at the
whole window at every step.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import I

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.compass import STRENGTH, CompassReading, CompassReadings, compass_reading
from fbgraph.estimators.compass_factors import (
    UNIT_UT,
    compass_factor,
    compass_factors,
    iron_factor,
    recalibration_factor,
)
from fbgraph.estimators.magnetic_field import FieldMemory
from fbgraph.estimators.node import Node
from fbgraph.front_end.step_track import Step

_STALE_UT, _STALE_REL = 1.5, 0.1  # how far the iron may be from where factors were made, and of the field's strength
_HELD_STEPS = 15  # that long the factors stay at least
_BLOCK_STEPS, _BLOCK_UT = 20, 0.1  # how often the iron is a state, and how far it may move meanwhile


class CompassWindow:
    """Readings and iron of the breadcrumbs in the window.

    Attributes:
        iron_ut: (3,) each, of every state: where the factors were made.
    """

    def __init__(self, config: GraphConfig) -> None:
        """Nothing heard yet."""
        self._config = config
        self._field = FieldMemory(config.norm_scale_ut, config.dip_scale_rad)
        self._heard: list[tuple[int, CompassReading]] = []
        self._starts: list[int] = []  # breadcrumbs where a state begins
        self._jumps_ut: dict[int, FloatArray] = {}  # by such a breadcrumb: where the magnetometer was calibrated anew
        self._usual_ut = math.nan
        self._made_at = 0
        self.iron_ut: list[FloatArray] = []

    def hear(self, k: int, step: Step, node: Node, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        """Take a step's reading, if it has one, and add its factors.

        Args:
            k: breadcrumb.
            step: the step that ends there.
            node: what is believed of it.
            graph, values: extended in place.
        """
        if not math.isfinite(step.yaw_mag_rad):
            return
        reading = compass_reading(step, self._field, self._config)
        if not self.iron_ut:
            self._usual_ut = reading.level_ut
            self.iron_ut.append(np.array([0.0, 0.0, self._usual_ut]))
            self._starts.append(k)
            values.insert(I(0), self.iron_ut[0] / UNIT_UT)
            graph.push_back(iron_factor(0, self.iron_ut[0], self._usual_ut, self._config))
        elif k - self._starts[-1] >= _BLOCK_STEPS:
            self.iron_ut.append(self.iron_ut[-1])
            self._starts.append(k)
            values.insert(I(len(self._starts) - 1), self.iron_ut[-1] / UNIT_UT)
            graph.add(self._tie(len(self._starts) - 1))
        self._heard.append((k, reading))
        at = len(self._starts) - 1
        graph.add(compass_factor(k, at, reading, node.yaw_rad, self.iron_ut[at], self._config))

    def turned(self, first: int, steps: Sequence[Step]) -> None:
        """The device was held otherwise than believed at the steps from ``first`` on."""
        self._heard = [
            (k, reading if k < first else reading._replace(mount_rad=steps[k - first].mount_rad))
            for k, reading in self._heard
        ]

    def state_of(self, k: int) -> int | None:
        """Which state of the iron a breadcrumb belongs to; None before the first reading."""
        return bisect_right(self._starts, k) - 1 if self._starts and self._starts[0] <= k else None

    def states(self, first: int, last: int) -> range:
        """The states of the iron of the breadcrumbs from ``first`` to ``last``."""
        return range(self.state_of(first) or 0, bisect_right(self._starts, last))

    def held(self, k: int) -> bool:
        """Whether the factors stay as they are at breadcrumb ``k``, wherever the iron is: they are new, or none."""
        return not self.iron_ut or k - self._made_at < _HELD_STEPS

    def is_far(self, iron_ut: FloatArray) -> bool:
        """Whether that is too far from the iron for which the latest factors were made."""
        made_ut = self.iron_ut[-1]
        limit_ut = max(_STALE_UT, _STALE_REL * abs(float(made_ut[STRENGTH])))
        return float(np.abs(iron_ut - made_ut).max()) > limit_ut

    def moved(self, k: int, result: gtsam.Values, first: int) -> None:
        """Take the iron of an estimate over, at breadcrumb ``k``, in a window from ``first`` on."""
        self._made_at = k
        self.iron_ut = self.estimated(result, first, k)

    def estimated(self, result: gtsam.Values, first: int, last: int) -> list[FloatArray]:
        """(3,) each, of every state: those of the breadcrumbs from ``first`` to ``last`` as estimated."""
        iron_ut = self.iron_ut.copy()
        for j in self.states(first, last):
            if result.exists(I(j)):
                iron_ut[j] = UNIT_UT * result.atVector(I(j))
        return iron_ut

    def recalibrated(self, starts: Sequence[int], jumps_ut: FloatArray, iron_ut: FloatArray) -> None:
        """The magnetometer's zero jumped before these breadcrumbs, some of which may be known, if at all.

        Args:
            starts: (J,) of them.
            jumps_ut: (J, 3) by how much.
            iron_ut: (J+1, 3) iron before and after each.
        """
        if not starts:
            self.iron_ut = [iron_ut[0]] * len(self.iron_ut)
        for start, jump_ut, before_ut, after_ut in zip(starts, jumps_ut, iron_ut[:-1], iron_ut[1:], strict=True):
            if start in self._jumps_ut:
                continue
            at = int(np.searchsorted(self._starts, start))
            if at == len(self._starts) or self._starts[at] != start:
                self._starts.insert(at, start)
                self.iron_ut.insert(at, after_ut)
            self._jumps_ut[start] = jump_ut
            self.iron_ut[at - 1] = before_ut
            self.iron_ut[at:] = [after_ut] * (len(self.iron_ut) - at)

    def again(
        self, nodes: Mapping[int, Node] | Sequence[Node], first: int, last: int, iron_ut: Sequence[FloatArray]
    ) -> list[gtsam.NonlinearFactor]:
        """All factors of the readings after breadcrumb ``first`` up to ``last``, and of the iron's states meanwhile.

        Args:
            nodes: of these breadcrumbs, as believed now.
            first, last: which.
            iron_ut: (3,) each, of every state, as believed now.
        """
        asked = [(k, reading) for k, reading in self._heard if first < k <= last]
        factors: list[gtsam.NonlinearFactor] = []
        for j in range(bisect_right(self._starts, first), bisect_right(self._starts, last)):
            if j:
                factors.append(self._tie(j))
            if j == 0 or self._starts[j] in self._jumps_ut:
                factors.append(iron_factor(j, iron_ut[j], self._usual_ut, self._config))
        return factors + self._factors(asked, [nodes[k].yaw_rad for k, _ in asked], iron_ut)

    def forget(self, join: int) -> None:
        """Breadcrumbs up to ``join`` have left the window, their readings told to its prior."""
        self._heard = [(k, reading) for k, reading in self._heard if k > join]

    def _tie(self, j: int) -> gtsam.BetweenFactorVector:
        """What a state of the iron has to do with the one before."""
        jump_ut = self._jumps_ut.get(self._starts[j])
        if jump_ut is None:
            return recalibration_factor(j, np.zeros(3), _BLOCK_UT)
        return recalibration_factor(j, jump_ut, self._config.sigma_iron_jump_ut)

    def _factors(
        self, heard: Sequence[tuple[int, CompassReading]], yaw_rad: Sequence[float], made_ut: Sequence[FloatArray]
    ) -> list[gtsam.NonlinearFactor]:
        if not heard:
            return []
        k = np.array([k for k, _ in heard])
        stretch = np.searchsorted(self._starts, k, side="right") - 1
        readings = CompassReadings.of([reading for _, reading in heard])
        iron_ut = np.array([made_ut[j] for j in stretch])
        return list(compass_factors(k, readings, np.array(yaw_rad), stretch, iron_ut, self._config))
