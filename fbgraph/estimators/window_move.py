"""A move of iSAM2's window: its older half is eliminated into a prior, and a tree of the newer half is made.

That is the work of a hundred steps. What is old enough that the next steps hardly change it is done beforehand, a
piece at every step, and the rest when the window moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import gtsam
from gtsam.symbol_shorthand import B, D, I, X, Z

from fbgraph.core.geometry import FloatArray
from fbgraph.estimators.compass_factors import UNIT_UT
from fbgraph.estimators.compass_window import CompassWindow
from fbgraph.estimators.isam_tree import eliminated, solving
from fbgraph.estimators.node import Node
from fbgraph.way_back.records import Closure

LEAVE, ENTER = 25, 10
"""Breadcrumbs eliminated, or told to the new tree, at one step: about a millisecond each."""

ClosureFactor = Callable[[Closure, int], gtsam.NonlinearFactor]


@dataclass(frozen=True)
class Known:
    """What is believed of a window at one moment: as gtsam has it, its breadcrumbs, and every state of the iron."""

    values: gtsam.Values
    nodes: Mapping[int, Node]
    iron_ut: Sequence[FloatArray]


@dataclass(frozen=True)
class Told:
    """What a window was told: factors that came with each breadcrumb from ``origin`` on, the compass, closures."""

    origin: int
    graphs: Sequence[gtsam.NonlinearFactorGraph]
    compass: CompassWindow
    closures: Sequence[Closure]
    closure_factor: ClosureFactor


class WindowMove:
    """One move of the window.

    Attributes:
        join: breadcrumb where the window will begin.
        tree: of the newer half, as far as it is told.
        prior: of breadcrumb ``join``, once all before it are eliminated.
    """

    def __init__(self, origin: int, join: int, tree: gtsam.ISAM2, *, by_qr: bool) -> None:
        """Nothing done yet.

        Args:
            origin: where the window begins.
            join: where it will.
            tree: a new one.
            by_qr: whether a gap lies in the older half.
        """
        self.join = join
        self.tree = tree
        self.prior = gtsam.NonlinearFactorGraph()
        self._by_qr = by_qr
        self._gone = origin  # breadcrumbs before it are eliminated
        self._entered = join - 1  # and up to this told to the new tree
        self._states = 0  # of the iron, told to it
        self._held = gtsam.KeyList()

    def takes(self, i: int, j: int) -> bool:
        """Whether a factor between two breadcrumbs that comes now still counts: neither is done with."""
        done = self._gone if self._gone < self.join else max(self.join, self._entered)
        return j > done and (j > self.join or i >= self._gone)

    def piece(self, told: Told, at: Known, last: int, leave: int = LEAVE, enter: int = ENTER) -> bool:
        """Do the next piece; returns whether there was one.

        Args:
            told: all that counts.
            at: where to linearise, and by which the compass is judged.
            last: breadcrumb up to which that is settled.
            leave, enter: how many breadcrumbs to eliminate or to tell.

        Raises:
            EstimationError: the solver failed.
        """
        if self._gone < self.join:
            end = min(self._gone + leave, self.join)
            tied = [c for c in told.closures if told.origin <= c.i and c.j <= self.join]
            while any(c.i < end < c.j for c in tied):  # never cut between them
                end += 1
            if end <= last:
                self._eliminate(told, at, end)
            return end <= last
        end = self._entered + enter
        if end <= last:
            self._tell(told, at, end)
        return end <= last

    def finish(self, told: Told, at: Known, last: int) -> None:
        """Do all that is left, up to the latest breadcrumb.

        Raises:
            EstimationError: the solver failed.
        """
        if self._gone < self.join:
            self._eliminate(told, at, self.join)
        if self._entered < last:
            self._tell(told, at, last)

    def _eliminate(self, told: Told, at: Known, end: int) -> None:
        """What is known of breadcrumb ``end`` once those before it are gone."""
        begin, origin, compass = self._gone, told.origin, told.compass
        graph = gtsam.NonlinearFactorGraph(self.prior)
        for part in told.graphs[begin - origin + (begin > origin) : end - origin + 1]:
            graph.push_back(part)
        for closure in told.closures:
            if begin < closure.j <= end:
                graph.push_back(told.closure_factor(closure, origin))
        for factor in compass.again(at.nodes, begin, end, at.iron_ut):
            graph.add(factor)
        gone = gtsam.Ordering()
        iron = compass.state_of(end)
        states = [j for j in compass.states(begin, end) if j != iron]
        for k in range(begin, end):
            # a state of the iron after its breadcrumbs: before them it would tie them all together
            while states and states[0] < (compass.state_of(k) or 0):
                gone.push_back(I(states.pop(0)))
            for key in (X(k), Z(k), B(k), D(k)):
                gone.push_back(key)
        for j in states:
            gone.push_back(I(j))
        kept = {X(end): 3, Z(end): 1, B(end): 2, D(end): 1, **({} if iron is None else {I(iron): 3})}
        self.prior = eliminated(graph, gone, kept, at.values, by_qr=self._by_qr)
        self._gone = end

    def _tell(self, told: Told, at: Known, end: int) -> None:
        """Tell the new tree of the breadcrumbs up to ``end``."""
        join, compass = self.join, told.compass
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for k in range(self._entered + 1, end + 1):
            graph.push_back(self.prior if k == join else told.graphs[k - told.origin])
            at.nodes[k].insert_into(values, k)
        before = max(self._entered, join)
        for factor in compass.again(at.nodes, before, end, at.iron_ut):
            graph.add(factor)
        for closure in told.closures:
            if before < closure.j <= end:
                graph.push_back(told.closure_factor(closure, join))
        states = compass.states(join, end)
        for j in states[self._states :]:
            values.insert(I(j), at.iron_ut[j] / UNIT_UT)
        keys = values.keys()
        for key in keys:
            self._held.push_back(key)  # half told, the tree knows less of yaw than ``at`` does
        with solving(f"step {end}"):
            self.tree.update(graph, values, constrainedKeys=at_root(compass, end), noRelinKeys=self._held)
        self._entered, self._states = end, len(states)


def at_root(compass: CompassWindow, k: int) -> gtsam.KeyGroupMap:
    """The next breadcrumb is tied to this one: far from the root, the whole tree would be made once more."""
    group = gtsam.KeyGroupMap()
    for key in (X(k), Z(k), B(k), D(k), *map(I, compass.states(k, k))):
        group.insert2(key, 1)
    return group
