"""Logs with truth, found in folders and scored in each mode: what ``scripts/accuracy.py`` makes its table of."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fbgraph.core.aids import Told
from fbgraph.core.building import Building
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.config import Config, load_config
from fbgraph.core.errors import FbgraphError
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.learning import learn_building
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset_of, read_log
from fbgraph.readers.cleaning import LogFile
from fbgraph.readers.places import read_checkpoints
from fbgraph.run.coverage import coverage
from fbgraph.run.inputs import RunInputs
from fbgraph.run.metrics import Alignment, checkpoint_errors
from fbgraph.run.walk_result import WalkResult

UNAIDED, ALIGNED, CLOSED, ANCHORED, PLACE = "unaided", "aligned", "closed", "anchored", "start + place"
AXIS = "axis"
MODES = (UNAIDED, ALIGNED, CLOSED, ANCHORED, PLACE, AXIS)
"""Told nothing; the same after the best rigid fit; told that it ends where it began; given every third checkpoint, or
the first and one more, and scored on the others; laid along the axis of its building."""
_EVERY = 3
_PLACE_M = 10.0  # how far the one known place is from the start, at least
_LEAST_TO_LEARN = 5  # walks, of which a building's axis is learned
_CLOSED_M = 1.0  # who ends no further from the start has closed the walk
_DENSE_S = 1.0  # truth told so often is a track
_FIRST_S = 5.0  # over which a track in a frame of its own is fitted
_SUFFIXES = (".csv", ".txt", ".gz", ".zip", ".json", ".dat", ".log")
_NO_LOGS = re.compile(r"truth|checkpoint|^ref\.|license|readme|location|gps", re.IGNORECASE)
_SENSOR_FILES = re.compile(r"^(total)?acc", re.IGNORECASE), re.compile(r"^gyr", re.IGNORECASE)
_TRUTHS = ("truth.csv", "ref.csv")  # beside or in a log that carries none
_PLACES = re.compile(r"\d{13}(\s+[-+.\d]+){3}")  # of ref.csv: Unix milliseconds, x, y, z


@dataclass(frozen=True)
class ModeScore:
    """One walk in one mode: RMSE of each estimator on the same checkpoints, metres.

    Attributes:
        pdr_m, ekf_m, online_m, smoothed_m: nan where not scored; only the smoother is told anything.
        error_m: (M,) of the smoother.
        nees: (M,) of the smoother's ellipses; empty where its alignment leaves none.
    """

    pdr_m: float
    ekf_m: float
    online_m: float
    smoothed_m: float
    error_m: FloatArray
    nees: FloatArray


@dataclass(frozen=True)
class ScoredWalk:
    """One log, scored: ``modes`` those of ``MODES`` that it can be scored in; ``note`` what to know of its scores."""

    group: str
    name: str
    verdict: str
    modes: dict[str, ModeScore]
    note: str = ""


@dataclass(frozen=True)
class FoundLog:
    """A log that may carry truth, the group whose means it enters, and what is known of the building."""

    path: Path
    group: str
    building: Building | None = None


def find_logs(folder: Path) -> Iterator[FoundLog]:
    """All logs in a folder, recursively; grouped by the folders within it, those of several floors by themselves."""
    for path in _logs_in(folder):
        inside = path.relative_to(folder).parts
        yield FoundLog(path, inside[0] if len(inside) > 1 else folder.resolve().name)


def _logs_in(folder: Path) -> Iterator[Path]:
    names = [entry.name for entry in folder.iterdir() if entry.is_file()]
    if all(any(pattern.match(name) for name in names) for pattern in _SENSOR_FILES):
        yield folder  # a file a sensor: the folder is the log
        return
    for entry in sorted(folder.iterdir()):
        if entry.is_dir():
            yield from _logs_in(entry)
        elif entry.suffix.lower() in _SUFFIXES and not _NO_LOGS.search(entry.name):
            yield entry


def with_buildings(found: Sequence[FoundLog], building: Building | None = None) -> list[FoundLog]:
    """The logs with the building that is named; else with what all logs of a group tell of theirs, without truth."""
    if building is not None:
        return [replace(one, building=building) for one in found]
    told: dict[str, Building] = {}
    for group in dict.fromkeys(one.group for one in found):
        logs = [one.path for one in found if one.group == group]
        if len(logs) < _LEAST_TO_LEARN:
            continue
        try:
            told[group] = learn_building(logs).building
        except FbgraphError as error:
            print(f"no axis: {group}: {error}", file=sys.stderr)
    return [replace(one, building=told.get(one.group)) for one in found]


def score_log(found: FoundLog) -> ScoredWalk | None:
    """Score a log in all modes; None, said on stderr, if it has no truth or cannot be read."""
    try:
        log_file = read_log(found.path)
        truth = _truth_of(log_file, found.path)
        if truth is None or len(truth) < 2 or truth.doubt:
            print(f"left out: {found.path}: no truth", file=sys.stderr)
            return None
        return _Scorer(replace(log_file, truth=truth), found).scored()
    except FbgraphError as error:
        print(f"left out: {found.path}: {error}", file=sys.stderr)
        return None


def _truth_of(log_file: LogFile, path: Path) -> Checkpoints | None:
    """What the log carries; else of its folder, or of the file named after it."""
    if log_file.truth is not None:
        return log_file.truth
    stem = path.name.partition(".")[0]
    beside = [path / name for name in _TRUTHS] if path.is_dir() else [path.with_name(f"{stem}_truth.csv")]
    for file in beside:
        if file.is_file():
            text = file.read_text("utf-8", "replace")
            if not _PLACES.match(text):
                return read_checkpoints(file)
            t_ms, x, y, z = np.array([line.split() for line in text.split("\n") if line.strip()], dtype=float).T
            return checkpoints(t_ms / 1e3, x, y, z, source=str(file))
    return None


@dataclass
class _Scorer:
    log_file: LogFile
    found: FoundLog
    truth: Checkpoints = field(init=False)
    config: Config = field(init=False)

    def __post_init__(self) -> None:
        assert self.log_file.truth is not None
        self.truth = self.log_file.truth
        self.config = load_config(preset_of(self.log_file))
        self.t0_s = self.log_file.log.t0_s
        self.own_frame = (
            not self.truth.gnss
            and self.truth.georeference is None
            and float(np.median(np.diff(self.truth.t_s))) <= _DENSE_S
        )

    def scored(self) -> ScoredWalk:
        """In every mode that this truth allows."""
        count = np.arange(len(self.truth))
        away_m = np.hypot(*(self.truth.xy_m - self.truth.xy_m[0]).T)
        result = self._run(Told(self.truth))
        online = OnlineSmoother(self.config)
        online.feed(self.log_file.log)
        online.finish()
        modes = {
            UNAIDED: self._free(result, online.causal),
            ALIGNED: self._free(result, online.causal, "rigid"),
        }
        if away_m[-1] <= _CLOSED_M and away_m.max() > _CLOSED_M:
            modes[CLOSED] = self._free(self._run(Told(self.truth, closed_walk=True)))
        if len(self.truth) > _EVERY and not self.own_frame:
            modes[ANCHORED] = self._given(count % _EVERY == 0)
        if (far := np.flatnonzero(away_m >= _PLACE_M)).size and len(self.truth) > 2:
            modes[PLACE] = self._given((count == 0) | (count == far[0]))
        if self.found.building is not None and not self.own_frame:
            modes[AXIS] = self._free(self._run(Told(self.truth, building=self.found.building)))
        floors = np.unique(self.truth.floor[np.isfinite(self.truth.floor)])
        note = f"fitted over its first {_FIRST_S:g} s" if self.own_frame else ""
        name = self.found.path.name.removesuffix(".gz").removesuffix(".txt").removesuffix(".csv")
        group = self.found.group + (", over floors" if len(floors) > 1 else _worn(self.found.path))
        return ScoredWalk(group, name, result.integrity.verdict, modes, note)

    def _run(self, told: Told) -> WalkResult:
        return reconstruct(self.log_file.log, self.config, told, RunInputs(forced=True))

    def _free(self, result: WalkResult, online: Trajectory | None = None, alignment: Alignment = "start") -> ModeScore:
        """Of estimates that were given no place."""
        smoothed = result.trajectories[result.best]
        estimates = [result.trajectories["pdr"], result.trajectories["ekf"], online, smoothed]
        errors = [None if one is None else self._errors(one, alignment) for one in estimates]
        nees = np.empty(0)
        if alignment == "start" and not self.own_frame:
            held = coverage(smoothed, self.truth, self.t0_s, "start")
            nees = nees if held is None else held.nees
        return _mode_score(errors, nees)

    def _given(self, given: BoolArray) -> ModeScore:
        """Of a smoother that was given these places: all are scored on the others, PDR and EKF moved to the first."""
        result = self._run(Told(self.truth, self.truth.select(given)))
        smoothed, others = result.trajectories[result.best], self.truth.select(~given)
        errors = [self._errors(result.trajectories[name], "start") for name in ("pdr", "ekf")]
        free = [error[~given[len(given) - len(error) :]] if not self.own_frame else error for error in errors]
        alignment: Alignment = "start" if "smoothed" in result.failed else "none"
        own = checkpoint_errors(smoothed, others, self.t0_s, alignment)
        held = coverage(smoothed, others, self.t0_s, alignment)
        return _mode_score([*free, None, own], np.empty(0) if held is None else held.nees)

    def _errors(self, trajectory: Trajectory, alignment: Alignment) -> FloatArray:
        """At the checkpoints that count; a track in a frame of its own is fitted over its first seconds."""
        if alignment != "start" or not self.own_frame:
            return checkpoint_errors(trajectory, self.truth, self.t0_s, alignment)
        return errors_after_first(trajectory.at(self.truth.t_s - self.t0_s)[:, :2], self.truth)


def errors_after_first(places_m: FloatArray, truth: Checkpoints) -> FloatArray:
    """Errors of (M, 2) places, moved and turned to fit the first 5 s of a track, at what comes after those."""
    first = truth.t_s <= truth.t_s[0] + _FIRST_S
    a, b = places_m @ (1.0, 1j), truth.xy_m @ (1.0, 1j)
    a, b = a - a[first].mean(), b - b[first].mean()
    turned = np.exp(1j * np.angle(np.vdot(a[first], b[first])))
    return np.asarray(np.abs(a * turned - b)[~first])


def _mode_score(errors: list[FloatArray | None], nees: FloatArray) -> ModeScore:
    pdr, ekf, online, smoothed = (
        float("nan") if error is None else float(np.sqrt((error**2).mean())) for error in errors
    )
    last = errors[-1]
    assert last is not None
    return ModeScore(pdr, ekf, online, smoothed, error_m=last, nees=nees)


def _worn(path: Path) -> str:
    """RIDI names its sequences by where the phone was."""
    if re.search(r"_(bag|leg)\d", path.name):
        return ", bag and leg"
    return ", hand and chest" if re.search(r"_(handheld|body)\d", path.name) else ""
