"""The sensors of a log against time: where it stood still, where samples are missing, where steps were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from fbgraph.core.geometry import FloatArray
from fbgraph.core.safe_text import short_name
from fbgraph.core.sensor_log import Stream

Spans = Sequence[tuple[float, float]]
_PANELS = {
    "acc": ("|acceleration|\nm/s²", 1.0),
    "gyro": ("|rotation|\n°/s", float(np.degrees(1.0))),
    "mag": ("|field|\nµT", 1.0),
    "pressure": ("pressure\nhPa", 1.0),
}
_WIDTH_IN, _PANEL_IN, _DPI = 9.0, 1.5, 130
_COLUMNS = 1500  # of the picture, about; of more samples each column shows the lowest and the highest


def write_sensor_figure(
    streams: Mapping[str, Stream], still: Spans, gaps: Spans, steps_s: FloatArray, title: str, path: Path
) -> None:
    """Draw as PNG.

    Args:
        streams: ``acc`` m/s², ``gyro`` rad/s, ``mag`` µT, ``pressure`` hPa, as far as they are there; of vectors the
            size is drawn.
        still, gaps: begin and end of each, seconds since log start.
        steps_s: (K,) when steps ended.
        title: name of the log.
        path: the file.

    Raises:
        OSError: it cannot be written.
    """
    there = [name for name in _PANELS if name in streams and len(streams[name])]
    with mpl.rc_context({"axes.spines.top": False, "axes.spines.right": False, "font.size": 9.0}):
        figure = Figure(figsize=(_WIDTH_IN, _PANEL_IN * max(len(there), 1) + 0.9), layout="constrained")
        panels = figure.subplots(max(len(there), 1), 1, sharex=True, squeeze=False)[:, 0]
        for panel, name in zip(panels, there, strict=False):
            label, scale = _PANELS[name]
            _draw(panel, streams[name], scale)
            panel.set_ylabel(label)
            panel.ticklabel_format(axis="y", useOffset=False)  # a pressure is read as it is
            for spans, color in ((still, "tab:green"), (gaps, "tab:red")):
                for start_s, end_s in spans:
                    panel.axvspan(start_s, end_s, color=color, alpha=0.25, linewidth=0)
        top = panels[0]
        top.plot(steps_s, np.full(len(steps_s), 1.0), "|", color="black", transform=top.get_xaxis_transform())
        top.set_title(short_name(title).replace("$", r"\$"), loc="left")
        panels[-1].set_xlabel("seconds since log start; green: still, red: no samples, ticks above: steps")
        data = BytesIO()
        figure.savefig(data, format="png", dpi=_DPI)
    path.write_bytes(data.getvalue())


def _draw(panel: Any, stream: Stream, scale: float) -> None:
    values = stream.values[:, 0] if stream.values.shape[1] == 1 else np.linalg.norm(stream.values, axis=1)
    t_s, drawn = extremes(stream.t_s, values * scale, _COLUMNS)
    panel.plot(t_s, drawn, linewidth=0.6, color="0.25")


def extremes(t_s: FloatArray, values: FloatArray, columns: int) -> tuple[FloatArray, FloatArray]:
    """Of many samples the lowest and the highest of each of so many groups, in order; else all of them."""
    each = len(values) // columns
    if each < 3:
        return t_s, values
    count = len(values) // each
    groups = values[: count * each].reshape(count, each)
    at = np.sort(np.stack((groups.argmin(axis=1), groups.argmax(axis=1)), axis=1), axis=1)
    at = np.append(at + each * np.arange(count)[:, None], np.arange(count * each, len(values)))
    return t_s[at], values[at]
