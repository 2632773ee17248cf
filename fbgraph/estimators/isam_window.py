"""The end of the walk in iSAM2, of a bounded size.

iSAM2 (Kaess et al., IJRR 2012) keeps a Bayes tree whose every update costs time in its size, so a tree of a day's walk
would be slow. It is kept to a window: when it has grown to twice ``window_steps``, the older half is eliminated
into one prior on the breadcrumb where the newer half begins (exact, to first order), and its breadcrumbs stay as
they were then.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, D, I, X, Z

from fbgraph.core.config import GraphConfig, OnlineConfig
from fbgraph.core.errors import EstimationError
from fbgraph.core.geometry import FloatArray, wrap_scalar
from fbgraph.estimators.aid_factors import closure_factor, closure_prior
from fbgraph.estimators.compass_factors import UNIT_UT
from fbgraph.estimators.compass_window import CompassWindow
from fbgraph.estimators.heading_chain import HeadingSolution
from fbgraph.estimators.node import Node
from fbgraph.front_end.step_track import Step
from fbgraph.way_back.records import Closure

_KEEP = 1e6  # a relinearisation threshold that is never reached: positions and biases are linear given yaw
_ANCHORED_M = 0.5  # but how far a robust anchor is believed depends on the place
_AIRED_M = 0.2  # and how far a robust barometer is on the altitude


class IsamWindow:
    """Factors of the latest breadcrumbs, solved as they come.

    Attributes:
        first: breadcrumb where the window begins.
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
        self.first = 0
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
        k = len(self.nodes)
        if not step.chained:
            self._after_gaps.append(k)
            self._rebuild(self.first, self._isam.calculateBestEstimate())  # by QR from now on
        self.nodes.append(node)
        self._graphs.append(graph)
        with_compass = gtsam.NonlinearFactorGraph(graph)
        self._compass.hear(k, step, node, with_compass, values)
        with _solving(f"step {k}"):
            self._isam.update(with_compass, values)
        self._latest()
        if len(self._graphs) >= 2 * self._config.window_steps:
            self._shorten()
        elif self._compass.iron_ut and self._compass.stale(k, self._iron()):
            self._rebuild(self.first, self._taken_over())
        return self.nodes[k]

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
        starts = np.flatnonzero(np.diff(heading.stretch)) + 1 + self.first
        result = self._taken_over()
        # where the compass is judged; the tree itself is linear in yaw
        for k, yaw_rad in enumerate(heading.yaw_rad.tolist(), self.first):
            node = self.nodes[k]
            self.nodes[k] = replace(node, yaw_rad=node.yaw_rad + wrap_scalar(yaw_rad - node.yaw_rad))
        self._compass.recalibrated(starts.tolist(), heading.jumps_ut, heading.iron_ut)
        self._rebuild(self.first, result)

    def _taken_over(self) -> gtsam.Values:
        """The window as solved now; breadcrumbs and iron are its from now on."""
        result = self._isam.calculateBestEstimate()
        self.nodes[self.first :] = self._read(result)
        self._compass.moved(len(self.nodes) - 1, result, self.first)
        return result

    def hold(self, k: int, factor: gtsam.NonlinearFactor) -> Node:
        """Add a factor on breadcrumb ``k`` of the window, and return the latest breadcrumb as solved.

        Raises:
            EstimationError: the solver failed.
        """
        graph = gtsam.NonlinearFactorGraph()
        graph.push_back(factor)
        self._graphs[k - self.first].push_back(factor)
        with _solving("an anchor"):
            self._isam.update(graph, gtsam.Values())
        return self._latest()

    def _latest(self) -> Node:
        """The latest breadcrumb as solved."""
        k = len(self.nodes) - 1
        with _solving(f"step {k}"):
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
        self._graphs[first - self.first :] = graphs
        self.nodes[first:] = nodes
        self._compass.turned(first, steps)
        values = gtsam.Values()
        for k, node in enumerate(self.nodes[self.first :], self.first):
            node.insert_into(values, k)
        self._rebuild(self.first, values)

    def close(self, closures: Iterable[Closure]) -> None:
        """Add closures; where the earlier breadcrumb has left the window, it is fixed.

        Raises:
            EstimationError: the solver failed.
        """
        graph = gtsam.NonlinearFactorGraph()
        for closure in closures:
            self.closures.append(closure)
            if closure.j >= self.first:
                graph.push_back(self._closure_factor(closure, self.first))
        if graph.size():
            with _solving("a closure"):
                self._isam.update(graph, gtsam.Values())

    def refresh(self) -> Sequence[Node]:
        """Take the whole window over from iSAM2; all breadcrumbs as known now."""
        self.nodes[self.first :] = self._read(self._isam.calculateBestEstimate())
        return self.nodes

    def glimpse(self) -> list[Node]:
        """The window as smoothed now. Only looks: later estimates are the same whether one asked or not."""
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
            for k in range(self.first, len(self.nodes))
        ]

    def _closure_factor(self, closure: Closure, first: int) -> gtsam.NonlinearFactor:
        if closure.i >= first:
            return closure_factor(closure)
        fixed = self.nodes[closure.i]
        return closure_prior(closure, fixed.x_m, fixed.y_m, fixed.yaw_rad)

    def _shorten(self) -> None:
        """Eliminate the older half of the window into a prior on the breadcrumb where the newer half begins."""
        result = self._taken_over()
        join = len(self.nodes) - self._config.window_steps
        split = join - self.first + 1  # factors that come with the join itself look back from it
        prior = self._eliminated(self._graphs[:split], join, result)
        self._graphs = [prior, *self._graphs[split:]]
        self._compass.forget(join)
        self._rebuild(join, result)

    def _rebuild(self, first: int, values: gtsam.Values) -> None:
        """A new tree of the breadcrumbs from ``first`` on; ``values`` are the window's, and lose what lies before."""
        graph = gtsam.NonlinearFactorGraph()
        for part in self._graphs:
            graph.push_back(part)
        for factor in self._compass.again(self.nodes, first, len(self.nodes) - 1):
            graph.add(factor)
        for closure in self.closures:
            if closure.j > first:
                graph.push_back(self._closure_factor(closure, first))
        for k in range(self.first, first):
            for key in (X(k), Z(k), B(k), D(k)):
                values.erase(key)
        for j in self._compass.states(self.first):  # whichever of them the estimate knew
            if values.exists(I(j)):
                values.erase(I(j))
        for j in self._compass.states(first):
            values.insert(I(j), self._compass.iron_ut[j] / UNIT_UT)
        self.first = first
        self._isam = self._new_isam()
        # the next breadcrumb is tied to the last one: far from the root, the whole tree would be made once more
        last, at_root = len(self.nodes) - 1, gtsam.KeyGroupMap()
        for key in (X(last), Z(last), B(last), D(last), *map(I, self._compass.states(last))):
            at_root.insert2(key, 1)
        with _solving(f"step {last}"):
            self._isam.update(graph, values, constrainedKeys=at_root)

    def _eliminated(
        self, graphs: Sequence[gtsam.NonlinearFactorGraph], join: int, result: gtsam.Values
    ) -> gtsam.NonlinearFactorGraph:
        """What these factors, and the closures among them, say of breadcrumb ``join`` once those before it are gone."""
        older = gtsam.NonlinearFactorGraph()
        for graph in graphs:
            older.push_back(graph)
        for closure in self.closures:
            if self.first < closure.j <= join:
                older.push_back(self._closure_factor(closure, self.first))
        for factor in self._compass.again(self.nodes, self.first, join):
            older.add(factor)
        gone = gtsam.Ordering()
        iron = self._compass.state_of(join)
        states = [j for j in self._compass.states(self.first) if iron is not None and j < iron]
        for k in range(self.first, join):
            # a state of the iron after its breadcrumbs: before them it would tie them all together
            while states and states[0] < (self._compass.state_of(k) or 0):
                gone.push_back(I(states.pop(0)))
            for key in (X(k), Z(k), B(k), D(k)):
                gone.push_back(key)
        for j in states:
            gone.push_back(I(j))
        if any(self.first < k <= join for k in self._after_gaps):
            kept = {X(join): 3, Z(join): 1, B(join): 2, D(join): 1, **({} if iron is None else {I(iron): 3})}
            return _eliminated_by_qr(older.linearize(result), gone, kept, result)
        _, remaining = older.linearize(result).eliminatePartialSequential(gone)
        prior = gtsam.NonlinearFactorGraph()
        for i in range(remaining.size()):
            prior.push_back(gtsam.LinearContainerFactor(remaining.at(i), result))
        return prior

    def _new_isam(self) -> gtsam.ISAM2:
        """Relinearises on yaw and altitude alone: positions and biases are linear given yaw."""
        config, params = self._config, gtsam.ISAM2Params()
        # until its first anchor, and after a gap, the walk hangs on a thread that Cholesky cannot see
        if self._places_known or self._after_gaps:
            params.setFactorization("QR")
        gauss_newton = gtsam.ISAM2GaussNewtonParams()
        gauss_newton.setWildfireThreshold(config.wildfire)
        params.setOptimizationParams(gauss_newton)
        thresholds = gtsam.ISAM2ThresholdMap()
        place = _ANCHORED_M if self._places_known else _KEEP
        thresholds.insert(("x", np.array([place, place, config.relinearize_yaw_rad])))
        thresholds.insert(("z", np.array([_AIRED_M])))
        thresholds.insert(("b", np.array([_KEEP, _KEEP])))
        thresholds.insert(("i", np.array([_KEEP, _KEEP, _KEEP])))
        thresholds.insert(("d", np.array([_AIRED_M])))
        params.setRelinearizeThreshold(thresholds)
        params.relinearizeSkip = config.relinearize_skip
        return gtsam.ISAM2(params)


