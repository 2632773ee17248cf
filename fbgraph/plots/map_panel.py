"""The map of a figure: walks, their ellipses of two sigma, the truth, North and a scale."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.patheffects import withStroke

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.geometry import FloatArray
from fbgraph.plots.drawn import SIGMAS, Drawn, distinct_truths, in_order
from fbgraph.plots.style import TRUTH

_ELLIPSES = 14  # along a walk; more would hide it
_DENSE_M = 1.5  # truth whose places are nearer to one another is a line, not places
_EDGE = 0.03  # between a corner and what stands there, as part of the map
_LINE_IN, _LETTERS_IN = 0.14, 0.62  # a line of text, and the words for a North that the compass shows
_HALO = [withStroke(linewidth=2.0, foreground="white")]


def draw_map(panel: Any, drawn: Sequence[Drawn]) -> None:
    """Draw walks on equal axes; ``finish_map`` adds North and scale once the layout stands."""
    for order, one in enumerate(in_order(drawn)):
        if one.main:
            _ellipses(panel, one)
            _misses(panel, one)
        way, width = one.way, 1.4 if one.main else 1.0
        panel.plot(way.x_m, way.y_m, color=one.color, ls=one.line, lw=width, zorder=4 + order)
        panel.plot(way.x_m[-1:], way.y_m[-1:], one.marker, color=one.color, ms=4.5, mec="black", mew=0.5, zorder=30)
    for truth in distinct_truths(drawn):
        if is_dense(truth):
            panel.plot(truth.x_m, truth.y_m, color=TRUTH, lw=0.8, zorder=3)
        else:
            panel.plot(truth.x_m, truth.y_m, "x", color=TRUTH, ms=4.0, mew=0.9, zorder=29)
    panel.plot(drawn[0].way.x_m[:1], drawn[0].way.y_m[:1], "o", mfc="white", mec="black", mew=0.9, ms=5.0, zorder=31)
    panel.set_aspect("equal", adjustable="datalim")
    panel.margins(0.06)


def extent_m(drawn: Sequence[Drawn]) -> FloatArray:
    """(2,) width and height of what the map shows, at least a metre each."""
    places = [one.way.xy_m for one in drawn] + [truth.xy_m for truth in distinct_truths(drawn)]
    return np.asarray(np.maximum(np.ptp(np.concatenate(places), axis=0), 1.0))


def is_dense(truth: Checkpoints) -> bool:
    """Whether truth is a path and not a few places."""
    return bool(np.median(np.hypot(*np.diff(truth.xy_m, axis=0).T)) < _DENSE_M)


def finish_map(panel: Any, drawn: Sequence[Drawn], north: str) -> None:
    """Scale and North in the emptiest corner; the limits are those of the layout from now on.

    Args:
        panel: whose layout is done.
        drawn: what the map shows.
        north: which one its y axis points to, of ``north_of``; nothing is drawn of an unknown one.
    """
    x0, x1 = panel.get_xlim()
    y0, y1 = panel.get_ylim()
    panel.set(xlim=(x0, x1), ylim=(y0, y1), autoscale_on=False)
    panel.set_aspect("equal", adjustable="box")
    width_in, height_in = panel.get_window_extent().size / panel.figure.dpi
    length_m = _round_length(0.22 * (x1 - x0))
    reach, line = length_m / (x1 - x0), _LINE_IN / height_in
    box = np.array(
        [max(reach, (_LETTERS_IN if north == "magnetic" else 0.0) / width_in), (3.3 if north else 1.2) * line]
    )
    share = (_outlines(drawn) - (x0, y0)) / (x1 - x0, y1 - y0)

    def crowd(corner: tuple[float, ...]) -> int:
        """How much of what is drawn lies in a corner."""
        return int((np.abs(share - corner) < box + _EDGE).all(axis=1).sum())

    right, top = min(itertools.product((0.0, 1.0), repeat=2), key=crowd)
    middle = _EDGE + 0.5 * box[0] if right == 0.0 else 1.0 - _EDGE - 0.5 * box[0]
    base = _EDGE if top == 0.0 else 1.0 - _EDGE - box[1]
    kw: dict[str, Any] = {"transform": panel.transAxes, "zorder": 40, "path_effects": _HALO}
    ends = [middle - 0.5 * reach, middle + 0.5 * reach]
    panel.plot(ends, [base, base], color="black", lw=1.6, solid_capstyle="butt", **kw)
    panel.text(middle, base + 0.15 * line, f"{length_m:g} m", ha="center", va="bottom", **kw)
    if north:
        arrow = {"arrowstyle": "-|>", "color": "black", "lw": 1.0, "shrinkA": 0.0, "shrinkB": 0.0}
        ends = [base + 1.25 * line, base + 2.45 * line]
        panel.annotate("", (middle, ends[1]), (middle, ends[0]), xycoords="axes fraction", arrowprops=arrow, zorder=41)
        name = "N" if north == "true" else "magnetic N"
        panel.text(middle, ends[1], name, ha="center", va="bottom", **kw)


def _outlines(drawn: Sequence[Drawn]) -> FloatArray:
    """(N, 2) points of all that is drawn, ellipses by their longest axis."""
    places: list[FloatArray] = [truth.xy_m for truth in distinct_truths(drawn)]
    for one in drawn:
        places.append(one.way.xy_m)
        if one.main and (sigma_m := one.way.longest_sigma_m) is not None and np.isfinite(sigma_m).all():
            turns = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
            places += [one.way.xy_m + SIGMAS * sigma_m[:, None] * (np.cos(a), np.sin(a)) for a in turns]
    return np.concatenate(places)


def _ellipses(panel: Any, one: Drawn) -> None:
    """Where a walk is with two sigma, every so often."""
    cov = one.way.cov_xy_yaw
    if cov is None or not np.isfinite(cov[:, :2, :2]).all():
        return
    walked, longest_m = one.way.distance_m, np.sqrt(np.linalg.eigvalsh(cov[:, :2, :2])[:, 1])
    at = [len(walked) - 1]
    for k in range(len(walked) - 1, 0, -1):  # from the end, which is the one that matters
        if walked[at[-1]] - walked[k] >= max(walked[-1] / _ELLIPSES, longest_m[k] + longest_m[at[-1]]):
            at.append(k)
    variance, axes = np.linalg.eigh(cov[at, :2, :2])
    half_m = SIGMAS * np.sqrt(np.maximum(variance, 0.0))
    panel.add_collection(
        EllipseCollection(
            2.0 * half_m[:, 1], 2.0 * half_m[:, 0], np.degrees(np.arctan2(axes[:, 1, 1], axes[:, 0, 1])),
            units="xy", offsets=one.way.xy_m[at], offset_transform=panel.transData,
            facecolor=(*one.color, 0.08), edgecolor=one.color, linewidth=0.7, zorder=2,
        )
    )  # fmt: skip
    # a collection's ellipses do not count for the limits
    reach = half_m[:, 1]
    panel.update_datalim(np.concatenate((one.way.xy_m[at] - reach[:, None], one.way.xy_m[at] + reach[:, None])))


def _misses(panel: Any, one: Drawn) -> None:
    """From each of a few true places to where the walk was then."""
    if one.truth is None or is_dense(one.truth):
        return
    for place, there in zip(one.truth.xy_m, one.way.at(one.truth.t_s)[:, :2], strict=True):
        panel.plot(*zip(place, there, strict=True), color=TRUTH, lw=0.5, zorder=3)


def _round_length(length_m: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is no longer."""
    ten = 10.0 ** np.floor(np.log10(length_m))
    return float(max(step * ten for step in (1.0, 2.0, 5.0) if step * ten <= length_m * (1.0 + 1e-9)))
