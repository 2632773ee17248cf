"""A figure of one run or of several compared: map, error, heading and altitude, fit for a column or a page."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fbgraph.core.errors import ConfigError
from fbgraph.core.whole_writes import whole_file
from fbgraph.plots.curves import draw_altitudes, draw_errors, draw_headings
from fbgraph.plots.drawn import Drawn, distinct_truths, drawn_of, north_of
from fbgraph.plots.map_panel import draw_map, extent_m, finish_map, is_dense
from fbgraph.plots.style import PAPER, TRUTH
from fbgraph.run.evaluation import NamedRun
from fbgraph.run.named_runs import named_runs

FORMATS: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Creator": "fbgraph", "Producer": None},
    ".svg": {"Date": None, "Creator": "fbgraph"},
}
"""What can be written, by the file's ending, and what its metadata say: nothing that changes from day to day."""
NARROWEST_IN, WIDEST_IN = 2.5, 20.0
_BESIDE_IN = 5.0  # from this width on curves stand beside the map, else below it
_DPI = 300
_CURVE_IN = 1.15
_SMALL: Any = {
    **{"font.size": 8.0, "axes.labelsize": 8.0, "xtick.labelsize": 7.0, "ytick.labelsize": 7.0, "legend.fontsize": 7.0},
    **{"axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "axes.unicode_minus": True},
    **{"xtick.major.size": 2.5, "ytick.major.size": 2.5, "axes.labelpad": 2.0, "xtick.major.pad": 2.0},
}


def require_figure(path: Path) -> None:
    """Refuse a name that says no format.

    Raises:
        ConfigError: it ends otherwise.
    """
    if path.suffix.lower() not in FORMATS:
        raise ConfigError(f"--out {path}: expected a name that ends with {', '.join(FORMATS)}")


def write_figure(runs: Sequence[NamedRun], path: Path, estimators: Sequence[str] = (), width_in: float = 7.0) -> None:
    """Draw runs into one figure and write it.

    Args:
        runs: one, or several to compare.
        path: PNG, PDF or SVG, by its ending.
        estimators: to draw; as ``drawn_of`` chooses if none.
        width_in: inches; 3.5 is a column of most journals, 7 a page. Letters are as large on either.

    Raises:
        ConfigError: nothing of the kind can be drawn or written.
        DataError: truth of another log, or an estimator that a run does not have.
    """
    require_figure(path)
    ending = path.suffix.lower()
    with mpl.rc_context(PAPER | _SMALL), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # letters that the font lacks are drawn as boxes
        figure = walk_figure(runs, estimators, width_in)
        with whole_file(path) as partial, open(partial, "wb") as out:
            figure.savefig(out, format=ending[1:], metadata=FORMATS[ending])


def run_png(folder: Path, width_in: float = 7.0) -> bytes:
    """The figure of one run folder as a PNG; without truth where that is no longer there.

    Raises:
        DataError: a damaged run.
    """
    with TemporaryDirectory(prefix="fbgraph-") as scratch:
        path = Path(scratch) / "walk.png"
        write_figure(named_runs([folder], lost_is_unknown=True), path, (), width_in)
        return path.read_bytes()


def walk_figure(runs: Sequence[NamedRun], estimators: Sequence[str] = (), width_in: float = 7.0) -> Figure:
    """The figure; arguments and errors as in ``write_figure``, whose style must be set."""
    drawn = drawn_of(runs, estimators)
    norths = {north_of(run.saved, name) for run in runs for name in estimators or ("smoothed",)}
    north = norths.pop() if len(norths) == 1 else ""
    high = any(one.height for one in drawn)
    figure, map_axes, curves = _panels(drawn, width_in, 2 + high)
    draw_map(map_axes, drawn)
    map_axes.set_xlabel("East (m)" if north else "x (m)")
    map_axes.set_ylabel("North (m)" if north else "y (m)")
    draw_errors(curves[0], drawn)
    draw_headings(curves[1], drawn, north)
    if high:
        draw_altitudes(curves[2], drawn)
    for panel in curves:
        panel.set_xlim(0.0, max(float(one.way.distance_m[-1]) for one in drawn))
        panel.grid(axis="y", lw=0.4, color="#dddddd")
        panel.set_axisbelow(True)
        panel.tick_params(labelbottom=panel is curves[-1])
    curves[-1].set_xlabel("distance walked (m)")
    figure.align_ylabels(curves if width_in >= _BESIDE_IN else [map_axes, *curves])
    _legend(figure, drawn, width_in)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # it stands
    finish_map(map_axes, drawn, north)
    return figure


def _panels(drawn: Sequence[Drawn], width_in: float, count: int) -> tuple[Figure, Any, list[Any]]:
    """An empty figure with its map and its curves, as high as the walk asks for within bounds."""
    across_m, up_m = extent_m(drawn)
    beside = width_in >= _BESIDE_IN
    map_in = width_in * (0.5 if beside else 0.86) * float(min(max(up_m / across_m, 0.35), 1.0))
    curves_in = _CURVE_IN * count
    height_in = 0.75 + (max(map_in, curves_in) if beside else map_in + curves_in)
    figure = Figure(figsize=(width_in, height_in), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    if beside:
        grid = figure.add_gridspec(count, 2, width_ratios=(1.1, 1.0))
        map_axes = figure.add_subplot(grid[:, 0])
        curves = [figure.add_subplot(grid[k, 1]) for k in range(count)]
    else:
        grid = figure.add_gridspec(count + 1, 1, height_ratios=(map_in, *(_CURVE_IN,) * count))
        map_axes = figure.add_subplot(grid[0, 0])
        curves = [figure.add_subplot(grid[k + 1, 0]) for k in range(count)]
    return figure, map_axes, curves


def _legend(figure: Figure, drawn: Sequence[Drawn], width_in: float) -> None:
    handles: list[Any] = [
        Line2D([], [], color=one.color, ls=one.line, marker=one.marker, ms=4.0, mec="black", mew=0.4, lw=1.4)
        for one in drawn
    ]
    names = [one.label for one in drawn]
    truths = distinct_truths(drawn)
    if truths:
        line = any(map(is_dense, truths))
        handles.append(Line2D([], [], color=TRUTH, lw=0.8, ls="-" if line else "", marker="" if line else "x", ms=4.0))
        names.append("truth")
    handles.append(Line2D([], [], ls="", marker="o", mfc="white", mec="black", ms=5.0))
    names.append("start")
    if any(one.main and one.way.cov_xy_yaw is not None for one in drawn):
        tint = drawn[0].color if sum(one.main for one in drawn) == 1 else (0.5, 0.5, 0.5)
        handles.append(Patch(facecolor=(*tint, 0.15), edgecolor=tint, lw=0.7))
        names.append("2σ")
    longest = max(map(len, names))
    columns = max(1, min(len(names), int(72.0 * width_in / (4.2 * longest + 34.0))))
    legend = figure.legend(
        handles, ["x" * len(name) for name in names], loc="outside upper center", ncols=columns, frameon=False,
        handlelength=3.4, columnspacing=1.2, borderaxespad=0.1, labelspacing=0.3,
    )  # fmt: skip
    for text, name in zip(legend.get_texts(), names, strict=True):  # as it is: no formula, and none hidden for its "_"
        text.set_parse_math(False)
        text.set_text(name)
