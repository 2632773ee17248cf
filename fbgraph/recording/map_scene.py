"""The walk in space, on the map and on the globe, as it is logged to Rerun.

``world/…`` in space (x East, y North, z up, metres), ``map/…`` the same in the plane, ``geo/…`` on the globe where
somebody knows where that is. Rerun's 2-D views have y down, so a transform at ``map`` turns North up again.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import rerun as rr

from fbgraph.core.checkpoints import anchor_breadcrumbs
from fbgraph.core.colors import COLORS, LABELS
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.safe_text import short_name
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.estimates import Belief
from fbgraph.recording.map_frame import MOST_LABELS, Frame
from fbgraph.recording.writer import RrdWriter
from fbgraph.run.scores import score_label
from fbgraph.run.timeline_lanes import DOUBTED, compass_lane
from fbgraph.run.walk_result import ESTIMATORS, WalkResult
from fbgraph.way_back.legs import Directions
from fbgraph.way_back.records import ReturnUpdate

SIGMAS = 2.0  # of ellipses and bands
FAINT = 110  # opacity, of 255, of bands and ellipses
_ELLIPSES = 10  # about so many along a walk; more hide each other
_ELLIPSE_POINTS = 33
_SAME_PLACE_M = 0.5  # checkpoints closer than this share a label ...
_SAME_FLOOR_M = 2.0  # ... unless one lies on another floor
_SETTLED_POINTS = 1000  # of the part of a belief that no longer moves
_WIDTHS = {"smoothed": 2.0}
_WIDTH = 1.2


def draw_axes(rrd: RrdWriter) -> None:
    """The axes."""
    rrd.fixed("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    rrd.fixed("map", rr.Transform3D(scale=(1.0, -1.0, 1.0)))


def draw_path(
    rrd: RrdWriter, name: str, trajectory: Trajectory, first: int = 0, shift_m: FloatArray | None = None
) -> None:
    """A trajectory as it is known now, and where it was at each breadcrumb from ``first`` on.

    Args:
        rrd: where to.
        name: of the estimator.
        trajectory: its breadcrumbs.
        first: index of the first one that was not logged before.
        shift_m: (3,) added to all of them.
    """
    places = xyz(trajectory) + (0.0 if shift_m is None else shift_m)
    rrd.lines(f"{name}/path", [places], COLORS[name], _WIDTHS.get(name, _WIDTH))
    rrd.moving_point(f"{name}/position", trajectory.t_s[first:], places[first:], COLORS[name], 7.0)


class Beliefs:
    """The online trajectory as it was believed at each moment: what still moves, and what is settled."""

    def __init__(self) -> None:
        self._settled = np.empty((0, 2))
        self._last: Belief | None = None
        self._kept: list[Belief] = []

    def add(self, rrd: RrdWriter, beliefs: Sequence[Belief]) -> None:
        """Log the next ones."""
        if not beliefs:
            return
        self._kept += beliefs
        settled: list[tuple[float, FloatArray]] = []
        for belief in beliefs:
            if self._last is not None and belief.first > self._last.first:
                left = self._last.xy_m[: belief.first - self._last.first + 1]
                self._settled = np.concatenate((self._settled, left))
                every = -(-len(self._settled) // _SETTLED_POINTS)
                settled.append((belief.t_s, self._settled[::-1][::every][::-1]))
            self._last = belief
        t_s = np.array([belief.t_s for belief in beliefs])
        rrd.moving_line("believed/moving", t_s, [belief.xy_m for belief in beliefs], COLORS["online"], 2.0)
        if settled:
            times, strips = zip(*settled, strict=True)
            faint = (*COLORS["online"], FAINT)
            rrd.moving_line("believed/settled", np.array(times), strips, faint, 2.0)

    def finish(self, rrd: RrdWriter, smoothed: Trajectory) -> None:
        """Log the finished walk as the last belief."""
        if self._last is None:
            return
        quarter = max(len(self._kept) // 4, 1)
        for part, belief in enumerate(self._kept[quarter::quarter][:3]):
            radii, colors = rr.Radius.ui_points(1.0), [(*COLORS["online"], FAINT)]
            minutes, seconds = divmod(round(belief.t_s), 60)
            label = f"believed at {minutes}:{seconds:02d}"
            strip = rr.LineStrips2D([belief.xy_m], colors=colors, radii=radii, labels=[label])
            rrd.fixed(f"map/believed/earlier/{part + 1}", strip)
        end_s = smoothed.t_s[-1:] + 1e-3
        rrd.moving_line("believed/moving", end_s, [smoothed.xy_m], COLORS["online"], 2.0)
        if len(self._settled):
            rrd.moving_line("believed/settled", end_s, [smoothed.xy_m[:2]], (*COLORS["online"], FAINT), 2.0)


def draw_finished(rrd: RrdWriter, result: WalkResult, scores: dict[str, float]) -> Frame:
    """What is known once a walk is over; returns what the map must show.

    Args:
        rrd: where to.
        result: the walk.
        scores: RMSE in metres by estimator, for the legend.
    """
    smoothed = result.smoothed.trajectory
    places = xyz(smoothed)
    seen = [places]
    if result.told.truth is not None and len(result.told.truth):
        known = truth_places(result)
        dense = len(known) > MOST_LABELS  # a track rather than checkpoints
        rrd.lines("truth/path", [known], COLORS["truth"], 2.0 if dense else 1.0)
        if not dense:
            rrd.points("truth/checkpoints", *_grouped(known), COLORS["truth"], 5.0)
        seen.append(known)
    for name, trajectory in ordered(result):
        shift_m = _shift_m(result, name)
        draw_path(rrd, name, trajectory, len(trajectory) if f"map/{name}/path" in rrd.entities else 0, shift_m)
        seen.append(xyz(trajectory) + shift_m)
    rrd.points("smoothed/breadcrumbs", places, None, COLORS["smoothed"], 2.5)
    if smoothed.cov_xy_yaw is not None:
        ellipses = _ellipses(smoothed)
        rrd.lines("smoothed/ellipses", ellipses, (*COLORS["smoothed"], FAINT), 0.7)
        seen += ellipses
    doubted = _stretches_where(compass_lane(result), DOUBTED, smoothed)
    if doubted:
        rrd.lines("smoothed/compass_doubted", doubted, COLORS["sensor"], 5.0)
    if result.smoothed.closures:
        edges = [places[[closure.j, closure.i]] for closure in result.smoothed.closures]
        rrd.lines("closures", edges, COLORS["closure"], 2.0)
    if result.told.closed_walk:
        rrd.lines("smoothed/closed_walk", [places[[-1, 0]]], COLORS["anchor"], 3.0)
        rrd.points("smoothed/closed_end", places[[0]], None, COLORS["anchor"], 8.0)
    _times(rrd, smoothed)
    _events(rrd, result)
    anchors = result.aids.anchors
    if anchors is not None and len(anchors):
        crumbs = anchor_breadcrumbs(anchors, result.track.t_s)
        fixes = np.column_stack((anchors.xy_m, smoothed.z_m[crumbs]))
        rrd.points("anchors/places", fixes, None, COLORS["anchor"], 8.0)  # a ring about a checkpoint
        edges = [np.array(ends) for ends in zip(fixes, places[crumbs], strict=True)]
        rrd.lines("anchors/edges", edges, COLORS["anchor"], 1.5)
        seen.append(fixes)
    where = result.georeference
    frame = Frame.around(np.concatenate(seen)[:, :2], 0.0 if where is None else where.lat_deg)
    _ends(rrd, places, frame)
    _legend(rrd, frame, scores, result)
    _globe(rrd, result)
    return frame


def draw_way_back(rrd: RrdWriter, back: Directions) -> None:
    """The legs of the way back, its turns numbered as in its instructions."""
    legs = [np.array(leg.points_m) for leg in back.legs]
    rrd.lines("return/legs", legs, COLORS["return"], 2.0)
    corners = np.array([*(leg[0] for leg in legs), legs[-1][-1]])
    labels = [str(number) for number in range(1, len(corners) + 1)]
    rrd.points("return/turns", corners, labels, COLORS["truth"], 6.0)


def draw_matches(rrd: RrdWriter, updates: Sequence[ReturnUpdate], online: Trajectory) -> None:
    """From where the wearer was believed to be to the breadcrumb of the way out that this is."""
    t_s = np.array([update.t_s for update in updates])
    strips = [online.xy_m[[update.k, update.breadcrumb]] for update in updates]
    rrd.moving_line("return/match", t_s, strips, COLORS["anchor"], 2.0)


def ordered(result: WalkResult) -> list[tuple[str, Trajectory]]:
    """The trajectories that were run, the smoothed one last, so that it is drawn on top."""
    names = sorted(result.trajectories, key=lambda name: (name == "smoothed", ESTIMATORS.index(name)))
    return [(name, result.trajectories[name]) for name in names]


def xyz(trajectory: Trajectory) -> FloatArray:
    """(K+1, 3) positions."""
    return np.column_stack((trajectory.x_m, trajectory.y_m, trajectory.z_m))


def truth_places(result: WalkResult) -> FloatArray:
    """(M, 3) checkpoints, moved (not turned) as in scoring.

    Surveyed heights are rarely on the barometer's datum, and floors are no metres: each is shown at the height of the
    trajectory.
    """
    assert result.told.truth is not None  # the caller asked
    z_m = result.smoothed.trajectory.at(result.told.truth.t_s - result.log.t0_s)[:, 2]
    return np.column_stack((result.told.truth.xy_m + result.truth_shift_m, z_m))


def _shift_m(result: WalkResult, name: str) -> FloatArray:
    """(3,) what brings a trajectory to the smoothed one's start, if anchors took that one away from the origin."""
    if result.told.anchors is None or name == "smoothed":
        return np.zeros(3)
    return np.asarray(xyz(result.smoothed.trajectory)[0] - xyz(result.trajectories[name])[0])


