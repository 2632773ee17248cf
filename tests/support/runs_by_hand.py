"""Run folders of walks made by hand, on disk in a moment: no estimator ran."""

from pathlib import Path
from typing import Any

from fbgraph.core.trajectory import Trajectory
from fbgraph.run.folder import write_tables
from fbgraph.run.summary import summarize
from support.results_by_hand import hand_result


def hand_run(folder: Path, smoothed: Trajectory, ekf: Trajectory | None = None, **given: Any) -> Path:
    """Write the run of a walk that was smoothed to this; the EKF's is the same and the PDR missing unless given."""
    ekf = smoothed if ekf is None else ekf
    result = hand_result(smoothed, trajectories={"ekf": ekf, "smoothed": smoothed}, **given)
    folder.mkdir(parents=True)
    write_tables(result, folder, summarize(result))
    return folder
