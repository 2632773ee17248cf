"""From a log to a result, and from a result to a run folder: composes the rooms, estimates nothing itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.core.aids import GnssUse, Told
from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import Config, load_config
from fbgraph.core.earth_field import with_declination
from fbgraph.core.errors import ConfigError, DataError, EstimationError
from fbgraph.core.georeference import Georeference
from fbgraph.core.gnss_fixes import gnss_anchors
from fbgraph.core.place_clocks import LogClock, on_logs_clock
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.baselines import baselines
from fbgraph.estimators.batch_smoother import smooth, tie_way_back
from fbgraph.estimators.building_axis import lay_along_axis
from fbgraph.estimators.estimates import Smoothed
from fbgraph.front_end.detect_steps import detect_steps
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import StepTrack
from fbgraph.integrity.assess import assess
from fbgraph.readers import preset_of, read_log
from fbgraph.readers.cleaning import LogFile
from fbgraph.readers.places import gnss_of, read_checkpoints
from fbgraph.run.folder import RunClaim, write_tables
from fbgraph.run.inputs import RunInputs
from fbgraph.run.summary import summarize, summary_markdown
from fbgraph.run.walk_result import WalkResult

Progress = Callable[[str], None]
"""Called with the name of each stage as it begins."""


def read_told(inputs: RunInputs) -> Told:
    """Read the files that the user named beside the log.

    Raises:
        DataError: one of them cannot be read.
    """
    return Told(
        truth=None if inputs.truth is None else read_checkpoints(inputs.truth),
        anchors=None if inputs.anchors is None else read_checkpoints(inputs.anchors),
        closed_walk=inputs.closed_walk,
        origin=None if inputs.origin is None else Georeference(*inputs.origin),
        building=inputs.building_told(),
    )


def read_walk(
    inputs: RunInputs, config: str | None = None, overrides: Sequence[str] = ()
) -> tuple[SensorLog, Config, Told]:
    """Read a log and what was said of it.

    Args:
        inputs: what was named.
        config: a preset or a TOML file; the preset of the log's format if None.
        overrides: ``a.b=value`` strings.

    Returns:
        The log, the effective configuration, and what was told; its truth is the log's own if none was named.

    Raises:
        ConfigError: a wrong option; told before a long log is read.
        DataError: a file that cannot be used.
    """
    load_config(config, overrides)
    told = read_told(inputs)
    log_file = read_log(
        Path(str(inputs.log)), inputs.format, inputs.max_size, layout=inputs.layout, rate_hz=inputs.rate_hz
    )
    effective = load_config(config or preset_of(log_file), overrides)
    log, told = with_places(log_file, told, inputs)
    effective = with_declination(effective, told.place, log.t0_s, Path(str(inputs.log)))
    return log, effective, told


def with_places(log_file: LogFile, told: Told, inputs: RunInputs) -> tuple[SensorLog, Told]:
    """A log and what was told of it, all places on the log's clock, with those that the log itself carries.

    Args:
        log_file: as read.
        told: as the user named it.
        inputs: says which of the log's fixes are anchors, and where the log is: fixes may be in a file beside it.

    Returns:
        The log, with notices of what was left out or assumed, and the truth and anchors that there are.

    Raises:
        DataError: places that are not on one clock with the log, or no fixes where they are to be used.
        ConfigError: fixes are to be used beside other anchors.
    """
    log, clock = log_file.log, LogClock.of(log_file.log)
    truth, anchors = (None if places is None else on_logs_clock(places, clock) for places in (told.truth, told.anchors))
    truth = log_file.truth if truth is None else truth
    fixes, said = _own_fixes(log_file, inputs, clock)
    use = None
    if fixes is not None:
        used, used_as = fixes.select(slice(0)), "none"
        if inputs.use_gnss != "none":
            if anchors is not None:
                raise ConfigError("the log's fixes and other anchors: name one of them")
            anchors = used = gnss_anchors(fixes, inputs.use_gnss)
            used_as = inputs.use_gnss
        elif truth is None:
            truth = used = fixes
            used_as = "truth"
        sigma_m = float(np.median(used.sigma_m)) if len(used) else None
        use = GnssUse(fixes.source, len(fixes), len(used), used_as, sigma_m)
    notices = [*said, *(text for places in (truth, anchors) if places is not None for text in places.notices)]
    log = replace(log, notices=(*log.notices, *dict.fromkeys(notices)))
    return log, replace(told, truth=truth, anchors=anchors, gnss=use)


def _own_fixes(log_file: LogFile, inputs: RunInputs, clock: LogClock) -> tuple[Checkpoints | None, tuple[str, ...]]:
    """What a receiver found during the walk, on the log's clock, and what is to be said of it.

    Fixes that nobody asked for are no reason to refuse a walk.
    """
    asked = inputs.use_gnss != "none"
    fixes = log_file.gnss
    inside = inputs.log is not None and (Path(inputs.log).is_dir() or Path(inputs.log).suffix.lower() == ".zip")
    if fixes is None and inputs.log is not None and (asked or inside):  # beside a log's one file only if asked
        try:
            fixes = gnss_of(Path(inputs.log))
        except DataError as error:
            if asked:
                raise
            return None, (f"GNSS fixes not used: {error}",)
    if fixes is None:
        if asked:
            raise DataError(
                f"{inputs.log or log_file.log.name}: --use-gnss {inputs.use_gnss}: no GNSS fixes in the log and no "
                "Location.csv beside it; name a file of places with --anchors"
            )
        return None, ()
    try:
        fixes = on_logs_clock(fixes, clock)
    except DataError as error:
        if asked:
            raise
        return None, (f"GNSS fixes not used: {error}",)
    return fixes, fixes.notices


def reconstruct(
    log: SensorLog,
    config: Config,
    told: Told | None = None,
    inputs: RunInputs | None = None,
    progress: Progress = lambda stage: None,
) -> WalkResult:
    """Run dead reckoning, the EKF pipeline and the smoother on the same steps of one log.

    A smoother that fails, or whose walk is withheld (``inputs.forced`` gives it all the same), takes nothing with it:
    ``WalkResult.failed`` says why, the others are there.

    Args:
        log: the walk.
        config: the effective configuration.
        told: truth, anchors, a closed end, an origin, a building.
        inputs: as in ``WalkResult``.
        progress: told each stage.

    Raises:
        DataError: no step in the log, or an anchor that lies outside it.
    """
    told = told or Told()
    require_anchors_within(log, told)
    config = with_declination(config, told.place, log.t0_s)
    seconds: dict[str, float] = {}

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        progress(name)
        start = time.perf_counter()
        yield
        seconds[name] = time.perf_counter() - start

    aids = told.aids(log.t0_s, config.device.declination_deg)
    with stage("steps"):
        track, signals = detect_steps(log, config)
    with stage("baselines"):
        compared = baselines(track, config)
    turned, failed = None, {}
    try:
        with stage("smoother"):
            smoothed = smooth(track, compared["ekf"], config.graph, config.solver, aids)
        if config.returning.out_and_back:
            with stage("closures"):
                smoothed, turned = tie_way_back(smoothed, track, compared["ekf"], config, aids)
        smoothed = lay_along_axis(smoothed, track, aids, config.graph)
    except EstimationError as error:
        failed["smoothed"], smoothed = str(error), stand_in(compared["ekf"])
    result = compose(log, config, told, signals, track, smoothed, compared, failed)
    return held_back(replace(result, seconds=seconds, inputs=inputs or RunInputs(), turn_back=turned))


def held_back(result: WalkResult) -> WalkResult:
    """A walk without its smoothed trajectory, if its own check withholds that and nobody wants it all the same.

    What the smoother said of itself stays, to look at in the recording, beside the EKF's walk.
    """
    if result.integrity.verdict != "withheld" or result.inputs.forced or "smoothed" in result.failed:
        return result
    others = {name: trajectory for name, trajectory in result.trajectories.items() if name != "smoothed"}
    return replace(
        result,
        trajectories=others,
        smoothed=replace(result.smoothed, trajectory=others["ekf"]),
        failed={**result.failed, "smoothed": f"withheld, {result.integrity.reasons[0].text}"},
    )


def require_anchors_within(log: SensorLog, told: Told) -> None:
    """Refuse anchors of another log or clock.

    Raises:
        DataError: one lies outside the log.
    """
    if told.anchors is not None:
        told.anchors.require_possible()
        told.anchors.require_within(log.t0_s + log.acc.t_s[0], log.t0_s + log.acc.t_s[-1])


def compose(
    log: SensorLog,
    config: Config,
    told: Told,
    signals: LevelledSignals,
    track: StepTrack,
    smoothed: Smoothed,
    others: Mapping[str, Trajectory],
    failed: Mapping[str, str] | None = None,
) -> WalkResult:
    """A walk's result from the answers of its estimators; truth is brought into the frame of the anchors."""
    failed = failed or {}
    known = [*others.items(), *([] if "smoothed" in failed else [("smoothed", smoothed.trajectory)])]
    known.sort(key=lambda one: one[0] == "online")  # in the order of ``ESTIMATORS``
    log, told = _doubted(log, told)
    truth = None if told.truth is None else told.truth.in_frame_of(told.anchors)
    result = WalkResult(
        log=log,
        config=config,
        signals=signals,
        track=track,
        trajectories=dict(known),
        smoothed=smoothed,
        told=replace(told, truth=truth),
        failed=failed,
    )
    return _checked(result)