def _stretches_where(lane: list[tuple[float, str | None]], state: str, trajectory: Trajectory) -> list[FloatArray]:
    """(N, 3) pieces of the trajectory walked while a lane was in this state."""
    pieces = []
    for (start_s, known), (end_s, _) in itertools.pairwise(lane):
        if known == state:
            inside = trajectory.t_s[(trajectory.t_s > start_s) & (trajectory.t_s < end_s)]
            pieces.append(trajectory.at(np.concatenate(([start_s], inside, [end_s]))))
    return pieces


def _times(rrd: RrdWriter, trajectory: Trajectory) -> None:
    """When the walk passed the middles of its ellipses."""
    chosen = _marked(trajectory)
    minutes, seconds = np.divmod(np.round(trajectory.t_s[chosen]).astype(int), 60)
    labels = [f"{m}:{s:02d}" for m, s in zip(minutes, seconds, strict=True)]
    rrd.points("smoothed/times", xyz(trajectory)[chosen], labels, COLORS["smoothed"], 3.5)


def _events(rrd: RrdWriter, result: WalkResult) -> None:
    """Where the walk was when the log marked something."""
    events = [event for event in result.log.events if event.label.strip()]
    if not 0 < len(events) <= MOST_LABELS:
        return
    places = result.smoothed.trajectory.at(np.array([event.t_s for event in events]))
    rrd.points("events", places, [f"“{short_name(event.label)}”" for event in events], COLORS["event"], 4.0)


