"""The trajectory while walking: the same steps and the same graph as the smoother's, solved by iSAM2 as they arrive."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Protocol

import gtsam
import numpy as np

from fbgraph.core.aids import Aids
from fbgraph.core.config import Config
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import wrap_scalar
from fbgraph.core.sensor_log import Event, SensorLog
from fbgraph.core.trajectory import Breadcrumb, Trajectory
from fbgraph.estimators.batch_smoother import smooth, tie_way_back
from fbgraph.estimators.building_axis import lay_along_axis
from fbgraph.estimators.estimates import Belief, Smoothed, Update
from fbgraph.estimators.factor_graph import GraphBuilder
from fbgraph.estimators.gyroscope import gyro_turn
from fbgraph.estimators.heading_chain import solve_heading
from fbgraph.estimators.isam_window import IsamWindow
from fbgraph.estimators.node import Node
from fbgraph.estimators.online_anchors import OnlineAnchors
from fbgraph.front_end.carrying import Carrying
from fbgraph.front_end.detect_steps import FrontEnd
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import Step, StepTrack
from fbgraph.way_back.records import Closure, ReturnUpdate, TurnBack

_JUDGED_AFTER = (12, 25, 50, 100)  # steps
_LOOKED_EVERY = 40  # steps, until the window moves: from no iron at all the way to much of it is long


class Companion(Protocol):
    """Somebody who is told every step and may say that an earlier breadcrumb is met again."""

    def note(self, events: Iterable[Event]) -> None:
        """Take events, before the steps that come with or after them."""

    def advance(
        self, update: Breadcrumb, step: Step, estimate: Callable[[], Trajectory]
    ) -> tuple[ReturnUpdate | None, Iterable[Closure]]:
        """Take a step; ``estimate`` gives all breadcrumbs as known now."""


class OnlineSmoother:
    """Samples in, updates out.

    Attributes:
        turn_back: where ``finish`` found that the walk turns back, if the companion had not.
        beliefs: what the walk was taken to be at every ``believe_steps``-th step.
        signals: what the last ``feed`` levelled, for who wants to show it.

    Example:
        >>> smoother = OnlineSmoother(load_config("m5stickc"))
        >>> for piece in pieces:                     # SensorLogs in order of time, any length
        ...     for update in smoother.feed(piece):
        ...         print(update.t_s, update.x_m, update.y_m)
        >>> walk = smoother.finish().trajectory      # everything, smoothed
    """

    def __init__(
        self, config: Config, aids: Aids | None = None, *, companion: Companion | None = None, believe_steps: int = 0
    ) -> None:
        """A smoother for one walk.

        Args:
            config: the effective configuration.
            aids: anchors, each used once the walk has passed its time (the result is in their frame); a closed end,
                which only ``finish`` can use.
            companion: told every step; its closures enter the graph from the next step on.
            believe_steps: keep a ``Belief`` every so many steps; none if 0.
        """
        self._config = config
        self._aids = aids or Aids()
        self._companion = companion
        self._believe_steps = believe_steps
        self._front_end = FrontEnd(config)
        self._carrying = Carrying(config.carrying)
        self._builder: GraphBuilder | None = None  # made with the first steps
        self._window = IsamWindow(config.online, config.graph, self._aids.places_known)
        self._anchors = OnlineAnchors(self._aids.anchors, config.graph)
        self._anchored: dict[int, list[gtsam.PoseTranslationPrior2D]] = {}  # by breadcrumb
        self._unjudged = False  # whether iron is to be looked for after the latest step
        self._jumped: list[int] = []  # breadcrumbs where the magnetometer's zero seems to
        self._steps: list[Step] = []
        self._updates: list[Update] = []
        self.turn_back: TurnBack | None = None
        self.beliefs: list[Belief] = []
        self.signals: LevelledSignals | None = None

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
        if not steps:
            self._rest()
        return self._advance(steps)

    def estimate(self) -> Trajectory:
        """All breadcrumbs as known now: the window smoothed, older ones as they were when they left it.

        Raises:
            DataError: no step yet.
        """
        return self._anchors.walk(self._own_estimate())

    def _own_estimate(self) -> Trajectory:
        """The same in the walk's own frame, which begins at the origin."""
        self._require_steps()
        self._rest()
        columns = np.array([(n.x_m, n.y_m, n.z_m, n.yaw_rad, n.bias_rad_s) for n in self._window.refresh()]).T
        return Trajectory(np.array([s.t_s for s in self._steps]), *columns)

    def belief(self) -> Belief:
        """The window as smoothed now. Only looks: later estimates are the same whether one asked or not.

        Raises:
            DataError: no step yet.
        """
        self._require_steps()
        xy_m = np.array([(node.x_m, node.y_m) for node in self._window.glimpse()])
        return Belief(len(self._steps) - 1, self._steps[-1].t_s, self._window.first, self._anchors.places(xy_m))

    @property
    def steps(self) -> Sequence[Step]:
        """The steps so far, the standing start among them."""
        return self._steps

    @property
    def track(self) -> StepTrack:
        """The steps so far."""
        return StepTrack(self._steps)

    @property
    def causal(self) -> Trajectory:
        """Each breadcrumb as it was estimated at the moment of its step: ``online.tum``."""
        self._require_steps()
        rows = [(u.t_s, u.x_m, u.y_m, u.z_m, u.yaw_rad, u.gyro_bias_rad_s) for u in self._updates]
        return Trajectory(*np.array(rows).T)

    def finish(self) -> Smoothed:
        """Take what was held back, then smooth the whole walk from where iSAM2 left it.

        Its closures are those of the companion; without any, a way back is looked for as in the batch smoother.

        Raises:
            DataError: no step in the samples.
            EstimationError: the solver failed.
        """
        self._advance(self._front_end.finish()[0])
        self._rest()
        self._rewrite(self._carrying.finish())
        config, track, known = self._config, self.track, self._own_estimate()
        smoothed = smooth(track, known, config.graph, config.solver, self._aids, self._window.closures)
        if config.returning.out_and_back and not self._window.closures:
            smoothed, self.turn_back = tie_way_back(smoothed, track, known, config, self._aids)
        return lay_along_axis(smoothed, track, self._aids, config.graph)

    def _require_steps(self) -> None:
        if not self._steps:
            raise DataError("no step found: nobody walks in these samples")

    def _advance(self, steps: list[Step]) -> list[Update]:
        updates = []
        for measured in steps:
            self._rest()
            self._rewrite(self._carrying.add(measured))
            (step,) = self._carrying.steps(len(self._steps))
            if self._builder is None:  # a walk begins with its start and several steps at once
                compass_rad = steps[1].yaw_mag_rad
                self._builder = GraphBuilder(self._config.graph, self._aids, compass=math.isfinite(compass_rad))
                node = Node(0.0, 0.0, 0.0, compass_rad if math.isfinite(compass_rad) else 0.0, 0.0)
            else:
                node = self._seed(step, self._steps[-1], self._window.nodes[-1])
            updates.append(self._add(self._builder, step, node))
        return updates

    def _add(self, builder: GraphBuilder, step: Step, node: Node) -> Update:
        """One breadcrumb more: seeded from iSAM2's latest estimate, solved, and read out."""
        k = len(self._steps)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        builder.add(step, node, self._window.nodes[-1] if k else None, graph, values)
        self._steps.append(step)
        node = self._window.add(graph, values, node, step)
        if self._anchors.waiting(step.t_s):
            walk = self._own_estimate()
            for at, factor in self._anchors.due(self._steps, walk, self._window.first, builder.compass):
                node = self._window.hold(at, factor)
                self._anchored.setdefault(at, []).append(factor)
        if step.jump_x_ut or step.jump_y_ut:
            self._jumped.append(k)
        self._unjudged = True
        walked_m = (self._updates[-1].distance_m if self._updates else 0.0) + step.length_m
        update = Update(k, step.t_s, node.x_m, node.y_m, node.z_m, node.yaw_rad, node.bias_rad_s, walked_m)
        if self._companion is not None:
            # the way back is known by distances and turns: it needs no frame, and none may change under it
            told, closures = self._companion.advance(update, step, self._own_estimate)
            if closures := tuple(closures):
                self._rest()  # what was due before them
                self._window.close(closures)
        else:
            told = None
        x_m, y_m, yaw_rad = self._anchors.seen(update)
        update = replace(update, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, returning=told)
        self._updates.append(update)
        if self._believe_steps and k and k % self._believe_steps == 0:
            self.beliefs.append(self.belief())
        return update

    def _rest(self) -> None:
        """Do what changes the next estimate but not the last: when no step has come, or before the next."""
        self._window.rest()
        if self._unjudged:
            self._unjudged = False
            self._judge_iron(len(self._steps) - 1)

    def _judge_iron(self, k: int) -> None:
        """Now and then ask whether a jump of the magnetometer, or more iron than is known of, explains the walk."""
        due = any(k - at in _JUDGED_AFTER and at > self._window.first for at in self._jumped)
        if not due and (self._window.first or k == 0 or k % _LOOKED_EVERY):
            return
        known = self._window.refresh()[self._window.first :]
        seed = np.array([node.yaw_rad for node in known]), np.array([node.bias_rad_s for node in known])
        heading = solve_heading(StepTrack(self._steps[self._window.first :]), [seed], self._config.graph)
        if len(heading.jumps_ut) or self._window.misjudged(heading):
            self._window.recalibrate(heading)

    def _rewrite(self, first: int) -> None:
        """From step ``first`` on the device was held otherwise than believed: walk these steps again."""
        last, window = len(self._steps), self._window
        if first >= last or self._builder is None:
            return
        nodes, believed = list(window.refresh()), self._steps.copy()
        self._steps[first:] = self._carrying.steps(first)[: last - first]
        first = max(first, window.first + 1 if window.first else 0)  # what left the window stays as it was
        if first == 0 and math.isfinite(self._steps[1].yaw_mag_rad):
            turned_rad = self._steps[0].mount_rad - believed[0].mount_rad
            nodes[0] = replace(nodes[0], yaw_rad=nodes[0].yaw_rad + turned_rad)
        self._builder.rewind(first, believed[first - 1] if first else None)
        graphs = [gtsam.NonlinearFactorGraph() for _ in range(first, last)]
        for k, graph in enumerate(graphs, first):
            if k:
                before = believed[k - 1] if k == first else self._steps[k - 1]
                nodes[k] = self._seed(self._steps[k], before, nodes[k - 1])
            self._builder.add(self._steps[k], nodes[k], nodes[k - 1] if k else None, graph, gtsam.Values())
            for factor in self._anchored.get(k, ()):
                graph.push_back(factor)
        window.rewrite(first, graphs, nodes[first:], self._steps[first:])

    def _seed(self, step: Step, before: Step, previous: Node) -> Node:
        """Where the next breadcrumb should be, by dead reckoning from the one before."""
        turned = 0.0
        if step.chained:
            turn = gyro_turn(before, step, self._config.graph)
            turned = (1.0 - previous.gyro_scale) * turn.turned_rad - previous.bias_rad_s * turn.moving_s
        elif math.isfinite(step.yaw_mag_rad):
            turned = wrap_scalar(step.yaw_mag_rad - previous.yaw_rad)
        yaw = previous.yaw_rad + turned
        x_m = previous.x_m + step.length_m * math.cos(yaw)
        y_m = previous.y_m + step.length_m * math.sin(yaw)
        z_m, isobar_m = previous.z_m + step.carried_m, previous.isobar_m - step.blown_m
        return Node(x_m, y_m, z_m, yaw, previous.bias_rad_s, isobar_m, previous.gyro_scale)
