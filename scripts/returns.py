#!/usr/bin/env python3
"""How well the way back is followed: the README's return tables.

.venv/bin/python scripts/returns.py ../shared/data [--simulated 100]

Return error: when a checkpoint is passed again, |route distance of the breadcrumb the program says the wearer is at -
route distance of the one dropped when it was first passed|, from the samples up to that moment alone. Which checkpoint
repeats which: from the truth, backwards from the turn-back (the middle pause).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fbgraph.core.config import Config, load_config
from fbgraph.core.log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.online import OnlineSmoother
from fbgraph.front_end.track import StepTrack
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.session import cut_log
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import Route, load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions
from fbgraph.way_back.guide import ReturnGuide
from fbgraph.way_back.matcher import RouteMatcher
from fbgraph.way_back.records import Closure, ReturnUpdate
from fbgraph.way_back.turn_back import reversal
from fbgraph.way_back.way_out import Outbound, level_length_m

PIECE_S = 0.1
WRONG_M = 3.0


@dataclass(frozen=True)
class Returned:
    """One way back as it was told: each row with the time until which samples had been seen."""

    rows: list[tuple[float, ReturnUpdate]]
    guide: ReturnGuide
    track: StepTrack


def follow(log: SensorLog, config: Config, at: str, piece_s: float = PIECE_S) -> Returned:
    """Feed a log in small pieces."""
    guide = ReturnGuide(config.model_copy(update={"returning": config.returning.model_copy(update={"at": at})}))
    smoother = OnlineSmoother(config, companion=guide)
    rows = []
    for piece, until_s in cut_log(log, piece_s, np.inf, lambda: False):
        for update in smoother.feed(piece):
            if update.returning is not None:
                rows.append((min(until_s, log.duration_s), update.returning))
    return Returned(rows, guide, smoother.track)


def repeats(xy_m: np.ndarray) -> tuple[int, list[tuple[int, int]]]:
    """Checkpoint of the turn-back, and (earlier, later) pairs of the same place, backwards from there.

    Later checkpoints repeat the way out: after a full way back they may walk it again, in either direction.
    """
    same = np.hypot(*(xy_m[:, None] - xy_m).transpose(2, 0, 1)) < 0.05
    turned = int(np.flatnonzero(same[np.arange(len(xy_m) - 1), np.arange(1, len(xy_m))])[0])
    pairs, at, step = [], turned, -1
    for later in range(turned + 1, len(xy_m)):
        if not same[at, later]:  # the same place again at the ends, the next one between them
            at += step
        assert same[at, later], "not a walk out and back"
        pairs.append((at, later))
        if at == 0:
            step = 1
        elif at == turned:
            step = -1
    return turned, pairs


def return_errors(returned: Returned, t_s: np.ndarray, pairs: list[tuple[int, int]]) -> np.ndarray:
    """Metres, one a pair; nan where the program did not yet know of the way back."""
    outbound, errors = returned.guide.outbound, []
    assert outbound is not None
    for earlier, later in pairs:
        known = [row for seen_s, row in returned.rows if seen_s <= t_s[later]]
        first = int(np.argmin(np.abs(outbound.t_s - t_s[earlier])))
        errors.append(abs(known[-1].route_m - outbound.route_m[first]) if known else np.nan)
    return np.array(errors)


def by_position(
    trajectory: Trajectory, track: StepTrack, config: Config, at_s: float, length_m: np.ndarray
) -> tuple[list[tuple[float, float]], Outbound]:
    """The same matcher by position alone, on another estimator's trajectory: (time, route distance) rows."""
    k = int(np.searchsorted(track.t_s, at_s))
    walked = np.cumsum(length_m)
    xyz_m = np.column_stack((trajectory.x_m, trajectory.y_m, trajectory.z_m))
    last = reversal(xyz_m[:k], trajectory.yaw_rad[:k], walked[:k], config.returning.apart_m)
    outbound = Outbound.of(trajectory, list(track.steps), config.step_length, last)
    blank = np.full(last + 1, np.nan)
    outbound = replace(outbound, level_m=walked[: last + 1], mag_up_ut=blank, mag_level_ut=blank, altitude_m=blank)
    matcher = RouteMatcher(outbound, config.returning.model_copy(update={"sigma_turn_rad": 1e6}))
    rows = []
    for j in range(last + 1, len(track)):
        length = float(length_m[j])
        match = matcher.advance(length, length, float(trajectory.yaw_rad[j]), (np.nan, np.nan), np.nan)
        rows.append((float(track.t_s[j]), float(outbound.route_m[match.breadcrumb])))
    return rows, outbound


