"""What the wearer did, second by second: stood, stepped, walked without steps that could be told apart, or neither."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from fbgraph.core.geometry import IntArray
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import Step

_UNRESOLVED = 0.5  # of a step's length; whose doubt is larger counts as not resolved


class Activity(IntEnum):
    """Of one second."""

    SILENT = 0
    """The log has a gap there."""
    STILL = 1
    STEPPING = 2
    UNRESOLVED = 3
    """Walking, by its rhythm, whose steps were not told apart."""
    HANDLED = 4
    """Moved, shaken, carried or driven, but not walked: a share of the log without an explanation."""


def activity(signals: LevelledSignals, steps: Sequence[Step], rate_hz: float) -> IntArray:
    """(N,) ``Activity`` of every whole second since log start that the signals reach; causal, apart from late steps.

    Args:
        signals: of a walk, or of its latest part; seconds before it are silent.
        steps: those found in it, the standing start included or not.
        rate_hz: of the signals' grid.
    """
    if len(signals) == 0:
        return np.empty(0, dtype=np.int64)
    seconds = np.asarray(signals.index // round(rate_hz), dtype=np.int64)
    count = int(seconds[-1]) + 1
    known = np.bincount(seconds, minlength=count)
    still = np.bincount(seconds, weights=signals.still, minlength=count)
    out = np.where(known > 0, np.where(2 * still > known, Activity.STILL, Activity.HANDLED), Activity.SILENT)
    for step in steps:
        if step.length_m > 0:
            first, last = int(step.start_s), min(int(step.t_s), count - 1)
            told = step.doubt_m <= _UNRESOLVED * step.length_m
            out[first : last + 1] = Activity.STEPPING if told else Activity.UNRESOLVED
    return np.asarray(out, dtype=np.int64)
