"""Whatever a configuration says, a walk ends with a result or one clear line, soon."""

import time

import numpy as np
import pytest

import fbgraph
from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError, FbgraphError
from fbgraph.pipeline import reconstruct
from fbgraph.run.summary import summarize
from fbgraph.run.walk_result import WalkResult
from fbgraph.session import replay_log

WALK = fbgraph.simulate("out-and-back", seed=3).log.between(-np.inf, 60.0)
EXTREMES = (
    "steps.window_s=1e-9",
    "steps.window_s=1e-9 steps.smoothing_s=1e-9",
    "attitude.rate_hz=10 attitude.still_window_s=3600",
    "attitude.rate_hz=1000 attitude.still_window_s=3600 steps.window_s=3600 steps.smoothing_s=3600",
    "attitude.level_tau_s=1e-300 attitude.altitude_tau_s=1e-300 ekf.altitude_tau_s=1e-300",
    "attitude.max_gap_s=1e-300",
    "steps.spin_window_s=10 steps.max_interval_s=10",
    "steps.min_interval_s=1e-9 steps.min_rise_m_s2=1e-9 steps.min_run=2 steps.lambda_sigma=0 steps.smoothing_s=1e-9",
    "step_length.alpha_m=100 step_length.beta_m_s=100 step_length.gamma_m=-100 step_length.kappa_surge=100",
    "graph.sigma_length_rel=1e4 graph.sigma_lateral_m=1e-6 graph.sigma_yaw_step_rad=1e4 graph.sigma_mag_rad=1e-6",
    "solver.max_iterations=1",
    "solver.max_iterations=100000 solver.relative_error=1e-300",
    "online.window_steps=10 online.relinearize_skip=1000000",
    "online.wildfire=1e-6 online.relinearize_yaw_rad=1e-300 online.relinearize_skip=1",
    "returning.at=30 returning.drift_m=1e-9 returning.sigma_pull_m=1e-6 returning.sigma_turn_rad=1e-6",
    "returning.at=auto returning.retraced_m=1e-9 returning.apart_m=1e4 returning.closure_every_m=1e-9",
)
REFUSED = (
    *("attitude.rate_hz=9.9", "attitude.rate_hz=inf", "attitude.rate_hz=nan", "attitude.rate_hz=true.x"),
    *("steps.window_s=0", "steps.window_s=3601", "steps.spin_window_s=10.1", "steps.max_interval_s=10.1"),
    *("graph.sigma_mag_rad=0", "graph.sigma_mag_rad=1e-7", "graph.mag_correlation_m=1e300", "graph=1"),
    *("device.mount=[0,0,0]", "device.mount=[nan,0,1]", "device.mount=[1,2]", "solver.max_iterations=0"),
    *(f"graph.sigma_mag_rad={'9' * 5000}", f"graph.sigma_mag_rad={'[' * 50_000}", "a.b.c=1", "graph..x=1", "=1"),
    f"{'a.' * 5000}a=1",
)


def ended(run: str, overrides: str) -> WalkResult | FbgraphError:
    """What came of it; everything else is a fault."""
    config = load_config("m5stickc", overrides.split())
    try:
        return reconstruct(WALK, config) if run == "smooth" else replay_log(WALK, config, chunk_s=1.0)
    except FbgraphError as error:
        return error


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("run", ["smooth", "online"])
@pytest.mark.parametrize("overrides", EXTREMES)
def test_an_extreme_configuration_ends_with_a_result_or_one_line(run: str, overrides: str) -> None:
    began = time.monotonic()
    end = ended(run, overrides)
    assert time.monotonic() - began < 10.0
    if isinstance(end, FbgraphError):
        assert str(end)
        assert "\n" not in str(end)
    else:
        assert summarize(end)["steps"] > 0
        assert np.isfinite(end.trajectories[end.best].xy_m).all()


@pytest.mark.parametrize("override", REFUSED)
def test_what_no_walk_needs_is_refused_in_one_short_line(override: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_config("m5stickc", [override])
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300 + len(override)
