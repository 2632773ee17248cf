"""The way of a walk: the legs between its turns, and the same way back.

The paper's return navigation (section Return Path Navigation Algorithm) walks the breadcrumbs backwards, P_n to P_0,
and takes its directions from the stored trajectory. Here it is cut at its turns into legs of one direction each.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from fbgraph.core.config import GraphConfig
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.geometry import FloatArray, wrap_scalar
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Integrity, caution
from fbgraph.way_back.shorten import LeftOut
from fbgraph.way_back.turns import find_turns, leg_yaws

_STEEP = 0.1  # a step that rises or falls by more of its length was shortened by the slope
MIN_CLIMB_M = 1.0  # less is air pressure as often as it is a climb
_RIDE_STEP_M, _RIDE_M = 0.4, 2.0  # no leg lifts its walker so high in a step: a lift or an escalator did
_SURE = 2.0  # a climb is told if it is so many of its standard deviations


@dataclass(frozen=True)
class Climb:
    """Stairs or a slope on a leg: from ``after_m`` behind its beginning to ``before_m`` ahead of its end.

    ``ride`` says that nobody stepped meanwhile: a lift or an escalator.
    """

    after_m: float
    before_m: float
    rise_m: float
    ride: bool = False


@dataclass(frozen=True)
class Landmark:
    """Something the log marked, ``after_m`` from the beginning of a leg and ``before_m`` from its end."""

    label: str
    after_m: float
    before_m: float


@dataclass(frozen=True)
class Leg:
    """A piece of the way in one direction.

    Attributes:
        points_m: (x, y, z) of its breadcrumbs in the world frame, those of the turns at its ends included.
        direction: unit vector (East, North) of the direction walked, without the steps that turn.
        length_m: walked, on the plan.
        climbs: where it rises or falls by at least ``MIN_CLIMB_M``, and by more than its uncertainty.
        landmarks: in the order in which they are passed.
        sigma_along_m, sigma_across_m: standard deviation of its end as seen from its beginning, see ``leg_sigmas``;
            None where the estimator gives no covariance.
        sigma_rise_m: standard deviation of its rise; None where the estimator gives none of altitude.
    """

    points_m: tuple[tuple[float, float, float], ...]
    direction: tuple[float, float]
    length_m: float
    climbs: tuple[Climb, ...] = ()
    landmarks: tuple[Landmark, ...] = ()
    sigma_along_m: float | None = None
    sigma_across_m: float | None = None
    sigma_rise_m: float | None = None

    @property
    def yaw_rad(self) -> float:
        """Direction to walk, counter-clockwise from East."""
        return math.atan2(self.direction[1], self.direction[0])

    @property
    def rise_m(self) -> float:
        """From its beginning to its end."""
        return self.points_m[-1][2] - self.points_m[0][2]

    def reversed(self) -> Leg:
        """The same leg the other way; exact, so that twice is none."""
        return replace(
            self,
            points_m=self.points_m[::-1],
            direction=(-self.direction[0], -self.direction[1]),
            climbs=tuple(Climb(c.before_m, c.after_m, -c.rise_m, c.ride) for c in reversed(self.climbs)),
            landmarks=tuple(Landmark(m.label, m.before_m, m.after_m) for m in reversed(self.landmarks)),
        )


@dataclass(frozen=True)
class Directions:
    """Legs in the order in which they are to be walked.

    Attributes:
        name: of the walk.
        legs: at least one.
        pace_m: the wearer's own step length, to count steps with.
        sigma_m: root mean square distance by which the walk's end may be off as seen from its beginning, or None.
        compass: whether its directions are those of a compass; else only its turns are known.
        back: whether the walk is walked back, from its end to its start.
        integrity: how far the walk may be believed.
        left_out: loops and dead ends of the walk that are no part of it.
    """

    name: str
    legs: tuple[Leg, ...]
    pace_m: float
    sigma_m: float | None = None
    compass: bool = True
    back: bool = False
    integrity: Integrity = field(default_factory=Integrity)
    left_out: tuple[LeftOut, ...] = ()

    @property
    def caution(self) -> tuple[str, ...]:
        """What to know before following it, in a sentence each; nothing where the walk is sound."""
        return caution(self.integrity, "way")

    @property
    def length_m(self) -> float:
        """Of all legs."""
        return math.fsum(leg.length_m for leg in self.legs)

    @property
    def points_m(self) -> tuple[tuple[float, float, float], ...]:
        """Every breadcrumb, once."""
        return self.legs[0].points_m[:1] + tuple(point for leg in self.legs for point in leg.points_m[1:])

    def turn_rad(self, index: int) -> float:
        """Turn before a leg, positive to the left, in [-π, π); 0 before the first."""
        return wrap_scalar(self.legs[index].yaw_rad - self.legs[index - 1].yaw_rad) if index > 0 else 0.0

    def remaining_m(self, index: int) -> float:
        """Distance to go after a leg."""
        return math.fsum(leg.length_m for leg in self.legs[index + 1 :])

    def reversed(self) -> Directions:
        """The way back; exact, so that twice is the way itself."""
        return replace(self, legs=tuple(leg.reversed() for leg in reversed(self.legs)), back=not self.back)


def directions_of(
    trajectory: Trajectory,
    landmarks: Iterable[tuple[float, str]] = (),
    pace_m: float | None = None,
    graph: GraphConfig | None = None,
    name: str = "walk",
    compass: bool = True,
) -> Directions:
    """A walk as legs between its turns, in walking order; ``directions_of(...).reversed()`` leads back.

    Args:
        trajectory: the breadcrumbs.
        landmarks: (time on the trajectory's clock, label).
        pace_m: the wearer's step length; the median of the walk if None.
        graph: weights of the steps, for the uncertainty of the legs; without them it is None.
        name: of the walk.
        compass: whether the trajectory's y axis is known to point North.

    Raises:
        ConfigError: a pace that is not positive.
        DataError: fewer than two steps, which have no direction to speak of.
    """
    if pace_m is not None and not 0 < pace_m < math.inf:
        raise ConfigError(f"the pace must be a positive number of metres, not {pace_m:g}")
    if len(trajectory) < 3:
        raise DataError(f"{name}: {len(trajectory) - 1} step(s) make no way: at least two are needed")
    distance = trajectory.distance_m
    median_m = float(np.median(np.diff(distance)))
    if pace_m is None and not median_m > 0:
        raise DataError(f"{name}: the walk never moves; name the wearer's step length with --pace-m")
    edges = [0, *(turn.breadcrumb for turn in find_turns(trajectory)), len(trajectory) - 1]
    yaw = leg_yaws(trajectory, edges)
    marks = [(float(np.interp(t_s, trajectory.t_s, distance)), label) for t_s, label in landmarks]
    points = list(zip(trajectory.x_m.tolist(), trajectory.y_m.tolist(), trajectory.z_m.tolist(), strict=True))
    legs = []
    for leg, (lo, hi) in enumerate(itertools.pairwise(edges)):
        start_m, end_m = float(distance[lo]), float(distance[hi])
        last = hi == edges[-1]
        here = sorted((at_m, label) for at_m, label in marks if start_m <= at_m and (at_m < end_m or last))
        along_m, across_m = leg_sigmas(trajectory, lo, hi, float(yaw[leg]), graph)
        legs.append(
            Leg(
                points_m=tuple(points[lo : hi + 1]),
                direction=(math.cos(yaw[leg]), math.sin(yaw[leg])),
                length_m=end_m - start_m,
                climbs=_told_climbs(trajectory, lo, hi),
                landmarks=tuple(Landmark(label, at_m - start_m, end_m - at_m) for at_m, label in here),
                sigma_along_m=along_m,
                sigma_across_m=across_m,
                sigma_rise_m=_sigma_rise_m(trajectory, lo, hi),
            )
        )
    cov = trajectory.cov_xy_yaw
    ends = None if cov is None else sum(math.sqrt(cov[k, 0, 0] + cov[k, 1, 1]) for k in (0, -1))
    sigma_m = ends if ends is not None and math.isfinite(ends) else None
    return Directions(name, tuple(legs), pace_m or median_m, sigma_m, compass)


def leg_sigmas(
    trajectory: Trajectory, lo: int, hi: int, yaw_rad: float, graph: GraphConfig | None
) -> tuple[float | None, float | None]:
    """Standard deviation, along and across, of the end of a leg as seen from its beginning by somebody with a compass.

    Only the marginal of each breadcrumb is stored, not how two of them go together, so the leg's is computed from the
    model of its steps. Along: their independent errors, the scale they share, and the error of what the slope took from
    them. Across: their sideways errors, and the stored heading errors, taken to be the same all along the leg, which is
    the worst they can be. By the triangle inequality of standard deviations it then lies between the difference and the
    sum of those of the two ends. Last, a turn happens somewhere within a step (uniform, at either end).

    Args:
        trajectory: the breadcrumbs.
        lo, hi: the first and last of the leg.
        yaw_rad: its direction.
        graph: weights of the steps.

    Returns:
        metres, or (None, None) without covariance or ``graph``.
    """
    cov = trajectory.cov_xy_yaw
    if cov is None or graph is None or not np.isfinite(cov[[lo, hi]][:, [0, 0, 1, 2], [0, 1, 1, 2]]).all():
        return None, None
    walked = np.diff(trajectory.distance_m)
    usual_m, step_m = float(np.median(walked)), walked[lo:hi]
    climbing = np.abs(np.diff(trajectory.z_m[lo : hi + 1])) > _STEEP * step_m
    slope_m = graph.sigma_slope_rel * float(np.maximum(usual_m - step_m, 0.0)[climbing].sum())
    scale_m = graph.sigma_length_scale * float(step_m.sum())
    along = math.hypot(graph.sigma_length_rel * float(np.linalg.norm(step_m)), scale_m, slope_m)
    sigma_yaw = np.sqrt(cov[lo + 1 : hi + 1, 2, 2])
    across = math.hypot(graph.sigma_lateral_m * math.sqrt(hi - lo), float(step_m @ sigma_yaw))
    bounded = []
    for axis_rad, sigma in ((yaw_rad, along), (yaw_rad + math.pi / 2.0, across)):
        axis = np.array((math.cos(axis_rad), math.sin(axis_rad)))
        first, last = (math.sqrt(max(float(axis @ cov[k, :2, :2] @ axis), 0.0)) for k in (lo, hi))
        bounded.append(min(max(sigma, abs(last - first)), last + first))
    return math.hypot(bounded[0], usual_m * math.sqrt(2.0 / 12.0)), bounded[1]


def surely_climbs(rise_m: float, sigma_m: float | None) -> bool:
    """Whether a rise is worth telling: a metre, and beyond what its standard deviation allows."""
    return abs(rise_m) >= max(MIN_CLIMB_M, _SURE * (sigma_m or 0.0))


def _sigma_rise_m(trajectory: Trajectory, lo: int, hi: int) -> float | None:
    """Standard deviation of the rise from one breadcrumb to another.

    Errors of altitude add up along a walk, so the difference of the two variances is that of what lies between.
    """
    sigma = trajectory.sigma_z_m
    if sigma is None or not np.isfinite(sigma[[lo, hi]]).all():
        return None
    return math.sqrt(abs(float(sigma[hi] ** 2 - sigma[lo] ** 2)))


def _told_climbs(trajectory: Trajectory, lo: int, hi: int) -> tuple[Climb, ...]:
    """Rides, and slopes without them, between two breadcrumbs, in the order in which they are met."""
    distance_m, z_m = trajectory.distance_m[lo : hi + 1], trajectory.z_m[lo : hi + 1]
    rise_m = np.diff(z_m)
    fast = np.where(np.abs(rise_m) > _RIDE_STEP_M, np.sign(rise_m), 0.0)
    edges = np.flatnonzero(np.diff(fast, prepend=0.0, append=0.0)).tolist()
    rides: list[Climb] = []
    for first, last in itertools.pairwise(edges):
        ridden_m = float(z_m[last] - z_m[first])
        if abs(ridden_m) >= _RIDE_M and fast[first]:
            after_m = float(distance_m[first] - distance_m[0])
            rides.append(Climb(after_m, float(distance_m[-1] - distance_m[last]), ridden_m, ride=True))
            rise_m[first:last] = 0.0
    level_m = np.concatenate(([0.0], np.cumsum(rise_m)))
    sigma_m = _sigma_rise_m(trajectory, lo, hi)
    slopes = [climb for climb in _climbs(distance_m, level_m) if surely_climbs(climb.rise_m, sigma_m)]
    return tuple(sorted([*rides, *slopes], key=lambda climb: climb.after_m))


def _climbs(distance_m: FloatArray, z_m: FloatArray) -> Iterable[Climb]:
    """Rises and falls of at least ``MIN_CLIMB_M``, each where its middle eight tenths happen."""
    from scipy.signal import find_peaks  # here, because it takes a third of a second to import

    tops, bottoms = (find_peaks(sign * z_m, prominence=MIN_CLIMB_M)[0] for sign in (1.0, -1.0))
    ends = sorted({0, *tops.tolist(), *bottoms.tolist(), len(z_m) - 1})
    for lo, hi in itertools.pairwise(ends):
        rise_m = float(z_m[hi] - z_m[lo])
        if abs(rise_m) < MIN_CLIMB_M:
            continue
        done = (z_m[lo : hi + 1] - z_m[lo]) / rise_m
        first, last = lo + int(np.flatnonzero(done <= 0.1)[-1]), lo + int(np.flatnonzero(done >= 0.9)[0])
        if first >= last:
            first, last = lo, hi
        yield Climb(float(distance_m[first] - distance_m[0]), float(distance_m[-1] - distance_m[last]), rise_m)
