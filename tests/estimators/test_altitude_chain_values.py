"""What is told of altitude to the graph: rides to the breadcrumb, leaps of pressure to the isobar, gusts to sigma."""

import math
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import D, Z
from support.factors import make_step, sigmas_of, stand

from fbgraph.core.config import GraphConfig
from fbgraph.estimators.altitude_chain import AltitudeChain, air_sigma_m, with_gusts_foreseen
from fbgraph.front_end.step_track import Step, StepTrack

CONFIG = GraphConfig(sigma_altitude_m=0.3, sigma_climb_m=0.1, sigma_weather_m=0.02, gust_s=1.5)


def factor_on(steps: list[Step], *keys: int) -> Any:
    graph, chain = gtsam.NonlinearFactorGraph(), AltitudeChain(CONFIG)
    previous = None
    for k, step in enumerate(steps):
        chain.add(k, step, previous, graph)
        previous = step
    (factor,) = [graph.at(i) for i in range(graph.size()) if tuple(graph.at(i).keys()) == keys]
    return factor


def misfit(factor: Any, *values: float) -> float:
    at = gtsam.Values()
    for key, value in zip(factor.keys(), values, strict=True):
        at.insert(key, value)
    return float(factor.unwhitenedError(at)[0])


def test_a_ride_moves_the_breadcrumb_by_its_height() -> None:
    steps = [stand(altitude_m=300.0), make_step(t_s=40.0, altitude_m=312.0, carried_m=12.0)]
    climb = factor_on(steps, Z(0), Z(1))
    assert misfit(climb, 0.0, 12.5) == pytest.approx(0.5)
    assert sigmas_of(climb) == pytest.approx([math.hypot(0.1, 1.2)])
    weather = factor_on(steps, D(0), D(1))
    assert (misfit(weather, 0.0, 0.1), sigmas_of(weather)[0]) == pytest.approx((0.1, 0.02 * math.sqrt(40.0)))


def test_a_leap_of_pressure_lowers_the_isobar() -> None:
    """Eight metres more by the barometer: the surface of equal pressure has sunk by as much."""
    steps = [stand(altitude_m=300.0), make_step(t_s=1.0, altitude_m=308.0, blown_m=8.0)]
    weather = factor_on(steps, D(0), D(1))
    assert misfit(weather, 0.0, -8.0) == pytest.approx(0.0)
    assert sigmas_of(weather) == pytest.approx([math.hypot(0.02, 24.0)])
    assert misfit(factor_on(steps, D(1), Z(1)), -8.0, 0.0) == pytest.approx(0.0)
    assert sigmas_of(factor_on(steps, Z(0), Z(1))) == pytest.approx([0.1])


def test_what_air_scatters_is_the_barometers_sigma_and_shared_by_the_steps_of_a_gust() -> None:
    steps = [stand(altitude_m=300.0, altitude_sigma_m=0.4), make_step(altitude_m=300.0, altitude_sigma_m=0.2)]
    assert sigmas_of(factor_on(steps, D(1), Z(1))) == pytest.approx([math.hypot(0.3, 0.2 * 2.0)])  # 1 + 1.5 s of 2 Hz
    assert sigmas_of(factor_on(steps, D(0))) == pytest.approx([math.hypot(1e-3, 0.4)])  # nor is the start known better
    unknown = [stand(altitude_m=300.0), make_step(altitude_m=300.0)]
    assert sigmas_of(factor_on(unknown, D(1), Z(1))) == pytest.approx([0.3])


def test_slow_changes_that_were_taken_for_air_may_have_been_altitude() -> None:
    steps = [
        stand(altitude_m=300.0),
        make_step(t_s=0.5, blown_m=2.0),  # 4 m/s
        make_step(t_s=1.0, blown_m=80.0),  # nobody moves so fast
        make_step(t_s=1.5),
        make_step(t_s=2.0, blown_m=-3.0),  # -6 m/s
        make_step(t_s=100.0, blown_m=-6.0),
    ]
    assert air_sigma_m(StepTrack(steps)) == pytest.approx([0.0, 1.0, 1.0, 1.0, 1.0, 2.0])


def test_gusts_had_begun_before_they_were_noticed() -> None:
    steps = [make_step(t_s=10.0 * k, altitude_sigma_m=0.1) for k in range(10)]
    steps[7] = replace(steps[7], gusty=True, altitude_sigma_m=0.9)
    steps[5] = replace(steps[5], altitude_sigma_m=1.5)
    known = [step.altitude_sigma_m for step in with_gusts_foreseen(steps)]
    assert known == [0.1, 0.1, 0.1, 0.9, 0.9, 1.5, 0.9, 0.9, 0.1, 0.1]
    assert np.isnan([s.altitude_sigma_m for s in with_gusts_foreseen([make_step()])]).all()
