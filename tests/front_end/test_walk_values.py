"""A made-up walk through the whole front end: raw samples of a bouncing, turning device to steps."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from support.made_signals import G, about_z, pieces, pressures, resting, same_signals, turned, without

from fbgraph.core.atmosphere import altitude_pressure_hpa
from fbgraph.core.config import Config, load_config
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.front_end import detect_steps as module
from fbgraph.front_end.detect_steps import FrontEnd, detect_steps
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import Step, StepTrack

LENGTH = {"alpha_m": 0.4, "beta_m_s": 0.1, "beta2_m_s2": 0.0, "kappa_surge": 0.1}
CONFIG = load_config(None, [f"step_length.{key}={value}" for key, value in LENGTH.items()])
STAND_S, WALK_S, INTERVAL_S, BIAS = 10.0, 30.0, 0.5, 0.01


def yaw(t_s: FloatArray) -> FloatArray:
    """Straight on to the North, a quarter turn to the left from 20 to 22 s."""
    return np.asarray(np.pi / 4 * np.clip(t_s - 20.0, 0.0, 2.0))


def rate(t_s: FloatArray) -> FloatArray:
    return np.asarray(BIAS + np.pi / 4 * ((t_s > 20.0) & (t_s < 22.0)))


def walk(rate_hz: float = 100.0, late_s: float = 0.0) -> SensorLog:
    """Ten seconds of standing, sixty steps half a second long, five more seconds of standing."""
    t_s = np.arange(round((STAND_S + WALK_S + 5.0) * rate_hz) + 1) / rate_hz
    walking = (t_s > STAND_S - 0.25) & (t_s < STAND_S + WALK_S - 0.25)
    phase = 2 * np.pi * (t_s - STAND_S) / INTERVAL_S
    up = G + np.where(walking, 2.0 * np.cos(phase), 0.0)
    # forward a good quarter of a step before the bounce, to the left with every other step
    push = np.column_stack((0.6 * np.cos(phase + 1.3), 0.3 * np.sin(phase / 2)))
    log = turned(yaw, rate, t_s, acc_up=up, acc_level=np.where(walking[:, None], push, 0.0), tilt_rad=0.5)
    # a biased gyroscope: about the vertical, in body axes tilted by half a radian
    n_r_b = about_z(np.zeros(1))[0] @ np.array(
        [[1, 0, 0], [0, np.cos(0.5), -np.sin(0.5)], [0, np.sin(0.5), np.cos(0.5)]]
    )
    log = replace(log, gyro=Stream(t_s, np.outer(rate(t_s), n_r_b[2])))
    log = replace(log, pressure=pressures(altitude_pressure_hpa(np.full(450, 300.0))))
    return log if late_s == 0 else shifted(log, late_s)


def shifted(log: SensorLog, by_s: float) -> SensorLog:
    acc, gyro, mag, pressure = (Stream(s.t_s + by_s, s.values) for s in (log.acc, log.gyro, log.mag, log.pressure))
    return replace(log, acc=acc, gyro=gyro, mag=mag, pressure=pressure)


@pytest.fixture(scope="module")
def whole() -> tuple[StepTrack, LevelledSignals]:
    return detect_steps(walk(), CONFIG)


Whole = tuple[StepTrack, LevelledSignals]


def test_every_step_is_found_at_the_top_of_its_bounce(whole: Whole) -> None:
    track = whole[0]
    assert len(track) == 61
    assert np.allclose(track.t_s[1:], STAND_S + INTERVAL_S * np.arange(60), atol=0.015)
    assert np.allclose(np.diff(track.t_s[1:]), INTERVAL_S, atol=0.015)
    assert track.t_s[0] == track.start_s[1] == pytest.approx(STAND_S - INTERVAL_S, abs=0.015)
    assert np.allclose(track.frequency_hz[2:], 2.0, atol=0.05)


def test_every_length_is_that_of_cadence_and_surge(whole: Whole) -> None:
    """0.4 + 0.1 · 2 Hz + 0.1 √surge; the gait begins and ends at the valleys.

    The push, 0.6 cos 2ωt, makes a speed of amplitude 0.6/2ω; the sway of 0.3 sin ωt, of which a step sees half a
    period, one of -0.3/ω cos ωt, with a variance of (0.3/ω)² (1/2 - 4/π²).
    """
    push_m_s, sway_m_s = 2.0 * 0.6 / (4.0 * np.pi), np.sqrt(8.0 * (0.5 - 4.0 / np.pi**2)) * 0.3 / (2.0 * np.pi)
    track = whole[0]
    assert track.length_m[0] == 0.0
    assert np.allclose(track.length_m[2:], 0.6 + 0.1 * np.sqrt(np.hypot(push_m_s, sway_m_s)), atol=0.002)
    assert not track.slope.any()


def test_directions_are_the_turn_and_the_gyroscopes_its_bias_too(whole: Whole) -> None:
    track = whole[0]
    steps = slice(2, None)
    assert np.allclose(track.yaw_s[steps], track.t_s[steps] - INTERVAL_S / 2 + 0.005, atol=0.01)
    compass = track.yaw_mag_rad[steps] - np.pi / 2
    assert np.allclose(np.angle(np.exp(1j * (compass - yaw(track.yaw_s[steps])))), 0.0, atol=0.02)
    turned_rad = track.yaw_gyro_rad - track.yaw_gyro_rad[1]
    expected = yaw(track.yaw_s) + BIAS * (track.yaw_s - track.yaw_s[1])
    assert np.allclose(turned_rad[steps], expected[steps], atol=0.01)


def test_the_rest_before_the_walk_is_the_gyroscopes_bias(whole: Whole) -> None:
    track = whole[0]
    assert track.rest_rate_rad_s[1] == pytest.approx(BIAS, abs=2e-4)
    assert 6.0 < track.rest_s[1] < 9.5
    assert not track.rest_s[2:].any()
    heard = np.isfinite(track.altitude_m)
    assert heard.any()
    assert np.allclose(track.altitude_m[heard], 300.0)
    assert np.allclose(track.mag_norm_ut[1:], np.hypot(20.0, 43.0), atol=1e-3)


def fed(log: SensorLog, edges_s: FloatArray) -> Whole:
    front_end, steps, signals = FrontEnd(CONFIG), list[Step](), list[LevelledSignals]()
    for piece in pieces(log, edges_s):
        more, levelled = front_end.feed(piece)
        steps += more
        signals.append(levelled)
    more, levelled = front_end.finish()
    return StepTrack([*steps, *more]), LevelledSignals.concatenate([*signals, levelled])


@pytest.mark.parametrize("every_s", [0.0301, 0.5, 7.0, 20.0])
def test_any_chunks_give_the_same_bits(whole: Whole, every_s: float) -> None:
    track, signals = fed(walk(), np.arange(0.0, 50.0, every_s))
    assert repr(track.steps) == repr(whole[0].steps)
    assert same_signals(signals, whole[1])


def test_a_long_log_is_levelled_in_pieces(whole: Whole, monkeypatch: pytest.MonkeyPatch) -> None:
    """A day's samples take half a kilobyte each at their worst, the result included, where one piece takes 1.2."""
    monkeypatch.setattr(module, "_PIECE_SAMPLES", 1000)
    assert repr(detect_steps(walk(), CONFIG)[0].steps) == repr(whole[0].steps)
    monkeypatch.setattr(module, "_PIECE_SAMPLES", 10_000)
    log = SensorLog.concatenate([shifted(walk(), 45.01 * lap) for lap in range(20)])
    tracemalloc.start()
    _, signals = detect_steps(log, CONFIG)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(signals) > 89_000
    assert most < 500 * len(signals)


