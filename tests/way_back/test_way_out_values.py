"""The way out as the way back sees it: columns of its steps, computed on paper."""

import math

import numpy as np
import pytest
from support.by_hand import HALF_A_METRE, hand_step, steps_of, way_along

from fbgraph.core.config import StepLengthConfig
from fbgraph.way_back.way_out import Outbound, field_of, gap_before_s, level_length_m

WAY = way_along((1.0, 2.0), (5.0, 2.0), (5.0, 5.0))


def test_it_holds_the_breadcrumbs_up_to_the_last() -> None:
    height = 0.1 * np.arange(len(WAY))
    steps = steps_of(WAY, altitude_m=height, mag_norm_ut=height + 50.0, mag_dip_rad=height * 0.0 + math.pi / 6)
    out = Outbound.of(WAY, steps, StepLengthConfig(alpha_m=0.6, beta_m_s=0.0, beta2_m_s2=0.0, kappa_surge=0.0), 10)
    np.testing.assert_array_equal(out.t_s, 0.5 * np.arange(11))
    np.testing.assert_allclose(out.route_m, 0.5 * np.arange(11))
    np.testing.assert_allclose(out.level_m, 0.6 * np.arange(11))
    np.testing.assert_allclose(out.x_m, np.minimum(1.0 + 0.5 * np.arange(11), 5.0))
    np.testing.assert_allclose(out.y_m, np.maximum(2.0, 2.0 + 0.5 * (np.arange(11) - 8)))
    np.testing.assert_allclose(out.mag_up_ut, (50.0 + height[:11]) * 0.5)
    np.testing.assert_allclose(out.mag_level_ut, (50.0 + height[:11]) * math.sqrt(0.75))
    np.testing.assert_array_equal(out.altitude_m, height[:11])


def test_the_field_is_split_by_its_dip() -> None:
    assert field_of(hand_step(mag_norm_ut=50.0, mag_dip_rad=math.atan2(40.0, 30.0))) == pytest.approx((40.0, 30.0))
    assert field_of(hand_step(mag_norm_ut=50.0, mag_dip_rad=math.atan2(-30.0, 40.0))) == pytest.approx((-30.0, 40.0))


def test_a_step_is_as_long_on_the_level_as_its_pace_says() -> None:
    length = StepLengthConfig(alpha_m=0.2, beta_m_s=0.1, beta2_m_s2=0.0, gamma_m=-9.0, kappa_surge=0.5, shortest_m=0.3)
    step = hand_step(frequency_hz=2.0, surge_m_s=0.16, length_m=0.1, slope=0.5)
    assert level_length_m(step, length) == pytest.approx(0.2 + 0.2 + 0.5 * 0.4)
    assert level_length_m(hand_step(frequency_hz=-1.0, surge_m_s=0.0), length) == 0.3
    assert level_length_m(hand_step(frequency_hz=2.0, length_m=0.0), length) == 0.0


def test_a_gap_is_as_long_as_the_log_was_silent() -> None:
    steps = [hand_step(t_s=1.0), hand_step(t_s=4.5, chained=False), hand_step(t_s=9.0)]
    assert [gap_before_s(steps, k) for k in (1, 2)] == [3.5, 0.0]


def test_level_length_counts_from_the_standing_start() -> None:
    out = Outbound.of(WAY, steps_of(WAY), HALF_A_METRE, 4)
    np.testing.assert_allclose(out.level_m, [0.0, 0.5, 1.0, 1.5, 2.0])
