#!/usr/bin/env python3
"""How well the way back is followed: the README's return tables.

.venv/bin/python scripts/returns.py ../shared/data [--simulated 100]

What is scored, and how: see ``fbgraph.run.return_scores``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fbgraph.core.config import load_config
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.run.return_scores import (
    ReturnScore,
    SimulatedReturnScore,
    follow_back,
    follow_by_position,
    level_lengths_m,
    passes,
    random_return_route,
    retraced_m,
    return_errors,
    score_return,
    score_simulated_return,
)
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate


def real(data: Path) -> None:
    """The logs of ipin2023, beside dead reckoning and the EKF."""
    print(
        "| log, return error mean / max, m | told at the turn | by itself | EKF, by position | PDR, by position "
        "| turn-back off by | known after | arrival announced | off-route rows | closures, wrong |\n"
        + "|---" * 10
        + "|"
    )
    walks: list[ReturnScore] = []
    others: list[list[float]] = [[], []]
    for path in sorted((data / "ipin2023").glob("*.gz")):
        log_file = read_log(path)
        log, truth, config = log_file.log, log_file.truth, load_config(preset(log_file.log.format))
        assert truth is not None
        t_s = truth.t_s - log.t0_s
        walk = score_return(log, truth.xy_m, t_s, config)
        walks.append(walk)
        turned, pairs = passes(truth.xy_m)
        result = reconstruct(log, config)
        level = level_lengths_m(result.track, config)
        constant = np.where(level > 0, config.step_length.constant_m, 0.0)
        errors = [walk.told_m, walk.auto_m]
        for i, (name, length_m) in enumerate((("ekf", level), ("pdr", constant))):
            rows, outbound = follow_by_position(result.trajectories[name], result.track, config, t_s[turned], length_m)
            errors.append(return_errors(rows, outbound, t_s, pairs, float(outbound.route_m[-1])))
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
    all_told, all_auto = (np.concatenate([getattr(w, n) for w in walks]) for n in ("told_m", "auto_m"))
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
        back = follow_back(log_file.log, load_config("phone"), "auto").turn_back
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
            follow_back(simulate(load_route(name, 2.0), seed=seed).log, load_config("m5stickc"), "auto").turn_back
            is not None
            for seed in seeds
        )
        print(f"simulated {name}, {len(seeds)} seeds: {false} turn-backs noticed")


def simulated_return(seed: int, detour: bool, at: str) -> SimulatedReturnScore:
    """Walk out and back with the simulator's default noise, told to return at the ``turn`` (or ``auto``)."""
    route, span = random_return_route(seed, detour)
    walk = simulate(route, seed=seed)
    passed_s = walk.checkpoints.t_s - walk.log.t0_s
    turned_s = float(passed_s[np.argmax(route.pause_s > 0)])
    returned = follow_back(walk.log, load_config("m5stickc"), f"{turned_s:.3f}" if at == "turn" else at)
    detour_s = (float(passed_s[span[0]]), float(passed_s[span[1]])) if span else None
    return score_simulated_return(walk, returned, turned_s, detour_s)


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
        closures, wrong = sum(w.closures for w in walks), sum(w.wrong for w in walks)
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
