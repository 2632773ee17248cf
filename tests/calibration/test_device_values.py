"""A device's own errors: from what walks showed, and back into the walks."""

from dataclasses import replace

import numpy as np
import pytest

from fbgraph.calibration.device import SeenDevice, fit_device, held_axes, iron_ahead_left, seen_device
from fbgraph.calibration.gyroscope import scale_by_places
from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import DeviceConfig, load_config
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.detect_steps import detect_steps
from fbgraph.front_end.step_track import StepTrack
from fbgraph.pipeline import reconstruct
from fbgraph.run.walk_result import WalkResult
from fbgraph.simulator.disturbances import offset
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions

CONFIG = load_config("m5stickc")
PRIOR = CONFIG.graph.sigma_gyro_scale
TILTED = np.array([[0.0, np.cos(0.35), -np.sin(0.35)], [-1.0, 0.0, 0.0]])
"""Forward and left of a device whose top edge is raised by 20°."""


def seen(
    iron_b: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0),
    sigma_ut: float = 1.0,
    axes_b: FloatArray = TILTED,
    scale: float = 0.0,
    scale_sigma: float = float("nan"),
    why: str = "",
) -> SeenDevice:
    return SeenDevice("walk", axes_b, axes_b @ iron_b, np.full(2, sigma_ut), why, scale, scale_sigma)


def test_iron_is_told_in_the_devices_axes_and_what_is_vertical_is_left_at_nothing() -> None:
    iron_b = np.array([12.0, 5.0, 3.0])
    found = fit_device([seen(iron_b)] * 4, PRIOR)
    assert found.iron_ut is not None
    np.testing.assert_allclose(TILTED @ found.iron_ut, TILTED @ iron_b, atol=1e-9)
    assert np.cross(TILTED[0], TILTED[1]) @ found.iron_ut == pytest.approx(0.0, abs=1e-9)
    assert found.iron_sigma_ut == pytest.approx(0.5)
    applied = found.applied(CONFIG)
    np.testing.assert_allclose(applied.device.iron_ut, found.iron_ut, atol=0.01)
    assert applied.graph.sigma_iron_ut == 0.5


def test_two_ways_of_holding_it_tell_all_of_it() -> None:
    iron_b = np.array([12.0, 5.0, 3.0])
    upright = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    found = fit_device([seen(iron_b), seen(iron_b, axes_b=upright)], PRIOR)
    assert found.iron_ut is not None
    np.testing.assert_allclose(found.iron_ut, iron_b, atol=1e-9)


def test_holds_that_hardly_differ_make_nothing_up_along_the_vertical() -> None:
    iron_b, other = np.array([12.0, 5.0, 0.0]), np.array([[0.0, np.cos(0.4), -np.sin(0.4)], [-1.0, 0.0, 0.0]])
    off = replace(seen(iron_b, axes_b=other), iron_ut=other @ iron_b + (1.0, 0.0))
    found = fit_device([seen(iron_b), off], PRIOR)
    assert found.iron_ut is not None
    assert abs(np.cross(TILTED[0], TILTED[1]) @ found.iron_ut) < 0.3


@pytest.mark.parametrize(
    ("walks", "said"),
    [
        ([seen((0.5, 0.5, 0.0))], "none to speak of"),
        ([seen((12.0, 0.0, 0.0)), seen((-12.0, 0.0, 0.0))], "the device calibrates itself"),
        ([seen((12.0, 0.0, 0.0), sigma_ut=4.0)], "turn more, walk longer"),
        ([seen(why="not enough turning")], "walk: not enough turning"),
    ],
)
def test_iron_that_is_not_sure_is_not_taken_out(walks: list[SeenDevice], said: str) -> None:
    found = fit_device(walks, PRIOR)
    assert found.iron_ut is None
    assert said in found.notes[0]
    assert found.applied(CONFIG).device == CONFIG.device


def test_the_prior_on_the_gyroscope_counts_once_however_many_walks() -> None:
    found = fit_device([seen(scale=0.03, scale_sigma=0.01), seen(scale=0.02, scale_sigma=0.005)], PRIOR)
    information = 1.0 / 0.01**2 + 1.0 / 0.005**2 + 1.0 / PRIOR**2
    assert found.gyro_scale == pytest.approx((0.03 / 0.01**2 + 0.02 / 0.005**2) / information)
    assert found.gyro_scale_sigma == pytest.approx(information**-0.5)
    applied = found.applied(CONFIG)
    assert applied.graph.sigma_gyro_scale == pytest.approx(information**-0.5, abs=1e-4)
    again = replace(found, gyro_scale=0.01, gyro_scale_sigma=0.001).applied(applied)
    assert 1.0 - again.device.gyro_scale == pytest.approx((1.0 - applied.device.gyro_scale) * 0.99, abs=1e-5)
    assert again.graph.sigma_gyro_scale == 0.003  # the least that is left
    untold = fit_device([seen()] * 3, PRIOR)
    assert untold.gyro_scale is None
    assert "figure of eight" in untold.notes[1]


