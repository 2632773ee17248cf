"""What the estimators answer: plain records, so that who reads them needs no solver."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from fbgraph.core.aids import Aids
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Breadcrumb, Trajectory
from fbgraph.core.verdict import Reason
from fbgraph.way_back.records import Closure, ReturnUpdate

FACTOR_KINDS = (
    "step_length",
    "step_sideways",
    "heading",
    "bias_drift",
    "compass",
    "field_strength",
    "barometer",
    "climb",
    "weather",
    "standing_still",
    "anchor",
    "closure",
    "closed_walk",
    "axis",
)
"""In the order of the table atop ``fbgraph.estimators.factor_graph``, priors on the origin left out; ``axis`` is what
legs have to say to ``fbgraph.estimators.building_axis``."""


@dataclass(frozen=True)
class Residuals:
    """All factors of one kind.

    Attributes:
        name: one of ``FACTOR_KINDS``.
        k: (N,) breadcrumb each is about, the later one of two.
        whitened: (N,) estimate minus measurement in standard deviations, before the robust loss; of a place, how far.
        weight: (N,) what the robust loss left of it, 0 to 1; ones for a factor without.
    """

    name: str
    k: npt.NDArray[np.int64]
    whitened: FloatArray
    weight: FloatArray

    @property
    def rms(self) -> float:
        """Root mean square; about 1 where the sigmas are right."""
        return float(np.sqrt((self.whitened**2).mean()))


@dataclass(frozen=True)
class DeviceErrors:
    """What the smoother found out about the device that recorded the walk.

    Attributes:
        gyro_scale, gyro_scale_sigma: share by which the gyroscope shows too much of a turn.
        iron_ut, iron_sigma_ut: (J, 3) horizontal components of the device's own iron in the wearer's frame, and the
            usual horizontal strength of the field, of each stretch between recalibrations; none without a compass.
        stretch_starts: (J,) breadcrumbs where these begin.
    """

    gyro_scale: float
    gyro_scale_sigma: float
    iron_ut: FloatArray
    iron_sigma_ut: FloatArray
    stretch_starts: npt.NDArray[np.int64]


@dataclass(frozen=True)
class AxisFit:
    """How a walk lies to the axis of its building.

    Attributes:
        used: whether it was turned to it.
        turned_rad, sigma_rad: by how much, counter-clockwise, and how well that is known.
        log_odds: logarithm of how much better that axis explains the straight legs than one that runs anywhere.
        legs: how many there are.
        along: how many of them lie along a corridor.
        why: it was not used, in words; empty if it was.
    """

    used: bool = False
    turned_rad: float = 0.0
    sigma_rad: float = 0.0
    log_odds: float = 0.0
    legs: int = 0
    along: int = 0
    why: str = ""


@dataclass(frozen=True)
class Smoothed:
    """A smoothed walk and how the solver got there.

    Attributes:
        trajectory: with covariance.
        errors: (I+1,) the graph's error (half the weighted sum of squares, robust) before the first of I iterations
            and after each.
        factors: number of factors in the graph.
        residuals: of every factor at the solution, by kind.
        closures: breadcrumbs tied to earlier ones.
        device: what was found out about the device; None of a walk that was not smoothed.
        aids: as they were used: anchors that contradict the walk with a wider sigma, and where their frame lies.
        doubts: why some of them are doubted.
        notes: what else they tell.
        axis: how it lies to the axis of its building; None if nobody named one.
    """

    trajectory: Trajectory
    errors: FloatArray
    factors: int
    residuals: tuple[Residuals, ...]
    closures: tuple[Closure, ...] = ()
    device: DeviceErrors | None = None
    aids: Aids = field(default_factory=Aids)
    doubts: tuple[Reason, ...] = ()
    notes: tuple[str, ...] = ()
    axis: AxisFit | None = None

    @property
    def closures_doubted(self) -> int:
        """How many of the closures had less than half of their pull left."""
        return sum(int((kind.weight < 0.5).sum()) for kind in self.residuals if kind.name == "closure")

    @property
    def iterations(self) -> int:
        """Of the solver."""
        return len(self.errors) - 1


@dataclass(frozen=True, slots=True)
class Update(Breadcrumb):
    """The estimate at the moment of a step, from what was known by then.

    Attributes:
        returning: on the way back, where on the way out that is and what to do next.
        caution: why the position is doubtful, in a sentence; None while nothing is known against it.
    """

    returning: ReturnUpdate | None = None
    caution: str | None = None


@dataclass(frozen=True)
class Belief:
    """Where the online smoother believed the recent walk to lie, at the moment of a step.

    Attributes:
        k: index of the latest breadcrumb.
        t_s: its time, seconds since log start.
        first: index of the first breadcrumb in ``xy_m``; those before it had left the window and stay as they were.
        xy_m: (k - first + 1, 2) places of breadcrumbs ``first`` … ``k``.
    """

    k: int
    t_s: float
    first: int
    xy_m: FloatArray
