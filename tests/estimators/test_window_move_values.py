"""A move of the window that is done in pieces says what one at once says, whatever comes meanwhile."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from support.factors import Array, walk_track
from support.windows import CONFIG, next_node, walked

from fbgraph.core.aids import Aids
from fbgraph.core.config import OnlineConfig
from fbgraph.estimators import isam_window
from fbgraph.estimators.factor_graph import GraphBuilder
from fbgraph.estimators.isam_window import IsamWindow
from fbgraph.estimators.noise_models import sigmas
from fbgraph.estimators.window_move import WindowMove
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.records import Closure

ONLINE = OnlineConfig(window_steps=80)
STEPS = 172  # the window moves at breadcrumb 159; what is done beforehand, from 147 on


@pytest.fixture(scope="module")
def track() -> StepTrack:
    """A wavy walk, noisy, its compass too."""
    rng = np.random.default_rng(5)
    yaw = 0.8 * np.sin(np.arange(STEPS) / 15.0)
    compass, altitude = yaw + rng.normal(0, 0.03, STEPS), 300 + rng.normal(0, 0.1, STEPS)
    track = walk_track(yaw, compass=compass, bias_rad_s=0.004, altitude_m=altitude)
    return StepTrack(
        [
            replace(s, yaw_gyro_rad=s.yaw_gyro_rad + 0.02 * float(rng.normal())) if k else s
            for k, s in enumerate(track.steps)
        ]
    )


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Nothing is ever settled."""
    monkeypatch.setattr(isam_window, "_UNSETTLED", 10**6)
    return monkeypatch


def end_of(window: IsamWindow) -> Array:
    assert window.first == 80
    return np.array([(n.x_m, n.y_m, n.z_m, n.yaw_rad) for n in window.refresh()[-30:]])


def begun(window: IsamWindow) -> bool:
    return window._ahead is not None


@pytest.mark.parametrize(
    "closures",
    [
        {},
        {100: Closure(30, 95, 0.3, 0.1)},
        {60: Closure(20, 56, 0.2, 0.2), 90: Closure(40, 80, 0.2, -0.2), 120: Closure(79, 110, 0.5, 0.5)},
        {150: Closure(90, 150, 0.3, 0.1), 152: Closure(10, 152, 0.4, 0.1)},
        {154: Closure(20, 60, 0.4, 0.2), 155: Closure(85, 95, 0.4, 0.2)},
    ],
    ids=["none", "across the join", "in the older half", "while it is done", "to what is done already"],
)
def test_in_pieces_as_at_once(
    track: StepTrack, closures: Mapping[int, Closure], monkeypatch: pytest.MonkeyPatch
) -> None:
    pieces: list[bool] = []
    one = WindowMove.piece

    def counted(self: WindowMove, *args: Any) -> bool:
        pieces.append(one(self, *args))
        return pieces[-1]

    monkeypatch.setattr(WindowMove, "piece", counted)
    spread = end_of(walked(track, ONLINE, closures))
    assert sum(pieces) >= (1 if 154 in closures else 2)
    monkeypatch.setattr(isam_window, "_UNSETTLED", 10**6)
    pieces.clear()
    whole = end_of(walked(track, ONLINE, closures))
    assert pieces == []
    assert np.abs(spread - whole).max() < 2e-3


def test_a_factor_on_what_is_done_begins_the_move_anew(track: StepTrack, at_once: pytest.MonkeyPatch) -> None:
    ends = []
    for unsettled in (10**6, 50):
        at_once.setattr(isam_window, "_UNSETTLED", unsettled)
        window, builder = IsamWindow(ONLINE, CONFIG, False), GraphBuilder(CONFIG, Aids(), compass=True)
        for k, step in enumerate(track.steps):
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            node = next_node(track, k, window.nodes)
            builder.add(step, node, window.nodes[-1] if k else None, graph, values)
            window.add(graph, values, node, step)
            if k == 155:
                assert begun(window) == (unsettled == 50)
                place = gtsam.Pose2(window.nodes[85].x_m + 2.0, window.nodes[85].y_m - 1.0, 0.0)
                window.hold(85, gtsam.PoseTranslationPrior2D(X(85), place, sigmas(0.1, 0.1)))
                assert not begun(window)
        ends.append(end_of(window))
    assert np.abs(ends[1] - ends[0]).max() < 2e-2
    assert np.abs(ends[1] - end_of(walked(track, ONLINE))).max() > 0.5


def test_breadcrumbs_taken_anew_while_a_move_is_done(track: StepTrack, at_once: pytest.MonkeyPatch) -> None:
    """The device was turned in the hand from breadcrumb 85 on, as is known at 155."""
    ends = []
    for unsettled in (10**6, 50):
        at_once.setattr(isam_window, "_UNSETTLED", unsettled)
        steps = [replace(s, yaw_gyro_rad=s.yaw_gyro_rad + 0.4) if k > 85 else s for k, s in enumerate(track.steps)]
        window, builder = IsamWindow(ONLINE, CONFIG, False), GraphBuilder(CONFIG, Aids(), compass=True)
        for k in range(len(steps)):
            graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            now = StepTrack(steps if k > 155 else track.steps)
            node = next_node(now, k, window.nodes)
            builder.add(now.steps[k], node, window.nodes[-1] if k else None, graph, values)
            window.add(graph, values, node, now.steps[k])
            if k == 155:
                nodes = list(window.refresh())
                builder.rewind(86, steps[85])
                graphs = [gtsam.NonlinearFactorGraph() for _ in range(86, k + 1)]
                for i, graph in enumerate(graphs, 86):
                    nodes[i] = next_node(StepTrack(steps), i, nodes[:i])
                    builder.add(steps[i], nodes[i], nodes[i - 1], graph, gtsam.Values())
                window.rewrite(86, graphs, nodes[86:], steps[86 : k + 1])
                assert not begun(window)
        ends.append(end_of(window))
    assert np.abs(ends[1] - ends[0]).max() < 5e-3
    assert math.isfinite(ends[0].sum())
