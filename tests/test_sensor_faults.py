"""Any fault of a sensor or a clock ends in a finite walk or in a line that says what is wrong; the table says which."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.broken_tables import Table, table_of
from support.sensor_faults import FAULTS, REFUSED, SILENT, SOUND, TOLD, WIDE, Fault, faulty

from fbgraph.core.config import load_config
from fbgraph.core.errors import FbgraphError
from fbgraph.core.geometry import FloatArray
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
WHAT_TO_DO = re.compile(r"check |record ")
SLACKS = (0.9, 1.0, 1.1)  # what lies between is a matter of the machine
NOT_OF_A_FAULT = ("gyroscope's bias by the smoother", "the wearer never stood still")


@dataclass(frozen=True)
class Undisturbed:
    """The walk without a fault: what a fault is measured by."""

    walk: SimulatedWalk
    table: Table
    said: frozenset[str]
    rmse_m: float
    altitude_rmse_m: float
    steps: int


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    walk = simulate(load_route("square"), SimulateOptions(duration_s=75.0), seed=11)
    path = tmp_path_factory.mktemp("undisturbed") / "walk.csv"
    write_m5stickc_csv(walk.log, path)
    table = table_of(path)
    result = reconstruct(read_log(path).log, CONFIG)
    error_m, _ = errors(walk, table, result)
    assert np.sqrt((error_m**2).mean(axis=0)).max() < 2.0
    rmse_m, altitude_rmse_m = np.sqrt((error_m**2).mean(axis=0)).tolist()
    return Undisturbed(walk, table, frozenset(said(summarize(result))), rmse_m, altitude_rmse_m, len(result.track))


def errors(walk: SimulatedWalk, table: Table, result: WalkResult) -> tuple[FloatArray, FloatArray]:
    """Errors on the plan and in altitude twice a second, (N, 2), and what they should be of, one sigma each."""
    log, smoothed = result.log, result.smoothed.trajectory
    rows = np.arange(0, len(table.rows), max(1, round(0.5 * len(table.rows) / log.duration_s)))[:2000]
    shown_s, true_s = table.shown_s[rows] - log.t0_s, table.true_s[rows] - walk.log.t0_s
    truth = np.column_stack([np.interp(true_s, walk.t_s, axis) for axis in (walk.x_m, walk.y_m, walk.z_m)])
    off = smoothed.at(shown_s) - truth
    off -= off[0]
    assert smoothed.longest_sigma_m is not None
    assert smoothed.sigma_z_m is not None
    sigmas = [np.interp(shown_s, smoothed.t_s, sigma) for sigma in (smoothed.longest_sigma_m, smoothed.sigma_z_m)]
    return np.column_stack((np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2]))), np.column_stack(sigmas)


def said(summary: Mapping[str, Any]) -> set[str]:
    """Everything a run says of its walk, without numbers."""
    texts = [*summary["warnings"], *(finding["text"] for finding in summary["findings"])]
    return {re.sub(r"[-+\d.]+", "#", text) for text in texts if not text.startswith(NOT_OF_A_FAULT)}


def require_possible(result: WalkResult) -> dict[str, Any]:
    """Refuse a result that nobody can have walked or that JSON cannot hold; its summary."""
    assert not result.failed
    for name, trajectory in result.trajectories.items():
        t_s = trajectory.t_s
        for values in (t_s, trajectory.x_m, trajectory.y_m, trajectory.z_m, trajectory.yaw_rad, trajectory.distance_m):
            assert np.isfinite(values).all(), name
        assert np.isfinite(trajectory.gyro_bias_rad_s).all(), name
        moved_m = np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m))
        assert (moved_m <= FASTEST_M_S * np.diff(t_s) + 1.0).all(), name
        assert trajectory.distance_m[-1] <= FASTEST_M_S * result.log.duration_s, name
    summary = summarize(result)
    json.dumps(summary, allow_nan=False)
    return summary


def outcomes(fault: Fault, table: Table, result: WalkResult, known: Undisturbed) -> set[str]:
    """What came of a fault that was not refused; more than one where it is nearly another."""
    new = said(require_possible(result)) - known.said
    told = any(word in text for word in fault.told_by for text in new)
    error_m, sigma_m = errors(known.walk, table, result)
    rmse_m = np.sqrt((error_m**2).mean(axis=0))
    most_m = 1.5 * np.array([known.rmse_m, known.altitude_rmse_m]) + 0.5

    def outcome(slack: float) -> str:
        if (rmse_m <= slack * most_m).all():
            return SOUND
        if told:
            return TOLD
        return WIDE if (error_m <= slack * (4.0 * sigma_m + 0.5)).all() else SILENT

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
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) == 124


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
