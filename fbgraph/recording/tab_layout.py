"""The tabs of a recording in Rerun: which views each question needs, and where they stand."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb

from fbgraph.recording.map_frame import Frame


def question_tabs(
    entities: Collection[str], frame: Frame | None, root: str = "", narrow: bool = False
) -> list[rrb.Container]:
    """One tab a question; a question to which nothing was written has none.

    Args:
        entities: paths that were written; views of what is not there are left out.
        frame: what the map shows; all there is if None.
        root: path below which all entities lie, ``/name``.
        narrow: to fit beside others.
    """
    tabs = _QuestionTabs(entities, frame, root, narrow)
    return [
        *tabs.walk(),
        *tabs.heading(),
        *tabs.steps(),
        *tabs.altitude(),
        *tabs.error(),
        *tabs.while_walking(),
        *tabs.way_back(),
        *tabs.graph(),
        *tabs.space(),
        *tabs.globe(),
        *tabs.raw_sensors(),
        *tabs.summary(),
    ]


@dataclass(frozen=True)
class _Views:
    """Views of what was written; each call makes new ones, for a view that is in two places must be two views."""

    entities: Collection[str]
    frame: Frame | None
    root: str
    narrow: bool

    def there(self, *prefixes: str) -> list[str]:
        """Query expressions of what was written below these paths."""
        entities = self.entities
        return [f"{self.root}/{p}/**" for p in prefixes if any(e == p or e.startswith(f"{p}/") for e in entities)]

    def curves(self, name: str, *prefixes: str) -> list[rrb.View]:
        """A view of what was written below these paths; none if nothing was."""
        if not (contents := self.there(*prefixes)):
            return []
        return [
            rrb.TimeSeriesView(
                name=name, origin="/", contents=contents, axis_x=_whole_time(), plot_legend=rrb.Corner2D.LeftTop
            )
        ]

    def text(self, name: str, entity: str) -> list[rrb.View]:
        """A text; none if it was not written."""
        return [rrb.TextDocumentView(name=name, origin=f"{self.root}/{entity}")] if entity in self.entities else []

    def told(self, name: str, entity: str) -> list[rrb.View]:
        """What was said when; none if nothing was."""
        view = rrb.TextLogView(name=name, origin=f"{self.root}/{entity}", columns=_texts())
        return [view] if entity in self.entities else []

    def lanes(self) -> list[rrb.View]:
        """Who did what when; none if nothing was written of it."""
        name = "What happened when"
        view = rrb.StateTimelineView(name=name, origin=f"{self.root}/lanes", time_view=_whole_time())
        return [view] if self.there("lanes") else []

    def plan(self, name: str, contents: list[str]) -> rrb.View:
        """The map, with these contents."""
        bounds = None if self.frame is None else self.frame.bounds
        return rrb.Spatial2DView(name=name, origin=self.root or "/", contents=contents, visual_bounds=bounds)

    def quartet(self, name: str, *views: list[rrb.View]) -> rrb.Container:
        """What happened when above up to four curves, two by two: high enough to read values off."""
        if self.narrow:
            return _stacked(name, (1.4, self.lanes()), *((2, view) for view in views))
        grid, lanes = rrb.Grid(*(view for some in views for view in some), grid_columns=2), self.lanes()
        return rrb.Vertical(*lanes, grid, row_shares=[1.3, 5][-1 - len(lanes) :], name=name)

    def error_curves(self) -> list[rrb.View]:
        """Errors where truth is known, beside what was expected of them."""
        return self.curves(
            "Horizontal error at checkpoints, and 2σ of the smoothed position [m]", "error_m", "uncertainty_m"
        )

    def length_errors(self) -> list[rrb.View]:
        """Of the legs between checkpoints."""
        return self.curves("Error of length, straight from checkpoint to checkpoint [%]", "legs/length_percent")

    def heading_curves(self) -> list[rrb.View]:
        """Of every estimator, and the compass."""
        return self.curves("Heading, counter-clockwise from East [°]", "state/yaw_deg")


class _QuestionTabs(_Views):
    """Every method is a tab: a list of one container, or of none where nothing was written for it."""

    def walk(self) -> list[rrb.Container]:
        """The map, with the summary, what happened when, and how sure or how wrong."""
        shares = (3, 1.5, 2) if "summary" in self.entities else (1, 2)
        if self.there("error_m"):
            quality = self.error_curves()
        else:
            quality = self.curves("How sure: 2σ of the smoothed position [m]", "uncertainty_m") or self.heading_curves()
        beside = [*self.text("Summary", "summary"), *self.lanes(), *quality]
        root = self.root
        shown = [f"{root}/map/**", f"- {root}/map/believed/**", f"- {root}/map/return/**"]
        walk = self.plan("Map, North up", shown)
        if self.narrow:
            rows = zip((2, 1.4, 2.4), ([view] for view in beside), strict=False)
            return [_stacked("The walk", (5, [walk]), *rows)]
        column = rrb.Vertical(*beside, row_shares=list(shares[: len(beside)]))
        return [rrb.Horizontal(walk, column, column_shares=[5, 3], name="The walk")]

    def heading(self) -> list[rrb.Container]:
        """Heading, compass, gyroscope bias, magnetic field."""
        return [
            self.quartet(
                "Did heading go wrong?",
                self.heading_curves(),
                self.curves(
                    "Compass minus smoothed heading, and what was expected [°]", "state/magnetic_disturbance_deg"
                ),
                self.curves("Gyroscope bias about the vertical [°/s]", "state/gyro_bias_deg_s"),
                self.curves("Magnetic field: strength [µT], dip [°]", "state/field"),
            )
        ]

    def steps(self) -> list[rrb.Container]:
        """Steps found, their length and frequency, and errors of length."""
        return [
            self.quartet(
                "Did steps go wrong?",
                self.curves("Steps found [m/s²]", "steps", "state/acc_norm_m_s2"),
                self.curves("Step length [m]", "state/step_length_m"),
                self.curves("Step frequency [Hz]", "state/step_frequency_hz"),
                self.length_errors(),
            )
        ]

    def altitude(self) -> list[rrb.Container]:
        """Barometer and estimates."""
        altitude = self.curves("Altitude above the start [m]", "state/altitude_m")
        return [rrb.Vertical(*altitude, name="Altitude")] if altitude else []

    def error(self) -> list[rrb.Container]:
        """Errors where truth is known, and what they are made of."""
        if not self.there("error_m"):
            return []
        direction = "Error of direction, straight from checkpoint to checkpoint [°]"
        beside = [*self.length_errors(), *self.curves(direction, "legs/direction_deg")]
        return [rrb.Vertical(*self.error_curves(), *beside, name="Error")]

    def while_walking(self) -> list[rrb.Container]:
        """The online path as it was believed at each moment."""
        if not self.there("map/believed"):
            return []
        name = (
            "The online path as it was believed at the time of the cursor (purple), and as smoothed in the end (green)"
        )
        root = self.root
        drawn = ("believed/**", "return/match", "online/position", "smoothed/path", "smoothed/ends")
        contents = [f"{root}/map/{what}" for what in drawn]
        contents += [f"{root}/map/truth/**", f"{root}/map/legend/scale", f"{root}/map/legend/north", f"{root}/map"]
        return [rrb.Horizontal(self.plan(name, contents), name="While walking")]

    def way_back(self) -> list[rrb.Container]:
        """The legs of the way back, and what was told of them."""
        if not self.there("map/return"):
            return []
        name, root = "The way back, its turns numbered as in the list", self.root
        known = [f"{root}/map/return/**", f"{root}/map/smoothed/ends", f"{root}/map/legend/north", f"{root}/map"]
        right = rrb.Vertical(
            *self.text("How to go", "return/instructions"),
            *self.told("Told while walking back", "return/told"),
            *self.curves("Left to the start [m]", "return/remaining_m"),
            *self.curves("Beside the route, to its left [m]", "return/cross_track_m"),
        )
        return [rrb.Horizontal(self.plan(name, known), right, column_shares=[5, 3], name="The way back")]

    def graph(self) -> list[rrb.Container]:
        """Residuals and weights of the factors, and the solver."""
        if not self.there("residuals"):
            return []
        weights = self.curves("Share of its pull that the robust loss left each factor", "weights")
        trust = self.curves("The compass: the same, less what the disturbed field took", "state/compass_trust")
        residuals = self.curves("Residuals: estimate minus measurement [σ]", "residuals")
        solver = [rrb.BarChartView(name="Error by iteration, log10", origin=f"{self.root}/solver/log10_error")]
        return [
            rrb.Horizontal(
                rrb.Vertical(*residuals, *weights, *trust),
                rrb.Vertical(*self.text("The graph", "graph"), *solver, row_shares=[3, 1]),
                column_shares=[5, 3],
                name="The graph",
            )
        ]

    def space(self) -> list[rrb.Container]:
        """The walk in space, seen from the South and above."""
        name, origin, frame = "3-D, seen from the South", f"{self.root}/world", self.frame
        contents = [f"{origin}/**", f"- {origin}/return/**", f"- {origin}/events/**", f"- {origin}/smoothed/times/**"]
        if frame is None:
            return [rrb.Horizontal(rrb.Spatial3DView(name=name, origin=origin, contents=contents), name="3-D")]
        middle = np.array([(frame.x_min_m + frame.x_max_m) / 2.0, (frame.y_min_m + frame.y_max_m) / 2.0, 0.0])
        view = rrb.Spatial3DView(
            name=name,
            origin=origin,
            contents=contents,
            eye_controls=rrb.EyeControls3D(
                position=middle + frame.size_m * np.array([0.0, -0.8, 0.75]), look_target=middle, eye_up=(0.0, 0.0, 1.0)
            ),
        )
        return [rrb.Horizontal(view, name="3-D")]

    def globe(self) -> list[rrb.Container]:
        """The walk on a map of the world."""
        if not self.there("geo"):
            return []
        name = "On the globe, North up (the map behind it comes from the internet)"
        zoom = None if self.frame is None else self.frame.zoom
        return [rrb.Horizontal(rrb.MapView(name=name, origin=f"{self.root}/geo", zoom=zoom), name="On the globe")]

    def raw_sensors(self) -> list[rrb.Container]:
        """Every sample."""
        return [
            rrb.Vertical(
                *self.curves("Accelerometer [m/s²]", "sensors/acc"),
                *self.curves("Gyroscope [rad/s]", "sensors/gyro"),
                *self.curves("Magnetometer [µT]", "sensors/mag"),
                *self.curves("Air pressure [hPa]", "sensors/pressure"),
                name="Raw sensors",
            )
        ]

    def summary(self) -> list[rrb.Container]:
        """The summary and the log's events."""
        if summary := self.text("Summary", "summary"):
            return [rrb.Horizontal(*summary, *self.told("Events of the log", "events"), name="Summary")]
        return []


def _stacked(name: str, *rows: tuple[float, list[rrb.View]]) -> rrb.Container:
    """One above the other, each with its share of the height; rows without a view are left out."""
    there = [(share, view) for share, views in rows for view in views]
    return rrb.Vertical(*(view for _, view in there), row_shares=[share for share, _ in there], name=name)


def _texts() -> rrb.TextLogColumns:
    """Of a log: when, and what."""
    return rrb.TextLogColumns(timeline_columns=["time"], text_log_columns=["Body"])


def _whole_time() -> rrb.TimeAxis:
    infinite = rrb.TimeRangeBoundary.infinite()
    return rrb.TimeAxis(view_range=rrb.TimeRange(start=infinite, end=infinite))
