"""How the device is carried: which way one walks against its own forward, and when it was turned in the hand.

A track's directions are the device's. They are the walker's while ``device.mount`` points where one walks, which the
push of the legs tells (``gait_direction``): roughly for the whole walk, and sharply from one stretch to the next, for
what is odd about a wearer's gait stays the same. So a fast turn of the device is a corner if the push, seen from the
device, stays as it was, and a turn in the hand if the push turns the other way by as much.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fbgraph.core.config import CarryingConfig
from fbgraph.core.geometry import FloatArray, wrap_scalar
from fbgraph.front_end.step_track import Step

_TURN_RAD = math.radians(30.0)  # a smaller change of direction is the path's
_TURN_STEPS = 3  # within so many steps it must come,
_STEADY_RAD = math.radians(12.0)  # it is over when two steps agree within this,
_TURN_LONGEST = 8  # and a longer one is a curve of the path
_BEFORE, _AFTER = 12, 10  # steps compared
_FEWEST, _SOON = 4, 6  # of those known: to tell anything, and to tell before all have come
_UNSEEN_STEPS = 2  # that a turn takes which the heading does not show
_TOGETHER = 3  # turns that are told together
_UNUSUAL = 2.5  # times the usual distance from the median
_PEAK_STEPS = 4  # after which nothing likelier comes
_CORRELATED = 2.0  # strides overlap by a step
_DRIFT, _RESTLESS = 0.15, 1.0  # from stretch to stretch gait changes by this share of its push, and of its scatter
_NOISE_M_S2 = 0.05  # no push is known better
_LEAK = 0.02  # m/s² into the horizontal for each m/s² of bounce, where the device leans otherwise than it seems
_LAG_ERROR_RAD = 0.25  # walking direction by the push, whole walks: sigma on real ones
_SURE = 4.0  # log-odds at which nothing more is waited for
_DOUBT = -2.2  # and at which something is not counted
_SIGMA_TURN_RAD = 0.12  # who turns the device in the hand walks on straight within this
_ANYWHERE_RAD = 1.8  # sigma of an angle of which nothing is known
_START_AT = 10  # pushes from which the start is judged, and at every doubling

Pushes = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Belief:
    """An angle out of several possible ones: the likeliest, how far the truth may be from it, how likely it is."""

    angle_rad: float
    sigma_rad: float
    odds: float
    """Logarithm of the odds that it is not as it was before, or as ``device.mount`` says."""


class Carrying:
    """Takes steps as measured and gives them back turned to the direction of walk. Causal; the same in any pieces."""

    def __init__(self, config: CarryingConfig) -> None:
        self._config = config
        self._raw: list[Step] = []
        self._pushes: list[tuple[complex, complex]] = []  # push and side, in the device's axes
        self._turned: list[float] = []  # direction of walk against the start's, in the device's axes
        self._turning: list[bool] = []
        self._sigma: list[float] = []
        self._open: int | None = None  # last step before a turn that goes on
        self._judging: list[tuple[int, int]] = []  # last steps before and last steps of turns not told yet
        self._unseen: tuple[Belief, int] | None = None  # the likeliest of late, and the last step before it
        self._since = 0  # first step after the latest gap of the log
        self._start = Belief(0.0, 0.0, -math.inf)
        self._start_due, self._count = _START_AT, 0

    def add(self, step: Step) -> int:
        """Take the next step.

        Returns:
            The first step about which more is known now: its own index, or an earlier one.
        """
        k = len(self._raw)
        self._raw.append(step)
        known = math.isfinite(step.push_m_s2) and step.slope == 0.0  # stairs push otherwise
        push = cmath.rect(step.push_m_s2, step.gait_yaw_rad) if known else complex(math.nan)
        self._pushes.append((push, complex(step.side_forward_m_s2, step.side_left_m_s2)))
        self._turned.append(self._turned[-1] if k else 0.0)
        self._turning.append(False)
        self._sigma.append(0.0)
        changed = k
        if not step.chained:
            changed = min(changed, self._judge(final=True))
            changed = min(changed, self._take_unseen())
            self._since, self._open = k, None
        changed = min(changed, self._follow_turn(k), self._judge(final=False), self._look_for_unseen(k))
        self._count += known
        if self._count >= self._start_due:
            self._start_due *= 2
            changed = min(changed, self._judge_start())
        return changed

    def finish(self) -> int:
        """No more steps will come. Returns the first step about which more is known now."""
        return min(self._judge(final=True), self._take_unseen(), self._judge_start())

    def steps(self, first: int = 0) -> list[Step]:
        """The steps from ``first`` on, their directions those of the walk as known now."""
        return [self._told(k) for k in range(first, len(self._raw))]

    def _told(self, k: int) -> Step:
        step, mount = self._raw[k], self._start.angle_rad + self._turned[k]
        sigma = self._sigma[k] if k else self._start.sigma_rad
        if mount == 0.0 and sigma == 0.0:
            return step
        return replace(
            step,
            yaw_gyro_rad=step.yaw_gyro_rad + mount,
            yaw_mag_rad=wrap_scalar(step.yaw_mag_rad + mount),
            mount_rad=mount,
            sigma_turned_rad=sigma,
        )

    def _follow_turn(self, k: int) -> int:
        """Notice where the device begins and ends to turn."""
        yaw = [step.yaw_gyro_rad for step in self._raw[max(k - _TURN_STEPS, self._since) :]]
        changed = k
        if self._open is None:
            back = len(yaw) - 1
            if max(abs(yaw[-1] - y) for y in yaw) >= _TURN_RAD:
                self._open = k - back
                changed = self._judge(final=len(self._judging) == _TOGETHER)
                self._turning[self._open + 1 :] = [True] * back
        elif k - self._open > 2 and abs(yaw[-1] - yaw[-3]) < _STEADY_RAD:
            if k - 2 - self._open <= _TURN_LONGEST:
                self._judging.append((self._open, k - 2))
            self._open = None
        else:
            self._turning[k] = True
        return changed

    def _judge(self, final: bool) -> int:
        """Corner or turn in the hand: told once enough steps followed, or no more will."""
        unchanged = len(self._raw)
        if not self._judging:
            return unchanged
        begin, end = self._judging[0][0], self._judging[-1][1]
        last = unchanged if self._open is None else self._open + 1
        before = self._known(range(max(begin - _BEFORE + 1, self._since), begin + 1))
        after = self._known(range(end + 2, min(last, end + 2 + _AFTER)))
        # who turns once more before this is told: both are told together
        final = final or unchanged >= end + 2 + _AFTER or (self._open is not None and len(after) >= _FEWEST)
        if not final and len(after) < _SOON:
            return unchanged
        jumps = [self._jump(i, j) for i, j in self._judging]
        belief = turn_belief(before, after, jumps, self._config)
        if not final and (belief.odds < _SURE or self._open is not None):
            return unchanged
        off = [abs(wrap_scalar(jump - belief.angle_rad)) for jump in jumps]
        which = off.index(min(off))
        (i, j), self._judging = self._judging[which], []
        if belief.sigma_rad == 0.0:
            return unchanged
        self._unseen = None
        self._apply(belief, i, j, jumps[which])
        return i + 1

    def _look_for_unseen(self, k: int) -> int:
        """A turn of the device that a corner hides, the other way by as much: the push alone shows it."""
        b = k - _UNSEEN_STEPS - _AFTER
        if b - _FEWEST < self._since or k % 2:  # every other step will do
            return len(self._raw)
        before = self._known(range(max(b - _BEFORE + 1, self._since), b + 1))
        after = self._known(range(b + _UNSEEN_STEPS + 1, k + 1))
        if min(len(before), len(after)) >= _SOON:
            belief = turn_belief(before, after, [], self._config)
            if belief.odds > (_DOUBT if self._unseen is None else self._unseen[0].odds):
                self._unseen = belief, b
        if self._unseen is not None and b - self._unseen[1] >= _PEAK_STEPS and not self._judging:
            return self._take_unseen()
        return len(self._raw)

    def _take_unseen(self) -> int:
        if self._unseen is None:
            return len(self._raw)
        belief, b = self._unseen
        self._unseen = None
        self._apply(belief, b, b + _UNSEEN_STEPS, 0.0)
        return b + 1

    def _jump(self, i: int, j: int) -> float:
        """From before step ``i`` to after step ``j``, over two steps each: a device sways with the stride."""
        before, after = self._raw[max(i - 1, self._since) : i + 1], self._raw[j + 1 : j + 3]
        then, now = (sum(step.yaw_gyro_rad for step in steps) / len(steps) for steps in (before, after))
        return now - then

    def _known(self, which: range) -> Pushes:
        """(N, 2) pushes and sides of these steps, those known, turned to how the device was held at the start."""
        rows = [
            (push * cmath.rect(1.0, -self._turned[k]), side * cmath.rect(1.0, -self._turned[k]))
            for k in which
            if not self._turning[k] and math.isfinite((push := self._pushes[k][0]).real)
            for side in (self._pushes[k][1],)
        ]
        return np.array(rows, dtype=np.complex128).reshape(-1, 2)

    def _apply(self, belief: Belief, i: int, j: int, jump: float) -> None:
        """Turn the steps of a turn in the hand by their share of it, and all later ones by all of it."""
        self._sigma[i + 1] = belief.sigma_rad
        from_rad = self._raw[i].yaw_gyro_rad
        for k in range(i + 1, len(self._raw)):
            share = min((k - i) / (j - i), 1.0)
            if jump and k <= j:
                share = min(max((self._raw[k].yaw_gyro_rad - from_rad) / jump, 0.0), 1.0)
            self._turned[k] -= share * belief.angle_rad

    def _judge_start(self) -> int:
        """How the device was held from the start, by all pushes so far."""
        if not self._raw:
            return 0
        belief = start_belief(self._known(range(len(self._raw)))[:, 0], self._raw, self._config)
        if belief == self._start:
            return len(self._raw)
        same = belief.angle_rad == self._start.angle_rad
        self._start = belief
        return len(self._raw) if same else 0


def turn_belief(before: Pushes, after: Pushes, jumps_rad: Sequence[float], config: CarryingConfig) -> Belief:
    """By how much the device was turned in the hand.

    Args:
        before, after: (N, 2) pushes and sides of the steps before and after, in the device's axes.
        jumps_rad: of the heading between them; none where it did not turn.
        config: how likely it is beforehand.
    """
    before, after = usual(before), usual(after)
    jumps = [jump for jump in map(wrap_scalar, jumps_rad) if abs(jump) >= _TURN_RAD]
    if min(len(before), len(after)) < _FEWEST or (jumps_rad and not jumps):
        return Belief(0.0, 0.0, -math.inf)
    then, now = before.mean(axis=0), after.mean(axis=0)
    scatter = (np.abs(before - then) ** 2).sum(axis=0) + (np.abs(after - now) ** 2).sum(axis=0)
    scatter = scatter / (2.0 * (len(before) + len(after) - 2)) + _NOISE_M_S2**2
    variance = scatter * (_CORRELATED * (1.0 / len(before) + 1.0 / len(after)) + _RESTLESS)
    variance += 0.25 * _DRIFT**2 * (np.abs(then) ** 2 + np.abs(now) ** 2).mean()

    def against_none(angle_rad: float) -> float:
        """Log-likelihood ratio of a device turned by an angle to one held as before."""
        seen = np.abs(now - then) ** 2 - np.abs(now - then * cmath.rect(1.0, -angle_rad)) ** 2
        return float((seen / (2.0 * variance)).sum())

    towards = complex((now.conj() * then / variance).sum())
    any_angle, sigma = cmath.phase(towards), min(1.0 / math.sqrt(max(abs(towards), 0.1)), _ANYWHERE_RAD)
    # of any angle, the share that fits the pushes so well
    fit = against_none(any_angle) + math.log(sigma / math.sqrt(2.0 * math.pi))
    partly = config.turned_in_corner if jumps else config.turned_unseen
    return _likeliest(
        [
            (0.0, 0.0, 0.0),
            *([(any_angle, sigma, math.log(partly) + fit)] if abs(any_angle) >= _TURN_RAD else []),
            *((jump, _SIGMA_TURN_RAD, math.log(config.turned_in_hand) + against_none(jump)) for jump in jumps),
        ]
    )


def usual(pushes: Pushes) -> Pushes:
    """Pushes without those far from the rest: setting off and halting push otherwise, and so do missed steps.

    Args:
        pushes: (N, M) of N strides.
    """
    if len(pushes) == 0:
        return pushes
    pushes = np.ascontiguousarray(pushes)
    middle = _middle(pushes.view(np.float64)).view(np.complex128)  # real and imaginary parts by themselves
    off = np.linalg.norm(pushes - middle, axis=1)
    return np.asarray(pushes[off <= _UNUSUAL * _middle(off) + _NOISE_M_S2])


def _middle(values: FloatArray) -> FloatArray:
    """Median of every column; ``np.median`` takes many times as long over a dozen rows."""
    ordered = np.sort(values, axis=0)
    return np.asarray(0.5 * (ordered[(len(values) - 1) // 2] + ordered[len(values) // 2]))


def start_belief(pushes: Pushes, steps: Sequence[Step], config: CarryingConfig) -> Belief:
    """Which way one walks against the device's forward, by all pushes of a walk.

    Args:
        pushes: (N,) in the axes that the device had at the start.
        steps: how it was held.
        config: what to believe beforehand.
    """
    up_rad, tilting, bounce = (
        float(np.mean([getattr(step, name) for step in steps]))
        for name in ("mount_up_rad", "tilt_rate_rad_s", "bounce_m_s2")
    )
    worn = up_rad > config.worn_up_rad or tilting > config.worn_tilt_rate_rad_s
    any_way = config.worn_any_way if worn else config.held_any_way
    prior = config.sigma_worn_rad if worn else config.sigma_held_rad
    if len(pushes) < _START_AT:
        return Belief(0.0, prior if worn else 0.0, -math.inf)
    pushes = usual(pushes[:, None])[:, 0]
    mean = complex(pushes.mean())
    noise = _CORRELATED * float((np.abs(pushes - mean) ** 2).mean()) / (2.0 * len(pushes))
    variance = (_LAG_ERROR_RAD * abs(mean)) ** 2 + (_LEAK * bounce) ** 2 + noise + _NOISE_M_S2**2
    seen, sigma = cmath.phase(mean), math.sqrt(variance) / max(abs(mean), 1e-9)

    def candidate(about_rad: float, about_sigma: float, share: float) -> tuple[float, float, float]:
        """An angle that was expected within a sigma: what the pushes make of it, and how well they fit."""
        off, both = wrap_scalar(seen - about_rad), math.hypot(sigma, about_sigma)
        sharpness = both**-2.0  # von Mises
        fit = sharpness * math.cos(off) - math.log(float(np.i0(sharpness)))
        return (
            wrap_scalar(about_rad + off * (about_sigma / both) ** 2),
            about_sigma * sigma / both,
            math.log(share) + fit,
        )

    as_told = candidate(0.0, prior, 1.0 - any_way)
    if not worn:  # a mount known as well as this is not bettered by the push
        as_told = 0.0, 0.0, as_told[2]
    return _likeliest(
        [
            as_told,
            candidate(0.0, config.sigma_worn_rad, any_way / 2.0),
            *(candidate(turn * math.pi / 2.0, config.sigma_held_rad, any_way / 12.0) for turn in (1, 2, 3)),
            (seen, min(sigma, _ANYWHERE_RAD), math.log(any_way / 4.0)),
        ]
    )


def carried(steps: Sequence[Step], config: CarryingConfig) -> list[Step]:
    """The steps of a whole walk, their directions turned from the device's to the walker's."""
    carrying = Carrying(config)
    for step in steps:
        carrying.add(step)
    carrying.finish()
    return carrying.steps()


def _likeliest(candidates: Sequence[tuple[float, float, float]]) -> Belief:
    """Out of angles, their sigmas and log-likelihoods: the first is "as before"."""
    angle, sigma, log = (np.array(column) for column in zip(*candidates, strict=True))
    weight: FloatArray = np.exp(log - log.max())
    odds = float(np.logaddexp.reduce(log[1:]) - log[0]) if len(log) > 1 else -math.inf
    if odds < _DOUBT:
        return Belief(float(angle[0]), float(sigma[0]), odds)
    weight /= weight.sum()
    best = int(weight.argmax())
    off = np.array([wrap_scalar(a - angle[best]) for a in angle.tolist()])
    return Belief(float(angle[best]), math.sqrt(float((weight * (off**2 + sigma**2)).sum())), odds)
