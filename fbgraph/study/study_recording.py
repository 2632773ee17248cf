"""A study as a Rerun recording: every trial's trajectories, the trials' RMSE, the figures and the report's summary.

Entities: ``map/{truth,method}/{trial}``, ``rmse_m/{method}`` on the timeline ``trial``,
``figures/{name}``, ``summary``.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fbgraph.core.colors import COLORS
from fbgraph.recording.map_frame import Frame
from fbgraph.recording.writer import RrdWriter, entity_below
from fbgraph.study.protocol import LABELS, StudyResult


def write_study_recording(result: StudyResult, figures: dict[str, bytes], markdown: str, path: Path) -> None:
    """Write the recording, its blueprint inside.

    Args:
        result: the study.
        figures: PNG by name.
        markdown: what the summary says, that the trials are simulated included.
        path: file to write.

    Raises:
        OSError: the file cannot be written.
    """
    content = hashlib.sha1(markdown.encode(), usedforsecurity=False).hexdigest()
    rrd = RrdWriter(f"study-{content[:12]}")
    rrd.fixed("summary", rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN))
    rrd.fixed("map", rr.Transform3D(scale=(1.0, -1.0, 1.0)))  # Rerun's 2-D views have y down
    names = result.drawn
    for trial in result.trials:
        label = entity_below(trial.trial.name)
        rrd.fixed(f"map/truth/{label}", _line(trial.trial.truth.xy_m, "truth", 1.0))
        for name in names:
            rrd.fixed(f"map/{name}/{label}", _line(trial.methods[name].xy_m, name, 1.5))
    numbers = np.arange(1, len(result.trials) + 1)
    for name in names:
        rrd.fixed(f"rmse_m/{name}", rr.SeriesLines(names=LABELS[name], colors=[COLORS[name]], widths=[2.0]))
        rmse = np.array([trial.methods[name].rmse_m for trial in result.trials])
        rrd.numbered(f"rmse_m/{name}", "trial", numbers, rr.Scalars.columns(scalars=rmse))
    for name, png in figures.items():
        rrd.fixed(f"figures/{name}", rr.EncodedImage(contents=png, media_type="image/png"))
    rrd.save(path, _blueprint(result, list(figures)))


def _line(xy_m: np.ndarray, color: str, width: float) -> rr.LineStrips2D:
    return rr.LineStrips2D([xy_m], colors=[COLORS[color]], radii=rr.Radius.ui_points(width))


def _blueprint(result: StudyResult, figures: list[str]) -> rrb.Blueprint:
    """Summary and RMSE first, then a map a method, then the figures."""
    frame = Frame.around(np.concatenate([trial.methods[n].xy_m for trial in result.trials for n in result.drawn]))
    said = " (simulated)" if result.simulated else ""
    maps = [
        rrb.Spatial2DView(
            name=f"{LABELS[name]}{said}",
            origin="/",
            contents=["/map/truth/**", f"/map/{name}/**"],
            visual_bounds=frame.bounds,
        )
        for name in result.drawn
    ]
    pictures = [rrb.Spatial2DView(name=f"{name}{said}", origin=f"/figures/{name}") for name in figures]
    rmse = rrb.TimeSeriesView(name=f"RMSE of each trial [m]{said}", origin="/rmse_m", plot_legend=rrb.Corner2D.RightTop)
    return rrb.Blueprint(
        rrb.Tabs(
            rrb.Horizontal(
                rrb.TextDocumentView(name="Summary", origin="/summary"),
                rmse,
                column_shares=[5, 3],
                name=f"Results{said}",
            ),
            rrb.Grid(*maps, name="All trajectories"),
            rrb.Tabs(*pictures, name="Figures"),
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="trial", play_state="paused"),
    )
