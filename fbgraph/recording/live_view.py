"""A walk in a Rerun viewer while it is walked: the recording's own code, entities and layout, piece by piece."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from fbgraph.core.config import Config
from fbgraph.core.sensor_log import SensorLog
from fbgraph.estimators.baselines import baselines
from fbgraph.estimators.estimates import Belief
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.recording.blueprint import blueprint
from fbgraph.recording.recorder import Recorder
from fbgraph.recording.writer import RrdWriter
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.records import ReturnUpdate

_CONFIRMED_S = 3.0  # steps are found this late at most
_EVERY_S = 0.2  # of wall time: a viewer is sent what came since, however fast it comes


class LiveView:
    """Shows what is fed to an online smoother, and what it makes of it."""

    def __init__(self, config: Config, url: str | None = None, rrd: RrdWriter | None = None) -> None:
        """Open a viewer, or connect to a running one.

        Args:
            config: the effective configuration of the walk.
            url: ``rerun+http://HOST:PORT/proxy``; a viewer is started if None.
            rrd: a stream that already goes somewhere, instead of a viewer.

        Raises:
            ConfigError: there is no viewer to be had.
        """
        self._config = config
        self._rrd = rrd or RrdWriter()
        if rrd is None:
            self._rrd.view(url, blueprint(()))
        self._recorder = Recorder(self._rrd, config)
        self._pieces: list[SensorLog] = []
        self._signals: list[LevelledSignals] = []
        self._beliefs: list[Belief] = []
        self._returning: list[ReturnUpdate] = []
        self._held: list[LevelledSignals] = []  # until the steps in them are known
        self._steps = 0
        self._arranged: set[str] = set()
        self._due_s = 0.0

    def fed(
        self,
        piece: SensorLog,
        smoother: OnlineSmoother,
        beliefs: Sequence[Belief],
        returning: Sequence[ReturnUpdate] = (),
    ) -> None:
        """Note a piece of log that the smoother was just fed, what it came to believe, and what the wearer was told."""
        self._pieces.append(piece)
        if smoother.signals is not None:
            self._signals.append(smoother.signals)
        self._beliefs += beliefs
        self._returning += returning
        if time.monotonic() >= self._due_s:
            self._flush(smoother)
            self._due_s = time.monotonic() + _EVERY_S

    def finished(self, result: WalkResult, smoother: OnlineSmoother, summary_markdown: str) -> None:
        """Show the finished walk."""
        self._flush(smoother)
        if self._held:
            self._recorder.wearer(LevelledSignals.concatenate(self._held), result.track)
        self._recorder.clock(result.smoothed.trajectory)
        for name, trajectory in result.trajectories.items():
            if name == "smoothed":
                self._recorder.states(name, trajectory)
            elif self._steps < len(trajectory):
                self._recorder.states(name, trajectory, self._steps)
        self._recorder.finished(result, summary_markdown)
        self._rrd.arrange(self._recorder.arranged)

    def _flush(self, smoother: OnlineSmoother) -> None:
        """Send what came since the last time; of the steps, if there are new ones."""
        signals = LevelledSignals.concatenate(self._signals) if self._signals else None
        pieces, self._pieces, self._signals = self._pieces, [], []
        if signals is not None and len(pieces):
            self._recorder.samples(SensorLog.concatenate(pieces), signals)
            self._held.append(signals)
        if len(smoother.steps) == self._steps:
            return
        track, first = smoother.track, self._steps
        online = smoother.causal
        self._recorder.clock(online)
        self._recorder.steps(track, first)
        if self._held:
            held = LevelledSignals.concatenate(self._held)
            known = int(np.searchsorted(held.t_s, track.t_s[-1] - _CONFIRMED_S))
            if known > 0:
                self._recorder.wearer(held.head(known), track)
            self._held = [held.tail(len(held) - known)] if known < len(held) else []
        trajectories = {
            **baselines(track, self._config),
            "online": online,
        }
        for name, trajectory in trajectories.items():
            self._recorder.states(name, trajectory, first)
            self._recorder.draw_path(name, trajectory, first)
        self._recorder.believed(self._beliefs)
        self._recorder.returned(self._returning, online)
        self._steps, self._beliefs, self._returning = len(track), [], []
        # views come into being with what they show: sensors first, then steps
        if tabs_of(self._rrd.entities) != self._arranged:
            self._arranged = tabs_of(self._rrd.entities)
            self._rrd.arrange(blueprint(self._rrd.entities))


def tabs_of(entities: set[str]) -> set[str]:
    """What decides which views there are: the first two parts of each path."""
    return {"/".join(entity.split("/")[:2]) for entity in entities}
