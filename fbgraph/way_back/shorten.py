"""A way without the loops and dead ends that the walk closed itself, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from fbgraph.core.config import GraphConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.core.trajectory import Trajectory

SAME_M = 2.0
"""Who is so near to a place is at it, if the trajectory is right."""
SEEN_M = 3.0
"""Who is so near to a place in truth finds it."""
_LEVEL_M = 1.5
_VISIT = 5  # breadcrumbs
_SHORTEST_M = 8.0  # a detour that is worth leaving out


@dataclass(frozen=True)
class LeftOut:
    """A piece of a walk between two breadcrumbs that are taken for the same place.

    Attributes:
        first, last: those breadcrumbs.
        after_m: walked before it.
        length_m: of it.
        apart_m: how far the two places are apart by the trajectory.
        sigma_m: standard deviation of how far they are, along the worse of two axes; None if nobody knows.
        sure: probability that they are within ``SEEN_M`` in truth; None if nobody knows.
    """

    first: int
    last: int
    after_m: float
    length_m: float
    apart_m: float
    sigma_m: float | None
    sure: float | None


def shortened(trajectory: Trajectory, graph: GraphConfig | None = None) -> tuple[Trajectory, tuple[LeftOut, ...]]:
    """The trajectory without what lies between two visits of a place, from its end on the earliest visit each.

    Args:
        trajectory: the walk.
        graph: weights of the steps, for how sure it is that two places are one; nobody knows without.

    Returns:
        The breadcrumbs that are left, and what was left out, in walking order.
    """
    walked, xyz = trajectory.distance_m, np.column_stack((trajectory.xy_m, trajectory.z_m))
    kept, left_out = [len(trajectory) - 1], list[LeftOut]()
    while (k := kept[-1]) > 0:
        far = int(np.searchsorted(walked, walked[k] - _SHORTEST_M, side="right"))
        off = xyz[:far] - xyz[k]
        near = (np.hypot(off[:, 0], off[:, 1]) < SAME_M) & (np.abs(off[:, 2]) < _LEVEL_M)
        if not near.any():
            kept.append(k - 1)
            continue
        first = int(near.argmax())
        visit = first + int((~near[first:]).argmax() if not near[first:].all() else far - first)  # it ends there
        later = np.arange(k, max(k - _VISIT, visit), -1)  # the visit of ``k``, of which the nearest pair is taken
        apart = np.hypot(*(xyz[later][:, None, :2] - xyz[None, first:visit, :2]).transpose(2, 0, 1))
        at, i = divmod(int(apart.argmin()), visit - first)
        i = 0 if first == 0 else first + i  # who is at the start is there
        kept += later[1 : at + 1].tolist()
        k = int(later[at])
        left_out.append(_left_out(trajectory, i, k, graph))
        kept.append(i)
    index = np.array(kept[::-1])
    known: dict[str, FloatArray] = {
        f.name: getattr(trajectory, f.name)[index]
        for f in fields(trajectory)
        if getattr(trajectory, f.name) is not None
    }
    return Trajectory(**known), tuple(left_out[::-1])


def _left_out(trajectory: Trajectory, i: int, k: int, graph: GraphConfig | None) -> LeftOut:
    walked = trajectory.distance_m
    apart_m = float(np.hypot(*(trajectory.xy_m[k] - trajectory.xy_m[i])))
    sigma_m = _sigma_m(trajectory, i, k, graph)
    return LeftOut(
        i,
        k,
        float(walked[i]),
        float(walked[k] - walked[i]),
        apart_m,
        sigma_m,
        None if sigma_m is None else within(SEEN_M, apart_m, sigma_m),
    )


def _sigma_m(trajectory: Trajectory, i: int, k: int, graph: GraphConfig | None) -> float | None:
    """Of the place of ``k`` as seen from ``i``: independent errors of the steps, and headings that go astray between.

    What all steps share, a scale or a turned compass, a loop that closes takes back: its steps lead nowhere together.
    Headings are off by their largest stored sigma, one way on the way out and the other on the way back, anew in every
    lap. It cannot be more than the sum of the sigmas of both places.
    """
    cov = trajectory.cov_xy_yaw
    if cov is None or graph is None or not np.isfinite(cov[i : k + 1][:, [0, 0, 1, 2], [0, 1, 1, 2]]).all():
        return None
    step_m = np.hypot(np.diff(trajectory.x_m[i : k + 1]), np.diff(trajectory.y_m[i : k + 1]))
    own_m = math.hypot(graph.sigma_length_rel * float(np.linalg.norm(step_m)), graph.sigma_lateral_m * math.sqrt(k - i))
    spread_m = float(np.hypot(*(trajectory.xy_m[i : k + 1] - trajectory.xy_m[k]).T).max())
    aside_m = math.sqrt(float(cov[i : k + 1, 2, 2].max()) * float(step_m.sum()) * spread_m)
    both_m = sum(math.sqrt(float(np.linalg.eigvalsh(cov[n, :2, :2])[-1])) for n in (i, k))
    return min(math.hypot(own_m, aside_m), both_m)


def within(reach_m: float, apart_m: float, sigma_m: float) -> float:
    """Probability that two places are within reach of one another, whose estimates are so far apart."""
    from scipy.special import chndtr  # here, because it takes a moment to import

    if sigma_m < 1e-6:
        return float(apart_m < reach_m)
    return float(chndtr((reach_m / sigma_m) ** 2, 2.0, (apart_m / sigma_m) ** 2))


def left_out_text(left_out: Sequence[LeftOut]) -> list[str]:
    """What was left out, in a sentence or two; nothing if nothing was."""
    if not left_out:
        return []
    count, total_m = len(left_out), math.fsum(one.length_m for one in left_out)
    lines = [
        f"Left out: {total_m:.0f} m in {count} loop{'' if count == 1 else 's'} or dead end"
        f"{'' if count == 1 else 's'}, where the walk came by a place again."
    ]
    known = [one for one in left_out if one.sure is not None]
    if known:
        worst = min(known, key=lambda one: one.sure or 0.0)
        apart = f"they are {worst.apart_m:.1f} m apart, ±{worst.sigma_m or 0.0:.1f} m"
        lines.append(
            f"That its two ends are one place, within {SEEN_M:.0f} m, is {100 * (worst.sure or 0.0):.0f} % sure"
            f"{' or more; least' if count > 1 else ':'} after {worst.after_m:.0f} m of the walk {apart}."
        )
    else:
        lines.append("How sure that is nobody knows: the trajectory has no uncertainty.")
    return lines
