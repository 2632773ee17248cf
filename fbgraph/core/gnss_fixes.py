"""Fixes of a satellite receiver: which may be believed, how far each is off, and how many of them are independent.

A receiver tells the radius within which it is with a chance of 68 % (Android's ``Location.getAccuracy``; Apple's
``horizontalAccuracy`` is the root mean square of both axes, which differs from it by 7 %). Distances in the plane are
Rayleigh distributed, so each axis has a standard deviation of radius / 1.515.

Errors of neighbouring fixes are alike: reflections and the receiver's own filter hold for tens of seconds (Wilson's
autocorrelation of handheld receivers bends at about a minute; Ornstein-Uhlenbeck processes describe such series:
Sensors 2020, 20(21), 6050). With a correlation time of 30 s, fixes of every 10 s tell as much as a sixth of them would
if they were independent; so one in 10 s is kept, and its sigma is widened by the root of six.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.geometry import BoolArray, FloatArray, IntArray
from fbgraph.core.georeference import Georeference, along_ground_m
from fbgraph.core.nanoseconds import MAX_T_NS

RADIUS_68 = math.sqrt(-2.0 * math.log(1.0 - 0.6827))
"""Radius that holds 68 % of errors, in standard deviations of an axis: 1.515."""
WORST_RADIUS_M = 100.0
UNKNOWN_SIGMA_M = 5.0
"""Of a fix that tells no accuracy; phones under an open sky do better (van Diggelen and Enge 2015: 4.9 m radius)."""
FASTEST_VEHICLE_M_S = 60.0
_STILL_M = 30.0  # by which neighbouring fixes may differ although nobody moved
_NEIGHBOURS = 3
_APART_S, _ALIKE_S = 10.0, 30.0
_GOOD_RADIUS_M, _GOOD_RATIO = 10.0, 2.0
GNSS_USES = ("none", "start", "ends", "all")
"""What ``--use-gnss`` takes."""


def gnss_checkpoints(
    t_s: FloatArray,
    lat_deg: FloatArray,
    lon_deg: FloatArray,
    radius_m: FloatArray | None,
    source: str,
    elapsed_s: FloatArray | None = None,
) -> Checkpoints:
    """Believable fixes in metres East and North of the first; heights are left out, for they are off by tens of metres.

    Args:
        t_s: (M,) seconds; only their differences matter here.
        lat_deg, lon_deg: (M,) nan where there is none.
        radius_m: (M,) 68 % radius of each fix, nan or 0 where it is not known; None if none is.
        source, elapsed_s: as in ``Checkpoints``.

    Returns:
        Checkpoints in order of time; what was left out is in ``notices``.

    Raises:
        DataError: no fix may be believed.
    """
    radius_m = np.full(len(t_s), np.nan) if radius_m is None else np.where(radius_m == 0.0, np.nan, radius_m)
    with np.errstate(invalid="ignore"):
        there = (
            (np.abs(t_s) < MAX_T_NS / 1e9) & (np.abs(lat_deg) <= 90.0) & (np.abs(lon_deg) <= 180.0) & ~(radius_m < 0.0)
        )
        there &= (lat_deg != 0.0) | (lon_deg != 0.0)  # what receivers write before the first fix
        fine = there & ~(radius_m > WORST_RADIUS_M)
    left_out = {"without a place or time": int((~there).sum()), f"worse than {WORST_RADIUS_M:.0f} m": 0}
    left_out[f"worse than {WORST_RADIUS_M:.0f} m"] = int((there & ~fine).sum())
    kept = np.flatnonzero(fine)
    kept = kept[np.argsort(t_s[kept], kind="stable")]
    new = np.ones(len(kept), dtype=bool)
    new[1:] = (np.diff(lat_deg[kept]) != 0.0) | (np.diff(lon_deg[kept]) != 0.0)
    left_out["repeated"] = int((~new).sum())
    kept = kept[new]
    slow = _without_jumps(t_s[kept], lat_deg[kept], lon_deg[kept], radius_m[kept])
    left_out["faster than any vehicle from the others"] = int((~slow).sum())
    kept = kept[slow]
    why = ", ".join(f"{number} {reason}" for reason, number in left_out.items() if number)
    if len(kept) == 0:
        raise DataError(f"{source}: none of {len(t_s)} fixes may be believed ({why or 'there is none'})")
    notices = [f"{source}: {len(t_s) - len(kept)} of {len(t_s)} fixes left out ({why})"] if why else []
    radius_m = radius_m[kept]
    if (unknown := int(np.isnan(radius_m).sum())) > 0:
        notices.append(
            f"{source}: {unknown} fixes tell no accuracy; taken as {UNKNOWN_SIGMA_M:.0f} m (1σ) on each axis"
        )
    first = Georeference(float(lat_deg[kept[0]]), float(lon_deg[kept[0]]))
    lat_lon_deg = np.column_stack((lat_deg[kept], lon_deg[kept]))
    x_m, y_m = first.local_m(lat_lon_deg).T
    sigma_m = np.where(np.isnan(radius_m), UNKNOWN_SIGMA_M, radius_m / RADIUS_68)
    places = checkpoints(
        t_s[kept], x_m, y_m, sigma_m=sigma_m, source=source, georeference=first, lat_lon_deg=lat_lon_deg
    )
    elapsed_s = None if elapsed_s is None else elapsed_s[kept]
    return replace(places, gnss=True, elapsed_s=elapsed_s, notices=tuple(notices))


def _without_jumps(t_s: FloatArray, lat_deg: FloatArray, lon_deg: FloatArray, radius_m: FloatArray) -> BoolArray:
    """(M,) which fixes to keep so that nobody was faster than a vehicle from each to the next.

    Of the two at either end of a jump the one goes that is far from more of its neighbours; if they are alike, the
    less accurate one, else the earlier: receivers begin with a place they remember.
    """
    kept = list(range(len(t_s)))
    give_m = _STILL_M + 2.0 * np.nan_to_num(radius_m, nan=UNKNOWN_SIGMA_M * RADIUS_68)

    def far(i: int, j: int) -> bool:
        apart_m = float(along_ground_m(lat_deg[[i, j]], lon_deg[[i, j]])[0])
        return apart_m > FASTEST_VEHICLE_M_S * abs(float(t_s[j] - t_s[i])) + float(give_m[i] + give_m[j])

    def conflicts(at: int) -> int:
        near = kept[max(at - _NEIGHBOURS, 0) : at] + kept[at + 1 : at + 1 + _NEIGHBOURS]
        return sum(far(kept[at], other) for other in near)

    apart_m = along_ground_m(lat_deg, lon_deg) if len(t_s) > 1 else np.empty(0)
    if not (apart_m > FASTEST_VEHICLE_M_S * np.diff(t_s) + give_m[:-1] + give_m[1:]).any():
        return np.ones(len(t_s), dtype=bool)
    at = 0
    while at + 1 < len(kept):
        if not far(kept[at], kept[at + 1]):
            at += 1
            continue
        guilt = [(conflicts(k), give_m[kept[k]], -k) for k in (at, at + 1)]
        del kept[at if guilt[0] >= guilt[1] else at + 1]
        at = max(at - 1, 0)
    fine = np.zeros(len(t_s), dtype=bool)
    fine[kept] = True
    return fine


def require_gnss_use(use: str) -> str:
    """What ``--use-gnss`` was given.

    Raises:
        ConfigError: nothing that it takes.
    """
    if use not in GNSS_USES:
        raise ConfigError(f"--use-gnss {use}: expected {', '.join(GNSS_USES[:-1])} or {GNSS_USES[-1]}")
    return use


def gnss_anchors(fixes: Checkpoints, use: str) -> Checkpoints:
    """Those of a log's fixes that enter the graph.

    Args:
        fixes: on the log's clock, at least one.
        use: ``start``, the first good one; ``ends``, the first and the last good one; ``all``, independent ones.
    """
    good = _good(fixes.sigma_m)
    if use == "start":
        return fixes.select(good[:1])
    if use == "ends":
        return fixes.select(np.unique(good[[0, -1]]))
    best = _best_of_each(fixes.t_s, fixes.sigma_m)
    chosen = fixes.select(best)
    if len(chosen) < 2:
        return chosen
    widened = max(math.sqrt(2.0 * _ALIKE_S / max(float(np.median(np.diff(chosen.t_s))), _APART_S)), 1.0)
    return replace(chosen, sigma_m=chosen.sigma_m * widened)


def _good(sigma_m: FloatArray) -> IntArray:
    """Fixes not much worse than the best: receivers begin with a guess and sharpen it."""
    most_m = max(_GOOD_RADIUS_M / RADIUS_68, _GOOD_RATIO * float(sigma_m.min()))
    return np.flatnonzero(sigma_m <= most_m)


def _best_of_each(t_s: FloatArray, sigma_m: FloatArray) -> IntArray:
    """The most accurate fix of every ten seconds, the middle one of equals."""
    bins = np.floor((t_s - t_s[0]) / _APART_S + 1e-9).astype(np.int64)
    middle_s = np.abs(t_s - t_s[0] - (bins + 0.5) * _APART_S)
    order = np.lexsort((middle_s, sigma_m, bins))
    first = np.ones(len(order), dtype=bool)
    first[1:] = np.diff(bins[order]) != 0
    return np.sort(order[first])
