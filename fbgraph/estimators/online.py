"""The trajectory while walking: the same steps and the same graph as the smoother's, solved by iSAM2 as they arrive.

iSAM2 (Kaess et al., IJRR 2012) keeps a Bayes tree whose every update costs time in its size, so a tree of a day's walk
would be slow. It is kept to a window: when it has grown to twice ``online.window_steps``, the older half is eliminated
into one prior on the breadcrumb where the newer half begins (exact, to first order), and its breadcrumbs stay as
they were then. ``finish`` puts all factors of the walk into one iSAM2 again and relinearises until nothing moves: the
batch smoother's answer. (A very long walk is given to the batch solver for that, which takes a third of the time.)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, X, Z

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import Config
from fbgraph.core.errors import DataError, EstimationError
from fbgraph.core.geometry import FloatArray, wrap_scalar
from fbgraph.core.log import Event, SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.graph import Graph, GraphBuilder, Node, Values, anchor_factor, anchor_sigma, closed_walk_factor
from fbgraph.estimators.residuals import factor_residuals
from fbgraph.estimators.smoother import Smoothed, on_deep_stack, smooth, tie_way_back, trajectory_of
from fbgraph.front_end.front_end import FrontEnd, Step, StepTrack
from fbgraph.front_end.leveller import LevelledSignals
from fbgraph.way_back.closures import Closure, closure_factor, closure_prior
from fbgraph.way_back.matcher import ReturnUpdate
from fbgraph.way_back.turn_back import TurnBack

_KEEP = 1e6  # a relinearisation threshold that is never reached: positions and biases are linear given yaw

_MOST_ISAM_STEPS = 10_000  # a longer walk is finished by the batch solver
_SETTLED = 1e-4  # metres and radians; what moves less has converged
_ANCHORED_M = 0.5  # but how far a robust anchor is believed depends on the place


@dataclass(frozen=True, slots=True)
class Update:
    """The estimate at the moment of a step, from what was known by then.

    Attributes:
        k: index of the breadcrumb; 0 is the standing start.
        t_s: time of the step, seconds since log start.
        x_m, y_m, z_m, yaw_rad, gyro_bias_rad_s: its state.
        distance_m: walked so far.
        returning: on the way back, where on the way out that is and what to do next.
    """

    k: int
    t_s: float
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    gyro_bias_rad_s: float
    distance_m: float
    returning: ReturnUpdate | None = None


class Companion(Protocol):
    """Somebody who is told every step and may say that an earlier breadcrumb is met again (``returning``)."""

    def note(self, events: Iterable[Event]) -> None:
        """Take events, before the steps that come with or after them."""

    def advance(
        self, update: Update, step: Step, estimate: Callable[[], Trajectory]
    ) -> tuple[ReturnUpdate | None, Iterable[Closure]]:
        """Take a step; ``estimate`` gives all breadcrumbs as known now."""


@dataclass(frozen=True)
class Belief:
    """Where the online smoother believed the recent walk to lie, at the moment of a step.

    Attributes:
        k: index of the latest breadcrumb.
        t_s: its time, seconds since log start.
        first: index of the first breadcrumb in ``xy_m``; those before it had left the window and stay as they were.
        xy_m: (k - first + 1, 2) places of breadcrumbs ``first`` … ``k``.
    """

    k: int
    t_s: float
    first: int
    xy_m: FloatArray


class OnlineSmoother:
    """Samples in, updates out.

    Example:
        >>> smoother = OnlineSmoother(load_config("m5stickc"))
        >>> for piece in pieces:                     # SensorLogs in order of time, any length
        ...     for update in smoother.feed(piece):
        ...         print(update.t_s, update.x_m, update.y_m)
        >>> walk = smoother.finish().trajectory      # everything, smoothed
    """

    def __init__(
        self,
        config: Config,
        anchors: Checkpoints | None = None,
        t0_s: float = 0.0,
        closed_walk: bool = False,
        *,
        companion: Companion | None = None,
        believe_steps: int = 0,
    ) -> None:
        """A smoother for one walk.

        Args:
            config: the effective configuration.
            anchors: known places, each used once the walk has passed its time; the result is in their frame.
            t0_s: brings the samples' times to the anchors' clock.
            closed_walk: ``finish`` may assume that the walk ended where it began.
            companion: told every step; its closures enter the graph from the next step on.
            believe_steps: keep a ``Belief`` every so many steps; none if 0.
        """
        self._config = config
        self._front_end = FrontEnd(config)
        self._anchors = anchors
        self._t0_s = t0_s
        self._first_compass_rad = math.nan
        self._closed_walk = closed_walk
        self._builder: GraphBuilder | None = None  # made with the first steps
        self._next_anchor = 0
        self._steps: list[Step] = []
        self._updates: list[Update] = []
        self._nodes: list[Node] = []  # of each breadcrumb: while in the window a guess, after it for good
        self._extra: list[Any] = []  # anchor factors
        self._companion = companion
        self._closures: list[Closure] = []
        self._window: list[Graph] = []  # the factors that came with each breadcrumb of the window
        self._first = 0  # breadcrumb where the window begins
        self._isam = gtsam.ISAM2(_isam_params(config, anchors is not None))
        self.turn_back: TurnBack | None = None
        """Where ``finish`` found that the walk turns back, if the companion had not."""
        self.beliefs: list[Belief] = []
        """What the walk was taken to be at every ``believe_steps``-th step, if anybody wants to know."""
        self._believe_steps = believe_steps
        self.signals: LevelledSignals | None = None
        """What the last ``feed`` levelled, for who wants to show it."""

    def feed(self, samples: SensorLog) -> list[Update]:
        """Take the next samples and return the estimate at each step that they complete.

        Args:
            samples: later than all before; any stream may be empty.

        Raises:
            EstimationError: the solver failed.
        """
        if self._companion is not None:
            self._companion.note(samples.events)
        steps, self.signals = self._front_end.feed(samples)
        return self._advance(steps)

    def estimate(self) -> Trajectory:
        """All breadcrumbs as known now: the window smoothed, older ones as they were when they left it.

        Raises:
            DataError: no step yet.
        """
        self._require_steps()
        self._refresh()
        columns = np.array([(n.x_m, n.y_m, n.z_m, n.yaw_rad, n.bias_rad_s) for n in self._nodes]).T
        return Trajectory(np.array([s.t_s for s in self._steps]), *columns)

    def belief(self) -> Belief:
        """The window as smoothed now. Only looks: later estimates are the same whether one asked or not.

        Raises:
            DataError: no step yet.
        """
        self._require_steps()
        nodes = self._read_window(self._isam.calculateEstimate())
        xy_m = np.array([(node.x_m, node.y_m) for node in nodes])
        return Belief(len(self._steps) - 1, self._steps[-1].t_s, self._first, xy_m)

    @property
    def steps(self) -> Sequence[Step]:
        """The steps so far, the standing start among them."""
        return self._steps

    @property
    def track(self) -> StepTrack:
        """The steps so far."""
        return StepTrack.of(self._steps)

    @property
    def causal(self) -> Trajectory:
        """Each breadcrumb as it was estimated at the moment of its step: ``online.tum``."""
        self._require_steps()
        rows = [(u.t_s, u.x_m, u.y_m, u.z_m, u.yaw_rad, u.gyro_bias_rad_s) for u in self._updates]
        return Trajectory(*np.array(rows).T)

    def finish(self) -> Smoothed:
        """Take what was held back, then smooth the whole walk.

        Its closures are those of the companion; without any, a way back is looked for as in the batch smoother.

        Raises:
            DataError: no step in the samples.
            EstimationError: the solver failed.
        """
        smoothed = self._finish()
        if self._config.returning.out_and_back and not self._closures:
            known = (self._config, self._anchors, self._t0_s, self._closed_walk)
            smoothed, self.turn_back = tie_way_back(smoothed, self.track, self.estimate(), *known)
        return smoothed

    def _finish(self) -> Smoothed:
        self._advance(self._front_end.finish()[0])
        self._require_steps()
        self._refresh()
        self._take_anchors(math.inf)
        if len(self._steps) > _MOST_ISAM_STEPS:  # the same answer, sooner
            return smooth(
                self.track,
                self.estimate(),
                self._config.graph,
                self._config.solver,
                self._anchors,
                self._t0_s,
                self._closed_walk,
                closures=self._closures,
            )
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        builder = self._new_builder(self._steps[1])
        previous: Node | None = None
        for step, node in zip(self._steps, self._nodes, strict=True):
            builder.add(step, node, previous, graph, values)
            previous = node
        for factor in (*self._extra, *map(closure_factor, self._closures)):
            graph.push_back(factor)
        if self._closed_walk:
            graph.push_back(closed_walk_factor(len(self._steps) - 1, self._config.graph))
        try:
            result, marginals, errors = on_deep_stack(lambda: self._solve_whole(graph, values), len(self._steps))
        except RuntimeError as error:
            raise EstimationError(f"iSAM2 failed at the end: {str(error).strip().splitlines()[0]}") from error
        anchored = self._anchors is not None and len(self._anchors) > 1
        return Smoothed(
            trajectory=trajectory_of(self.track, result, marginals, self._config.graph, anchored),
            errors=errors,
            factors=graph.size(),
            residuals=factor_residuals(graph, result),
            closures=tuple(self._closures),
        )

    def _solve_whole(self, graph: Graph, values: Values) -> tuple[Values, object, FloatArray]:
        """All factors in one iSAM2, relinearised until nothing moves."""
        params = _isam_params(self._config, self._anchors is not None)
        params.setRelinearizeThreshold(0.0)
        params.relinearizeSkip = 1
        isam = gtsam.ISAM2(params)
        isam.update(graph, values)
        result = isam.calculateBestEstimate()
        errors = [graph.error(values), graph.error(result)]
        while len(errors) <= self._config.solver.max_iterations:
            isam.update()
            before, result = result, isam.calculateBestEstimate()
            errors.append(graph.error(result))
            if np.abs(before.localCoordinates(result).vector()).max() < _SETTLED:
                break
        return result, gtsam.Marginals(graph, result), np.array(errors)

    def _new_builder(self, first: Step) -> GraphBuilder:
        anchored = self._anchors is not None
        return GraphBuilder(
            self._config.graph,
            compass=math.isfinite(first.yaw_mag_rad),
            free_origin=anchored,
            turned=self._anchors is not None and len(self._anchors) > 1,
            aided=anchored or self._closed_walk,
        )

    def _require_steps(self) -> None:
        if not self._steps:
            raise DataError("no step found: nobody walks in these samples")

    def _advance(self, steps: list[Step]) -> list[Update]:
        if steps and self._builder is None:
            self._builder = self._new_builder(steps[1])  # a walk begins with its start and several steps at once
            self._first_compass_rad = steps[1].yaw_mag_rad
        return [self._add(step) for step in steps]

    def _add(self, step: Step) -> Update:
        """One breadcrumb more: seeded from iSAM2's latest estimate, solved, and read out."""
        assert self._builder is not None  # made before the first step is added
        k = len(self._steps)
        previous = self._nodes[-1] if k else None
        node = self._seed(step, previous)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._builder.add(step, node, previous, graph, values)
        self._steps.append(step)
        self._nodes.append(node)
        for factor in self._take_anchors(step.t_s):
            graph.push_back(factor)
        self._window.append(graph)
        try:
            self._isam.update(graph, values)
            node = self._node(k, node.yaw_rad)
        except RuntimeError as error:
            raise EstimationError(f"iSAM2 failed at step {k}: {str(error).strip().splitlines()[0]}") from error
        self._nodes[k] = node
        walked = self._updates[-1].distance_m if self._updates else 0.0
        update = Update(
            k, step.t_s, node.x_m, node.y_m, node.z_m, node.yaw_rad, node.bias_rad_s, walked + step.length_m
        )
        self._updates.append(update)
        if len(self._window) >= 2 * self._config.online.window_steps:
            self._shorten_window()
        if self._companion is not None:
            told, closures = self._companion.advance(update, step, self.estimate)
            self._close(closures)
            update = replace(update, returning=told)
            self._updates[k] = update
        if self._believe_steps and k and k % self._believe_steps == 0:
            self.beliefs.append(self.belief())
        return update

    def _close(self, closures: Iterable[Closure]) -> None:
        """Add closures to the tree; where their earlier breadcrumb has left the window, it is fixed."""
        graph = gtsam.NonlinearFactorGraph()
        for closure in closures:
            self._closures.append(closure)
            if closure.j >= self._first:
                graph.push_back(self._closure_factor(closure, self._first))
        if graph.size():
            try:
                self._isam.update(graph, gtsam.Values())
            except RuntimeError as error:
                raise EstimationError(f"iSAM2 failed at a closure: {str(error).strip().splitlines()[0]}") from error

    def _closure_factor(self, closure: Closure, first: int) -> Any:
        if closure.i >= first:
            return closure_factor(closure)
        fixed = self._nodes[closure.i]
        return closure_prior(closure, fixed.x_m, fixed.y_m, fixed.yaw_rad)

    def _seed(self, step: Step, previous: Node | None) -> Node:
        if previous is None:
            compass = self._first_compass_rad
            return Node(0.0, 0.0, 0.0, compass if math.isfinite(compass) else 0.0, 0.0)
        before = self._steps[-1]
        turned = step.yaw_gyro_rad - before.yaw_gyro_rad - previous.bias_rad_s * (step.yaw_s - before.yaw_s)
        if not step.chained and math.isfinite(step.yaw_mag_rad):
            turned = wrap_scalar(step.yaw_mag_rad - previous.yaw_rad)
        yaw = previous.yaw_rad + turned
        x_m = previous.x_m + step.length_m * math.cos(yaw)
        y_m = previous.y_m + step.length_m * math.sin(yaw)
        return Node(x_m, y_m, previous.z_m, yaw, previous.bias_rad_s)

    def _take_anchors(self, now_s: float) -> list[Any]:
        """Factors of the anchors whose time has come, at the breadcrumb nearest in time as in the batch graph."""
        factors: list[Any] = []
        anchors = self._anchors
        while anchors is not None and self._next_anchor < len(anchors):
            at_s = anchors.t_s[self._next_anchor] - self._t0_s
            if at_s > now_s:
                break
            k = len(self._steps) - 1
            if k > 0 and abs(self._steps[k - 1].t_s - at_s) <= abs(self._steps[k].t_s - at_s):
                k -= 1
            x_m, y_m = anchors.x_m[self._next_anchor], anchors.y_m[self._next_anchor]
            length_m = self._steps[k].length_m if k else 0.0
            sigma = anchor_sigma(anchors.sigma_m[self._next_anchor], length_m, self._config.graph)
            factor = anchor_factor(k, float(x_m), float(y_m), sigma)
            factors.append(factor)
            self._extra.append(factor)
            self._next_anchor += 1
        return factors

    def _node(self, k: int, near_yaw_rad: float) -> Node:
        """iSAM2's estimate of a breadcrumb, its yaw unwrapped to lie near the one given."""
        pose = self._isam.calculateEstimatePose2(X(k))
        yaw = near_yaw_rad + wrap_scalar(pose.theta() - near_yaw_rad)
        z_m, bias = self._isam.calculateEstimateDouble(Z(k)), self._isam.calculateEstimateDouble(B(k))
        return Node(pose.x(), pose.y(), z_m, yaw, bias)

    def _read_window(self, result: Values) -> list[Node]:
        """The window's breadcrumbs of an estimate of iSAM2, each yaw unwrapped to lie near the one known before."""
        nodes = []
        for k in range(self._first, len(self._steps)):
            pose, near = result.atPose2(X(k)), self._nodes[k].yaw_rad
            yaw = near + wrap_scalar(pose.theta() - near)
            nodes.append(Node(pose.x(), pose.y(), result.atDouble(Z(k)), yaw, result.atDouble(B(k))))
        return nodes

    def _refresh(self) -> None:
        """Take the whole window over from iSAM2."""
        self._nodes[self._first :] = self._read_window(self._isam.calculateBestEstimate())

    def _shorten_window(self) -> None:
        """Eliminate the older half of the window into a prior on the breadcrumb where the newer half begins."""
        self._refresh()
        join = len(self._steps) - self._config.online.window_steps
        result = self._isam.calculateBestEstimate()
        older = gtsam.NonlinearFactorGraph()
        split = join - self._first + 1  # factors that come with the join itself look back from it
        for graph in self._window[:split]:
            older.push_back(graph)
        for closure in self._closures:
            if self._first < closure.j <= join:
                older.push_back(self._closure_factor(closure, self._first))
        gone = gtsam.Ordering()
        for k in range(self._first, join):
            for key in (X(k), Z(k), B(k)):
                gone.push_back(key)
        _, remaining = older.linearize(result).eliminatePartialSequential(gone)
        prior = gtsam.NonlinearFactorGraph()
        for i in range(remaining.size()):
            prior.push_back(gtsam.LinearContainerFactor(remaining.at(i), result))
        window = [prior, *self._window[split:]]
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for part in window:
            graph.push_back(part)
        for closure in self._closures:
            if closure.j > join:
                graph.push_back(self._closure_factor(closure, join))
        for k in range(join, len(self._steps)):
            values.insert(X(k), result.atPose2(X(k)))
            values.insert(Z(k), result.atDouble(Z(k)))
            values.insert(B(k), result.atDouble(B(k)))
        self._isam = gtsam.ISAM2(_isam_params(self._config, self._anchors is not None))
        self._isam.update(graph, values)
        self._window, self._first = window, join


def _isam_params(config: Config, free_origin: bool) -> gtsam.ISAM2Params:
    """Relinearise on yaw alone: positions and biases are linear given yaw."""
    params = gtsam.ISAM2Params()
    if free_origin:  # until its first anchor the walk hangs on a thread that Cholesky cannot see
        params.setFactorization("QR")
    gauss_newton = gtsam.ISAM2GaussNewtonParams()
    gauss_newton.setWildfireThreshold(config.online.wildfire)
    params.setOptimizationParams(gauss_newton)
    thresholds = gtsam.ISAM2ThresholdMap()
    place = _ANCHORED_M if free_origin else _KEEP
    thresholds.insert(("x", np.array([place, place, config.online.relinearize_yaw_rad])))
    thresholds.insert(("z", np.array([_KEEP])))
    thresholds.insert(("b", np.array([_KEEP])))
    params.setRelinearizeThreshold(thresholds)
    params.relinearizeSkip = config.online.relinearize_skip
    return params
