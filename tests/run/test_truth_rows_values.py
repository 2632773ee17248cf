"""``truth.tum``: what evo makes of it is our score."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.by_hand import way_along
from support.evo_figures import evo_ape

from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.tum_files import read_tum, write_tum
from fbgraph.run.metrics import Alignment, score
from fbgraph.run.truth_rows import is_dense, truth_rows, write_truth_tum

# 40 m East, 20 m North, a step a half second; climbing, so that heights would tell in evo's three dimensions
FLAT = way_along((0.0, 0.0), (40.0, 0.0), (40.0, 20.0), t0_s=1_700_000_000.0)
WAY = replace(FLAT, z_m=np.linspace(0.0, 6.0, len(FLAT)))


def told(*rows: tuple[float, float, float]) -> Checkpoints:
    t_s, x_m, y_m = np.array(rows).T
    return checkpoints(t_s + 1_700_000_000.0, x_m, y_m, z_m=np.full(len(rows), 99.0))


TRUTH = told((-3.0, 100.0, 50.0), (10.2, 110.0, 52.0), (10.3, 110.5, 51.0), (30.6, 131.0, 49.0), (90.0, 143.0, 71.0))


def figures(tmp_path: Path, way: Trajectory, truth: Checkpoints, alignment: Alignment) -> tuple[float, float, float]:
    """evo's RMSE, ours, and how many pairs evo found."""
    write_tum(tmp_path / "smoothed.tum", way, 0.0)
    log_s = float(way.t_s[0]) - 5.0, float(way.t_s[-1]) + 50.0
    write_truth_tum(tmp_path / "truth.tum", "smoothed", way, truth, alignment, log_s)
    theirs = evo_ape(tmp_path / "truth.tum", tmp_path / "smoothed.tum")
    ours = score(way, truth, 0.0, alignment, log_s)
    assert theirs["max"] == pytest.approx(ours.max_m, abs=1e-5)
    return theirs["rmse"], ours.rmse_m, theirs["pairs"]


def test_evo_agrees_between_steps_before_the_first_and_after_the_last(tmp_path: Path) -> None:
    theirs, ours, pairs = figures(tmp_path, WAY, TRUTH, "start")
    errors_m = np.hypot([0.2, -0.2, -0.4, -3.0], [-2.0, -1.0, 1.0, -1.0])  # on paper
    assert ours == pytest.approx(np.sqrt((errors_m**2).mean()), abs=1e-6)
    assert theirs == pytest.approx(ours, abs=1e-5)
    assert pairs == 4


def test_an_anchored_walk_is_not_moved_and_scored_at_the_first_place_too(tmp_path: Path) -> None:
    near = replace(TRUTH, x_m=TRUTH.x_m - 100.0, y_m=TRUTH.y_m - 50.0)
    theirs, ours, pairs = figures(tmp_path, WAY, near, "none")
    assert theirs == pytest.approx(ours, abs=1e-5)
    assert pairs == 5


def test_rows_lie_at_steps_in_the_walks_frame() -> None:
    t_s, places_m = truth_rows(WAY, TRUTH, "start", (0.0, 2e9))
    assert t_s - 1_700_000_000.0 == pytest.approx([10.0, 10.5, 30.5, 60.0], abs=3e-6)
    assert places_m[0] == pytest.approx([9.8, 2.0, 1.0])  # truth at 10.2 s, less the 0.2 m walked since 10.0 s
    assert places_m[3] == pytest.approx([43.0, 21.0, WAY.z_m[-1]])


def test_places_of_one_step_stay_apart(tmp_path: Path) -> None:
    crowd = told((0.0, 0.0, 0.0), (10.0, 11.0, 0.0), (10.01, 9.0, 0.0), (10.02, 10.0, 3.0), (20.0, 20.0, 0.0))
    theirs, ours, pairs = figures(tmp_path, WAY, crowd, "start")
    assert theirs == pytest.approx(ours, abs=1e-5)
    assert pairs == 4
    assert (np.diff(read_tum(tmp_path / "truth.tum").t_s) > 0.0).all()


@pytest.mark.parametrize(("extra", "dense"), [(-1, False), (0, True)])
def test_more_places_than_steps_stay_where_they_were(extra: int, dense: bool) -> None:
    t_s = np.linspace(0.1, 59.0, len(WAY) + extra)
    many = checkpoints(t_s + 1_700_000_000.0, t_s, 0.0 * t_s)
    assert is_dense(WAY, many) is dense
    rows_s, places_m = truth_rows(WAY, many, "start")
    assert bool(np.abs(rows_s - many.t_s[1:]).max() < 1e-3) is dense
    if dense:
        assert np.hypot(*(places_m[:, :2] - many.xy_m[1:] - (0.1 - t_s[0], 0.0)).T).max() < 1e-6


def test_its_first_lines_say_what_it_is(tmp_path: Path) -> None:
    write_truth_tum(tmp_path / "truth.tum", "ekf", WAY, TRUTH, "start", (0.0, 2e9))
    text = (tmp_path / "truth.tum").read_text()
    assert text.startswith(
        "# known places in the frame of ekf.tum, which agrees with the first known place; heights are"
    )
    assert (
        "`evo_ape tum truth.tum ekf.tum` gives the score of summary.json\n# t x y z qx qy qz qw\n1700000010.0" in text
    )
    assert text.splitlines()[-1].endswith(" 0 0 0 1")
