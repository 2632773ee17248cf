"""Which of three sensors has its axes in another order or with other signs: two agree, the third is wrong.

Gravity and Earth's field both turn in the device as the gyroscope says (``turning``). If one sensor's axes are a signed
order Q of the device's, v_raw = Qᵀ v, then v̇ = -ω × v becomes v̇_raw = -(det Q · Qᵀω) × v_raw: a mirrored
accelerometer cannot be told from a turned gyroscope by these two, and a vector with all signs negated not from one
without. So the magnetometer votes on the first, and simplicity and the field's dip on the second.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.physics.turning import (
    FIELD_WINDOW_S,
    GRAVITY_WINDOW_S,
    PROPER_ORDERS,
    SIGNED_ORDERS,
    Residuals,
    Windows,
    cut,
    gain,
    integrate,
    residuals,
)

Culprit = Literal["none", "acc", "gyro", "mag"]

LEAVE_SIGMAS = 2.5  # by which names must be beaten; of right ones on 105 real logs: at most 1.9
_AMONG_SIGMAS, _CHIP_SIGMAS = 2.0, 1.0  # by which the runner-up must be; less for what a known chip explains
_CLEARLY_SIGMAS = 5.0  # by which names are beaten where a known chip needs to be no better than the runner-up
_TWO_SIGMAS = 1.5  # from which two sensors may be wrong, and nothing is done
_DOUBT_SIGMAS = 2.0  # from which something is said
_SURE_SIGMAS = 1.0
CHIPS: dict[str, tuple[str, str, str]] = {
    "ICM-20948": ("x", "-y", "-z"),
    "MPU-9250 or MPU-9150": ("y", "x", "-z"),
    "LSM9DS1": ("-x", "y", "z"),
}
"""Which axes of their magnetometers lie along x, y and z of their accelerometers: data sheets DS-000189 (figures 12 and
13), PS-MPU-9250A-01 (9.1), DocID025715 (1.1)."""
_FEW = 6  # windows, of which nothing follows
_BIAS_RAD_S = 0.05  # one sigma
_IRON = 3.0  # one sigma of the hard iron against the usual reading


@dataclass(frozen=True)
class Turning:
    """How the accelerometer and the magnetometer turn against the gyroscope, in windows.

    Attributes:
        acc: windows of gyroscope and accelerometer, as their file has them.
        mag: of gyroscope and magnetometer; none without one.
    """

    acc: Windows
    mag: Windows
    _field: dict[float, Residuals | None] = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def of(cls, acc: Stream, gyro: Stream, mag: Stream | None) -> Turning:
        """Cut both out of a log; streams as their file has them, the accelerometer's in any unit."""
        nothing = Stream(np.empty(0), np.empty((0, 3)))
        return cls(cut(gyro, acc, GRAVITY_WINDOW_S), cut(gyro, mag or nothing, FIELD_WINDOW_S))

    def gravity(self, scale: float) -> Residuals | None:
        """What is left moving of gravity under each of ``SIGNED_ORDERS``; ``scale``: the gyroscope's unit in rad/s."""
        return _both_hands(self.acc, scale, "bias", _BIAS_RAD_S)

    def field(self, scale: float) -> Residuals | None:
        """The same of Earth's field; solved once for a scale, for vote and hard iron ask the same."""
        if scale not in self._field and len(self.mag) >= _FEW:
            usual = float(np.median(np.linalg.norm(self.mag.vector, axis=-1)))
            self._field[scale] = _both_hands(self.mag, scale, "offset", _IRON * max(usual, 1e-9))
        return self._field.get(scale)


def _both_hands(windows: Windows, scale: float, free: str, prior: float) -> Residuals | None:
    if len(windows) < _FEW:
        return None
    hands = [residuals(integrate(hand * scale * windows.rate), windows.vector, free, prior) for hand in (1.0, -1.0)]
    return Residuals(np.concatenate([h.size for h in hands]), np.concatenate([h.free for h in hands]))


@dataclass(frozen=True, eq=False)
class Vote:
    """Whose axes are not as named.

    Attributes:
        culprit: the sensor; "none" if all are as named, or if the motion does not tell otherwise.
        axes: (3, 3) what brings its columns to the axes of the other two.
        sure: whether the motion told.
        margin: standard deviations over the next best explanation.
        doubt: standard deviations by which another one is better than what was kept; 0 if none is.
        other: that one, for people.
        ambiguous: accelerometer and gyroscope contradict each other, without a third to say which of them is wrong.
    """

    culprit: Culprit
    axes: FloatArray
    sure: bool
    margin: float
    doubt: float = 0.0
    other: str = ""
    ambiguous: bool = False


