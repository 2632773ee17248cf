"""How a live walk is read: told while it is open, kept beside its lines, and the same when it is read again."""

from pathlib import Path

import numpy as np

from fbgraph.core.config import load_config
from fbgraph.core.trajectory import Trajectory
from fbgraph.pipeline import write_run
from fbgraph.readers import read_log
from fbgraph.readers.layout import read_layout
from fbgraph.run.folder import claimed_live, require_replaceable
from fbgraph.run.log_again import read_log_again
from fbgraph.run.read_run import read_run
from fbgraph.session import follow_source


def followed(lines: list[str], out: Path, resume: bool = False) -> tuple[Trajectory, list[str]]:
    told: list[str] = []
    pieces = (line.encode() for line in lines)
    with claimed_live(out, resume) as claim:
        config = load_config("m5stickc")
        result = follow_source(pieces, claim.place, config, tell=told.append, resume=resume, recording=False)
        write_run(result, claim, recording=False)
    return result.smoothed.trajectory, told


def test_the_layout_is_told_kept_and_taken_again(device_lines: list[str], tmp_path: Path) -> None:
    """Also by a walk that goes on after a crash, and by ``smooth`` of the lines that are kept."""
    whole, told = followed(device_lines, tmp_path / "whole")
    assert [text.partition(":")[0] for text in told] == ["deciding how to read it", "decided"]
    assert "20 s of walking at most" in told[0]
    assert told[1].startswith("decided: acc ax_g/ay_g/az_g in g; gyro gx_dps/gy_dps/gz_dps in °/s; mag ")
    layout = read_layout(tmp_path / "whole" / "layout.toml")
    assert layout.mag is not None

    out = tmp_path / "parts"
    with claimed_live(out, resume=False) as claim:
        (claim.place / "raw.csv").write_text("".join(device_lines[:2500]) + "12,")
        (claim.place / "config.toml").write_text((tmp_path / "whole" / "config.toml").read_text())
    resumed, told = followed(device_lines[2500:], out, resume=True)
    assert len(told) == 2
    np.testing.assert_array_equal(resumed.xy_m, whole.xy_m)
    assert (out / "layout.toml").read_text() == (tmp_path / "whole" / "layout.toml").read_text()

    again = read_log_again(read_run(out)).log
    file = read_log(out / "raw.csv")
    for name in ("acc", "gyro", "mag", "pressure"):
        np.testing.assert_array_equal(getattr(file.log, name).values, getattr(again, name).values, name)
    assert file.reading is not None
    assert file.reading.layout == layout


def test_a_live_walk_without_a_byte_may_hold_a_layout_and_be_replaced(tmp_path: Path) -> None:
    for name in ("raw.csv", "layout.toml", "config.toml"):
        (tmp_path / name).touch()
    require_replaceable(tmp_path)
