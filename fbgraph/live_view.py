"""A walk in a Rerun viewer while it is walked: the same entities, colours and clock as in its recording."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fbgraph.errors import ConfigError
from fbgraph.online import Update
from fbgraph.palette import COLORS
from fbgraph.rrd import APPLICATION_ID

_LINE = rr.Radius.ui_points(2.5)
_STRIP_STEPS = 100
_DOT = rr.Radius.ui_points(7.0)


class LiveView:
    """Shows each update as it comes."""

    def __init__(self, url: str | None = None) -> None:
        """Open a viewer, or connect to a running one.

        Args:
            url: ``rerun+http://HOST:PORT/proxy``; a viewer is started if None.

        Raises:
            ConfigError: there is no viewer to be had.
        """
        self._stream = rr.RecordingStream(APPLICATION_ID)
        self._path: list[tuple[float, float]] = []
        arranged = rrb.Blueprint(
            rrb.Horizontal(
                rrb.Spatial2DView(origin="/", contents="/map/**", name="Map, North up"),
                rrb.Vertical(
                    rrb.TimeSeriesView(origin="state/yaw_deg", name="Direction [°]"),
                    rrb.TimeSeriesView(origin="state/gyro_bias_deg_s", name="Gyro bias [°/s]"),
                    rrb.TimeSeriesView(origin="state/altitude_m", name="Altitude [m]"),
                ),
                column_shares=[3, 2],
            )
        )
        try:
            if url is None:
                self._stream.spawn(default_blueprint=arranged)
            else:
                self._stream.connect_grpc(url, default_blueprint=arranged)
        except (RuntimeError, ValueError, OSError) as error:
            raise ConfigError(f"--view: no viewer: {str(error).splitlines()[0]}") from error
        self._stream.log("map", rr.Transform3D(scale=[1.0, -1.0, 1.0]), static=True)  # North up
        for entity, label in (("yaw_deg", "°"), ("gyro_bias_deg_s", "°/s"), ("altitude_m", "m")):
            style = rr.SeriesLines(names=f"online [{label}]", colors=COLORS["online"])
            self._stream.log(f"state/{entity}/online", style, static=True)

    def show(self, update: Update) -> None:
        """Log one update: where the wearer is believed to be, and how they came there."""
        self._stream.set_time("time", duration=update.t_s)
        self._stream.set_time("step", sequence=update.k)
        self._stream.set_time("distance_cm", sequence=round(100.0 * update.distance_m))
        # a strip grows with every step: one that is long enough is left alone and another begun
        if update.k % _STRIP_STEPS == 1:
            self._path = self._path[-1:]
        self._path.append((update.x_m, update.y_m))
        color = COLORS["online"]
        strip = f"map/online/path/{max(update.k - 1, 0) // _STRIP_STEPS}"
        self._stream.log(strip, rr.LineStrips2D([self._path], colors=[color], radii=_LINE))
        self._stream.log("map/online/position", rr.Points2D([self._path[-1]], colors=[color], radii=_DOT))
        self._stream.log("state/yaw_deg/online", rr.Scalars(np.degrees(update.yaw_rad)))
        self._stream.log("state/gyro_bias_deg_s/online", rr.Scalars(np.degrees(update.gyro_bias_rad_s)))
        self._stream.log("state/altitude_m/online", rr.Scalars(update.z_m))
