"""Times of logs: whole nanoseconds, whatever clock and tick they were written in."""

from __future__ import annotations

import numpy as np

from fbgraph.core.geometry import FloatArray, IntArray

MAX_T_NS = 4 * 10**18
"""The year 2096 in Unix time; differences of two such times still fit in an int64."""


def to_ns(t: FloatArray | IntArray, tick_ns: int) -> IntArray:
    """Times in ticks of ``tick_ns`` as int64 nanoseconds (N,), exact for integers.

    Floats that cannot hold a nanosecond (Unix seconds) are rounded to the microsecond, which gives back the decimals
    that were written. Times that no clock can show become ``MAX_T_NS + 1``, which cleaning drops.
    """
    most = MAX_T_NS // tick_ns
    if t.dtype.kind == "i" and (len(t) == 0 or (t.min() >= -most and t.max() <= most)):
        return np.asarray(t * tick_ns, dtype=np.int64)
    possible = (t >= -most) & (t <= most)  # False for nan
    t = np.where(possible, t, 0)
    if t.dtype.kind == "i":
        t_ns = t * tick_ns
    else:
        coarse = np.abs(t) * tick_ns > 2.0**52
        t_ns = np.round(t * tick_ns).astype(np.int64)
        t_ns = np.where(coarse, np.round(t * (tick_ns / 1000)).astype(np.int64) * 1000, t_ns)
    return np.where(possible, t_ns, MAX_T_NS + 1).astype(np.int64)
