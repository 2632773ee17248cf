"""Where on Earth a run's trajectory lies, and by how much it must yet be turned to lie by true North."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from fbgraph.core.earth_field import EarthField, earth_field, walk_day
from fbgraph.core.georeference import Georeference
from fbgraph.run.read_run import SavedRun, in_anchors_frame, read_georeference, trajectory_of


@dataclass(frozen=True)
class Placement:
    """A trajectory on the map.

    Attributes:
        origin: of its frame.
        field: that by whose declination it must be turned about its start; None if it lies by true North already, or
            somebody set its declination.
    """

    origin: Georeference
    field: EarthField | None = None

    @property
    def turned_rad(self) -> float:
        """How far it must be turned, counter-clockwise."""
        return 0.0 if self.field is None else -math.radians(self.field.declination_deg)

    @property
    def note(self) -> str:
        """What the user should know of it; empty if there is nothing."""
        if self.field is None:
            return ""
        return (
            "the walk was smoothed towards magnetic North; on the map it is turned by the declination, "
            f"{self.field.text}"
        )


def placement(run: SavedRun, estimator: str, start: Georeference | None = None) -> Placement | None:
    """Where a trajectory lies; None if nobody knows.

    Args:
        run, estimator: whose.
        start: where on Earth it begins; the run's own georeference if None.

    Raises:
        ConfigError: no estimator of this name.
        DataError: the run does not have it, or a damaged configuration.
    """
    where = start or read_georeference(run.summary)
    if where is None:
        return None
    field = None
    if not in_anchors_frame(run, estimator) and run.read_config().device.declination_deg is None:
        log = (run.summary.get("inputs") or {}).get("log")
        field = earth_field(where, walk_day(float(run.summary["log"]["t0_s"]), None if log is None else Path(log)))
    if start is not None:
        first = trajectory_of(run, estimator)
        where = start.moved(-float(first.x_m[0]), -float(first.y_m[0]))
    return Placement(where, field)
