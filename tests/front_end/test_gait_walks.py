"""Steps of simulated walks at any cadence and bounce, and none where nobody walks."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.front_end.detect_steps import FrontEnd
from fbgraph.front_end.step_track import Step
from fbgraph.simulator.disturbances import Burst, gestures, lift, vibration
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import Route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import Device, SimulateOptions

CONFIG = load_config("m5stickc")
CORNERS = ((0.0, 0.0), (25.0, 0.0), (25.0, 15.0), (0.0, 15.0))


def walked(
    walker: Walker, rate_hz: float, seed: int, stops: Sequence[tuple[float, float, float]] = ()
) -> SimulatedWalk:
    """Along the corners, or from stop to stop (x, y, pause in seconds)."""
    rows = np.array(stops or [(*corner, 0.0) for corner in CORNERS])
    places = np.column_stack((rows[:, :2], np.zeros(len(rows))))
    route = Route("gait", places, rows[:, 2], tuple(str(i) for i in range(len(rows))))
    return simulate(route, SimulateOptions(walker=walker, device=Device(rate_hz=rate_hz)), seed)


def steps_of(log: SensorLog, edges_s: Sequence[float] = ()) -> list[Step]:
    front_end, steps = FrontEnd(CONFIG), list[Step]()
    bounds = [-np.inf, *edges_s, np.inf]
    for start_s, end_s in itertools.pairwise(bounds):
        steps += front_end.feed(log.between(start_s, end_s))[0]
    return steps + front_end.finish()[0]


def doubt_m(steps: Sequence[Step]) -> float:
    return float(np.sqrt(sum(step.doubt_m**2 for step in steps)))


def distance_m(steps: Sequence[Step]) -> float:
    return sum(step.length_m for step in steps)


@pytest.mark.parametrize(
    ("cadence_hz", "bounce", "rate_hz"),
    [
        *((0.7, 0.5, 40.0), (0.75, 1.8, 20.0), (0.85, 0.4, 100.0), (1.0, 0.6, 25.0), (1.3, 2.0, 50.0)),
        *((1.6, 0.35, 50.0), (1.8, 0.35, 25.0), (1.8, 4.0, 200.0), (2.1, 1.8, 20.0), (2.3, 3.0, 40.0)),
        *((2.6, 6.0, 50.0), (2.85, 9.0, 20.0), (3.05, 9.0, 100.0), (3.2, 9.0, 50.0)),
    ],
)
def test_steps_are_counted_at_any_cadence_and_bounce(cadence_hz: float, bounce: float, rate_hz: float) -> None:
    alpha_m = 1.1 - 0.2 * cadence_hz if cadence_hz > 2.4 else 0.35
    walker = Walker(cadence_hz=cadence_hz, bounce_m_s2=bounce, alpha_m=alpha_m)
    walk = walked(walker, rate_hz, round(100 * cadence_hz))
    steps = steps_of(walk.log)
    assert len(steps) - 1 == pytest.approx(len(walk.steps.t_s), rel=0.1)
    frequency_hz = np.median([step.frequency_hz for step in steps])
    assert frequency_hz == pytest.approx(cadence_hz, rel=0.06)
    true_m, sigma_m = float(walk.steps.length_m.sum()), np.hypot(doubt_m(steps), 0.05 * len(steps) ** 0.5 + 4.0)
    assert abs(distance_m(steps) - true_m) < 2.5 * sigma_m
    assert (doubt_m(steps) > 3.0) == (cadence_hz < 1.1 or cadence_hz > 2.4)  # nobody knows the length of such steps


def test_ordinary_steps_are_beyond_doubt() -> None:
    walk = walked(Walker(), 50.0, 4)
    steps = steps_of(walk.log)
    assert len(steps) - 1 == pytest.approx(len(walk.steps.t_s), abs=1)
    assert doubt_m(steps) == 0.0


@pytest.mark.parametrize(("apart_m", "seed"), [(1.0, 1), (1.2, 3), (1.42, 2)])
def test_bouts_of_a_few_steps_are_walked_and_doubted(apart_m: float, seed: int) -> None:
    stops = [(apart_m * i, 0.0, 3.0) for i in range(16)]
    walk = walked(Walker(), 25.0, seed, stops)
    steps = steps_of(walk.log)
    true_m = 15 * apart_m
    assert distance_m(steps) == pytest.approx(true_m, rel=0.3)
    assert abs(distance_m(steps) - true_m) < 3.0 * np.hypot(doubt_m(steps), 1.0)
    cut = steps_of(walk.log, np.arange(0.0, walk.log.duration_s, 0.7).tolist())
    assert repr(cut) == repr(steps)


@pytest.mark.parametrize(("bounce", "sway_deg", "seed"), [(0.2, 0.5, 1), (0.3, 1.0, 2), (0.3, 2.5, 4)])
def test_what_was_walked_before_a_trolleys_rhythm_was_known_counts_with_doubt(
    bounce: float, sway_deg: float, seed: int
) -> None:
    walk = walked(Walker(bounce_m_s2=bounce, sway_deg=sway_deg), 50.0, seed, [(0.0, 0.0, 0.0), (40.0, 0.0, 0.0)])
    steps = steps_of(walk.log)
    assert distance_m(steps) == pytest.approx(40.0, abs=4.0)
    assert 0.5 < doubt_m(steps) < 4.0
    assert steps[1].doubt_m > 0.4 * steps[1].length_m > 0.5
    assert repr(steps_of(walk.log, np.arange(0.0, 60.0, 0.31).tolist())) == repr(steps)


def standing(seconds: float, seed: int) -> SimulatedWalk:
    """Standing, then twelve metres."""
    return walked(Walker(), 50.0, seed, [(0.0, 0.0, seconds), (12.0, 0.0, 0.0)])


def first_step_s(log: SensorLog) -> float:
    return next(step.t_s for step in steps_of(log) if step.length_m > 0)


@pytest.mark.parametrize("seed", range(4))
def test_hands_that_talk_do_not_walk(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bursts = [
        Burst(4.0 + 12.0 * i, rng.uniform(3.0, 9.0), rng.uniform(1.0, 3.2), rng.uniform(0.01, 0.08)) for i in range(4)
    ]
    assert first_step_s(gestures(standing(55.0, seed), bursts).log) > 57.0


@pytest.mark.parametrize("hz", [10.0, 14.0, 25.0])
def test_an_engine_does_not_walk(hz: float) -> None:
    walk = vibration(standing(40.0, 5), 2.0, 40.0, 1.0, hz, np.random.default_rng(int(hz)))
    assert first_step_s(walk.log) > 42.0


def test_a_lift_does_not_walk() -> None:
    assert first_step_s(lift(standing(40.0, 5), 12.0, 10.0, 10.0).log) > 42.0


def swaying(log: SensorLog, until_s: float, seed: int) -> SensorLog:
    """A bus: irregular, in all directions, below two hertz."""
    rng = np.random.default_rng(seed)
    waves = np.zeros((len(log.acc), 3))
    for axis, size in enumerate((0.5, 0.35, 0.35)):
        rates, phases = 2 * np.pi * rng.uniform(0.2, 2.0, 40), rng.uniform(0.0, 2 * np.pi, 40)
        waves[:, axis] = size * np.sqrt(2 / 40) * np.sin(rates * log.acc.t_s[:, None] + phases).sum(axis=1)
    there = ((log.acc.t_s > 3.0) & (log.acc.t_s < until_s))[:, None]
    return replace(log, acc=Stream(log.acc.t_s, log.acc.values + there * waves))


def test_a_bus_hardly_walks() -> None:
    found = [len([s for s in steps_of(swaying(standing(60.0, k).log, 60.0, k)) if s.t_s < 62.0]) for k in range(4)]
    assert sum(found) <= 20  # of 240 seconds


def swung(log: SensorLog, from_s: float, until_s: float, cadence_hz: float = 1.8) -> SensorLog:
    """A device that hangs on a swinging arm meanwhile: it tilts and is thrown with every stride."""
    there = ((log.gyro.t_s > from_s) & (log.gyro.t_s < until_s)).astype(float)
    phase = np.pi * cadence_hz * log.gyro.t_s
    rate = log.gyro.values + (2.5 * there * np.cos(phase))[:, None] * np.array([0.0, 0.0, 1.0])
    return replace(log, gyro=Stream(log.gyro.t_s, rate))


def test_a_gyroscope_that_says_nothing_takes_no_step_away() -> None:
    walk = walked(Walker(), 50.0, 9)
    dead = replace(walk.log, gyro=Stream(walk.log.gyro.t_s, np.zeros_like(walk.log.gyro.values)))
    assert len(steps_of(dead)) == pytest.approx(len(steps_of(walk.log)), abs=2)


@pytest.mark.parametrize("length_m", [9.0, 10.0])
def test_a_swing_too_brief_to_be_sure_is_one_long_doubtful_step(length_m: float) -> None:
    """The yaw swings beyond any hand's for a few seconds, with every stride; it takes longer to be sure of a limb."""
    walk = walked(
        Walker(bounce_m_s2=4.0, start_hold_s=6.0),
        50.0,
        2,
        [(0.0, 0.0, 0.0), (length_m, 0.0, 8.0), (length_m + 12.0, 0.0, 0.0)],
    )
    steps = steps_of(swung(walk.log, 5.0, 8.0 + length_m / 1.2))
    long = [step for step in steps if step.doubt_m > 0.5 * step.length_m > 0]
    assert len(long) == 1
    assert abs(long[0].length_m - length_m) < 1.5 * long[0].doubt_m
    assert long[0].t_s - long[0].start_s > 3.0


