"""Each sentence of the table atop fbgraph.estimators.factor_graph: the factors of one step, computed on paper."""

import math
from typing import Any

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import B, D, I, X, Z
from support.factors import Array, factors_of, graph_of, is_robust, make_step, sigmas_of, stand, the_factor, values_at

from fbgraph.core.aids import Aids
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import GraphConfig
from fbgraph.estimators.factor_graph import heading_factor
from fbgraph.estimators.gyroscope import GyroTurn
from fbgraph.estimators.node import Node
from fbgraph.front_end.step_track import Step

CONFIG = GraphConfig(
    sigma_length_rel=0.1,
    sigma_slope_rel=0.5,
    sigma_lateral_m=0.04,
    sigma_length_scale=0.06,
    aided_length_steps=25.0,
    sigma_yaw_step_rad=0.02,
    sigma_bias_rad_s=0.008,
    sigma_bias_walk_rad_s=3e-4,
    sigma_mag_rad=0.2,
    mag_correlation_m=6.0,
    mag_huber=1.5,
    norm_scale_ut=20.0,
    dip_scale_rad=0.5,
    sigma_gap_m_s=1.5,
    sigma_gap_yaw_rad_s=0.25,
    sigma_altitude_m=0.3,
    sigma_climb_m=0.11,
    sigma_weather_m=0.03,
)
START = (0.0, 0.0, 0.0, 0.0, 0.0)
ONE_PLACE = Aids(checkpoints(np.zeros(1), np.zeros(1), np.zeros(1)))


def error_at(factor: Any, *nodes: tuple[float, ...]) -> float:
    return float(factor.error(values_at(*nodes)))


def test_step_length_sees_the_breadcrumb_before_one_length_behind() -> None:
    graph = graph_of([stand(), make_step(length_m=0.7)], CONFIG)
    factor = the_factor(graph, "BetweenFactorPose2", X(1), X(0))
    # moved 0.9 m to the North facing North: nothing is left but 0.2 m too far along
    values = values_at((2.0, 3.0, 0, math.pi / 2, 0), (2.0, 3.9, 0, math.pi / 2, 0))
    assert np.allclose(factor.unwhitenedError(values), [-0.2, 0.0, 0.0], atol=1e-12)
    # 0.1 m to the left of where North leads: the one before lies 0.1 m to the right, whose sign is minus
    values = values_at((2.0, 3.0, 0, math.pi / 2, 0), (1.9, 3.7, 0, math.pi / 2, 0))
    assert np.allclose(factor.unwhitenedError(values), [0.0, -0.1, 0.0], atol=1e-12)
    assert not is_robust(factor)
    assert np.allclose(sigmas_of(factor), [0.07, 0.04, 100.0])  # 10 % of 0.7 m; sideways; the yaw says nothing


def test_step_length_goes_where_the_later_step_faces() -> None:
    factor = the_factor(graph_of([stand(), make_step(length_m=0.7)], CONFIG), "BetweenFactorPose2", X(1), X(0))
    turned = values_at((0, 0, 0, 0, 0), (0.0, 0.7, 0, math.pi / 2, 0))
    assert np.allclose(factor.unwhitenedError(turned)[:2], 0.0, atol=1e-12)
    assert factor.error(turned) == pytest.approx(0.5 * (math.pi / 2 / 100.0) ** 2)


def test_the_slope_term_adds_its_own_share_to_the_length_sigma() -> None:
    step = make_step(length_m=0.6, shortened_m=0.16)
    factor = the_factor(graph_of([stand(), step], CONFIG), "BetweenFactorPose2", X(1), X(0))
    assert sigmas_of(factor)[:2] == pytest.approx([0.1, 0.04])  # hypot(10 % of 0.6, half of 0.16) = hypot(.06, .08)


def test_a_doubtful_length_is_doubtful_in_every_direction() -> None:
    step = make_step(length_m=0.6, doubt_m=0.08)
    factor = the_factor(graph_of([stand(), step], CONFIG), "BetweenFactorPose2", X(1), X(0))
    assert sigmas_of(factor)[:2] == pytest.approx([0.1, np.hypot(0.04, 0.08)])