def test_a_later_start_changes_only_times(whole: Whole) -> None:
    later, track = detect_steps(walk(late_s=40.0), CONFIG)[0], whole[0]
    assert np.allclose(later.t_s - 40.0, track.t_s, atol=0.011)
    assert np.allclose(later.length_m, track.length_m, atol=0.01)
    assert np.allclose(np.diff(later.yaw_gyro_rad), np.diff(track.yaw_gyro_rad), atol=0.02)


@pytest.mark.parametrize("rate_hz", [40.0, 250.0])
def test_another_rate_gives_the_same_walk(whole: Whole, rate_hz: float) -> None:
    track = detect_steps(walk(rate_hz), CONFIG)[0]
    assert np.allclose(track.t_s[1:], whole[0].t_s[1:], atol=0.03)
    assert np.allclose(
        track.yaw_gyro_rad - track.yaw_gyro_rad[1], whole[0].yaw_gyro_rad - whole[0].yaw_gyro_rad[1], atol=0.02
    )


def test_a_gap_breaks_the_chain_at_the_first_step_after_it(whole: Whole) -> None:
    log = walk()
    cut = replace(log, acc=without(log.acc, 24.9, 27.6), gyro=without(log.gyro, 24.9, 27.6))
    track, signals = detect_steps(cut, CONFIG)
    assert not ((signals.t_s > 24.91) & (signals.t_s < 27.6)).any()
    broken = np.flatnonzero(track.chained == 0)
    assert broken.tolist() == [int(np.searchsorted(track.t_s, 26.0))]
    assert 26 <= track.t_s[broken[0]] <= 28.6
    assert len(track) == 61 - 6


def test_the_last_step_is_found_though_no_sample_follows_for_long() -> None:
    """Without a magnetometer half a second is held back until the log is known to end."""
    log = replace(walk(), mag=Stream(np.empty(0), np.empty((0, 3)))).between(-1.0, 39.15)
    track, signals = detect_steps(log, CONFIG)
    assert track.t_s[-1] == pytest.approx(39.0, abs=0.015)
    assert signals.t_s[-1] == pytest.approx(39.14)
    front_end = FrontEnd(CONFIG)
    assert front_end.feed(log)[0][-1].t_s == pytest.approx(38.5, abs=0.015)
    assert [step.t_s for step in front_end.finish()[0]] == [track.t_s[-1]]


def test_where_nobody_walks_there_is_no_step_and_that_is_said() -> None:
    with pytest.raises(DataError, match=r"made: no step found in 12\.0 s"):
        detect_steps(resting(12.0), Config())
