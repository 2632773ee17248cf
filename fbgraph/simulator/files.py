"""A simulated walk as files: an M5StickC log, and its exact truth beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from fbgraph.core.whole_writes import whole_files
from fbgraph.simulator.routes import Route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions


def write_m5stickc_csv(log: SensorLog, path: Path) -> None:
    """Write a log as an M5StickC logger does; fields of a slower sensor are empty where it has no new sample.

    There is no thermometer in a ``SensorLog``, so ``temp_c`` stays empty. Digits go well below any sensor's resolution.

    Raises:
        DataError: accelerometer and gyroscope are not stamped alike, so that they do not make rows.
        OSError: the file cannot be written.
    """
    if not np.array_equal(log.acc.t_s, log.gyro.t_s):
        raise DataError(f"{log.name}: accelerometer and gyroscope have clocks of their own; cannot write them in rows")
    rows = len(log.acc)
    times = log.acc.t_s
    compass, air, marks = [",,"] * rows, [""] * rows, [""] * rows
    for row, vector in zip(_nearest_rows(times, log.mag.t_s), log.mag.values.tolist(), strict=True):
        compass[row] = "{:.4f},{:.4f},{:.4f}".format(*vector)
    for row, (value,) in zip(_nearest_rows(times, log.pressure.t_s), log.pressure.values.tolist(), strict=True):
        air[row] = f"{value:.5f}"
    for row, event in zip(_nearest_rows(times, np.array([e.t_s for e in log.events])), log.events, strict=True):
        text = f"{marks[row]} {event.label}".strip().replace('"', "'")
        marks[row] = f'"{text}"' if "," in text else text
    t_ms = (times + log.t0_s) * 1000.0
    whole = bool(np.abs(t_ms - np.round(t_ms)).max(initial=0.0) < 1e-3)
    inertial = np.column_stack((t_ms, log.acc.values / STANDARD_GRAVITY_M_S2, log.gyro.values / DEGREE_RAD)).tolist()
    line = ("%.0f" if whole else "%.3f") + ",%.6f" * 6 + ",%s,%s,,%s\n"
    with open(path, "w", encoding="utf-8", newline="") as out:
        out.write(CANONICAL + "\n")
        out.writelines(line % (*row, m, p, e) for row, m, p, e in zip(inertial, compass, air, marks, strict=True))


def _nearest_rows(times_s: FloatArray, t_s: FloatArray) -> list[int]:
    after = np.clip(np.searchsorted(times_s, t_s), 1, len(times_s) - 1)
    nearer_before = t_s - times_s[after - 1] < times_s[after] - t_s
    return [int(row) for row in after - nearer_before]


def write_truth_csv(walk: SimulatedWalk, path: Path, rate_hz: float = 10.0) -> None:
    """Write ``t_s,x_m,y_m,z_m,yaw_rad,step,length_m,turn_rad``; ``t_s`` on the event clock, as in the log's ``t_ms``.

    Rows at ``rate_hz``, one more for every step (with its number, from 1, and its length) and every turn (with its
    angle); ``read_checkpoints`` reads it.

    Raises:
        OSError: the file cannot be written.
    """
    every = max(1, round(1.0 / (rate_hz * (walk.t_s[1] - walk.t_s[0]))))
    grid = np.column_stack((walk.t_s, walk.x_m, walk.y_m, walk.z_m, walk.yaw_rad))[::every]
    yaw_at = [np.interp(t_s, walk.t_s, walk.yaw_rad) for t_s in (walk.steps.t_s, walk.turns.t_s)]
    turn_z = np.interp(walk.turns.t_s, walk.t_s, walk.z_m)
    steps = np.column_stack((walk.steps.t_s, walk.steps.xyz_m, yaw_at[0]))
    turns = np.column_stack((walk.turns.t_s, walk.turns.x_m, walk.turns.y_m, turn_z, yaw_at[1]))
    labels = [",,"] * len(grid)
    labels += [f"{k},{length:.4f}," for k, length in enumerate(walk.steps.length_m.tolist(), 1)]
    labels += [f",,{angle:.6f}" for angle in walk.turns.angle_rad.tolist()]
    table = np.concatenate((grid, steps, turns))
    table[:, 0] += walk.log.t0_s
    order = np.argsort(table[:, 0], kind="stable").tolist()
    rows = table.tolist()
    with open(path, "w", encoding="utf-8", newline="") as out:
        out.write("t_s,x_m,y_m,z_m,yaw_rad,step,length_m,turn_rad\n")
        out.writelines("{:.4f},{:.5f},{:.5f},{:.5f},{:.6f},{}\n".format(*rows[i], labels[i]) for i in order)


def simulate_files(out: Path, route: Route, options: SimulateOptions, seed: int) -> dict[str, Any]:
    """Write a simulated M5StickC log to ``out`` and its exact truth beside it; returns what was written.

    Raises:
        ConfigError: impossible options, or ``out`` cannot be written.
    """
    walk = simulate(route, options, seed)
    truth = out.with_name(f"{out.stem}_truth.csv")
    with whole_files((out, truth), make_parents=True) as (log_to_be, truth_to_be):
        write_m5stickc_csv(walk.log, log_to_be)
        write_truth_csv(walk, truth_to_be)
    return {
        "log": str(out),
        "truth": str(truth),
        "duration_s": round(walk.log.duration_s, 2),
        "steps": len(walk.steps.t_s),
        "distance_m": round(float(walk.steps.length_m.sum()), 2),
        "turns": len(walk.turns.t_s),
    }
