"""Places brought to the clock of a log: only where both are on one clock beyond doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.sensor_log import SensorLog

_SLACK_S = 5.0  # as much as anchors may lie outside of a log
_SAME_START_S = 1.0
_RATE_OFF = 0.01
EPOCH_S = (9e8, 4.1e9)
"""What Unix seconds of 1998 to 2099 lie between; no device runs for so long."""


@dataclass(frozen=True)
class LogClock:
    """What places need to know of a log.

    Attributes:
        start_s, end_s: of its samples, on its event clock; ``end_s`` infinite if it goes on.
        rate_hz: of its rows, if it has no clock and they were counted; nan otherwise.
    """

    start_s: float
    end_s: float
    rate_hz: float = np.nan

    @staticmethod
    def of(log: SensorLog) -> LogClock:
        """That of a log; one whose samples are all equally far apart, to a millionth, was counted."""
        start_s, end_s = log.span_s
        steps_s = np.diff(log.acc.t_s)
        step_s = float(np.median(steps_s)) if len(steps_s) else np.nan
        counted = bool(np.isfinite(step_s)) and bool(np.abs(steps_s / step_s - np.round(steps_s / step_s)).max() < 1e-4)
        return LogClock(log.t0_s + start_s, log.t0_s + end_s, 1.0 / step_s if counted else np.nan)

    @property
    def tells_date(self) -> bool:
        """Whether it may be Unix time."""
        return EPOCH_S[0] <= self.start_s <= EPOCH_S[1]

    def holds(self, t_s: FloatArray) -> IntArray:
        """(M,) indices of the times that lie within the log, give or take a few seconds."""
        return np.flatnonzero((t_s >= self.start_s - _SLACK_S) & (t_s <= self.end_s + _SLACK_S))


def on_logs_clock(places: Checkpoints, log: LogClock) -> Checkpoints:
    """The same places, their times on the log's clock; what lies outside of the log is left out and said.

    Args:
        places: as a file told them. On the log's own clock already (``clock`` "log") they stay as they are, unless a
            receiver found them: then those outside of the log go.
        log: whose clock.

    Raises:
        DataError: they are not on one clock with the log, as far as can be told; the message names both ranges.
    """
    if len(places) == 0 or (places.clock == "log" and not places.gnss):
        return places
    t_s, notices = _converted(places, log)
    inside = log.holds(t_s)
    if len(inside) == 0:
        raise DataError(_apart(places, log))
    if outside := len(t_s) - len(inside):
        notices.append(f"{places.source}: {outside} of {len(t_s)} places lie outside of the log's time; left out")
    settled = replace(places, t_s=t_s, clock="log", elapsed_s=None, notices=(*places.notices, *notices))
    return settled if outside == 0 else settled.select(inside)


def _converted(places: Checkpoints, log: LogClock) -> tuple[FloatArray, list[str]]:
    """(M,) times on the log's clock, as far as they can be, and what was assumed for it."""
    if places.clock == "samples":
        return _counted(places, log)
    elapsed_s = places.t_s if places.clock == "elapsed" else places.elapsed_s
    if places.clock != "elapsed" and len(log.holds(places.t_s)):
        return places.t_s, []
    if elapsed_s is None or log.tells_date:
        return (places.t_s if places.clock != "elapsed" else np.full(len(places), np.nan)), []
    if abs(log.start_s) < _SAME_START_S:
        return elapsed_s, []
    said = (
        f"{places.source}: its seconds since the start of the recording are counted from the log's first sample, at "
        f"{log.start_s:.1f} s on the log's clock"
    )
    return elapsed_s + log.start_s, [said]


def _counted(places: Checkpoints, log: LogClock) -> tuple[FloatArray, list[str]]:
    """Rows of a log that has no clock as times on the one that was made for it."""
    if not np.isfinite(log.rate_hz):
        raise DataError(
            f"{places.source}: its places are told by row of the log, but the log has a clock of its own; write their "
            "times on that clock, as t_s"
        )
    notices = []
    if np.isfinite(places.rate_hz) and abs(places.rate_hz / log.rate_hz - 1.0) > _RATE_OFF:
        notices.append(
            f"{places.source}: by its times of day the log has {places.rate_hz:.1f} rows a second, "
            f"but was read with {log.rate_hz:.1f}"
        )
    return places.t_s / log.rate_hz, notices


def _apart(places: Checkpoints, log: LogClock) -> str:
    """Why places and log are on no common clock."""
    kind = " since the start of a recording" if places.clock == "elapsed" else ""
    told = f"{_shown(float(places.t_s[0]))} to {_shown(float(places.t_s[-1]))}{kind}"
    return (
        f"{places.source}: its times ({told}) and the log's ({_shown(log.start_s)} to {_shown(log.end_s)}) are another "
        "walk's, or not on one clock; write them as a column t_s, in seconds on the log's clock"
    )


def _shown(t_s: float) -> str:
    """A time for people: with its date if it may be Unix time."""
    if EPOCH_S[0] <= t_s <= EPOCH_S[1]:
        return f"{datetime.fromtimestamp(t_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
    return f"{t_s:.1f} s"
