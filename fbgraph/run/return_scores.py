"""How well the way back was told: return errors, turn-back, arrival, false alarms, wrong closures, against truth.

Return error: when a checkpoint is passed again, |route distance of the breadcrumb that the wearer is said to be at -
route distance of the one dropped when it was first passed|, from the samples up to that moment alone. Which checkpoint
repeats which comes from the truth. Times ``t_s`` are seconds since log start throughout.

    >>> told = follow_back(log, config, "auto")
    >>> turned, pairs = passes(truth.xy_m)
    >>> return_errors(told.route_rows, told.outbound, truth.t_s - log.t0_s, pairs).mean()
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fbgraph.core.config import Config
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.front_end.step_track import StepTrack
from fbgraph.simulator.routes import Route
from fbgraph.simulator.simulate import SimulatedWalk
from fbgraph.way_back.guide import ReturnGuide
from fbgraph.way_back.matcher import RouteMatcher
from fbgraph.way_back.records import Closure, ReturnUpdate, TurnBack
from fbgraph.way_back.turn_back import reversal
from fbgraph.way_back.way_out import Outbound, level_length_m

WRONG_M = 3.0
"""A closure of breadcrumbs that truly lie further apart is wrong."""
_SAME_M = 0.05  # checkpoints nearer to each other are one place
_REJOINED_M = 10.0  # walked after a detour before being off route counts as false

Pairs = Sequence[tuple[int, int]]
"""(earlier, later): indices of checkpoints at the same place, passed on the way out and again after the turn-back."""
RouteRows = Sequence[tuple[float, float]]
"""(time until which samples had been seen, route distance at which the wearer was said to be), in order of time."""


@dataclass(frozen=True)
class Returned:
    """A walk with its way back as it was told.

    Attributes:
        rows: what was told at each step of the way back, each with the time until which samples had been seen.
        outbound: the way out as the way back was compared with it; None if no way back began.
        turn_back: where the way out ended; None likewise.
        closures: matches that entered the graph.
        track: the steps.
    """

    rows: tuple[tuple[float, ReturnUpdate], ...]
    outbound: Outbound | None
    turn_back: TurnBack | None
    closures: tuple[Closure, ...]
    track: StepTrack

    @property
    def route_rows(self) -> RouteRows:
        """The rows as ``return_errors`` takes them."""
        return [(seen_s, update.route_m) for seen_s, update in self.rows]


def follow_back(log: SensorLog, config: Config, at: str, piece_s: float = 0.1) -> Returned:
    """Feed a log to the online smoother in pieces, as it would come from a device, and note what was told when.

    Args:
        log: the walk.
        config: the effective configuration.
        at: when the way back begins, as ``returning.at``: auto, event or seconds since log start.
        piece_s: length of the pieces.

    Raises:
        EstimationError: the solver failed.
    """
    guide = ReturnGuide(config.model_copy(update={"returning": config.returning.model_copy(update={"at": at})}))
    smoother = OnlineSmoother(config, companion=guide)
    rows = []
    edges = [-np.inf, *np.arange(piece_s, log.duration_s, piece_s).tolist(), np.inf]
    for start_s, until_s in itertools.pairwise(edges):
        for update in smoother.feed(log.between(start_s, until_s)):
            if update.returning is not None:
                rows.append((min(until_s, log.duration_s), update.returning))
    return Returned(tuple(rows), guide.outbound, guide.turn_back, tuple(guide.closures), smoother.track)


def passes(xy_m: FloatArray) -> tuple[int, list[tuple[int, int]]]:
    """Checkpoint of the turn-back, and pairs of passes of the same place, backwards from there.

    After a full way back the way out may be walked again, in either direction; those passes repeat it too.

    Args:
        xy_m: (M, 2) true checkpoints in order of time; that of the turn-back stands twice, before and after a pause.

    Raises:
        DataError: not a walk out and back.
    """
    same = np.hypot(*(xy_m[:, None] - xy_m).transpose(2, 0, 1)) < _SAME_M
    paused = np.flatnonzero(same[np.arange(len(xy_m) - 1), np.arange(1, len(xy_m))])
    if len(paused) == 0:
        raise DataError("not a walk out and back: no checkpoint is passed twice in a row")
    turned = int(paused[0])
    pairs, at, step = [], turned, -1
    for later in range(turned + 1, len(xy_m)):
        if not same[at, later]:  # the same place again at the ends, the next one between them
            at += step
        if not same[at, later]:
            raise DataError(f"not a walk out and back: checkpoint {later + 1} is not on the way out")
        pairs.append((at, later))
        if at == 0:
            step = 1
        elif at == turned:
            step = -1
    return turned, pairs


def return_errors(
    rows: RouteRows, outbound: Outbound, t_s: FloatArray, pairs: Pairs, unknown_m: float = np.nan
) -> FloatArray:
    """(P,) return errors in metres, one a pair.

    Args:
        rows: where the wearer was said to be.
        outbound: the way out that its distances refer to.
        t_s: (M,) when the checkpoints were passed.
        pairs: P pairs of them.
        unknown_m: route distance to take where nothing had been said yet; with nan the error is nan too.
    """
    errors = []
    for earlier, later in pairs:
        known = [route_m for seen_s, route_m in rows if seen_s <= t_s[later]]
        first = int(np.argmin(np.abs(outbound.t_s - t_s[earlier])))
        errors.append(abs((known[-1] if known else unknown_m) - outbound.route_m[first]))
    return np.array(errors, dtype=np.float64)


def follow_by_position(
    trajectory: Trajectory, track: StepTrack, config: Config, at_s: float, length_m: FloatArray
) -> tuple[RouteRows, Outbound]:
    """The same matcher by position alone, on a trajectory that knows nothing of ways back.

    Args:
        trajectory: an estimator's, of the whole walk.
        track: its K steps.
        config: of the matcher.
        at_s: when the wearer says that the way back begins.
        length_m: (K+1,) step lengths of that estimator, 0 for the standing start.

    Returns:
        Where the wearer would have been said to be at each step of the way back, and the way out.
    """
    k = int(np.searchsorted(track.t_s, at_s))
    walked = np.cumsum(length_m)
    xyz_m = np.column_stack((trajectory.x_m, trajectory.y_m, trajectory.z_m))
    last = reversal(xyz_m[:k], trajectory.yaw_rad[:k], walked[:k], config.returning.apart_m)
    outbound = Outbound.of(trajectory, track.steps, config.step_length, last)
    blank = np.full(last + 1, np.nan)
    outbound = replace(outbound, level_m=walked[: last + 1], mag_up_ut=blank, mag_level_ut=blank, altitude_m=blank)
    matcher = RouteMatcher(outbound, config.returning.model_copy(update={"sigma_turn_rad": 1e6}))
    rows = []
    for j in range(last + 1, len(track)):
        length = float(length_m[j])
        match = matcher.advance(length, length, float(trajectory.yaw_rad[j]), (np.nan, np.nan), np.nan)
        rows.append((float(track.t_s[j]), float(outbound.route_m[match.breadcrumb])))
    return rows, outbound


def level_lengths_m(track: StepTrack, config: Config) -> FloatArray:
    """(K+1,) how long each step would have been on the level; 0 for the standing start."""
    return np.array([level_length_m(step, config.step_length) for step in track.steps])


def wrong_closures(
    closures: Sequence[Closure], track: StepTrack, walked_m: FloatArray, t_s: FloatArray, pairs: Pairs
) -> int:
    """How many closures tie places more than ``WRONG_M`` apart.

    Between checkpoints, the distance walked tells the place.

    Args:
        closures: of the walk.
        track: its K steps.
        walked_m: (K+1,) distance walked up to each breadcrumb, as if on the level.
        t_s: (M,) when the checkpoints were passed.
        pairs: which of them are the same place.
    """
    if not closures:
        return 0
    turned = pairs[0][0]
    place_m = np.interp(t_s[: turned + 1], track.t_s, walked_m)  # of the checkpoints of the way out
    knots_m = np.interp(t_s[[later for _, later in pairs]], track.t_s, walked_m)
    values_m = place_m[[earlier for earlier, _ in pairs]]
    away = [np.interp(walked_m[c.j], knots_m, values_m) - walked_m[c.i] - c.along_m for c in closures]
    return int((np.abs(away) > WRONG_M).sum())


@dataclass(frozen=True)
class ReturnScore:
    """A real walk out and back, scored at its checkpoints.

    Attributes:
        told_m: (P,) return errors when told of the turn at its checkpoint.
        auto_m: (P,) return errors when the turn-back was to be noticed; nan before it was.
        turn_off_s: noticed turn-back against the pause at the turn.
        delay_s: from the end of that pause until it was known.
        arrived_m: between where arrival was announced and the first checkpoint, as walked; nan if it was not.
        off_route: rows that say so, of both.
        closures, wrong: how many, and how many of them wrong, when noticed.
    """

    told_m: FloatArray
    auto_m: FloatArray
    turn_off_s: float
    delay_s: float
    arrived_m: float
    off_route: int
    closures: int
    wrong: int


def score_return(
    log: SensorLog, xy_m: FloatArray, t_s: FloatArray, config: Config, piece_s: float = 0.1
) -> ReturnScore:
    """Follow a log's way back, told of the turn and by itself, and score both.

    Args:
        log: a walk out and back with a pause at the turn.
        xy_m: (M, 2) true checkpoints; see ``passes``.
        t_s: (M,) when they were passed.
        config: the effective configuration.
        piece_s: as in ``follow_back``.

    Raises:
        DataError: not a walk out and back, or its turn-back was not noticed.
        EstimationError: the solver failed.
    """
    turned, pairs = passes(xy_m)
    told, auto = (follow_back(log, config, at, piece_s) for at in (f"{t_s[turned]:.3f}", "auto"))
    back = auto.turn_back
    if back is None or auto.outbound is None or told.outbound is None:
        raise DataError(f"{log.name}: no turn-back noticed")
    arrived = [update for _, update in auto.rows if update.arrived]
    home = next(later for earlier, later in pairs if earlier == 0)
    track = auto.track
    walked_m = np.cumsum(track.length_m)
    home_m = float(np.interp(t_s[home], track.t_s, walked_m))
    level_m = np.cumsum(level_lengths_m(track, config))
    return ReturnScore(
        told_m=return_errors(told.route_rows, told.outbound, t_s, pairs),
        auto_m=return_errors(auto.route_rows, auto.outbound, t_s, pairs),
        turn_off_s=float(max(t_s[turned] - back.t_s, back.t_s - t_s[turned + 1], 0.0)),
        delay_s=float(back.known_s - t_s[turned + 1]),
        arrived_m=abs(home_m - float(walked_m[arrived[0].k])) if arrived else np.nan,
        off_route=sum(update.off_route for _, update in (*told.rows, *auto.rows)),
        closures=len(auto.closures),
        wrong=wrong_closures(auto.closures, track, level_m, t_s, pairs),
    )


def retraced_m(xy_m: FloatArray, apart_m: float = 3.0, grid_m: float = 0.5) -> float:
    """The longest stretch over which the straight lines between waypoints go back over their own way.

    Args:
        xy_m: (M, 2) waypoints in order of time.
        apart_m: how far from the way the way back may be.
        grid_m: how finely to look.
    """
    walked = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T)))
    longest = 0.0
    for turn_m in np.arange(2.0 * grid_m, walked[-1], grid_m):
        away = np.arange(grid_m, min(turn_m, walked[-1] - turn_m), grid_m)
        after, before = (
            np.column_stack([np.interp(at, walked, c) for c in xy_m.T]) for at in (turn_m + away, turn_m - away)
        )
        apart = np.flatnonzero(np.hypot(*(after - before).T) > apart_m)
        longest = max(longest, grid_m * float(apart[0] if len(apart) else len(away)))
    return longest


def random_return_route(seed: int, detour: bool) -> tuple[Route, tuple[int, int] | None]:
    """Out and back over four to seven random legs of 10 to 25 m, with a pause of 10 s at the far end.

    Args:
        seed: of the legs.
        detour: whether the way back leaves the route for 20 m, at a right angle, in the middle of a leg.

    Returns:
        The route, and the first and last waypoint of the detour if there is one.
    """
    rng = np.random.default_rng(seed)
    yaw, xy = 0.0, [np.zeros(2)]
    for _ in range(int(rng.integers(4, 8))):
        xy.append(xy[-1] + rng.uniform(10.0, 25.0) * np.array([np.cos(yaw), np.sin(yaw)]))
        yaw += rng.choice((-1.0, 1.0)) * np.radians(rng.uniform(40.0, 100.0))
    out = np.array(xy)
    way = [*out, *out[-2::-1]]
    pause = [0.0] * len(way)
    pause[len(out) - 1] = 10.0
    span = None
    if detour:  # to the side that is further away from the rest of the route
        leg = len(out) + int(rng.integers(0, len(out) - 2))
        a, b = way[leg - 1], way[leg]
        middle, along = 0.5 * (a + b), (b - a) / np.hypot(*(b - a))
        sides = [middle + 20.0 * s * np.array([-along[1], along[0]]) for s in (1.0, -1.0)]
        far = max(sides, key=lambda p: float(np.hypot(*(out - p).T).min()))
        way[leg:leg] = [middle, far, middle + 0.1 * along]
        pause[leg:leg] = [0.0, 0.0, 0.0]
        span = (leg, leg + 2)
    rows = np.column_stack((np.array(way), np.zeros(len(way))))
    labels = tuple(str(k) for k in range(len(rows)))
    return Route(f"detour-{seed}" if detour else f"out-and-back-{seed}", rows, np.array(pause), labels), span


@dataclass(frozen=True)
class SimulatedReturnScore:
    """A simulated walk out and back, scored at every step of its way back.

    Attributes:
        error_m: (S,) route distance told against that of the true place, at each step on the route.
        false_off: rows off route while the wearer was on it.
        flagged_after_m: walked on a detour until it was told; nan without a detour.
        back_after_m: walked after a detour until it was told that it is over; nan likewise.
        arrived_m: true distance from the start where arrival was announced; nan if it was not.
        closures, wrong: how many, and how many of them wrong.
    """

    error_m: FloatArray
    false_off: int
    flagged_after_m: float
    back_after_m: float
    arrived_m: float
    closures: int
    wrong: int


def score_simulated_return(
    walk: SimulatedWalk, returned: Returned, turned_s: float, detour_s: tuple[float, float] | None = None
) -> SimulatedReturnScore:
    """Score what was told on a simulated way back against where the walker truly was.

    Args:
        walk: from ``simulate``.
        returned: what was told, from ``follow_back``.
        turned_s: when the far end was reached.
        detour_s: when the route was left, and reached again; None if it never was.
    """
    xy_m = np.column_stack((walk.x_m, walk.y_m))
    walked_m = np.append(0.0, np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T)))
    out = walk.t_s <= turned_s
    leave_s, join_s = detour_s or (np.inf, np.inf)

    def walked_at(when_s: float) -> float:
        return float(np.interp(min(when_s, walk.t_s[-1]), walk.t_s, walked_m))

    def place(when_s: float) -> FloatArray:
        return np.array([np.interp(when_s, walk.t_s, axis) for axis in xy_m.T])

    errors, false_off, flagged_s, back_s, arrived_m = [], 0, np.inf, np.inf, np.nan
    for seen_s, update in returned.rows:
        here = place(update.t_s)
        if leave_s <= update.t_s <= join_s:
            flagged_s = min(flagged_s, seen_s if update.off_route else np.inf)
            continue
        if update.t_s > join_s and not update.off_route:
            back_s = min(back_s, seen_s)
        if update.t_s < leave_s or walked_at(update.t_s) > walked_at(join_s) + _REJOINED_M:
            false_off += update.off_route
        if update.arrived:
            arrived_m = float(np.hypot(*here))
        if not update.off_route:
            nearest = int(np.argmin(np.hypot(*(xy_m[out] - here).T)))
            errors.append(abs(walked_at(update.breadcrumb_t_s) - walked_m[nearest]))
    at_s = returned.track.t_s
    apart_m = [float(np.hypot(*(place(at_s[c.i]) - place(at_s[c.j])))) for c in returned.closures]
    return SimulatedReturnScore(
        error_m=np.array(errors, dtype=np.float64),
        false_off=false_off,
        flagged_after_m=walked_at(flagged_s) - walked_at(leave_s) if detour_s else np.nan,
        back_after_m=walked_at(back_s) - walked_at(join_s) if detour_s else np.nan,
        arrived_m=arrived_m,
        closures=len(apart_m),
        wrong=sum(apart > WRONG_M for apart in apart_m),
    )
