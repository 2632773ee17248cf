"""How figures on paper look: one colour, line and marker an estimator, legible in grey. Nothing here draws."""

from __future__ import annotations

from typing import Any

from fbgraph.core.colors import COLORS, RUN_COLORS

Shade = tuple[float, float, float]

PAPER: Any = {
    **{"axes.spines.top": False, "axes.spines.right": False},
    **{"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": "fbgraph"},
}
"""Of every figure, for ``matplotlib.rc_context``: letters stay letters, and the same figure is the same picture."""

TRUTH = "black"
"""On white; on a screen's black it is ``COLORS["truth"]``."""

STYLES: dict[str, tuple[Any, str]] = {
    "logged_pdr": ((0, (1, 1)), "v"),
    "logged_forestback": ((0, (5, 1, 1, 1, 1, 1)), "P"),
    "pdr": ((0, (2, 1.2)), "s"),
    "ekf": ((0, (6, 1.5)), "^"),
    "online": ((0, (6, 1.5, 1.2, 1.5)), "D"),
    "smoothed": ("-", "o"),
}
"""Line style and marker, by estimator."""

RUN_STYLES: tuple[tuple[Any, str], ...] = tuple(
    STYLES[name] for name in ("smoothed", "ekf", "pdr", "online", "logged_forestback", "logged_pdr")
)
"""The same of runs that are compared, in their order."""


def color(estimator: str) -> Shade:
    """Of an estimator, red, green, blue from 0 to 1."""
    return _shade(COLORS[estimator])


def run_color(number: int) -> Shade:
    """Of a run that is compared with others, by its place among them."""
    return _shade(RUN_COLORS[number])


def _shade(rgb: tuple[int, int, int]) -> Shade:
    r, g, b = rgb
    return r / 255.0, g / 255.0, b / 255.0
