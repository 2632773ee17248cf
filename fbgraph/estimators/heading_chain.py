"""Heading before places: yaw, gyroscope bias and scale, and the device's own iron, by banded least squares.

None of them depends on where the walk goes, so they are solved first, in milliseconds; the graph starts at the answer.
Per breadcrumb k the unknowns are yaw θ_k and bias b_k, for the whole walk the gyroscope's scale s, and for each stretch
between recalibrations of the magnetometer its hard iron and usual horizontal strength (``compass``):

    heading      θ_k - θ_{k-1} + b_k t_k + s g_k = g_k      g_k turned by the gyroscope in t_k of moving
    bias walk    b_k - b_{k-1} = 0
    rest         b_k = mean yaw rate of the rest
    compass      θ_k = direction of the field, iron taken out; Huber
    strength     horizontal field, iron taken out = H; Huber

These are the graph's own factors. Gauss-Newton with iteratively reweighted least squares; the normal equations are
banded but for the few unknowns of the whole walk, which are eliminated last (Golub and Van Loan, Matrix Computations,
4.3). Then the compass is believed only as far as it agrees with the gyroscope (``compass.scattered``): where its
residuals scatter by more than its sigma, that is widened, and heading is solved again. Of a whole walk only: what the
online smoother makes of a reading keeps its sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded

from fbgraph.core.config import GraphConfig
from fbgraph.core.errors import EstimationError
from fbgraph.core.geometry import FloatArray, IntArray, wrap_angle
from fbgraph.estimators.compass import (
    CompassReadings,
    circle_through,
    compass_readings,
    compass_residuals,
    iron_cost,
    iron_sigma_ut,
    scattered,
)
from fbgraph.estimators.gyroscope import GyroTurns, gyro_turns
from fbgraph.estimators.magnetic_field import FieldMemory
from fbgraph.front_end.step_track import StepTrack

_BAND = 4
_FREE_RAD = 100.0
_FIXED_RAD = 1e-3
_FIRST_TRIES, _KEPT, _MOST = 6, 2, 40
_DONE_RAD = 1e-5
_RELOOKS, _NOTABLE = 2, 1.5  # how often, and from how many times the usual deviation on, the compass is doubted
_LEAST_FOR_CIRCLE = 8  # readings
_IRON = 3  # unknowns of a stretch: two of hard iron, one of strength


@dataclass(frozen=True)
class HeadingSolution:
    """Headings of a walk, solved by themselves.

    Attributes:
        yaw_rad: (K+1,) walking direction, unwrapped.
        bias_rad_s: (K+1,) gyroscope bias about the vertical.
        gyro_scale: share by which the gyroscope shows too much of a turn; 0.01 is one percent.
        iron_ut: (J, 3) hard iron and usual horizontal strength of each stretch between recalibrations.
        stretch: (K+1,) which stretch each breadcrumb belongs to.
        jumps_ut: (J-1, 3) by how much the iron jumped between them.
        readings: of the compass, at breadcrumbs where there is one, with sigmas as they were believed at last.
        usual_ut: median horizontal strength of the field.
        cost: half the robust sum of squares, priors included.
    """

    yaw_rad: FloatArray
    bias_rad_s: FloatArray
    gyro_scale: float
    iron_ut: FloatArray
    stretch: IntArray
    jumps_ut: FloatArray
    readings: CompassReadings
    usual_ut: float
    cost: float


def solve_heading(track: StepTrack, seeds: list[tuple[FloatArray, FloatArray]], config: GraphConfig) -> HeadingSolution:
    """Headings of a walk from gyroscope, rests and compass.

    Args:
        track: the steps.
        seeds: yaw and bias, (K+1,) each, from which to start; the best answer is taken.
        config: weights of the graph.

    Where the magnetometer's zero seems to have jumped, the walk is tried with and without: what explains it better.

    Raises:
        EstimationError: there is no finite answer.
    """
    jumped = bool(track.jump_x_ut.any() or track.jump_y_ut.any())
    tried = [
        (one, one.improved(one.start(yaw_rad, bias_rad_s, iron_ut), _FIRST_TRIES))
        for one in (HeadingChain(track, config, jumps=jumps) for jumps in ((True, False) if jumped else (False,)))
        for yaw_rad, bias_rad_s in seeds
        for iron_ut in one.iron_starts()
    ]
    tried.sort(key=lambda one: one[1].cost)
    kept = [(one, one.improved(solution, _MOST)) for one, solution in tried[:_KEPT]]
    best, solution = min(kept, key=lambda one: one[1].cost)
    return best.as_scattered(solution)


class HeadingChain:
    """The least-squares problem of one walk.

    Attributes:
        jumps_ut: (J-1, 3) jumps of the magnetometer's zero that are believed.
    """

    def __init__(self, track: StepTrack, config: GraphConfig, *, jumps: bool) -> None:
        """The problem of a track; ``jumps`` says whether jumps of the magnetometer's zero are believed."""
        self._config = config
        self._count = len(track)
        self._turns: GyroTurns = gyro_turns(track, config)
        self._known = np.flatnonzero(np.isfinite(track.yaw_mag_rad))
        field = FieldMemory(config.norm_scale_ut, config.dip_scale_rad)
        self._compass: CompassReadings = compass_readings([track.steps[k] for k in self._known], field, config)
        self._nominal = self._compass
        self._distance_m = np.cumsum(track.length_m)
        seen_ut = np.column_stack((track.jump_x_ut, track.jump_y_ut, np.zeros(self._count))) * float(jumps)
        jumped = seen_ut.any(axis=1)
        self.jumps_ut = seen_ut[jumped]
        self._stretch: IntArray = np.cumsum(jumped)
        self._rests = np.flatnonzero(track.rest_s > 0)
        self._rest_rate, self._rest_sigma = track.rest_rate_rad_s[self._rests], track.rest_sigma_rad_s[self._rests]
        self._usual_ut = float(np.median(self._compass.level_ut)) if len(self._known) else 0.0

    def start(self, yaw_rad: FloatArray, bias_rad_s: FloatArray, iron_ut: FloatArray) -> HeadingSolution:
        """A guess, as a solution that nobody has improved yet."""
        about = (self._stretch, self.jumps_ut, self._compass, self._usual_ut)
        # each turn within half a circle of the gyroscope's, which is linear
        turned = self._turns.turned_rad
        turns = turned + wrap_angle(np.diff(yaw_rad) - turned)
        yaw_rad = yaw_rad[0] + np.concatenate(([0.0], np.cumsum(turns)))
        return HeadingSolution(yaw_rad, bias_rad_s, 0.0, iron_ut, *about, cost=np.inf)

    def iron_starts(self) -> list[FloatArray]:
        """(J, 3) each: no iron in each of the stretches in turn, and as much as the circle of the field shows."""
        moved = np.concatenate((np.zeros((1, 3)), np.cumsum(self.jumps_ut, axis=0)))
        usual = np.array([0.0, 0.0, self._usual_ut])
        starts = [moved - moved[j] + usual for j in sorted({0, len(moved) - 1})]
        if len(self._known) >= _LEAST_FOR_CIRCLE:
            first = self._stretch[self._known] == 0
            starts.append(moved + circle_through(self._compass, first if first.sum() >= _LEAST_FOR_CIRCLE else ~first))
        return starts

    def improved(self, start: HeadingSolution, iterations: int) -> HeadingSolution:
        """Gauss-Newton from a start; until nothing moves or so often."""
        solution = start
        for _ in range(iterations):
            system = _System(self._count, 1 + _IRON * len(solution.iron_ut))
            cost = self._add_gyroscope(system, solution) + self._add_compass(system, solution)
            step, shared = system.solved()
            solution = replace(
                solution,
                yaw_rad=solution.yaw_rad + step[::2],
                bias_rad_s=solution.bias_rad_s + step[1::2],
                gyro_scale=solution.gyro_scale + float(shared[0]),
                iron_ut=solution.iron_ut + shared[1:].reshape(-1, _IRON),
                cost=cost,
            )
            if np.abs(step[::2]).max() < _DONE_RAD:
                break
        return solution

    def as_scattered(self, solution: HeadingSolution) -> HeadingSolution:
        """The answer with the compass believed as far as it agrees with the gyroscope, where that is less."""
        for _ in range(_RELOOKS):
            iron_ut = solution.iron_ut[self._stretch[self._known]]
            off = compass_residuals(self._nominal, solution.yaw_rad[self._known], iron_ut, self._config)
            doubted = scattered(self._nominal, off.across_rad, self._distance_m[self._known], self._config)
            if np.all(doubted.own_rad < _NOTABLE * self._nominal.own_rad):
                break
            self._compass = doubted
            solution = self.improved(replace(solution, readings=doubted), _MOST)
        return solution

    def _add_gyroscope(self, system: _System, at: HeadingSolution) -> float:
        config, turns = self._config, self._turns
        one = np.ones(self._count - 1)
        turned = at.yaw_rad[1:] - at.yaw_rad[:-1]
        off = turned + at.bias_rad_s[1:] * turns.moving_s + (at.gyro_scale - 1.0) * turns.turned_rad
        later = np.arange(1, self._count)
        cost = system.add(
            [(2 * later - 2, -one), (2 * later, one), (2 * later + 1, turns.moving_s)],
            off,
            turns.sigma_rad,
            [(np.zeros(self._count - 1, dtype=np.int64), turns.turned_rad)],
        )
        drifted = at.bias_rad_s[1:] - at.bias_rad_s[:-1]
        cost += system.add([(2 * later - 1, -one), (2 * later + 1, one)], drifted, turns.drift_rad_s)
        first = np.zeros(1, dtype=np.int64)
        cost += system.add([(first + 1, one[:1])], at.bias_rad_s[:1], np.array([config.sigma_bias_rad_s]))
        fixed = _FREE_RAD if len(self._known) else _FIXED_RAD
        system.add([(first, one[:1])], np.zeros(1), np.array([fixed]))
        if len(self._rests):
            off = at.bias_rad_s[self._rests] - self._rest_rate
            cost += system.add([(2 * self._rests + 1, np.ones(len(off)))], off, self._rest_sigma)
        return cost + system.add_shared(0, at.gyro_scale, config.sigma_gyro_scale)

    def _add_compass(self, system: _System, at: HeadingSolution) -> float:
        config, readings = self._config, self._compass
        cost = 0.0
        for j, iron_ut in enumerate(at.iron_ut):
            place = 1 + _IRON * j
            cost += iron_cost(iron_ut, config)
            sigma_ut = iron_sigma_ut(iron_ut, config)
            for axis in (0, 1):
                system.add_shared(place + axis, float(iron_ut[axis]), sigma_ut)
            cost += system.add_shared(place + 2, float(iron_ut[2]) - self._usual_ut, config.sigma_field_ut)
            if j == 0:
                continue
            off = iron_ut - at.iron_ut[j - 1] - self.jumps_ut[j - 1]
            for axis in range(_IRON):
                cost += system.add_between(
                    place + axis - _IRON, place + axis, float(off[axis]), config.sigma_iron_jump_ut
                )
        if len(self._known) == 0:
            return cost
        stretch = self._stretch[self._known]
        off = compass_residuals(readings, at.yaw_rad[self._known], at.iron_ut[stretch], config)
        columns = 1 + _IRON * stretch
        one, none = np.ones(len(stretch)), [(2 * self._known, np.zeros(len(stretch)))]
        for residual, derivative, weight, rows in (
            (off.across_rad, off.across_by_iron, off.across_weight, [(2 * self._known, one)]),
            (off.strength_rel, off.strength_by_iron, off.strength_weight, none),
        ):
            sigma = readings.sigma_rad / np.sqrt(weight)
            shared = [(columns + axis, derivative[axis]) for axis in range(_IRON)]
            cost += system.add(rows, residual, sigma, shared)
            # Huber's loss is linear beyond its limit: w r²/2 counts half of what it does there
            cost += float((0.5 * (residual / readings.sigma_rad) ** 2 * (1.0 - weight) * weight).sum())
        return cost


