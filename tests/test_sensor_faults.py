"""Any fault of a sensor or a clock ends in a walk that its own check judges rightly, or in a line that says what is
wrong; the table says which."""

import json
import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from judged_walks import ALLOWED_M, ALLOWED_Z_M, FAR, ellipse_sigmas
from support.broken_tables import Table, table_of
from support.sensor_faults import (
    FAULTS,
    REFUSED,
    SILENT,
    SOUND,
    UNNAMED,
    WIDE,
    WITHHELD,
    Fault,
    faulty,
)

from fbgraph.core.config import load_config
from fbgraph.core.errors import FbgraphError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.pipeline import reconstruct
from fbgraph.readers import read_log
from fbgraph.run.summary import summarize
from fbgraph.run.walk_result import WalkResult
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions

CONFIG = load_config("m5stickc", ["returning.out_and_back=false"])
FASTEST_M_S = 12.5
NAMES_IT = re.compile(r"acceleromet|gyroscop|magnetomet|barometer|column|time")
WHAT_TO_DO = re.compile(r"check |record |log it |mend it|name ")
SLACKS = (0.9, 1.0, 1.1)  # what lies between is a matter of the machine


@dataclass(frozen=True)
class Undisturbed:
    """The walk without a fault: what a fault is measured by."""

    walk: SimulatedWalk
    table: Table
    rmse_m: FloatArray
    steps: int


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    walk = simulate(load_route("square"), SimulateOptions(duration_s=75.0), seed=11)
    path = tmp_path_factory.mktemp("undisturbed") / "walk.csv"
    write_m5stickc_csv(walk.log, path)
    table = table_of(path)
    result = reconstruct(read_log(path).log, CONFIG)
    assert result.integrity.verdict == SOUND
    rmse_m = rms_m(errors_m(walk, table, result))
    assert rmse_m.max() < 2.0
    return Undisturbed(walk, table, rmse_m, len(result.track))


def errors_m(walk: SimulatedWalk, table: Table, result: WalkResult) -> FloatArray:
    """(K+1, 3) the smoothed breadcrumbs less where the wearer was, both from the first on."""
    smoothed, t0_s = result.smoothed.trajectory, result.log.t0_s
    true_s = np.interp(smoothed.t_s + t0_s, table.shown_s, table.true_s) - walk.log.t0_s
    truth = np.column_stack([np.interp(true_s, walk.t_s, axis) for axis in (walk.x_m, walk.y_m, walk.z_m)])
    off = np.column_stack((smoothed.xy_m, smoothed.z_m)) - truth
    return np.asarray(off - off[0])


def rms_m(off_m: FloatArray) -> FloatArray:
    """(2,) on the plan and in altitude."""
    return np.sqrt([(off_m[:, :2] ** 2).sum(axis=1).mean(), (off_m[:, 2] ** 2).mean()])


def worst_sigma(off_m: FloatArray, smoothed: Trajectory) -> float:
    """The largest error in its own sigma, on the plan or in altitude."""
    assert smoothed.sigma_z_m is not None
    in_altitude = np.abs(off_m[:, 2]) / np.hypot(smoothed.sigma_z_m, ALLOWED_Z_M)
    return float(max(ellipse_sigmas(off_m[:, :2], smoothed, ALLOWED_M).max(), in_altitude.max()))


def require_possible(result: WalkResult) -> Mapping[str, Any]:
    """Refuse a result that nobody can have walked or that JSON cannot hold; its summary."""
    believed = result.integrity.verdict != WITHHELD
    assert not (result.failed and believed)
    for name, trajectory in result.trajectories.items():
        t_s = trajectory.t_s
        for values in (t_s, trajectory.x_m, trajectory.y_m, trajectory.z_m, trajectory.yaw_rad, trajectory.distance_m):
            assert np.isfinite(values).all(), name
        assert np.isfinite(trajectory.gyro_bias_rad_s).all(), name
        moved_m = np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m))
        if name != "smoothed" or believed:
            assert (moved_m <= FASTEST_M_S * np.diff(t_s) + 1.0).all(), name
            assert trajectory.distance_m[-1] <= FASTEST_M_S * result.log.duration_s, name
    summary = summarize(result)
    json.dumps(summary, allow_nan=False)
    return summary


def outcomes(fault: Fault, table: Table, result: WalkResult, known: Undisturbed) -> set[str]:
    """What came of a fault that was not refused; more than one where it is nearly another."""
    require_possible(result)
    integrity, off = result.integrity, errors_m(known.walk, table, result)
    if integrity.verdict != SOUND:
        said = " ".join(f"{reason.kind} {reason.sentence}" for reason in integrity.reasons).lower()
        return {integrity.verdict if any(word in said for word in fault.told_by) else UNNAMED}
    most_m, sigma = 1.5 * known.rmse_m + 0.5, worst_sigma(off, result.smoothed.trajectory)

    def outcome(slack: float) -> str:
        if sigma > slack * FAR:
            return SILENT
        return SOUND if (rms_m(off) <= slack * most_m).all() else WIDE

    return {outcome(slack) for slack in SLACKS}


def require_clear(error: FbgraphError) -> None:
    """Refuse an error that is more than a line, or does not say what is wrong and what to do."""
    text = str(error)
    assert "\n" not in text
    assert len(text) < 300
    assert NAMES_IT.search(text), text
    assert WHAT_TO_DO.search(text), text


def reconstructed(table: Table, folder: Path) -> WalkResult:
    """The walk of a log's file."""
    path = folder / "walk.csv"
    path.write_text(table.text())
    return reconstruct(read_log(path).log, CONFIG)


def test_every_fault_has_a_name_of_its_own() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) == 122


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_what_comes_of_a_fault(fault: Fault, undisturbed: Undisturbed, tmp_path: Path) -> None:
    table = faulty(undisturbed.table, fault)
    try:
        result = reconstructed(table, tmp_path)
    except FbgraphError as error:
        require_clear(error)
        found = {REFUSED}
    else:
        found = outcomes(fault, table, result, undisturbed)
    assert fault.outcome in found, found


@pytest.mark.parametrize("name", ["30 min gap", "70 min gap", "clock +1 day"])
def test_both_halves_of_a_walk_whose_clock_was_set_are_kept(
    name: str, undisturbed: Undisturbed, tmp_path: Path
) -> None:
    (fault,) = (fault for fault in FAULTS if fault.name == name)
    halves = reconstructed(faulty(undisturbed.table, fault), tmp_path)
    assert not halves.failed
    assert len(halves.track) == pytest.approx(undisturbed.steps, abs=2)
    assert (halves.track.chained == 0).sum() == 1


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "s"), (1e3, "µs")])
def test_a_clock_in_another_unit_than_it_names_is_read_by_its_steps(
    factor: float, unit: str, undisturbed: Undisturbed, tmp_path: Path
) -> None:
    table = deepcopy(undisturbed.table)
    table.rows[:, 0] *= factor
    result = reconstructed(table, tmp_path)
    assert any(f"in the ms that it names: taken as {unit}" in notice for notice in result.log.notices)
    assert len(result.track) == undisturbed.steps
