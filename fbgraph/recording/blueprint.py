"""How a recording opens in Rerun: tabs by question, the first of them enough to understand the walk."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb

from fbgraph.core.geometry import FloatArray

_MARGIN = 0.06  # of the walk's size, around it
_LEGEND_WIDTH = 0.32  # of the walk's size, right of it
_EQUATOR_M_PER_PIXEL = 156543.03  # of a Web Mercator map at zoom 0
_LEGEND_ROWS = 13  # to the walk's size: far enough apart for labels on a laptop's screen


@dataclass(frozen=True)
class Frame:
    """The part of the plane that the map opens on: the walk and, with ``legend``, a column for one; metres."""

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float
    lat_deg: float = 0.0
    legend: bool = True

    @staticmethod
    def around(xy_m: FloatArray, lat_deg: float = 0.0) -> Frame:
        """The frame of (N, 2) places; not smaller than a room. ``lat_deg`` is where on the globe."""
        low, high = xy_m.min(axis=0), xy_m.max(axis=0)
        grow = np.maximum(4.0 - (high - low), 0.0) / 2.0
        (x_min, y_min), (x_max, y_max) = low - grow, high + grow
        return Frame(float(x_min), float(x_max), float(y_min), float(y_max), lat_deg)

    @property
    def size_m(self) -> float:
        """The longer side."""
        return max(self.x_max_m - self.x_min_m, self.y_max_m - self.y_min_m)

    @property
    def legend_x_m(self) -> float:
        """Middle of the legend's column."""
        return self.x_max_m + 0.55 * _LEGEND_WIDTH * self.size_m

    @property
    def row_m(self) -> float:
        """Distance that keeps one label off the next."""
        return self.size_m / _LEGEND_ROWS

    @property
    def scale_bar_m(self) -> float:
        """A round length of up to a sixth of the walk's size."""
        power = 10.0 ** np.floor(np.log10(self.size_m / 6.0))
        return float(power * max(m for m in (1, 2, 5) if m * power <= self.size_m / 6.0))

    @property
    def zoom(self) -> float:
        """Of a Web Mercator map on which the walk fills about 600 pixels."""
        m_per_pixel = self.size_m / 600.0
        return float(np.log2(_EQUATOR_M_PER_PIXEL * np.cos(np.radians(self.lat_deg)) / m_per_pixel))

    @property
    def bounds(self) -> rrb.VisualBounds2D:
        """For a view with y down, as Rerun's are."""
        margin, legend = _MARGIN * self.size_m, _LEGEND_WIDTH * self.size_m * self.legend
        return rrb.VisualBounds2D(
            x_range=(self.x_min_m - margin, self.x_max_m + margin + legend),
            y_range=(-self.y_max_m - margin, -self.y_min_m + margin),
        )


def blueprint(entities: Collection[str], frame: Frame | None = None, active_tab: int = 0) -> rrb.Blueprint:
    """The arrangement of views.

    Args:
        entities: paths that were written; views of what is not there are left out.
        frame: what the map shows; all there is if None.
        active_tab: which tab is open.
    """
    return arranged(rrb.Tabs(*question_tabs(entities, frame), active_tab=active_tab))


def arranged(root: rrb.Tabs) -> rrb.Blueprint:
    """The whole window: no panels, the cursor at the end of the walk, which it follows while it goes on."""
    return rrb.Blueprint(
        root,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="following"),
    )


