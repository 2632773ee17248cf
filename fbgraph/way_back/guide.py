"""The way back, live: where on the way out the wearer is, what to do next, and what the graph may learn from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from fbgraph.core.config import Config
from fbgraph.core.sensor_log import Event
from fbgraph.core.trajectory import Breadcrumb, Trajectory
from fbgraph.front_end.step_track import Step
from fbgraph.way_back.closures import beside_m
from fbgraph.way_back.follower import RouteFollower
from fbgraph.way_back.records import Closure, Match, ReturnUpdate, TurnBack
from fbgraph.way_back.texts import turn_text
from fbgraph.way_back.turn_back import TurnBackDetector, crumb_of, reversal
from fbgraph.way_back.turns import Turn, find_turns
from fbgraph.way_back.way_out import Outbound, level_length_m

_SOON_M = 15.0  # a turn further away is not announced yet
_HERE_M = 1.5
_AHEAD_RAD = math.radians(45.0)
_WRONG_WAY_M = 2.0  # walked out instead of back before it is said


class ReturnGuide:
    """Companion of an ``OnlineSmoother``: told every step, it waits for the way back and then follows it.

    Attributes:
        updates: what was told at each step of the way back.
        turn_back: the end of the way out; None until it is known.
        outbound: the way out; None until it is known where it ended.
        closures: matches that were good enough for the graph.
    """

    def __init__(self, config: Config) -> None:
        """A guide for one walk.

        Args:
            config: ``config.returning.at`` says when the way back begins: never, auto, event, event:NAME or a
                time.
        """
        self._config = config.returning
        self._length = config.step_length
        at = config.returning.at
        mode, _, name = at.partition(":")
        self._mode = mode if mode in ("never", "auto", "event") else "time"
        self._named = name.split()
        self._at_s = float(at) if self._mode == "time" else math.inf
        self._detector = TurnBackDetector(self._config.retraced_m)
        self._events_s: list[float] = []
        self._steps: list[Step] = []
        self._yaws: list[float] = []
        self._walked_m = 0.0
        self._follower: RouteFollower | None = None
        self._arrived = False
        self._caution, self._cautioned = "", False
        self._wrong_way_m = 0.0
        self.updates: list[ReturnUpdate] = []
        self.closures: list[Closure] = []
        self.turn_back: TurnBack | None = None
        self.outbound: Outbound | None = None

    def note(self, events: Iterable[Event]) -> None:
        """Take events of the log, not later than the steps that come after them."""
        if self._mode == "event":
            named = self._named
            self._events_s.extend(e.t_s for e in events if not named or all(word in e.label.split() for word in named))

    def advance(
        self, update: Breadcrumb, step: Step, estimate: Callable[[], Trajectory]
    ) -> tuple[ReturnUpdate | None, list[Closure]]:
        """Take the next breadcrumb; return what to tell the wearer and the graph.

        Args:
            update: its state as known at its step.
            step: the step.
            estimate: gives all breadcrumbs as known now.
        """
        self._steps.append(step)
        self._yaws.append(update.yaw_rad)
        self._walked_m += level_length_m(step, self._length)
        told = len(self.updates)
        closures = self._begin(update, step, estimate) if self._follower is None else self._follow(update.k, tell=True)
        return (self.updates[-1] if len(self.updates) > told else None), closures

    def distrust(self, caution: str) -> None:
        """From now on say with every direction that the position is doubtful, and with the next one why."""
        if caution != self._caution:
            self._caution, self._cautioned = caution, False

    def warnings(self) -> list[str]:
        """What the user should know when the walk has ended."""
        if self._mode == "never" or self.turn_back is not None:
            return []
        if self._mode == "event":
            named = f" named {' '.join(self._named)}" if self._named else ""
            found = f"the log has no event{named} after walking began"
            return [f"--return-at event: {found}, so there was no way back to guide"]
        if self._mode == "auto":
            return ["--return-at auto: no turn-back was noticed, so there was no way back to guide"]
        last_s = f"{self._steps[-1].t_s:.1f} s" if self._steps else "never"
        return [f"--return-at {self._at_s:g}: later than the last step ({last_s}), so there was no way back to guide"]

    def _begin(self, update: Breadcrumb, step: Step, estimate: Callable[[], Trajectory]) -> list[Closure]:
        """Whether the way back has begun with this step; if so, catch up with it."""
        k = update.k
        if self._mode == "auto":
            place = update.x_m, update.y_m, update.z_m, update.yaw_rad
            self.turn_back = self._detector.advance(crumb_of(step, place, self._walked_m))
            if self.turn_back is None:
                return []
            known = estimate()
        else:
            if self._mode == "event" and self._events_s:
                began_s = self._steps[0].t_s
                self._at_s = min((at_s for at_s in self._events_s if at_s > began_s), default=math.inf)
            if k < 2 or step.t_s < self._at_s:
                return []
            known = estimate()
            walked = np.cumsum([level_length_m(s, self._length) for s in self._steps])
            xyz_m = np.column_stack((known.x_m, known.y_m, known.z_m))
            last = reversal(xyz_m[:k], known.yaw_rad[:k], walked[:k], self._config.apart_m)
            self.turn_back = TurnBack(max(last, 1), float(known.t_s[max(last, 1)]), step.t_s)
        turned = self.turn_back.breadcrumb
        self.outbound = outbound = Outbound.of(known, self._steps, self._length, turned)
        self._turns = _turns_back(known, turned, outbound)
        self._follower = RouteFollower(outbound, self._length, self._config, beside_m(known, turned))
        found: list[Closure] = []
        for j in range(turned + 1, k + 1):
            self._yaws[j] = float(known.yaw_rad[j])
            found += self._follow(j, tell=j == k)
        return found

    def _follow(self, k: int, tell: bool) -> list[Closure]:
        assert self._follower is not None  # the way back has begun
        step = self._steps[k]
        match, closure = self._follower.advance(self._steps, k, self._yaws[k])
        wrong_way = not match.facing_back and not match.off_route
        self._wrong_way_m = self._wrong_way_m + step.length_m if wrong_way else 0.0
        if tell:
            self.updates.append(self._told(k, step, match))
        if closure is None:
            return []
        self.closures.append(closure)
        return [closure]

    def _told(self, k: int, step: Step, match: Match) -> ReturnUpdate:
        remaining_m = match.route_m
        turn = next((t for t in self._turns if t[0] < remaining_m - 0.5), None)
        here = not match.off_route and remaining_m <= self._config.arrived_m
        arrived = here and not self._arrived
        self._arrived |= here
        words = next_instruction(match, turn, remaining_m, self._wrong_way_m, arrived)
        if self._arrived and not arrived:
            words = ""  # nothing more to say
        elif self._caution:
            words = f"position doubtful{'' if self._cautioned else f': {self._caution}'}; {words}"
            self._cautioned = True
        outbound = self.outbound
        assert outbound is not None  # the way back has begun
        return ReturnUpdate(
            t_s=step.t_s,
            k=k,
            breadcrumb=match.breadcrumb,
            breadcrumb_t_s=float(outbound.t_s[match.breadcrumb]),
            route_m=float(outbound.route_m[match.breadcrumb]),
            remaining_m=remaining_m,
            cross_track_m=match.cross_m,
            next_turn_m=None if turn is None else remaining_m - turn[0],
            next_turn_rad=None if turn is None else turn[1],
            sigma_m=match.sigma_m,
            off_route=match.off_route,
            arrived=arrived,
            instruction=words,
        )


def next_instruction(
    match: Match, turn: tuple[float, float] | None, remaining_m: float, wrong_way_m: float, arrived: bool
) -> str:
    """The next thing to do, in a sentence.

    Args:
        match: where the wearer is.
        turn: the next turn: its distance along the route, its angle as met on the way back (left positive).
        remaining_m: left to the start.
        wrong_way_m: how long the wearer has been walking out instead of back.
        arrived: the start is reached.
    """
    if match.off_route:
        return f"off route: the route is {abs(match.cross_m):.0f} m {_side(match.bearing_rad)}"
    if arrived:
        return "you are back at the start"
    if wrong_way_m >= _WRONG_WAY_M:
        return "turn around"
    if turn is None or remaining_m - turn[0] > _SOON_M:
        return f"straight on for {remaining_m - (turn[0] if turn else 0.0):.0f} m"
    ahead_m = remaining_m - turn[0]
    return f"{turn_text(turn[1])} " + ("now" if ahead_m < _HERE_M else f"in {ahead_m:.0f} m")


def _side(bearing_rad: float) -> str:
    if abs(bearing_rad) < _AHEAD_RAD:
        return "ahead"
    if abs(bearing_rad) > math.pi - _AHEAD_RAD:
        return "behind you"
    return "to your left" if bearing_rad > 0 else "to your right"


def _turns_back(known: Trajectory, last: int, outbound: Outbound) -> list[tuple[float, float]]:
    """Turns of the way out as met on the way back, the nearest to its end first: distance along the route, angle."""
    n = last + 1
    columns = (known.t_s, known.x_m, known.y_m, known.z_m, known.yaw_rad, known.gyro_bias_rad_s)
    turns: list[Turn] = find_turns(Trajectory(*(column[:n] for column in columns)))
    return [(float(outbound.route_m[turn.breadcrumb]), -turn.angle_rad) for turn in reversed(turns)]