def baseline_errors(
    rows: list[tuple[float, float]], outbound: Outbound, t_s: np.ndarray, pairs: list[tuple[int, int]]
) -> np.ndarray:
    errors = []
    for earlier, later in pairs:
        known = [route_m for row_s, route_m in rows if row_s <= t_s[later]]
        first = int(np.argmin(np.abs(outbound.t_s - t_s[earlier])))
        errors.append(abs((known[-1] if known else outbound.route_m[-1]) - outbound.route_m[first]))
    return np.array(errors)


def wrong_closures(
    closures: list[Closure], track: StepTrack, walked: np.ndarray, t_s: np.ndarray, pairs: list[tuple[int, int]]
) -> int:
    """How many lie more than 3 m apart, along the checkpoints: walked distance between them tells the place."""
    turned = pairs[0][0]
    place_m = np.interp(t_s[: turned + 1], track.t_s, walked)  # of the checkpoints of the way out
    knots_m = np.interp(t_s[[later for _, later in pairs]], track.t_s, walked)
    values_m = place_m[[earlier for earlier, _ in pairs]]
    away = [np.interp(walked[c.j], knots_m, values_m) - walked[c.i] - c.along_m for c in closures]
    return int((np.abs(away) > WRONG_M).sum()) if closures else 0


@dataclass(frozen=True)
class RealReturn:
    """A log of a walk out and back, scored; metres and seconds.

    ``told``, ``auto``: return errors, told of the turn at its checkpoint or not; ``turn_off_s``: noticed turn-back
    against the pause at the turn; ``delay_s``: until it was known, from the end of that pause; ``arrived_m``: between
    where the wearer was when arrival was announced and the first checkpoint, as walked.
    """

    told: np.ndarray
    auto: np.ndarray
    turn_off_s: float
    delay_s: float
    arrived_m: float
    off_route: int
    closures: int
    wrong: int


def real_return(
    log: SensorLog, xy_m: np.ndarray, t_s: np.ndarray, config: Config, piece_s: float = PIECE_S
) -> RealReturn:
    """Follow a log's way back, told and by itself; ``t_s`` are the checkpoints' times on the log's clock."""
    turned, pairs = repeats(xy_m)
    told, auto = (follow(log, config, at, piece_s) for at in (f"{t_s[turned]:.3f}", "auto"))
    back = auto.guide.turn_back
    assert back is not None, "no turn-back noticed"
    arrived = [(seen_s, row) for seen_s, row in auto.rows if row.arrived]
    assert len(arrived) <= 1
    home = next(later for earlier, later in pairs if earlier == 0)
    track = auto.track
    walked = np.cumsum(track.length_m)
    home_m = float(np.interp(t_s[home], track.t_s, walked))
    level = np.array([level_length_m(step, config.step_length) for step in track.steps])
    return RealReturn(
        told=return_errors(told, t_s, pairs),
        auto=return_errors(auto, t_s, pairs),
        turn_off_s=float(max(t_s[turned] - back.t_s, back.t_s - t_s[turned + 1], 0.0)),
        delay_s=float(back.known_s - t_s[turned + 1]),
        arrived_m=abs(home_m - walked[arrived[0][1].k]) if arrived else np.nan,
        off_route=sum(row.off_route for _, row in (*told.rows, *auto.rows)),
        closures=len(auto.guide.closures),
        wrong=wrong_closures(auto.guide.closures, track, np.cumsum(level), t_s, pairs),
    )


def real(data: Path) -> None:
    """The logs of ipin2023, beside dead reckoning and the EKF."""
    print(
        "| log, return error mean / max, m | told at the turn | by itself | EKF, by position | PDR, by position "
        "| turn-back off by | known after | arrival announced | off-route rows | closures, wrong |\n"
        + "|---" * 10
        + "|"
    )
    walks: list[RealReturn] = []
    others: list[list[float]] = [[], []]
    for path in sorted((data / "ipin2023").glob("*.gz")):
        log_file = read_log(path)
        log, truth, config = log_file.log, log_file.truth, load_config(preset(log_file.log.format))
        assert truth is not None
        t_s = truth.t_s - log.t0_s
        walk = real_return(log, truth.xy_m, t_s, config)
        walks.append(walk)
        turned, pairs = repeats(truth.xy_m)
        result = reconstruct(log, config)
        level = np.array([level_length_m(s, config.step_length) for s in result.track.steps])
        constant = np.where(level > 0, config.step_length.constant_m, 0.0)
        errors = [walk.told, walk.auto]
        for i, (name, length_m) in enumerate((("ekf", level), ("pdr", constant))):
            rows, outbound = by_position(result.trajectories[name], result.track, config, t_s[turned], length_m)
            errors.append(baseline_errors(rows, outbound, t_s, pairs))
            others[i] += errors[-1].tolist()
        cells = []
        for error in errors:
            known = error[np.isfinite(error)]
            before = f" ({len(error) - len(known)} before it knew)" if len(known) < len(error) else ""
            cells.append(f"{known.mean():.2f} / {known.max():.1f}{before}")
        print(
            f"| {path.name.removesuffix('.txt.gz')} | {' | '.join(cells)} | {walk.turn_off_s:.1f} s "
            f"| {walk.delay_s:.1f} s | at {walk.arrived_m:.1f} m | {walk.off_route} | {walk.closures}, {walk.wrong} |",
            flush=True,
        )
    all_told, all_auto = (np.concatenate([getattr(w, n) for w in walks]) for n in ("told", "auto"))
    means = [
        f"{np.mean(e):.2f}, p95 {np.percentile(e, 95):.1f}"
        for e in (all_told, all_auto[np.isfinite(all_auto)], *others)
    ]
    print(
        f"| all | {' | '.join(means)} | max {max(w.turn_off_s for w in walks):.1f} s "
        f"| max {max(w.delay_s for w in walks):.1f} s | max {max(w.arrived_m for w in walks):.1f} m "
        f"| {sum(w.off_route for w in walks)} | {sum(w.closures for w in walks)}, {sum(w.wrong for w in walks)} |"
    )


