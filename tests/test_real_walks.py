"""Accuracy on real walks, one configuration, nothing tuned per log: the figures that the README promises."""

from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.run.metrics import score

FLOORS_M = {0: 0.0, -1: -3.4, -2: -5.5}  # measured in this museum


def mean_rmse_m(paths: list[Path], closed_walk: bool = False) -> dict[str, float]:
    scores: dict[str, list[float]] = {"pdr": [], "ekf": [], "smoothed": []}
    for path in paths:
        log_file = read_log(path)
        assert log_file.truth is not None
        result = reconstruct(log_file.log, load_config(preset(log_file.log.format)), closed_walk=closed_walk)
        for name, values in scores.items():
            values.append(score(result.trajectories[name], log_file.truth, log_file.log.t0_s).rmse_m)
    return {name: float(np.mean(values)) for name, values in scores.items()}


@pytest.fixture(scope="module")
def museum(request: pytest.FixtureRequest) -> list[Path]:
    shared = Path(__file__).parents[1].parent / "shared" / "data"
    if not shared.is_dir():
        pytest.skip("needs ../shared/data")
    return [path for path in sorted((shared / "ipin2023").glob("*.gz")) if "Trial51" not in path.name]


def test_museum_unaided(museum: list[Path]) -> None:
    mean = mean_rmse_m(museum)
    assert len(museum) == 7
    assert mean["ekf"] <= 5.0
    assert mean["smoothed"] <= 3.6
    assert mean["smoothed"] <= 0.85 * mean["ekf"]
    assert mean["ekf"] < mean["pdr"]


def test_museum_closed(museum: list[Path]) -> None:
    assert mean_rmse_m(museum, closed_walk=True)["smoothed"] <= 2.7


def test_shopping_centre_unaided(shared_data: Path) -> None:
    paths = sorted((shared_data / "indoor-location" / "site1").rglob("*.txt.gz"))
    mean = mean_rmse_m(paths)
    assert len(paths) == 80
    assert mean["ekf"] <= 5.4
    assert mean["smoothed"] <= 4.7
    assert mean["smoothed"] <= 0.93 * mean["ekf"]


def test_altitude_on_the_stairs(shared_data: Path) -> None:
    log_file = read_log(shared_data / "ipin2023" / "TrainingTrial51_repetition02.txt.gz")
    assert log_file.truth is not None
    result = reconstruct(log_file.log, load_config("phone"))
    z_m = result.trajectories["smoothed"].at(log_file.truth.t_s - log_file.log.t0_s)[:, 2]
    off_m = z_m - [FLOORS_M[int(floor)] for floor in log_file.truth.floor]
    assert np.abs(off_m).max() < 1.0


@pytest.mark.parametrize("name", ["dan_handheld1", "dan_body1", "hao_body2", "dan_leg1"])
def test_other_ways_of_carrying_still_give_a_walk(shared_data: Path, name: str) -> None:
    """RIDI: hand, chest strap and pocket. The mount is not known, so only the distance is judged."""
    path = shared_data / "ridi" / f"{name}.csv.gz"
    result = reconstruct(read_log(path).log, load_config("phone"))
    truth = np.genfromtxt(path, delimiter=",", names=True)
    coarse = slice(None, None, 100)
    walked_m = np.hypot(np.diff(truth["pos_x"][coarse]), np.diff(truth["pos_y"][coarse])).sum()
    found_m = result.trajectories["smoothed"].distance_m[-1]
    assert found_m == pytest.approx(walked_m, rel=0.35)
