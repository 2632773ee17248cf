"""Simulated walks without errors, and what is true of them."""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fbgraph.core.geometry import BoolArray
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions

METRONOME = Walker(alpha_m=0.7, beta_m_s=0.0, gamma_m=0.0, gait_variation=0.0)


def perfect(route: str = "square", **options: Any) -> SimulatedWalk:
    return simulate(load_route(route), SimulateOptions(noise=0.0, **options), seed=3)


def attitude(walk: SimulatedWalk) -> Rotation:
    return Rotation.from_quat(np.roll(walk.quat_wxyz, -1, axis=1))


def still(walk: SimulatedWalk) -> BoolArray:
    """Which inertial samples come before the walk."""
    start_s = walk.checkpoints.t_s[0] - walk.log.t0_s
    return np.asarray(walk.log.acc.t_s < start_s)
