"""Rests of known bias: rate, standard deviation and duration by hand."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.made_signals import levelled

from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.rests import Rest, Rests

RATE_HZ, SETTLE_S = 100.0, 3.0
FLOOR, SWAY, UNSETTLED, COMPASS, TRIM_S = 2e-4, 0.03, 0.04, 0.04, 0.75
"""rad/s; rad; rad; rad; s: as the front end's page has them."""


def rest_of(*parts: LevelledSignals) -> Rest:
    """What all rests in these signals told."""
    rests = Rests(RATE_HZ, SETTLE_S)
    for part in parts:
        rests.push(part)
    return rests.take(10**9)


def rested(*parts: LevelledSignals) -> tuple[float, float, float]:
    """Rate, sigma and duration of all rests in these signals."""
    told = rest_of(*parts)
    return told.rate_rad_s, told.sigma_rad_s, told.duration_s


def still(duration_s: float, first_s: float = 0.0, **given: Any) -> LevelledSignals:
    return levelled(round(duration_s * RATE_HZ), round(first_s * RATE_HZ), still=True, **given)


def moving(duration_s: float, first_s: float, **given: Any) -> LevelledSignals:
    return levelled(round(duration_s * RATE_HZ), round(first_s * RATE_HZ), still=False, **given)


def seconds(duration_s: float, first_s: float = 0.0) -> FloatArray:
    return first_s + np.arange(round(duration_s * RATE_HZ)) / RATE_HZ


def test_a_first_rest_is_its_slope_and_as_sure_as_a_hand_is_steady() -> None:
    rate, sigma, rest_s = rested(still(10.0, yaw_gyro_rad=3.0 + 0.02 * seconds(10.0)), moving(1.0, 10.0))
    assert rate == pytest.approx(0.02)
    assert rest_s == pytest.approx(10.0 - TRIM_S - 0.01)  # the end, where movement begins unnoticed, is left out
    assert sigma == pytest.approx(SWAY / rest_s + FLOOR)


def test_the_end_that_is_left_out_may_do_anything() -> None:
    yaw = 0.02 * seconds(10.0)
    yaw[-75:] += 1.0
    assert rested(still(10.0, yaw_gyro_rad=yaw), moving(1.0, 10.0))[0] == pytest.approx(0.02)
    yaw[-76] += 1.0
    assert rested(still(10.0, yaw_gyro_rad=yaw), moving(1.0, 10.0))[0] != pytest.approx(0.02, abs=1e-4)


def test_scatter_counts_once_a_second() -> None:
    """√(12 / T) · scatter / T, samples a second apart being independent."""
    yaw = 0.02 * seconds(13.0) + 0.05 * np.where(np.arange(1300) % 2, 1.0, -1.0)
    rate, sigma, rest_s = rested(still(13.0, yaw_gyro_rad=yaw), moving(1.0, 13.0))
    assert rate == pytest.approx(0.02, abs=1e-4)
    random = math.sqrt(12.0 / rest_s) * 0.05 / rest_s
    assert sigma == pytest.approx(math.hypot(random, SWAY / rest_s) + FLOOR, rel=1e-3)


def swaying(duration_s: float, bias: float, drift: float, first_s: float = 0.0) -> dict[str, Any]:
    """A hand that turns by ``drift`` meanwhile; the compass sees it too, the bias it does not."""
    t_s = seconds(duration_s, first_s)
    turned = 2.0 + drift * t_s
    compass = np.angle(np.exp(1j * (turned + 1.0)))  # wrapped, and off by one radian
    return {"yaw_gyro_rad": turned + bias * t_s, "yaw_mag_rad": compass}


def test_the_compass_tells_the_hand_from_the_bias() -> None:
    rate, sigma, rest_s = rested(still(10.0, **swaying(10.0, bias=0.01, drift=0.3)), moving(1.0, 10.0))
    alone, relative = SWAY / rest_s + FLOOR, COMPASS / rest_s + FLOOR
    weight = alone**2 / (alone**2 + relative**2)
    assert rate == pytest.approx(0.31 * (1 - weight) + 0.01 * weight)
    assert sigma == pytest.approx(1.0 / math.hypot(1 / alone, 1 / relative))


