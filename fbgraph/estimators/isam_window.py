"""The end of the walk in iSAM2, of a bounded size.

iSAM2 (Kaess et al., IJRR 2012) keeps a Bayes tree whose every update costs time in its size, so a tree of a day's walk
would be slow. It is kept to a window: when it has grown to twice ``window_steps``, the older half is eliminated
into one prior on the breadcrumb where the newer half begins (exact, to first order), and its breadcrumbs stay as
they were then (``window_move``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, D, I, X, Z

from fbgraph.core.config import GraphConfig, OnlineConfig
from fbgraph.core.geometry import FloatArray, wrap_scalar
from fbgraph.estimators.aid_factors import closure_factor, closure_prior
from fbgraph.estimators.compass_factors import UNIT_UT
from fbgraph.estimators.compass_window import CompassWindow
from fbgraph.estimators.heading_chain import HeadingSolution
from fbgraph.estimators.isam_tree import new_tree, solving
from fbgraph.estimators.node import Node
from fbgraph.estimators.window_move import ENTER, LEAVE, Known, Told, WindowMove, at_root
from fbgraph.front_end.step_track import Step
from fbgraph.way_back.records import Closure

_UNSETTLED = 50  # breadcrumbs that later steps may still turn


class IsamWindow:
    """Factors of the latest breadcrumbs, solved as they come.

    Attributes:
        nodes: of every breadcrumb: while in the window a guess, after it for good.
        closures: all so far.
    """

    def __init__(self, config: OnlineConfig, graph_config: GraphConfig, places_known: bool) -> None:
        """An empty window.

        Args:
            config: its size, and iSAM2's thresholds.
            graph_config: weights of the compass.
            places_known: whether anchors will come: then places are no longer linear given yaw.
        """
        self._config = config
        self._places_known = places_known
        self._graphs: list[gtsam.NonlinearFactorGraph] = []  # what came with each breadcrumb of the window
        self._compass = CompassWindow(graph_config)  # but for the compass
        self._after_gaps: list[int] = []  # breadcrumbs before which the log was silent
        self._isam = self._new_isam()
        self._past: gtsam.ISAM2 | None = None  # the tree before, which takes a while to be taken down
        self._rested = True
        self._ahead: tuple[WindowMove, Known, int] | None = None  # a move that is begun: as known then, up to where
        self._first = 0
        self.nodes: list[Node] = []
        self.closures: list[Closure] = []

    def add(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, node: Node, step: Step) -> Node:
        """Take the next breadcrumb and return it as solved.

        Args:
            graph: the factors that come with it, without the compass.
            values: its first values.
            node: the same.
            step: the step that ends there.

        Raises:
            EstimationError: the solver failed.
        """
        self.rest()
        k = len(self.nodes)
        if not step.chained:
            self._after_gaps.append(k)
            self._rebuild(self._isam.calculateBestEstimate())  # by QR from now on
        self.nodes.append(node)
        self._graphs.append(graph)
        with_compass = gtsam.NonlinearFactorGraph(graph)
        self._compass.hear(k, step, node, with_compass, values)
        with solving(f"step {k}"):
            self._isam.update(with_compass, values)
        self._rested = False
        return self._latest()

    def rest(self) -> None:
        """Do what may wait until after a step: when no step has come, and at the latest before anything else is asked.

        Raises:
            EstimationError: the solver failed.
        """
        if self._rested:
            return
        self._rested, self._past, k = True, None, len(self.nodes) - 1
        if len(self._graphs) >= 2 * self._config.window_steps:
            self._shorten()
        elif not self._compass.held(k) and self._compass.is_far(self._iron()):
            self._rebuild(self._taken_over())
        else:
            self._prepare(k)

    @property
    def first(self) -> int:
        """Breadcrumb where the window begins."""
        self.rest()
        return self._first

    def _iron(self) -> FloatArray:
        """(3,) iron and strength of the latest stretch, as believed now."""
        return np.asarray(UNIT_UT * self._isam.calculateEstimateVector(I(len(self._compass.iron_ut) - 1)))

    def misjudged(self, heading: HeadingSolution) -> bool:
        """Whether the headings of the window, solved by themselves, show another iron than the window knows of."""
        return bool(self._compass.iron_ut) and self._compass.is_far(heading.iron_ut[-1])

    def recalibrate(self, heading: HeadingSolution) -> None:
        """Believe the iron that the window's headings show, and that the magnetometer's zero jumped within it.

        Args:
            heading: of the breadcrumbs in the window, its jumps believed.

        Raises:
            EstimationError: the solver failed.
        """
        self.rest()
        starts = np.flatnonzero(np.diff(heading.stretch)) + 1 + self._first
        result = self._taken_over()
        # where the compass is judged; the tree itself is linear in yaw
        for k, yaw_rad in enumerate(heading.yaw_rad.tolist(), self._first):
            node = self.nodes[k]
            self.nodes[k] = replace(node, yaw_rad=node.yaw_rad + wrap_scalar(yaw_rad - node.yaw_rad))
        self._compass.recalibrated(starts.tolist(), heading.jumps_ut, heading.iron_ut)
        self._rebuild(result)

    def _taken_over(self) -> gtsam.Values:
        """The window as solved now; breadcrumbs and iron are its from now on."""
        result = self._isam.calculateBestEstimate()
        self.nodes[self._first :] = self._read(result)
        self._compass.moved(len(self.nodes) - 1, result, self._first)
        return result

    def hold(self, k: int, factor: gtsam.NonlinearFactor) -> Node:
        """Add a factor on breadcrumb ``k`` of the window, and return the latest breadcrumb as solved.

        Raises:
            EstimationError: the solver failed.
        """
        self.rest()
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(factor)
        self._graphs[k - self._first].push_back(factor)
        self._let_through(k, k)
        with solving("an anchor"):
            self._isam.update(graph, gtsam.Values())
        return self._latest()

    def _latest(self) -> Node:
        """The latest breadcrumb as solved."""
        k = len(self.nodes) - 1
        with solving(f"step {k}"):
            pose, b = self._isam.calculateEstimatePose2(X(k)), self._isam.calculateEstimateVector(B(k))
            z_m, isobar_m = (self._isam.calculateEstimateDouble(key) for key in (Z(k), D(k)))
            solved = self.nodes[k] = _near(self.nodes[k].yaw_rad, pose, z_m, b, isobar_m)
        return solved

    def rewrite(
        self, first: int, graphs: Sequence[gtsam.NonlinearFactorGraph], nodes: Sequence[Node], steps: Sequence[Step]
    ) -> None:
        """Take the breadcrumbs from ``first`` on anew, as more is known of how the device was held.

        Args:
            first: in the window, and not where it begins, unless that is the start.
            graphs: the factors that come with each, without the compass.
            nodes: where to start the solver.
            steps: the steps that end there.

        Raises:
            EstimationError: the solver failed.
        """
        self.rest()
        self._graphs[first - self._first :] = graphs
        self.nodes[first:] = nodes
        self._compass.turned(first, steps)
        values = gtsam.Values()
        for k, node in enumerate(self.nodes[self._first :], self._first):
            node.insert_into(values, k)
        self._rebuild(values)

    def close(self, closures: Iterable[Closure]) -> None:
        """Add closures; where the earlier breadcrumb has left the window, it is fixed.

        Raises:
            EstimationError: the solver failed.
        """
        closures = list(closures)
        if not closures:
            return
        self.rest()
        graph = gtsam.NonlinearFactorGraph()
        for closure in closures:
            self.closures.append(closure)
            self._let_through(closure.i, closure.j)
            if closure.j >= self._first:
                graph.push_back(self._closure_factor(closure, self._first))
        if graph.size():
            with solving("a closure"):
                self._isam.update(graph, gtsam.Values())

    def refresh(self) -> Sequence[Node]:
        """Take the whole window over from iSAM2; all breadcrumbs as known now."""
        self.rest()
        self.nodes[self._first :] = self._read(self._isam.calculateBestEstimate())
        return self.nodes

    def glimpse(self) -> list[Node]:
        """The window as smoothed now. Only looks: later estimates are the same whether one asked or not."""
        self.rest()
        return self._read(self._isam.calculateEstimate())

    def _read(self, result: gtsam.Values) -> list[Node]:
        """The window's breadcrumbs of an estimate, each yaw unwrapped to lie near the one known before."""
        return [
            _near(
                self.nodes[k].yaw_rad,
                result.atPose2(X(k)),
                result.atDouble(Z(k)),
                result.atVector(B(k)),
                result.atDouble(D(k)),
            )
            for k in range(self._first, len(self.nodes))
        ]

    def _closure_factor(self, closure: Closure, first: int) -> gtsam.NonlinearFactor:
        if closure.i >= first:
            return closure_factor(closure)
        fixed = self.nodes[closure.i]
        return closure_prior(closure, fixed.x_m, fixed.y_m, fixed.yaw_rad)

    def _told(self) -> Told:
        return Told(self._first, self._graphs, self._compass, self.closures, self._closure_factor)

    def _next_move(self) -> WindowMove:
        join = self._first + self._config.window_steps
        by_qr = any(self._first < k <= join for k in self._after_gaps)
        return WindowMove(self._first, join, self._new_isam(), by_qr=by_qr)

    def _prepare(self, k: int) -> None:
        """Before the window moves, do a piece of what later steps hardly change any more; ``k`` is the latest."""
        size = self._config.window_steps
        left, settled = 2 * size - len(self._graphs), k - _UNSETTLED
        if self._ahead is not None:
            move, at, last = self._ahead
            move.piece(self._told(), at, last)
        elif left <= size // LEAVE + size // ENTER + 1 and settled >= self._first + LEAVE:
            values = self._isam.calculateBestEstimate()
            nodes = dict(enumerate(self._read(values), self._first))
            at = Known(values, nodes, self._compass.estimated(values, self._first, k))
            self._ahead = self._next_move(), at, settled

    def _let_through(self, i: int, j: int) -> None:
        """A factor between two breadcrumbs has come: a move that has done with them begins anew."""
        if self._ahead is not None and not self._ahead[0].takes(i, j):
            self._ahead = None

    def _shorten(self) -> None:
        """Move the window by half of it."""
        values = self._taken_over()
        at = Known(values, dict(enumerate(self.nodes[self._first :], self._first)), self._compass.iron_ut)
        move = self._ahead[0] if self._ahead is not None else self._next_move()
        move.finish(self._told(), at, len(self.nodes) - 1)
        # factors that come with the join itself look back from it
        self._graphs = [move.prior, *self._graphs[move.join - self._first + 1 :]]
        self._compass.forget(move.join)
        self._first, self._ahead = move.join, None
        self._past, self._isam = self._isam, move.tree

    def _rebuild(self, values: gtsam.Values) -> None:
        """A new tree of the window's breadcrumbs at once, which are at ``values``."""
        graph, last = gtsam.NonlinearFactorGraph(), len(self.nodes) - 1
        for part in self._graphs:
            graph.push_back(part)
        for factor in self._compass.again(self.nodes, self._first, last, self._compass.iron_ut):
            graph.add(factor)
        for closure in self.closures:
            if closure.j > self._first:
                graph.push_back(self._closure_factor(closure, self._first))
        for j in self._compass.states(self._first, last):
            if values.exists(I(j)):  # whichever of them the estimate knew
                values.erase(I(j))
            values.insert(I(j), self._compass.iron_ut[j] / UNIT_UT)
        self._isam, self._ahead = self._new_isam(), None
        with solving(f"step {last}"):
            self._isam.update(graph, values, constrainedKeys=at_root(self._compass, last))

    def _new_isam(self) -> gtsam.ISAM2:
        # until its first anchor, and after a gap, the walk hangs on a thread that Cholesky cannot see
        by_qr = self._places_known or bool(self._after_gaps)
        return new_tree(self._config, by_qr=by_qr, places_known=self._places_known)


def _near(yaw_rad: float, pose: gtsam.Pose2, z_m: float, gyroscope: FloatArray, isobar_m: float) -> Node:
    """A breadcrumb as solved, its yaw unwrapped to lie near the one given."""
    yaw_rad += wrap_scalar(pose.theta() - yaw_rad)
    return Node(pose.x(), pose.y(), z_m, yaw_rad, float(gyroscope[0]), isobar_m, float(gyroscope[1]))
