"""The compass readings of the latest breadcrumbs, online: kept, so that they can be said anew when more is known.

A compass factor is linear in the device's own iron, and its robust weight a number: both were right for what was
believed when the step was made. When the iron turns out to be another, or the window moves, they are made again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import gtsam
import numpy as np
from gtsam.symbol_shorthand import I

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.compass import STRENGTH, CompassReadings, compass_readings
from fbgraph.estimators.compass_factors import compass_factors, iron_factor, recalibration_factor
from fbgraph.estimators.magnetic_field import FieldMemory
from fbgraph.estimators.node import Node
from fbgraph.front_end.step_track import Step

_STALE_UT, _STALE_REL = 1.5, 0.1  # how far the iron may be from where factors were made, and of the field's strength
_HELD_STEPS = 15  # that long the factors stay at least


class CompassWindow:
    """Readings and iron of the breadcrumbs in the window.

    Attributes:
        iron_ut: (3,) each, of every stretch between recalibrations: where the factors were made.
    """

    def __init__(self, config: GraphConfig) -> None:
        """Nothing heard yet."""
        self._config = config
        self._field = FieldMemory(config.norm_scale_ut, config.dip_scale_rad)
        self._heard: list[tuple[int, CompassReadings]] = []
        self._starts: list[int] = []  # breadcrumbs where a stretch begins
        self._jumps_ut: list[FloatArray] = []
        self._begun = True  # whether the prior of the first stretch is still a factor of its own
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
        reading = compass_readings([step], self._field, self._config)
        if not self.iron_ut:
            self._usual_ut = float(reading.level_ut[0])
            self.iron_ut.append(np.array([0.0, 0.0, self._usual_ut]))
            self._starts.append(k)
            values.insert(I(0), self.iron_ut[0])
            graph.push_back(iron_factor(0, self.iron_ut[0], self._usual_ut, self._config))
        self._heard.append((k, reading))
        for factor in self._factors([(k, reading)], [node.yaw_rad]):
            graph.push_back(factor)

    def stretch_of(self, k: int) -> int | None:
        """Which stretch between recalibrations a breadcrumb belongs to; None before the first reading."""
        return max(int(np.searchsorted(self._starts, k, side="right")) - 1, 0) if self._starts else None

    def stretches(self, first: int) -> range:
        """The stretches of the breadcrumbs from ``first`` on."""
        begin = self.stretch_of(first)
        return range(0) if begin is None else range(begin, len(self._starts))

    def stale(self, k: int, iron_ut: FloatArray) -> bool:
        """Whether the factors were made for iron too far from the latest stretch's now; asked at breadcrumb ``k``."""
        made_ut = self.iron_ut[-1]
        limit_ut = max(_STALE_UT, _STALE_REL * abs(float(made_ut[STRENGTH])))
        return k - self._made_at >= _HELD_STEPS and float(np.abs(iron_ut - made_ut).max()) > limit_ut

    def moved(self, k: int, result: gtsam.Values, first: int) -> None:
        """Take the iron of an estimate over, at breadcrumb ``k``, in a window that begins at ``first``."""
        self._made_at = k
        for j in self.stretches(first):
            if result.exists(I(j)):
                self.iron_ut[j] = result.atVector(I(j))

    def recalibrated(self, starts: Sequence[int], jumps_ut: FloatArray, iron_ut: FloatArray) -> None:
        """The magnetometer's zero jumped before these breadcrumbs, some of which may be known.

        Args:
            starts: (J,) of them.
            jumps_ut: (J, 3) by how much.
            iron_ut: (J+1, 3) iron before and after each.
        """
        for start, jump_ut, after_ut in zip(starts, jumps_ut, iron_ut[1:], strict=True):
            if start > self._starts[-1]:
                self._starts.append(start)
                self._jumps_ut.append(jump_ut)
                self.iron_ut.append(after_ut)

    def again(self, nodes: Sequence[Node], first: int, last: int) -> list[gtsam.NonlinearFactor]:
        """All factors of the window's readings up to breadcrumb ``last``, and of its iron.

        Args:
            nodes: of all breadcrumbs, as believed now.
            first: where the window begins.
            last: up to which.
        """
        asked = [(k, reading) for k, reading in self._heard if k <= last]
        factors: list[gtsam.NonlinearFactor] = []
        if self.iron_ut and self._begun:
            factors.append(iron_factor(0, self.iron_ut[0], self._usual_ut, self._config))
        for j in range(1, len(self._starts)):
            if first < self._starts[j] <= last:
                factors.append(recalibration_factor(j, self._jumps_ut[j - 1], self._config))
                factors.append(iron_factor(j, self.iron_ut[j], self._usual_ut, self._config))
        return factors + self._factors(asked, [nodes[k].yaw_rad for k, _ in asked])

    def forget(self, join: int) -> None:
        """Breadcrumbs up to ``join`` have left the window, their readings told to its prior."""
        self._begun = False
        self._heard = [(k, reading) for k, reading in self._heard if k > join]

    def _factors(
        self, heard: Sequence[tuple[int, CompassReadings]], yaw_rad: Sequence[float]
    ) -> list[gtsam.NonlinearFactor]:
        if not heard:
            return []
        k = np.array([k for k, _ in heard])
        stretch = np.maximum(np.searchsorted(self._starts, k, side="right") - 1, 0)
        readings = CompassReadings.concatenate([reading for _, reading in heard])
        iron_ut = np.array(self.iron_ut)
        return list(compass_factors(k, readings, np.array(yaw_rad), stretch, iron_ut, self._config))
