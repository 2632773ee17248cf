"""The checks of sensors and steps while a walk goes on: one a step in turn, of its last minute."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from fbgraph.core.config import Config
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.verdict import Integrity
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import Step, StepTrack
from fbgraph.integrity.assess import SENSED_CHECKS, verdict_of
from fbgraph.integrity.evidence import Doubt, SensedCheck
from fbgraph.integrity.sensor_checks import frozen_sensors, silent_sensors

_WINDOW_S = 60.0
_JOINED = 10
_FEW_STEPS = 20  # before that nothing is said
_IDLE_S = 10.0  # who takes no step for so long is looked at all the same: a sensor may have fallen silent
_HEAVIER = 1.5  # news of the same kind are told when they weigh so much more

IDLE_CHECKS: tuple[SensedCheck, ...] = (frozen_sensors, silent_sensors)
"""Those that need no step."""


Piece = TypeVar("Piece")


@dataclass(frozen=True)
class _Recent:
    """A part of a walk, as checks want it."""

    log: SensorLog
    config: Config
    signals: LevelledSignals
    track: StepTrack


class LiveCheck:
    """Fed what an online smoother is fed, and every step it makes of it; the same answers in any pieces.

    Each step asks one check, so that no step takes long; a round of all takes some ten seconds. What was found stays:
    a walk that was led astray once does not come right by itself.
    """

    def __init__(self, config: Config, checks: Sequence[SensedCheck] = SENSED_CHECKS) -> None:
        """A check of one walk.

        Args:
            config: the effective configuration.
            checks: what to ask, in this order.
        """
        self._config = config
        self._checks = checks
        self._pieces = _Pieces(SensorLog.concatenate)
        self._signals = _Pieces(LevelledSignals.concatenate)
        self._levelled = -1
        self._steps: deque[Step] = deque()
        self._count = 0
        self._window: _Recent | None = None
        self._found: dict[str, Doubt] = {}
        self._asked_s = 0.0
        self._cautions: list[tuple[int, str]] = []  # since which breadcrumb

    def feed(self, piece: SensorLog) -> None:
        """Take the next samples, before their signals and steps."""
        if not (len(piece.acc) or len(piece.gyro)):
            return
        end_s = max(float(stream.t_s[-1]) for stream in (piece.acc, piece.gyro) if len(stream))
        self._pieces.append(piece, end_s)
        if self._steps and end_s - self._asked_s >= 2.0 * _IDLE_S:
            self._asked_s = _IDLE_S * np.floor(end_s / _IDLE_S)
            self._ask(IDLE_CHECKS, self._cut(self._asked_s))

    def level(self, signals: LevelledSignals) -> None:
        """Take the next signals; those that were taken already are known by themselves."""
        if len(signals) and signals.index[-1] > self._levelled:
            self._levelled = int(signals.index[-1])
            self._signals.append(signals, float(signals.t_s[-1]))

    def advance(self, step: Step) -> str | None:
        """Take the next step; returns why the position is doubtful, None while nothing is known against it."""
        self._steps.append(step)
        self._asked_s = step.t_s
        turn = self._count % len(self._checks)
        if turn == 0:
            self._window = self._cut(step.t_s)
        self._count += 1
        if len(self._steps) >= _FEW_STEPS:
            self._ask(self._checks[turn : turn + 1], self._window)
        return self.caution(self._count - 1)

    def caution(self, breadcrumb: int) -> str | None:
        """What ``advance`` returned at a breadcrumb."""
        return next((text for since, text in reversed(self._cautions) if since <= breadcrumb), None)

    @property
    def integrity(self) -> Integrity:
        """The verdict until now."""
        doubts = sorted(self._found.values(), key=lambda doubt: -doubt.reason.weight)
        return Integrity(verdict_of(doubts), tuple(doubt.reason for doubt in doubts))

    def _ask(self, checks: Sequence[SensedCheck], window: _Recent | None) -> None:
        """Keep what they find, of each kind the heaviest; what was found first is told until one weighs more."""
        if window is None:
            return
        for doubt in (doubt for check in checks for doubt in check(window)):
            known = self._found.get(doubt.reason.kind)
            if known is None or doubt.reason.weight > _HEAVIER * known.reason.weight:
                self._found[doubt.reason.kind] = doubt
                text = self.integrity.reasons[0].sentence
                if not self._cautions or self._cautions[-1][1] != text:
                    self._cautions.append((max(self._count - 1, 0), text))

    def _cut(self, until_s: float) -> _Recent | None:
        """The minute before a time; what lies before it is forgotten."""
        since_s = until_s - _WINDOW_S
        while len(self._steps) > _FEW_STEPS and self._steps[0].t_s < since_s:
            self._steps.popleft()
        pieces, levelled = self._pieces.since(since_s), self._signals.since(since_s)
        if pieces is None or levelled is None:
            return None
        log = pieces.between(since_s, until_s)
        if not len(log.acc) or not len(log.gyro):
            return None
        return _Recent(log, self._config, levelled.between(since_s, until_s), StepTrack(list(self._steps)))


class _Pieces(Generic[Piece]):
    """The latest pieces of something, joined by tens as they come, so that few are left to join when asked for."""

    def __init__(self, join: Callable[[list[Piece]], Piece]) -> None:
        self._join = join
        self._whole: deque[tuple[float, Piece]] = deque()
        self._new: list[Piece] = []

    def append(self, piece: Piece, end_s: float) -> None:
        """Take the next one, which ends then."""
        self._new.append(piece)
        if len(self._new) == _JOINED:
            self._whole.append((end_s, self._join(self._new)))
            self._new = []

    def since(self, start_s: float) -> Piece | None:
        """All that ends later as one; what ends before is forgotten. None if there is nothing."""
        while self._whole and self._whole[0][0] < start_s:
            self._whole.popleft()
        pieces = [*(piece for _, piece in self._whole), *self._new]
        return self._join(pieces) if pieces else None
