"""Steps as columns, lengths on the level, and signals in pieces."""

import math

import numpy as np
import pytest
from support.by_hand import hand_step
from support.made_signals import levelled, same_signals

from fbgraph.core.config import StepLengthConfig
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_length import flat_length_m
from fbgraph.front_end.step_track import LOOK_BACK_S, Step, StepTrack


def test_every_field_of_a_step_is_a_column_of_the_track() -> None:
    steps = [hand_step(t_s=0.5 * k, length_m=0.1 * k, chained=k != 1, yaw_mag_rad=-0.2 * k) for k in range(4)]
    track = StepTrack(steps)
    assert len(track) == 4
    assert track.steps == tuple(steps)
    assert np.allclose(track.length_m, [0.0, 0.1, 0.2, 0.3])
    assert np.allclose(track.yaw_mag_rad, [0.0, -0.2, -0.4, -0.6])
    assert track.chained.tolist() == [1.0, 0.0, 1.0, 1.0]
    assert np.isnan(track.altitude_m).all()
    assert track.t_s is track.t_s  # made once
    for name in Step.__slots__:
        assert getattr(track, name).shape == (4,)
    with pytest.raises(AttributeError, match="a step has no 'lenght_m'; it has t_s, start_s"):
        _ = track.lenght_m


def test_length_on_the_level_by_hand() -> None:
    config = StepLengthConfig(alpha_m=0.1, beta_m_s=0.2, beta2_m_s2=-0.1, gamma_m=9.0, kappa_surge=0.5)
    assert flat_length_m(config, 1.5, 0.09) == pytest.approx(0.1 + 0.3 - 0.225 + 0.15)
    assert flat_length_m(config, 1.5, 0.0) == pytest.approx(0.175)
    assert flat_length_m(config, 1.5, 0.5) == flat_length_m(config, 1.5, 0.2) == pytest.approx(0.175 + 0.5 * 0.2**0.5)
    assert flat_length_m(config, 9.0, 0.0) == flat_length_m(config, 2.4, 0.0)
    assert flat_length_m(config, 0.2, 0.0) == flat_length_m(config, 1.1, 0.0)


def test_the_papers_line_goes_on_beyond_the_cadences_of_the_fit() -> None:
    paper = StepLengthConfig(alpha_m=0.35, beta_m_s=0.2, beta2_m_s2=0.0, kappa_surge=0.0)
    assert [flat_length_m(paper, hz, 0.5) for hz in (0.7, 2.0, 3.2)] == pytest.approx([0.49, 0.75, 0.99])


def test_measuring_looks_back_twelve_seconds() -> None:
    """Long enough for the detector's window, its spin and the slope, each with a run of slow steps before them."""
    assert LOOK_BACK_S == 12.0


def test_heads_and_tails_are_the_first_and_last_samples() -> None:
    signals = levelled(10, yaw_gyro_rad=np.arange(10.0))
    assert signals.head(3).yaw_gyro_rad.tolist() == [0.0, 1.0, 2.0]
    assert signals.tail(3).yaw_gyro_rad.tolist() == [7.0, 8.0, 9.0]
    assert len(signals.tail(0)) == 0
    assert same_signals(signals.tail(99), signals)
    assert same_signals(signals.tail(15), signals)
    assert same_signals(signals.head(99), signals)
    assert same_signals(LevelledSignals.concatenate([signals.head(4), signals.tail(6)]), signals)
    assert LevelledSignals.concatenate([signals]) is signals
    assert math.isclose(signals.tail(1).t_s[0], 0.09)