@contextmanager
def _solving(where: str) -> Iterator[None]:
    """Says where iSAM2 failed."""
    try:
        yield
    except RuntimeError as error:
        raise EstimationError(f"iSAM2 failed at {where}: {str(error).strip().splitlines()[0]}") from error


def _eliminated_by_qr(
    linear: gtsam.GaussianFactorGraph, gone: gtsam.Ordering, kept: dict[int, int], result: gtsam.Values
) -> gtsam.NonlinearFactorGraph:
    """What linear factors say of the states that are kept, of so many numbers each, by a dense QR decomposition."""
    for key in kept:
        gone.push_back(key)
    a, b = linear.jacobian(gone)
    size = sum(kept.values())
    triangle = np.asarray(np.linalg.qr(np.column_stack((a, b)), mode="r"))
    left = triangle[: a.shape[1]][-size:]
    columns = np.split(left[:, -size - 1 : -1], np.cumsum([*kept.values()])[:-1], axis=1)
    terms = list(zip(kept, columns, strict=True))
    # the one class that takes any number of terms; a conditional of all of them is a factor on them
    factor = gtsam.GaussianConditional(terms, len(terms), left[:, -1], gtsam.noiseModel.Unit.Create(size))
    prior = gtsam.NonlinearFactorGraph()
    prior.push_back(gtsam.LinearContainerFactor(gtsam.JacobianFactor(factor), result))
    return prior


def _near(yaw_rad: float, pose: gtsam.Pose2, z_m: float, gyroscope: FloatArray, isobar_m: float) -> Node:
    """A breadcrumb as solved, its yaw unwrapped to lie near the one given."""
    yaw_rad += wrap_scalar(pose.theta() - yaw_rad)
    return Node(pose.x(), pose.y(), z_m, yaw_rad, float(gyroscope[0]), isobar_m, float(gyroscope[1]))