def _ends(rrd: RrdWriter, places: FloatArray, frame: Frame) -> None:
    """Flags at the ends of the walk, on poles that lean apart: they would hide each other and the checkpoints."""
    labels, colors, radii = ["start", "end"], [COLORS["smoothed"]], rr.Radius.ui_points(1.0)
    lean, rise = 0.9 * frame.row_m, 0.75 * frame.row_m
    # a label is put at the mean of its strip's points: three of four are the top of the pole
    grow = np.array((0.0, 1.0, 1.0, 1.0))[:, None]
    poles = [foot + grow * (side * lean, 0.0, rise) for foot, side in ((places[0], -1.0), (places[-1], 1.0))]
    rrd.fixed("world/smoothed/ends", rr.LineStrips3D(poles, labels=labels, colors=colors, radii=radii))
    flat = [foot[:2] + grow * (side * lean, rise) for foot, side in ((places[0], -1.0), (places[-1], 1.0))]
    rrd.fixed("map/smoothed/ends", rr.LineStrips2D(flat, labels=labels, colors=colors, radii=radii))


def _legend(rrd: RrdWriter, frame: Frame, scores: dict[str, float], result: WalkResult) -> None:
    """Which colour is which, where North is and how long a metre, in the frame's column right of the walk."""
    known = []
    for name, _ in ordered(result):
        text = LABELS[name]
        if name in scores:
            label, _ = score_label(name, *result.told.modes)
            text += f"{'' if label == 'unaided' else f' ({label})'}: {scores[name]:.1f} m RMSE"
        known.append((name, text))
    extras = (
        ("smoothed/ellipses", "smoothed", f"ellipses: {SIGMAS:g}σ"),
        ("truth/path", "truth", "truth"),
        ("smoothed/times", "smoothed", "time, min:s"),
        ("smoothed/compass_doubted", "sensor", "compass doubted"),
        ("anchors/places", "anchor", "anchor"),
        ("smoothed/closed_walk", "anchor", "closed walk"),
        ("closures", "closure", "closure"),
        ("events", "event", "event of the log"),
    )
    known += [(color, text) for entity, color, text in extras if f"map/{entity}" in rrd.entities]
    count = len(known) + 3
    row_m = min(frame.row_m, frame.size_m / count)
    # beside the walk, or about its middle if that is flatter than the legend
    top_m = max(frame.y_max_m, (frame.y_min_m + frame.y_max_m + row_m * count) / 2.0)
    rows = np.array([(frame.legend_x_m, top_m - row_m * i) for i in range(count)])
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