def _checked(result: WalkResult) -> WalkResult:
    """The walk with its verdict; where it is doubtful, the covariance is widened to what was found."""
    found = assess(result)
    trajectories = dict(result.trajectories)
    if "smoothed" in trajectories:
        trajectories["smoothed"] = found.trajectory
    smoothed = replace(result.smoothed, trajectory=found.trajectory)
    return replace(result, smoothed=smoothed, trajectories=trajectories, integrity=found.integrity)


def _doubted(log: SensorLog, told: Told) -> tuple[SensorLog, Told]:
    """Truth where nobody can have been scores nobody, and places far from each other are told."""
    notices = [*told.disagreements(log.duration_s)]
    if told.truth is not None and told.truth.doubt:
        notices.append(f"not scored: {told.truth.source}: {told.truth.doubt}")
        told = replace(told, truth=None)
    return (replace(log, notices=(*log.notices, *notices)) if notices else log), told


def stand_in(ekf: Trajectory) -> Smoothed:
    """What is shown where the smoother failed: the EKF's trajectory, which is all that is known."""
    return Smoothed(ekf, errors=np.array([np.nan]), factors=0, residuals=())


def write_run(
    result: WalkResult, claim: RunClaim, recording: bool = True, progress: Progress = lambda stage: None
) -> dict[str, Any]:
    """Write the run folder, whole or not at all, and return its summary.

    Args:
        result: the walk.
        claim: its place, held by ``claimed_run`` or ``claimed_live``.
        recording: whether to write ``recording.rrd`` too.
        progress: told each stage.

    Raises:
        ConfigError: it cannot be written.
        DataError: truth that does not belong to this log.
    """
    with claim.written() as folder:
        return write_files(result, folder, recording, progress)


def write_files(
    result: WalkResult, folder: Path, recording: bool = True, progress: Progress = lambda stage: None
) -> dict[str, Any]:
    """Write all files of a run into an existing folder and return the summary.

    Raises:
        DataError: truth that does not belong to this log.
    """
    progress("tables")
    summary = summarize(result)
    if recording and find_spec("rerun") is None:
        recording = False
        summary["warnings"].append("no recording.rrd: rerun-sdk is not installed (pip install rerun-sdk)")
    write_tables(result, folder, summary)
    if recording:
        progress("recording")
        from fbgraph.recording.recorder import write_recording  # rerun takes a second to import

        write_recording(result, folder / "recording.rrd", summary_markdown(summary))
    return summary
