"""The paper's figures, all methods side by side; no state but what is passed.

Sized for a page's width, legible in grey: every method has a colour, a line style and a marker (``plots.style``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from scipy import stats

from fbgraph.core.geometry import FloatArray
from fbgraph.core.safe_text import for_terminal, short_name
from fbgraph.plots.style import PAPER, STYLES, TRUTH, color
from fbgraph.study.course import OBSTACLE_M
from fbgraph.study.protocol import LABELS, StudyResult, TrialResult

_DPI = 180
_WIDTH_IN = 7.2
_TEXT: Any = {"font.size": 10, "axes.titlesize": 10.5, "axes.labelsize": 10, "legend.fontsize": 9.5}
_ERROR_MAP = "cividis_r"  # even in grey and for the colour-blind: darker is worse
_CELL_M = 0.3
_MOST_LABEL = 24  # characters of a checkpoint's name
_SECTORS = 24


def draw(result: StudyResult) -> dict[str, tuple[bytes, str]]:
    """All figures: PNG and caption, by name.

    A caption of simulated trials says so, as does the picture.
    """
    drawers: dict[str, Callable[[StudyResult], tuple[Figure, str]]] = {
        "trajectory": _trajectory,
        "heatmap": _heatmap,
        "progress": _progress,
        "rmse": _rmse,
        "heading": _heading,
    }
    pictures = {}
    with mpl.rc_context({**PAPER, **_TEXT}):
        for name, drawer in drawers.items():
            figure, caption = drawer(result)
            if result.simulated:
                figure.suptitle("SIMULATED trials, no real walk", fontsize=10, color="#a33b00", fontweight="bold")
                caption = f"Simulated trials. {caption}"
            png = BytesIO()
            figure.savefig(png, format="png", bbox_inches="tight", pad_inches=0.08, metadata={"Software": None})
            pictures[name] = (png.getvalue(), caption)
    return pictures


def representative(result: StudyResult) -> TrialResult:
    """The trial whose RMSEs are, relatively, nearest to the medians of all methods."""
    table = np.array([[trial.methods[name].rmse_m for name in result.drawn] for trial in result.trials])
    off = ((table / np.median(table, axis=0) - 1.0) ** 2).sum(axis=1)
    return result.trials[int(np.argmin(off))]


def _grid(count: int, height_in: float, **kw: Any) -> tuple[Figure, list[Any]]:
    """A panel a method, two in a row; no panel is left empty."""
    rows = (count + 1) // 2
    figure = Figure(figsize=(_WIDTH_IN, height_in * rows + 0.7), dpi=_DPI, layout="compressed")
    panels = figure.subplots(rows, 2, squeeze=False, **kw).ravel().tolist()
    for spare in panels[count:]:
        spare.remove()
    return figure, panels[:count]


def _one(height_in: float) -> tuple[Figure, Any]:
    figure = Figure(figsize=(_WIDTH_IN, height_in), dpi=_DPI, layout="constrained")
    return figure, figure.subplots()


def _checkpoint_places(trial: TrialResult, names: Sequence[str]) -> list[tuple[str, float, float]]:
    """Where the truth passes each checkpoint."""
    times = trial.trial.checkpoint_s
    if len(times) != len(names):
        truth = trial.trial.truth.t_s
        times = np.concatenate((truth[:1], trial.reference.t_s, truth[-1:]))
    if len(times) != len(names):
        return []
    truth_path = trial.trial.truth
    x, y = (np.interp(times, truth_path.t_s, axis) for axis in (truth_path.x_m, truth_path.y_m))
    return list(zip(names, x.tolist(), y.tolist(), strict=True))


def _scene(panel: Any, result: StudyResult, trial: TrialResult) -> None:
    """Obstacle, ground truth and checkpoints."""
    if result.simulated:
        x0, y0, x1, y1 = OBSTACLE_M
        panel.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor="#e8e8e8", edgecolor="#777777", hatch="///"))
    truth = trial.trial.truth
    panel.plot(truth.x_m, truth.y_m, color=TRUTH, lw=1.3, zorder=3, label="ground truth")
    middle = truth.xy_m.mean(axis=0)
    for name, x, y in _checkpoint_places(trial, list(result.checkpoints)):
        outward = np.array([x, y]) - middle
        panel.plot(x, y, marker="o", ms=4, color=TRUTH, zorder=6)
        panel.annotate(
            for_terminal(name, _MOST_LABEL),
            (x, y),
            xytext=11.0 * outward / max(float(np.hypot(*outward)), 1e-9),
            textcoords="offset points",
            ha="center",
            va="center",
            fontweight="bold",
            parse_math=False,
            zorder=9,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )
    panel.use_sticky_edges = False
    panel.margins(0.12)
    panel.set_aspect("equal", adjustable="box")
    panel.set_xlabel("x, East (m)")
    panel.set_ylabel("y, North (m)")


def _trajectory(result: StudyResult) -> tuple[Figure, str]:
    trial = representative(result)
    methods = result.drawn
    figure, panels = _grid(len(methods), 2.35, sharex=True, sharey=True)
    worst = max(trial.methods[name].max_m for name in methods)
    scale = Normalize(0.0, worst)
    for panel, name in zip(panels, methods, strict=True):
        method = trial.methods[name]
        _scene(panel, result, trial)
        strip = np.stack((method.xy_m[:-1], method.xy_m[1:]), axis=1)
        panel.add_collection(LineCollection(list(strip), colors=[color(name)], linewidths=6.5, zorder=4, alpha=0.45))
        colored = LineCollection(list(strip), cmap=_ERROR_MAP, norm=scale, linewidths=2.8, zorder=5)
        colored.set_array(method.error_m[1:])
        panel.add_collection(colored)
        panel.plot(*method.xy_m[-1], marker=STYLES[name][1], ms=8, color=color(name), mec="black", zorder=8)
        panel.autoscale_view()
        panel.set_title(f"{LABELS[name]}\nRMSE {method.rmse_m:.2f} m, final {method.final_m:.2f} m")
    for panel in panels:
        panel.label_outer()
    bar = figure.colorbar(panels[0].collections[1], ax=panels, shrink=0.8, pad=0.02)
    bar.set_label("position error (m)")
    name = short_name(trial.trial.name)
    caption = (
        f"Trajectory of a representative trial ({name}: its RMSEs are nearest to the methods' medians). "
        "Black: ground truth with its checkpoints; coloured: the estimate by its position error, its end marked."
    )
    return figure, caption


def _heatmap(result: StudyResult) -> tuple[Figure, str]:
    methods = result.drawn
    figure, panels = _grid(len(methods), 2.1, sharex=True, sharey=True)
    places = np.concatenate([trial.trial.truth.xy_m for trial in result.trials])
    low, high = places.min(axis=0) - _CELL_M, places.max(axis=0) + _CELL_M
    edges = [np.arange(low[axis], high[axis] + _CELL_M, _CELL_M) for axis in (0, 1)]
    maps = {}
    for name in methods:
        errors = np.concatenate([trial.methods[name].error_m for trial in result.trials])
        maps[name] = stats.binned_statistic_2d(places[:, 0], places[:, 1], errors, "mean", bins=edges).statistic
    worst = max(float(np.nanmax(values)) for values in maps.values())
    for panel, name in zip(panels, methods, strict=True):
        image = panel.pcolormesh(edges[0], edges[1], maps[name].T, cmap=_ERROR_MAP, vmin=0.0, vmax=worst, zorder=2)
        _scene(panel, result, representative(result))
        panel.set_title(
            f"{LABELS[name]}: mean {np.mean([trial.methods[name].mean_m for trial in result.trials]):.2f} m"
        )
    for panel in panels:
        panel.label_outer()
    figure.colorbar(image, ax=panels, shrink=0.8, pad=0.02).set_label("mean position error (m)")
    caption = (
        f"Mean position error by where the person really was, over {len(result.trials)} trials, cells of "
        f"{100 * _CELL_M:.0f} cm. Black: the ground truth of {short_name(representative(result).trial.name)}."
    )
    return figure, caption


def _progress(result: StudyResult) -> tuple[Figure, str]:
    figure, panel = _one(4.2)
    grid = np.linspace(0.0, 1.0, 101)
    for name in result.drawn:
        curves = np.array([_over_progress(trial, name, grid) for trial in result.trials])
        mean = curves.mean(axis=0)
        line, marker = STYLES[name]
        panel.plot(
            grid, mean, color=color(name), ls=line, lw=2.2, marker=marker, markevery=10, ms=6, mec="black", mew=0.5,
            label=LABELS[name],
        )  # fmt: skip
        if len(curves) > 2:
            half = stats.t.ppf(0.975, len(curves) - 1) * curves.std(axis=0, ddof=1) / np.sqrt(len(curves))
            panel.fill_between(grid, mean - half, mean + half, color=color(name), alpha=0.13, lw=0)
    panel.set_xlim(0.0, 1.0)
    panel.set_ylim(bottom=0.0)
    for label, at in result.checkpoints.items():
        panel.axvline(at, color="#555555", ls="--", lw=0.9, zorder=1)
        panel.annotate(for_terminal(label, _MOST_LABEL), (at, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
                       textcoords="offset points", ha="center", fontweight="bold", parse_math=False)  # fmt: skip
    panel.set_xlabel("share of the route walked")
    panel.set_ylabel("mean position error (m)")
    panel.legend(loc="upper left", framealpha=0.9, handlelength=4.0)
    return figure, (
        f"Error along the route, mean of {len(result.trials)} trials with the 95 % confidence band of the mean. "
        "Dashed: mean place of the checkpoints."
    )


def _over_progress(trial: TrialResult, name: str, grid: FloatArray) -> FloatArray:
    """Errors at these shares of the route; who stands still counts once, at the end of the rest."""
    progress, error = trial.progress, trial.methods[name].error_m
    last = np.append(np.diff(progress) > 0, True)
    return np.asarray(np.interp(grid, progress[last], error[last]))


def _rmse(result: StudyResult) -> tuple[Figure, str]:
    methods = result.drawn
    figure, panel = _one(4.6)
    table = np.array([[trial.methods[name].rmse_m for name in methods] for trial in result.trials])
    at = np.arange(len(methods))
    if len(table) > 2 and (np.ptp(table, axis=0) > 0).all():
        bodies: Any = panel.violinplot(table, positions=at, widths=0.8, showextrema=False)["bodies"]
        for body, name in zip(bodies, methods, strict=True):
            body.set_facecolor(color(name))
            body.set_edgecolor("black")
            body.set_alpha(0.35)
    for row in table:
        panel.plot(at, row, color="#888888", lw=0.6, alpha=0.6, zorder=2)
    panel.boxplot(
        table, positions=at, widths=0.17, showfliers=False, patch_artist=True, zorder=4,
        boxprops={"facecolor": "white"}, medianprops={"color": "black", "lw": 2},
    )  # fmt: skip
    for k, name in enumerate(methods):
        panel.scatter(np.full(len(table), k), table[:, k], s=20, marker=STYLES[name][1], color=color(name),
                      edgecolor="black", linewidth=0.4, zorder=5)  # fmt: skip
    means = table.mean(axis=0)
    panel.set_xticks(at, [f"{LABELS[name]}\nmean {mean:.2f} m" for name, mean in zip(methods, means, strict=True)])
    panel.set_ylabel("RMSE of a trial (m)")
    panel.set_ylim(bottom=0.0)
    return figure, (
        f"RMSE of each of {len(table)} trials: distribution, median and quartiles; grey lines join the same trial."
    )


def _heading(result: StudyResult) -> tuple[Figure, str]:
    methods = [n for n in result.drawn if all(len(trial.methods[n].direction_rad) for trial in result.trials)]
    figure, panels = _grid(len(methods), 3.0, subplot_kw={"projection": "polar"})
    direction, error = (
        {n: np.concatenate([getattr(trial.methods[n], field) for trial in result.trials]) for n in methods}
        for field in ("direction_rad", "heading_error_rad")
    )
    every = np.degrees(np.abs(np.concatenate(list(error.values()))))
    limit = max(10.0, float(np.ceil(np.percentile(every, 97.0) / 10.0) * 10.0))
    centers = 2.0 * np.pi * np.arange(_SECTORS) / _SECTORS
    for panel, name in zip(panels, methods, strict=True):
        degrees = np.degrees(np.abs(error[name]))
        sector = np.round(direction[name] / (2.0 * np.pi / _SECTORS)).astype(int) % _SECTORS
        count = np.bincount(sector, minlength=_SECTORS)
        rms = np.sqrt(np.bincount(sector, degrees**2, minlength=_SECTORS) / np.maximum(count, 1))
        panel.scatter(direction[name], np.minimum(degrees, limit), s=9, marker=STYLES[name][1], color=color(name),
                      alpha=0.6, linewidth=0, zorder=2)  # fmt: skip
        panel.bar(centers, np.minimum(rms, limit), width=2.0 * np.pi / _SECTORS, facecolor="none", edgecolor="black",
                  linewidth=1.0, zorder=3)  # fmt: skip
        panel.set_ylim(0.0, limit)
        panel.set_xticks(np.arange(8) * np.pi / 4.0, ["E", "NE", "N", "NW", "W", "SW", "S", "SE"])
        ticks = np.arange(10.0, limit + 1.0, 10.0)
        panel.set_yticks(ticks, [f"{tick:.0f}°" for tick in ticks], fontsize=9)
        panel.set_rlabel_position(202.5)
        panel.set_title(f"{LABELS[name]}: RMS {np.sqrt((degrees**2).mean()):.1f}°", pad=12)
    return figure, (
        "Heading error by walking direction: each step's absolute error, and outlined the RMS of each 15°. Points "
        f"beyond {limit:.0f}° are drawn at the rim."
    )
