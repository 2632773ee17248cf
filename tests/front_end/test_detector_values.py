"""The step detector on cosines: the paper's conditions one by one, and ours against hands."""

import itertools
from typing import Any

import numpy as np
import pytest
from support.made_signals import G, levelled

from fbgraph.core.config import StepsConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_detector import StepDetector
from fbgraph.front_end.step_track import Peak

SMOOTHING = 15  # samples of 0.15 s; delays by seven


def bumps(at: list[int], heights: list[float] | float = 3.0, count: int | None = None, width: int = 50) -> FloatArray:
    """|acc| with a raised cosine of this width and height, valley to top, around each index."""
    acc = np.full(count or at[-1] + 400, G)
    tall = heights if isinstance(heights, list) else [heights] * len(at)
    for centre, height in zip(at, tall, strict=True):
        i = np.arange(centre - width // 2, centre + width // 2 + 1)
        acc[i] = np.maximum(acc[i], G + height * (0.5 + 0.5 * np.cos(2 * np.pi * (i - centre) / width)))
    return acc


def every(interval: int, number: int, first: int = 600) -> list[int]:
    return [first + interval * i for i in range(number)]


def smoothed(acc: FloatArray) -> FloatArray:
    """The paper's moving average over the last N samples; fewer at the beginning."""
    return np.array([acc[max(i - SMOOTHING + 1, 0) : i + 1].mean() for i in range(len(acc))])


def found(acc: FloatArray, config: StepsConfig | None = None, chunk: int = 10**9, **given: Any) -> list[list[Peak]]:
    signals = levelled(len(acc), acc_norm_m_s2=acc, **given)
    return found_in(signals, config, chunk)


def found_in(signals: LevelledSignals, config: StepsConfig | None = None, chunk: int = 10**9) -> list[list[Peak]]:
    detector, count = StepDetector(config or StepsConfig(), 100.0), len(signals)
    pieces = [signals.tail(count - at).head(chunk) for at in range(0, count, chunk)]
    return [run for piece in pieces for run in detector.push(piece)]


def times(runs: list[list[Peak]]) -> list[int]:
    return [peak.index for run in runs for peak in run]


def test_every_step_is_at_the_top_of_its_bump() -> None:
    at = every(50, 12)
    runs = found(bumps(at))
    assert times(runs) == at
    assert [len(run) for run in runs] == [4] + [1] * 8  # a run is believed once it has four
    peaks = [peak for run in runs for peak in run]
    assert [p.start_index for p in peaks] == [550, *at[:-1]]  # the first began one interval before its top
    assert [p.first for p in peaks] == [True] + [False] * 11


def test_the_first_step_of_a_run_is_as_long_as_the_second() -> None:
    runs = found(bumps([600, 640, 700, 750]))
    assert [(p.start_index, p.index) for p in runs[0]] == [(560, 600), (600, 640), (640, 700), (700, 750)]


def test_even_smoothing_delays_by_the_lower_half() -> None:
    at = every(50, 6)
    signal = bumps(at) - 1e-6 * np.arange(at[-1] + 400)  # of two equal tops the earlier
    assert times(found(signal, StepsConfig(smoothing_s=0.16))) == at


def z_of(acc: FloatArray, index: int, window: int) -> float:
    """How many deviations the smoothed top of a bump stands above the mean of the window that ends there."""
    value = smoothed(acc)
    top = index + SMOOTHING // 2
    part = value[top - window + 1 : top + 1]
    return float((value[top] - part.mean()) / part.std())


@pytest.mark.parametrize("window_s", [4.0, 2.5])
def test_a_step_exceeds_the_mean_by_lambda_deviations(window_s: float) -> None:
    """Eleven bumps, the eighth low and off beat: it is a step exactly if λ is below what it reaches."""
    at = every(50, 11)
    at[7] -= 12
    acc = bumps(at, [3.0] * 7 + [1.75] + [3.0] * 3, width=30)
    z = z_of(acc, at[7], round(window_s * 100))
    assert 0.1 < z < 1.2
    below, above = (StepsConfig(window_s=window_s, lambda_sigma=z + dz) for dz in (-0.005, 0.005))
    assert times(found(acc, below)) == at
    assert times(found(acc, above)) == at[:7] + at[8:]


def test_tops_within_the_refractory_interval_are_no_steps() -> None:
    at = every(33, 12)
    acc = bumps(at, width=20)
    assert times(found(acc)) == at[::2]  # T_min of 0.33 s must be exceeded
    assert times(found(acc, StepsConfig(min_interval_s=0.32))) == at


@pytest.mark.parametrize(("rise", "steps"), [(0.79, 0), (0.81, 8)])
def test_a_step_stands_out_from_the_valley_before_it(rise: float, steps: int) -> None:
    x = 2 * np.pi / 50
    left = np.sin(SMOOTHING * x / 2) / (SMOOTHING * np.sin(x / 2))  # of a cosine's height, by the moving average
    at = every(50, 8)
    acc = bumps(at, rise / float(left))
    # smoothing at both ends of the row sees the flat around it, inside it sees cosines only
    inside = times(found(np.concatenate((acc[575:951], acc[575:951], np.full(100, G)))))
    assert len(inside) >= 13 if steps else not inside
    assert len(times(found(acc, StepsConfig(min_rise_m_s2=0.5)))) == 8


def test_the_valley_is_the_deepest_since_the_step_before() -> None:
    """A second top on the shoulder of a step is none, however high: it rises little since the step before."""
    acc = bumps(every(100, 8), 4.0, width=60)
    for centre in every(100, 8):
        i = np.arange(centre + 34, centre + 47)
        acc[i] = np.maximum(acc[i], G + 2.0)
    assert times(found(acc, StepsConfig(min_rise_m_s2=2.5))) == every(100, 8)


def test_before_a_first_step_only_the_last_six_tenths_of_a_second_are_a_valley() -> None:
    at = every(50, 6)
    for ago, steps in ((50, at), (70, at[1:])):
        acc = bumps(at, [0.7] + [3.0] * 5)
        dip = np.interp(np.arange(600), (0, 600 - ago - 30, 600 - ago, 575), (0.0, -1.5, -0.05, 0.0))
        acc[:600] += dip  # back from a dip, then ever so slowly up to the bump
        assert times(found(acc)) == steps


@pytest.mark.parametrize(("number", "min_run", "steps"), [(3, 4, 0), (4, 4, 4), (2, 2, 2), (5, 6, 0), (6, 6, 6)])
def test_steps_come_in_runs(number: int, min_run: int, steps: int) -> None:
    assert len(times(found(bumps(every(50, number)), StepsConfig(min_run=min_run)))) == steps


@pytest.mark.parametrize(("pause", "firsts"), [(120, [0]), (121, [0, 5])])
def test_a_longer_interval_is_a_pause_and_a_new_run(pause: int, firsts: list[int]) -> None:
    first = every(50, 5)
    at = first + every(50, 5, first[-1] + pause)
    peaks = [p for run in found(bumps(at)) for p in run]
    assert [p.index for p in peaks] == at
    assert [i for i, p in enumerate(peaks) if p.first] == firsts
    assert peaks[5].start_index == (at[4] if len(firsts) == 1 else at[5] - 50)


def test_too_few_steps_after_a_pause_are_none() -> None:
    first = every(50, 5)
    assert times(found(bumps(first + every(50, 3, first[-1] + 200)))) == first


def walking(**given: Any) -> list[int]:
    return times(found(bumps(every(50, 20)), **given))


ALL = every(50, 20)


def test_a_device_that_tilts_fast_is_shaken() -> None:
    """On average over the step: half of it at 5.9 rad/s is carried, at 6.2 shaken; the run must begin anew."""
    tilt = np.zeros(ALL[-1] + 400)
    tilt[ALL[9] + 7 : ALL[9] + 32] = 5.9  # within a step as the smoothed tops delimit it
    assert walking(tilt_rate_rad_s=tilt) == ALL
    tilt *= 6.2 / 5.9
    assert walking(tilt_rate_rad_s=tilt) == ALL[:10] + ALL[11:]
    tilt[ALL[17] + 7 : ALL[17] + 32] = 6.2
    assert walking(tilt_rate_rad_s=tilt) == ALL[:10] + ALL[11:18]  # one step is left after it: no run


def spun(radians: float, seconds: float) -> FloatArray:
    at = (np.arange(ALL[-1] + 400) - 900) / 100.0
    return np.asarray(radians * np.clip(at / seconds, 0.0, 1.0))


def test_who_spins_on_the_spot_does_not_walk() -> None:
    assert walking(yaw_gyro_rad=spun(4.1, 1.0)) == ALL
    assert walking(yaw_gyro_rad=spun(-4.1, 1.0)) == ALL
    for sign in (1.0, -1.0):
        dropped = sorted(set(ALL) - set(walking(yaw_gyro_rad=spun(sign * 4.3, 1.0))))
        # from the end of the turn until it lies three seconds back, as seen at the smoothed tops
        assert dropped == [at for at in ALL if 900 + 100 * 4.2 / 4.3 < at + 7 < 1200]
    assert walking(yaw_gyro_rad=spun(8.0, 6.0)) == ALL  # four radians in three seconds
    assert walking(yaw_gyro_rad=spun(8.0, 6.0), config=StepsConfig(max_spin_rad=3.9)) != ALL


def wobbled(radians: float) -> FloatArray:
    """There and back again within a second."""
    at = (np.arange(ALL[-1] + 400) - 900) / 100.0
    return np.asarray(radians * np.maximum(1.0 - np.abs(at - 0.5) / 0.5, 0.0))


def test_a_device_whose_yaw_goes_back_and_forth_is_shaken() -> None:
    """Twice the swing is more than it turned in the end; the window is two seconds."""
    assert walking(yaw_gyro_rad=wobbled(0.60)) == ALL
    dropped = sorted(set(ALL) - set(walking(yaw_gyro_rad=wobbled(0.75))))
    assert dropped
    assert 900 < dropped[0] <= 1000 + 50
    assert dropped[-1] < 1100
    turn = 1.2 * np.clip((np.arange(ALL[-1] + 400) - 900) / 100.0, 0.0, 1.0)
    assert walking(yaw_gyro_rad=turn) == ALL  # turning is not wobbling


def gapped(after: int, length: int) -> LevelledSignals:
    at = every(50, 20)
    acc = bumps(at)
    index = np.arange(len(acc))
    keep = (index <= after) | (index > after + length)
    return levelled(int(keep.sum()), index=index[keep], acc_norm_m_s2=acc[keep])


def test_a_gap_longer_than_a_pause_ends_the_run() -> None:
    peaks = [p for run in found_in(gapped(1210, 150)) for p in run]
    assert [p.index for p in peaks if p.first] == [600, 1400]
    assert [p.index for p in peaks] == every(50, 13) + every(50, 4, 1400)


def test_no_step_happens_before_the_gap_that_its_average_reaches_back_over() -> None:
    for after in range(1195, 1206):
        for peak in (p for run in found_in(gapped(after, 60)) for p in run):
            assert not after < peak.index <= after + 60


def test_a_top_seen_only_after_a_gap_is_a_step_after_it() -> None:
    """The bump up to 1252 and from 1303 on looks like one; its smoothed top comes after the gap."""
    assert times(found_in(gapped(1252, 50))) == [*every(50, 13), 1303, *every(50, 5, 1350)]


@pytest.mark.parametrize("chunk", [1, 7, 50, 333])
def test_any_chunks_give_the_same_steps(chunk: int) -> None:
    rng = np.random.default_rng(8)
    at = (600 + np.cumsum(rng.integers(36, 100, 60))).tolist()
    acc = bumps(at, rng.uniform(1.5, 4.0, 60).tolist(), width=40)
    acc += rng.normal(0.0, 0.1, len(acc))
    yaw = np.cumsum(rng.normal(0.0, 0.03, len(acc)))
    whole, cut = found(acc, yaw_gyro_rad=yaw), found(acc, chunk=chunk, yaw_gyro_rad=yaw)
    assert cut == whole
    assert len(times(whole)) > 25
    assert sum(peak.first for run in whole for peak in run) > 1


def test_a_step_is_told_one_sample_after_its_smoothed_top() -> None:
    at = every(50, 6)
    signals = levelled(len(bumps(at)), acc_norm_m_s2=bumps(at))
    detector, told = StepDetector(StepsConfig(), 100.0), []
    for i in range(len(signals)):
        piece = signals.tail(len(signals) - i).head(1)
        told += [(i, peak.index) for run in detector.push(piece) for peak in run]
    assert told[:4] == [(at[3] + 8, index) for index in at[:4]]
    assert told[4:] == [(index + 8, index) for index in at[4:]]


def test_a_flat_signal_has_no_steps() -> None:
    assert found(np.full(2000, G)) == []
    assert StepDetector(StepsConfig(), 100.0).push(levelled(0)) == []
    assert list(itertools.chain(*found(bumps(every(50, 8), 0.3)))) == []
