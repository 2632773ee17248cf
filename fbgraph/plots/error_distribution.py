"""How the errors of many walks are distributed: for each error, the share of walks that are off by less."""

from __future__ import annotations

import io
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fbgraph.core.geometry import FloatArray
from fbgraph.plots.style import PAPER, color

Curve = tuple[str, FloatArray, str, bool]
"""A label, the errors of walks in metres, the estimator, and whether it is the batch of before."""


def distribution_png(curves: Sequence[Curve], width_in: float = 6.0) -> bytes:
    """Draw the distributions of errors as steps from none to all walks.

    Args:
        curves: of which each has a walk or more.
        width_in: inches.
    """
    with mpl.rc_context(PAPER):
        figure = Figure(figsize=(width_in, 0.5 * width_in), dpi=150, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        for label, errors_m, estimator, before in curves:
            ordered = np.concatenate(([0.0], np.sort(errors_m)))
            share = 100.0 * np.arange(len(ordered)) / len(errors_m)
            axes.step(
                ordered, share, where="post", color=color(estimator), ls=":" if before else "-", lw=1.4, label=label
            )
        axes.set_xlabel("RMSE of a walk (m)")
        axes.set_ylabel("walks below it (%)")
        axes.set_xlim(0.0, max(float(np.quantile(errors_m, 0.98)) for _, errors_m, _, _ in curves) * 1.1 or 1.0)
        axes.set_ylim(0.0, 100.0)
        axes.grid(lw=0.4, color="#dddddd")
        axes.legend(frameon=False, loc="lower right")
        out = io.BytesIO()
        figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()