def eight(shown: float) -> tuple[StepTrack, Checkpoints]:
    """The steps of three rounds of an eight by a gyroscope that shows so much more of every turn, and its corners."""
    walk = simulate(load_route("eight", laps=3), SimulateOptions(), seed=4)
    log = replace(walk.log, gyro=replace(walk.log.gyro, values=walk.log.gyro.values / (1.0 - shown)))
    return detect_steps(log, CONFIG)[0], walk.checkpoints.since(log.t0_s)


def test_turns_between_known_places_tell_the_gyroscopes_scale() -> None:
    for shown in (0.0, 0.03):
        scale, sigma = scale_by_places(*eight(shown), CONFIG.graph)
        assert sigma < 0.012
        assert abs(scale - shown) < 2.0 * sigma
    square = simulate(load_route("square", laps=2), SimulateOptions(), seed=4)
    track = detect_steps(square.log, CONFIG)[0]
    _, unsure = scale_by_places(track, square.checkpoints.since(square.log.t0_s), CONFIG.graph)
    assert unsure > 0.05  # round and round the same way: a bias turns as much
    assert np.isnan(scale_by_places(track, square.checkpoints.select(slice(3)).since(square.log.t0_s), CONFIG.graph)[1])


def walked(iron_b: tuple[float, float, float], laps: int = 2) -> SimulatedWalk:
    return offset(simulate(load_route("square", laps=laps), SimulateOptions(), seed=4), "mag", np.array(iron_b))


@pytest.fixture(scope="module")
def magnetised() -> WalkResult:
    """A wearable with 25 µT of its own, to the right and ahead."""
    return reconstruct(walked((20.0, 15.0, 0.0)).log, CONFIG)


def test_iron_of_a_walk_comes_out_along_the_axes_as_they_were_held(magnetised: WalkResult) -> None:
    np.testing.assert_allclose(held_axes(magnetised), TILTED, atol=0.05)
    one = seen_device(magnetised)
    assert one.why == ""
    np.testing.assert_allclose(one.iron_ut, TILTED @ (20.0, 15.0, 0.0), atol=4.0)
    # in the graph the components are along (cos m, -sin m) of the compass: left, and backwards
    np.testing.assert_allclose(iron_ahead_left(np.array([3.0, -7.0]), DeviceConfig()), (7.0, 3.0), atol=1e-12)
    turned = iron_ahead_left(np.array([3.0, -7.0]), DeviceConfig(declination_deg=90.0))
    np.testing.assert_allclose(turned, (3.0, -7.0), atol=1e-12)


def test_iron_that_is_taken_out_is_no_longer_found(magnetised: WalkResult) -> None:
    found = fit_device([seen_device(magnetised)], PRIOR)
    config = found.applied(CONFIG)
    again = seen_device(reconstruct(magnetised.log, config))
    assert np.hypot(*again.iron_ut) < 2.5
    pdr, before = detect_steps(magnetised.log, config)[0], magnetised.track
    clean, there = detect_steps(walked((0.0, 0.0, 0.0)).log, CONFIG)[0], np.isfinite(before.yaw_mag_rad)
    off = np.angle(np.exp(1j * (pdr.yaw_mag_rad - clean.yaw_mag_rad)[there]))
    was = np.angle(np.exp(1j * (before.yaw_mag_rad - clean.yaw_mag_rad)[there]))
    assert np.sqrt((off**2).mean()) < 0.3 * np.sqrt((was**2).mean())  # PDR and EKF have it taken out too


def test_a_gyroscope_that_shows_too_much_is_corrected_before_anything_is_made_of_it() -> None:
    log = walked((0.0, 0.0, 0.0), laps=1).log
    much = replace(log, gyro=replace(log.gyro, values=log.gyro.values / 0.95))
    config = CONFIG.model_copy(update={"device": CONFIG.device.model_copy(update={"gyro_scale": 0.05})})
    straight, corrected = detect_steps(log, CONFIG)[0], detect_steps(much, config)[0]
    np.testing.assert_allclose(corrected.yaw_gyro_rad, straight.yaw_gyro_rad, atol=1e-6)


def test_who_walks_straight_on_shows_nothing_of_the_iron() -> None:
    straight = simulate(load_route("straight"), SimulateOptions(), seed=2)
    one = seen_device(reconstruct(straight.log, CONFIG))
    assert "in one direction" in one.why