def no_way_back(data: Path) -> None:
    """Turn-backs noticed on walks that are not out and back."""
    paths = sorted((data / "indoor-location" / "site1").rglob("*.txt.gz"))
    rows = []
    for path in paths:
        log_file = read_log(path)
        truth = log_file.truth
        assert truth is not None
        back = follow(log_file.log, load_config("phone"), "auto").guide.turn_back
        rows.append((back is not None, retraced_m(truth.xy_m)))
    noticed, retraced = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    print(
        f"\nindoor-location, {len(rows)} walks, by itself: {noticed.sum()} turn-backs noticed. "
        "How far the walks go back over their own way, by the waypoints: "
        + "; ".join(
            f"{text}: {of.sum()} walks, {(noticed & of).sum()} noticed"
            for text, of in (
                ("12 m or more", retraced >= 12),
                ("7 to 12 m", (retraced >= 7) & (retraced < 12)),
                ("less", retraced < 7),
            )
        )
    )
    for name in ("straight", "square", "eight", "obstacle"):
        seeds = range(25)
        false = sum(
            follow(simulate(load_route(name, 2.0), seed=seed).log, load_config("m5stickc"), "auto").guide.turn_back
            is not None
            for seed in seeds
        )
        print(f"simulated {name}, {len(seeds)} seeds: {false} turn-backs noticed")


def retraced_m(xy_m: np.ndarray) -> float:
    """The longest stretch that the straight lines between waypoints go back over their own way, within 3 m."""
    walked = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T)))
    longest = 0.0
    for turn_m in np.arange(1.0, walked[-1], 0.5):
        away = np.arange(0.5, min(turn_m, walked[-1] - turn_m), 0.5)
        after, before = (
            np.column_stack([np.interp(at, walked, c) for c in xy_m.T]) for at in (turn_m + away, turn_m - away)
        )
        apart = np.flatnonzero(np.hypot(*(after - before).T) > 3.0)
        longest = max(longest, 0.5 * (apart[0] if len(apart) else len(away)))
    return longest


@dataclass(frozen=True)
class SimulatedReturn:
    """A simulated way back: what was said, and what was true."""

    walk: SimulatedWalk
    returned: Returned
    error_m: np.ndarray
    false_off: int
    flagged_after_m: float
    back_after_m: float
    arrived_m: float
    wrong: int


def simulated_route(seed: int, detour: bool) -> tuple[Route, tuple[int, int] | None]:
    """Out and back over random legs; with a detour of 20 m off the way back, and its first and last waypoint."""
    rng = np.random.default_rng(seed)
    yaw, xy = 0.0, [np.zeros(2)]
    for _ in range(int(rng.integers(4, 8))):
        xy.append(xy[-1] + rng.uniform(10.0, 25.0) * np.array([np.cos(yaw), np.sin(yaw)]))
        yaw += rng.choice((-1.0, 1.0)) * np.radians(rng.uniform(40.0, 100.0))
    out = np.array(xy)
    way = [*out, *out[-2::-1]]
    pause = [0.0] * len(way)
    pause[len(out) - 1] = 10.0
    span = None
    if detour:  # leaves the middle of a leg of the way back at a right angle, away from the rest of the route
        leg = len(out) + int(rng.integers(0, len(out) - 2))
        a, b = way[leg - 1], way[leg]
        middle, along = 0.5 * (a + b), (b - a) / np.hypot(*(b - a))
        sides = [middle + 20.0 * s * np.array([-along[1], along[0]]) for s in (1.0, -1.0)]
        far = max(sides, key=lambda p: np.hypot(*(out - p).T).min())
        way[leg:leg] = [middle, far, middle + 0.1 * along]
        pause[leg:leg] = [0.0, 0.0, 0.0]
        span = (leg, leg + 2)
    rows = np.column_stack((np.array(way), np.zeros(len(way))))
    labels = tuple(str(k) for k in range(len(rows)))
    return Route(f"detour-{seed}" if detour else f"out-and-back-{seed}", rows, np.array(pause), labels), span


