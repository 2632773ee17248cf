"""The figure of a log's sensors."""

from pathlib import Path

import numpy as np

from fbgraph.core.sensor_log import Stream
from fbgraph.plots.sensor_figure import extremes, write_sensor_figure


def test_no_peak_is_lost_when_samples_are_thinned() -> None:
    values = np.zeros(100_000)
    values[[77, 50_001, 99_990]] = (5.0, -7.0, 3.0)
    t_s, drawn = extremes(np.arange(100_000.0), values, 1500)
    assert len(drawn) < 3200
    assert set(drawn.tolist()) == {0.0, 5.0, -7.0, 3.0}
    assert t_s[drawn == -7.0].tolist() == [50_001.0]
    assert (np.diff(t_s) >= 0).all()
    same_t, same = extremes(np.arange(3000.0), values[:3000], 1500)
    assert len(same_t) == len(same) == 3000


def test_a_figure_is_a_picture_of_what_is_there(tmp_path: Path) -> None:
    t_s = np.arange(0.0, 10.0, 0.01)
    stream = Stream(t_s, np.tile([0.0, 0.0, 9.8], (1000, 1)))
    for name, streams in (("one", {"acc": stream}), ("two", {"acc": stream, "mag": stream}), ("none", {})):
        write_sensor_figure(
            streams, [(1.0, 2.0)], [(3.0, 4.0)], np.arange(5.0, 8.0), "a $walk_", tmp_path / f"{name}.png"
        )
    sizes = {path.stem: int.from_bytes(path.read_bytes()[20:24], "big") for path in tmp_path.iterdir()}
    assert all(path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" for path in tmp_path.iterdir())
    assert sizes["two"] > sizes["one"] == sizes["none"]
