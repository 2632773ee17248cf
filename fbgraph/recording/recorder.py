"""What an analyst opens to see where a walk went and why it went wrong, as a file or live in a viewer.

Entities
    ``world/…``, ``map/…``, ``geo/…``: places, see ``scene``. ``sensors/…``: the raw streams. ``state/…``: what
    the estimators say at each breadcrumb, beside what it was made from, with ±2σ bands. ``lanes/…``: what went on when.
    ``uncertainty_m/…``, ``error_m/…``, ``legs/…``: how sure, and where truth is known how wrong. ``residuals/…`` and
    ``weights/…``: what each factor of the graph still has to complain about, and what its robust loss left it.
    ``solver/…``, ``graph``, ``summary``: the solver, and two texts.
Timelines
    ``time``, ``step`` and ``distance_cm``; see ``fbgraph.recording.writer``.

Equal results give recordings that ``rerun rrd compare`` finds equal: nothing in them comes from the wall clock.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from fbgraph.core.colors import AXIS_COLORS, COLORS, LABELS
from fbgraph.core.config import Config
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, wrap_angle
from fbgraph.core.safe_text import MOST_NAME, for_markdown, for_terminal
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.estimates import Belief
from fbgraph.front_end.levelled_signals import LevelledSignals
from fbgraph.front_end.step_track import StepTrack
from fbgraph.recording import map_scene as scene
from fbgraph.recording.blueprint import blueprint
from fbgraph.recording.checkpoint_errors import errors_at_checkpoints, record_errors
from fbgraph.recording.factor_residuals import record_residuals
from fbgraph.recording.map_scene import FAINT, SIGMAS, ordered
from fbgraph.recording.writer import Rgba, RrdWriter
from fbgraph.run.timeline_lanes import (
    ARRIVED,
    DOUBTED,
    MOVING,
    OFF_ROUTE,
    ON_ROUTE,
    STANDING,
    TRUSTED,
    WALKING,
    compass_inflation,
    compass_lane,
    compass_trust,
    places_lane,
    returning_lane,
    wearer_lane,
)
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.legs import directions_of
from fbgraph.way_back.records import ReturnUpdate
from fbgraph.way_back.texts import as_text

_ACC_NORM_HZ = 20.0  # of |acc| beside the steps; the raw stream has every sample
_PAUSE_S = 3.0  # curves of steps are broken where nobody stepped for longer
_SENSORS = {
    # unit, and a power of two finer than the sensor resolves: rounded to it, numbers take a third less of the file
    "acc": ("m/s²", 2.0**-9),
    "gyro": ("rad/s", 2.0**-12),
    "mag": ("µT", 2.0**-5),
    "pressure": ("hPa", 2.0**-10),
}
_WEARER_COLORS: dict[str, Rgba] = {WALKING: (0, 114, 178), STANDING: (110, 110, 110), MOVING: (96, 72, 140)}
_COMPASS_COLORS: dict[str, Rgba] = {TRUSTED: (0, 110, 80), DOUBTED: COLORS["sensor"]}
_PLACE_COLORS: dict[str, Rgba] = {
    "anchor": COLORS["anchor"],
    "closed walk": COLORS["anchor"],
    "closure": COLORS["closure"],
}
_RETURN_COLORS: dict[str, Rgba] = {ON_ROUTE: COLORS["return"], OFF_ROUTE: COLORS["sensor"], ARRIVED: COLORS["smoothed"]}
_CIRCLE = rr.components.MarkerShape.Circle
_DIAMOND = rr.components.MarkerShape.Diamond


class Recorder:
    """Logs a walk as it becomes known: all at once into a file, or piece by piece into a viewer."""

    def __init__(self, rrd: RrdWriter, config: Config) -> None:
        """Begin.

        Args:
            rrd: where to.
            config: the effective configuration of the walk.
        """
        self._rrd = rrd
        self._config = config
        self._beliefs = scene.Beliefs()
        self._yaw_s = self._yaw_rad = self._shown_rad = np.zeros(1)
        self._acc_s = self._acc = np.zeros(0)
        self._lanes: dict[str, str | None] = {}
        scene.draw_axes(rrd)

    def clock(self, trajectory: Trajectory) -> None:
        """The trajectory whose steps and distances are the timelines, and beside whose headings others are shown."""
        self._rrd.clock(trajectory.t_s, trajectory.distance_m)
        self._yaw_s, self._yaw_rad = trajectory.t_s, trajectory.yaw_rad
        self._shown_rad = trajectory.yaw_rad - 2.0 * np.pi * _laps(trajectory.yaw_rad)

    def samples(self, log: SensorLog, signals: LevelledSignals) -> None:
        """The raw streams and events of a piece of log, and |acc| as the step detector sees it."""
        rrd = self._rrd
        for name, (unit, resolution) in _SENSORS.items():
            stream = getattr(log, name)
            values = np.round(stream.values / resolution) * resolution
            if values.shape[1] == 1:
                labels, colors = [f"{name} [{unit}]"], [COLORS["sensor"]]
            else:
                labels, colors = [f"{name} {axis} [{unit}]" for axis in "xyz"], list(AXIS_COLORS)
            gap_s = self._config.attitude.max_gap_s if name in ("acc", "gyro") else np.inf
            rrd.series(
                f"sensors/{name}", stream.t_s, values, labels, colors, width=1.0, only_time=True, max_gap_s=gap_s
            )
        every = max(round(self._config.attitude.rate_hz / _ACC_NORM_HZ), 1)
        count = len(signals) // every * every
        t_s = signals.t_s[:count].reshape(-1, every).mean(axis=1)
        acc_norm = signals.acc_norm_m_s2[:count].reshape(-1, every).mean(axis=1)
        rrd.series("state/acc_norm_m_s2", t_s, acc_norm, ["|acc| [m/s²]"], [COLORS["sensor"]], only_time=True)
        keep = int(10.0 * _ACC_NORM_HZ)  # steps are found some seconds late
        self._acc_s, self._acc = (
            np.concatenate((self._acc_s[-keep:], t_s)),
            np.concatenate((self._acc[-keep:], acc_norm)),
        )
        if log.events:
            at_s = np.array([event.t_s for event in log.events])
            texts = [for_terminal(event.label) for event in log.events]
            levels = [rr.TextLogLevel.INFO] * len(texts)
            rrd.columns("events", at_s, rr.TextLog.columns(text=texts, level=levels))

    def steps(self, track: StepTrack, first: int = 0) -> None:
        """What each step from ``first`` on measured."""
        rrd, sensor = self._rrd, COLORS["sensor"]
        t_s = track.t_s[first:]
        walked = slice(max(first, 1), None)  # the standing start has neither length nor frequency
        if len(t_s) == 0:
            return
        step_s = track.t_s[walked]
        at_steps = np.interp(step_s, self._acc_s, self._acc) if len(self._acc_s) else np.full(len(step_s), 9.81)
        rrd.series("steps", step_s, at_steps, ["step"], [COLORS["step"]], width=2.0, points=_DIAMOND)
        frequency = track.frequency_hz[walked]
        names, colors = ["step frequency [Hz]"], [COLORS["step"]]
        rrd.series("state/step_frequency_hz", step_s, frequency, names, colors, max_gap_s=_PAUSE_S)
        length = track.length_m[walked]
        rrd.series("state/step_length_m/measured", step_s, length, ["by its model"], colors, max_gap_s=_PAUSE_S)
        graph = self._config.graph
        sigma = np.hypot(graph.sigma_length_rel * length, graph.sigma_slope_rel * track.shortened_m[walked])
        faint = [(*COLORS["step"], FAINT)] * 2
        names = [f"by its model ±{SIGMAS:g}σ"] * 2
        table = np.maximum(_band(length, sigma), 0.0)
        rrd.series("state/step_length_m/measured_2sigma", step_s, table, names, faint, width=1.0, max_gap_s=_PAUSE_S)
        compass = np.degrees(self._beside(track.t_s[first:], track.yaw_mag_rad[first:]))
        rrd.series("state/yaw_deg/compass", t_s, compass, ["compass"], [sensor], points=_CIRCLE)
        rest = np.degrees(np.where(track.rest_s > 0, track.rest_rate_rad_s, np.nan))[first:]
        rrd.series("state/gyro_bias_deg_s/rest", t_s, rest, ["while standing"], [sensor], width=2.5, points=_CIRCLE)
        norm, dip = track.mag_norm_ut[first:], np.degrees(track.mag_dip_rad[first:])
        rrd.series("state/field/norm_ut", t_s, norm, ["strength [µT]"], [sensor], max_gap_s=_PAUSE_S)
        rrd.series("state/field/dip_deg", t_s, dip, ["dip [°]"], [AXIS_COLORS[1]], max_gap_s=_PAUSE_S)
        known = np.flatnonzero(np.isfinite(track.altitude_m))
        if len(known):
            altitude = (track.altitude_m - track.altitude_m[known[0]])[first:]
            rrd.series("state/altitude_m/barometer", t_s, altitude, ["barometer"], [sensor], points=_CIRCLE)

    def wearer(self, signals: LevelledSignals, track: StepTrack) -> None:
        """What the wearer did during these signals."""
        self._lane("wearer", wearer_lane(signals, track, self._config.attitude.still_window_s), _WEARER_COLORS)

    def states(self, name: str, trajectory: Trajectory, first: int = 0) -> None:
        """What an estimator says at each breadcrumb from ``first`` on."""
        rrd, label, color = self._rrd, [LABELS[name]], [COLORS[name]]
        t_s = trajectory.t_s[first:]
        if len(t_s) == 0:
            return
        yaw_deg = np.degrees(self._beside(t_s, trajectory.yaw_rad[first:]))
        rrd.series(f"state/yaw_deg/{name}", t_s, yaw_deg, label, color, max_gap_s=_PAUSE_S)
        if name != "pdr":  # it has neither
            bias = np.degrees(trajectory.gyro_bias_rad_s[first:])
            rrd.series(f"state/gyro_bias_deg_s/{name}", t_s, bias, label, color)
            if "state/altitude_m/barometer" in rrd.entities:
                z_m = trajectory.z_m[first:]
                rrd.series(f"state/altitude_m/{name}", t_s, z_m, label, color, max_gap_s=_PAUSE_S)

    def draw_path(self, name: str, trajectory: Trajectory, first: int = 0) -> None:
        """The places of an estimator, new ones from ``first`` on."""
        scene.draw_path(self._rrd, name, trajectory, first)

    def believed(self, beliefs: Sequence[Belief]) -> None:
        """What the online smoother took the walk to be."""
        self._beliefs.add(self._rrd, beliefs)

    def returned(self, updates: Sequence[ReturnUpdate], online: Trajectory) -> None:
        """What the wearer was told on the way back; ``online`` holds each breadcrumb as believed at its step."""
        if not updates:
            return
        rrd, t_s = self._rrd, np.array([update.t_s for update in updates])
        scene.draw_matches(rrd, updates, online)
        blue, red = COLORS["return"], COLORS["sensor"]
        remaining = np.array([update.remaining_m for update in updates])
        rrd.series("return/remaining_m", t_s, remaining, ["left to the start"], [blue])
        cross = np.array([update.cross_track_m for update in updates])
        rrd.series("return/cross_track_m", t_s, cross, ["left of the route"], [red], max_gap_s=_PAUSE_S)
        told = [update for update in updates if update.instruction]
        if told:
            at_s, texts = np.array([update.t_s for update in told]), [update.instruction for update in told]
            rrd.columns("return/told", at_s, rr.TextLog.columns(text=texts, level=[rr.TextLogLevel.INFO] * len(told)))
        self._lane("way_back", returning_lane(updates), _RETURN_COLORS)

    def finished(self, result: WalkResult, summary_markdown: str, active_tab: int = 0) -> None:
        """What only the whole walk tells; what it shares with the walk in progress must have been logged."""
        rrd = self._rrd
        errors = errors_at_checkpoints(result, ordered(result))
        rrd.fixed("summary", rr.TextDocument(summary_markdown, media_type=rr.MediaType.MARKDOWN))
        self._hindsight(result)
        record_residuals(rrd, result)
        record_errors(rrd, result, errors)
        self._lane("compass", compass_lane(result), _COMPASS_COLORS)
        self._lane("known_places", places_lane(result), _PLACE_COLORS)
        self._way_back(result)
        scores = {name: float(np.sqrt((error_m**2).mean())) for name, (_, error_m) in errors.items()}
        frame = scene.draw_finished(rrd, result, scores)
        self._beliefs.finish(rrd, result.smoothed.trajectory)
        self.arranged = blueprint(rrd.entities, frame, active_tab)

    def _lane(self, name: str, lane: list[tuple[float, str | None]], colors: dict[str, Rgba]) -> None:
        """Changes of state; one that is no change since the last piece is left out."""
        if lane and lane[0][1] == self._lanes.get(name):
            lane = lane[1:]
        if lane:
            self._lanes[name] = lane[-1][1]
            self._rrd.lane(f"lanes/{name}", lane, colors)

    def _beside(self, t_s: FloatArray, yaw_rad: FloatArray) -> FloatArray:
        """The same directions within half a turn of the one by which the clock goes, so that they can be compared."""
        at = np.clip(np.searchsorted(self._yaw_s, t_s), 0, len(self._yaw_s) - 1)
        return np.asarray(self._shown_rad[at] + wrap_angle(yaw_rad - self._yaw_rad[at]))

    def _hindsight(self, result: WalkResult) -> None:
        """The bands of the smoother, and what it makes of steps and compass."""
        rrd, smoothed, track, config = self._rrd, result.smoothed.trajectory, result.track, result.config.graph
        color, names = [(*COLORS["smoothed"], FAINT)] * 2, [f"smoothed ±{SIGMAS:g}σ"] * 2

        def band(entity: str, middle: FloatArray, sigma: FloatArray, max_gap_s: float = _PAUSE_S) -> None:
            table = _band(middle, sigma)
            rrd.series(entity, smoothed.t_s, table, names, color, width=1.0, max_gap_s=max_gap_s)

        sigma_m = smoothed.longest_sigma_m
        if smoothed.cov_xy_yaw is not None and sigma_m is not None:
            sigma = np.degrees(np.sqrt(smoothed.cov_xy_yaw[:, 2, 2]))
            band("state/yaw_deg/smoothed_2sigma", np.degrees(self._shown_rad), sigma)
            label = [f"smoothed {SIGMAS:g}σ, the ellipse's longest half axis"]
            rrd.series("uncertainty_m/smoothed_2sigma", smoothed.t_s, SIGMAS * sigma_m, label, [color[0]])
        if smoothed.sigma_bias_rad_s is not None:
            bias, sigma = np.degrees(smoothed.gyro_bias_rad_s), np.degrees(smoothed.sigma_bias_rad_s)
            band("state/gyro_bias_deg_s/smoothed_2sigma", bias, sigma, np.inf)
        if smoothed.sigma_z_m is not None and "state/altitude_m/barometer" in rrd.entities:
            band("state/altitude_m/smoothed_2sigma", smoothed.z_m, smoothed.sigma_z_m)
        step_m = np.hypot(np.diff(smoothed.x_m), np.diff(smoothed.y_m))
        entity, step_s = "state/step_length_m/smoothed", smoothed.t_s[1:]
        rrd.series(entity, step_s, step_m, [LABELS["smoothed"]], [COLORS["smoothed"]], max_gap_s=_PAUSE_S)

        trust = compass_trust(result)
        off_deg = np.degrees(wrap_angle(track.yaw_mag_rad - smoothed.yaw_rad))
        sensor = [COLORS["sensor"]]
        entity = "state/magnetic_disturbance_deg"
        label = ["compass minus smoothed heading"]
        rrd.series(f"{entity}/compass_off", track.t_s, off_deg, label, sensor, points=_CIRCLE)
        expected = np.degrees(config.sigma_mag_rad) * np.sqrt(compass_inflation(result))
        faint = [(*COLORS["sensor"], FAINT)] * 2
        table = _band(np.zeros(len(track)), expected)
        label = [f"expected there ±{SIGMAS:g}σ"] * 2
        rrd.series(f"{entity}/expected_2sigma", track.t_s, table, label, faint, width=1.0, max_gap_s=_PAUSE_S)
        label = ["share of its pull left to the compass"]
        rrd.series("state/compass_trust", track.t_s, trust, label, sensor, max_gap_s=_PAUSE_S)

    def _way_back(self, result: WalkResult) -> None:
        """Where the way back leads, and how it is told."""
        log, compass = (
            result.log,
            len(result.log.mag) > 0 or (result.told.anchors is not None and len(result.told.anchors) > 1),
        )
        events = [(event.t_s, for_markdown(event.label, MOST_NAME)) for event in log.events]
        name = for_markdown(log.name, MOST_NAME)
        walked = result.smoothed.trajectory
        if result.turn_back is not None and result.returning:  # the wearer has gone back already: that way
            walked = walked.until(result.turn_back.breadcrumb)
        try:
            there = directions_of(walked, events, None, result.config.graph, name, compass)
        except DataError:  # a walk that leads nowhere
            return
        back = there.reversed()
        scene.draw_way_back(self._rrd, back)
        listed = as_text(back).replace("\n\n", "\n\n\n")
        self._rrd.fixed("return/instructions", rr.TextDocument(listed, media_type=rr.MediaType.MARKDOWN))


def write_recording(result: WalkResult, path: Path, summary_markdown: str, active_tab: int = 0) -> None:
    """Write the recording of a walk, its blueprint inside: ``rerun recording.rrd`` opens it framed and arranged.

    Args:
        result: the walk.
        path: file to write; its folder exists.
        summary_markdown: shown beside the map.
        active_tab: which tab it opens on.

    Raises:
        OSError: the file cannot be written.
    """
    smoothed = result.smoothed.trajectory
    content = hashlib.sha1(np.ascontiguousarray(smoothed.xy_m).tobytes(), usedforsecurity=False).hexdigest()
    rrd = RrdWriter(f"{result.log.name}-{content[:12]}")
    recorder = Recorder(rrd, result.config)
    recorder.clock(smoothed)
    recorder.samples(result.log, result.signals)
    recorder.steps(result.track)
    recorder.wearer(result.signals, result.track)
    for name, trajectory in ordered(result):
        recorder.states(name, trajectory)
    recorder.believed(result.beliefs)
    if result.returning:
        recorder.returned(result.returning, result.trajectories["online"])
    recorder.finished(result, summary_markdown, active_tab)
    rrd.save(path, recorder.arranged)


def _laps(yaw_rad: FloatArray) -> FloatArray:
    """(N,) whole turns to take off, lest laps add up and flatten the plot; changed as rarely as keeps within ±270°."""
    laps = [float(np.round(yaw_rad[0] / (2.0 * np.pi)))]
    for turns in (yaw_rad[1:] / (2.0 * np.pi)).tolist():
        laps.append(laps[-1] if abs(turns - laps[-1]) < 0.75 else float(round(turns)))
    return np.array(laps)


def _band(values: FloatArray, sigma: FloatArray) -> FloatArray:
    """(N, 2) lower and upper end."""
    return np.column_stack((values - SIGMAS * sigma, values + SIGMAS * sigma))
