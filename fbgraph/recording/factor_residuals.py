"""Residuals and weights of the graph's factors in a recording, as curves and as a table; the solver's iterations."""

from __future__ import annotations

import numpy as np
import rerun as rr

from fbgraph.core.colors import COLORS
from fbgraph.recording.writer import Rgba, RrdWriter
from fbgraph.run.walk_result import WalkResult

_QUIET_SIGMA = 0.01  # residuals that never exceed it are in the table only
_CIRCLE = rr.components.MarkerShape.Circle


def record_residuals(rrd: RrdWriter, result: WalkResult) -> None:
    """Write the residuals and weights by kind of factor, and how the solver got there.

    Args:
        rrd: where to; ``residuals/…`` in standard deviations, ``weights/…`` from 0 to 1, ``solver/…`` and ``graph``.
        result: the walk, as smoothed.
    """
    smoothed = result.smoothed
    for kind in smoothed.residuals:
        t_s, label = smoothed.trajectory.t_s[kind.k], [kind.name.replace("_", " ")]
        if np.abs(kind.whitened).max() > _QUIET_SIGMA:
            entity, color = f"residuals/{kind.name}", _kind_color(kind.name)
            rrd.series(entity, t_s, kind.whitened, label, [color], points=_CIRCLE)
        if kind.weight.min() < 1.0:
            rrd.series(f"weights/{kind.name}", t_s, kind.weight, label, [_kind_color(kind.name)], points=_CIRCLE)
    errors = np.log10(np.maximum(smoothed.errors, 1e-12))
    rrd.fixed("solver/log10_error", rr.BarChart(errors, color=COLORS["smoothed"]))
    rrd.fixed("graph", rr.TextDocument(_graph_markdown(result), media_type=rr.MediaType.MARKDOWN))


def _graph_markdown(result: WalkResult) -> str:
    """What the graph is made of and how it was solved."""
    smoothed = result.smoothed
    lines = [
        "# The factor graph",
        f"{len(smoothed.trajectory)} breadcrumbs, {smoothed.factors} factors.",
        "",
        "A residual is the estimate minus the measurement in standard deviations. RMS up to 1 is what the sigmas "
        "promised (well below it where errors of neighbours go together, as the compass's do), far above 1 is a model "
        "that does not fit. The last column counts factors that the robust loss left less than half their pull.",
        "",
        "| factor | how many | RMS (σ) | worst (σ) | at | below half |",
        "|---|---|---|---|---|---|",
    ]
    for kind in smoothed.residuals:
        worst = int(np.argmax(np.abs(kind.whitened)))
        doubted = int((kind.weight < 0.5).sum())
        at_s = smoothed.trajectory.t_s[kind.k[worst]]
        lines.append(
            f"| {kind.name.replace('_', ' ')} | {len(kind.k)} | {kind.rms:.2f} | {kind.whitened[worst]:+.1f} | "
            f"{at_s:.0f} s | {doubted or '–'} |"
        )
    lines += ["", "# The solver", "", "| iteration | error |", "|---|---|"]
    lines += [f"| {i} | {error:.4g} |" for i, error in enumerate(smoothed.errors)]
    return "\n".join(lines) + "\n"


def _kind_color(name: str) -> Rgba:
    """Of a kind of factor."""
    colors: dict[str, Rgba] = {
        "step_length": (200, 200, 200),
        "step_sideways": (166, 118, 29),
        "heading": COLORS["ekf"],
        "bias_drift": COLORS["online"],
        "compass": COLORS["sensor"],
        "barometer": COLORS["pdr"],
        "climb": COLORS["smoothed"],
        "weather": (102, 194, 165),
        "standing_still": COLORS["truth"],
        "closure": COLORS["closure"],
        "axis": COLORS["return"],
    }
    return colors.get(name, COLORS["anchor"])
