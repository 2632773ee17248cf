"""Whether the ellipses of a trajectory hold: how many known places lie inside those of 95 %.

A place that was surveyed has an error of its own, and so has the one at which the walk is moved to agree; both count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.run.metrics import Alignment, checkpoint_offsets

ELLIPSE_95 = 5.991464547107979
"""Squared Mahalanobis distance within which 95 % of two-dimensional Gaussian errors lie: -2 ln 0.05."""


@dataclass(frozen=True)
class Coverage:
    """Errors at known places in units of what they were said to be.

    Attributes:
        nees: (M,) normalised estimation error squared, eᵀ Σ⁻¹ e; χ² of two degrees of freedom, mean 2, if Σ is right
            (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4).
    """

    nees: FloatArray

    @property
    def inside(self) -> int:
        """How many places lie inside the ellipse of 95 %."""
        return int((self.nees <= ELLIPSE_95).sum())

    @property
    def share(self) -> float:
        """Part of the places inside it."""
        return self.inside / len(self.nees)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        worst = float(np.sqrt(self.nees.max()))
        return {
            "inside_95": self.inside,
            "of": len(self.nees),
            "nees_mean": float(self.nees.mean()),
            "worst_sigma": worst,
        }


def coverage(
    trajectory: Trajectory,
    truth: Checkpoints,
    t0_s: float = 0.0,
    alignment: Alignment = "start",
    log_s: tuple[float, float] | None = None,
) -> Coverage | None:
    """Errors at the scored checkpoints against ellipse and survey; None without covariance.

    The covariance of an error is that of the breadcrumb there (linear between two) and of the place; where the walk is
    moved to agree at the first checkpoint, that of the walk and of the place there as well, taken as independent.

    Args:
        trajectory, truth, t0_s, log_s: as in ``checkpoint_errors``; places without a standard deviation are taken as
            exact.
        alignment: ``start`` or ``none``; a rigid fit leaves errors that are not the estimator's.

    Raises:
        DataError: as ``checkpoint_errors``.
    """
    cov = trajectory.cov_xy_yaw
    if cov is None or not np.isfinite(cov[:, :2, :2]).all():
        return None
    offset_m = checkpoint_offsets(trajectory, truth, t0_s, alignment, log_s)
    t_s = truth.t_s - t0_s
    xx, xy, yy = (np.interp(t_s, trajectory.t_s, cov[:, i, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    own = np.nan_to_num(truth.sigma_m, nan=0.0) ** 2
    sigma = np.empty((len(t_s), 2, 2))
    sigma[:, 0, 0], sigma[:, 1, 1] = xx + own, yy + own
    sigma[:, 0, 1] = sigma[:, 1, 0] = xy
    if alignment == "start":
        sigma = sigma[1:] + sigma[0]
    sigma += 1e-9 * np.eye(2)  # an exact place at a certain breadcrumb: a tenth of a millimetre
    return Coverage(np.einsum("ni,ni->n", offset_m, np.linalg.solve(sigma, offset_m[:, :, None])[:, :, 0]))
