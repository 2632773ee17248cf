"""Full smoothing: the whole graph at once, by Levenberg-Marquardt from headings that were solved first."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, I, L, X, Z

from fbgraph.core.aids import Aids
from fbgraph.core.config import Config, GraphConfig, SolverConfig
from fbgraph.core.errors import EstimationError
from fbgraph.core.geometry import FloatArray, plane_turns, wrap_angle
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.aided import (
    CheckedAids,
    check_aids,
    in_anchors_frame,
    in_walks_frame,
    solved_frame,
    told_residuals,
)
from fbgraph.estimators.altitude_chain import air_sigma_m, weather_sigma_m
from fbgraph.estimators.closure_weights import WeighedClosures, weigh
from fbgraph.estimators.compass_factors import UNIT_UT
from fbgraph.estimators.estimates import DeviceErrors, Smoothed
from fbgraph.estimators.factor_graph import build_graph
from fbgraph.estimators.heading_chain import HeadingSolution, solve_heading
from fbgraph.estimators.pdr import calibrated_yaw_rad
from fbgraph.estimators.residuals import compass_table, factor_residuals
from fbgraph.estimators.shared_errors import curvature_covariance, walk_covariance
from fbgraph.front_end.step_track import StepTrack
from fbgraph.way_back.follower import find_closures
from fbgraph.way_back.records import Closure, TurnBack
from fbgraph.way_back.turn_back import find_turn_back

_INTERRUPTIBLE_S = 0.1
_PASSES, _SETTLED_RAD = 4, 0.01
Solved = TypeVar("Solved")
_STACK_MIN, _STACK_PER_BREADCRUMB, _STACK_MAX = 64 << 20, 4096, 1 << 30


def smooth(
    track: StepTrack,
    seed: Trajectory,
    graph_config: GraphConfig,
    solver_config: SolverConfig,
    aids: Aids | None = None,
    closures: Sequence[Closure] = (),
) -> Smoothed:
    """Smooth a walk.

    Args:
        track: the steps.
        seed: an estimate from the origin, the EKF's: headings are solved from its own and from the gyroscope's.
        graph_config, solver_config: weights and limits.
        aids: checked against the walk without them first; with anchors the result is in their frame, not at the origin.
        closures: breadcrumbs known to be at the places of earlier ones.

    Raises:
        EstimationError: the solver failed or its answer is not finite.
    """
    checked = CheckedAids(aids or Aids())
    if checked.aids.closed_walk or checked.aids.direction_known:
        alone = _smoothed(track, seed, graph_config, solver_config, Aids(), ()).trajectory
        checked = check_aids(checked.aids, track, alone, graph_config)
    smoothed = _smoothed(track, seed, graph_config, solver_config, checked.aids, closures)
    smoothed = replace(smoothed, residuals=told_residuals(smoothed.residuals, aids, checked.aids))
    return replace(smoothed, doubts=checked.doubts, notes=checked.notes)


def _smoothed(
    track: StepTrack,
    seed: Trajectory,
    graph_config: GraphConfig,
    solver_config: SolverConfig,
    aids: Aids,
    closures: Sequence[Closure],
) -> Smoothed:
    """Smooth a walk with aids that have been checked; ``seed`` begins at the origin."""
    by_gyroscope = calibrated_yaw_rad(track)
    seeds = [(seed.yaw_rad, seed.gyro_bias_rad_s), (by_gyroscope, seed.gyro_bias_rad_s)]
    heading = solve_heading(track, seeds, graph_config)
    near = _composed(track, seed, heading)
    errors, tied = np.empty(0), _Tied(tuple(closures))
    for _ in range(_PASSES):
        graph, values = build_graph(track, near, heading, graph_config, aids)
        if tied.weighed is not None:
            values.insert(L(0), tied.aside_m)
        solved, trajectory = _solved(track, near, graph, values, tied, graph_config, solver_config, aids)
        errors = np.concatenate((errors[:-1], solved.errors))
        heading = _heading_of(heading, solved.values, trajectory)
        moved_rad = np.abs(trajectory.yaw_rad - near.yaw_rad).max()
        near = trajectory
        if moved_rad < _SETTLED_RAD:  # compass weights and linear factors were of the answer
            break
    if not np.isfinite(errors[-1]):
        raise EstimationError("the smoother diverged: its error is not finite")
    tables = compass_table(track, trajectory, heading, graph_config)
    if tied.weighed is not None:
        tables = (*tables, tied.weighed.residuals(solved.values))
    if (frame := solved_frame(solved.values, aids)) is not None:
        look = partial(in_anchors_frame, trajectory, solved.graph, solved.values, frame)
        trajectory, aids = _on_deep_stack(look, len(track)), replace(aids, frame=frame)
    return Smoothed(
        trajectory=trajectory,
        errors=errors,
        factors=solved.graph.size(),
        residuals=factor_residuals(solved.graph, solved.values, tables),
        closures=tied.closures,
        device=_device_of(heading, solved),
        aids=aids,
    )


@dataclass
class _Tied:
    """Closures, what the first solution left of each, and how far beside the way out the latest has the way back."""

    closures: tuple[Closure, ...]
    weighed: WeighedClosures | None = None
    aside_m: float = 0.0


def _composed(track: StepTrack, seed: Trajectory, heading: HeadingSolution) -> Trajectory:
    """Places by the headings: where the whole graph starts."""
    x_m = seed.x_m[0] + np.cumsum(track.length_m * np.cos(heading.yaw_rad))
    y_m = seed.y_m[0] + np.cumsum(track.length_m * np.sin(heading.yaw_rad))
    return Trajectory(track.t_s, x_m, y_m, seed.z_m, heading.yaw_rad, heading.bias_rad_s)


def _solved(
    track: StepTrack,
    near: Trajectory,
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    tied: _Tied,
    graph_config: GraphConfig,
    solver_config: SolverConfig,
    aids: Aids,
) -> tuple[_Solved, Trajectory]:
    """Solve a graph and its closures, which are weighed the first time.

    Raises:
        EstimationError: neither Cholesky nor QR could.
    """
    # what hangs on a gap alone, or on sigmas far apart, is more than Cholesky can tell from nothing
    failure: RuntimeError | None = None
    for by_qr in (False, True) if track.chained.all() else (True,):
        try:
            whole, start = gtsam.NonlinearFactorGraph(graph), values
            if tied.closures and tied.weighed is None:
                tied.weighed, start = _on_deep_stack(partial(weigh, graph, values, tied.closures, by_qr), len(track))
            if tied.weighed is not None:
                tied.weighed.add_to(whole, start)
            solved = _on_deep_stack(partial(_solve, whole, start, solver_config, by_qr), len(track))
            if tied.weighed is not None:
                tied.aside_m = solved.values.atDouble(L(0))
            return solved, _trajectory_of(track, near, solved, graph_config, aids.direction_known)
        except RuntimeError as error:
            failure = error
    raise EstimationError(f"the smoother failed: {_said(failure)}") from failure


def _heading_of(heading: HeadingSolution, values: gtsam.Values, trajectory: Trajectory) -> HeadingSolution:
    """The headings of a solved graph."""
    return replace(
        heading,
        yaw_rad=trajectory.yaw_rad,
        bias_rad_s=trajectory.gyro_bias_rad_s,
        gyro_scale=float(values.atVector(B(len(trajectory) - 1))[1]),
        iron_ut=np.array([UNIT_UT * values.atVector(I(j)) for j in range(len(heading.iron_ut))])
        if len(heading.readings)
        else heading.iron_ut,
    )


def _device_of(heading: HeadingSolution, solved: _Solved) -> DeviceErrors:
    """What the graph found out about the device, with its standard deviations."""
    last = B(len(heading.yaw_rad) - 1)
    sigma = float(solved.marginals.marginalCovariance(last)[1, 1]) ** 0.5
    iron_sigma = np.array(
        [
            UNIT_UT * np.sqrt(np.diag(solved.marginals.marginalCovariance(I(j))))
            for j in range(len(heading.iron_ut) if len(heading.readings) else 0)
        ]
    ).reshape(-1, 3)
    starts = np.concatenate(([0], np.flatnonzero(np.diff(heading.stretch)) + 1))
    return DeviceErrors(heading.gyro_scale, sigma, heading.iron_ut[: len(iron_sigma)], iron_sigma, starts)


@dataclass(frozen=True)
class _Solved:
    """What the solver returned; ``errors`` (I+1,) before the first of I iterations and after each."""

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    marginals: gtsam.Marginals | gtsam.ISAM2
    errors: FloatArray


def _solve(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, config: SolverConfig, by_qr: bool) -> _Solved:
    """Levenberg-Marquardt and marginals; RuntimeError if GTSAM finds the system indeterminate."""
    params = gtsam.LevenbergMarquardtParams()
    if by_qr:
        params.setLinearSolverType("MULTIFRONTAL_QR")
    params.setMaxIterations(config.max_iterations)
    params.setRelativeErrorTol(config.relative_error)
    params.setAbsoluteErrorTol(1e-12)
    errors: list[float] = []
    params.iterationHook = lambda iteration, before, after: errors.append(float(after))
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, params)
    errors.append(optimizer.error())
    result = optimizer.optimize()
    marginals = _qr_marginals(graph, result) if by_qr else gtsam.Marginals(graph, result)
    return _Solved(graph, result, marginals, np.array(errors))


def _said(error: RuntimeError | None) -> str:
    """What GTSAM says, on one line: the variable it stumbled over stands on the second."""
    return " ".join(str(error).split(".")[0].split())


def _qr_marginals(graph: gtsam.NonlinearFactorGraph, result: gtsam.Values) -> gtsam.ISAM2:
    """Marginal covariances by QR, which GTSAM's own ``Marginals`` has no switch for in Python."""
    params = gtsam.ISAM2Params()
    params.setFactorization("QR")
    isam = gtsam.ISAM2(params)
    isam.update(graph, result)
    return isam