class _System:
    """Normal equations of 2 (K+1) banded unknowns and a few shared ones."""

    def __init__(self, count: int, shared: int) -> None:
        self._band = np.zeros((_BAND, 2 * count))
        self._mixed = np.zeros((2 * count, shared))
        self._right = np.zeros(2 * count)
        self._shared = np.zeros((shared, shared))
        self._shared_right = np.zeros(shared)

    def add(
        self,
        columns: list[tuple[IntArray, FloatArray]],
        residual: FloatArray,
        sigma: FloatArray,
        shared: Sequence[tuple[IntArray, FloatArray]] = (),
    ) -> float:
        """Add rows, each with its own unknowns; half their sum of squares.

        Args:
            columns: indices in ascending order, no two rows sharing one, and coefficients.
            residual: (N,) now.
            sigma: (N,) standard deviations.
            shared: the same of unknowns that rows may share.
        """
        weight = 1.0 / sigma**2
        for i, (at, value) in enumerate(columns):
            self._right[at] -= weight * value * residual
            for before, other in columns[: i + 1]:
                self._band[at - before, before] += weight * value * other
        for index, value in shared:
            for at, other in columns:
                self._mixed[at, index] += weight * value * other
            np.subtract.at(self._shared_right, index, weight * value * residual)
            for other_index, other in shared:
                np.add.at(self._shared, (index, other_index), weight * value * other)
        return 0.5 * float((weight * residual**2).sum())

    def add_shared(self, index: int, residual: float, sigma: float) -> float:
        """A prior on one of the shared unknowns."""
        self._shared[index, index] += 1.0 / sigma**2
        self._shared_right[index] -= residual / sigma**2
        return 0.5 * (residual / sigma) ** 2

    def add_between(self, one: int, other: int, residual: float, sigma: float) -> float:
        """``other`` less ``one`` is known."""
        pair = np.array([one, other])
        signs = np.array([-1.0, 1.0])
        self._shared[np.ix_(pair, pair)] += np.outer(signs, signs) / sigma**2
        self._shared_right[pair] -= signs * residual / sigma**2
        return 0.5 * (residual / sigma) ** 2

    def solved(self) -> tuple[FloatArray, FloatArray]:
        """The step of the banded and of the shared unknowns.

        Raises:
            EstimationError: there is none, or it is not finite.
        """
        try:
            parts = solveh_banded(self._band, np.column_stack((self._right, self._mixed)), lower=True)
            schur = self._shared - self._mixed.T @ parts[:, 1:]
            shared = np.linalg.solve(schur, self._shared_right - self._mixed.T @ parts[:, 0])
        except ValueError as error:  # NumPy's LinAlgError is one
            raise EstimationError(f"the smoother failed at the headings: {error}") from error
        return parts[:, 0] - parts[:, 1:] @ shared, np.asarray(shared, dtype=np.float64)
