#!/usr/bin/env python3
"""Turns and legs of simulated walks, realistic noise, against their truth: the figures of `fbgraph guide`.

.venv/bin/python scripts/turns.py [SEEDS]

A true turn is a corner of the route of at least 30°; the smoother's trajectory is searched, without truth. How a found
turn is matched to a true one stands in `fbgraph.run.metrics.score_turns`. Every built-in route is used; their corners,
`eight` included, are 45° to 180°. `random` walks have ten legs of 3 to 15 m, with turns of 40° to 150° and, never two
in a row, bends of 10° to 20° that are no turns. Legs: error of the estimated leg between the true corners, along and
across, over the standard deviation that is given for it; likewise the whole walk.
"""

from __future__ import annotations

import sys

import numpy as np

from fbgraph.core.config import load_config
from fbgraph.core.trajectory import Trajectory
from fbgraph.pipeline import reconstruct
from fbgraph.run.metrics import score_turns
from fbgraph.simulator.routes import ROUTE_NAMES, Route, load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.way_back.legs import directions_of

HEADS = ("route", "walks", "true turns", "missed", "phantom", "recall %", "precision %", "angle rms °")
LEG_HEADS = ("error / sigma: along", "across", "whole walk")


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    print(f"| {' | '.join(HEADS + LEG_HEADS)} |\n|{'---|' * len(HEADS + LEG_HEADS)}")
    total = np.zeros(4)
    for name in (*ROUTE_NAMES, "random"):
        counts, angles, ratios = np.zeros(4), [np.zeros(0)], []
        for seed in range(seeds):
            walk = simulate(random_route(seed) if name == "random" else load_route(name), seed=seed)
            smoothed = reconstruct(walk.log, CONFIG).smoothed.trajectory
            score = score_turns(smoothed, walk.turns.t_s, walk.turns.angle_rad)
            counts += (1, score.found, len(score.missed), len(score.phantom))
            angles.append(np.degrees(score.error_rad))
            if not (score.missed or score.phantom):
                ratios += leg_ratios(walk, smoothed)
        total += counts
        rms = [np.sqrt(np.nanmean(np.square(column))) for column in np.array(ratios).T]
        angle = np.concatenate(angles)
        print_row(name, counts, f"{np.sqrt((angle**2).mean()):.1f}" if len(angle) else "–", *(f"{r:.2f}" for r in rms))
    print_row("all", total, "", "", "", "")


def random_route(seed: int) -> Route:
    rng = np.random.default_rng((2023, seed))
    yaw, bend, places = rng.uniform(-np.pi, np.pi), False, [np.zeros(3)]
    for _ in range(10):
        length_m = rng.uniform(3.0, 15.0)
        places.append(places[-1] + length_m * np.array((np.cos(yaw), np.sin(yaw), 0.0)))
        bend = not bend and rng.random() < 0.4
        yaw += np.radians(rng.uniform(10.0, 20.0) if bend else rng.uniform(40.0, 150.0)) * rng.choice((-1.0, 1.0))
    return Route("random", np.array(places), np.zeros(11), tuple(map(str, range(11))))


def leg_ratios(walk: SimulatedWalk, smoothed: Trajectory) -> list[tuple[float, float, float]]:
    """Error over sigma of each leg, along and across, and once of the walk."""
    there = directions_of(smoothed, graph=CONFIG.graph)
    real = np.abs(walk.turns.angle_rad) >= np.radians(30.0)
    corners = np.column_stack((walk.turns.x_m, walk.turns.y_m))[real]
    corners = np.vstack(((walk.x_m[0], walk.y_m[0]), corners, (walk.x_m[-1], walk.y_m[-1])))
    ratios = []
    for leg, true in zip(there.legs, np.diff(corners, axis=0), strict=True):
        assert leg.sigma_along_m is not None
        assert leg.sigma_across_m is not None
        error = np.subtract(leg.points_m[-1], leg.points_m[0])[:2] - true
        along, across = error @ leg.direction, error @ (-leg.direction[1], leg.direction[0])
        ratios.append((along / leg.sigma_along_m, across / leg.sigma_across_m, np.nan))
    error = np.subtract(there.points_m[-1], there.points_m[0])[:2] - (corners[-1] - corners[0])
    assert there.sigma_m is not None
    return [*ratios, (np.nan, np.nan, float(np.hypot(*error)) / there.sigma_m)]


def print_row(name: str, counts: np.ndarray, *rest: str) -> None:
    walks, found, missed, phantom = counts.tolist()
    shares = [f"{100 * found / (found + other):.2f}" if found else "–" for other in (missed, phantom)]
    cells = (name, f"{walks:.0f}", f"{found + missed:.0f}", f"{missed:.0f}", f"{phantom:.0f}", *shares, *rest)
    print(f"| {' | '.join(cells)} |", flush=True)


CONFIG = load_config("m5stickc")

if __name__ == "__main__":
    main()
