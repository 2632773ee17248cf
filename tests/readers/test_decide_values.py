"""What decides how a log is read: samples of a sensor that lives, and of no other."""

from pathlib import Path

import numpy as np
import pytest
from support.m5stickc_lines import ACC, GYRO

from fbgraph.core.errors import DataError
from fbgraph.core.sensor_log import Stream
from fbgraph.physics.judge_sensors import judge_sensors
from fbgraph.readers import read_log

HEADER = "t_ms,ax,ay,az,gx_rads,gy_rads,gz_rads"


def written(folder: Path, acc: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> Path:
    rows = (
        ",".join(f"{v:.5f}" for v in (*acc[i], *GYRO[i % len(GYRO)])) if np.isfinite(acc[i]).all() else ",,,0.1,0.2,0.1"
        for i in range(len(acc))
    )
    path = folder / "walk.csv"
    path.write_text("\n".join([HEADER, *(f"{20 * i},{row}" for i, row in enumerate(rows))]))
    return path


@pytest.fixture
def acc() -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([ACC[i % len(ACC)] for i in range(600)], dtype=float)


def test_spikes_and_a_sensor_that_hangs_decide_no_unit(
    acc: np.ndarray[tuple[int, int], np.dtype[np.float64]], tmp_path: Path
) -> None:
    spiked, hanging = acc.copy(), acc.copy()
    spiked[::100] = 147.0
    hanging[250:] = 0.0
    for values in (acc, spiked):
        reading = read_log(written(tmp_path, values)).reading
        assert reading is not None
        assert reading.layout.acc.unit == "m/s²"
    with pytest.raises(DataError, match="median magnitude"):  # units are right, the log is none of a walk
        read_log(written(tmp_path, hanging))


def test_a_sensor_without_any_value_is_said_to_be_missing(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="accelerometer"):
        read_log(written(tmp_path, np.full((600, 3), np.nan)))


def test_nothing_is_judged_of_an_accelerometer_that_never_spoke() -> None:
    still = Stream(np.arange(100) / 50.0, np.full((100, 3), 20.0))
    nothing = Stream(np.empty(0), np.empty((0, 3)))
    assert judge_sensors(nothing, still, still).mag is None
