"""Steps: found in levelled signals, measured one by one, the same offline and online.

``FrontEnd`` chains the leveller, the paper's step detector and the measurement of each step. It is causal and
chunk-invariant: cut the log anywhere, the steps stay the same.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from fbgraph.core.config import Config
from fbgraph.core.errors import DataError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.front_end.carrying import carried
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.leveller import Leveller
from fbgraph.front_end.step_detector import StepDetector
from fbgraph.front_end.step_measurement import StepGauge
from fbgraph.front_end.step_track import MIN_RATE_HZ, Step, StepTrack

_SHAKEN_M_S2 = 0.5  # who walks moves a device by about so much
_PIECE_SAMPLES = 100_000  # levelling takes a kilobyte a sample meanwhile


class FrontEnd:
    """Samples in, steps out."""

    def __init__(self, config: Config) -> None:
        self._leveller = Leveller(config.device, config.attitude)
        self._detector = StepDetector(config.steps, config.attitude.rate_hz)
        self._gauge = StepGauge(config.step_length, config.attitude.rate_hz, config.attitude.level_tau_s)

    def feed(self, piece: SensorLog) -> tuple[list[Step], LevelledSignals]:
        """Take the next samples; return the steps they complete and the signals they level."""
        return self._advance(self._leveller.feed(piece))

    def finish(self) -> tuple[list[Step], LevelledSignals]:
        """What was held back for samples that will not come."""
        steps, signals = self._advance(self._leveller.finish())
        return steps + [s for run in self._detector.finish() for s in self._gauge.measure(run)], signals

    def _advance(self, signals: LevelledSignals) -> tuple[list[Step], LevelledSignals]:
        self._gauge.push(signals)
        return [s for run in self._detector.push(signals) for s in self._gauge.measure(run)], signals


def detect_steps(log: SensorLog, config: Config) -> tuple[StepTrack, LevelledSignals]:
    """Steps and levelled signals of a whole log.

    Raises:
        DataError: no steps in it.
    """
    steps, signals = found_steps(log, config)
    if not steps:
        raise DataError(f"{log.name}: no step found in {log.duration_s:.1f} s; {_why_none(log, signals)}")
    return StepTrack(carried(steps, config.carrying)), signals


def found_steps(log: SensorLog, config: Config) -> tuple[list[Step], LevelledSignals]:
    """Steps, of which there may be none, and levelled signals of a whole log."""
    front_end = FrontEnd(config)
    steps: list[Step] = []
    levelled: list[LevelledSignals] = []
    for found, signals in (*map(front_end.feed, _pieces(log)), front_end.finish()):
        steps += found
        levelled.append(signals)
    return steps, LevelledSignals.concatenate(levelled)


def _pieces(log: SensorLog) -> Iterator[SensorLog]:
    """A log in pieces, for a day of walking is levelled in the memory of some minutes of it."""
    edges = np.concatenate(([-np.inf], log.acc.t_s[_PIECE_SAMPLES::_PIECE_SAMPLES], [np.inf])).tolist()
    return (log.between(*ends) for ends in itertools.pairwise(edges))


def _why_none(log: SensorLog, signals: LevelledSignals) -> str:
    """What is most likely wrong with a log without steps, and what to do."""
    left_out = log.counts.get("rows_impossible", 0)
    if left_out > 0.05 * len(log.acc):
        return (
            f"{left_out} rows were left out, no sensor gives such values: check the columns of accelerometer and "
            "gyroscope and their units"
        )
    if log.acc.rate_hz < MIN_RATE_HZ:
        return (
            f"the accelerometer runs at {log.acc.rate_hz:.3g} Hz, too slow to show steps: check the unit of the time "
            "column, or record faster"
        )
    shaken_m_s2 = float(signals.acc_norm_m_s2.std()) if len(signals) else 0.0
    if len(signals) and signals.still.mean() < 0.5 and shaken_m_s2 > _SHAKEN_M_S2:
        return (
            f"the accelerometer's magnitude varies by {shaken_m_s2:.1f} m/s² without the rhythm of a walk: check "
            "whether it is noisy, or the device was shaken rather than worn"
        )
    return "nobody walks in this log, or steps.min_rise_m_s2 or steps.lambda_sigma is too high for this device"