@pytest.mark.parametrize("aids", [ONE_PLACE, Aids(closed_walk=True)])
def test_known_places_let_every_step_stretch_by_the_error_they_share(aids: Aids) -> None:
    factor = the_factor(graph_of([stand(), make_step()], CONFIG, aids), "BetweenFactorPose2", X(1), X(0))
    # 6 % spread over 25 steps: 0.06 √25 = 0.3; hypot(0.1, 0.3) of 0.7 m
    assert sigmas_of(factor)[0] == pytest.approx(0.7 * math.sqrt(0.1))
    assert sigmas_of(factor)[1] == pytest.approx(0.04)


def test_after_a_gap_the_wearer_may_be_anywhere_a_walker_gets_to() -> None:
    steps = [stand(t_s=1.0), make_step(t_s=5.0, start_s=4.5, chained=False)]
    factor = the_factor(graph_of(steps, CONFIG), "BetweenFactorPose2", X(1), X(0))
    assert np.allclose(sigmas_of(factor), [6.0, 6.0, 1.0])  # four seconds at 1.5 m/s and 0.25 rad/s
    assert factor.measured().theta() == 0.0


def test_after_a_long_gap_any_direction_is_as_likely_and_no_more() -> None:
    for silent_s, sigma_rad in ((12.0, 3.0), (13.0, math.pi), (1e4, math.pi)):
        steps = [stand(t_s=1.0), make_step(t_s=1.0 + silent_s, chained=False)]
        factor = the_factor(graph_of(steps, CONFIG), "BetweenFactorPose2", X(1), X(0))
        assert sigmas_of(factor)[2] == pytest.approx(sigma_rad)


def test_heading_holds_the_turn_to_the_gyroscope_less_its_bias() -> None:
    steps = [stand(yaw_gyro_rad=1.0, yaw_s=0.2), make_step(yaw_gyro_rad=1.5, yaw_s=0.9)]
    factor = the_factor(graph_of(steps, CONFIG), "LinearContainerFactor", X(0), X(1), B(1))
    # Δyaw + b Δt - increment, b of the later breadcrumb, Δt = 0.7 between the middles: 0.6 + 0.1 * 0.7 - 0.5 = 0.17
    at = ((5.0, 1.0, 0, 0.3, 0.9), (2.0, 2.0, 0, 0.9, 0.1))
    assert error_at(factor, *at) == pytest.approx(0.5 * (0.17 / 0.02) ** 2)
    # ... and nothing where they agree: 0.57 - 0.07
    assert error_at(factor, START, (0, 0, 0, 0.57, -0.1)) == pytest.approx(0.0, abs=1e-12)


def test_heading_says_the_same_wherever_it_was_linearised() -> None:
    """Only the turn to the nearest π of the linearisation point matters: who turned by 4 rad did not turn by -2.28."""
    steps = [stand(yaw_gyro_rad=0.0), make_step(yaw_gyro_rad=4.0, yaw_s=0.5)]
    nodes = [Node(1.0, 2.0, 3.0, 0.1, 0.5), Node(4.0, 5.0, 6.0, 4.2, -0.3)]
    factor = the_factor(graph_of(steps, CONFIG, nodes=nodes), "LinearContainerFactor", X(0), X(1), B(1))
    assert error_at(factor, (9, 9, 9, 0.2, 9), (8, 8, 8, 4.2, 0.0)) == pytest.approx(0.0, abs=1e-12)
    assert error_at(factor, (9, 9, 9, 0.2, 9), (8, 8, 8, 4.24, 0.0)) == pytest.approx(0.5 * 2.0**2)


def test_across_a_gap_the_gyroscope_says_nothing_of_the_turn() -> None:
    for chained in (True, False):
        graph = graph_of([stand(), make_step(chained=chained)], CONFIG)
        assert len(factors_of(graph, "LinearContainerFactor", X(0), X(1), B(1))) == chained


def test_the_bias_walks_with_the_square_root_of_time() -> None:
    graph = graph_of([stand(yaw_s=0.2), make_step(yaw_s=1.2), make_step(yaw_s=5.2)], CONFIG)
    for k, sigma in ((1, 3e-4), (2, 6e-4)):
        factor = the_factor(graph, "BetweenFactorVector", B(k - 1), B(k))
        assert sigmas_of(factor) == pytest.approx([sigma, 1e-5])  # the scale stays as it is
        assert not is_robust(factor)
    values = values_at(START, (0, 0, 0, 0, 0.002), (0, 0, 0, 0, 0.005))
    assert factor.unwhitenedError(values) == pytest.approx([0.003, 0.0])


