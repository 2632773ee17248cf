#!/usr/bin/env python3
"""The README's accuracy tables: every real log in a folder of walks, one configuration, mean of the RMSE, and
what share of the checkpoints lies in the smoother's ellipses.

.venv/bin/python scripts/accuracy.py ../shared/data
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fbgraph.core.aids import Told
from fbgraph.core.config import load_config
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.run.coverage import Coverage, coverage
from fbgraph.run.metrics import Alignment, checkpoint_errors, score

FLOORS_M = {0: 0.0, -1: -3.4, -2: -5.5}  # measured in the museum of ipin2023


def main() -> None:
    parser = argparse.ArgumentParser(description="Score every log of the shared data folder.")
    parser.add_argument("data", type=Path, help="folder with ipin2023/ and indoor-location/")
    data = parser.parse_args().data
    ipin = sorted((data / "ipin2023").glob("*.gz"))
    flat = [path for path in ipin if "Trial51" not in path.name]
    indoor = sorted((data / "indoor-location" / "site1").rglob("*.txt.gz"))
    print(
        "| logs | mode | PDR | EKF | online, at each step | smoother | smoother / EKF | in its 95 % ellipse | NEES |\n"
        "|---|---|---|---|---|---|---|---|---|"
    )
    for name, paths, closed, every in (
        ("ipin2023, 7 single-floor", flat, False, 0),
        ("ipin2023, 7 single-floor", flat, True, 0),
        ("ipin2023, 7 single-floor", flat, False, 3),
        (f"indoor-location/site1, {len(indoor)}", indoor, False, 0),
    ):
        scored = [scores(path, closed, every) for path in paths]
        pdr, ekf, online, smoothed = np.array([rmse for rmse, _ in scored]).mean(axis=0)
        held = Coverage(np.concatenate([covered.nees for _, covered in scored]))
        mode = "closed" if closed else f"anchored (every {every}rd checkpoint)" if every else "unaided"
        print(
            f"| {name} | {mode} | {pdr:.2f} | {ekf:.2f} | {online:.2f} | {smoothed:.2f} | {smoothed / ekf:.2f} "
            f"| {100.0 * held.share:.0f} % of {len(held.nees)} | {held.nees.mean():.2f} |"
        )
    for path in ipin:
        if "Trial51" in path.name:
            altitude(path)


def scores(path: Path, closed: bool, every: int) -> tuple[list[float], Coverage]:
    """RMSE of PDR, EKF, online (unaided, causal) and smoother, and whether the smoother's ellipses hold.

    Anchored runs are scored on the checkpoints not given. Checkpoints have the sigma of their survey.
    """
    log_file = read_log(path)
    truth = log_file.truth
    assert truth is not None
    config = load_config(preset(log_file.log.format))
    anchors = truth.select(slice(0, None, every)) if every else None
    result = reconstruct(log_file.log, config, Told(truth, anchors, closed))
    online = OnlineSmoother(config)
    online.feed(log_file.log)
    online.finish()
    trajectories = {**result.trajectories, "online": online.causal}
    rmse_m = [score(trajectories[n], truth, log_file.log.t0_s).rmse_m for n in ("pdr", "ekf", "online", "smoothed")]
    smoothed = result.trajectories["smoothed"]
    alignment: Alignment = "none" if every else "start"
    if every:
        truth = truth.select(np.arange(len(truth)) % every != 0)
        errors = checkpoint_errors(smoothed, truth, log_file.log.t0_s, "none")
        rmse_m[3] = float(np.sqrt((errors**2).mean()))
    covered = coverage(smoothed, truth, log_file.log.t0_s, alignment)
    assert covered is not None
    return rmse_m, covered


def altitude(path: Path) -> None:
    log_file = read_log(path)
    truth = log_file.truth
    assert truth is not None
    result = reconstruct(log_file.log, load_config(preset(log_file.log.format)))
    z_m = result.trajectories["smoothed"].at(truth.t_s - log_file.log.t0_s)[:, 2]
    off = z_m - [FLOORS_M[int(floor)] for floor in truth.floor]
    print(f"\n{path.name}: altitude off by at most {np.abs(off).max():.2f} m at {len(off)} checkpoints")


if __name__ == "__main__":
    main()
