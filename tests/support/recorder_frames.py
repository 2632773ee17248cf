"""A walk as the chips of the recorder's device measure it: what their registers show every 10 ms."""

import io
import struct

import numpy as np
from calibration import REST_S
from sensors import ACC_G, GYRO_DPS, Qmp6988

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog, Stream
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from support.recorder_device import BMM_TRIM, RECORD, Device, Frames

BEFORE_S = REST_S + 2.0
"""At rest, before the walk's log begins."""
BIAS_DPS = np.array([0.98, -1.34, 0.49])
"""That the simulated gyroscope adds."""
_HALL = 7053
_RAW_T = 8388608 + 700_000


def frames_of(log: SensorLog) -> bytes:
    """What the registers show from the moment the device is switched on."""
    t_s = np.arange(-BEFORE_S, log.span_s[1], 0.01)
    acc = _counts(log.acc, t_s, STANDARD_GRAVITY_M_S2 * ACC_G)
    gyro = _counts(log.gyro, t_s, DEGREE_RAD * GYRO_DPS)
    rest = t_s < 0
    acc[rest], gyro[rest] = acc[~rest][0], 0
    gyro = gyro + np.rint(BIAS_DPS / GYRO_DPS).astype(int)
    z2, z1 = struct.unpack_from("<hH", BMM_TRIM[2])
    scale_ut = np.array([256.0 * 186.0 / 131072.0] * 2 + [131072.0 / (z2 + z1 * _HALL / 32768.0) / 64.0])
    field = _counts(log.mag, t_s, scale_ut)
    pressure = _pressure_counts(np.interp(t_s, log.pressure.t_s, log.pressure.values[:, 0]))
    parts = []
    for i in range(len(t_s)):
        parts.append(struct.pack(">hhhhhhh", *acc[i], 326, *gyro[i]))
        x, y, z = field[i].tolist()
        parts.append(struct.pack("<hhhH", x << 3, y << 3, z << 1, _HALL << 2))
        parts.append(int(pressure[i]).to_bytes(3, "big") + _RAW_T.to_bytes(3, "big"))
    data = b"".join(parts)
    assert len(data) == RECORD * len(t_s)
    return data


def _counts(
    stream: Stream, t_s: FloatArray, unit: float | FloatArray
) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    at = np.column_stack([np.interp(t_s, stream.t_s, axis) for axis in stream.values.T])
    return np.rint(at / unit).astype(np.int64)


def _pressure_counts(pressure_hpa: FloatArray) -> FloatArray:
    """What a QMP6988 must read to say so: its own polynomial, turned round."""
    chip = Qmp6988(Device(Frames(io.BytesIO(bytes(RECORD))), "", []).hat, 0x70)
    counts = np.linspace(-4e6, 4e6, 4001)
    known = [chip.compensated_hpa(int(p), _RAW_T - 8388608) for p in counts]
    assert (np.diff(known) > 0).all()
    return np.rint(np.interp(pressure_hpa, known, counts)) + 8388608
