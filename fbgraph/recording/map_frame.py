"""The part of the plane that the map opens on, and what is measured by its size: legend, scale bar, zoom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import rerun.blueprint as rrb

from fbgraph.core.geometry import FloatArray

MOST_LABELS = 100
"""More places than this are not labelled one by one."""
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
