"""Turns between steps by the gyroscope: while walking, across rests, across gaps."""

import math
from itertools import pairwise

import numpy as np
import pytest
from support.factors import make_step, stand

from fbgraph.core.config import GraphConfig
from fbgraph.estimators.gyroscope import GyroTurn, gyro_turn, gyro_turns
from fbgraph.front_end.step_track import StepTrack

CONFIG = GraphConfig(
    sigma_yaw_step_rad=0.02,
    sigma_bias_rad_s=0.008,
    sigma_bias_walk_rad_s=3e-4,
    sigma_gap_yaw_rad_s=0.25,
)
BEFORE = stand(yaw_s=1.0, yaw_gyro_rad=0.5)


def test_a_step_turns_by_what_the_gyroscope_shows() -> None:
    turn = gyro_turn(BEFORE, make_step(yaw_s=5.0, yaw_gyro_rad=4.5), CONFIG)
    assert turn == pytest.approx(GyroTurn(4.0, 4.0, 0.02, 6e-4))  # more than half a circle is told


def test_across_a_rest_the_turn_is_less_what_the_bias_added_there() -> None:
    """Ten minutes at 0.01 rad/s are a full circle: of the turn it is taken out, and of the time the bias adds to."""
    rest = {"rest_s": 600.0, "rest_rate_rad_s": 0.01, "rest_drift_rad": 6.0, "rest_drift_sigma_rad": 0.048}
    turn = gyro_turn(BEFORE, make_step(yaw_s=604.0, yaw_gyro_rad=7.3, **rest), CONFIG)
    assert turn.turned_rad == pytest.approx(0.8)
    assert turn.moving_s == pytest.approx(3.0)
    assert turn.sigma_rad == pytest.approx(math.hypot(0.02, 0.048))
    assert turn.drift_rad_s == pytest.approx(3e-4 * math.sqrt(603.0))
    round_about = make_step(yaw_s=604.0, yaw_gyro_rad=7.3 + 2 * math.pi, **rest)
    assert gyro_turn(BEFORE, round_about, CONFIG).turned_rad == pytest.approx(0.8)  # the nearest such turn


def test_a_rest_longer_than_the_time_between_two_steps_leaves_none_of_it() -> None:
    rest = {"rest_s": 3.0, "rest_rate_rad_s": 0.0, "rest_drift_rad": 0.1, "rest_drift_sigma_rad": 0.0}
    assert gyro_turn(BEFORE, make_step(yaw_s=3.5, **rest), CONFIG).moving_s == 0.0


def test_after_hours_the_bias_is_as_unknown_as_at_the_start_and_no_more() -> None:
    assert gyro_turn(BEFORE, make_step(yaw_s=1e5), CONFIG).drift_rad_s == 0.008


def test_across_a_gap_the_gyroscope_says_nothing() -> None:
    turn = gyro_turn(BEFORE, make_step(yaw_s=5.0, yaw_gyro_rad=3.0, chained=False), CONFIG)
    assert turn[:3] == pytest.approx((0.0, 0.0, 1.0))
    assert gyro_turn(BEFORE, make_step(yaw_s=500.0, chained=False), CONFIG).sigma_rad == math.pi
    assert gyro_turn(BEFORE, make_step(yaw_s=1.0, chained=False), CONFIG).sigma_rad == pytest.approx(0.025)


def test_a_whole_walks_turns_are_those_of_its_steps() -> None:
    steps = [BEFORE, make_step(yaw_s=5.0, yaw_gyro_rad=4.5), make_step(yaw_s=6.0, yaw_gyro_rad=4.0)]
    turns = gyro_turns(StepTrack(steps), CONFIG)
    assert np.array(turns).T.tolist() == [list(gyro_turn(a, b, CONFIG)) for a, b in pairwise(steps)]
