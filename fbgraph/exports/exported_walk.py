"""ExportedWalk: one trajectory of a run and what is known of it, as every format gets it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import FloatArray, heading_deg
from fbgraph.core.georeference import Georeference
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Integrity, caution
from fbgraph.run.placement import Placement, placement
from fbgraph.run.read_run import SavedRun, knows_north, read_events, trajectory_of
from fbgraph.way_back.gpx_geojson import require_map

_FIRST_DAY = datetime(2010, 1, 1, tzinfo=UTC)  # a clock that shows an earlier day counts from something else


@dataclass(frozen=True)
class ExportedWalk:
    """A walk to be written.

    Attributes:
        run: where it is from.
        estimator: whose trajectory it is.
        trajectory: in the world frame, ``t_s`` on the log's event clock; nan for a gyroscope bias that is not known.
        placed: where on Earth its frame lies, None if nobody knows.
        start_height_m: of its start above sea level; None if nobody said.
        log_path: where its log is now, if it has moved.
        at_truth: whether poses are wanted at the truth's times.
    """

    run: SavedRun
    estimator: str
    trajectory: Trajectory
    placed: Placement | None = None
    start_height_m: float | None = None
    log_path: Path | None = None
    at_truth: bool = False

    @property
    def name(self) -> str:
        """Of the log, as it was written down: not to be shown as it is."""
        return str(self.run.summary["log"]["name"])

    @property
    def title(self) -> str:
        """Of the log and the estimator; not to be shown as it is."""
        return f"{self.name} ({self.estimator})"

    @property
    def events(self) -> list[tuple[float, str]]:
        """(time, label) of what the log marked; labels are not to be shown as they are."""
        return read_events(self.run.summary)

    @property
    def caution(self) -> tuple[str, ...]:
        """What to know before relying on it, in a sentence each."""
        return caution(Integrity.from_dict(self.run.summary.get("integrity")), "walk")

    @property
    def barometer(self) -> bool:
        """Whether its heights were measured."""
        return int(self.run.summary["log"].get("samples", {}).get("pressure", 1)) > 0

    @property
    def dated(self) -> bool:
        """Whether its clock is Unix time: shows a day of 2010 or later, and not one to come."""
        first, last = self.trajectory.t_s[[0, -1]].tolist()
        return bool(first >= _FIRST_DAY.timestamp() and last <= (datetime.now(UTC) + timedelta(days=1)).timestamp())

    def moment(self, t_s: float) -> datetime | None:
        """The date and time (UTC) of a time of its clock, to a millisecond; None if it is not ``dated``."""
        if not self.dated:
            return None
        return datetime.fromtimestamp(0, UTC) + timedelta(milliseconds=round(t_s * 1e3))

    @property
    def undated_note(self) -> list[str]:
        """That there are no dates, if so."""
        return [] if self.dated else ["the log's clock does not show the date: no time of day is written"]

    @property
    def heights_m(self) -> FloatArray | None:
        """(K+1,) of its breadcrumbs, above sea level if somebody said how high it starts, else above its start."""
        if not self.barometer:
            return None
        return np.asarray(self.trajectory.z_m + (self.start_height_m or 0.0)).round(3) + 0.0  # no -0.0

    @property
    def heights_note(self) -> list[str]:
        """What the heights are, if they are not above sea level."""
        if not self.barometer:
            return ["no barometer: heights are left out"]
        return [] if self.start_height_m is not None else ["heights are above the start; --start-height-m says its own"]

    @property
    def on_map(self) -> tuple[Georeference, Trajectory]:
        """The origin of its frame, and the walk with its y axis to true North.

        Raises:
            ConfigError: nobody knows where it was.
        """
        if self.placed is None:
            raise ConfigError("it is not known where on Earth the walk was")
        return self.placed.origin, self.trajectory.turned(self.placed.turned_rad)

    def lon_lat(self, trajectory: Trajectory, origin: Georeference) -> FloatArray:
        """(K+1, 2) longitude and latitude of breadcrumbs, to a centimetre."""
        return np.round(origin.geodetic_deg(trajectory.xy_m)[:, ::-1], 7)

    def marks(self, trajectory: Trajectory, origin: Georeference) -> list[tuple[float, str, list[float]]]:
        """(time, label, [longitude, latitude]) of every event."""
        events = self.events
        places_m = trajectory.at(np.array([t_s for t_s, _ in events]))
        lon_lat = np.round(origin.geodetic_deg(places_m[:, :2])[:, ::-1], 7).tolist() if events else []
        return [(t_s, label, place) for (t_s, label), place in zip(events, lon_lat, strict=True)]

    def states(self, trajectory: Trajectory) -> list[dict[str, Any]]:
        """What is known of each breadcrumb, None where it is not."""
        frame = trajectory.to_dataframe()
        names = ("t_s", "z_m", "sigma_x_m", "sigma_y_m", "cov_xy_m2", "sigma_z_m", "sigma_yaw_rad")
        columns = {name: frame[name].tolist() for name in names}
        columns["heading_deg"] = [round(heading_deg(yaw), 2) for yaw in trajectory.yaw_rad.tolist()]
        if not self.barometer:
            columns["z_m"] = [np.nan] * len(trajectory)
        return [
            {"k": k, **{n: None if np.isnan(v) else round(v, 6) for n, v in zip(columns, row, strict=True)}}
            for k, row in enumerate(zip(*columns.values(), strict=True))
        ]


def exported_walk(
    run: SavedRun,
    estimator: str,
    format_: str,
    start: Georeference | None = None,
    start_height_m: float | None = None,
    needs_place: bool = False,
) -> ExportedWalk:
    """A walk of a run as a format needs it.

    Args:
        run, estimator: whose.
        format_: for messages.
        start: where on Earth it begins; the run's own georeference if None.
        start_height_m: how high above sea level; None if nobody knows.
        needs_place: whether the format is of a map.

    Raises:
        ConfigError: no such estimator, or a map of a walk of which it is not known where it was, or where North is.
        DataError: the run does not have it.
    """
    trajectory = trajectory_of(run, estimator)
    if estimator != "smoothed":
        trajectory = replace(trajectory, gyro_bias_rad_s=np.full(len(trajectory), np.nan))  # not in its file
    north = knows_north(run, estimator)
    placed = placement(run, estimator, start) if north or needs_place else None
    if needs_place:
        require_map(format_, placed.origin if placed else None, north)
    return ExportedWalk(run, estimator, trajectory, placed, start_height_m)
