"""A gap of any length is a stretch of unknown travel: the walk goes on, and says how little is known of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog, Stream, empty_stream
from fbgraph.core.trajectory import Trajectory
from fbgraph.pipeline import reconstruct
from fbgraph.readers import read_log
from fbgraph.run.folder import claimed_live
from fbgraph.session import follow_source, replay_log
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions

CONFIG = load_config("m5stickc")
CUT_S = 30.0  # where the gap begins
WALK = simulate(load_route("eight"), SimulateOptions(duration_s=70.0), seed=5)
LENGTHS_S = (1.0, 30.0, 90.0, 100.0, 1800.0, 18_000.0)


def paused(log: SensorLog, gap_s: float) -> SensorLog:
    """The device slept for so long, and nobody walked meanwhile."""

    def late(stream: Stream) -> Stream:
        return Stream(stream.t_s + gap_s * (stream.t_s >= CUT_S), stream.values)

    return replace(
        log, events=(), acc=late(log.acc), gyro=late(log.gyro), mag=late(log.mag), pressure=late(log.pressure)
    )


def missed(log: SensorLog, gap_s: float) -> SensorLog:
    """The device slept for so long while its wearer walked on."""
    before, after = log.between(-1.0, CUT_S), log.between(CUT_S + gap_s, np.inf)
    return replace(SensorLog.concatenate([before, after]), events=())


def without_compass(log: SensorLog) -> SensorLog:
    return replace(log, mag=empty_stream(3))


def errors_sigma(walk: SimulatedWalk, smoothed: Trajectory, gap_s: float) -> FloatArray:
    """Errors of the breadcrumbs after the gap in units of their sigma; the truth is of the waist, not of the wrist."""
    assert smoothed.cov_xy_yaw is not None
    true_s = smoothed.t_s - gap_s * (smoothed.t_s > CUT_S + gap_s / 2.0)
    off = smoothed.xy_m - np.column_stack([np.interp(true_s, walk.t_s, axis) for axis in (walk.x_m, walk.y_m)])
    off -= off[0]
    after = smoothed.t_s > CUT_S + gap_s / 2.0
    cov = smoothed.cov_xy_yaw[after, :2, :2] + 0.1**2 * np.eye(2)
    return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", off[after], np.linalg.inv(cov), off[after])))


def written(log: SensorLog, folder: Path) -> SensorLog:
    """The walk as a file holds it."""
    write_m5stickc_csv(log, folder / "sent.csv")
    return read_log(folder / "sent.csv").log


def live(folder: Path) -> Trajectory:
    """The walk as a device sends it, its lines kept to the byte."""
    sent = (folder / "sent.csv").read_bytes()
    with claimed_live(folder / "run", resume=False) as claim:
        pieces = (sent[at : at + 30_000] for at in range(0, len(sent), 30_000))
        result = follow_source(pieces, claim.place, CONFIG, recording=False)
    assert (folder / "run" / "raw.csv").read_bytes() == sent
    assert not result.failed
    return result.smoothed.trajectory


@pytest.mark.parametrize("gap_s", LENGTHS_S)
def test_a_pause_of_any_length_is_survived_and_told(gap_s: float, tmp_path: Path) -> None:
    log = written(paused(WALK.log, gap_s), tmp_path)
    batch = reconstruct(log, CONFIG)
    assert not batch.failed
    smoothed = batch.smoothed.trajectory
    for other in (replay_log(log, CONFIG).smoothed.trajectory, live(tmp_path)):
        assert len(other) == len(smoothed)
        assert np.abs(other.xy_m - smoothed.xy_m).max() < 1e-3 + 1e-5 * gap_s
    assert errors_sigma(WALK, smoothed, gap_s).max() < 4.0
    sigma_m = smoothed.longest_sigma_m
    assert sigma_m is not None
    assert sigma_m[-1] == pytest.approx(CONFIG.graph.sigma_gap_m_s * gap_s, rel=0.2) or gap_s < 10.0
    assert sigma_m[smoothed.t_s < CUT_S].max() < 3.0


@pytest.mark.parametrize("gap_s", LENGTHS_S)
def test_without_a_compass_directions_after_it_are_anybodys_guess(gap_s: float, tmp_path: Path) -> None:
    log = written(without_compass(paused(WALK.log, gap_s)), tmp_path)
    batch = reconstruct(log, CONFIG)
    assert not batch.failed
    smoothed = batch.smoothed.trajectory
    assert smoothed.cov_xy_yaw is not None
    after = smoothed.t_s > CUT_S + gap_s / 2.0
    turned = min(CONFIG.graph.sigma_gap_yaw_rad_s * gap_s, np.pi)
    assert np.sqrt(smoothed.cov_xy_yaw[after, 2, 2]).min() > 0.9 * turned
    for other in (replay_log(log, CONFIG).smoothed.trajectory, live(tmp_path)):
        assert np.abs(other.xy_m - smoothed.xy_m).max() < 1e-3 + 1e-5 * gap_s


@pytest.mark.parametrize("gap_s", [1.0, 5.0, 15.0])
def test_who_walks_on_meanwhile_is_still_within_it(gap_s: float) -> None:
    result = reconstruct(missed(WALK.log, gap_s), CONFIG)
    assert errors_sigma(WALK, result.smoothed.trajectory, 0.0).max() < 4.0


def test_the_second_part_keeps_its_own_shape() -> None:
    """Hours later the walk goes on: where is not known, how it went there is."""
    smoothed = reconstruct(paused(WALK.log, 18_000.0), CONFIG).smoothed.trajectory
    whole = reconstruct(replace(WALK.log, events=()), CONFIG).smoothed.trajectory
    count = int((smoothed.t_s > CUT_S + 9000.0).sum()) - 10
    second, known = smoothed.xy_m[-count:], whole.xy_m[-count:]
    assert np.abs((second - second[0]) - (known - known[0])).max() < 1.0


def test_many_short_gaps_without_a_compass_are_survived() -> None:
    log = without_compass(replace(WALK.log, events=()))
    pieces = [log.between(start_s, start_s + 4.2) for start_s in np.arange(0.0, 70.0, 5.0)]
    result = reconstruct(SensorLog.concatenate(pieces), CONFIG)
    assert not result.failed
    assert int((result.track.chained == 0).sum()) >= 6
