"""What ``import fbgraph`` offers: a walk smoothed, saved, loaded and looked at from Python."""

from __future__ import annotations

import html
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fbgraph.core.aids import Told
from fbgraph.core.building import Building
from fbgraph.core.building_files import read_building
from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.colors import COLORS, LABELS
from fbgraph.core.config import Config, load_config
from fbgraph.core.earth_field import with_declination
from fbgraph.core.errors import ConfigError
from fbgraph.core.georeference import Georeference
from fbgraph.core.place_clocks import LogClock, on_logs_clock
from fbgraph.core.safe_text import short_name
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Integrity
from fbgraph.estimators.estimates import Update
from fbgraph.pipeline import reconstruct, with_places, write_run
from fbgraph.readers import preset_of, read_log
from fbgraph.readers.cleaning import LogFile
from fbgraph.readers.dataframe import dataframe_lines, read_dataframe
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.places import read_checkpoints
from fbgraph.run.finding import Finding
from fbgraph.run.folder import claimed_run
from fbgraph.run.inputs import RunInputs
from fbgraph.run.read_run import read_run
from fbgraph.run.summary import summarize
from fbgraph.run.walk_result import WalkResult
from fbgraph.session import WalkInProgress
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk
from fbgraph.simulator.simulate import simulate as simulate_route
from fbgraph.simulator.simulate_options import SimulateOptions

if TYPE_CHECKING:
    import pandas as pd

_MAP_PX = 320


@dataclass(frozen=True)
class Walk:
    """A reconstructed walk, as the command prints and writes it.

    Attributes:
        trajectories: by estimator (``pdr``, ``ekf``, ``smoothed``, ``online``), ``t_s`` in seconds since log start.
        summary: what ``summary.json`` holds.
        result: everything the estimators said; None for a run that was loaded.
        folder: of a run that was loaded; else None.
    """

    trajectories: Mapping[str, Trajectory]
    summary: Mapping[str, Any]
    result: WalkResult | None = field(default=None, repr=False)
    folder: Path | None = None

    @property
    def integrity(self) -> Integrity:
        """How far the smoothed walk may be believed, and why no further."""
        return Integrity.from_dict(self.summary.get("integrity"))

    @property
    def findings(self) -> list[Finding]:
        """What deserves a look, in order of time."""
        entries = self.summary.get("findings", [])
        return [Finding(one["kind"], one["start_s"], one["end_s"], one["text"]) for one in entries]

    @property
    def scores(self) -> dict[str, dict[str, Any]]:
        """Errors by estimator, metres, as in ``summary.json``; empty where no truth is known."""
        entries = self.summary["estimators"].items()
        return {name: entry["score"] for name, entry in entries if "score" in entry}

    def save(self, folder: str | Path, recording: bool = True, force: bool = False) -> Path:
        """Write the run folder, whole or not at all; returns where.

        Args:
            folder: the run folder to be; a run of the same log and configuration there is replaced.
            recording: whether to write ``recording.rrd`` too.
            force: replace the run of another log or configuration too.

        Raises:
            ConfigError: it cannot be written, or holds something else than a run.
        """
        out = Path(folder)
        if self.folder is not None and self.folder.resolve() == out.resolve():
            return out
        made_by = None if self.result is None else (self.result.inputs, self.result.config)
        with claimed_run(out, made_by, force) as claim:
            if self.result is not None:
                write_run(self.result, claim, recording)
            elif self.folder is not None:
                with claim.written() as partial:
                    shutil.copytree(self.folder, partial, dirs_exist_ok=True)
        return out

    def __repr__(self) -> str:
        s = self.summary
        scored = self.scores.get("smoothed")
        error = f", {scored['rmse_m']:.2f} m RMSE" if scored else ""
        name, seconds = s["log"]["name"], s["log"]["duration_s"]
        return f"<Walk {short_name(name)}: {seconds:.0f} s, {s['steps']} steps, {s['distance_m']:.1f} m{error}>"

    def _repr_html_(self) -> str:
        """A small table and the map, for notebooks."""
        heads = "".join(f"<th>{head}</th>" for head in ("", "distance m", "end x m", "end y m", "RMSE m"))
        rows = []
        for name, entry in self.summary["estimators"].items():
            rmse = f"{entry['score']['rmse_m']:.2f}" if "score" in entry else "–"
            cells = (f"{entry['distance_m']:.1f}", *(f"{value:.2f}" for value in entry["end_m"][:2]), rmse)
            color = f"rgb{COLORS[name]}"
            row = "".join(f"<td>{cell}</td>" for cell in cells)
            rows.append(f"<tr><th style='color:{color}'>{html.escape(LABELS[name])}</th>{row}</tr>")
        return f"<table><tr>{heads}</tr>{''.join(rows)}</table>{_map_svg(self.trajectories)}"