def simulated_return(seed: int, detour: bool, at: str = "turn") -> SimulatedReturn:
    """Walk out and back with the simulator's default noise, told to return at the turn (or ``auto``)."""
    route, span = simulated_route(seed, detour)
    walk = simulate(route, SimulateOptions(walker=Walker()), seed)
    passed_s = walk.checkpoints.t_s - walk.log.t0_s
    turn = int(np.argmax(route.pause_s > 0))
    at = f"{passed_s[turn]:.3f}" if at == "turn" else at
    returned = follow(walk.log, load_config("m5stickc"), at)
    xy = np.column_stack((walk.x_m, walk.y_m))
    true_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))
    out = walk.t_s <= passed_s[turn]
    outbound = returned.guide.outbound
    leave_s, join_s = (passed_s[span[0]], passed_s[span[1]]) if span else (np.inf, np.inf)
    errors, false_off, flagged_s, back_s, arrived_m = [], 0, np.inf, np.inf, np.nan
    for seen_s, row in returned.rows:
        here = np.array([np.interp(row.t_s, walk.t_s, axis) for axis in xy.T])
        if leave_s <= row.t_s <= join_s:
            flagged_s = min(flagged_s, seen_s if row.off_route else np.inf)
            continue
        if row.t_s > join_s and not row.off_route:
            back_s = min(back_s, seen_s)
        if row.t_s < leave_s or np.interp(row.t_s, walk.t_s, true_m) > np.interp(join_s, walk.t_s, true_m) + 10.0:
            false_off += row.off_route
        if row.arrived:
            arrived_m = float(np.hypot(*here))
        nearest = int(np.argmin(np.hypot(*(xy[out] - here).T)))
        claimed_s = row.breadcrumb_t_s
        if not row.off_route:
            errors.append(abs(np.interp(claimed_s, walk.t_s, true_m) - true_m[nearest]))

    def walked_at(when_s: float) -> float:
        return float(np.interp(min(when_s, walk.t_s[-1]), walk.t_s, true_m))

    wrong = 0
    for closure in returned.guide.closures:
        i_s, j_s = returned.track.t_s[[closure.i, closure.j]]
        apart = [np.interp(i_s, walk.t_s, axis) - np.interp(j_s, walk.t_s, axis) for axis in xy.T]
        wrong += bool(np.hypot(*apart) > WRONG_M)
    assert outbound is not None
    return SimulatedReturn(
        walk=walk,
        returned=returned,
        error_m=np.array(errors),
        false_off=false_off,
        flagged_after_m=walked_at(flagged_s) - walked_at(leave_s) if span else np.nan,
        back_after_m=walked_at(back_s) - walked_at(join_s) if span else np.nan,
        arrived_m=arrived_m,
        wrong=wrong,
    )


def simulated(count: int) -> None:
    print(
        f"\n| {count} simulated walks | mean return error | p95 | false off-route rows (walks) | detour flagged after "
        "| on the route again after | arrival announced | not announced | closures, wrong |\n" + "|---" * 9 + "|"
    )
    for name, detour, at in (
        ("out and back", False, "turn"),
        ("out and back, turn noticed", False, "auto"),
        ("with a 20 m detour", True, "turn"),
    ):
        walks = [simulated_return(seed, detour, at) for seed in range(count)]
        error = np.concatenate([w.error_m for w in walks])
        false = [w.false_off for w in walks]
        arrived = np.array([w.arrived_m for w in walks])
        closures, wrong = sum(len(w.returned.guide.closures) for w in walks), sum(w.wrong for w in walks)
        flagged = max(w.flagged_after_m for w in walks)
        back = max(w.back_after_m for w in walks)
        print(
            f"| {name} | {error.mean():.2f} m "
            f"| {np.percentile(error, 95):.2f} m | {sum(false)} ({sum(f > 0 for f in false)}) "
            f"| {f'max {flagged:.1f} m' if detour else '–'} | {f'max {back:.1f} m' if detour else '–'} "
            f"| max {np.nanmax(arrived):.1f} m from the start | {int(np.isnan(arrived).sum())} | {closures}, {wrong} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="Score the way back on the logs of the shared data folder.")
    parser.add_argument("data", type=Path, help="folder with ipin2023/ and indoor-location/")
    parser.add_argument("--simulated", type=int, default=0, metavar="N", help="so many simulated walks as well")
    options = parser.parse_args()
    real(options.data)
    no_way_back(options.data)
    if options.simulated:
        simulated(options.simulated)


if __name__ == "__main__":
    main()
