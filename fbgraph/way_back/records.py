"""Plain records of the way back: its turn-back, matches, closures, and what was told."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TurnBack:
    """The wearer turned back.

    Attributes:
        breadcrumb: the last one of the way out.
        t_s: its time, seconds since log start.
        known_s: time of the step with which it became known.
    """

    breadcrumb: int
    t_s: float
    known_s: float


@dataclass(frozen=True, slots=True)
class Crumb:
    """What the search looks at: time, place, direction, distance walked as if on the level, the magnetic field there.

    The field is that of the step, down, horizontally, and horizontally across magnetic North; nan where not known.
    """

    t_s: float
    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    walked_m: float
    down_ut: float = math.nan
    level_ut: float = math.nan
    across_ut: float = math.nan


@dataclass(frozen=True, slots=True)
class Match:
    """Where the wearer is along the route.

    Attributes:
        route_m: distance along the route (of its breadcrumbs).
        sigma_m: its standard deviation.
        breadcrumb: the nearest breadcrumb of the route.
        cross_m: distance of the wearer from the route there, positive if to the left of it as seen walking back.
        off_route: the wearer left the corridor and has not come back.
        facing_back: the wearer walks back along the route rather than out.
        bearing_rad: direction to the route as the wearer faces, positive to the left.
        steady_m: how far the route has been followed back without doubt.
    """

    route_m: float
    sigma_m: float
    breadcrumb: int
    cross_m: float
    off_route: bool
    facing_back: bool
    bearing_rad: float
    steady_m: float


@dataclass(frozen=True, slots=True)
class ReturnUpdate:
    """What is told at a step of the way back.

    Attributes:
        t_s: time of the step, seconds since log start.
        k: its breadcrumb.
        breadcrumb, breadcrumb_t_s: the breadcrumb of the way out that the wearer is at, and when it was dropped.
        route_m: how far along the way out that breadcrumb lies.
        remaining_m: distance left to the start, along the route.
        cross_track_m: distance from the route, positive if to the left of it as seen walking back.
        next_turn_m, next_turn_rad: distance to the next turn and its angle, left positive; None if only the start is
            ahead.
        sigma_m: standard deviation of the place along the route.
        off_route: the wearer left the route.
        arrived: the start is reached; true once.
        instruction: what to do next.
    """

    t_s: float
    k: int
    breadcrumb: int
    breadcrumb_t_s: float
    route_m: float
    remaining_m: float
    cross_track_m: float
    next_turn_m: float | None
    next_turn_rad: float | None
    sigma_m: float
    off_route: bool
    arrived: bool
    instruction: str


@dataclass(frozen=True, slots=True)
class Closure:
    """Breadcrumb ``j`` is at the place of the earlier breadcrumb ``i``.

    Attributes:
        i, j: breadcrumbs.
        sigma_along_m, sigma_across_m: standard deviations along the direction walked at ``i`` and across it.
        along_m: how far beyond ``i``, in that direction, ``j`` is.
        across_m: how far to the left of ``i``, facing that direction, by dead reckoning round the turn.
    """

    i: int
    j: int
    sigma_along_m: float
    sigma_across_m: float
    along_m: float = 0.0
    across_m: float = 0.0