def smooth(
    log: str | Path | SensorLog | LogFile | pd.DataFrame,
    *,
    truth: str | Path | Checkpoints | None = None,
    anchors: str | Path | Checkpoints | None = None,
    closed_walk: bool = False,
    origin: tuple[float, float] | None = None,
    config: str | Path | Config | None = None,
    overrides: Sequence[str] = (),
    format_name: str | None = None,
    max_size: int | None = None,
    force: bool = False,
    use_gnss: str = "none",
    layout: str | Path | None = None,
    rate_hz: float | None = None,
    building: str | Path | Building | None = None,
) -> Walk:
    """Reconstruct a walk: PDR, EKF and factor-graph smoother on the same steps.

    Args:
        log: a log file, one that was read already, or a DataFrame with named columns.
        truth: known places, for scoring only; those of the log itself if None.
        anchors: known places for the smoother. Both on the log's own clock.
        closed_walk: whether the walk ends where it began.
        origin: latitude and longitude of its start, degrees.
        config: a preset, a TOML file or a configuration; the preset of the log's format if None.
        overrides: ``a.b=value`` strings, as ``--set`` takes them.
        format_name: of a log file; found by content if None.
        max_size: bytes of a log file's text that are read at most; 1 GiB if None.
        use_gnss: which of the log's own GNSS fixes are anchors: ``none`` (they score, unless truth is named),
            ``start``, ``ends`` or ``all``.
        layout: a file that says what the columns of a log file are, as ``fbgraph inspect --write-layout`` writes it;
            found by their names and by what they show if None.
        rate_hz: of the samples, for a log file that has no clock.
        building: what is known of it (``learn_building``), or its file: the walk is laid along its corridors.
        force: give the smoothed trajectory even where the walk's own check withholds it (``Walk.integrity``).

    Raises:
        ConfigError: no such preset or key.
        DataError: nothing usable in a file, no step, an anchor outside the log.
    """
    told = Told(
        truth=_places(truth),
        anchors=_places(anchors),
        closed_walk=closed_walk,
        origin=None if origin is None else Georeference(*origin),
        building=_building(building),
    )
    inputs = RunInputs.of(
        log=Path(log) if isinstance(log, str | Path) else None,
        format_name=format_name,
        truth=Path(truth) if isinstance(truth, str | Path) else None,
        anchors=Path(anchors) if isinstance(anchors, str | Path) else None,
        closed_walk=closed_walk,
        origin=told.origin,
        max_size=max_size,
        forced=force,
        use_gnss=use_gnss,
        layout=None if layout is None else Path(layout),
        rate_hz=rate_hz,
        building=Path(building) if isinstance(building, str | Path) else None,
    )
    file = _log_file(log, inputs)
    walk, told = with_places(file, told, inputs)
    effective = _configuration(config, preset_of(file), overrides)
    effective = with_declination(effective, told.place, walk.t0_s, None if inputs.log is None else Path(inputs.log))
    return _walk(reconstruct(walk, effective, told, inputs))


def load_run(folder: str | Path) -> Walk:
    """Read a run folder back.

    Raises:
        DataError: not a run folder, or a damaged one.
    """
    saved = read_run(Path(folder))
    t0_s = float(saved.summary["log"]["t0_s"])
    trajectories = {name: trajectory.since(t0_s) for name, trajectory in saved.trajectories.items()}
    return Walk(trajectories, saved.summary, folder=saved.folder)


def log_from_dataframe(frame: pd.DataFrame, name: str = "dataframe") -> SensorLog:
    """A walk from a table; see ``fbgraph.readers.dataframe.read_dataframe`` for its columns.

    Raises:
        DataError: nothing usable in it.
    """
    return read_dataframe(frame, name).log


def simulate(
    route: str = "obstacle",
    *,
    seed: int = 0,
    scale: float = 1.0,
    laps: int = 1,
    options: SimulateOptions | None = None,
) -> SimulatedWalk:
    """Walk a route that nobody walked: a log, and exactly what happened.

    Args:
        route: obstacle, square, straight, eight, out-and-back, stairs, or a CSV of waypoints.
        seed: the same gives the same walk.
        scale: stretches the plan.
        laps: how often to walk it.
        options: walker, device, sensor errors, surroundings.

    Raises:
        ConfigError: no such route, or options that cannot be.
        DataError: a file that is no route.
    """
    return simulate_route(load_route(route, scale, laps), options, seed)