def tie_way_back(
    smoothed: Smoothed, track: StepTrack, seed: Trajectory, config: Config, aids: Aids | None = None
) -> tuple[Smoothed, TurnBack | None]:
    """Smooth a walk out and back once more, each stretch of the way back tied to the same stretch of the way out.

    Args:
        smoothed: the walk without closures.
        track, seed, aids: as they were given to ``smooth``.
        config: the effective configuration.

    Returns:
        The walk, as it was if no turn-back or no trustworthy match is found, and the turn-back.

    Raises:
        EstimationError: as ``smooth``.
    """
    turned = find_turn_back(smoothed.trajectory, track, config.step_length, config.returning)
    closures = find_closures(smoothed.trajectory, track, turned, config.step_length, config.returning)
    if not closures:
        return smoothed, turned
    near = in_walks_frame(smoothed.trajectory, smoothed.aids.frame)
    tied = _smoothed(track, near, config.graph, config.solver, smoothed.aids, closures)
    tied = replace(tied, residuals=told_residuals(tied.residuals, aids, smoothed.aids))
    return replace(tied, doubts=smoothed.doubts, notes=smoothed.notes), turned


def _on_deep_stack(solve: Callable[[], Solved], breadcrumbs: int) -> Solved:
    """Run a solver where its recursion has room: GTSAM eliminates a chain as deep as it is long.

    Eight mebibytes, a usual stack, overflow at some 100,000 breadcrumbs, which ends the whole process. Who interrupts
    the program does not wait for the solver.
    """
    done: list[Solved] = []
    failed: list[BaseException] = []

    def work() -> None:
        try:
            done.append(solve())
        except BaseException as error:  # handed on to who waits
            failed.append(error)

    before = threading.stack_size(min(_STACK_MIN + breadcrumbs * _STACK_PER_BREADCRUMB, _STACK_MAX))
    try:
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
    finally:
        threading.stack_size(before)
    while thread.is_alive():
        thread.join(_INTERRUPTIBLE_S)
    if failed:
        raise failed[0]
    return done[0]


