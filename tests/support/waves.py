"""Sensor streams of a made-up walk, in SI, distinct on every axis."""

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog


def waves(count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Accelerometer, gyroscope and magnetometer, (count, 3) each."""
    i = np.arange(count)
    acc = np.column_stack((0.5 * np.sin(i / 5), 0.8 * np.cos(i / 7), 9.8 + 2.5 * np.sin(i / 4)))
    gyro = np.column_stack((0.9 * np.sin(i / 6), 1.1 * np.cos(i / 9), 1.3 * np.sin(i / 11)))
    mag = np.column_stack((20 + np.sin(i / 30), -5 + np.cos(i / 30), -38 + np.sin(i / 20)))
    return acc, gyro, mag


def check_sound(log: SensorLog) -> None:
    """What every estimator relies on: finite numbers, time that increases, a clock that starts at the first sample."""
    for stream in (log.acc, log.gyro, log.mag, log.pressure):
        assert np.isfinite(stream.t_s).all()
        assert np.isfinite(stream.values).all()
        assert (np.diff(stream.t_s) > 0).all()
    assert min(log.acc.t_s[0], log.gyro.t_s[0]) == 0.0