class OnlineSmoother:
    """A walk smoothed while it is walked: samples in, updates out.

    Example:
        >>> online = fbgraph.OnlineSmoother("m5stickc")
        >>> for piece in pieces:                  # SensorLogs or DataFrames in order of time, of any length
        ...     for update in online.feed(piece):
        ...         print(update.t_s, update.x_m, update.y_m)
        >>> walk = online.finish()
    """

    def __init__(
        self,
        config: str | Path | Config = "m5stickc",
        *,
        overrides: Sequence[str] = (),
        anchors: str | Path | Checkpoints | None = None,
        t0_s: float = 0.0,
        closed_walk: bool = False,
        origin: tuple[float, float] | None = None,
        building: str | Path | Building | None = None,
    ) -> None:
        """A smoother for one walk.

        Args:
            config: a preset, a TOML file or a configuration; ``returning.at`` says when the way back begins.
            overrides: ``a.b=value`` strings, as ``--set`` takes them.
            anchors: known places, each used once the walk has passed its time; of DataFrames on their clock.
            t0_s: ``SensorLog.t0_s`` of the pieces, which brings their times to the anchors' clock.
            closed_walk: ``finish`` may assume that the walk ended where it began.
            origin: latitude and longitude of its start, degrees; declination is looked up there.
            building: as in ``smooth``; ``finish`` lays the walk along its corridors, updates are as without.

        Raises:
            ConfigError: no such preset or key.
            DataError: anchors that cannot be read.
        """
        where = None if origin is None else Georeference(*origin)
        known = _places(anchors)
        known = None if known is None else on_logs_clock(known, LogClock(t0_s, math.inf))
        self._told = Told(anchors=known, closed_walk=closed_walk, origin=where, building=_building(building))
        asked = _configuration(config, "m5stickc", overrides)
        self._config = with_declination(asked, self._told.place, t0_s)
        if self._told.anchors is not None:
            self._told.anchors.require_possible()
        self._walk = WalkInProgress(self._config, self._told.aids(t0_s, self._config.device.declination_deg))
        self._inputs = RunInputs.of(None, closed_walk=closed_walk, origin=where)
        self._reader: LiveReader | None = None
        self._pieces: list[SensorLog] = []

    def feed(self, samples: SensorLog | pd.DataFrame) -> list[Update]:
        """Take the next samples and return the estimate at each step that they complete.

        Args:
            samples: later than all before. Of DataFrames rows are held back until units and axes are told, 20 s of
                movement at most.

        Raises:
            ConfigError: a DataFrame after a SensorLog, or the reverse.
            DataError: columns that name no accelerometer.
            EstimationError: the solver failed.
        """
        if isinstance(samples, SensorLog):
            if self._reader is not None:
                raise ConfigError("a SensorLog after DataFrames: feed one kind only")
            return self._take(samples)
        if self._reader is None:
            if self._pieces:
                raise ConfigError("a DataFrame after SensorLogs: feed one kind only")
            self._reader = LiveReader("dataframe")
        return self._take(self._reader.push(dataframe_lines(samples)))

    @property
    def integrity(self) -> Integrity:
        """How far the walk may be believed, by what its sensors and steps showed until now."""
        return self._walk.integrity

    def finish(self) -> Walk:
        """Take what was held back, then smooth the whole walk.

        Raises:
            DataError: no samples, or no step in them.
            EstimationError: the solver failed.
        """
        if self._reader is not None:
            self._take(self._reader.finish())
        if not self._pieces:
            raise ConfigError("nothing was fed: feed samples before finish")
        log = SensorLog.concatenate(self._pieces)
        return _walk(self._walk.finish(log, self._told, self._inputs))

    def _take(self, piece: SensorLog) -> list[Update]:
        self._pieces.append(piece)
        return self._walk.feed(piece)


def _log_file(log: str | Path | SensorLog | LogFile | pd.DataFrame, inputs: RunInputs) -> LogFile:
    if isinstance(log, LogFile):
        return log
    if isinstance(log, SensorLog):
        return LogFile(log, None)
    if isinstance(log, str | Path):
        return read_log(log, inputs.format, inputs.max_size, layout=inputs.layout, rate_hz=inputs.rate_hz)
    return read_dataframe(log)


def _places(places: str | Path | Checkpoints | None) -> Checkpoints | None:
    return read_checkpoints(places) if isinstance(places, str | Path) else places


def _building(building: str | Path | Building | None) -> Building | None:
    return read_building(Path(building)) if isinstance(building, str | Path) else building


def _configuration(config: str | Path | Config | None, preset: str, overrides: Sequence[str]) -> Config:
    if isinstance(config, Config):
        if overrides:
            raise ConfigError("overrides go with a preset or a file; change a Config with model_copy")
        return config
    return load_config(config or preset, overrides)


def _walk(result: WalkResult) -> Walk:
    return Walk(result.trajectories, summarize(result), result)


def _map_svg(trajectories: Mapping[str, Trajectory]) -> str:
    """The paths on one plan, North up."""
    places = np.concatenate([trajectory.xy_m for trajectory in trajectories.values()])
    low, high = places.min(axis=0), places.max(axis=0)
    per_m = (_MAP_PX - 20) / max(float((high - low).max()), 1.0)
    paths = []
    for name, trajectory in trajectories.items():
        x, y = ((trajectory.xy_m - (low[0], high[1])) * (per_m, -per_m) + 10.0).T
        points = " ".join(f"{px:.1f},{py:.1f}" for px, py in zip(x, y, strict=True))
        paths.append(f"<polyline points='{points}' fill='none' stroke='rgb{COLORS[name]}' stroke-width='1.5'/>")
    width, height = ((high - low) * per_m + 20.0).tolist()
    return f"<svg width='{width:.0f}' height='{height:.0f}'>{''.join(paths)}</svg>"
