"""Field, compass turns, rhythm and bounce, of walks made by hand."""

import math
from typing import Any

import numpy as np
import pytest
from support.by_hand import steps_of, way_along
from support.results_by_hand import hand_result, hand_signals

from fbgraph.front_end.step_track import StepTrack
from fbgraph.integrity.compass_checks import (
    compass_against_gyroscope,
    field_strength,
    field_upside_down,
    turn_slope,
)
from fbgraph.integrity.walk_checks import rhythm, rise_of_a_step, unexplained_time
from fbgraph.run.walk_result import WalkResult

WAY = way_along((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0), (0.0, 0.0), t0_s=1.0)  # 80 steps, 40 s
YAW = np.unwrap(WAY.yaw_rad)


def walk(**columns: Any) -> WalkResult:
    usual = {"yaw_s": WAY.t_s, "yaw_gyro_rad": YAW}
    return hand_result(WAY, steps=usual | columns)


def slope_of(by_compass: Any, **columns: Any) -> Any:
    usual = {"yaw_s": WAY.t_s, "yaw_gyro_rad": YAW, "yaw_mag_rad": by_compass}
    return turn_slope(StepTrack(steps_of(WAY, **(usual | columns))))


@pytest.mark.parametrize("slope", [1.0, -1.0, 0.5, 2.0, 0.0])
def test_the_slope_of_the_compass_on_the_gyroscope(slope: float) -> None:
    """Whatever the bias of the gyroscope (0.05 rad/s) and where both begin."""
    found = slope_of(slope * YAW + 0.3 - 0.05 * WAY.t_s)
    assert found.slope == pytest.approx(slope, abs=0.03)
    assert found.agreement == pytest.approx(1.0, abs=0.01)
    assert found.turn_rad == pytest.approx(np.std(YAW[5:] - YAW[1:-4]))


def test_turns_across_a_gap_are_not_compared() -> None:
    chained = [k != 40 for k in range(81)]
    jumped = np.where(np.arange(81) >= 40, YAW + 2.0, YAW)
    found = slope_of(YAW, yaw_gyro_rad=jumped, chained=chained)
    assert found.slope == pytest.approx(1.0, abs=0.03)
    assert found.agreement == pytest.approx(1.0)


def test_too_few_compass_headings_say_nothing() -> None:
    assert slope_of(np.full(81, math.nan)) is None
    assert compass_against_gyroscope(walk()) == []


@pytest.mark.parametrize(
    ("slope", "text"),
    [(-1.0, "opposite ways"), (0.0, "does not turn"), (0.5, "0.5 times as far"), (2.0, "2.0 times as far")],
)
def test_a_compass_that_turns_otherwise_is_told(slope: float, text: str) -> None:
    (found,) = compass_against_gyroscope(walk(yaw_mag_rad=slope * YAW))
    assert text in found.reason.text
    assert compass_against_gyroscope(walk(yaw_mag_rad=1.25 * YAW)) == []


def test_who_walks_straight_on_says_nothing_of_turns() -> None:
    straight = way_along((0.0, 0.0), (40.0, 0.0))
    wobble = 0.01 * np.sin(np.arange(81.0))
    steps = {
        "yaw_s": straight.t_s,
        "yaw_gyro_rad": wobble,
        "yaw_mag_rad": -wobble + 0.2 * np.cos(np.arange(81.0) * 0.7),
    }
    assert compass_against_gyroscope(hand_result(straight, steps=steps)) == []


def test_a_field_that_is_not_earths() -> None:
    for norm_ut, weight in ((0.45, 40.0), (160.0, 2.0)):
        (found,) = field_strength(walk(mag_norm_ut=np.full(81, norm_ut)))
        assert found.reason.weight == pytest.approx(weight)
    for norm_ut in (22.0, 67.0):
        assert field_strength(walk(mag_norm_ut=np.full(81, norm_ut))) == []
    assert field_strength(walk()) == []  # no magnetometer


def test_a_field_that_points_out_of_the_ground() -> None:
    (found,) = field_upside_down(walk(mag_dip_rad=np.full(81, math.radians(-60.0))))
    assert "points 60° out of the ground" in found.reason.text
    assert field_upside_down(walk(mag_dip_rad=np.full(81, math.radians(-10.0)))) == []


def test_a_rhythm_that_is_no_walk() -> None:
    for hz, weight in ((0.5, 1.4), (4.0, 1.25)):
        (found,) = rhythm(walk(frequency_hz=np.full(81, hz)))
        assert found.reason.weight == pytest.approx(weight)
    for hz in (0.75, 3.1):
        assert rhythm(walk(frequency_hz=np.full(81, hz))) == []


def test_a_step_that_rises_too_far() -> None:
    """35 m/s² peak to peak at 2 Hz is 35 / (4π)² = 0.22 m."""
    (found,) = rise_of_a_step(walk(bounce_m_s2=np.full(81, 35.0)))
    assert "rises 0.22 m" in found.reason.text
    assert rise_of_a_step(walk(bounce_m_s2=np.full(81, 25.0))) == []
    (slow,) = rise_of_a_step(walk(bounce_m_s2=np.full(81, 5.0), frequency_hz=np.full(81, 1.0)))
    assert "rises 0.13 m" in slow.reason.text


def test_movement_without_steps() -> None:
    """Steps from 1 to 26 s, then 34 s of movement: more than two fifths of 59 s."""
    moving = hand_result(config=hand_result().config.model_copy(update={"attitude": _ten_hz()}))
    (found,) = unexplained_time(moving)
    assert "for 34 s of the log the device moved" in found.reason.text
    still = np.arange(601) >= 320
    resting = hand_result(config=moving.config, signals=hand_signals(still=still))
    assert unexplained_time(resting) == []


def _ten_hz() -> Any:
    return hand_result().config.attitude.model_copy(update={"rate_hz": 10.0})
