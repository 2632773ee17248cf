"""One step measured by hand: length, frequency, slope, directions, field, altitude, rest and chain."""

import math
from typing import Any

import numpy as np
import pytest
from support.made_signals import G, levelled

from fbgraph.core.config import StepLengthConfig
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_measurement import StepGauge
from fbgraph.front_end.step_track import Peak, Step

CONFIG = StepLengthConfig(alpha_m=0.4, beta_m_s=0.2, gamma_m=-1.5, beta2_m_s2=0.0, kappa_surge=0.1, min_climb_m_s=0.2)
ONE = Peak(1050, 1000, first=True)
"""Half a second, two hertz."""


def gauged(signals: LevelledSignals, *peaks: Peak, config: StepLengthConfig = CONFIG, chunk: int = 10**9) -> list[Step]:
    """The steps of one run, the standing start first."""
    gauge = StepGauge(config, 100.0, 3.0)
    for at in range(0, len(signals), chunk):
        gauge.push(signals.tail(len(signals) - at).head(chunk))
    return gauge.measure(list(peaks))


def step_of(**columns: Any) -> Step:
    return gauged(levelled(1200, **columns), ONE)[1]


def bounce(
    low: float = G, high: float = G, start: int = 1000, end: int = 1050
) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Vertical acceleration: its extremes in the first and the last sample of a step, wilder just outside."""
    up = np.full(1200, G)
    up[start + 1], up[end] = low, high
    up[start], up[end + 1] = -100.0, 100.0
    return up


def surging(speed_m_s: float, hz: float = 2.0, start: int = 1000) -> dict[str, Any]:
    """Horizontal acceleration of a speed that goes to and fro by this much, peak to peak; wilder outside the step."""
    t_s = (np.arange(1200) - start) / 100.0
    push = np.pi * hz * speed_m_s * np.cos(2.0 * np.pi * hz * t_s)
    inside = (t_s > 0.0) & (t_s <= 0.5)
    return {"forward_m_s2": np.where(inside, 0.8 * push + 3.0, 50.0), "left_m_s2": np.where(inside, 0.6 * push, -50.0)}


def test_length_is_alpha_beta_f_and_kappa_of_the_surge() -> None:
    step = step_of(up_m_s2=bounce(2.0, 18.0), **surging(0.16))
    assert step.frequency_hz == 2.0
    assert step.bounce_m_s2 == 16.0
    assert step.surge_m_s == pytest.approx(0.16, rel=2e-3)
    assert step.length_m == pytest.approx(0.4 + 0.2 * 2.0 + 0.1 * 0.4, abs=1e-4)
    assert (step.slope, step.shortened_m) == (0.0, 0.0)
    assert (step.t_s, step.start_s) == (10.5, 10.0)


def test_a_limb_swings_more_than_its_wearer_surges() -> None:
    step = step_of(**surging(0.8))
    assert step.surge_m_s == pytest.approx(0.8, rel=2e-3)
    assert step.length_m == pytest.approx(0.4 + 0.2 * 2.0 + 0.1 * math.sqrt(0.2))


def test_who_does_not_surge_shuffles() -> None:
    step = step_of()
    assert step.surge_m_s == 0.0
    assert step.length_m == pytest.approx(0.8)


def test_a_surge_that_was_not_seen_whole_is_the_usual_one() -> None:
    """A log that begins within the first step, a gap within a step, steps that were not told apart."""
    gap = levelled(1200, index=np.arange(1200) + 10 * (np.arange(1200) > 1020))
    for signals, peak in (
        (levelled(1200), Peak(30, -20, True)),
        (gap, Peak(1060, 1000, True)),
        (levelled(1300), Peak(1200, 1000, True, count=4.0)),
    ):
        assert gauged(signals, peak)[1].surge_m_s == 0.2


def test_nobody_knows_the_length_of_steps_that_surge_beyond_any_that_was_measured() -> None:
    within, beyond = step_of(**surging(0.98)), step_of(**surging(1.02))
    assert within.doubt_m == 0.0
    assert beyond.doubt_m == pytest.approx(0.25 * beyond.length_m)
    paper = CONFIG.model_copy(update={"kappa_surge": 0.0})
    assert gauged(levelled(1200, **surging(1.02)), ONE, config=paper)[1].doubt_m == 0.0


def test_frequency_is_over_this_step_and_the_one_before_within_a_run() -> None:
    peaks = Peak(1050, 1000, True), Peak(1090, 1050, False), Peak(1150, 1090, False)
    again = Peak(1800, 1720, True), Peak(1850, 1800, False)
    steps = gauged(levelled(2000), *peaks, *again)[1:]
    assert [s.frequency_hz for s in steps] == pytest.approx([2.0, 100 / 45, 2.0, 1.25, 100 / 65])


def climbing(rate_m_s: float, since: int = 0) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.asarray(300.0 + rate_m_s * np.maximum(np.arange(1200) - since, 0) / 100.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_stairs_up_or_down_shorten_the_step_by_their_slope(sign: float) -> None:
    config = CONFIG.model_copy(update={"kappa_surge": 0.0, "gamma_m": -0.8})
    (_, step) = gauged(levelled(1200, altitude_m=climbing(sign * 0.4)), ONE, config=config)
    # on the level 0.8 m at 2 Hz: 0.4 m/s over 1.6 m/s
    assert step.slope == pytest.approx(0.25)
    assert step.shortened_m == pytest.approx(0.2)
    assert step.length_m == pytest.approx(0.6)


def test_a_slope_that_lengthens_is_counted_as_much() -> None:
    config = CONFIG.model_copy(update={"kappa_surge": 0.0, "gamma_m": 0.8})
    (_, step) = gauged(levelled(1200, altitude_m=climbing(0.4)), ONE, config=config)
    assert (step.length_m, step.shortened_m) == pytest.approx((1.0, 0.2))


def test_no_step_is_shorter_than_the_shortest() -> None:
    steep = CONFIG.model_copy(update={"gamma_m": -4.0})
    assert gauged(levelled(1200, altitude_m=climbing(0.4)), ONE, config=steep)[1].length_m == 0.15
    negative = CONFIG.model_copy(update={"alpha_m": -1.0})
    (_, step) = gauged(levelled(1200, altitude_m=climbing(0.3)), ONE, config=negative)
    assert step.slope == pytest.approx(0.3 / (0.15 * 2.0))  # nor is its speed on the level


def test_a_slow_change_of_altitude_is_the_weather_and_a_fast_one_air() -> None:
    assert step_of(altitude_m=climbing(0.19)).slope == 0.0
    assert step_of(altitude_m=climbing(0.21)).slope > 0.0
    assert step_of(altitude_m=climbing(0.49)).slope > 0.0  # at 2 Hz a quarter of a metre a step
    assert step_of(altitude_m=climbing(0.51)).slope == 0.0
    assert step_of().slope == 0.0
    config = CONFIG.model_copy(update={"min_climb_m_s": 0.5})
    assert gauged(levelled(1200, altitude_m=climbing(0.4)), ONE, config=config)[1].slope == 0.0


def test_what_was_climbed_in_a_gap_is_no_slope() -> None:
    """A minute without samples, three floors up in a lift, then level ground again."""
    leap = np.arange(1200) > 900
    signals = levelled(1200, index=np.arange(1200) + 6000 * leap, altitude_m=np.where(leap, 309.0, 300.0))
    assert gauged(signals, Peak(7050, 7000, first=True))[1].slope == 0.0


def test_directions_are_means_over_the_samples_of_the_step() -> None:
    yaw = np.zeros(1200)
    yaw[1001:1051] = 0.01 * np.arange(50)
    yaw[1000], yaw[1051] = 50.0, 50.0
    step = step_of(yaw_gyro_rad=yaw)
    assert step.yaw_gyro_rad == pytest.approx(0.245)
    assert step.yaw_s == pytest.approx(10.255)


def test_the_compass_is_averaged_as_seen_from_the_gyroscope() -> None:
    """Round a turn and across the wrap: the mean gyroscope yaw and the mean difference to it."""
    gyro = 7.0 + np.linspace(0.0, 12.0, 1200)
    compass = np.angle(np.exp(1j * (gyro - 4.0 + np.where(np.arange(1200) % 2, 0.2, -0.2))))
    compass[1010:1020] = np.nan
    step = step_of(yaw_gyro_rad=gyro, yaw_mag_rad=compass)
    expected = math.remainder(float(gyro[1001:1051].mean()) - 4.0, 2 * math.pi)
    assert step.yaw_mag_rad == pytest.approx(expected)
    assert -math.pi <= step.yaw_mag_rad < math.pi
    assert math.isnan(step_of(yaw_gyro_rad=gyro).yaw_mag_rad)


def test_the_compass_difference_is_a_circular_mean() -> None:
    compass = np.where(np.arange(1200) % 2, 3.0, -3.0)
    assert abs(step_of(yaw_mag_rad=compass).yaw_mag_rad) == pytest.approx(math.pi)


def test_field_and_altitude_are_means_of_what_is_known() -> None:
    norm, dip, altitude = np.full((3, 1200), np.nan)
    norm[1001:1051], dip[1001:1051], altitude[1001:1051] = 48.0, 1.1, 300.0
    norm[1001], dip[1050], altitude[1025] = 98.0, 2.1, 350.0
    norm[1002], dip[1002], altitude[1002] = np.nan, np.nan, np.nan
    step = step_of(mag_norm_ut=norm, mag_dip_rad=dip, altitude_m=altitude)
    assert step.mag_norm_ut == pytest.approx(48.0 + 50 / 49)
    assert step.mag_dip_rad == pytest.approx(1.1 + 1 / 49)
    assert step.altitude_m == pytest.approx(300.0 + 50 / 49)
    silent = step_of()
    assert all(math.isnan(v) for v in (silent.mag_norm_ut, silent.mag_dip_rad, silent.altitude_m))


def test_a_walk_begins_with_its_standing_start() -> None:
    altitude = np.full(1200, 300.0)
    altitude[:500], altitude[1050:] = 0.0, 900.0  # five seconds before the step, and the step up to its end
    columns: dict[str, Any] = {"yaw_gyro_rad": 0.7, "yaw_mag_rad": 0.5, "mag_norm_ut": 48.0, "mag_dip_rad": 1.1}
    start, step = gauged(levelled(1200, altitude_m=altitude, up_m_s2=bounce(2.0, 18.0), **columns), ONE)
    assert (start.t_s, start.start_s, start.length_m) == (10.0, 10.0, 0.0)
    assert (start.slope, start.shortened_m, start.rest_s) == (0.0, 0.0, 0.0)
    assert (start.yaw_s, start.yaw_gyro_rad) == (step.yaw_s, step.yaw_gyro_rad)
    assert start.altitude_m == pytest.approx(300.0)
    assert start.chained
    unknown = ("yaw_mag_rad", "mag_norm_ut", "mag_dip_rad", "rest_rate_rad_s", "rest_sigma_rad_s")
    assert all(math.isnan(getattr(start, name)) for name in unknown)


def test_only_the_first_run_has_a_standing_start() -> None:
    gauge = StepGauge(CONFIG, 100.0, 3.0)
    gauge.push(levelled(1200))
    assert [s.length_m > 0 for s in gauge.measure([ONE, Peak(1100, 1050, False)])] == [False, True, True]
    gauge.push(levelled(1200, 1200))
    assert [s.length_m > 0 for s in gauge.measure([Peak(2100, 2050, True)])] == [True]


def test_the_rest_before_a_step_comes_with_it_once() -> None:
    still = np.arange(1200) < 900
    yaw = 0.02 * np.arange(1200) / 100.0
    signals = levelled(1200, still=still, yaw_gyro_rad=yaw)
    start, step, after = gauged(signals, ONE, Peak(1100, 1050, False))
    assert step.rest_rate_rad_s == pytest.approx(0.02)
    assert step.rest_s == pytest.approx(9.0 - 0.75 - 0.01)
    assert step.rest_sigma_rad_s == pytest.approx(0.03 / step.rest_s + 2e-4)
    assert (start.rest_s, after.rest_s) == (0.0, 0.0)
    assert math.isnan(after.rest_rate_rad_s)


def holed(*holes: int, count: int = 3000, length: int = 100) -> LevelledSignals:
    """Signals whose index leaps by ``length`` after each of these indices."""
    index = np.arange(count, dtype=np.int64)
    for hole in holes:
        index = np.where(index > hole, index + length, index)
    return levelled(count, index=index)


RUN = (Peak(1050, 1000, True), Peak(1100, 1050, False), Peak(1400, 1350, True))


@pytest.mark.parametrize(
    ("hole", "chained"),
    [
        (900, [True, True, True]),  # before the walk
        (1020, [False, True, True]),
        (1049, [False, True, True]),
        (1050, [True, False, True]),
        (1100, [True, True, False]),
        (1200, [True, True, False]),
        (1399, [True, True, False]),
        (1400, [True, True, True]),
    ],
)
@pytest.mark.parametrize("chunk", [10**9, 40])
def test_a_gap_before_a_step_breaks_its_chain_to_the_one_before(hole: int, chained: list[bool], chunk: int) -> None:
    peaks = [Peak(p.index + 100 * (p.index > hole), p.start_index + 100 * (p.start_index > hole), p.first) for p in RUN]
    signals = holed(hole, count=1450)
    assert [s.chained for s in gauged(signals, *peaks, chunk=chunk)[1:]] == chained


@pytest.mark.parametrize(("hole", "chained"), [(1020, True), (1050, False), (1900, False), (3100, True)])
def test_so_does_one_longer_ago_than_signals_are_kept(hole: int, chained: bool) -> None:
    gauge, signals = StepGauge(CONFIG, 100.0, 3.0), holed(hole, count=3200, length=10)
    steps: list[Step] = []
    for at in range(0, 3200, 50):
        piece = signals.tail(3200 - at).head(50)
        gauge.push(piece)
        for peak in (Peak(1050 + 10 * (hole < 1050), 1000, True), Peak(3060, 3010, True)):
            if piece.index[0] <= peak.index <= piece.index[-1]:
                steps += gauge.measure([peak])
    assert steps[-1].chained is chained


def test_a_gap_after_a_step_does_not_break_its_chain_after_a_long_rest() -> None:
    gauge, signals = StepGauge(CONFIG, 100.0, 3.0), holed(3080, count=3200)
    gauge.push(signals.head(1100))
    gauge.measure([ONE])
    for at in range(1100, 3000, 100):
        gauge.push(signals.tail(3200 - at).head(100))
    gauge.push(signals.tail(200))
    assert gauge.measure([Peak(3060, 3010, True)])[0].chained


def test_any_chunks_give_the_same_step() -> None:
    rng = np.random.default_rng(3)
    columns: dict[str, Any] = {
        n: rng.normal(0, 1, 1200) for n in ("yaw_gyro_rad", "yaw_mag_rad", "mag_norm_ut", "altitude_m")
    }
    signals = levelled(1200, up_m_s2=rng.normal(G, 2, 1200), **columns)
    whole = gauged(signals, ONE)
    assert all(repr(gauged(signals, ONE, chunk=chunk)) == repr(whole) for chunk in (1, 37, 600))


@pytest.mark.parametrize(("end", "doubt_m"), [(30, 1.6), (119, 1.6), (120, 0.0), (1050, 0.0)])
def test_the_first_step_of_a_log_that_begins_in_the_middle_of_a_walk_is_doubted(end: int, doubt_m: float) -> None:
    peaks = Peak(end, end - 50, True), Peak(end + 50, end, False)
    start, first, second = gauged(levelled(1200), *peaks)
    assert (start.doubt_m, first.doubt_m, second.doubt_m) == (0.0, doubt_m, 0.0)
    sure = CONFIG.model_copy(update={"start_doubt_m": 0.0})
    assert [step.doubt_m for step in gauged(levelled(1200), *peaks, config=sure)] == [0.0] * 3


def test_a_stretch_of_doubtful_steps_is_wrong_all_together() -> None:
    """Every second half a metre, a third in doubt: after n of them the doubt is a third of all, not √n of one."""
    config = CONFIG.model_copy(update={"alpha_m": 0.1, "kappa_surge": 0.0})  # 0.1 + 0.2 * 2 Hz
    peaks = [Peak(1000 + 50 * i, 950 + 50 * i, i == 0, doubt=0.3) for i in range(5)]
    steps = gauged(levelled(1300), *peaks, config=config)[1:]
    for n in range(1, 6):
        assert math.sqrt(sum(step.doubt_m**2 for step in steps[:n])) == pytest.approx(0.3 * 0.5 * n)


def test_a_stretch_of_doubt_ends_with_a_step_beyond_doubt() -> None:
    config = CONFIG.model_copy(update={"alpha_m": 0.1, "kappa_surge": 0.0})
    doubts = (0.3, 0.3, 0.0, 0.3)
    peaks = [Peak(1000 + 50 * i, 950 + 50 * i, i == 0, doubt=doubt) for i, doubt in enumerate(doubts)]
    steps = gauged(levelled(1300), *peaks, config=config)[1:]
    assert [s.doubt_m for s in steps] == pytest.approx([0.15, 0.15 * math.sqrt(3.0), 0.0, 0.15])


def test_a_stretch_shares_its_doubt_up_to_twenty_metres() -> None:
    config = CONFIG.model_copy(update={"alpha_m": 0.1, "kappa_surge": 0.0})
    gauge = StepGauge(config, 100.0, 3.0)
    gauge.push(levelled(1300))
    peaks = [Peak(1000 + 50 * (i % 5), 950 + 50 * (i % 5), False, doubt=20.0) for i in range(5)]
    doubts = [step.doubt_m for step in gauge.measure(peaks)[1:]]  # 10 m each
    assert doubts == pytest.approx([10.0, 10.0 * math.sqrt(3.0), 10.0 * math.sqrt(5.0), 10.0, 10.0 * math.sqrt(3.0)])


@pytest.mark.parametrize(("interval", "doubtful"), [(38, True), (45, False), (80, False), (100, True)])
def test_nobody_knows_the_length_of_steps_at_unusual_cadences(interval: int, doubtful: bool) -> None:
    config = CONFIG.model_copy(update={"kappa_surge": 0.0})
    step = gauged(levelled(1200), Peak(1000 + interval, 1000, True), config=config)[1]
    assert step.doubt_m == pytest.approx(0.25 * step.length_m if doubtful else 0.0)


def test_a_length_that_bends_with_cadence_does_so_within_the_cadences_it_was_measured_at() -> None:
    bent = CONFIG.model_copy(update={"alpha_m": -1.0, "beta_m_s": 1.4, "beta2_m_s2": -0.3, "kappa_surge": 0.0})
    lengths = [
        gauged(levelled(1200), Peak(1000 + n, 1000, True), config=bent)[1].length_m for n in (30, 50, 80, 100, 110)
    ]
    slow_m, fast_m = -1.0 + 1.4 * 1.1 - 0.3 * 1.21, -1.0 + 1.4 * 2.4 - 0.3 * 5.76
    assert lengths == pytest.approx([fast_m, 0.6, -1.0 + 1.75 - 0.3 * 1.5625, slow_m, slow_m])


def test_a_length_that_shrinks_with_cadence_does_not_vanish_in_a_run() -> None:
    shrinking = CONFIG.model_copy(update={"alpha_m": 1.2, "beta_m_s": -0.3, "kappa_surge": 0.0})
    assert gauged(levelled(1200), Peak(1032, 1000, True), config=shrinking)[1].length_m == pytest.approx(
        1.2 - 0.3 * 2.4
    )
    growing = CONFIG.model_copy(update={"kappa_surge": 0.0})
    assert gauged(levelled(1200), Peak(1032, 1000, True), config=growing)[1].length_m == pytest.approx(0.4 + 0.2 / 0.32)


def test_one_peak_may_stand_for_several_steps_or_for_part_of_one() -> None:
    config = CONFIG.model_copy(update={"kappa_surge": 0.0})
    long, short = (
        gauged(levelled(1300), peak, config=config)[1]
        for peak in (Peak(1200, 1000, True, count=4.0), Peak(1050, 1000, True, share=0.8))
    )
    assert (long.frequency_hz, short.frequency_hz) == (2.0, 2.0)
    assert long.length_m == pytest.approx(4 * 0.8)
    assert short.length_m == pytest.approx(0.8 * 0.8)
    assert math.isnan(long.gait_yaw_rad)


def test_a_limb_swings_more_than_its_wearer_bounces() -> None:
    signals = levelled(1200, up_m_s2=bounce(2.0, 34.0))
    worn, swung = (gauged(signals, Peak(1050, 1000, True, swung=limb))[1] for limb in (False, True))
    assert (worn.bounce_m_s2, swung.bounce_m_s2) == (32.0, 12.0)
