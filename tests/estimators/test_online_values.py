"""The online smoother step by step: what it reports, believes, hands on and anchors."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest
from support.simulated import perfect
from support.walking import feed

from fbgraph.core.aids import Aids
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import load_config
from fbgraph.core.errors import DataError
from fbgraph.core.sensor_log import Event, SensorLog
from fbgraph.core.trajectory import Breadcrumb, Trajectory
from fbgraph.estimators.batch_smoother import smooth
from fbgraph.estimators.estimates import Update
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.front_end.step_track import Step
from fbgraph.way_back.records import Closure, ReturnUpdate

CONFIG = load_config("m5stickc", ["returning.out_and_back=false", "online.window_steps=20"])


@pytest.fixture(scope="module")
def log() -> SensorLog:
    return perfect("square").log


@pytest.fixture(scope="module")
def plain(log: SensorLog) -> tuple[OnlineSmoother, list[Update]]:
    smoother = OnlineSmoother(CONFIG)
    return smoother, feed(smoother, log, 5.0)


Plain = tuple[OnlineSmoother, list[Update]]


def test_there_is_an_update_at_every_step_with_the_distance_walked(plain: Plain) -> None:
    smoother, updates = plain
    track = smoother.track
    assert [u.k for u in updates] == list(range(len(track)))
    assert [u.t_s for u in updates] == track.t_s.tolist()
    assert np.allclose([u.distance_m for u in updates], np.cumsum(track.length_m))
    assert smoother.steps == list(track.steps)
    assert all(u.returning is None for u in updates)


def test_the_causal_trajectory_is_the_updates(plain: Plain) -> None:
    smoother, updates = plain
    causal = smoother.causal
    assert causal.t_s.tolist() == [u.t_s for u in updates]
    assert causal.xy_m.tolist() == [[u.x_m, u.y_m] for u in updates]
    assert causal.z_m.tolist() == [u.z_m for u in updates]
    assert causal.yaw_rad.tolist() == [u.yaw_rad for u in updates]
    assert causal.gyro_bias_rad_s.tolist() == [u.gyro_bias_rad_s for u in updates]


def test_the_latest_update_is_the_latest_breadcrumb_of_the_estimate(plain: Plain) -> None:
    smoother, updates = plain
    known = smoother.estimate()
    assert len(known) == len(updates)
    assert (known.x_m[-1], known.y_m[-1]) == pytest.approx((updates[-1].x_m, updates[-1].y_m), abs=0.05)
    assert known.t_s.tolist() == [u.t_s for u in updates]


def test_beliefs_are_kept_every_so_many_steps_and_change_nothing(plain: Plain, log: SensorLog) -> None:
    smoother = OnlineSmoother(CONFIG, believe_steps=15)
    updates = feed(smoother, log, 5.0)
    assert updates == plain[1]
    assert [b.k for b in smoother.beliefs] == list(range(15, len(updates), 15))
    for belief in smoother.beliefs:
        assert belief.t_s == updates[belief.k].t_s
        assert belief.first == max((belief.k + 1) // 20 - 1, 0) * 20
        assert belief.xy_m.shape == (belief.k - belief.first + 1, 2)
        now = updates[belief.k]
        assert np.allclose(belief.xy_m[-1], (now.x_m, now.y_m), atol=0.05)
    assert plain[0].beliefs == []


class Friend:
    """Remembers what it is told, answers every step, and knows one closure."""

    def __init__(self, at: int, closure: Closure) -> None:
        self.at, self.closure = at, closure
        self.events: list[Event] = []
        self.told: list[tuple[int, Step, int]] = []

    def note(self, events: Iterable[Event]) -> None:
        self.events += events

    def advance(
        self, update: Breadcrumb, step: Step, estimate: Callable[[], Trajectory]
    ) -> tuple[ReturnUpdate | None, Iterable[Closure]]:
        self.told.append((update.k, step, len(estimate())))
        told = ReturnUpdate(update.t_s, update.k, 0, 0.0, 0.0, 0.0, 0.0, None, None, 1.0, False, False, "on")
        return told, [self.closure] if update.k == self.at else []


def test_a_companion_is_told_every_step_and_its_closures_count_from_the_next_on(log: SensorLog, plain: Plain) -> None:
    closure = Closure(2, 30, 0.1, 0.1)
    friend = Friend(30, closure)
    smoother = OnlineSmoother(CONFIG, companion=friend)
    updates = feed(smoother, log, 5.0)
    assert [(k, count) for k, _, count in friend.told] == [(u.k, u.k + 1) for u in updates]
    assert [step for _, step, _ in friend.told] == list(smoother.steps)
    assert friend.events == list(log.events)
    assert all(u.returning is not None and u.returning.k == u.k for u in updates)
    moved = [np.hypot(a.x_m - b.x_m, a.y_m - b.y_m) for a, b in zip(updates, plain[1], strict=True)]
    assert max(moved[:31]) < 1e-3
    assert min(moved[31:40]) > 0.01
    finished = smoother.finish()
    assert finished.closures == (closure,)
    known, track = plain[0].estimate(), smoother.track
    batch = smooth(track, known, CONFIG.graph, CONFIG.solver, None, (closure,)).trajectory
    assert np.allclose(finished.trajectory.xy_m, batch.xy_m, atol=0.02)


@pytest.mark.parametrize(("share", "later"), [(0.3, 0), (0.7, 1)])
def test_an_anchor_holds_the_breadcrumb_nearest_in_time(log: SensorLog, plain: Plain, share: float, later: int) -> None:
    """One anchor alone moves the whole walk: that breadcrumb is exactly there."""
    k, t_s = 25, plain[0].track.t_s
    when = t_s[k] + share * (t_s[k + 1] - t_s[k])
    anchors = checkpoints(np.array([when]), np.array([100.0]), np.array([-50.0]))
    smoother = OnlineSmoother(CONFIG, Aids(anchors))
    updates = feed(smoother, log, 5.0)
    for trajectory in (smoother.estimate(), smoother.finish().trajectory):
        assert trajectory.xy_m[k + later] == pytest.approx((100.0, -50.0), abs=0.1)
    before, after = updates[k], updates[k + 2]
    # not known before its time: the walk is shown as if it began there
    assert (updates[0].x_m, updates[0].y_m) == pytest.approx((100.0, -50.0))
    assert np.hypot(before.x_m - 100.0, before.y_m + 50.0) > 5.0
    assert np.hypot(after.x_m - 100.0, after.y_m + 50.0) < 2.0


def test_every_anchor_is_used_once_as_in_the_batch_graph(log: SensorLog, plain: Plain) -> None:
    track, known = plain[0].track, plain[0].estimate()
    at = np.array([0, 12, 13, 40, 50])
    anchors = checkpoints(track.t_s[at] + 0.05, *(known.xy_m[at] + (5.0, 7.0)).T)
    smoother = OnlineSmoother(CONFIG, Aids(anchors))
    feed(smoother, log, 0.7)
    finished = smoother.finish()
    (kind,) = [r for r in finished.residuals if r.name == "anchor"]
    assert kind.k.tolist() == at.tolist()
    online = smoother.estimate()
    assert np.allclose(online.xy_m[-1], finished.trajectory.xy_m[-1], atol=0.2)
    batch = smooth(track, known, CONFIG.graph, CONFIG.solver, Aids(anchors)).trajectory
    assert np.allclose(finished.trajectory.xy_m, batch.xy_m, atol=0.02)


def test_the_second_anchor_counts_while_walking_too(log: SensorLog, plain: Plain) -> None:
    track, known = plain[0].track, plain[0].estimate()
    at = np.array([10, 30])
    x_m, y_m = known.x_m[at] + np.array([100.0, 102.0]), known.y_m[at] - 50.0
    ends = []
    for count in (1, 2):
        anchors = checkpoints(track.t_s[at], x_m, y_m, sigma_m=np.full(2, 0.2)).select(slice(0, count))
        smoother = OnlineSmoother(CONFIG, Aids(anchors))
        feed(smoother, log, 5.0)
        ends.append(smoother.estimate().x_m[30])
    assert ends[0] == pytest.approx(x_m[1] - 2.0, abs=0.3)
    assert ends[1] > ends[0] + 0.5


def test_finish_takes_what_was_held_back_and_smooths_it_all(log: SensorLog) -> None:
    smoother = OnlineSmoother(CONFIG)
    feed(smoother, log, 5.0)
    finished = smoother.finish()
    track = smoother.track
    assert len(finished.trajectory) == len(track)
    assert finished.trajectory.cov_xy_yaw is not None
    assert smoother.turn_back is None


def test_without_a_step_there_is_nothing_to_tell(log: SensorLog) -> None:
    smoother = OnlineSmoother(CONFIG)
    assert smoother.feed(log.between(-1.0, 2.0)) == []
    assert smoother.signals is not None
    assert smoother.signals.t_s[-1] > 1.0
    for ask in (smoother.estimate, smoother.belief, lambda: smoother.causal, smoother.finish):
        with pytest.raises(DataError, match="no step found"):
            ask()
