"""Baseline dead reckoning in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.factors import make_step, stand, walk_track

from fbgraph.core.config import Config, StepLengthConfig
from fbgraph.estimators.baselines import baselines
from fbgraph.estimators.ekf import run_ekf
from fbgraph.estimators.pdr import calibration_bias_rad_s, dead_reckon, first_compass_yaw_rad
from fbgraph.front_end.step_track import StepTrack

CONFIG = StepLengthConfig(constant_m=0.5)


def test_every_step_has_the_constant_length_and_the_start_none() -> None:
    trajectory = dead_reckon(walk_track(np.zeros(4), length_m=0.9), CONFIG)
    assert np.allclose(trajectory.x_m, [0.0, 0.5, 1.0, 1.5, 2.0])
    assert not trajectory.y_m.any()
    assert not trajectory.z_m.any()
    assert not trajectory.gyro_bias_rad_s.any()


def test_a_square_closes() -> None:
    yaw = np.repeat(np.radians([0.0, 90.0, 180.0, 270.0]), 10)
    trajectory = dead_reckon(walk_track(yaw, compass=np.angle(np.exp(1j * yaw))), CONFIG)
    assert np.allclose(trajectory.xy_m[[10, 20, 30, 40]], [(5, 0), (5, 5), (0, 5), (0, 0)])
    assert trajectory.yaw_rad[-1] == pytest.approx(1.5 * math.pi)  # unwrapped


def test_a_biased_gyroscope_bends_the_walk_as_it_is_not_calibrated() -> None:
    track = walk_track(np.zeros(100), bias_rad_s=0.01)
    trajectory = dead_reckon(track, CONFIG)
    assert np.allclose(trajectory.yaw_rad, 0.01 * (track.yaw_s - 0.25))
    assert trajectory.y_m[-1] == pytest.approx(0.5 * np.sin(0.005 * np.arange(100)).sum())


def test_the_first_rest_is_its_calibration_and_no_later_one() -> None:
    steps = list(walk_track(np.zeros(100), bias_rad_s=0.01).steps)
    steps[1] = replace(steps[1], rest_s=3.0, rest_rate_rad_s=0.01, rest_sigma_rad_s=0.1)
    steps[50] = replace(steps[50], rest_s=3.0, rest_rate_rad_s=0.05, rest_sigma_rad_s=0.001)
    track = StepTrack(steps)
    assert calibration_bias_rad_s(track) == 0.01
    assert np.allclose(dead_reckon(track, CONFIG).yaw_rad, 0.0, atol=1e-12)
    assert calibration_bias_rad_s(walk_track(np.zeros(4))) == 0.0


def test_it_starts_at_the_mean_compass_of_the_first_four_steps_that_have_one() -> None:
    compass = np.array([np.nan, 0.2, 0.3, 0.4, 0.5, 2.9])
    track = walk_track(np.zeros(6), compass=compass)
    assert first_compass_yaw_rad(track) == pytest.approx(0.35)
    assert np.allclose(dead_reckon(track, CONFIG).yaw_rad, 0.35)


def test_the_compass_mean_follows_the_gyroscope_round_turns_and_the_circle() -> None:
    yaw = np.array([3.0, 3.1, 3.2, 3.3, 0.0])
    compass = np.angle(np.exp(1j * (yaw + np.array([0.1, -0.1, 0.1, -0.1, 1.0]))))
    assert first_compass_yaw_rad(walk_track(yaw, compass=compass, start=5.0)) == pytest.approx(3.0)


def test_without_a_compass_it_starts_towards_east() -> None:
    steps = [stand(yaw_gyro_rad=2.0), make_step(yaw_gyro_rad=2.0), make_step(yaw_gyro_rad=2.0 + math.pi / 2)]
    trajectory = dead_reckon(StepTrack(steps), CONFIG)
    assert np.allclose(trajectory.xy_m, [(0, 0), (0.5, 0), (0.5, 0.5)])


def test_the_baselines_are_these_two() -> None:
    config = Config(step_length=CONFIG)
    track = walk_track(np.linspace(0, 1, 20), compass=np.linspace(0.1, 1.1, 20))
    both = baselines(track, config)
    assert np.array_equal(both["pdr"].xy_m, dead_reckon(track, CONFIG).xy_m)
    assert np.array_equal(both["ekf"].xy_m, run_ekf(track, config.ekf).xy_m)
