"""What a figure shows: places, ellipses, curves and names where they belong."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from support.by_hand import way_along
from support.hostile import TEXTS
from support.results_by_hand import hand_log, with_cov
from support.runs_by_hand import hand_run

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.sensor_log import Stream
from fbgraph.plots.drawn import drawn_of, north_of
from fbgraph.plots.style import color, run_color
from fbgraph.plots.walk_figure import walk_figure, write_figure
from fbgraph.run.evaluation import NamedRun
from fbgraph.run.named_runs import named_runs

EL = with_cov(way_along((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), t0_s=1.0), 0.3, 0.6)
EL = replace(EL, z_m=np.linspace(0.0, 3.0, len(EL)), sigma_z_m=np.full(len(EL), 0.5))
EKF = way_along((0.0, 0.0), (10.0, 0.0), (20.0, 0.0), t0_s=1.0)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[NamedRun]:
    """A corner that truth, 100 m East of it, has 2 m shorter; and the same without truth, turned about."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "truth.csv").write_text("t_s,x_m,y_m\n1001,100,0\n1011,110,0\n1021,110,8\n")
    first = named_runs([hand_run(folder / "corner", EL, EKF)], [folder / "truth.csv"])
    return first + named_runs([hand_run(folder / "back", EL.turned(math.pi))])


def line(figure: Figure, panel: int, shade: Any) -> Any:
    """The longest curve of this colour."""
    lines: list[Any] = [one for one in figure.axes[panel].get_lines() if one.get_color() == shade]
    return max(lines, key=lambda one: len(one.get_xdata()))


def test_the_map_shows_walk_truth_and_two_sigma(runs: list[NamedRun]) -> None:
    figure = walk_figure(runs[:1])
    drawn = line(figure, 0, color("smoothed"))
    assert np.column_stack(drawn.get_data()) == pytest.approx(EL.xy_m, abs=1e-5)
    assert np.column_stack(line(figure, 0, color("ekf")).get_data()) == pytest.approx(EKF.xy_m, abs=1e-5)
    places = next(one for one in figure.axes[0].get_lines() if one.get_marker() == "x")
    assert np.column_stack(places.get_data()) == pytest.approx(np.array([[0, 0], [10, 0], [10, 8]]))
    (ellipses,) = (one for one in figure.axes[0].collections if isinstance(one, EllipseCollection))
    assert ellipses._widths * 2 == pytest.approx(2.4)  # type: ignore[attr-defined]  # two sigma either way
    assert ellipses._heights * 2 == pytest.approx(1.2)  # type: ignore[attr-defined]
    assert np.abs(np.degrees(ellipses._angles)) == pytest.approx(90.0)  # type: ignore[attr-defined]
    assert ellipses.get_offsets()[0] == pytest.approx(EL.xy_m[-1])  # type: ignore[index]


@pytest.mark.parametrize("width_in", [3.5, 7.0])
def test_a_metre_is_a_metre_in_both_directions_and_on_the_scale(runs: list[NamedRun], width_in: float) -> None:
    figure = walk_figure(runs, width_in=width_in)
    figure.draw_without_rendering()
    panel = figure.axes[0]
    (x0, x1), (y0, y1), box = panel.get_xlim(), panel.get_ylim(), panel.get_window_extent()
    assert box.width / (x1 - x0) == pytest.approx(box.height / (y1 - y0), rel=1e-3)
    assert figure.get_figwidth() == width_in
    told = next(text.get_text() for text in panel.texts if text.get_text().endswith(" m"))
    bar = next(one for one in panel.get_lines() if one.get_transform() == panel.transAxes)
    assert np.ptp(bar.get_xdata()) * (x1 - x0) == pytest.approx(float(told.removesuffix(" m")), rel=1e-6)
    for text in figure.findobj(lambda one: hasattr(one, "get_fontsize")):
        assert text.get_fontsize() >= 7.0  # type: ignore[attr-defined]


def test_curves_are_errors_headings_and_altitudes_over_distance(runs: list[NamedRun]) -> None:
    figure = walk_figure(runs[:1])
    error = line(figure, 1, color("smoothed"))
    assert error.get_xdata() == pytest.approx([10.0, 20.0], abs=1e-4)
    assert error.get_ydata() == pytest.approx([0.0, 2.0], abs=1e-4)
    heading = line(figure, 2, color("smoothed"))
    degrees = np.mod(heading.get_ydata(), 360.0)
    assert degrees[:20] == pytest.approx(90.0, abs=1e-3)  # East, then North
    assert np.mod(degrees[22:] + 180.0, 360.0) == pytest.approx(180.0, abs=1e-3)
    labels = {
        tick: text.get_text()
        for tick, text in zip(figure.axes[2].get_yticks(), figure.axes[2].get_yticklabels(), strict=True)
    }
    assert {round(tick) % 360: name for tick, name in labels.items()} == {0: "N", 90: "E", 180: "S", 270: "W"}
    altitude = line(figure, 3, color("smoothed"))
    assert altitude.get_ydata() == pytest.approx(EL.z_m, abs=1e-5)
    assert [panel.get_ylabel() for panel in figure.axes[1:]] == ["error (m)", "heading", "altitude (m)"]
    true_legs: list[Any] = [one.get_ydata() for one in figure.axes[2].get_lines() if one.get_color() == "black"]
    assert np.mod(np.mean(true_legs, axis=1), 360.0) == pytest.approx([90.0, 0.0])