def test_one_sample_without_a_compass_leaves_the_gyroscope_alone() -> None:
    given = swaying(10.0, bias=0.01, drift=0.3)
    given["yaw_mag_rad"][300] = np.nan
    rate, sigma, rest_s = rested(still(10.0, **given), moving(1.0, 10.0))
    assert rate == pytest.approx(0.31)
    assert sigma == pytest.approx(SWAY / rest_s + FLOOR)


def test_after_walking_the_beginning_is_left_to_settle() -> None:
    """Twice the time constant, or four tenths of a short rest, and what is still unsettled then counts as sway."""
    for duration_s, begin_s in ((20.0, 6.0), (10.0, 4.0)):
        given = swaying(duration_s, bias=0.01, drift=0.0, first_s=5.0)
        lead = round(begin_s * RATE_HZ)
        given["yaw_gyro_rad"][:lead] += 0.5
        parts = moving(5.0, 0.0), still(duration_s, 5.0, **given), moving(1.0, 5.0 + duration_s)
        rate, sigma, rest_s = rested(*parts)
        assert rest_s == pytest.approx(duration_s - begin_s - TRIM_S - 0.01)
        alone = SWAY / rest_s + FLOOR
        relative = math.hypot(UNSETTLED * math.exp(-begin_s / SETTLE_S), COMPASS) / rest_s + FLOOR
        assert rate == pytest.approx(0.01, abs=1e-9)
        assert sigma == pytest.approx(1.0 / math.hypot(1 / alone, 1 / relative), rel=1e-4)


def test_a_second_rest_comes_after_walking_and_the_logs_begin_does_not() -> None:
    """Until its window is full the leveller cannot tell that a device is still: 1.5 s are no movement yet."""
    first = rested(moving(1.5, 0.0), still(10.0, 1.5), moving(1.0, 11.5))[2]
    assert first == pytest.approx(10.0 - TRIM_S - 0.01)
    later = rested(moving(2.02, 0.0), still(10.0, 2.02), moving(1.0, 12.02))[2]
    assert later == pytest.approx(10.0 - 4.0 - TRIM_S - 0.01)
    moved = rested(still(1.0), moving(0.5, 1.0), still(10.0, 1.5), moving(1.0, 11.5))[2]
    assert moved == pytest.approx(later)  # a rest, however short, was over: that is movement at any time
    twice = rested(still(10.0), moving(0.5, 10.0), still(10.0, 10.5), moving(1.0, 20.5))[2]
    assert twice == pytest.approx(first + later)


def test_of_a_long_rest_the_last_minute_tells_the_bias() -> None:
    t_s = seconds(100.0)
    yaw = np.where(t_s < 40.0, 0.01 * t_s, 0.4 + 0.02 * (t_s - 40.0))
    for cut in (10000, 700):
        parts = [
            levelled(len(yaw[at : at + cut]), at, still=True, yaw_gyro_rad=yaw[at : at + cut])
            for at in range(0, 10000, cut)
        ]
        told = rest_of(*parts, moving(1.0, 100.0))
        assert told.rate_rad_s == pytest.approx(0.02)
        assert told.sigma_rad_s == pytest.approx(SWAY / (60.0 - TRIM_S - 0.01) + FLOOR)
        assert told.duration_s == pytest.approx(100.0 - TRIM_S - 0.01)
        assert told.drift_rad == pytest.approx(yaw[9924], abs=0.02)  # but the gyroscope went wrong all the time


def test_less_than_a_second_tells_nothing() -> None:
    for duration_s, known in ((1.75, False), (1.77, True)):
        rate, sigma, rest_s = rested(still(duration_s), moving(1.0, duration_s))
        assert math.isfinite(rate) is known
        assert math.isfinite(sigma) is known
        assert (rest_s > 0) is known


def test_a_rest_is_one_only_once_it_is_over() -> None:
    assert math.isnan(rested(still(10.0))[0])


