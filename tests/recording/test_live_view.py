"""A walk shown piece by piece while it was walked, against its recording afterwards."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.recordings import chunks_of, column, entities, tabs

from fbgraph.core.config import load_config
from fbgraph.readers import read_log
from fbgraph.recording.blueprint import blueprint
from fbgraph.recording.live_view import LiveView
from fbgraph.recording.recorder import write_recording
from fbgraph.recording.writer import RrdWriter
from fbgraph.run.summary import summarize, summary_markdown
from fbgraph.run.walk_result import WalkResult
from fbgraph.session import replay_log


@pytest.fixture(scope="module")
def live_and_file(device_lines: list[str], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, WalkResult]:
    """One walk, shown piece by piece while it was walked, and recorded afterwards."""
    out = tmp_path_factory.mktemp("live")
    (out / "walk.csv").write_text("".join(device_lines))
    log = read_log(out / "walk.csv").log
    stream = RrdWriter("live")
    view = LiveView(load_config("m5stickc"), rrd=stream)
    result = replay_log(log, load_config("m5stickc"), chunk_s=0.5, view=view)
    stream.save(out / "live.rrd", blueprint(stream.entities))
    write_recording(result, out / "file.rrd", summary_markdown(summarize(result)))
    return out / "live.rrd", out / "file.rrd", result


def test_live_and_file_show_the_same_things_in_the_same_layout(live_and_file: tuple[Path, Path, WalkResult]) -> None:
    live, file, _ = live_and_file
    assert entities(live) == entities(file)
    assert list(tabs(entities(live))) == list(tabs(entities(file)))
    assert "While walking" in tabs(entities(live))


def test_live_and_file_hold_the_same_numbers(live_and_file: tuple[Path, Path, WalkResult]) -> None:
    """Every sample, step and state once, whatever the pieces."""

    live, file = (chunks_of(path) for path in live_and_file[:2])
    for entity in ("sensors/acc", "sensors/mag", "state/altitude_m/barometer", "state/gyro_bias_deg_s/ekf"):
        name = "Scalars:scalars"
        np.testing.assert_allclose(column(live[entity], name), column(file[entity], name), atol=1e-9, err_msg=entity)
    for entity in ("world/online/position", "world/pdr/position", "world/smoothed/position"):
        name = "Points3D:positions"
        np.testing.assert_allclose(column(live[entity], name), column(file[entity], name), atol=1e-6, err_msg=entity)


def test_beliefs_end_where_the_walk_was_and_do_not_disturb_it(live_and_file: tuple[Path, Path, WalkResult]) -> None:
    _, _, result = live_and_file
    online, beliefs = result.trajectories["online"], result.beliefs
    assert len(beliefs) >= (len(online) - 1) // 5 - 1
    for belief in beliefs:
        assert belief.first + len(belief.xy_m) == belief.k + 1
        np.testing.assert_allclose(belief.xy_m[-1], online.xy_m[belief.k], atol=0.05)
    unseen = replay_log(result.log, result.config, chunk_s=0.5, recording=False)
    assert unseen.beliefs == ()
    np.testing.assert_array_equal(unseen.trajectories["online"].xy_m, online.xy_m)
