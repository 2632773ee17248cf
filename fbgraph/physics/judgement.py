"""What is decided about one sensor: unit, signs and axes, by what, and how surely."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from fbgraph.core.geometry import FloatArray

By = Literal["name", "physics", "assumed"]


@dataclass(frozen=True, eq=False)
class Judgement:
    """One decision.

    Attributes:
        scale: factor to SI: m/s², rad/s, µT, hPa; nan if the numbers are nothing of the kind.
        unit: for people.
        axes: (3, 3) signed permutation: what it makes of a column vector (x, y, z) is along the device's axes.
        by: what decided: the name (physics agrees or is silent), physics (against the name, or without one), or
            neither, so that the likeliest was assumed.
        sure: whether anything was left to assume.
        margin: standard deviations between what was decided and the next best; inf where limits alone decide.
        text: what to say; empty if there is nothing to.
        gravity_removed: of an accelerometer: it shows no gravity, so that nothing tells which way is down.
    """

    scale: float
    unit: str
    by: By
    sure: bool
    margin: float = float("inf")
    text: str = ""
    axes: FloatArray = field(default_factory=lambda: np.eye(3))
    gravity_removed: bool = False

    @property
    def signed_axes(self) -> tuple[str, str, str]:
        """Which column, turned or not, points along x, y and z: ``("x", "-y", "-z")``."""
        x, y, z = (f"{'-' if row.sum() < 0 else ''}{'xyz'[int(np.abs(row).argmax())]}" for row in self.axes)
        return x, y, z

    @property
    def straight(self) -> bool:
        """Whether the axes are as named."""
        return bool((self.axes == np.eye(3)).all())


@dataclass(frozen=True)
class Judged:
    """What each sensor is; None for those that are not there.

    Attributes:
        axes_told: whether the motion told that the axes are right, as named or as turned.
    """

    acc: Judgement
    gyro: Judgement
    mag: Judgement | None = None
    pressure: Judgement | None = None
    axes_told: bool = True

    @property
    def texts(self) -> tuple[str, ...]:
        """What there is to say, a clause each."""
        found = (self.acc, self.gyro, self.mag, self.pressure)
        clauses = (clause for judgement in found if judgement is not None for clause in judgement.text.split("; "))
        return tuple(clause for clause in clauses if clause)

    @property
    def undecided(self) -> str:
        """What more of the walk may still tell; "" if nothing."""
        untold = () if self.axes_told else ("axes: taken as named, the device turned too little to tell",)
        return "; ".join((*self.texts, *untold))