def test_rests_are_weighted_by_what_they_know_and_taken_once() -> None:
    rests = Rests(RATE_HZ, SETTLE_S)
    rests.push(still(5.0, yaw_gyro_rad=0.01 * seconds(5.0)))
    rests.push(moving(1.0, 5.0))
    rests.push(still(20.0, 6.0, yaw_gyro_rad=0.02 * seconds(20.0)))
    rests.push(moving(1.0, 26.0))
    a, b = 5.0 - TRIM_S - 0.01, 20.0 - 6.0 - TRIM_S - 0.01
    sigma_a, sigma_b = SWAY / a + FLOOR, SWAY / b + FLOOR
    told = rests.take(2600)
    known = 1 / sigma_a**2 + 1 / sigma_b**2
    assert told.rate_rad_s == pytest.approx((0.01 / sigma_a**2 + 0.02 / sigma_b**2) / known)
    assert told.sigma_rad_s == pytest.approx((2 / known) ** 0.5)  # what one does wrong the other does too
    assert told.duration_s == pytest.approx(a + b)
    assert told.drift_rad == pytest.approx(0.01 * a + 0.02 * b)
    again = rests.take(10**9)
    assert math.isnan(again.rate_rad_s)
    assert math.isnan(again.sigma_rad_s)
    assert (again.duration_s, again.drift_rad, again.drift_sigma_rad) == (0.0, 0.0, 0.0)


def test_a_rest_belongs_to_the_first_step_that_ends_after_it() -> None:
    rests = Rests(RATE_HZ, SETTLE_S)
    rests.push(still(5.0, yaw_gyro_rad=0.01 * seconds(5.0)))
    rests.push(moving(1.0, 5.0))
    assert rests.take(499).duration_s == 0.0
    assert rests.take(500).rate_rad_s == pytest.approx(0.01)


def test_a_gap_is_remembered_from_the_sample_before_it() -> None:
    rests = Rests(RATE_HZ, SETTLE_S)
    rests.push(moving(1.0, 0.0))
    assert rests.unbroken_between(0, 99)
    rests.push(levelled(0))
    rests.push(moving(1.0, 2.0))
    assert not rests.unbroken_between(99, 200)
    assert not rests.unbroken_between(0, 100)
    assert rests.unbroken_between(100, 200)
    assert rests.unbroken_between(0, 99)  # nor does a gap after both
    rests.push(moving(1.0, 3.0))
    assert rests.unbroken_between(100, 399)


def test_of_two_gaps_in_a_piece_both_are_remembered() -> None:
    rests = Rests(RATE_HZ, SETTLE_S)
    rests.push(levelled(30, index=np.arange(30) + 10 * (np.arange(30) >= 10) + 10 * (np.arange(30) >= 20)))
    assert not rests.unbroken_between(8, 25)
    assert not rests.unbroken_between(28, 45)
    assert not rests.unbroken_between(0, 49)
    assert rests.unbroken_between(0, 9)
    assert rests.unbroken_between(20, 29)
    assert rests.unbroken_between(40, 49)


def test_a_gap_inside_a_rest_does_not_dilute_its_bias() -> None:
    """Nothing is integrated across a gap, so the yaw of 10 s before and 10 s after it has the slope only in parts."""
    yaw = 0.01 * seconds(20.0)
    parts = still(10.0, yaw_gyro_rad=yaw[:1000]), still(10.0, 40.0, yaw_gyro_rad=yaw[1000:]), moving(1.0, 50.0)
    rate, sigma, _ = rested(*parts)
    assert abs(rate - 0.01) < 3 * sigma


BIAS = math.radians(0.5)


def long_rest(duration_s: float, compass: bool, hand_rad: float = 0.0, first_s: float = 0.0) -> Rest:
    """A rest of a gyroscope that shows half a degree a second; the hand turns on the way, slowly."""
    t_s = seconds(duration_s, first_s)
    turned = 0.4 + hand_rad * np.clip((t_s - first_s) / duration_s, 0.0, 1.0)
    given: dict[str, Any] = {"yaw_gyro_rad": turned + BIAS * t_s}
    if compass:
        given["yaw_mag_rad"] = np.angle(np.exp(1j * (turned + 2.9)))
    return rest_of(still(duration_s, first_s, **given), moving(1.0, first_s + duration_s))


@pytest.mark.parametrize("compass", [True, False])
def test_a_long_rest_tells_what_the_bias_added_all_the_while(compass: bool) -> None:
    told = long_rest(600.0, compass)
    assert told.drift_rad == pytest.approx(BIAS * told.duration_s, rel=1e-4)  # most of a circle
    hand = SWAY * math.sqrt(1.0 + told.duration_s / 60.0)  # which wanders the longer it holds still
    sigma = hand * COMPASS / math.hypot(hand, COMPASS) if compass else hand
    assert told.drift_sigma_rad == pytest.approx(sigma)


