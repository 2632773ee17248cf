"""Which samples have numbers like the others': what is judged of a sensor, one garbled line must not decide."""

from __future__ import annotations

import numpy as np

from fbgraph.core.geometry import BoolArray, FloatArray

_LARGEST = {"acc": 50.0, "linear_acc": 1e3, "gravity": 50.0, "gyro": 1e4, "mag": 50.0}  # times the usual
_SPIKE = 4.0  # times what nine of ten samples do not pass: nobody's foot strikes as hard, in any unit
_MEASURED = 1e12  # no sensor says more, in any unit


def likely(name: str, values: FloatArray, good: BoolArray) -> BoolArray:
    """Which rows have numbers like the others': one that a garbled line made huge would outweigh a walk's.

    Args:
        name: of the sensor.
        values: (N, D).
        good: (N,) which of them are there.
    """
    size = np.abs(values if good.all() else np.where(good[:, None], values, 0.0)).max(axis=1)
    measured: BoolArray = size <= _MEASURED
    good = good & measured
    usual = float(np.median(size[good])) if good.any() else 0.0
    most = _LARGEST.get(name, np.inf) * usual
    if name == "acc" and good.any():  # spikes of a tenth of the samples at most
        most = min(most, _SPIKE * float(np.percentile(size[good], 90)))
    likely: BoolArray = size <= min(most, _MEASURED)
    return likely if usual > 0.0 else measured