def test_two_steps_at_one_time_still_have_a_bias_walk() -> None:
    factor = the_factor(graph_of([stand(yaw_s=1.0), make_step(yaw_s=1.0)], CONFIG), "BetweenFactorVector", B(0), B(1))
    assert sigmas_of(factor)[0] == pytest.approx(3e-4 * math.sqrt(1e-3))


def test_a_rest_measures_the_bias_of_the_step_after_it() -> None:
    rest = {"rest_s": 4.0, "rest_rate_rad_s": 0.012, "rest_sigma_rad_s": 5e-4}
    graph = graph_of([stand(), make_step(**rest), make_step()], CONFIG)
    factor = the_factor(graph, "LinearContainerFactor", B(1))
    assert error_at(factor, START, (0, 0, 0, 0, 0.013)) == pytest.approx(0.5 * 2.0**2)
    assert factors_of(graph, "LinearContainerFactor", B(2)) == []


USUAL_UT = 48.0 * math.cos(1.1)
NO_IRON = (0.0, 0.0, USUAL_UT)


def compass_of(step: Step, yaw_rad: float) -> Any:
    """The compass factor of one step, made where the walk goes in this direction."""
    nodes = [Node(0.0, 0.0, 0.0, yaw_rad, 0.0)] * 2
    return the_factor(graph_of([stand(), step], CONFIG, nodes=nodes), "LinearContainerFactor", X(1), I(0))


def compass_sigma(factor: Any) -> float:
    """By how much yaw may be off, by the factor's derivative."""
    linear = factor.linearize(values_at(START, START, iron_ut=NO_IRON))
    return 1.0 / float(linear.augmentedJacobian()[0, 2])


def test_the_compass_is_believed_once_per_correlation_length() -> None:
    """N steps know as much as N (1 - a) / (1 + a) free ones, with a = exp(-0.7 / 6): √coth(0.7 / 12)."""
    step = make_step(length_m=0.7, yaw_mag_rad=0.5, mag_norm_ut=48.0, mag_dip_rad=1.1)
    factor, sigma = compass_of(step, 0.8), 0.2 * 4.1427403  # √(1.8898818 / 0.1101182)
    assert compass_sigma(factor) == pytest.approx(sigma, rel=1e-6)
    for yaw_rad, off in ((0.79, 0.29), (0.5, 0.0), (0.0, -0.5)):
        values = values_at(START, (7, 8, 0, yaw_rad, 0), iron_ut=NO_IRON)
        assert factor.error(values) == pytest.approx(0.5 * (off / sigma) ** 2, abs=1e-9)


def test_a_compass_far_off_is_weighed_where_it_was_made() -> None:
    """Huber's loss bends 1.5 * 0.2 rad from the reading, whatever the inflation: w r is its slope."""
    step = make_step(length_m=0.7, yaw_mag_rad=0.5, mag_norm_ut=48.0, mag_dip_rad=1.1)
    usual = compass_sigma(compass_of(step, 0.5))
    for yaw_rad, weight in ((0.79, 1.0), (1.1, 0.5), (1.7, 0.25), (-1.0, 0.2)):
        assert compass_sigma(compass_of(step, yaw_rad)) == pytest.approx(usual / math.sqrt(weight))


def test_a_compass_step_on_the_spot_counts_as_five_centimetres() -> None:
    step = make_step(length_m=0.0, yaw_mag_rad=0.5, mag_norm_ut=48.0, mag_dip_rad=1.1)
    a = math.exp(-0.05 / 6.0)
    assert compass_sigma(compass_of(step, 0.5)) == pytest.approx(0.2 * math.sqrt((1 + a) / (1 - a)))


