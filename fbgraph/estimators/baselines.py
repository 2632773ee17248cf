"""What the smoother is compared with: the paper's two methods on the same steps."""

from __future__ import annotations

from fbgraph.core.config import Config
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.ekf import run_ekf
from fbgraph.estimators.pdr import dead_reckon
from fbgraph.front_end.step_track import StepTrack


def baselines(track: StepTrack, config: Config) -> dict[str, Trajectory]:
    """Plain dead reckoning (``pdr``) and the heading filter (``ekf``) over a whole walk."""
    return {"pdr": dead_reckon(track, config.step_length), "ekf": run_ekf(track, config.ekf)}
