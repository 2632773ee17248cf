"""Where along the outbound route: a forward filter over route distance (a hidden Markov model on a grid).

The state is the wearer's distance along the route walked out, in bins. A step moves the belief by its length projected
on the route there, so walking back, walking on and milling about need no states of their own. What is compared with the
route: direction (turns), place, altitude, and the magnetic field: its vertical component, which does not care which way
the device faces, and its horizontal one less what the device itself adds. Distance is counted as if on the level, by
which a staircase is as long up as down.

The wearer's place in the frame of the route is dead reckoning, drawn softly to the route and turned slowly into its
direction as long as it is followed. When it leaves the corridor the wearer is off the route; from then on every place
of the route that the wearer comes near, in its direction, may be where it is met again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fbgraph.core.config import ReturnConfig
from fbgraph.core.geometry import BoolArray, FloatArray, wrap_scalar
from fbgraph.way_back.records import Match
from fbgraph.way_back.way_out import Outbound

_BIN_M = 0.25
_WINDOW_BINS = 1000  # on either side of where the wearer is: further away nobody gets in a step
_SIDE_M = 1.0  # the direction of the route at a place is that over this distance to either side
_PEAK_M = 3.0  # the match is read out within this distance of the belief's peak
_STEP_M = 0.65
# errors of neighbouring steps are alike: what a step says counts by this much
_PLACE, _TURN, _MAG, _LEVEL, _ALTITUDE = 0.15, 0.3, 0.5, 0.25, 0.2
_FORGET = 0.05  # of the device's own horizontal field, a step
_JUMP, _JUMP_STEPS = 0.07, 1.0  # steps missed or counted twice: share, and how far in steps
_GAP_M_S, _GAP_MOST_M = 1.0, 20.0  # where the log is silent
_DRIFT_RAD, _DRIFT_M = math.radians(20.0), 25.0  # of direction on the way back against that on the way out
_OUTWARD = 0.1  # who walks back along the route is told so as long as that is this likely against walking out
_ANYWHERE = 0.03  # once lost, a step's chance to be anywhere near
_ALONG_RAD = math.radians(50.0)
_ALONG_M = 2.5  # walked along the route before it counts as met again


@dataclass(frozen=True)
class _Nearby:
    """The bins of the route that a step looks at, and how they lie to it.

    Attributes:
        window: which bins of the whole route.
        grid: (B,) their distances along the route, in metres as if on the level.
        x, y: (B,) their places.
        cos, sin: (B,) of the route's direction on the way out.
        cosine: (B,) of the angle between step and route.
        back: (B,) whether the step leads back along the route.
        aside: (B,) angle between the step and the line of the route, whichever way, in radians.
        squared: (B,) squared distance of the wearer, in m².
    """

    window: slice
    grid: FloatArray
    x: FloatArray
    y: FloatArray
    cos: FloatArray
    sin: FloatArray
    cosine: FloatArray
    back: BoolArray
    aside: FloatArray
    squared: FloatArray


@dataclass(frozen=True)
class _Place:
    """Where on the route the belief is: bins ``lo`` to ``hi`` about its peak, of those nearby.

    Attributes:
        at: the bin of its mean.
        at_m: its mean, in metres along the grid.
        sigma_m: its spread.
    """

    lo: int
    hi: int
    at: int
    at_m: float
    sigma_m: float


class RouteMatcher:
    """Steps after the turn-back in, matches out; causal."""

    def __init__(self, outbound: Outbound, config: ReturnConfig) -> None:
        """The wearer is at the end of the route, give or take ``config.sigma_place_m``."""
        self._config = config
        self._outbound = outbound
        at = outbound.level_m
        total = float(at[-1])
        self._bin_m = _BIN_M
        self._grid = np.minimum(np.arange(0.0, total + self._bin_m, self._bin_m), total)
        self._route = np.interp(self._grid, at, outbound.route_m)
        self._x, self._y = (np.interp(self._grid, at, axis) for axis in (outbound.x_m, outbound.y_m))
        # what a step tells is the mean over it: of half a step before its end, which is nearer to the start going out
        # and farther from it coming back
        half = 0.5 * np.diff(at, prepend=at[0])
        seen = self._grid + float(np.median(half))
        self._up, self._level, self._altitude = (
            _on_grid(seen, at - half, values)
            for values in (outbound.mag_up_ut, outbound.mag_level_ut, outbound.altitude_m)
        )
        ahead, behind = np.minimum(seen + _SIDE_M, total), np.maximum(np.minimum(seen, total) - _SIDE_M, 0.0)
        along = [np.interp(ahead, at, axis) - np.interp(behind, at, axis) for axis in (outbound.x_m, outbound.y_m)]
        length = np.maximum(np.hypot(*along), 1e-6)
        self._cos, self._sin = along[0] / length, along[1] / length
        belief = np.exp(-0.5 * ((self._grid - total) / 1.0) ** 2)
        self._belief: FloatArray = belief / belief.sum()
        self._px, self._py = float(self._x[-1]), float(self._y[-1])
        self._var = 0.25
        self._off = False
        self._along_m = self._steady_m = 0.0
        self._level_shift_ut = self._turned_rad = 0.0

    def advance(
        self,
        length_m: float,
        level_m: float,
        yaw_rad: float,
        field_ut: tuple[float, float],
        altitude_m: float,
        gap_s: float = 0.0,
    ) -> Match:
        """Take the next step.

        Args:
            length_m: of the step on the plan.
            level_m: of the step, had it been on the level.
            yaw_rad: its direction.
            field_ut: as by ``field_of``; nan if not known.
            altitude_m: barometric; nan if not known.
            gap_s: how long the log was silent before the step.
        """
        if gap_s > 0.0:
            self._spread(min(_GAP_M_S * gap_s, _GAP_MOST_M))
        yaw_rad -= self._turned_rad
        near = self._walk(length_m, yaw_rad)
        bound_m = self._config.corridor_m + 2.0 * math.sqrt(self._var)
        belief = self._predicted(near.window, level_m, near.cosine)
        lost = self._lost(near, belief, bound_m)
        belief = self._updated(near, belief, lost, level_m, field_ut, altitude_m)
        place = self._read_out(near, belief)
        self._judge(near, place, lost, length_m, bound_m)
        dx, dy = self._px - float(near.x[place.at]), self._py - float(near.y[place.at])
        if not lost and not self._off:
            self._pull(dx, dy)
            self._follow_drift(near, place, length_m, yaw_rad, field_ut[1])
        return self._match(near, place, yaw_rad, (dx, dy))

    def _walk(self, length_m: float, yaw_rad: float) -> _Nearby:
        """The wearer by dead reckoning after the step, and how the route lies about the wearer."""
        window = self._window()
        x, y, cos, sin = (a[window] for a in (self._x, self._y, self._cos, self._sin))
        cosine = math.cos(yaw_rad) * cos + math.sin(yaw_rad) * sin
        back = cosine < 0.0
        aside = np.arccos(np.minimum(np.abs(cosine), 1.0))
        self._px += length_m * math.cos(yaw_rad)
        self._py += length_m * math.sin(yaw_rad)
        self._var += self._config.drift_m**2 * length_m
        squared = (self._px - x) ** 2 + (self._py - y) ** 2
        return _Nearby(window, self._grid[window], x, y, cos, sin, cosine, back, aside, squared)

    def _lost(self, near: _Nearby, belief: FloatArray, bound_m: float) -> bool:
        """Whether the wearer is not where the belief is: off the route, or further from its peak than the bound."""
        before = int(np.argmax(belief))
        reach = int(_PEAK_M / self._bin_m)
        squared = near.squared
        return self._off or math.sqrt(float(squared[max(before - reach, 0) : before + reach + 1].min())) > bound_m

    def _updated(
        self,
        near: _Nearby,
        belief: FloatArray,
        lost: bool,
        level_m: float,
        field_ut: tuple[float, float],
        altitude_m: float,
    ) -> FloatArray:
        """The predicted belief about the bins nearby after what the step measured; kept for the next step."""
        config, window, squared = self._config, near.window, near.squared
        aside, back = near.aside, near.back
        if lost:
            close = np.exp(-0.5 * squared / (config.sigma_place_m**2 + 4.0 * self._var))
            belief = (1.0 - _ANYWHERE) * belief + _ANYWHERE * close / (close.sum() + 1e-9)
        belief *= self._likelihood(window, level_m, squared, aside, back, field_ut, altitude_m, 3.0 if lost else 1.0)
        belief += 1e-12
        belief = belief / belief.sum()
        self._belief = np.zeros(len(self._grid))
        self._belief[window] = belief
        return belief

    def _read_out(self, near: _Nearby, belief: FloatArray) -> _Place:
        """The place on the route about the belief's peak."""
        grid = near.grid
        reach = int(_PEAK_M / self._bin_m)
        top = int(np.argmax(np.where(near.back, belief, _OUTWARD * belief)))
        lo, hi = max(top - reach, 0), top + reach + 1
        weight = belief[lo:hi]
        mass = float(weight.sum())
        at_m = float(weight @ grid[lo:hi]) / mass
        sigma_m = math.sqrt(float(weight @ (grid[lo:hi] - at_m) ** 2) / mass) + (1.0 - mass) * _PEAK_M
        at = min(round(at_m / self._bin_m) - near.window.start, len(grid) - 1)
        return _Place(lo, hi, at, at_m, sigma_m)

    def _judge(self, near: _Nearby, place: _Place, lost: bool, length_m: float, bound_m: float) -> None:
        """Whether the wearer is off the route or meets it again, and for how long the route has been followed."""
        config, at = self._config, place.at
        local_m = math.sqrt(float(near.squared[place.lo : place.hi].min()))
        along = near.aside[at] < _ALONG_RAD and local_m < config.corridor_m + math.sqrt(self._var)
        self._along_m = self._along_m + length_m if along else 0.0
        if self._off:
            self._off = self._along_m < _ALONG_M
        else:
            self._off = local_m > bound_m
        steady = along and bool(near.back[at]) and not lost and place.sigma_m < config.closure_doubt_m
        self._steady_m = self._steady_m + length_m if steady else 0.0

    def _pull(self, dx: float, dy: float) -> None:
        """Draw the wearer's place softly to the route, from which it is off by (dx, dy) metres."""
        gain = self._var / (self._var + self._config.sigma_pull_m**2)
        self._px -= gain * dx
        self._py -= gain * dy
        self._var *= 1.0 - gain

    def _follow_drift(
        self, near: _Nearby, place: _Place, length_m: float, yaw_rad: float, level_field_ut: float
    ) -> None:
        """Turn slowly into the direction of the route, and forget the device's own horizontal field."""
        at = place.at
        sign = -1.0 if near.back[at] else 1.0
        away = wrap_scalar(yaw_rad - math.atan2(sign * float(near.sin[at]), sign * float(near.cos[at])))
        if abs(away) < _DRIFT_RAD:
            turned_rad = self._turned_rad + min(length_m / _DRIFT_M, 1.0) * away
            self._turned_rad = min(max(turned_rad, -_DRIFT_RAD), _DRIFT_RAD)
        if math.isfinite(level_field_ut):
            expected_ut = float(self._level[near.window][at])
            self._level_shift_ut += _FORGET * (level_field_ut - expected_ut - self._level_shift_ut)

    def _match(self, near: _Nearby, place: _Place, yaw_rad: float, offset_m: tuple[float, float]) -> Match:
        """What is told of the step; ``offset_m`` is that of the wearer from the place on the route."""
        squared, at, (dx, dy) = near.squared, place.at, offset_m
        lo, hi = place.lo, place.hi
        route_m = float(np.interp(place.at_m, self._grid, self._route))
        closest = lo + int(np.argmin(squared[lo:hi])) if not self._off else int(np.argmin(squared))
        to_route = math.atan2(float(near.y[closest]) - self._py, float(near.x[closest]) - self._px)
        cross_m = dx * float(near.sin[at]) - dy * float(near.cos[at])
        if self._off:  # as far as the nearest place of it, on the same side
            cross_m = math.copysign(math.sqrt(float(squared[closest])), cross_m)
        return Match(
            route_m=route_m,
            sigma_m=place.sigma_m,
            breadcrumb=int(np.argmin(np.abs(self._outbound.route_m - route_m))),
            cross_m=cross_m,
            off_route=self._off,
            facing_back=bool(near.back[at]),
            bearing_rad=wrap_scalar(to_route - yaw_rad),
            steady_m=self._steady_m,
        )

    def _spread(self, sigma_m: float) -> None:
        """Nobody knows how far the wearer went meanwhile."""
        reach = int(3.0 * sigma_m / self._bin_m) + 1
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * self._bin_m / sigma_m) ** 2)
        self._belief = np.convolve(self._belief, kernel / kernel.sum())[reach : reach + len(self._grid)]
        self._var += sigma_m**2

    def _window(self) -> slice:
        """The bins to look at: near where the wearer is, or, off the route, all."""
        if self._off:
            return slice(0, len(self._grid))
        top = int(np.argmax(self._belief))
        return slice(max(top - _WINDOW_BINS, 0), min(top + _WINDOW_BINS, len(self._grid)))

    def _predicted(self, window: slice, level_m: float, cosine: FloatArray) -> FloatArray:
        """The belief moved by a step, along the route as far as it leads along the route."""
        before = self._belief[window]
        count = len(before)
        moved = self._grid[window] + level_m * np.clip(1.2 * cosine, -1.0, 1.0)
        cell = np.clip(moved / self._bin_m - window.start, 0.0, count - 1.0)
        low = cell.astype(np.int64)
        upper = before * (cell - low)
        belief = np.bincount(low, before - upper, count + 1) + np.bincount(low + 1, upper, count + 1)
        offset = np.arange(-8, 9) * self._bin_m
        narrow = np.exp(-0.5 * (offset / math.hypot(self._config.sigma_step_rel * level_m, 0.5 * self._bin_m)) ** 2)
        wide = np.exp(-0.5 * (offset / (_JUMP_STEPS * level_m)) ** 2)
        kernel = (1.0 - _JUMP) * narrow / narrow.sum() + _JUMP * wide / wide.sum()
        return np.convolve(belief, kernel)[8 : 8 + count]

    def _likelihood(
        self,
        window: slice,
        level_m: float,
        squared: FloatArray,
        aside: FloatArray,
        back: BoolArray,
        field_ut: tuple[float, float],
        altitude_m: float,
        place: float,
    ) -> FloatArray:
        """How well each place of the route explains the step, relative to the best; heavy-tailed throughout."""
        config = self._config
        log = place * _PLACE * _tailed(squared / (config.sigma_place_m**2 + self._var))
        log += _TURN * (_tailed((aside / config.sigma_turn_rad) ** 2) - ~back)
        share = min(level_m / _STEP_M, 1.5)
        up_ut = field_ut[0] - self._up[window]
        level_ut = field_ut[1] - self._level_shift_ut - self._level[window]
        if math.isfinite(up_ut[0]):
            log += share * _MAG * _tailed((up_ut / config.sigma_mag_ut) ** 2)
            log += share * _LEVEL * _tailed((level_ut / config.sigma_mag_ut) ** 2)
        climbed_m = altitude_m - self._altitude[window]
        if math.isfinite(climbed_m[0]):
            log += _ALTITUDE * _tailed((climbed_m / config.sigma_altitude_m) ** 2)
        return np.asarray(np.exp(log - log.max()))


def _tailed(squared: FloatArray) -> FloatArray:
    """log-density of Student's t with three degrees of freedom, of squared residuals over their variance."""
    return -2.0 * np.log1p(squared / 3.0)


def _on_grid(grid: FloatArray, at: FloatArray, values: FloatArray) -> FloatArray:
    known = np.isfinite(values)
    return np.interp(grid, at[known], values[known]) if known.any() else np.full(len(grid), np.nan)