def test_an_unusual_field_weakens_the_compass() -> None:
    usual = make_step(yaw_mag_rad=0.0, mag_norm_ut=48.0, mag_dip_rad=1.0)
    stronger = make_step(yaw_mag_rad=0.0, mag_norm_ut=78.0, mag_dip_rad=1.0)
    steeper = make_step(yaw_mag_rad=0.0, mag_norm_ut=48.0, mag_dip_rad=1.5)
    graph = graph_of([stand(), usual, usual, usual, stronger, steeper], CONFIG)
    values = values_at(*[START] * 6, iron_ut=NO_IRON)
    sigma = [
        1.0 / float(the_factor(graph, "LinearContainerFactor", X(k), I(0)).linearize(values).augmentedJacobian()[0, 2])
        for k in range(1, 6)
    ]
    # 1 + (30 µT / 20 µT)² = 3.25 and 1 + (0.5 rad / 0.5 rad)² = 2
    assert np.array(sigma) / sigma[0] == pytest.approx([1.0, 1.0, 1.0, math.sqrt(3.25), math.sqrt(2.0)])


def test_iron_in_the_device_turns_the_compass_and_strengthens_the_field() -> None:
    """Facing north of a field of 21.8 µT: 2 µT to the left turn the reading by 92 mrad, ahead they add to it."""
    step = make_step(length_m=0.7, yaw_mag_rad=0.0, mag_norm_ut=48.0, mag_dip_rad=1.1)
    factor, sigma = compass_of(step, 0.0), 0.2 * 4.1427403
    for iron_ut, row in (
        ((2.0, 0.0, USUAL_UT), (0.0, -2.0 / USUAL_UT)),
        ((0.0, 2.0, USUAL_UT), (-2.0 / USUAL_UT, 0.0)),
        ((0.0, 0.0, USUAL_UT + 2.0), (0.0, -2.0 / USUAL_UT)),
    ):
        error = factor.error(values_at(START, START, iron_ut=iron_ut))
        assert error == pytest.approx(0.5 * float(np.square(row).sum()) / sigma**2)
        right = factor.linearize(values_at(START, START, iron_ut=iron_ut)).augmentedJacobian()[:, -1]
        assert np.allclose(-right, np.array(row) / sigma)


def test_without_a_compass_there_is_none() -> None:
    graph = graph_of([stand(), make_step()], CONFIG)
    assert all(gtsam.Symbol(key).chr() != ord("i") for key in graph.keyVector())


def test_the_barometer_measures_from_the_isobar_of_the_start() -> None:
    graph = graph_of([stand(altitude_m=300.0), make_step(altitude_m=302.5), make_step()], CONFIG)
    factor = the_factor(graph, "BetweenFactorDouble", D(1), Z(1))
    assert sigmas_of(factor) == pytest.approx([0.3])
    assert factor.unwhitenedError(values_at(START, (0, 0, 2.9, 0, 0))) == pytest.approx([0.4])
    assert factor.unwhitenedError(values_at(START, (0, 0, 2.9, 0, 0, 0.4))) == pytest.approx([0.0])
    # Huber of 1.345: 3 m are 10 sigma, 1.345 (10 - 1.345 / 2)
    assert error_at(factor, START, (0, 0, 5.5, 0, 0)) == pytest.approx(1.345 * (10 - 0.6725))
    assert error_at(factor, START, (0, 0, 2.5 + 0.39, 0, 0)) == pytest.approx(0.5 * 1.3**2)
    for symbol in (Z, D):  # the start defines both
        (prior,) = factors_of(graph, "PriorFactorDouble", symbol(0))
        assert sigmas_of(prior) == pytest.approx([1e-3])
    assert factors_of(graph, "BetweenFactorDouble", D(0), Z(0)) == []
    assert factors_of(graph, "BetweenFactorDouble", D(2), Z(2)) == []


def test_a_barometer_that_comes_late_starts_the_count_itself() -> None:
    steps = [stand(), make_step(altitude_m=300.0), make_step(altitude_m=301.0)]
    graph = graph_of(steps, CONFIG)
    values = values_at(START, (0, 0, 0.0, 0, 0), (0, 0, 1.0, 0, 0))
    for k in (1, 2):
        assert the_factor(graph, "BetweenFactorDouble", D(k), Z(k)).unwhitenedError(values) == pytest.approx([0.0])


def test_nobody_climbs_much_in_one_step() -> None:
    graph = graph_of([stand(), make_step()], CONFIG)
    factor = the_factor(graph, "BetweenFactorDouble", Z(0), Z(1))
    assert sigmas_of(factor) == pytest.approx([0.11])
    assert not is_robust(factor)
    assert factor.unwhitenedError(values_at((0, 0, 1.0, 0, 0), (0, 0, 1.3, 0, 0))) == pytest.approx([0.3])


