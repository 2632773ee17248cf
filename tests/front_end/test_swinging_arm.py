"""An arm that swings to and fro with the stride carries the device; hands that turn it otherwise do not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fbgraph.core.config import load_config
from fbgraph.core.sensor_log import SensorLog, Stream, empty_stream
from fbgraph.front_end.detect_steps import detect_steps
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions

CONFIG = load_config("m5stickc")


@pytest.fixture(scope="module")
def walk() -> SimulatedWalk:
    return simulate(load_route("square"), SimulateOptions(walker=Walker(gait_variation=0.3)), seed=3)


def turned(log: SensorLog, yaw_rad: np.ndarray[tuple[int], np.dtype[np.float64]]) -> SensorLog:
    """The device turned about the vertical by so much at each sample, on the way."""
    up = np.median(log.acc.values, axis=0)
    up /= np.linalg.norm(up)
    undone = Rotation.from_rotvec(-yaw_rad[:, None] * up)
    rate = log.gyro.values + np.gradient(yaw_rad, log.gyro.t_s)[:, None] * up
    acc = Stream(log.acc.t_s, undone.apply(log.acc.values))
    return replace(log, acc=acc, gyro=Stream(log.gyro.t_s, undone.apply(rate)), mag=empty_stream(3))


def swing(walk: SimulatedWalk, size_rad: float, a_step: float) -> SensorLog:
    """Turned to and fro by so much each way, so often a step, while it is walked."""
    log, steps_s = walk.log, walk.steps.t_s
    count = np.interp(log.acc.t_s, steps_s, np.arange(len(steps_s)))
    going = np.interp(log.acc.t_s, [steps_s[0], steps_s[0] + 0.5, steps_s[-1], steps_s[-1] + 0.5], [0.0, 1.0, 1.0, 0.0])
    return turned(log, size_rad * going * np.sin(2.0 * np.pi * a_step * count))


@pytest.mark.parametrize("size_deg", [46.0, 70.0])
def test_steps_of_a_swinging_arm_are_found(walk: SimulatedWalk, size_deg: float) -> None:
    track, _ = detect_steps(swing(walk, np.radians(size_deg), 0.5), CONFIG)
    assert len(track) - 1 == pytest.approx(len(walk.steps.t_s), abs=3)


@pytest.mark.parametrize("a_step", [0.33, 0.8])
def test_what_turns_to_and_fro_but_not_with_the_stride_is_handled(walk: SimulatedWalk, a_step: float) -> None:
    level = swing(walk, 0.0, 0.5)
    assert len(detect_steps(level, CONFIG)[0]) - 1 == pytest.approx(len(walk.steps.t_s), abs=1)
    track, _ = detect_steps(swing(walk, np.radians(70.0), a_step), CONFIG)
    assert len(track) - 1 < 0.7 * len(walk.steps.t_s)
