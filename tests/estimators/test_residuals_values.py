"""Residuals of every kind of factor at places chosen by hand: sign, size, breadcrumb, robust weight."""

import math

import numpy as np
import pytest
from support.factors import graph_of, make_step, seed_of, stand, values_at

from fbgraph.core.aids import Aids
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import GraphConfig
from fbgraph.estimators.aid_factors import anchor_factor, closed_walk_factor, closure_factor
from fbgraph.estimators.estimates import FACTOR_KINDS, Residuals
from fbgraph.estimators.heading_chain import HeadingChain
from fbgraph.estimators.residuals import compass_table, factor_residuals
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.records import Closure

CONFIG = GraphConfig(
    sigma_length_rel=0.1,
    sigma_lateral_m=0.05,
    sigma_yaw_step_rad=0.02,
    sigma_bias_rad_s=0.01,
    sigma_bias_walk_rad_s=0.001,
    sigma_mag_rad=0.1,
    mag_huber=1.0,
    sigma_altitude_m=0.5,
    sigma_climb_m=0.2,
    sigma_weather_m=0.1,
    sigma_anchor_m=0.3,
    sigma_closure_m=2.0,
)
REST = {"rest_s": 4.0, "rest_rate_rad_s": 0.01, "rest_sigma_rad_s": 0.002}
SENSED = {"yaw_gyro_rad": 0.1, "altitude_m": 301.0, "yaw_mag_rad": 0.3, "mag_norm_ut": 48.0, "mag_dip_rad": 1.0}
STEPS = [
    stand(altitude_m=300.0),
    make_step(t_s=0.25, length_m=0.5, yaw_s=1.0, **SENSED, **REST),
    make_step(t_s=0.5, length_m=0.8, yaw_s=2.0, yaw_gyro_rad=0.1),
]
USUAL_UT = 48.0 * math.cos(1.0)
AT = values_at(
    (0, 0, 0, 0, 0.004),
    (0.6, 0.1, 0.4, 0.0, 0.006, 0.05),
    (1.4, 0.1, 0.3, 0.0, 0.005),
    iron_ut=(0.0, 0.0, USUAL_UT),
)


def residuals() -> dict[str, Residuals]:
    graph = graph_of(STEPS, CONFIG)
    anchors = checkpoints(np.array([0.0]), np.array([0.3]), np.array([0.5]), sigma_m=np.array([0.3]))
    graph.push_back(anchor_factor(anchors, 0, 1, make_step(length_m=0.8), CONFIG))
    graph.push_back(closed_walk_factor(2, CONFIG))
    graph.push_back(closure_factor(Closure(0, 2, 0.7, 1.0)))
    track = StepTrack(STEPS)
    chain = HeadingChain(track, CONFIG, jumps=False)
    heading = chain.start(np.zeros(3), np.zeros(3), np.array([[0.0, 0.0, 1.1 * USUAL_UT]]))
    compass = compass_table(track, seed_of(track, np.zeros(3)), heading, CONFIG)
    return {kind.name: kind for kind in factor_residuals(graph, AT, compass)}


def says(kind: Residuals, *rows: tuple[int, float]) -> bool:
    """Whether its rows are these, each a breadcrumb and a whitened residual."""
    return kind.k.tolist() == [k for k, _ in rows] and np.allclose(kind.whitened, [value for _, value in rows])


def test_every_kind_is_named_and_in_the_order_of_the_table() -> None:
    assert (*residuals(), "axis") == FACTOR_KINDS  # which is no factor of the graph


def test_a_step_that_went_too_far_or_to_the_left_is_positive() -> None:
    found = residuals()
    assert says(found["step_length"], (1, 2.0), (2, 0.0))  # 0.1 m of 10 % of 0.5 m
    assert says(found["step_sideways"], (1, 2.0), (2, 0.0))
    assert found["step_length"].weight.tolist() == [1.0, 1.0]


def test_estimate_minus_measurement_in_sigmas() -> None:
    found = residuals()
    # yaw did not turn, the gyroscope by 0.1, of which 0.04 are the rest's; then by nothing less 0.005 of bias
    assert says(found["heading"], (1, (0.04 - 0.1) / 0.02), (2, 0.25))
    assert says(found["bias_drift"], (0, 0.4), (1, 2.0), (2, -1.0))
    assert says(found["standing_still"], (1, -2.0))
    assert says(found["climb"], (1, 2.0), (2, -0.5))
    assert says(found["weather"], (1, 1.0), (2, -1.0))


def test_a_robust_loss_says_what_it_left() -> None:
    found = residuals()
    x = 0.5 / 6.0  # correlated compass errors: sigma grows by √coth(L / 2c), Huber's bend shrinks by it
    inflation = math.sqrt(1.0 / math.tanh(x / 2.0))
    assert says(found["compass"], (1, -3.0 / inflation))
    assert found["compass"].weight == pytest.approx([1.0 / 3.0])
    # the field is a tenth of what is usual: 1 / 1.1 of it, a sigma and a bit
    assert says(found["field_strength"], (1, -1.0 / 1.1 / inflation))
    assert found["field_strength"].weight.tolist() == [1.0]
    assert says(found["barometer"], (1, -1.3))
    assert found["barometer"].weight.tolist() == [1.0]
    assert says(found["anchor"], (1, 1.0))  # 0.3 and 0.4 m of hypot(0.3, 0.4)
    assert found["anchor"].weight.tolist() == [1.0]


def test_of_a_place_how_far() -> None:
    found = residuals()
    assert says(found["closed_walk"], (2, math.hypot(1.4, 0.1) / 2.0))
    # facing the same way where the other way is meant, half a turn: GTSAM's logarithm of it is π / 2 of the chord
    away = found["closure"].whitened[0]
    assert found["closure"].k.tolist() == [2]
    assert found["closure"].weight[0] < 1.0
    assert away > 1.0


def test_one_closure_facing_back_by_hand() -> None:
    graph = graph_of([stand()], CONFIG)
    graph.push_back(closure_factor(Closure(0, 2, 0.5, 1.0)))
    at = values_at((0, 0, 0, 0, 0), (9, 9, 0, 0, 0), (1.5, 4.0, 0, math.pi, 0))
    (closure,) = [kind for kind in factor_residuals(graph, at) if kind.name == "closure"]
    assert closure.whitened == pytest.approx([5.0])  # 3 sigma along, 4 across
    assert closure.weight == pytest.approx([1.0 / 26.0])  # Cauchy: 1 / (1 + d²), of the whole vector
    assert closure.rms == pytest.approx(5.0)


def test_places_are_known_but_the_origin_is_no_row() -> None:
    graph = graph_of([stand()], CONFIG, Aids())
    found = factor_residuals(graph, values_at((3.0, 4.0, 5.0, 1.0, 0.02)))
    assert [kind.name for kind in found] == ["bias_drift"]
    assert says(found[0], (0, 2.0))


def test_rms_is_the_root_of_the_mean_square() -> None:
    kind = Residuals("heading", np.array([1, 2]), np.array([3.0, -1.0]), np.ones(2))
    assert kind.rms == pytest.approx(math.sqrt(5.0))