@pytest.mark.parametrize("hand_rad", [math.radians(30.0), math.radians(-30.0), math.radians(170.0)])
def test_a_hand_that_turns_meanwhile_is_told_from_the_bias_by_the_compass(hand_rad: float) -> None:
    told = long_rest(600.0, True, hand_rad)
    off = told.drift_rad - BIAS * told.duration_s
    assert abs(off) <= 1.01 * told.drift_sigma_rad
    assert told.drift_sigma_rad < 0.2 * abs(hand_rad)
    blind = long_rest(600.0, False, hand_rad)
    assert blind.drift_rad - BIAS * blind.duration_s == pytest.approx(hand_rad, rel=0.01)


def shuffled(compass: bool) -> Rest:
    """A pause of ten minutes: eight rests of 45 s, and between them half a minute of handling the device."""
    t_s = seconds(600.0)
    resting = (t_s % 75.0) < 45.0
    handled = np.where(resting, 0.0, 1.5 * np.sin(2 * math.pi * ((t_s % 75.0) - 45.0) / 30.0))
    turned = 0.4 + handled + 0.002 * np.where(resting, np.sin(t_s), 0.0)
    yaw = turned + BIAS * t_s
    rests = Rests(RATE_HZ, SETTLE_S)
    for at in range(0, len(t_s), 7500):
        for lo, hi, still_now in ((at, at + 4500, True), (at + 4500, at + 7500, False)):
            given: dict[str, Any] = {"yaw_gyro_rad": yaw[lo:hi]}
            if compass:
                given["yaw_mag_rad"] = np.angle(np.exp(1j * (turned[lo:hi] - 1.0)))
            rests.push(levelled(hi - lo, lo, still=still_now, **given))
    return rests.take(10**9)


def test_a_pause_of_many_rests_is_known_as_a_whole_by_the_compass_at_its_ends() -> None:
    told, blind = shuffled(True), shuffled(False)
    assert told.duration_s == pytest.approx(7 * 75.0 + 45.0 - TRIM_S - 0.01)
    assert told.drift_rad == pytest.approx(BIAS * told.duration_s, abs=0.02)
    assert told.drift_sigma_rad == pytest.approx(math.hypot(COMPASS, 0.1), rel=1e-3)  # of the shuffling
    assert told.rate_rad_s == pytest.approx(BIAS, abs=3 * told.sigma_rad_s)
    # without one, each rest by itself, and nothing of what lies between
    settled = 45.0 - 2 * SETTLE_S - TRIM_S - 0.01
    assert blind.duration_s == pytest.approx(7 * settled + 45.0 - TRIM_S - 0.01)
    assert blind.drift_rad == pytest.approx(BIAS * blind.duration_s, rel=0.01)


def calibrated_at(signals: LevelledSignals, at_s: float) -> LevelledSignals:
    """The same, the magnetometer's zero jumping at a time by what turns the compass by half a radian."""
    jump = np.zeros((len(signals), 2))
    jump[np.searchsorted(signals.t_s, at_s)] = 20.0
    off = np.where(signals.t_s >= at_s, 0.5, 0.0)
    return replace(signals, field_jump_ut=jump, yaw_mag_rad=signals.yaw_mag_rad + off)


def test_a_magnetometer_calibrated_in_a_rest_shows_no_turn() -> None:
    rest = still(60.0, **swaying(60.0, bias=0.005, drift=0.0))
    told = rest_of(calibrated_at(rest, 30.0), moving(1.0, 60.0))
    assert told.drift_rad == pytest.approx(0.005 * told.duration_s, abs=1e-6)
    assert told.rate_rad_s == pytest.approx(0.005, abs=1e-6)


def test_nor_in_the_movement_between_two_rests_of_a_pause() -> None:
    between = moving(60.0, 20.0, **swaying(60.0, 0.005, 0.0, 20.0))
    parts = [
        still(20.0, **swaying(20.0, bias=0.005, drift=0.0)),
        between,
        calibrated_at(between, 50.0),
    ]
    last = still(20.0, 80.0, **swaying(20.0, 0.005, 0.0, 80.0))
    jumped = replace(last, yaw_mag_rad=last.yaw_mag_rad + 0.5)
    without, with_jump = (rest_of(parts[0], middle, jumped, moving(1.0, 100.0)) for middle in parts[1:])
    assert without.duration_s > 90.0  # by the compass at its ends
    assert with_jump.duration_s < 40.0  # by each rest alone
    assert with_jump.drift_rad == pytest.approx(0.005 * with_jump.duration_s, abs=1e-3)
