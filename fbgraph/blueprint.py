"""How a recording opens in Rerun: tabs by question, the first of them enough to understand the walk."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb

from fbgraph.geometry import FloatArray

_MARGIN = 0.06  # of the walk's size, around it
_LEGEND_WIDTH = 0.32  # of the walk's size, right of it
_LEGEND_ROWS = 13  # to the walk's size: far enough apart for labels on a laptop's screen


@dataclass(frozen=True)
class Frame:
    """The part of the plane that the map opens on: the walk, and a column for the legend right of it; metres."""

    x_min_m: float
    x_max_m: float
    y_min_m: float
    y_max_m: float

    @staticmethod
    def around(xy_m: FloatArray) -> Frame:
        """The frame of (N, 2) places; not smaller than a room."""
        low, high = xy_m.min(axis=0), xy_m.max(axis=0)
        grow = np.maximum(4.0 - (high - low), 0.0) / 2.0
        (x_min, y_min), (x_max, y_max) = low - grow, high + grow
        return Frame(float(x_min), float(x_max), float(y_min), float(y_max))

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
    def bounds(self) -> rrb.VisualBounds2D:
        """For a view with y down, as Rerun's are."""
        margin, legend = _MARGIN * self.size_m, _LEGEND_WIDTH * self.size_m
        return rrb.VisualBounds2D(
            x_range=(self.x_min_m - margin, self.x_max_m + margin + legend),
            y_range=(-self.y_max_m - margin, -self.y_min_m + margin),
        )


def blueprint(entities: Collection[str], frame: Frame, active_tab: int = 0) -> rrb.Blueprint:
    """The arrangement of views.

    Args:
        entities: paths that were written; views of absent sensors are left out.
        frame: what the map shows.
        active_tab: which tab is open.
    """

    def curves(name: str, *prefixes: str) -> list[rrb.View]:
        """A view of what was written below these paths; none if nothing was."""
        contents = [f"/{p}/**" for p in prefixes if any(e == p or e.startswith(f"{p}/") for e in entities)]
        if not contents:
            return []
        whole = rrb.TimeRange(start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite())
        axis = rrb.TimeAxis(view_range=whole)
        return [
            rrb.TimeSeriesView(name=name, origin="/", contents=contents, axis_x=axis, plot_legend=rrb.Corner2D.LeftTop)
        ]

    # functions, for a view that is in two places must be two views
    def summary() -> rrb.View:
        return rrb.TextDocumentView(name="Summary", origin="/summary")

    def error() -> list[rrb.View]:
        return curves("Horizontal error at checkpoints [m]", "error_m")

    def heading() -> list[rrb.View]:
        return curves("Heading, counter-clockwise from East [°]", "state/yaw_deg")

    tabs: list[rrb.Container] = [
        rrb.Horizontal(
            rrb.Spatial2DView(name="Map, North up", origin="/", contents="/map/**", visual_bounds=frame.bounds),
            rrb.Vertical(summary(), *(error() or heading()), row_shares=[3, 2]),
            column_shares=[5, 3],
            name="The walk",
        ),
        rrb.Vertical(
            *heading(),
            *curves("Gyroscope bias about the vertical [°/s]", "state/gyro_bias_deg_s"),
            *curves("Magnetic field: strength [µT], dip [°]", "state/field"),
            name="Did heading go wrong?",
        ),
        rrb.Vertical(
            *curves("Steps found [m/s²]", "steps", "state/acc_norm_m_s2", "state/still"),
            *curves("Step frequency [Hz]", "state/step_frequency_hz"),
            *curves("Step length [m]", "state/step_length_m"),
            name="Steps",
        ),
    ]
    if altitude := curves("Altitude above the start [m]", "state/altitude_m"):
        tabs.append(rrb.Vertical(*altitude, name="Altitude"))
    if error():
        tabs.append(rrb.Vertical(*error(), *heading(), name="Error"))
    tabs.append(rrb.Horizontal(_space_view(frame), name="3-D"))
    tabs.append(
        rrb.Vertical(
            *curves("Accelerometer [m/s²]", "sensors/acc"),
            *curves("Gyroscope [rad/s]", "sensors/gyro"),
            *curves("Magnetometer [µT]", "sensors/mag"),
            *curves("Air pressure [hPa]", "sensors/pressure"),
            name="Raw sensors",
        )
    )
    events = [rrb.TextLogView(name="Events of the log", origin="/events")] if "events" in entities else []
    tabs.append(rrb.Vertical(summary(), *events, name="Summary"))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=active_tab),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="time", play_state="paused"),
    )


def _space_view(frame: Frame) -> rrb.View:
    """The walk in space, seen from the South and above."""
    middle = np.array([(frame.x_min_m + frame.x_max_m) / 2.0, (frame.y_min_m + frame.y_max_m) / 2.0, 0.0])
    return rrb.Spatial3DView(
        name="3-D, seen from the South",
        origin="/world",
        eye_controls=rrb.EyeControls3D(
            position=middle + frame.size_m * np.array([0.0, -0.8, 0.75]), look_target=middle, eye_up=(0.0, 0.0, 1.0)
        ),
    )
