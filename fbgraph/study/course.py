"""The ForestBack paper's obstacle course, simulated: trials at 100 Hz past checkpoints A to E."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from fbgraph.core.errors import ConfigError
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions

TRIALS = 36
"""As in the paper."""
_ROUTE_SCALE, _HOLD_S = 0.91, 0.5
"""Trials of 11.86 s on average (the paper's 42,474 samples / 36 trials / 100 Hz: 11.80 s): the device is calibrated
before it records, so a trial has no more standing than it takes to press a button."""
_ERRORS = 1.85
"""By what all errors of ``simulate``'s data-sheet defaults are multiplied. Set once, by plain PDR alone and before any
other method was run: bisection until the mean RMSE of ``pdr.dead_reckon`` over 360 trials (seeds 0 to 9), its constant
step length the mean of the true ones, was the paper's 1.129 m (it is 1.128 m; final error 1.81 m, the paper's 1.781).
The errors: gyroscope bias 0.5 °/s, mount 3°, wearer's step length 4 %, iron of 6 µT, and all of the sensors' noise."""
_TURN_LABEL_S = 0.5  # a trial is labelled as turning for so long before and after the middle of a corner
OBSTACLE_M = (2.9, -1.3, 5.1, 1.5)
"""The central obstacle that B, C and D lead around: least x and y, largest x and y."""
_SEEDS = 1000  # trials of one seed never share a walk with those of another


def simulated_trials(seed: int, count: int = TRIALS) -> Iterator[tuple[str, SimulatedWalk, str]]:
    """Name, walk and a remark that it is simulated, of each trial; wearer, biases and iron are drawn anew for each.

    Raises:
        ConfigError: a negative seed.
    """
    if seed < 0:
        raise ConfigError(f"the seed must be 0 or more, not {seed}")
    walker = Walker(start_hold_s=_HOLD_S, end_hold_s=_HOLD_S)
    walker = replace(walker, person_sigma=_ERRORS * walker.person_sigma)
    options = SimulateOptions(walker=walker, noise=_ERRORS, anomalies=_ERRORS)
    route = load_route("obstacle", scale=_ROUTE_SCALE)
    for number in range(1, count + 1):
        remark = f"simulated by fbgraph: obstacle course, seed {seed}, errors x {_ERRORS:g}, trial {number}"
        yield f"trial_{number:02d}", simulate(route, options, _SEEDS * seed + number), remark


def write_trial(walk: SimulatedWalk, path: Path, remark: str) -> None:
    """Write a simulated trial as a table of the data set's layout, without any method's output.

    Fields of a slower sensor are empty where it has no new sample. Truth and labels are those of each row's time.

    Args:
        walk: from ``simulate``.
        path: file to write.
        remark: first line, after ``#``: that and how it was simulated.

    Raises:
        OSError: the file cannot be written.
    """
    import pandas as pd

    log = walk.log
    t_s = log.acc.t_s
    table = pd.DataFrame({"time_s": t_s})
    for name, stream, unit in (("acc", log.acc, "ms2"), ("gyro", log.gyro, "rads"), ("mag", log.mag, "ut")):
        rows = np.searchsorted(t_s, stream.t_s)
        for i, axis in enumerate("xyz"):
            table.loc[rows, f"{name}_{axis}_{unit}"] = stream.values[:, i]
    table.loc[np.searchsorted(t_s, log.pressure.t_s), "pressure_hpa"] = log.pressure.values[:, 0]
    table["step"] = 0
    table.loc[np.searchsorted(t_s, walk.steps.t_s).clip(max=len(t_s) - 1), "step"] = 1
    table["turn"] = "none"
    for middle, angle in zip(walk.turns.t_s, walk.turns.angle_rad, strict=True):
        table.loc[np.abs(t_s - middle) <= _TURN_LABEL_S, "turn"] = "left" if angle > 0 else "right"
    table["checkpoint"] = ""
    passed = np.searchsorted(t_s, walk.checkpoints.t_s - log.t0_s).clip(max=len(t_s) - 1)
    table.loc[passed, "checkpoint"] = list(walk.labels)
    for name, values in (("gt_x_m", walk.x_m), ("gt_y_m", walk.y_m), ("gt_heading_rad", walk.yaw_rad)):
        table[name] = np.interp(t_s, walk.t_s, values)
    with open(path, "w", encoding="utf-8", newline="") as out:
        out.write(f"# {remark}\n")
        table.to_csv(out, index=False, float_format="%.6f", lineterminator="\n")
