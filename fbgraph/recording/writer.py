"""Writes to Rerun by columns: curves, lanes, and places in space and on maps, on the clock of a walk.

One writer serves a file, written whole at the end, and a viewer, fed while the walk goes on.

Timelines
    ``time``, a duration since log start, on everything; ``step``, the number of the last breadcrumb, and
    ``distance_cm``, what had been walked, on everything that is known once a step. A timeline of Rerun counts integers
    or nanoseconds; whole centimetres are finer than any breadcrumb.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.safe_text import visible
from fbgraph.recording.viewer import start_viewer

APPLICATION_ID = "fbgraph"

Rgba = tuple[int, int, int] | tuple[int, int, int, int]


def entity_below(name: str) -> str:
    """A path of entities for a name from outside; its slashes make levels, nothing else in it means anything."""
    return "/".join(rr.escape_entity_path_part(visible(part)) for part in name.split("/") if part)


class RrdWriter:
    """A stream, its clock, and which entities were written to it."""

    def __init__(self, recording_id: str | None = None) -> None:
        """Begin a recording.

        Args:
            recording_id: the same for equal walks; a new one if None.
        """
        # without properties: they hold the time of writing; a file is cut into chunks by what it holds, not by when
        batching = rr.ChunkBatcherConfig.NEVER() if recording_id is not None else None
        shown_id = None if recording_id is None else visible(recording_id)
        self._stream = rr.RecordingStream(
            APPLICATION_ID, recording_id=shown_id, send_properties=False, batcher_config=batching
        )
        self._crumb_s = np.zeros(1)
        self._distance_m = np.zeros(1)
        self._ends_s: dict[str, float] = {}  # of curves
        self.entities: set[str] = set()

    def view(self, url: str | None, arranged: rrb.Blueprint) -> None:
        """From now on show everything in a viewer.

        Args:
            url: of a running one, ``rerun+http://HOST:PORT/proxy``; one is started if None.
            arranged: how it opens.

        Raises:
            ConfigError: there is no viewer to be had.
        """
        try:
            self._stream.connect_grpc(url or start_viewer(), default_blueprint=arranged)
        except (RuntimeError, ValueError, OSError) as error:
            raise ConfigError(f"--view: no viewer: {str(error).splitlines()[0]}") from error

    def arrange(self, arranged: rrb.Blueprint) -> None:
        """Tell the viewer how to arrange what there is now."""
        self._stream.send_blueprint(arranged)

    def save(self, path: Path, arranged: rrb.Blueprint) -> None:
        """Write everything logged so far to a file, and how it opens; nothing is on disk before.

        Raises:
            OSError: the file cannot be written.
        """
        # not by ``RecordingStream.save``: it hangs or keeps quiet when the disk is full
        memory = self._stream.memory_recording()
        self._stream.send_blueprint(arranged, make_active=False, make_default=True)
        path.write_bytes(memory.drain_as_bytes())
        self._stream.disconnect()

    def copy(self, chunks: Sequence[Chunk], below: str) -> None:
        """Log what another recording holds, its entities below this one."""
        self._stream.send_chunks([chunk.with_entity_path(f"/{below}{chunk.entity_path}") for chunk in chunks])

    def clock(self, crumb_s: FloatArray, distance_m: FloatArray) -> None:
        """The breadcrumbs by which times become steps and distances.

        Args:
            crumb_s: (K+1,) their times, seconds since log start.
            distance_m: (K+1,) distance walked up to each.
        """
        self._crumb_s, self._distance_m = crumb_s, distance_m

    def fixed(self, entity: str, *archetypes: rr.AsComponents) -> None:
        """Log what holds at all times, in place of what held before."""
        self._stream.log(entity, *archetypes, static=True, strict=True)
        self.entities.add(entity)

    def styled(self, entity: str, style: rr.AsComponents) -> None:
        """Log how an entity looks, once."""
        if entity not in self.entities:
            self.fixed(entity, style)

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

    def numbered(self, entity: str, timeline: str, numbers: IntArray, columns: rr.ComponentColumnList) -> None:
        """Log a row for each of these numbers, on a timeline of their own."""
        self._stream.send_columns(entity, [rr.TimeColumn(timeline, sequence=numbers)], columns, strict=True)
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
        max_gap_s: float = np.inf,
    ) -> None:
        """Log (N,) or (N, D) numbers as D curves, or as points.

        Rows that are not finite are left out; a curve is broken where nothing is known for longer than ``max_gap_s``.
        """
        table = values if values.ndim == 2 else values[:, None]
        known = np.isfinite(table).all(axis=1)
        if not known.any():
            return
        t_s, table = t_s[known], table[known]
        lengths = np.full(len(table), table.shape[1])
        style: rr.SeriesPoints | rr.SeriesLines
        if points is not None:
            style = rr.SeriesPoints(names=names, colors=colors, markers=points, marker_sizes=2.0 * width)
        else:
            before_s = np.concatenate(([self._ends_s.get(entity, np.inf)], t_s[:-1]))
            self._ends_s[entity] = float(t_s[-1])
            gaps = np.flatnonzero(t_s - before_s > max_gap_s)
            lengths = np.insert(lengths, gaps, 0)  # a row of nothing ends the curve
            t_s = np.insert(t_s, gaps, before_s[gaps] + 1e-3)
            style = rr.SeriesLines(
                names=names,
                colors=colors,
                widths=[width] * len(names),
                # an average would hide the very spikes that one looks for
                aggregation_policy=rr.components.AggregationPolicy.MinMax,
                interpolation_mode=rr.components.InterpolationMode.StepAfter if stairs else None,
            )
        self.styled(entity, style)
        columns = rr.Scalars.columns(scalars=table.ravel()).partition(lengths)
        self.columns(entity, t_s, columns, only_time=only_time)

    def lane(self, entity: str, changes: Sequence[tuple[float, str | None]], colors: dict[str, Rgba]) -> None:
        """Log since when which state holds; None for a stretch without one."""
        if not changes:
            return
        style = rr.StateConfiguration(values=list(colors), labels=list(colors), colors=list(colors.values()))
        self.styled(entity, style)
        known = [state for _, state in changes if state is not None]
        lengths = [int(state is not None) for _, state in changes]  # a row of nothing is a stretch without a state
        columns = rr.StateChange.columns(state=known).partition(lengths)
        self.columns(entity, np.array([t_s for t_s, _ in changes]), columns)

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
        self.styled(f"world/{entity}", rr.Points3D.from_fields(colors=[color], radii=radii))
        self.styled(f"map/{entity}", rr.Points2D.from_fields(colors=[color], radii=radii))
        self.columns(f"world/{entity}", t_s, rr.Points3D.columns(positions=points))
        self.columns(f"map/{entity}", t_s, rr.Points2D.columns(positions=points[:, :2]))

    def moving_line(
        self, entity: str, t_s: FloatArray, strips: Sequence[FloatArray], color: Rgba, width: float
    ) -> None:
        """Log, for each of (N,) ``t_s``, the (M, 2) line strip that holds from then on; on the map."""
        style = rr.LineStrips2D.from_fields(colors=[color], radii=rr.Radius.ui_points(width))
        self.styled(f"map/{entity}", style)
        self.columns(f"map/{entity}", t_s, rr.LineStrips2D.columns(strips=strips))
