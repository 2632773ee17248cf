"""Online: the batch answer, for any chunks."""

import numpy as np
import pytest
from support.walking import differences, feed

from fbgraph.core.config import Config, load_config
from fbgraph.core.errors import DataError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.pipeline import reconstruct
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import SimulateOptions


@pytest.fixture(scope="module")
def quarter_of_an_hour() -> SensorLog:
    return simulate(load_route("out-and-back"), SimulateOptions(duration_s=900.0), seed=2).log


def test_a_long_walk_through_a_short_window_ends_as_the_batch(quarter_of_an_hour: SensorLog) -> None:
    config = load_config("m5stickc", ["online.window_steps=100", "returning.out_and_back=false"])
    batch = reconstruct(quarter_of_an_hour, config)
    smoother = OnlineSmoother(config)
    updates = feed(smoother, quarter_of_an_hour, 5.0)
    window = smoother.estimate()
    distance_m, yaw_deg = differences(smoother.finish().trajectory, batch.smoothed.trajectory)
    assert distance_m < 0.05
    assert yaw_deg < 0.3
    assert [update.k for update in updates] == list(range(len(updates)))
    # what the last estimate says of now is close to what is known in the end
    end = batch.smoothed.trajectory
    assert np.hypot(window.x_m[-1] - end.x_m[-1], window.y_m[-1] - end.y_m[-1]) < 1.0


def test_updates_do_not_depend_on_the_chunks() -> None:
    log = simulate(load_route("square"), seed=5).log
    runs = []
    for chunk_s in (1e9, 1.0, 0.013):
        smoother = OnlineSmoother(load_config("m5stickc"))
        runs.append((feed(smoother, log, chunk_s), smoother.finish().trajectory))
    for updates, trajectory in runs[1:]:
        assert updates == runs[0][0]
        assert np.array_equal(trajectory.xy_m, runs[0][1].xy_m)


def test_no_step_is_an_error_only_at_the_end() -> None:
    log = simulate(load_route("square"), seed=5).log
    smoother = OnlineSmoother(Config())
    assert smoother.feed(log.between(-np.inf, 2.0)) == []
    with pytest.raises(DataError, match="no step"):
        smoother.finish()