def test_while_the_log_was_silent_the_wearer_may_have_climbed_as_far_as_walked() -> None:
    graph = graph_of([stand(), make_step(t_s=4.0, chained=False)], CONFIG)
    assert sigmas_of(the_factor(graph, "BetweenFactorDouble", Z(0), Z(1))) == pytest.approx([math.hypot(0.11, 6.0)])


def test_the_isobar_wanders_with_the_square_root_of_time() -> None:
    steps = [stand(), make_step(t_s=4.0), make_step(t_s=4.0)]
    graph = graph_of(steps, CONFIG)
    factor = the_factor(graph, "BetweenFactorDouble", D(0), D(1))
    assert sigmas_of(factor) == pytest.approx([0.06])
    assert factor.unwhitenedError(values_at((0, 0, 0, 0, 0, 1.0), (0, 0, 0, 0, 0, 1.3))) == pytest.approx([0.3])
    assert not is_robust(factor)
    at_one_time = the_factor(graph, "BetweenFactorDouble", D(1), D(2))
    assert sigmas_of(at_one_time) == pytest.approx([0.03 * math.sqrt(1e-3)])


def whitened(factor: Any, values: gtsam.Values) -> Array:
    if not hasattr(factor, "unwhitenedError"):
        return -np.array(factor.linearize(values).augmentedJacobian())[:, -1]
    model = factor.noiseModel()
    model = model.noise() if isinstance(model, gtsam.noiseModel.Robust) else model
    return np.array(model.whiten(factor.unwhitenedError(values)))


def test_every_factor_is_linearised_with_its_numerical_derivatives() -> None:
    field = {"mag_norm_ut": 48.0, "mag_dip_rad": 1.1, "altitude_m": 300.0}
    rest = {"rest_s": 4.0, "rest_rate_rad_s": 0.012, "rest_sigma_rad_s": 5e-4}
    steps = [stand(altitude_m=300.0), make_step(yaw_mag_rad=0.5, yaw_gyro_rad=0.4, **field, **rest)]
    graph = graph_of(steps, CONFIG)
    # where no robust loss bites
    values = values_at((0.1, 0.2, 0.1, 0.3, 0.01), (0.6, 0.5, 0.15, 0.6, 0.02, 0.05), iron_ut=(1.0, -2.0, 21.0))
    h = 1e-6
    for i in range(graph.size()):
        factor = graph.at(i)
        linear = factor.linearize(values)
        jacobian, at = np.array(linear.augmentedJacobian()), 0
        for key in list(linear.keys()):
            width = 3 if key in (X(0), X(1), I(0)) else 2 if key in (B(0), B(1)) else 1
            for axis in range(width):
                delta = gtsam.VectorValues()
                delta.insert(key, h * np.eye(width)[axis])
                moved = whitened(factor, values.retract(delta)) - whitened(factor, values)
                assert np.allclose(moved / h, jacobian[:, at], rtol=1e-4, atol=1e-3), type(factor).__name__
                at += 1
        assert at == jacobian.shape[1] - 1
        assert np.allclose(jacobian[:, -1], -whitened(factor, values))


def test_the_heading_factor_pulls_the_way_the_gyroscope_says() -> None:
    """Its right-hand side is the negative whitened error, with derivatives -1, +1 and Δt over sigma."""
    turn = GyroTurn(turned_rad=0.35, moving_s=0.6, sigma_rad=0.02, drift_rad_s=1e-4)
    factor = heading_factor(3, turn, Node(0, 0, 0, 0.4, 0.01), Node(0, 0, 0, 0.1, 0.0))
    assert tuple(factor.keys()) == (X(2), X(3), B(3))
    values = gtsam.Values()
    values.insert(X(2), gtsam.Pose2(0.0, 0.0, 0.1))
    values.insert(X(3), gtsam.Pose2(0.0, 0.0, 0.5))
    values.insert(B(3), np.array([0.1, 0.02]))
    linear = factor.linearize(values)
    # of the 0.35 rad that it shows 2 % are too much, and 0.06 rad are its bias
    right = (0.35 - 0.4 - 0.06 - 0.02 * 0.35) / 0.02
    assert np.allclose(linear.augmentedJacobian(), [[0, 0, -50.0, 0, 0, 50.0, 30.0, 17.5, right]])
