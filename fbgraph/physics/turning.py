"""How vectors that are fixed in the world turn in the device, against how the gyroscope says that it turns.

Seen from a device that turns by ω, a vector v fixed in the world (gravity; Earth's field) turns the other way:
v̇_b = -ω × v_b (Titterton & Weston, Strapdown Inertial Navigation Technology, 2nd ed., 2004, eq. 3.22). Integrated over
a window with R(t) from Ṙ = R [ω×], the vector R(t) v_b(t) stands still. What moves instead is measured with a smooth
weight φ (Hann, zero at both ends): ∫φ d/dt(R v_b) dt = -∫φ' R v_b dt, so that no measurement is ever differentiated
and the pushes of steps, at twice the window's frequency and above, cancel.

If a sensor's axes are a signed order of the gyroscope's, v_b is replaced by Q v_raw; if the gyroscope is mirrored, R by
that of -ω. Two integrations therefore serve all 48 signed orders.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.sensor_log import Stream

GRAVITY_WINDOW_S = 3.0  # some three strides: what pushes forward and back in them cancels
FIELD_WINDOW_S = 0.8  # nothing pushes a field; in a longer one somebody walks past iron
_OVERLAP = 3  # windows that see one sample
_DT_S = 0.04
_LONGEST_GAP_S = 0.3
_MOST_S = 480.0  # of windows, overlaps counted
_SILENCE_S = 60.0  # that nobody measures in; a clock that was set takes years for nothing
_LONGEST_S = 48 * 3600.0  # of a log, from its start
_ROUNDS = 4  # of reweighting
_LEAST_SPREAD = 1e-3  # of residuals against the vector's size in a second


def _proper_orders() -> FloatArray:
    """(24, 3, 3) all rotations by quarter turns; the first is the identity."""
    signed = [
        np.diag(signs) @ np.eye(3)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return np.array([matrix for matrix in signed if np.linalg.det(matrix) > 0.0])


PROPER_ORDERS = _proper_orders()
SIGNED_ORDERS = np.concatenate((PROPER_ORDERS, -PROPER_ORDERS))
"""(48, 3, 3) all signed orders of axes; the first 24 keep the handedness, the first of all is the identity."""


@dataclass(frozen=True)
class Windows:
    """Pieces of a log where gyroscope and a vector have no hole: (W, N, 3) each, as their file has them."""

    rate: FloatArray
    vector: FloatArray

    def __len__(self) -> int:
        return len(self.rate)

    def none(self) -> Windows:
        """No windows."""
        return Windows(self.rate[:0], self.vector[:0])


@dataclass(frozen=True)
class Residuals:
    """What is left moving under each hypothesis.

    Attributes:
        size: (H, W) norm of what moves, in the vector's unit a second.
        free: (H, 3) what was solved beside: the gyroscope's bias, or the hard iron.
    """

    size: FloatArray
    free: FloatArray

    @property
    def usual(self) -> float:
        """What the best hypothesis leaves in the middle."""
        return float(np.median(self.size, axis=1).min()) + 1e-12

    def cost(self, usual: float) -> FloatArray:
        """(H, W) logarithmic, so that no single window decides; ``usual`` counts as one."""
        return np.asarray(np.log1p(self.size / usual))


def cut(gyro: Stream, vector: Stream, window_s: float) -> Windows:
    """Windows of both on one grid; of a long log those in which the device turns most.

    Every grid value is the mean over its cell, so that nothing aliases.
    """
    n = round(window_s / _DT_S)
    nothing = Windows(np.empty((0, n, 3)), np.empty((0, n, 3)))
    if min(len(gyro), len(vector)) < 2:
        return nothing
    stride = max(n // _OVERLAP, 1)
    gyro, vector = _without_silences(gyro, vector, stride * _DT_S)
    start_s, end_s = max(gyro.t_s[0], vector.t_s[0]), min(gyro.t_s[-1], vector.t_s[-1])
    cells = int(min(end_s - start_s, _LONGEST_S) / _DT_S)
    if cells < n:
        return nothing
    edges_s = start_s + _DT_S * np.arange(cells + 1)
    holes = np.concatenate(([0], np.cumsum(_holes(gyro.t_s, edges_s) + _holes(vector.t_s, edges_s))))
    first = np.arange(0, cells - n + 1, stride)
    first = first[holes[first + n] == holes[first]]
    rate = _cell_means(gyro, edges_s)
    rows = _busiest(rate, first, n, round(_MOST_S / window_s))[:, None] + np.arange(n)
    return Windows(rate[rows], _cell_means(vector, edges_s)[rows])


def _without_silences(gyro: Stream, vector: Stream, stride_s: float) -> tuple[Stream, Stream]:
    """Both without most of the time in which neither measures, by whole strides: windows stay what they were."""
    if not any((np.diff(one.t_s) > _SILENCE_S).any() for one in (gyro, vector)):
        return gyro, vector
    t_s = np.union1d(gyro.t_s, vector.t_s)
    left_out = np.maximum(np.floor((np.diff(t_s) - _SILENCE_S) / stride_s), 0.0) * stride_s
    if not left_out.any():
        return gyro, vector
    before = np.concatenate(([0.0], np.cumsum(left_out)))
    kept = [Stream(one.t_s - before[np.searchsorted(t_s, one.t_s)], one.values) for one in (gyro, vector)]
    return kept[0], kept[1]


def _busiest(rate: FloatArray, first: IntArray, n: int, most: int) -> IntArray:
    """Windows, no more than are needed: evenly from the busier half where there are many."""
    if len(first) <= most:
        return first
    square = np.concatenate(([0.0], np.cumsum((rate**2).sum(axis=1))))
    busy = square[first + n] - square[first]
    first = first[busy >= np.median(busy)]
    return first[np.linspace(0, len(first) - 1, min(most, len(first))).astype(np.int64)]


def _cell_means(stream: Stream, edges_s: FloatArray) -> FloatArray:
    """(cells, 3) mean of the polyline through the samples over each cell."""
    t_s, values = stream.t_s, stream.values
    area = np.zeros_like(values)
    np.cumsum((values[1:] + values[:-1]) * (0.5 * np.diff(t_s))[:, None], axis=0, out=area[1:])
    at_edges = np.stack([np.interp(edges_s, t_s, column) for column in area.T], axis=1)
    return np.diff(at_edges, axis=0) / _DT_S


def _holes(t_s: FloatArray, edges_s: FloatArray) -> IntArray:
    """(cells,) how many holes of the stream touch each cell."""
    gap = np.flatnonzero(np.diff(t_s) > _LONGEST_GAP_S)
    marks = np.zeros(len(edges_s) + 1, dtype=np.int64)
    np.add.at(marks, np.searchsorted(edges_s, t_s[gap]), 1)
    np.add.at(marks, np.minimum(np.searchsorted(edges_s, t_s[gap + 1]) + 1, len(edges_s)), -1)
    return np.cumsum(marks)[: len(edges_s) - 1]


def integrate(rate_rad_s: FloatArray) -> FloatArray:
    """(N, W, 3, 3) rotations R(t) from each sample to the middle of its window, for rates (W, N, 3).

    Rodrigues' formula sample by sample, multiplied up.
    """
    turn = rate_rad_s.transpose(1, 0, 2) * _DT_S
    angle = np.linalg.norm(turn, axis=-1)[..., None, None]
    skew = np.zeros((*turn.shape, 3))
    x, y, z = turn[..., 0], turn[..., 1], turn[..., 2]
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = -z, y, -x
    skew[..., 1, 0], skew[..., 2, 0], skew[..., 2, 1] = z, -y, x
    square = turn[..., :, None] * turn[..., None, :] - angle**2 * np.eye(3)  # of the skew matrix
    step = np.eye(3) + np.sinc(angle / np.pi) * skew + 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2 * square
    turned = np.empty_like(step)
    now = np.broadcast_to(np.eye(3), step.shape[1:])
    for i in range(len(step)):
        turned[i] = now
        now = now @ step[i]
    return np.asarray(turned[len(turned) // 2].transpose(0, 2, 1)[None] @ turned)


def residuals(rotations: FloatArray, vector: FloatArray, free: str, prior: float) -> Residuals:
    """What is left moving of a vector under each of the 24 proper orders Q of its axes, something solved beside.

    Linear least squares, reweighted (Cauchy) so that jerks and iron nearby do not decide:
    ``free="bias"``: ∫φ d/dt(R Q v) = b × Q v, for a gyroscope that is off by b (rad/s);
    ``free="offset"``: ∫φ d/dt(R) (Q v - h), for a vector that is off by h in the device: hard iron.

    Args:
        rotations: (N, W, 3, 3) of ``integrate``.
        vector: (W, N, 3).
        prior: one sigma of what is solved beside, in its unit.
    """
    n = len(rotations)
    phase = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    weight = (1.0 - np.cos(phase)) / n
    slope = np.sin(phase) * (2.0 * np.pi / n / (n * _DT_S))
    windows = vector.shape[0]
    turned = rotations.transpose(1, 2, 3, 0).reshape(windows, 9, n)
    orders = PROPER_ORDERS.reshape(24, 9)
    moving = (-(turned * slope) @ vector).reshape(windows, 3, 9) @ orders.T
    moved = moving.transpose(2, 0, 1)  # (24, W, 3)
    if free == "bias":
        mean = (((turned * weight) @ vector).reshape(windows, 3, 9) @ orders.T).transpose(2, 0, 1)
        design = _cross(mean)
    else:
        rotating = -(turned @ slope).reshape(windows, 3, 3)
        design = rotating[None]
    size_of_vector = float(np.median(np.linalg.norm(vector, axis=-1))) or 1.0
    return _solve(moved, design, prior, _LEAST_SPREAD * size_of_vector)


def _solve(moved: FloatArray, design: FloatArray, prior: float, floor: float) -> Residuals:
    """Reweighted least squares of ``moved = design @ free`` for every hypothesis at once.

    Args:
        moved: (H, W, 3).
        design: (H, W, 3, 3), or (1, W, 3, 3) of all hypotheses.
    """
    squares = np.einsum("hwki,hwkj->hwij", design, design).reshape(*design.shape[:2], 9)
    rights = np.einsum("hwki,hwk->hwi", np.broadcast_to(design, (*moved.shape, 3)), moved)
    moved = np.ascontiguousarray(moved.swapaxes(1, 2))  # many windows lie side by side
    design = np.ascontiguousarray(design.swapaxes(1, 2))
    free = np.zeros((len(moved), 3))
    size = np.linalg.norm(moved, axis=1)
    for _ in range(_ROUNDS):
        spread = np.maximum(np.median(size, axis=1), floor)[:, None]
        weight = (1.0 / (spread**2 + size**2))[:, None]
        normal, right = (weight @ squares).reshape(-1, 3, 3) + np.eye(3) / prior**2, weight @ rights
        solved = np.linalg.solve(normal, right.swapaxes(1, 2))
        free = solved[..., 0]
        size = np.linalg.norm(moved - (design @ solved[:, None])[..., 0], axis=1)
    return Residuals(size, free)


def _cross(vectors: FloatArray) -> FloatArray:
    """(…, 3, 3) so that the product with b is b × v."""
    out = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = z, -y, x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = -z, y, -x
    return out


def gain(costs: tuple[FloatArray, ...], worse: tuple[int, ...], better: tuple[int, ...]) -> float:
    """By how many standard deviations one hypothesis beats another, over the windows of all vectors together.

    Args:
        costs: (H, W) for each vector.
        worse: the first hypothesis, for each vector.
        better: the other.
    """
    pairs = zip(costs, worse, better, strict=True)
    gains = [cost[one] - cost[other] for cost, one, other in pairs if cost.shape[1] > 1]
    variance = sum(len(g) * float(g.var(ddof=1)) for g in gains) * _OVERLAP
    return sum(float(g.sum()) for g in gains) / max(float(np.sqrt(variance)), 1e-9)