def _trajectory_of(
    track: StepTrack, near: Trajectory, solved: _Solved, config: GraphConfig, anchored: bool
) -> Trajectory:
    """The breadcrumbs of a solved graph; ``anchored`` says that the walk's own scale and turn are known."""
    count = len(track)
    result, marginals = solved.values, solved.marginals
    poses = gtsam.utilities.extractPose2(result)[-count:]  # breadcrumbs come after the anchors' frame
    z_m = np.array([result.atDouble(Z(k)) for k in range(count)])
    bias = np.array([result.atVector(B(k))[0] for k in range(count)])
    covariance = np.array([marginals.marginalCovariance(X(k)) for k in range(count)])
    sigma_z = np.array([marginals.marginalCovariance(Z(k))[0, 0] for k in range(count)]) ** 0.5
    if np.isfinite(track.altitude_m).any():
        sigma_z = np.sqrt(sigma_z**2 + weather_sigma_m(track.t_s, config) ** 2 + air_sigma_m(track) ** 2)
    sigma_bias = np.array([marginals.marginalCovariance(B(k))[0, 0] for k in range(count)]) ** 0.5
    covariance = body_to_world(covariance, poses[:, 2])
    if not anchored:
        covariance += walk_covariance(poses, track.sigma_turned_rad, config)
        covariance += curvature_covariance(track.length_m, poses[:, 2], covariance[:, 2, 2])
    return Trajectory(
        track.t_s,
        poses[:, 0],
        poses[:, 1],
        z_m,
        # who turned on the spot by more than half a circle between two steps is unwrapped as before
        near.yaw_rad + wrap_angle(poses[:, 2] - near.yaw_rad),
        bias,
        cov_xy_yaw=covariance,
        sigma_z_m=sigma_z,
        sigma_bias_rad_s=sigma_bias,
    )


def body_to_world(covariance: FloatArray, yaw_rad: FloatArray) -> FloatArray:
    """(N, 3, 3) covariances of Pose2 tangent vectors (body frame) as those of (x, y, yaw) in the world frame."""
    turns = plane_turns(yaw_rad)
    return np.asarray(turns @ covariance @ turns.transpose(0, 2, 1))
