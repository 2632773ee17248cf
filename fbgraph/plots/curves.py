"""Curves of a figure, over distance walked: error or its sigma, heading, altitude."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.plots.drawn import SIGMAS, Drawn, distinct_truths, in_order
from fbgraph.plots.style import TRUTH

_MARKED = 40  # checkpoints up to which each is marked
_STRAIGHT, _LEG_M = (
    1.04,
    3.0,
)  # a leg between checkpoints tells the heading where the walk there is as straight and long


def draw_errors(panel: Any, drawn: Sequence[Drawn]) -> None:
    """Errors at checkpoints, and two sigma of the longest axis of the ellipse, which they should rarely exceed."""
    for one in in_order(drawn):
        sigma_m = one.way.longest_sigma_m if one.main else None
        if sigma_m is not None and np.isfinite(sigma_m).all():
            panel.fill_between(one.way.distance_m, SIGMAS * sigma_m, color=one.color, alpha=0.15, lw=0.0, zorder=1)
        if len(one.error_m):
            few = len(one.error_m) <= _MARKED
            panel.plot(
                one.error_walked_m, one.error_m, color=one.color, ls=one.line, lw=1.2 if one.main else 0.9,
                marker=one.marker if few else "", ms=2.6, zorder=4 + one.main,
            )  # fmt: skip
    panel.set_ylim(bottom=0.0)
    panel.set_ylabel("error (m)" if any(len(one.error_m) for one in drawn) else "2σ (m)")


def draw_headings(panel: Any, drawn: Sequence[Drawn], north: str) -> None:
    """Walking directions of the steps, a full turn high and cut where fewest go; two sigma of those that have any.

    Args:
        panel: to draw on.
        drawn: what to draw.
        north: as in ``finish_map``; without it degrees are counter-clockwise from where the x axis points.
    """
    signed = -1.0 if north else 1.0
    every = np.concatenate([_direction_deg(one, north) for one in drawn])
    counts = np.bincount((np.mod(every, 360.0) // 30.0).astype(int), minlength=12)
    # a cut amid the emptiest stretch: smoothed around the circle
    spread = counts + np.roll(counts, 1) + np.roll(counts, -1)
    low = 30.0 * float(np.argmin(spread)) + 15.0
    for one in in_order(drawn):
        walked, direction = one.way.distance_m, np.unwrap(_direction_deg(one, north), period=360.0)
        cov = one.way.cov_xy_yaw if one.main else None
        for turns in range(int((low - direction.max()) // 360.0), int((low + 360.0 - direction.min()) // 360.0) + 1):
            shown = direction + 360.0 * turns
            if cov is not None and np.isfinite(cov[:, 2, 2]).all():
                half = SIGMAS * np.degrees(np.sqrt(cov[:, 2, 2]))
                panel.fill_between(walked, shown - half, shown + half, color=one.color, alpha=0.15, lw=0.0, zorder=1)
            panel.plot(walked, shown, color=one.color, ls=one.line, lw=1.1 if one.main else 0.8, zorder=3 + one.main)
    for one in drawn:
        if one.main:
            _true_legs(panel, one, north, low, signed)
    panel.set_ylim(low, low + 360.0)
    ticks = np.arange(90.0 * np.ceil(low / 90.0), low + 360.1, 90.0)
    names = ("N", "E", "S", "W") if north else ("0°", "90°", "180°", "270°")
    panel.set_yticks(ticks, [names[round(tick / 90.0) % 4] for tick in ticks])
    panel.set_ylabel("heading" if north else "direction")


def draw_altitudes(panel: Any, drawn: Sequence[Drawn]) -> None:
    """Altitude by the barometer, two sigma, and that of the truth where it has one."""
    for one in in_order(drawn):
        if not one.height:
            continue
        walked, sigma_m = one.way.distance_m, one.way.sigma_z_m
        if one.main and sigma_m is not None and np.isfinite(sigma_m).all():
            low_m, high_m = one.way.z_m - SIGMAS * sigma_m, one.way.z_m + SIGMAS * sigma_m
            panel.fill_between(walked, low_m, high_m, color=one.color, alpha=0.15, lw=0.0, zorder=1)
        panel.plot(walked, one.way.z_m, color=one.color, ls=one.line, lw=1.2 if one.main else 0.9, zorder=3 + one.main)
    for truth in distinct_truths(drawn):
        known = truth.select(np.isfinite(truth.z_m))
        one = next(one for one in drawn if one.truth is not None and np.array_equal(one.truth.xy_m, truth.xy_m))
        if len(known) > 1:
            z_m = known.z_m - known.z_m[0] + one.way.at(known.t_s[:1])[0, 2]
            few = len(known) <= _MARKED
            panel.plot(
                one.walked_m(known.t_s), z_m, "x" if few else "-", color=TRUTH, ms=3.5, mew=0.8, lw=0.7, zorder=6
            )
    low, high = panel.get_ylim()
    if high - low < 2.0:  # noise is not to look like stairs
        panel.set_ylim(0.5 * (low + high) - 1.0, 0.5 * (low + high) + 1.0)
    panel.set_ylabel("altitude (m)")


def _direction_deg(one: Drawn, north: str) -> FloatArray:
    """(K,) clockwise from North, or counter-clockwise from the x axis where no North is known."""
    yaw_deg = np.degrees(one.way.yaw_rad)
    return np.asarray(np.mod(90.0 - yaw_deg if north else yaw_deg, 360.0))


def _true_legs(panel: Any, one: Drawn, north: str, low: float, signed: float) -> None:
    """True directions from checkpoint to checkpoint, where the walk went straight from one to the other."""
    if one.truth is None:
        return
    chosen = [0]
    for k, place in enumerate(one.truth.xy_m):
        if np.hypot(*(place - one.truth.xy_m[chosen[-1]])) >= _LEG_M:
            chosen.append(k)
    t_s, places = one.truth.t_s[chosen], one.truth.xy_m[chosen]
    walked = one.walked_m(t_s)
    straight_m = np.hypot(*np.diff(one.way.at(t_s)[:, :2], axis=0).T)
    for k in np.flatnonzero(np.diff(walked) <= _STRAIGHT * straight_m).tolist():
        dx_m, dy_m = places[k + 1] - places[k]
        deg = signed * np.degrees(np.arctan2(dy_m, dx_m)) + (90.0 if north else 0.0)
        panel.plot(walked[k : k + 2], [low + (deg - low) % 360.0] * 2, color=TRUTH, lw=0.8, zorder=6)
