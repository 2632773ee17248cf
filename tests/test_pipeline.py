"""Simulated walks through the whole chain: exact without noise, honest about itself with noise."""

import numpy as np
import pytest

from fbgraph.core.config import Config, StepLengthConfig, load_config
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.pipeline import reconstruct
from fbgraph.run.walk_result import WalkResult
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import ROUTE_NAMES, load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions
from fbgraph.way_back.turns import find_turns

METRONOME = Walker(gait_variation=0.0, alpha_m=0.71, beta_m_s=0.0, gamma_m=0.0)
CONSTANT = StepLengthConfig(constant_m=0.71, alpha_m=0.71, beta_m_s=0.0, gamma_m=0.0, beta2_m_s2=0.0, kappa_surge=0.0)


def errors_m(estimate: Trajectory, walk: SimulatedWalk) -> FloatArray:
    truth = np.column_stack([np.interp(estimate.t_s, walk.t_s, axis) for axis in (walk.x_m, walk.y_m)])
    return np.asarray(np.hypot(*(estimate.xy_m - truth).T))


@pytest.fixture(scope="module")
def perfect_walks() -> dict[str, tuple[SimulatedWalk, WalkResult]]:
    config: Config = load_config("m5stickc").model_copy(update={"step_length": CONSTANT})
    walks = {name: simulate(load_route(name), SimulateOptions(walker=METRONOME, noise=0.0)) for name in ROUTE_NAMES}
    return {name: (walk, reconstruct(walk.log, config)) for name, walk in walks.items()}


@pytest.mark.parametrize("route", ROUTE_NAMES)
def test_without_noise_every_step_is_found_and_the_walk_is_right(
    perfect_walks: dict[str, tuple[SimulatedWalk, WalkResult]], route: str
) -> None:
    walk, result = perfect_walks[route]
    distance_m = walk.steps.length_m.sum()
    # who turns about on the spot may do so within a step
    assert abs(len(result.track) - 1 - len(walk.steps.t_s)) <= (route == "out-and-back")
    smoothed = errors_m(result.trajectories["smoothed"], walk)
    assert np.sqrt((smoothed**2).mean()) < 0.01 * distance_m
    assert smoothed[-1] < 0.01 * distance_m
    for name in ("pdr", "ekf"):  # they start on a compass that the first strides have tilted
        assert np.sqrt((errors_m(result.trajectories[name], walk) ** 2).mean()) < 0.025 * distance_m


@pytest.mark.parametrize("route", ["obstacle", "square", "out-and-back"])
def test_turns_are_those_of_the_route(perfect_walks: dict[str, tuple[SimulatedWalk, WalkResult]], route: str) -> None:
    walk, result = perfect_walks[route]
    found = [turn.angle_rad for turn in find_turns(result.trajectories["smoothed"])]
    assert len(found) == len(walk.turns.angle_rad)
    difference = np.asarray(found) - walk.turns.angle_rad
    about_turn = np.abs(np.abs(walk.turns.angle_rad) - np.pi) < 0.1  # left or right about is the same direction
    assert np.abs(difference[~about_turn]).max() < np.radians(12.0)


def test_errors_are_what_the_covariance_says() -> None:
    """Normalised error (error / σ, per axis) over 16 seeds: rms between 0.65 and 1.4.

    Of altitude it may be less: its σ allows for a weather of 1 hPa an hour, the simulator's is kinder.
    """
    config = load_config("m5stickc")
    normalised: dict[str, list[FloatArray]] = {"x": [], "y": [], "z": []}
    for seed in range(16):
        walk = simulate(load_route("out-and-back"), seed=seed)
        smoothed = reconstruct(walk.log, config).trajectories["smoothed"]
        assert smoothed.cov_xy_yaw is not None
        assert smoothed.sigma_z_m is not None
        sigma = (np.sqrt(smoothed.cov_xy_yaw[:, 0, 0]), np.sqrt(smoothed.cov_xy_yaw[:, 1, 1]), smoothed.sigma_z_m)
        for axis, truth, s in zip("xyz", (walk.x_m, walk.y_m, walk.z_m), sigma, strict=True):
            error = getattr(smoothed, f"{axis}_m") - np.interp(smoothed.t_s, walk.t_s, truth)
            normalised[axis].append(error[2:] / s[2:])
    for axis, values in normalised.items():
        rms = np.sqrt((np.concatenate(values) ** 2).mean())
        assert (0.3 if axis == "z" else 0.65) < rms < 1.4, f"{axis}: {rms:.2f}"


def test_a_turned_route_gives_the_turned_walk() -> None:
    """Without noise the answer turns with the world: the same square, walked towards North first."""
    config = load_config("m5stickc").model_copy(update={"step_length": CONSTANT})
    options = SimulateOptions(walker=METRONOME, noise=0.0)
    route = load_route("square")
    turned = type(route)("turned", route.waypoints_m[:, [1, 0, 2]] * (-1.0, 1.0, 1.0), route.pause_s, route.labels)
    a, b = (reconstruct(simulate(r, options).log, config).trajectories["smoothed"] for r in (route, turned))
    assert np.allclose(np.column_stack((-a.y_m, a.x_m)), b.xy_m, atol=0.35)
