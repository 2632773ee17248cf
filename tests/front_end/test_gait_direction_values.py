"""Which way the legs push: cosines whose phase and direction are known."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.made_signals import G, levelled

from fbgraph.front_end.gait_direction import GaitDirection, Push
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import Peak

LAG = math.radians(75.0)
PEAKS = [Peak(100, 50, False), Peak(150, 100, False), Peak(200, 150, False), Peak(240, 200, False)]
SETTING_OFF = [Peak(20, 5, True), Peak(35, 20, False), Peak(50, 35, False)]


def walking(count: int = 300, push: float = 0.8, lag: float = LAG, yaw: float = 0.5, **given: Any) -> LevelledSignals:
    """A bounce twice a second, and a push of so much, so long after it, so far to the left of the device."""
    beat = 2.0 * np.pi * np.arange(count) / 50.0
    forward = push * np.cos(beat + lag)
    acc = np.column_stack((forward * math.cos(yaw), forward * math.sin(yaw), G + 2.0 * np.cos(beat)))
    return replace(levelled(count, **given), acc_n_m_s2=acc)


def told(signals: LevelledSignals, peaks: list[Peak] = PEAKS[:3]) -> list[Push]:
    """Of these steps, after three with which one set off."""
    gait = GaitDirection()
    return [gait.push(signals, peak) for peak in (*SETTING_OFF, *peaks)][3:]


@pytest.mark.parametrize("yaw", [0.0, 0.5, math.pi / 2, 3.0, -2.0])
def test_the_push_points_where_one_walks(yaw: float) -> None:
    first, second, third = told(walking(yaw=yaw))
    assert math.isnan(first.gait_yaw_rad)
    for step in (second, third):
        assert step.gait_yaw_rad == pytest.approx(yaw)
        assert step.push_m_s2 == pytest.approx(0.8)
        assert (step.side_forward_m_s2, step.side_left_m_s2) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_what_follows_a_quarter_of_a_step_later_is_no_push() -> None:
    step = told(walking(lag=LAG + math.pi / 2))[1]
    assert step.push_m_s2 == pytest.approx(0.0, abs=1e-9)
    assert step.side_forward_m_s2 == pytest.approx(0.8 * math.cos(0.5))
    assert step.side_left_m_s2 == pytest.approx(0.8 * math.sin(0.5))


def test_a_push_that_lags_otherwise_is_the_less_of_one() -> None:
    step = told(walking(lag=LAG + 0.4))[1]
    assert step.push_m_s2 == pytest.approx(0.8 * math.cos(0.4))
    assert step.gait_yaw_rad == pytest.approx(0.5)


def test_sway_lean_and_slow_turning_are_no_push() -> None:
    signals = walking()
    stride = np.pi * np.arange(300) / 50.0
    sway = np.column_stack((3.0 * np.cos(stride + 0.3), 5.0 * np.cos(stride - 1.0), 1.5 * np.cos(stride)))
    swaying = replace(signals, acc_n_m_s2=signals.acc_n_m_s2 + sway + (0.7, -0.4, 0.0))
    step = told(swaying)[1]
    assert step.gait_yaw_rad == pytest.approx(0.5, abs=1e-6)
    assert step.push_m_s2 == pytest.approx(0.8, abs=1e-6)


def test_a_step_that_does_not_follow_another_tells_nothing() -> None:
    alone = told(walking(400), [PEAKS[0], PEAKS[1], Peak(300, 250, False), Peak(350, 300, False)])
    assert [math.isfinite(step.gait_yaw_rad) for step in alone] == [False, True, False, True]


def test_who_sets_off_pushes_the_whole_body() -> None:
    """Three steps after every stop tell nothing, nor does the fourth, which has none to be added to."""
    ends = np.arange(50, 500, 50)
    peaks = [Peak(int(end), int(end) - 50, end in (50, 350)) for end in ends]
    gait, signals = GaitDirection(), walking(500)
    pushed = [math.isfinite(gait.push(signals, peak).push_m_s2) for peak in peaks]
    assert pushed == [False, False, False, False, True, True, False, False, False]


def test_nor_does_one_with_a_gap_in_it_or_of_too_few_samples() -> None:
    whole = walking()
    keep = np.ones(300, dtype=bool)
    keep[120:125] = False
    holed = LevelledSignals(*(column[keep] for column in (getattr(whole, n) for n in whole.__dataclass_fields__)))
    assert [math.isfinite(step.push_m_s2) for step in told(holed, PEAKS)] == [False, False, False, True]
    short = told(whole, [Peak(100, 97, False), Peak(104, 100, False), Peak(108, 104, False)])
    assert [math.isfinite(step.push_m_s2) for step in short] == [False, False, True]


def test_no_bounce_no_push() -> None:
    flat = levelled(300)
    assert math.isnan(told(replace(flat, acc_n_m_s2=np.zeros((300, 3))))[1].push_m_s2)


def test_how_the_device_was_held_is_the_mean_of_the_step() -> None:
    index = np.arange(300.0)
    step = told(walking(mount_up_rad=index / 1000.0, tilt_rate_rad_s=index / 100.0))[1]
    assert step.mount_up_rad == pytest.approx(np.arange(101, 151).mean() / 1000.0)
    assert step.tilt_rate_rad_s == pytest.approx(np.arange(101, 151).mean() / 100.0)
