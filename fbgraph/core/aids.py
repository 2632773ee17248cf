"""What is known of a walk besides its sensors: truth that only scores, and aids that an estimator may use."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

from fbgraph.core.building import Building, BuildingField
from fbgraph.core.checkpoints import FASTEST_M_S, SLACK_M, Checkpoints
from fbgraph.core.georeference import Georeference


@dataclass(frozen=True)
class AnchorFrame:
    """Where the frame of anchors lies in that of the walk, whose first breadcrumb is the origin.

    Attributes:
        x_m, y_m: place in the walk's frame of the point ``centre_m``.
        turn_rad: by which the anchors' x axis is turned against the walk's East, anticlockwise.
        centre_m: (x, y) in the anchors' frame, near them: large numbers are kept out of the solver.
        free: whether the turn is to be found; else it is what it is here.
        sigma_late_s: by how much all anchors may have been told too late or too early, one standard deviation.
    """

    x_m: float
    y_m: float
    turn_rad: float
    centre_m: tuple[float, float]
    free: bool
    sigma_late_s: float = 0.6


@dataclass(frozen=True)
class WalkAxis:
    """Which way the corridors of a building run in the frame of a walk, up to right angles.

    Attributes:
        yaw_rad: of any of them, counter-clockwise from East.
        sigma_rad: its standard deviation.
        field: what Earth's field usually is there; None if nobody knows.
    """

    yaw_rad: float
    sigma_rad: float
    field: BuildingField | None = None


@dataclass(frozen=True)
class Aids:
    """What an estimator may know besides the sensors.

    Attributes:
        anchors: known places, ``t_s`` in seconds since log start; with them the result is in their frame.
        closed_walk: whether the walk ends where it began.
        frame: where the anchors' frame lies, as far as it is known; None before anchors are compared with a walk.
        axis: of the building, if that was told.
    """

    anchors: Checkpoints | None = None
    closed_walk: bool = False
    frame: AnchorFrame | None = None
    axis: WalkAxis | None = None

    @property
    def places_known(self) -> bool:
        """Whether there are anchors, so that the first breadcrumb is not the origin."""
        return self.anchors is not None

    @property
    def direction_known(self) -> bool:
        """Whether there are at least two anchors, which also tell the walk's direction and scale."""
        return self.anchors is not None and len(self.anchors) > 1


@dataclass(frozen=True)
class GnssUse:
    """How a log's own fixes were used.

    Attributes:
        source: where they came from.
        fixes: how many of them lie within the log and may be believed.
        used: how many were used.
        used_as: ``truth``, or which of them are anchors: ``start``, ``ends`` or ``all``; ``none`` if they were not.
        sigma_m: median standard deviation on each axis of those used, as anchors with their widening; None of none.
    """

    source: str
    fixes: int
    used: int
    used_as: str
    sigma_m: float | None

    def as_dict(self) -> dict[str, Any]:
        """For ``summary.json``."""
        return asdict(self)


@dataclass(frozen=True)
class Told:
    """Everything that a user says of a walk, on the log's event clock; no estimator sees the truth.

    Attributes:
        truth: known places, for scoring and showing only.
        anchors: known places that enter the graph.
        closed_walk: whether the walk ends where it began.
        origin: where on Earth the walk began.
        gnss: how the log's own fixes were used, which are among truth or anchors; None if it has none.
        building: in which it was walked, if somebody said so.
    """

    truth: Checkpoints | None = None
    anchors: Checkpoints | None = None
    closed_walk: bool = False
    origin: Georeference | None = None
    gnss: GnssUse | None = None
    building: Building | None = None

    @property
    def place(self) -> Georeference | None:
        """Somewhere on the walk, as an estimator may know it: never by the truth."""
        if self.origin is not None:
            return self.origin
        return None if self.anchors is None else self.anchors.first

    @property
    def modes(self) -> tuple[bool, bool, bool]:
        """Whether anchors, a closed end and a building's axis were named: what a score is labelled by."""
        return self.anchors is not None, self.closed_walk, self.building is not None

    def disagreements(self, duration_s: float) -> list[str]:
        """Sentences on an origin, anchors and truth that lie further apart than a walk of this duration goes."""
        anchors, truth = (None if places is None else places.first for places in (self.anchors, self.truth))
        known = (("the origin", self.origin), ("the first anchor", anchors), ("the truth's first place", truth))
        there = [(name, where) for name, where in known if where is not None]
        most_m = SLACK_M + FASTEST_M_S * duration_s
        return [
            f"{name} ({where.lat_deg:.6f}, {where.lon_deg:.6f}) and {other} ({its.lat_deg:.6f}, {its.lon_deg:.6f}) "
            f"are {where.apart_m(its) / 1e3:.4g} km apart: one of them is wrong"
            for (name, where), (other, its) in combinations(there, 2)
            if where.apart_m(its) > most_m
        ]

    def aids(self, t0_s: float, declination_deg: float | None = None) -> Aids:
        """What an estimator gets of it.

        Args:
            t0_s: ``SensorLog.t0_s``, which brings seconds since log start to the event clock.
            declination_deg: by which the walk's compass was turned to true North; None if it was not.
        """
        anchors = None if self.anchors is None else self.anchors.since(t0_s)
        if self.building is None:
            return Aids(anchors, self.closed_walk)
        axis = self.building.axis
        known = WalkAxis(axis.yaw_rad(declination_deg), math.radians(axis.sigma_deg), self.building.field)
        return Aids(anchors, self.closed_walk, axis=known)