def test_a_longer_swing_is_a_limbs_walk() -> None:
    walk = walked(Walker(bounce_m_s2=4.0, start_hold_s=6.0), 50.0, 2, [(0.0, 0.0, 0.0), (30.0, 0.0, 3.0)])
    steps = steps_of(swung(walk.log, 5.0, 40.0))
    assert len(steps) - 1 == pytest.approx(len(walk.steps.t_s), abs=3)


def test_a_swing_long_before_the_first_steps_is_no_walk() -> None:
    """Before they walk, people shake and turn what they carry."""
    walk = walked(
        Walker(bounce_m_s2=4.0, start_hold_s=6.0),
        50.0,
        2,
        [(0.0, 0.0, 0.0), (9.0, 0.0, 30.0), (21.0, 0.0, 0.0)],
    )
    steps = steps_of(swung(walk.log, 5.0, 15.5))
    assert steps[0].t_s > 40.0
    assert max(step.doubt_m for step in steps) < 1.0


@pytest.mark.parametrize(("rest_s", "steps"), [(3.0, 1), (120.0, 0)])
def test_a_swing_that_no_walk_follows_is_told_while_its_signals_are_known(rest_s: float, steps: int) -> None:
    walk = walked(Walker(bounce_m_s2=4.0, start_hold_s=6.0), 50.0, 2, [(0.0, 0.0, 0.0), (9.0, 0.0, rest_s)])
    log = swung(walk.log, 5.0, 15.5)
    pieces = np.arange(1.0, log.duration_s, 1.0).tolist()
    for found in (steps_of(log), steps_of(log, pieces)):
        assert len(found[1:]) == steps


def test_a_swing_before_the_first_steps_is_the_same_in_any_pieces() -> None:
    stops = [(0.0, 0.0, 0.0), (9.0, 0.0, 8.0), (21.0, 0.0, 0.0)]
    walk = walked(Walker(bounce_m_s2=4.0, start_hold_s=6.0), 50.0, 2, stops)
    log = swung(walk.log, 5.0, 15.5)
    whole, cut = steps_of(log), steps_of(log, np.arange(1.0, log.duration_s, 1.0).tolist())
    assert len(whole) > 10
    said = [np.array([(step.t_s, step.length_m, step.doubt_m) for step in steps]) for steps in (whole, cut)]
    assert said[1] == pytest.approx(said[0])
