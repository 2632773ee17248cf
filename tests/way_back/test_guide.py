"""The way back, live: followed and told as the README promises, whatever the chunks."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.walking import guided, route

from fbgraph.readers import preset, read_log
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.way_back.guide import ReturnGuide, next_instruction
from fbgraph.way_back.records import Match


@pytest.fixture(scope="module")
def walk() -> SimulatedWalk:
    return simulate(load_route("out-and-back"), seed=4)


@pytest.fixture(scope="module")
def guide(walk: SimulatedWalk) -> ReturnGuide:
    return guided(walk.log, "auto")


def test_who_walks_back_along_a_spur_is_not_sent_out_again(shared_data: Path) -> None:
    """The route goes into a dead end and out again: the legs lie side by side, but only one is the way back."""
    log_file = read_log(shared_data / "ipin2023" / "TrainingTrial01_repetition03.txt.gz")
    guide = guided(log_file.log, "auto", device=preset(log_file.log.format))
    remaining_m = np.array([update.remaining_m for update in guide.updates])
    assert len(remaining_m) > 50
    assert np.diff(remaining_m).max() < 2.0
    assert not [update for update in guide.updates if update.instruction == "turn around"]


def test_a_shortcut_meets_the_route_further_on() -> None:
    walk = simulate(route((0, 0), (40, 0), (40, 25), (70, 25, 10), (40, 25), (20, 0), (0, 0)), seed=2)
    guide = guided(walk.log, "auto")
    off_m = [u.remaining_m for u in guide.updates if u.off_route]
    assert off_m
    met_s = max(u.t_s for u in guide.updates if u.off_route)
    after = [u for u in guide.updates if u.t_s > met_s]
    for u in after:
        assert abs(u.remaining_m - np.interp(u.t_s, walk.t_s, np.hypot(walk.x_m, walk.y_m))) < 4.0
    assert after[0].remaining_m > 10.0
    assert sum(u.arrived for u in guide.updates) == 1


def test_rows_do_not_depend_on_the_chunks(walk: SimulatedWalk, guide: ReturnGuide) -> None:
    assert guide.updates
    for chunk_s in (1e9, 0.03):
        other = guided(walk.log, "auto", chunk_s)
        assert other.updates == guide.updates
        assert other.closures == guide.closures


def test_rows_use_only_the_past(walk: SimulatedWalk, guide: ReturnGuide) -> None:
    half_s = guide.updates[len(guide.updates) // 2].t_s
    cut = guided(walk.log.between(-np.inf, half_s + 1.0), "auto")
    assert len(cut.updates) > 10
    assert cut.updates == guide.updates[: len(cut.updates)]


def test_the_way_is_told(walk: SimulatedWalk, guide: ReturnGuide) -> None:
    """Out-and-back has four corners: met on the way back in reverse order, the other way round."""
    assert guide.turn_back is not None
    told = [u for u in guide.updates if u.next_turn_rad is not None]
    sides = [s for s, _ in itertools.groupby(np.sign([u.next_turn_rad or 0.0 for u in told]))]
    assert sides[-2:] == [1.0, -1.0] or sides[-1:] == [-1.0]  # the last corner: out a left turn, back a right one
    remaining = [u.remaining_m for u in guide.updates]
    assert remaining[-1] < 3.5
    assert np.diff(remaining).max() < 0.5
    arrived = [u for u in guide.updates if u.arrived]
    assert [u.instruction for u in arrived] == ["you are back at the start"]
    assert sum(u.instruction == "you are back at the start" for u in guide.updates) == 1


def test_sentences() -> None:
    match = Match(30.0, 0.3, 40, -6.0, False, True, -1.4, 10.0)
    assert next_instruction(match, (18.0, np.radians(85)), 30.0, 0.0, False) == "turn left 85° in 12 m"
    assert next_instruction(match, (29.5, np.radians(-90)), 30.0, 0.0, False) == "turn right 90° now"
    assert next_instruction(match, (2.0, 1.0), 30.0, 0.0, False) == "straight on for 28 m"
    assert next_instruction(match, None, 23.0, 0.0, False) == "straight on for 23 m"
    assert next_instruction(match, None, 23.0, 5.0, False) == "turn around"
    lost = Match(30.0, 0.3, 40, -6.0, True, True, -1.4, 0.0)
    assert next_instruction(lost, None, 23.0, 0.0, False) == "off route: the route is 6 m to your right"


def test_event_and_time_begin_the_way_back(walk: SimulatedWalk) -> None:
    first_s = next(e.t_s for e in walk.log.events if e.t_s > 5.0)
    by_event = guided(walk.log, "event")
    assert by_event.turn_back is not None
    assert 0.0 <= by_event.turn_back.known_s - first_s < 1.5
    timed = guided(walk.log, "20")
    assert timed.updates[0].t_s >= 20.0
    assert timed.updates[0].t_s < 21.5


def test_one_who_says_so_late_is_still_guided_from_the_turn(walk: SimulatedWalk) -> None:
    turn_s = walk.checkpoints.t_s[5] - walk.log.t0_s  # the far end; the pause lasts 30 s
    late = guided(walk.log, f"{turn_s + 30.0 + 6.0:.2f}")
    assert late.turn_back is not None
    assert abs(late.turn_back.t_s - turn_s) < 3.0
    assert late.outbound is not None
    assert late.updates[0].remaining_m < late.outbound.route_m[-1] - 2.0


def test_event_without_an_event_is_a_warning() -> None:
    silent = guided(replace(simulate(load_route("straight"), seed=1).log, events=()), "event")
    assert silent.turn_back is None
    assert "no event" in silent.warnings()[0]
