"""The smoother's own account: whether it came to an end, what its factors complain about, and who else agrees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.verdict import Reason
from fbgraph.estimators.estimates import Residuals
from fbgraph.integrity.evidence import Doubt, Evidence, turned_m

_DOUBTED_BELOW = 0.5  # of a robust factor's pull
_FEW = 10  # factors of a kind; of fewer no share is told
_APART = 2.5  # how far the smoother may be off both others, in sigmas of theirs; undisturbed: 1.92
_OTHERS_REL = 0.1  # step length and mount of EKF and PDR, a metre a metre walked
_OTHERS_M = 0.5


@dataclass(frozen=True)
class Limits:
    """What factors of a kind may show: twice and more what any undisturbed walk does.

    Attributes:
        rms: of all, in their sigmas.
        most: of any one.
        doubted: share that a robust loss may take half or more of its pull from.
        name, advice: for people.
    """

    rms: float
    most: float
    doubted: float
    name: str
    advice: str


_ALONE = np.inf
LIMITS = {
    "step_length": Limits(0.4, 2.5, _ALONE, "step lengths", "what is known of places contradicts the steps"),
    "step_sideways": Limits(
        0.4, 2.5, _ALONE, "walking straight ahead", "what is known of places contradicts the steps"
    ),
    "heading": Limits(
        0.4, 1.5, _ALONE, "the gyroscope's turns", "gyroscope and compass contradict each other; calibrate both"
    ),
    "bias_drift": Limits(
        0.4, 3.5, _ALONE, "the gyroscope's bias", "it jumped or drifts: let the device warm up and calibrate it"
    ),
    "compass": Limits(2.5, _ALONE, 0.65, "the compass", "calibrate the magnetometer, or keep magnets away"),
    "barometer": Limits(1.0, 5.0, 0.2, "the barometer", "shield it from wind, or leave it out; altitude is not known"),
    "climb": Limits(
        1.5, 3.5, _ALONE, "climbing", "the pressure changed faster than anybody climbs; altitude is not known"
    ),
    "standing_still": Limits(
        1.5,
        1.5,
        _ALONE,
        "the gyroscope's rate at rest",
        "its bias or scale changed, its clock runs wrong, or the compass pulls it away; check time and calibrate both",
    ),
}
"""By kind; of places that were told see ``aid_checks``. Measured on 88 real and 120 simulated undisturbed walks."""


def solver_failed(walk: Evidence) -> list[Doubt]:
    """The smoother gave no answer."""
    if "smoothed" not in walk.failed:
        return []
    text = f"the smoother gave no answer ({walk.failed['smoothed']})"
    return [Doubt(Reason("solver", 10.0, text, "the EKF's walk is there to look at"), withhold=True)]


def solver_at_its_limit(walk: Evidence) -> list[Doubt]:
    """The solver was stopped before it found the best answer."""
    done = walk.smoothed.iterations
    if done < walk.config.solver.max_iterations:
        return []
    text = f"the solver was stopped at its limit of {done} iterations, before it had found the best answer"
    advice = "what it was told contradicts itself; look at the recording's residuals, or raise solver.max_iterations"
    return [Doubt(Reason("solver", 1.0, text, advice))]


def factors_beyond_their_sigmas(walk: Evidence) -> list[Doubt]:
    """Kinds of factors whose residuals are larger than their sigmas promise."""
    found = []
    for residuals in walk.smoothed.residuals:
        limits = LIMITS.get(residuals.name)
        if limits is not None and (weight := _beyond(residuals, limits)) > 1.0:
            worst = float(np.abs(residuals.whitened).max())
            text = f"{limits.name}: off by {worst:.1f} sigma at worst, {residuals.rms:.1f} on average"
            if (share := _doubted(residuals)) > 0.1:
                text += f", {100.0 * share:.0f} % of it not believed"
            at = int(residuals.k[np.abs(residuals.whitened).argmax()])
            reason = Reason(residuals.name, weight, text, limits.advice, float(walk.track.start_s[at]))
            found.append(_widening(walk, residuals, reason))
    return found


def _widening(walk: Evidence, residuals: Residuals, reason: Reason) -> Doubt:
    """Altitude by what the barometer is off, and steps by their slopes; all else by the heading that is in doubt."""
    if residuals.name in ("barometer", "climb"):
        sigma_m = (
            walk.config.graph.sigma_altitude_m if residuals.name == "barometer" else walk.config.graph.sigma_climb_m
        )
        off_m = np.zeros(len(walk.track))
        off_m[residuals.k] = np.abs(residuals.whitened) * sigma_m
        # a sum of single steps that none climbs, or the worst so far
        so_far = np.cumsum(off_m) if residuals.name == "climb" else np.maximum.accumulate(off_m)
        # what was taken for a slope shortened the steps
        return Doubt(reason, np.cumsum(walk.track.shortened_m) / np.sqrt(2.0), so_far)
    heading_rad = 0.1 * min(reason.weight, 10.0)
    return Doubt(reason, turned_m(walk.track, heading_rad))


def _beyond(residuals: Residuals, limits: Limits) -> float:
    """How many times beyond its limits a kind of factor is."""
    worst = float(np.abs(residuals.whitened).max())
    return max(residuals.rms / limits.rms, worst / limits.most, _doubted(residuals) / limits.doubted)


def _doubted(residuals: Residuals) -> float:
    """Share of the factors of which less than half was left; 0 of a few."""
    return float((residuals.weight < _DOUBTED_BELOW).mean()) if len(residuals.k) >= _FEW else 0.0


def smoother_against_others(walk: Evidence) -> list[Doubt]:
    """The smoother may leave PDR or the EKF behind, each of which has its weakness, but seldom both."""
    smoothed = walk.smoothed.trajectory
    others = [walk.trajectories[name] for name in ("ekf", "pdr") if name in walk.trajectories]
    if len(others) < 2 or "smoothed" in walk.failed or walk.aids.places_known or walk.aids.closed_walk:
        return []
    apart_m = np.minimum(*(_apart_m(smoothed, other) for other in others))
    allowed_m = np.hypot(_allowed_m(smoothed, walk.config.graph), _iron_m(walk))
    worst = int((apart_m / allowed_m).argmax())
    ratio = float(apart_m[worst] / allowed_m[worst])
    if ratio <= _APART:
        return []
    text = (
        f"the smoothed walk is {apart_m[worst]:.0f} m away from those of PDR and EKF, "
        f"{ratio:.1f} times what they may be off"
    )
    advice = "one of the sensors misleads it; compare the three in the recording"
    reason = Reason("estimators", ratio / _APART, text, advice, float(smoothed.t_s[worst]))
    return [Doubt(reason, np.maximum.accumulate(apart_m))]


def _iron_m(walk: Evidence) -> FloatArray:
    """(K+1,) how far the device's own iron may have led the others astray, which do not know of it."""
    device = walk.smoothed.device
    if device is None or len(device.iron_ut) == 0:
        return np.zeros(len(walk.track))
    iron, usual = np.hypot(device.iron_ut[:, 0], device.iron_ut[:, 1]), np.maximum(device.iron_ut[:, 2], 1e-6)
    return turned_m(walk.track, float((iron / usual).max()))


def _apart_m(one: Trajectory, other: Trajectory) -> FloatArray:
    """(K+1,) distance between breadcrumbs of two walks from the same start."""
    off = (one.xy_m - one.xy_m[0]) - (other.xy_m - other.xy_m[0])
    return np.asarray(np.hypot(off[:, 0], off[:, 1]))


def _allowed_m(smoothed: Trajectory, config: GraphConfig) -> FloatArray:
    """(K+1,) one sigma of smoother and EKF together.

    The EKF's own covariance knows heading only, and takes compass errors for independent; here they last for
    ``mag_correlation_m``, as in the graph: after a walk of d, sigma_mag √(correlation d), beside what goes with d.
    """
    walked_m = smoothed.distance_m
    own_m = smoothed.longest_sigma_m if smoothed.longest_sigma_m is not None else np.zeros(len(smoothed))
    compass = config.sigma_mag_rad**2 * config.mag_correlation_m * walked_m
    return np.asarray(np.sqrt(own_m**2 + (_OTHERS_REL * walked_m) ** 2 + compass + _OTHERS_M**2))
