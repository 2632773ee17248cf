"""The front end on real walks: the same steps however they are fed, and none where nobody walks."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.config import Config
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.front_end.detect_steps import FrontEnd, detect_steps
from fbgraph.front_end.step_track import Step, StepTrack
from fbgraph.readers import read_log
from fbgraph.readers.cleaning import LogFile

LOGS = ("ipin2023/TrainingTrial04_repetition01.txt.gz", "indoor-location/site1/F4/5ddb6560c5b77e0006b1791e.txt.gz")


def feed(log: SensorLog, edges_s: np.ndarray) -> StepTrack:
    front_end = FrontEnd(Config())
    steps: list[Step] = []
    bounds = np.concatenate(([-1.0], edges_s, [1e9]))
    for start_s, end_s in itertools.pairwise(bounds):
        steps += front_end.feed(log.between(start_s, end_s))[0]
    return StepTrack(steps + front_end.finish()[0])


def same(a: StepTrack, b: StepTrack) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in Step.__slots__)


@pytest.mark.parametrize("name", [*LOGS, "ipin2023/TrainingTrial24_repetition04.txt.gz"])
def test_any_chunks_give_identical_steps(shared_data: Path, name: str) -> None:
    log = read_log(shared_data / name).log.between(-np.inf, 120.0)
    whole, _ = detect_steps(log, Config())
    rng = np.random.default_rng(1)
    assert same(feed(log, np.arange(0.0, log.duration_s, 1.0)), whole)
    assert same(feed(log, np.cumsum(rng.exponential(0.3, int(log.duration_s * 4)))), whole)
    assert same(feed(log, np.arange(0.0, log.duration_s, 0.0301)), whole)


def test_a_time_shift_changes_nothing_but_time(shared_data: Path) -> None:
    log = read_log(shared_data / LOGS[0]).log

    def later(stream: Stream) -> Stream:
        return Stream(stream.t_s + 40.0, stream.values)

    shifted = replace(log, acc=later(log.acc), gyro=later(log.gyro), mag=later(log.mag), pressure=later(log.pressure))
    a, b = detect_steps(log, Config())[0], detect_steps(shifted, Config())[0]
    assert np.allclose(a.t_s + 40.0, b.t_s, atol=0.02)
    assert np.allclose(a.length_m, b.length_m, atol=1e-3)
    assert np.allclose(np.diff(a.yaw_gyro_rad), np.diff(b.yaw_gyro_rad), atol=1e-3)


@pytest.fixture(scope="module")
def museum(shared_data: Path) -> dict[str, tuple[LogFile, StepTrack]]:
    """Logs by name, and their steps."""
    files = {path.name: read_log(path) for path in sorted((shared_data / "ipin2023").glob("*.gz"))}
    return {name: (file, detect_steps(file.log, Config())[0]) for name, file in files.items()}


def test_shaking_and_turning_on_the_spot_are_not_walking(museum: dict[str, tuple[LogFile, StepTrack]]) -> None:
    """The IPIN logs begin with 20 to 40 s of it; the walk begins at the first checkpoint, about 61 s in."""
    false_steps = 0
    for name, (file, track) in museum.items():
        assert file.truth is not None
        early = int((track.t_s < file.truth.t_s[0] - file.log.t0_s - 2.0).sum())
        assert early <= 10, name
        false_steps += early
    assert false_steps <= 40


def test_rests_measure_the_same_bias_twice(museum: dict[str, tuple[LogFile, StepTrack]]) -> None:
    """Before the walk and at the far end the gyroscope's bias is much the same."""
    for name, (_, track) in museum.items():
        rests = track.rest_s > 4.0
        rates, sigmas = track.rest_rate_rad_s[rests], track.rest_sigma_rad_s[rests]
        assert len(rates) >= 1, name
        assert np.ptp(rates) < np.radians(0.3) + 4 * sigmas.max(), name


def test_a_gap_breaks_the_chain_but_not_the_walk(shared_data: Path) -> None:
    log = read_log(shared_data / LOGS[1]).log
    whole, _ = detect_steps(log, Config())

    def cut(stream: Stream) -> Stream:
        keep = (stream.t_s < 15.0) | (stream.t_s > 18.0)
        return Stream(stream.t_s[keep], stream.values[keep])

    track, signals = detect_steps(replace(log, acc=cut(log.acc), gyro=cut(log.gyro), mag=cut(log.mag)), Config())
    assert not ((signals.t_s > 15.1) & (signals.t_s < 18.0)).any()
    assert (track.chained == 0).sum() == 1
    assert 2 <= len(whole) - len(track) <= 12  # three seconds of walking, and a run's first steps