def test_several_runs_have_a_colour_each_and_truth_only_where_it_is_known(runs: list[NamedRun]) -> None:
    drawn = drawn_of(runs)
    assert [(one.label, one.color, len(one.error_m)) for one in drawn] == [
        ("corner", run_color(0), 2),
        ("back", run_color(1), 0),
    ]
    assert len({one.line for one in drawn}) == 2
    assert [one.label for one in drawn_of(runs, ["smoothed", "ekf"])][1] == "corner, EKF"
    with pytest.raises(ConfigError, match="6 can be told apart"):
        drawn_of(runs * 2, ["smoothed", "ekf"])
    with pytest.raises(DataError, match="no pdr trajectory"):
        drawn_of(runs, ["pdr"])


def test_north_is_drawn_only_where_something_knows_it(runs: list[NamedRun], tmp_path: Path) -> None:
    none = Stream(np.empty(0), np.empty((0, 3)))
    bare = named_runs(
        [hand_run(tmp_path / "bare", EL, log=hand_log(mag=none, pressure=Stream(np.empty(0), np.empty((0, 1)))))]
    )
    assert [north_of(run.saved) for run in (*runs, *bare)] == ["magnetic", "magnetic", ""]
    known = replace(runs[0].saved, summary=runs[0].saved.summary | {"declination": {"deg": 3.0, "text": ""}})
    assert north_of(known) == "true"
    assert north_of(replace(known, summary=known.summary | {"anchors": 3})) == ""  # their frame may be any
    figure = walk_figure(bare)
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("x (m)", "y (m)")
    assert not any("N" in text.get_text() for text in figure.axes[0].texts)
    assert [panel.get_ylabel() for panel in figure.axes[1:]] == ["2σ (m)", "direction"]  # no barometer, no altitude
    assert "magnetic N" in [text.get_text() for text in walk_figure(runs).axes[0].texts]


@pytest.mark.parametrize(
    ("ending", "begins", "ends"),
    [
        ("png", b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"),
        ("pdf", b"%PDF-1.", b"%%EOF\n"),
        ("SVG", b"<?xml", b"</svg>\n"),
    ],
    ids=["png", "pdf", "svg"],
)
def test_files_are_whole_and_the_same_again(
    runs: list[NamedRun], tmp_path: Path, ending: str, begins: bytes, ends: bytes
) -> None:
    written = []
    for name in ("a", "b"):
        write_figure(runs[:1], tmp_path / f"{name}.{ending}", width_in=3.5)
        written.append((tmp_path / f"{name}.{ending}").read_bytes())
    assert written[0].startswith(begins)
    assert written[0].endswith(ends)
    clips = re.compile(rb"\bp[0-9a-f]{10}\b")  # Matplotlib names them in an SVG by what was freed before
    assert clips.sub(b"", written[0]) == clips.sub(b"", written[1])
    if ending == "pdf":
        assert b"/Type3" not in written[0]
        assert b"/FontFile2" in written[0]
    if ending == "SVG":
        assert ">East (m)</text>" in written[0].decode()


@pytest.mark.filterwarnings("ignore:Glyph")
def test_names_are_shown_whatever_they_would_do(runs: list[NamedRun], tmp_path: Path) -> None:
    names = ["_hidden", "$\\frac{", *TEXTS]
    for pair in zip(names[::2], [*names[1::2], "last"], strict=False):
        called = [replace(run, name=name) for run, name in zip(runs, pair, strict=True)]
        labels = [one.label for one in drawn_of(called)]
        assert all(label.isprintable() and len(label) <= 32 for label in labels)
    called = [replace(run, name=name) for run, name in zip(runs, ("_$x^2$", "<b>&</b>"), strict=True)]
    write_figure(called, tmp_path / "a.svg")
    shown = re.findall(r">([^<]+)</text>", (tmp_path / "a.svg").read_text("utf-8"))
    assert {"_$x^2$", "&lt;b&gt;&amp;&lt;/b&gt;"} <= set(shown)
