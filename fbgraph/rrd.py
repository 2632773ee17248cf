"""Writes a Rerun file by columns: curves, and places in space and on the map, on the clock of a walk.

Timelines
    ``time``, a duration since log start, on everything; ``step``, the number of the last breadcrumb, and
    ``distance_cm``, what the smoothed trajectory had walked, on everything that is known once a step. A timeline of
    Rerun counts integers or nanoseconds; whole centimetres are finer than any breadcrumb.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fbgraph.geometry import FloatArray

APPLICATION_ID = "fbgraph"

Rgba = tuple[int, int, int] | tuple[int, int, int, int]


class RrdWriter:
    """A stream, its clock, and which entities were written to it; nothing is on disk before ``save``."""

    def __init__(self, recording_id: str, crumb_s: FloatArray, distance_m: FloatArray) -> None:
        """Begin a recording.

        Args:
            recording_id: the same for equal walks.
            crumb_s: (K+1,) times of the breadcrumbs, seconds since log start.
            distance_m: (K+1,) distance walked up to each.
        """
        # without properties: they hold the time of writing
        self._stream = rr.RecordingStream(APPLICATION_ID, recording_id=recording_id, send_properties=False)
        self._crumb_s = crumb_s
        self._distance_m = distance_m
        self.entities: set[str] = set()

    def fixed(self, entity: str, *archetypes: rr.AsComponents) -> None:
        """Log what holds at all times."""
        self._stream.log(entity, *archetypes, static=True, strict=True)
        self.entities.add(entity)

    def columns(
        self, entity: str, t_s: FloatArray, columns: rr.ComponentColumnList, *, only_time: bool = False
    ) -> None:
        """Log a row for each of these times, on the timelines that the module's text names; sensors ``only_time``."""
        # whole microseconds, which no clock of such a device betters, pack more tightly than nanoseconds
        indexes = [rr.TimeColumn("time", duration=np.round(t_s * 1e6).astype("timedelta64[us]"))]
        if not only_time:
            step = np.maximum(np.searchsorted(self._crumb_s, t_s, side="right") - 1, 0)
            distance_m = np.interp(t_s, self._crumb_s, self._distance_m)
            indexes.append(rr.TimeColumn("step", sequence=step))
            indexes.append(rr.TimeColumn("distance_cm", sequence=np.round(100.0 * distance_m).astype(np.int64)))
        self._stream.send_columns(entity, indexes=indexes, columns=columns, strict=True)
        self.entities.add(entity)

    def series(
        self,
        entity: str,
        t_s: FloatArray,
        values: FloatArray,
        names: Sequence[str],
        colors: Sequence[Rgba],
        *,
        width: float = 1.5,
        points: rr.components.MarkerShape | None = None,
        stairs: bool = False,
        only_time: bool = False,
    ) -> None:
        """Log (N,) or (N, D) numbers as D curves, or as points; rows that are not finite are left out."""
        table = values if values.ndim == 2 else values[:, None]
        known = np.isfinite(table).all(axis=1)
        if not known.any():
            return
        style: rr.SeriesPoints | rr.SeriesLines
        if points is not None:
            style = rr.SeriesPoints(names=names, colors=colors, markers=points, marker_sizes=2.0 * width)
        else:
            style = rr.SeriesLines(
                names=names,
                colors=colors,
                widths=[width] * len(names),
                # an average would hide the very spikes that one looks for
                aggregation_policy=rr.components.AggregationPolicy.MinMax,
                interpolation_mode=rr.components.InterpolationMode.StepAfter if stairs else None,
            )
        self.fixed(entity, style)
        self.columns(entity, t_s[known], rr.Scalars.columns(scalars=table[known]), only_time=only_time)

    def lines(self, entity: str, strips: Sequence[FloatArray], color: Rgba, width: float) -> None:
        """Log (N, 3) line strips in space and on the map."""
        radii = rr.Radius.ui_points(width)
        self.fixed(f"world/{entity}", rr.LineStrips3D(strips, colors=[color], radii=radii))
        flat = [strip[:, :2] for strip in strips]
        self.fixed(f"map/{entity}", rr.LineStrips2D(flat, colors=[color], radii=radii))

    def points(self, entity: str, points: FloatArray, labels: Sequence[str] | None, color: Rgba, width: float) -> None:
        """Log (N, 3) points in space and on the map."""
        radii = rr.Radius.ui_points(width)
        self.fixed(f"world/{entity}", rr.Points3D(points, colors=[color], radii=radii, labels=labels))
        self.fixed(f"map/{entity}", rr.Points2D(points[:, :2], colors=[color], radii=radii, labels=labels))

    def moving_point(self, entity: str, t_s: FloatArray, points: FloatArray, color: Rgba, width: float) -> None:
        """Log a point that is at (N, 3) ``points`` at (N,) ``t_s``, in space and on the map."""
        radii = rr.Radius.ui_points(width)
        self.fixed(f"world/{entity}", rr.Points3D.from_fields(colors=[color], radii=radii))
        self.fixed(f"map/{entity}", rr.Points2D.from_fields(colors=[color], radii=radii))
        self.columns(f"world/{entity}", t_s, rr.Points3D.columns(positions=points))
        self.columns(f"map/{entity}", t_s, rr.Points2D.columns(positions=points[:, :2]))

    def save(self, path: Path, arranged: rrb.Blueprint) -> None:
        """Write everything, and how it opens.

        Raises:
            OSError: the file cannot be written.
        """
        try:
            self._stream.save(path, default_blueprint=arranged)
        except RuntimeError as error:
            raise OSError(f"{path}: {error}") from error
        self._stream.disconnect()
