"""A Rerun recording of a finished walk: what an analyst opens to see where and why it went wrong.

Entities
    ``world/…`` in space (x East, y North, z up, metres): ``{estimator}/path`` and ``{estimator}/position``,
    ``smoothed/{ends,breadcrumbs,ellipses,closure}``, ``truth/{path,checkpoints}``, ``anchors``. ``map/…`` the same in
    the plane, in the same coordinates; Rerun's 2-D views have y down, so a transform at ``map`` turns North up again.
    ``sensors/{acc,gyro,mag,pressure}``, ``state/…``, ``steps``, ``error_m/{estimator}``, ``events``, ``summary``.
Timelines
    ``time``, ``step`` and ``distance_cm``; see ``fbgraph.rrd``.

Equal results give recordings that ``rerun rrd compare`` finds equal: nothing in them comes from the wall clock.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr

from fbgraph.blueprint import Frame, blueprint
from fbgraph.errors import DataError
from fbgraph.exports import score_label
from fbgraph.geometry import FloatArray, wrap_angle
from fbgraph.metrics import checkpoint_errors
from fbgraph.palette import AXIS_COLORS, COLORS, LABELS
from fbgraph.result import ESTIMATORS, WalkResult
from fbgraph.rrd import RrdWriter
from fbgraph.trajectory import Trajectory

_SIGMAS = 2.0  # of ellipses and bands
_ELLIPSES = 10  # about so many along a walk; more hide each other
_ELLIPSE_POINTS = 33
_ACC_NORM_HZ = 20.0  # of |acc| beside the steps; the raw stream has every sample
_SAME_PLACE_M = 0.5  # checkpoints closer than this share a label ...
_SAME_FLOOR_M = 2.0  # ... unless one lies on another floor
_MOST_LABELS = 100
_FAINT = 110  # opacity, of 255, of bands and ellipses
_SENSORS = {
    # unit, and a power of two finer than the sensor resolves: rounded to it, numbers take a third less of the file
    "acc": ("m/s²", 2.0**-10),
    "gyro": ("rad/s", 2.0**-12),
    "mag": ("µT", 2.0**-6),
    "pressure": ("hPa", 2.0**-10),
}


def write_recording(result: WalkResult, path: Path, summary_markdown: str) -> None:
    """Write the recording of a walk, its blueprint inside: ``rerun recording.rrd`` opens it framed and arranged.

    Args:
        result: the walk.
        path: file to write; its folder exists.
        summary_markdown: shown beside the map.

    Raises:
        OSError: the file cannot be written.
    """
    _write(result, path, summary_markdown)


def _write(result: WalkResult, path: Path, summary_markdown: str, active_tab: int = 0) -> None:
    """As ``write_recording``, opening at another tab."""
    smoothed = result.smoothed.trajectory
    content = hashlib.sha1(np.ascontiguousarray(smoothed.xy_m).tobytes(), usedforsecurity=False).hexdigest()
    rrd = RrdWriter(f"{result.log.name}-{content[:12]}", smoothed.t_s, smoothed.distance_m)
    rrd.fixed("summary", rr.TextDocument(summary_markdown, media_type=rr.MediaType.MARKDOWN))
    errors = _errors(result)
    _log_sensors(rrd, result)
    _log_states(rrd, result)
    _log_errors(rrd, errors)
    _log_events(rrd, result)
    frame = _log_places(rrd, result, _legend(result, errors))
    rrd.save(path, blueprint(rrd.entities, frame, active_tab))


def _log_sensors(rrd: RrdWriter, result: WalkResult) -> None:
    """The raw streams, and |acc| as the step detector sees it with the steps on it."""
    for name, (unit, resolution) in _SENSORS.items():
        stream = getattr(result.log, name)
        values = np.round(stream.values / resolution) * resolution
        if values.shape[1] == 1:
            labels, colors = [f"{name} [{unit}]"], [COLORS["sensor"]]
        else:
            labels, colors = [f"{name} {axis} [{unit}]" for axis in "xyz"], list(AXIS_COLORS)
        rrd.series(f"sensors/{name}", stream.t_s, values, labels, colors, width=1.0, only_time=True)

    signals, crumb_s = result.signals, result.track.t_s
    every = max(round(result.config.attitude.rate_hz / _ACC_NORM_HZ), 1)
    count = len(signals) // every * every
    t_s = signals.t_s[:count].reshape(-1, every).mean(axis=1)
    acc_norm = signals.acc_norm_m_s2[:count].reshape(-1, every).mean(axis=1)
    rrd.series("state/acc_norm_m_s2", t_s, acc_norm, ["|acc| [m/s²]"], [COLORS["sensor"]], only_time=True)
    at_steps = np.interp(crumb_s[1:], t_s, acc_norm)
    diamond = rr.components.MarkerShape.Diamond
    rrd.series("steps", crumb_s[1:], at_steps, ["step"], [COLORS["step"]], width=2.0, points=diamond)
    # only where it changes, and once more at the end
    turns = np.flatnonzero(np.diff(signals.still, prepend=~signals.still[:1], append=~signals.still[-1:])[:-1])
    rows = np.append(turns, len(signals) - 1)
    still = signals.still[rows].astype(float)
    rrd.series(
        "state/still", signals.t_s[rows], still, ["standing still"], [COLORS["truth"]], stairs=True, only_time=True
    )


def _log_states(rrd: RrdWriter, result: WalkResult) -> None:
    """What the estimators say at each breadcrumb, each beside what it was made from."""
    track, smoothed = result.track, result.smoothed.trajectory
    circle = rr.components.MarkerShape.Circle
    sensor = COLORS["sensor"]
    band = [(*COLORS["smoothed"], _FAINT)] * 2
    band_names = [f"smoothed ±{_SIGMAS:g}σ"] * 2

    shown = smoothed.yaw_rad - 2.0 * np.pi * _laps(smoothed.yaw_rad)

    def beside(yaw_rad: FloatArray) -> FloatArray:
        """The same directions in degrees, within half a turn of the smoothed one, so that they can be compared."""
        return np.degrees(shown + wrap_angle(yaw_rad - smoothed.yaw_rad))

    compass = beside(track.yaw_mag_rad)
    rrd.series("state/yaw_deg/compass", track.t_s, compass, ["compass"], [sensor], points=circle)
    if smoothed.cov_xy_yaw is not None:
        table = np.degrees(_band(shown, np.sqrt(smoothed.cov_xy_yaw[:, 2, 2])))
        rrd.series("state/yaw_deg/smoothed_2sigma", smoothed.t_s, table, band_names, band, width=1.0)
    for name, trajectory in _ordered(result):
        yaw_deg = beside(trajectory.yaw_rad)
        rrd.series(f"state/yaw_deg/{name}", trajectory.t_s, yaw_deg, [LABELS[name]], [COLORS[name]])

    rest = np.degrees(np.where(track.rest_s > 0, track.rest_rate_rad_s, np.nan))
    rrd.series("state/gyro_bias_deg_s/rest", track.t_s, rest, ["while standing"], [sensor], width=2.5, points=circle)
    for name, trajectory in _ordered(result):
        if name != "pdr":  # it has none
            bias = np.degrees(trajectory.gyro_bias_rad_s)
            rrd.series(f"state/gyro_bias_deg_s/{name}", trajectory.t_s, bias, [LABELS[name]], [COLORS[name]])

    rrd.series("state/field/norm_ut", track.t_s, track.mag_norm_ut, ["strength [µT]"], [sensor])
    rrd.series("state/field/dip_deg", track.t_s, np.degrees(track.mag_dip_rad), ["dip [°]"], [AXIS_COLORS[1]])

    walked = slice(1, None)  # the standing start has neither length nor frequency
    length = track.length_m[walked]
    rrd.series("state/step_length_m", track.t_s[walked], length, ["step length [m]"], [COLORS["step"]])
    frequency = track.frequency_hz[walked]
    rrd.series("state/step_frequency_hz", track.t_s[walked], frequency, ["step frequency [Hz]"], [COLORS["step"]])

    known = np.flatnonzero(np.isfinite(track.altitude_m))
    if len(known):
        altitude = track.altitude_m - track.altitude_m[known[0]]
        rrd.series("state/altitude_m/barometer", track.t_s, altitude, ["barometer"], [sensor], points=circle)
        if smoothed.sigma_z_m is not None:
            table = _band(smoothed.z_m, smoothed.sigma_z_m)
            rrd.series("state/altitude_m/smoothed_2sigma", smoothed.t_s, table, band_names, band, width=1.0)
        for name, trajectory in _ordered(result):
            if name != "pdr":
                entity = f"state/altitude_m/{name}"
                rrd.series(entity, trajectory.t_s, trajectory.z_m, [LABELS[name]], [COLORS[name]])


def _log_errors(rrd: RrdWriter, errors: dict[str, tuple[FloatArray, FloatArray]]) -> None:
    for name, (t_s, error_m) in errors.items():
        rrd.series(f"error_m/{name}", t_s, error_m, [LABELS[name]], [COLORS[name]], width=2.0)


def _log_events(rrd: RrdWriter, result: WalkResult) -> None:
    """What the log marked, and what its reader had to say."""
    log = result.log
    rows = [(0.0, notice, rr.TextLogLevel.WARN) for notice in log.notices]
    rows += [(event.t_s, event.label, rr.TextLogLevel.INFO) for event in log.events]
    if rows:
        t_s, texts, levels = zip(*rows, strict=True)
        rrd.columns("events", np.array(t_s), rr.TextLog.columns(text=texts, level=levels))


def _log_places(rrd: RrdWriter, result: WalkResult, legend: dict[str, str]) -> Frame:
    """Trajectories, truth, anchors and the map's legend; returns what the map must show."""
    smoothed = result.smoothed.trajectory
    rrd.fixed("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    rrd.fixed("map", rr.Transform3D(scale=(1.0, -1.0, 1.0)))
    seen = []
    if result.truth is not None and len(result.truth):
        places = _truth_places(result)
        dense = len(places) > _MOST_LABELS  # a track rather than checkpoints
        rrd.lines("truth/path", [places], COLORS["truth"], 2.0 if dense else 1.0)
        if not dense:
            rrd.points("truth/checkpoints", *_grouped(places), COLORS["truth"], 5.0)
        seen.append(places)
    for name, trajectory in _ordered(result):
        path = _xyz(trajectory)
        if result.anchors is not None and name != "smoothed":  # that one left the origin for the anchors' frame
            path = path - path[0] + _xyz(smoothed)[0]
        rrd.lines(f"{name}/path", [path], COLORS[name], 2.0 if name == "smoothed" else 1.2)
        rrd.moving_point(f"{name}/position", trajectory.t_s, path, COLORS[name], 7.0)
        seen.append(path)
    path = _xyz(smoothed)
    rrd.points("smoothed/breadcrumbs", path, None, COLORS["smoothed"], 2.5)
    if smoothed.cov_xy_yaw is not None:
        ellipses = _ellipses(smoothed)
        rrd.lines("smoothed/ellipses", ellipses, (*COLORS["smoothed"], _FAINT), 0.7)
        seen += ellipses
    if result.closed_walk:
        rrd.lines("smoothed/closure", [path[[-1, 0]]], COLORS["anchor"], 1.5)
    if result.anchors is not None and len(result.anchors):
        z_m = smoothed.at(result.anchors.t_s - result.log.t0_s)[:, 2]
        places = np.column_stack((result.anchors.xy_m, z_m))
        rrd.points("anchors", places, None, COLORS["anchor"], 8.0)  # a ring about a checkpoint
        seen.append(places)
    frame = Frame.around(np.concatenate(seen)[:, :2])
    _log_ends(rrd, path, frame)
    _log_legend(rrd, frame, legend)
    return frame


def _log_ends(rrd: RrdWriter, path: FloatArray, frame: Frame) -> None:
    """Flags at the ends of the walk, on poles that lean apart: they would hide each other and the checkpoints."""
    labels, colors, radii = ["start", "end"], [COLORS["smoothed"]], rr.Radius.ui_points(1.0)
    lean, rise = 0.9 * frame.row_m, 0.75 * frame.row_m
    # a label is put at the mean of its strip's points: three of four are the top of the pole
    grow = np.array((0.0, 1.0, 1.0, 1.0))[:, None]
    poles = [foot + grow * (side * lean, 0.0, rise) for foot, side in ((path[0], -1.0), (path[-1], 1.0))]
    rrd.fixed("world/smoothed/ends", rr.LineStrips3D(poles, labels=labels, colors=colors, radii=radii))
    flat = [foot[:2] + grow * (side * lean, rise) for foot, side in ((path[0], -1.0), (path[-1], 1.0))]
    rrd.fixed("map/smoothed/ends", rr.LineStrips2D(flat, labels=labels, colors=colors, radii=radii))


def _log_legend(rrd: RrdWriter, frame: Frame, legend: dict[str, str]) -> None:
    """Which colour is which, where North is and how long a metre, in the frame's column right of the walk."""
    known = [(name, text) for name, text in legend.items() if f"map/{name}/path" in rrd.entities]
    known += [("smoothed", f"ellipses: {_SIGMAS:g}σ")] * ("map/smoothed/ellipses" in rrd.entities)
    known += [("truth", "truth")] * ("map/truth/path" in rrd.entities)
    known += [("anchor", "anchor")] * ("map/anchors" in rrd.entities)
    known += [("anchor", "closed walk")] * ("map/smoothed/closure" in rrd.entities)
    row_m = frame.row_m
    rows = np.array([(frame.legend_x_m, frame.y_max_m - row_m * i) for i in range(len(known) + 3)])
    rrd.fixed(
        "map/legend/colors",
        rr.Points2D(
            rows[: len(known)],
            colors=[COLORS[name] for name, _ in known],
            labels=[text for _, text in known],
            radii=rr.Radius.ui_points(5.0),
        ),
    )
    length_m = frame.scale_bar_m
    bar = rows[-2] + np.array([[-0.5, 0.0], [0.5, 0.0]]) * length_m
    grey = [COLORS["truth"]]
    radii = rr.Radius.ui_points(1.5)
    rrd.fixed("map/legend/scale", rr.LineStrips2D([bar], colors=grey, radii=radii, labels=[f"{length_m:g} m"]))
    north = rr.Arrows2D(
        origins=[rows[-1] - (0.0, 0.5 * row_m)], vectors=[(0.0, row_m)], colors=grey, radii=radii, labels=["North"]
    )
    rrd.fixed("map/legend/north", north)


def _errors(result: WalkResult) -> dict[str, tuple[FloatArray, FloatArray]]:
    """By estimator: times and horizontal errors at the truth's checkpoints, aligned as in scoring."""
    if result.truth is None:
        return {}
    t_s = result.truth.t_s - result.log.t0_s
    errors = {}
    for name, trajectory in _ordered(result):
        _, alignment = score_label(name, result.anchors is not None, result.closed_walk)
        try:
            error_m = checkpoint_errors(trajectory, result.truth, result.log.t0_s, alignment)
        except DataError:  # truth of another log; who scores complains, the recording shows what there is
            continue
        errors[name] = (t_s[len(t_s) - len(error_m) :], error_m)
    return errors


def _legend(result: WalkResult, errors: dict[str, tuple[FloatArray, FloatArray]]) -> dict[str, str]:
    """By estimator: what the map's legend says of it."""
    texts = {}
    for name, _ in _ordered(result):
        texts[name] = LABELS[name]
        if name in errors:
            label, _ = score_label(name, result.anchors is not None, result.closed_walk)
            aid = "" if label == "unaided" else f" ({label})"
            texts[name] += f"{aid}: {np.sqrt((errors[name][1] ** 2).mean()):.1f} m RMSE"
    return texts


def _ordered(result: WalkResult) -> list[tuple[str, Trajectory]]:
    """The trajectories that were run, the smoothed one last, so that it is drawn on top."""
    names = sorted(result.trajectories, key=lambda name: (name == "smoothed", ESTIMATORS.index(name)))
    return [(name, result.trajectories[name]) for name in names]


def _xyz(trajectory: Trajectory) -> FloatArray:
    """(K+1, 3) positions."""
    return np.column_stack((trajectory.x_m, trajectory.y_m, trajectory.z_m))


def _laps(yaw_rad: FloatArray) -> FloatArray:
    """(N,) whole turns to take off, lest laps add up and flatten the plot; changed as rarely as keeps within ±270°."""
    laps = [float(np.round(yaw_rad[0] / (2.0 * np.pi)))]
    for turns in (yaw_rad[1:] / (2.0 * np.pi)).tolist():
        laps.append(laps[-1] if abs(turns - laps[-1]) < 0.75 else float(round(turns)))
    return np.array(laps)


def _band(values: FloatArray, sigma: FloatArray) -> FloatArray:
    """(N, 2) lower and upper end."""
    return np.column_stack((values - _SIGMAS * sigma, values + _SIGMAS * sigma))


def _truth_places(result: WalkResult) -> FloatArray:
    """(M, 3) checkpoints, moved (not turned) as in scoring: the smoothed trajectory agrees at the first of them.

    Known anchors have already brought the trajectory into their frame; then they stay. Surveyed heights are rarely
    on the barometer's datum, and floors are no metres: each is shown at the height of the trajectory.
    """
    assert result.truth is not None  # the caller asked
    at = result.smoothed.trajectory.at(result.truth.t_s - result.log.t0_s)
    shift = np.zeros(2) if result.anchors is not None else at[0, :2] - result.truth.xy_m[0]
    return np.column_stack((result.truth.xy_m + shift, at[:, 2]))


def _grouped(places: FloatArray) -> tuple[FloatArray, list[str] | None]:
    """Places passed more than once as one, labelled with all their numbers: labels at one spot hide each other.

    Truth so dense that its labels would cover the walk has none.
    """
    if len(places) > _MOST_LABELS:
        return places, None
    groups: list[list[int]] = []
    for i, place in enumerate(places):
        for group in groups:
            away = np.abs(place - places[group[0]])
            if np.hypot(*away[:2]) < _SAME_PLACE_M and away[2] < _SAME_FLOOR_M:
                group.append(i)
                break
        else:
            groups.append([i])
    return places[[group[0] for group in groups]], [", ".join(str(i + 1) for i in group) for group in groups]


def _ellipses(trajectory: Trajectory) -> list[FloatArray]:
    """Ellipses of the horizontal covariance at breadcrumbs evenly along the walk, each (P, 3) and closed."""
    assert trajectory.cov_xy_yaw is not None  # the caller asked
    every = max(len(trajectory) // _ELLIPSES, 1)
    chosen = np.arange(len(trajectory) - 1, 0, -every)
    # with P = L Lᵀ, L turns and stretches a circle into the ellipse; the first breadcrumb's P is almost nothing
    root = np.linalg.cholesky(trajectory.cov_xy_yaw[chosen, :2, :2] + 1e-9 * np.eye(2))
    angle = np.linspace(0.0, 2.0 * np.pi, _ELLIPSE_POINTS)
    outline = _SIGMAS * np.einsum("nij,jp->npi", root, np.array((np.cos(angle), np.sin(angle))))
    height = np.zeros((*outline.shape[:2], 1))
    return list(_xyz(trajectory)[chosen, None, :] + np.concatenate((outline, height), axis=2))
