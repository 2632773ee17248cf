"""The way back: found, followed and told as the README promises, whatever the chunks; and what it does to the graph."""

import csv
import importlib.util
import itertools
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from scipy.ndimage import gaussian_filter1d

from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError
from fbgraph.core.log import SensorLog
from fbgraph.core.trajectory import read_tum
from fbgraph.estimators.graph import closure_factor
from fbgraph.estimators.online import OnlineSmoother
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.run.folder import RETURN_HEADER
from fbgraph.run.metrics import score
from fbgraph.session import cut_log
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import Route, load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.way_back.closures import ClosureMaker
from fbgraph.way_back.guide import ReturnGuide, instruction
from fbgraph.way_back.matcher import RouteMatcher
from fbgraph.way_back.records import Closure, Crumb, Match, ReturnUpdate, TurnBack
from fbgraph.way_back.turn_back import TurnBackDetector
from fbgraph.way_back.way_out import Outbound


def load_script() -> ModuleType:
    path = Path(__file__).parents[1] / "scripts" / "returns.py"
    spec = importlib.util.spec_from_file_location("returns", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["returns"] = module
    spec.loader.exec_module(module)
    return module


returns = load_script()


def guided(log: SensorLog, at: str, chunk_s: float = 0.5, device: str = "m5stickc") -> ReturnGuide:
    config = load_config(device, [f'returning.at="{at}"'])
    guide = ReturnGuide(config)
    smoother = OnlineSmoother(config, companion=guide)
    for piece, _ in cut_log(log, chunk_s, np.inf, lambda: False):
        smoother.feed(piece)
    smoother.finish()
    return guide


def route(*rows: tuple[float, ...]) -> Route:
    """x, y and, where given, the pause."""
    table = np.array([(*row, 0.0)[:3] for row in rows], dtype=float)
    xyz_m = np.column_stack((table[:, :2], np.zeros(len(table))))
    return Route("test", xyz_m, table[:, 2], tuple(str(k) for k in range(len(rows))))


@pytest.fixture(scope="module")
def walk() -> SimulatedWalk:
    return simulate(load_route("out-and-back"), seed=4)


@pytest.fixture(scope="module")
def guide(walk: SimulatedWalk) -> ReturnGuide:
    return guided(walk.log, "auto")


def test_museum(shared_data: Path) -> None:
    """All eight walks: return error, turn-back, arrival, no false alarm, no wrong closure."""
    walks = []
    for path in sorted((shared_data / "ipin2023").glob("*.gz")):
        log_file = read_log(path)
        truth = log_file.truth
        assert truth is not None
        config = load_config(preset(log_file.log.format))
        walks.append(returns.real_return(log_file.log, truth.xy_m, truth.t_s - log_file.log.t0_s, config, 0.25))
    assert len(walks) == 8
    told, by_itself = np.concatenate([w.told for w in walks]), np.concatenate([w.auto for w in walks])
    assert np.isfinite(told).all()
    for error in (told, by_itself[np.isfinite(by_itself)]):
        assert error.mean() <= 1.5
        assert np.percentile(error, 95) <= 4.0
    assert np.isfinite(by_itself).mean() > 0.7  # some checkpoints are passed before it can know
    assert max(w.turn_off_s for w in walks) < 10.0
    assert max(w.delay_s for w in walks) < 15.0
    assert max(w.arrived_m for w in walks) < 4.0  # fails on nan too: all arrive
    assert sum(w.off_route for w in walks) == 0
    assert sum(w.closures for w in walks) > 50
    assert sum(w.wrong for w in walks) == 0


def test_who_walks_back_along_a_spur_is_not_sent_out_again(shared_data: Path) -> None:
    """The route goes into a dead end and out again: the legs lie side by side, but only one is the way back."""
    log_file = read_log(shared_data / "ipin2023" / "TrainingTrial01_repetition03.txt.gz")
    guide = guided(log_file.log, "auto", device=preset(log_file.log.format))
    remaining_m = np.array([update.remaining_m for update in guide.updates])
    assert len(remaining_m) > 50
    assert np.diff(remaining_m).max() < 2.0
    assert not [update for update in guide.updates if update.instruction == "turn around"]


@pytest.mark.parametrize("seed", range(3))
def test_simulated_out_and_back(seed: int) -> None:
    found = returns.simulated_return(seed, detour=False)
    assert found.false_off == 0
    assert found.error_m.mean() < 1.0
    assert found.arrived_m < 4.0
    assert found.wrong == 0


@pytest.mark.parametrize("seed", [0, 5, 25])
def test_a_detour_is_noticed_and_the_route_found_again(seed: int) -> None:
    found = returns.simulated_return(seed, detour=True)
    assert found.false_off == 0
    assert found.flagged_after_m < 10.0
    assert found.back_after_m < 10.0
    assert found.arrived_m < 4.0
    assert found.wrong == 0


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


@pytest.mark.parametrize("name", ["straight", "square", "eight"])
def test_no_turn_back_where_nobody_turns_back(name: str) -> None:
    assert guided(simulate(load_route(name, 2.0), seed=1).log, "auto", 5.0).turn_back is None


def crumbs(route_: Route) -> list[Crumb]:
    """A step every 0.6 m along a route."""
    at = np.append(0.0, np.cumsum(np.hypot(*np.diff(route_.waypoints_m[:, :2], axis=0).T)))
    walked = np.arange(0.0, at[-1], 0.6)
    x, y = (np.interp(walked, at, axis) for axis in route_.waypoints_m[:, :2].T)
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    return [Crumb(s / 1.2, *row, 0.0, a, s) for s, row, a in zip(walked, zip(x, y, strict=True), yaw, strict=True)]


def first_turn_back(route_: Route) -> TurnBack | None:
    detector = TurnBackDetector(12.0, 1.5)
    return next((found for crumb in crumbs(route_) if (found := detector.advance(crumb))), None)


def test_a_dead_end_is_no_turn_back() -> None:
    assert first_turn_back(route((0, 0), (20, 0), (20, 8), (20, 0), (45, 0))) is None
    found = first_turn_back(route((0, 0), (20, 0), (20, 15), (20, 0), (45, 0)))
    assert found is not None
    assert abs(found.t_s - 35 / 1.2) < 1.5
    assert first_turn_back(route((0, 0), (30, 0), (30, 4), (0, 4))) is None  # a parallel aisle


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
    assert instruction(match, (18.0, np.radians(85)), 30.0, 0.0, False) == "turn left 85° in 12 m"
    assert instruction(match, (29.5, np.radians(-90)), 30.0, 0.0, False) == "turn right 90° now"
    assert instruction(match, (2.0, 1.0), 30.0, 0.0, False) == "straight on for 28 m"
    assert instruction(match, None, 23.0, 0.0, False) == "straight on for 23 m"
    assert instruction(match, None, 23.0, 5.0, False) == "turn around"
    lost = Match(30.0, 0.3, 40, -6.0, True, True, -1.4, 0.0)
    assert instruction(lost, None, 23.0, 0.0, False) == "off route: the route is 6 m to your right"


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
    assert late.updates[0].remaining_m < late.outbound.route_m[-1] - 2.0  # type: ignore[union-attr]


@pytest.mark.parametrize("at", ["soon", "-3", "nan", "inf", ""])
def test_a_wrong_time_is_refused(at: str) -> None:
    with pytest.raises(ConfigError, match=r"returning\.at"):
        load_config(None, [f'returning.at="{at}"'])


def run(*arguments: object, stdin: str | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "fbgraph", "online", *map(str, arguments), "--no-recording"]
    return subprocess.run(command, capture_output=True, text=True, input=stdin)


def test_command_line(walk: SimulatedWalk, guide: ReturnGuide, tmp_path: Path) -> None:
    log = tmp_path / "walk.csv"
    write_m5stickc_csv(walk.log, log)
    out = tmp_path / "run"
    done = run(log, "--return-at", "auto", "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    told = [line["returning"] for line in lines[:-1] if "returning" in line]
    assert set(told[0]) == set(ReturnUpdate.__dataclass_fields__)
    with open(out / "return.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert ",".join(rows[0]) == RETURN_HEADER
    assert len(rows) == len(told) == lines[-1]["return"]["steps"]
    assert lines[-1]["return"]["arrived_t_s"] is not None
    online = read_tum(out / "online.tum")  # the same clock
    assert float(rows[0]["t_s"]) == pytest.approx(online.t_s[-len(rows)], abs=1e-5)
    assert float(rows[5]["breadcrumb_t_s"]) == pytest.approx(online.t_s[int(rows[5]["breadcrumb"])], abs=1e-5)
    late = run(log, "--return-at", "100000", "--out", out, "--follow")
    assert "later than the last step" in late.stdout
    assert not (out / "return.csv").exists()
    bad = run(log, "--return-at", "tomorrow", "--out", out)
    assert bad.returncode == 2
    assert "--return-at" in bad.stderr


def test_event_without_an_event_is_a_warning(tmp_path: Path) -> None:
    walk = simulate(load_route("straight"), seed=1)
    silent = guided(SensorLog(**{**vars(walk.log), "events": ()}), "event")
    assert silent.turn_back is None
    assert "no event" in silent.warnings()[0]


def test_a_resumed_walk_is_told_the_same_way_back(walk: SimulatedWalk, tmp_path: Path) -> None:
    """The time of return is kept in the run's config.toml; steps before the interruption are matched again."""
    log = tmp_path / "walk.csv"
    write_m5stickc_csv(walk.log, log)
    lines = log.read_text().splitlines(keepends=True)
    whole, part = tmp_path / "whole", tmp_path / "part"
    live = ("--source", "stdin")
    assert run(*live, "--out", whole, "--return-at", "auto", stdin="".join(lines)).returncode == 0
    cut = int(0.8 * len(lines))
    assert run(*live, "--out", part, "--return-at", "auto", stdin="".join(lines[:cut])).returncode == 0
    assert run(*live, "--resume", part, stdin="".join(lines[cut:])).returncode == 0
    assert (part / "return.csv").read_text() == (whole / "return.csv").read_text()


def test_closure_factor_is_zero_at_the_place_it_names() -> None:
    closure = Closure(2, 9, 1.0, 0.5, along_m=0.3)
    values = gtsam.Values()
    values.insert(X(2), gtsam.Pose2(1.0, 2.0, 0.5))
    there = gtsam.Pose2(1.0, 2.0, 0.5).transformFrom(gtsam.Point2(0.3, 0.0))
    values.insert(X(9), gtsam.Pose2(there[0], there[1], 0.5 + np.pi + 0.4))
    assert closure_factor(closure).error(values) < 1e-4  # whatever the direction
    values.update(X(9), gtsam.Pose2(there[0] + 30.0, there[1], 0.5 + np.pi))
    assert closure_factor(closure).error(values) < 5.0  # a wrong match does not pull for ever


def test_closures_help_the_smoother_on_ways_back_and_leave_others_alone(shared_data: Path) -> None:
    scores = []
    for path in sorted((shared_data / "ipin2023").glob("*.gz")):
        log_file = read_log(path)
        log, truth = log_file.log, log_file.truth
        assert truth is not None
        pair = []
        for tied in ("false", "true"):
            config = load_config(preset(log.format), [f"returning.out_and_back={tied}"])
            result = reconstruct(log, config)
            pair.append(score(result.trajectories["smoothed"], truth, log.t0_s).rmse_m)
            assert bool(result.smoothed.closures) == (tied == "true")
        scores.append(pair)
    alone, tied_m = np.mean(scores, axis=0)
    assert tied_m < 0.95 * alone


def test_a_route_of_kilometres_is_matched_as_finely_as_a_short_one() -> None:
    """Three kilometres out and back, without errors: on the route all the way, to the start, and closures on it."""
    length_m, count = 0.7, 4300
    yaw = 0.6 * np.sin(np.arange(count) / 40.0)
    way_m = np.cumsum(length_m * np.exp(1j * yaw))
    at_m = length_m * np.arange(count)
    field = gaussian_filter1d(np.random.default_rng(1).normal(size=(count, 2)), 4.0, axis=0)
    field *= 6.0 / field.std()
    outbound = Outbound(
        t_s=np.arange(count) * 0.6,
        x_m=way_m.real,
        y_m=way_m.imag,
        route_m=at_m,
        level_m=at_m,
        mag_up_ut=field[:, 0],
        mag_level_ut=field[:, 1],
        altitude_m=np.zeros(count),
    )
    config = load_config("m5stickc").returning
    matcher, maker, closures, off = RouteMatcher(outbound, config), ClosureMaker(outbound, config), 0, 0
    for k in range(count - 1, 0, -1):
        match = matcher.advance(length_m, length_m, float(yaw[k] + np.pi), (field[k, 0], field[k, 1]), 0.0)
        closure = maker.advance(2 * count - k, length_m, match)
        closures += closure is not None
        off += match.off_route
        assert abs(match.route_m - at_m[k - 1]) < 3.0
    assert off == 0
    assert closures > 500