_Told = tuple[Culprit, int, int]  # culprit, and which order gravity and the field then follow


def vote(turning: Turning, scale: float) -> Vote:
    """Compare all explanations in which one sensor at most is wrong, the gyroscope's unit being ``scale`` rad/s."""
    gravity, field = turning.gravity(scale), turning.field(scale)
    costs = tuple(np.zeros((48, 0)) if r is None else r.cost(r.usual) for r in (gravity, field))
    none: _Told = ("none", 0, 0)
    told: list[_Told] = [none, *(("gyro", h, h) for h in range(1, 48))]
    if gravity is None and field is None:
        return Vote("none", np.eye(3), False, 0.0)
    if field is not None and gravity is not None:
        told += [("acc", h, 0) for h in range(1, 24)] + [("mag", 0, h) for h in range(1, 24)]
    elif field is not None:
        told = [none, *(("mag", 0, h) for h in range(1, 24))]
    left = np.array([costs[0][h].sum() + costs[1][g].sum() for _, h, g in told])
    best, second = (told[i] for i in np.argsort(left)[:2])
    margin = gain(costs, second[1:], best[1:])
    if best == none:
        return Vote("none", np.eye(3), margin >= _SURE_SIGMAS, margin)
    against = gain(costs, none[1:], best[1:])
    among = margin
    if second == none:
        third = told[int(np.argsort(left)[2])]
        among = gain(costs, third[1:], best[1:])
    found = _explained(best, with_field=field is not None)
    alone = (int(costs[0].sum(axis=1).argmin()), int(costs[1].sum(axis=1).argmin()))
    if field is not None and 0 not in alone and gain(costs, best[1:], alone) > _TWO_SIGMAS:
        return Vote("none", np.eye(3), False, 0.0, against, "the axes of more than one sensor are not as named")
    needed = _AMONG_SIGMAS
    if found.culprit == "mag" and chip_of(found.axes):  # who only turns left and right turns a gyroscope as well so
        needed = _CHIP_SIGMAS if against < _CLEARLY_SIGMAS else 0.0
    if against < LEAVE_SIGMAS or among < needed:
        other = f"{_SENSORS[found.culprit]} is {told_axes(found.axes)}" if against >= _DOUBT_SIGMAS else ""
        return Vote("none", np.eye(3), False, 0.0, against, other)
    return Vote(found.culprit, found.axes, not found.ambiguous, min(against, among), ambiguous=found.ambiguous)


_SENSORS = {"acc": "the accelerometer", "gyro": "the gyroscope", "mag": "the magnetometer", "none": "nothing"}


def _explained(best: _Told, with_field: bool) -> Vote:
    """An explanation as a sensor and what to do with its axes."""
    culprit, h, g = best
    if culprit == "mag":
        return Vote("mag", PROPER_ORDERS[g], True, 0.0)
    if culprit == "gyro":
        axes = SIGNED_ORDERS[h].T
        mirrored = -PROPER_ORDERS[h] if h < 24 else axes
        if with_field or h >= 24:  # no order of the accelerometer's axes looks like a mirrored gyroscope
            return Vote("gyro", axes, True, 0.0)
        if _negations(mirrored) < _negations(axes):
            return Vote("acc", mirrored, False, 0.0, ambiguous=True)
        return Vote("gyro", axes, False, 0.0, ambiguous=True)
    return Vote("acc", simpler(PROPER_ORDERS[h]), True, 0.0)


def simpler(axes: FloatArray) -> FloatArray:
    """Of a signed order and the one with all signs negated, that with fewer of them."""
    return axes if _negations(axes) <= _negations(-axes) else -axes


def _negations(axes: FloatArray) -> int:
    return int((axes < 0).sum())


def chip_of(axes: FloatArray) -> str:
    """The chip whose magnetometer lies so, or with all signs negated, which no turn tells; "" if none is known."""
    names = (name for name, told in CHIPS.items() if told_axes(axes) == ", ".join(told))
    back = (name for name, told in CHIPS.items() if told_axes(-axes) == ", ".join(told))
    return next(names, next(back, ""))


def told_axes(axes: FloatArray) -> str:
    """A signed order for people: ``x, -y, -z``."""
    return ", ".join(f"{'-' if row.sum() < 0 else ''}{'xyz'[int(np.abs(row).argmax())]}" for row in axes)