def _globe(rrd: RrdWriter, result: WalkResult) -> None:
    """Paths and truth in latitude and longitude, if anybody knows where the walk was."""
    where = result.georeference
    if where is None:
        return
    for name, trajectory in ordered(result):
        lines = where.geodetic_deg(trajectory.xy_m + _shift_m(result, name)[:2])
        radii = rr.Radius.ui_points(2.0 * _WIDTHS.get(name, _WIDTH))
        rrd.fixed(f"geo/{name}/path", rr.GeoLineStrings(lat_lon=[lines], colors=[COLORS[name]], radii=radii))
    end = where.geodetic_deg(result.smoothed.trajectory.xy_m[-1:])
    radii = rr.Radius.ui_points(8.0)
    rrd.fixed("geo/smoothed/end", rr.GeoPoints(lat_lon=end, colors=[COLORS["smoothed"]], radii=radii))
    if result.told.truth is not None and len(result.told.truth):
        known = where.geodetic_deg(truth_places(result)[:, :2])
        radii = rr.Radius.ui_points(5.0)
        rrd.fixed("geo/truth/checkpoints", rr.GeoPoints(lat_lon=known, colors=[COLORS["truth"]], radii=radii))


def _grouped(places: FloatArray) -> tuple[FloatArray, list[str] | None]:
    """Places passed more than once as one, labelled with all their numbers: labels at one spot hide each other.

    Truth so dense that its labels would cover the walk has none.
    """
    if len(places) > MOST_LABELS:
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


def _marked(trajectory: Trajectory) -> IntArray:
    """Indices of breadcrumbs evenly along the walk, the last one among them."""
    return np.arange(len(trajectory) - 1, 0, -max(len(trajectory) // _ELLIPSES, 1))


def _ellipses(trajectory: Trajectory) -> list[FloatArray]:
    """Ellipses of the horizontal covariance at breadcrumbs evenly along the walk, each (P, 3) and closed."""
    assert trajectory.cov_xy_yaw is not None  # the caller asked
    chosen = _marked(trajectory)
    # with P = L Lᵀ, L turns and stretches a circle into the ellipse; the first breadcrumb's P is almost nothing
    root = np.linalg.cholesky(trajectory.cov_xy_yaw[chosen, :2, :2] + 1e-9 * np.eye(2))
    angle = np.linspace(0.0, 2.0 * np.pi, _ELLIPSE_POINTS)
    outline = SIGMAS * np.einsum("nij,jp->npi", root, np.array((np.cos(angle), np.sin(angle))))
    height = np.zeros((*outline.shape[:2], 1))
    return list(xyz(trajectory)[chosen, None, :] + np.concatenate((outline, height), axis=2))