def question_tabs(
    entities: Collection[str], frame: Frame | None, root: str = "", narrow: bool = False
) -> list[rrb.Container]:
    """One tab a question.

    Args:
        entities: as in ``blueprint``.
        frame: as in ``blueprint``.
        root: path below which all entities lie, ``/name``.
        narrow: to fit beside others.
    """

    def there(*prefixes: str) -> list[str]:
        """Query expressions of what was written below these paths."""
        return [f"{root}/{p}/**" for p in prefixes if any(e == p or e.startswith(f"{p}/") for e in entities)]

    def curves(name: str, *prefixes: str, without: Sequence[str] = ()) -> list[rrb.View]:
        """A view of what was written below these paths; none if nothing was."""
        if not (contents := there(*prefixes)):
            return []
        contents += [f"- {root}/{p}/**" for p in without]
        return [
            rrb.TimeSeriesView(
                name=name, origin="/", contents=contents, axis_x=_whole_time(), plot_legend=rrb.Corner2D.LeftTop
            )
        ]

    # functions, for a view that is in two places must be two views
    def text(name: str, entity: str) -> list[rrb.View]:
        return [rrb.TextDocumentView(name=name, origin=f"{root}/{entity}")] if entity in entities else []

    def lanes() -> list[rrb.View]:
        name = "What happened when"
        return [rrb.StateTimelineView(name=name, origin=f"{root}/lanes", time_view=_whole_time())] * bool(
            there("lanes")
        )

    def plan(name: str, contents: list[str]) -> rrb.View:
        bounds = None if frame is None else frame.bounds
        return rrb.Spatial2DView(name=name, origin=root or "/", contents=contents, visual_bounds=bounds)

    def error() -> list[rrb.View]:
        return curves(
            "Horizontal error at checkpoints, and 2σ of the smoothed position [m]", "error_m", "uncertainty_m"
        )

    def sure() -> list[rrb.View]:
        return curves("How sure: 2σ of the smoothed position [m]", "uncertainty_m")

    def heading() -> list[rrb.View]:
        return curves("Heading, counter-clockwise from East [°]", "state/yaw_deg")

    def stacked(name: str, *rows: tuple[float, list[rrb.View]]) -> rrb.Container:
        """One above the other, each with its share of the height; rows without a view are left out."""
        there = [(share, view) for share, views in rows for view in views]
        return rrb.Vertical(*(view for _, view in there), row_shares=[share for share, _ in there], name=name)

    def quartet(name: str, *views: list[rrb.View]) -> rrb.Container:
        """What happened when above up to four curves, two by two: high enough to read values off."""
        if narrow:
            return stacked(name, (1.4, lanes()), *((2, view) for view in views))
        grid = rrb.Grid(*(view for some in views for view in some), grid_columns=2)
        return rrb.Vertical(*lanes(), grid, row_shares=[1.3, 5][-1 - len(lanes()) :], name=name)

    def legs(what: str, name: str) -> list[rrb.View]:
        return curves(name, f"legs/{what}")

    truth = bool(there("error_m"))
    shares = (3, 1.5, 2) if "summary" in entities else (1, 2)
    beside = [*text("Summary", "summary"), *lanes(), *(error() if truth else sure() or heading())]
    shown = [f"{root}/map/**", f"- {root}/map/believed/**", f"- {root}/map/return/**"]
    walk = plan("Map, North up", shown)
    if narrow:
        first = stacked("The walk", (5, [walk]), *zip((2, 1.4, 2.4), ([view] for view in beside), strict=False))
    else:
        column = rrb.Vertical(*beside, row_shares=list(shares[: len(beside)]))
        first = rrb.Horizontal(walk, column, column_shares=[5, 3], name="The walk")
    result = [
        first,
        quartet(
            "Did heading go wrong?",
            heading(),
            curves("Compass minus smoothed heading, and what was expected [°]", "state/magnetic_disturbance_deg"),
            curves("Gyroscope bias about the vertical [°/s]", "state/gyro_bias_deg_s"),
            curves("Magnetic field: strength [µT], dip [°]", "state/field"),
        ),
        quartet(
            "Did steps go wrong?",
            curves("Steps found [m/s²]", "steps", "state/acc_norm_m_s2"),
            curves("Step length [m]", "state/step_length_m"),
            curves("Step frequency [Hz]", "state/step_frequency_hz"),
            legs("length_percent", "Error of length, straight from checkpoint to checkpoint [%]"),
        ),
    ]
    if altitude := curves("Altitude above the start [m]", "state/altitude_m"):
        result.append(rrb.Vertical(*altitude, name="Altitude"))
    if truth:
        beside = [*legs("length_percent", "Error of length, straight from checkpoint to checkpoint [%]")]
        beside += legs("direction_deg", "Error of direction, straight from checkpoint to checkpoint [°]")
        result.append(rrb.Vertical(*error(), *beside, name="Error"))
    if there("map/believed"):
        name = (
            "The online path as it was believed at the time of the cursor (purple), and as smoothed in the end (green)"
        )
        drawn = ("believed/**", "return/match", "online/position", "smoothed/path", "smoothed/ends")
        contents = [f"{root}/map/{what}" for what in drawn]
        contents += [f"{root}/map/truth/**", f"{root}/map/legend/scale", f"{root}/map/legend/north", f"{root}/map"]
        result.append(rrb.Horizontal(plan(name, contents), name="While walking"))
    if there("map/return"):
        name = "The way back, its turns numbered as in the list"
        known = [f"{root}/map/return/**", f"{root}/map/smoothed/ends", f"{root}/map/legend/north", f"{root}/map"]
        told = "return/told" in entities
        live = [rrb.TextLogView(name="Told while walking back", origin=f"{root}/return/told", columns=_texts())] * told
        right = rrb.Vertical(
            *text("How to go", "return/instructions"),
            *live,
            *curves("Left to the start [m]", "return/remaining_m"),
            *curves("Beside the route, to its left [m]", "return/cross_track_m"),
        )
        result.append(rrb.Horizontal(plan(name, known), right, column_shares=[5, 3], name="The way back"))
    if there("residuals"):
        weights = curves("Share of its pull that the robust loss left each factor", "weights")
        trust = curves("The compass: the same, less what the disturbed field took", "state/compass_trust")
        residuals = curves("Residuals: estimate minus measurement [σ]", "residuals")
        solver = [rrb.BarChartView(name="Error by iteration, log10", origin=f"{root}/solver/log10_error")]
        result.append(
            rrb.Horizontal(
                rrb.Vertical(*residuals, *weights, *trust),
                rrb.Vertical(*text("The graph", "graph"), *solver, row_shares=[3, 1]),
                column_shares=[5, 3],
                name="The graph",
            )
        )
    result.append(rrb.Horizontal(_space_view(frame, f"{root}/world"), name="3-D"))
    if there("geo"):
        zoom = None if frame is None else frame.zoom
        globe = rrb.MapView(
            name="On the globe, North up (the map behind it comes from the internet)", origin=f"{root}/geo", zoom=zoom
        )
        result.append(rrb.Horizontal(globe, name="On the globe"))
    result.append(
        rrb.Vertical(
            *curves("Accelerometer [m/s²]", "sensors/acc"),
            *curves("Gyroscope [rad/s]", "sensors/gyro"),
            *curves("Magnetometer [µT]", "sensors/mag"),
            *curves("Air pressure [hPa]", "sensors/pressure"),
            name="Raw sensors",
        )
    )
    log = (
        [rrb.TextLogView(name="Events of the log", origin=f"{root}/events", columns=_texts())]
        if "events" in entities
        else []
    )
    if summary := text("Summary", "summary"):
        result.append(rrb.Horizontal(*summary, *log, name="Summary"))
    return result


def _texts() -> rrb.TextLogColumns:
    """Of a log: when, and what."""
    return rrb.TextLogColumns(timeline_columns=["time"], text_log_columns=["Body"])


def _whole_time() -> rrb.TimeAxis:
    infinite = rrb.TimeRangeBoundary.infinite()
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=infinite, end=infinite))


def _space_view(frame: Frame | None, origin: str) -> rrb.View:
    """The walk in space, seen from the South and above."""
    name = "3-D, seen from the South"
    contents = [f"{origin}/**", f"- {origin}/return/**", f"- {origin}/events/**", f"- {origin}/smoothed/times/**"]
    if frame is None:
        return rrb.Spatial3DView(name=name, origin=origin, contents=contents)
    middle = np.array([(frame.x_min_m + frame.x_max_m) / 2.0, (frame.y_min_m + frame.y_max_m) / 2.0, 0.0])
    return rrb.Spatial3DView(
        name=name,
        origin=origin,
        contents=contents,
        eye_controls=rrb.EyeControls3D(
            position=middle + frame.size_m * np.array([0.0, -0.8, 0.75]), look_target=middle, eye_up=(0.0, 0.0, 1.0)
        ),
    )
