#!/usr/bin/env python3
"""The figures that only simulated walks can give: noise-free error, normalised error, online against batch.

.venv/bin/python scripts/simulated.py
"""

from __future__ import annotations

import numpy as np

from fbgraph.core.config import load_config
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.pipeline import reconstruct
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import ROUTE_NAMES, load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import SimulateOptions

SEEDS = 30


def main() -> None:
    config = load_config("m5stickc")
    print(
        "| route, perfect sensors, metronome | PDR | EKF | smoother: RMSE / final, % of distance |\n|---|---|---|---|"
    )
    for route in ROUTE_NAMES:
        walk = simulate(load_route(route), SimulateOptions(walker=Walker(gait_variation=0.0), noise=0.0))
        cells = []
        for trajectory in reconstruct(walk.log, config).trajectories.values():
            x_m, y_m = (np.interp(trajectory.t_s, walk.t_s, axis) for axis in (walk.x_m, walk.y_m))
            error = 100.0 * np.hypot(trajectory.x_m - x_m, trajectory.y_m - y_m) / walk.steps.length_m.sum()
            cells.append(f"{np.sqrt((error**2).mean()):.2f} / {error[-1]:.2f}")
        print(f"| {route} | {' | '.join(cells)} |")
    print(f"\n| route, with noise, {SEEDS} seeds | rms of error / sigma: x | y | z |\n|---|---|---|---|")
    for route in ROUTE_NAMES:
        normalised: list[list[np.ndarray]] = [[], [], []]
        for seed in range(SEEDS):
            walk = simulate(load_route(route), seed=seed)
            s = reconstruct(walk.log, config).smoothed.trajectory
            assert s.cov_xy_yaw is not None
            assert s.sigma_z_m is not None
            sigmas = (*np.sqrt(s.cov_xy_yaw[:, [0, 1], [0, 1]]).T, s.sigma_z_m)
            for i, (estimate, truth) in enumerate(((s.x_m, walk.x_m), (s.y_m, walk.y_m), (s.z_m, walk.z_m))):
                normalised[i].append(((estimate - np.interp(s.t_s, walk.t_s, truth)) / sigmas[i])[2:])
        cells = [f"{np.sqrt((np.concatenate(values) ** 2).mean()):.2f}" for values in normalised]
        print(f"| {route} | {' | '.join(cells)} |")
    log = simulate(load_route("out-and-back"), SimulateOptions(duration_s=1800.0), seed=2).log
    online = OnlineSmoother(config)
    online.feed(log)
    end, batch = online.finish().trajectory, reconstruct(log, config).smoothed.trajectory
    apart_m = np.sqrt(((end.xy_m - batch.xy_m) ** 2).sum(axis=1).mean())
    print(f"\n30-minute walk: online's end is {apart_m:.6f} m RMS from the batch smoother's, {len(end)} breadcrumbs")


if __name__ == "__main__":
    main()
