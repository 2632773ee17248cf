"""The checks while a walk goes on: found in time, the same in any pieces, and told by guide and command."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fbgraph.core.aids import Aids
from fbgraph.core.config import load_config
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.estimators.estimates import Update
from fbgraph.integrity.live_check import LiveCheck
from fbgraph.session import WalkInProgress, cut_log
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import SimulateOptions

CONFIG = load_config("m5stickc")


@pytest.fixture(scope="module")
def log() -> SensorLog:
    return simulate(load_route("square"), SimulateOptions(duration_s=75.0), seed=11).log


def mirrored(log: SensorLog) -> SensorLog:
    """Its gyroscope with the wrong sign."""
    return replace(log, gyro=Stream(log.gyro.t_s, -log.gyro.values))


def walked(log: SensorLog, chunk_s: float, **given: Any) -> tuple[WalkInProgress, list[Update]]:
    config = load_config("m5stickc", [f"{key}={value}" for key, value in given.items()])
    walk, updates = WalkInProgress(config, Aids()), []
    for piece, _ in cut_log(log, chunk_s, np.inf, lambda: False):
        updates += walk.feed(piece)
    return walk, updates


def test_nothing_is_said_of_an_undisturbed_walk(log: SensorLog) -> None:
    walk, updates = walked(log, 0.5)
    assert walk.integrity.verdict == "sound"
    assert [update.caution for update in updates] == [None] * len(updates)


def test_a_mirrored_gyroscope_is_noticed_on_the_way_in_any_pieces(log: SensorLog) -> None:
    walk, updates = walked(mirrored(log), 0.5)
    assert walk.integrity.verdict == "doubtful"
    first = next(update for update in updates if update.caution)
    assert "turn opposite ways" in str(first.caution)
    assert first.t_s < 60.0
    assert updates[-1].caution
    _, again = walked(mirrored(log), 3.0)
    assert [update.caution for update in again] == [update.caution for update in updates]


def test_a_sensor_that_falls_silent_is_noticed_without_a_step(log: SensorLog) -> None:
    short = replace(log, gyro=log.gyro.between(0.0, 30.0))
    walk, updates = walked(short, 0.5)
    assert updates[-1].t_s < 30.0
    assert "the gyroscope fell silent at 30 s" in walk.integrity.reasons[0].text


def test_the_guide_says_that_it_no_longer_trusts_itself() -> None:
    out = simulate(load_route("out-and-back"), SimulateOptions(duration_s=90.0), seed=2)
    turned_s = 45.0
    told = [
        u.returning.instruction for u in walked(mirrored(out.log), 0.5, **{"returning.at": turned_s})[1] if u.returning
    ]
    why = [text for text in told if text.startswith("position doubtful: ")]
    assert why
    assert len(why) < 4
    assert sum(text.startswith("position doubtful; ") for text in told) > 5
    sound = [u.returning.instruction for u in walked(out.log, 0.5, **{"returning.at": turned_s})[1] if u.returning]
    assert not any("doubtful" in text for text in sound)


def test_one_check_is_asked_a_step_and_windows_are_a_minute() -> None:
    asked: list[tuple[int, float]] = []

    def check(number: int) -> Any:
        def ask(walk: Any) -> list[Any]:
            asked.append((number, float(walk.log.acc.t_s[-1] - walk.log.acc.t_s[0])))
            return []

        return ask

    log = simulate(load_route("square"), SimulateOptions(duration_s=100.0), seed=1).log
    watch = LiveCheck(CONFIG, [check(0), check(1), check(2)])
    from fbgraph.front_end.detect_steps import FrontEnd

    front_end = FrontEnd(CONFIG)
    for piece, _ in cut_log(log, 0.5, np.inf, lambda: False):
        watch.feed(piece)
        steps, signals = front_end.feed(piece)
        watch.level(signals)
        for step in steps:
            assert watch.advance(step) is None
    assert [number for number, _ in asked[:6]] == [1, 2, 0, 1, 2, 0]  # from the twentieth step on
    assert max(span_s for _, span_s in asked) <= 60.0
    assert asked[-1][1] > 59.0
