"""Clocks that start again in the middle of a log, and rows that arrive a little out of order."""

from __future__ import annotations

import numpy as np

from fbgraph.core.geometry import IntArray

_RESTART_NS = 1_000_000_000
_LATE_TOGETHER = 8  # rows, on average, that come late one after the other


def continue_restarts(t_ns: IntArray) -> tuple[IntArray, int]:
    """Times that go on where a device started its clock again, and how often it did.

    A restart is a jump back by more than a second after which time runs on from there; a single garbled time is not,
    and a clock that runs backwards all the time is left as it is.

    Args:
        t_ns: (N,) in file order.
    """
    steps = np.diff(t_ns)
    back = np.flatnonzero(steps < -_RESTART_NS) + 1
    if len(back) == 0 or len(back) > max(10, len(t_ns) // 100):
        return t_ns, 0
    step_ns = int(np.median(steps[steps > 0])) if (steps > 0).any() else 0
    t_ns, restarts = t_ns.copy(), 0
    for i in back.tolist():
        before, after = t_ns[max(0, i - 5) : i], t_ns[i : i + 5]  # medians of these: any one time may be garbled
        middle = int(np.median(before))
        runs_on = min(len(before), len(after)) >= 3 and np.mean(np.diff(after) >= 0) > 0.5
        if runs_on and np.median(after) < middle - _RESTART_NS:
            last = min(max(int(t_ns[i - 1]), middle), middle + _RESTART_NS)
            t_ns[i:] += last + step_ns - t_ns[i]
            restarts += 1
    return t_ns, restarts


def little_disorder(t_ns: IntArray) -> bool:
    """Whether some rows come late, as datagrams do, but none by a second: then their times sort them.

    A clock that is set back makes many rows late in a row, which belong where they are.

    Args:
        t_ns: (N,) in file order.
    """
    steps_back = int((np.diff(t_ns) < 0).sum())
    if not steps_back:
        return False
    late_ns = np.maximum.accumulate(t_ns) - t_ns
    late = int((late_ns > 0).sum())
    return bool(late_ns.max() < _RESTART_NS and late <= _LATE_TOGETHER * steps_back)
