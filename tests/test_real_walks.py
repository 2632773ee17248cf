"""Accuracy on real walks, one configuration, nothing tuned per log: the figures that the README promises."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.aids import Told
from fbgraph.core.building import Building
from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import load_config
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.building_axis import lay_along_axis
from fbgraph.learning import building_of, walk_in_building
from fbgraph.pipeline import reconstruct
from fbgraph.readers import preset, read_log
from fbgraph.run.metrics import score
from fbgraph.run.walk_result import WalkResult
from fbgraph.way_back.records import Closure

FLOORS_M = {0: 0.0, -1: -3.4, -2: -5.5}  # measured in this museum


@dataclass(frozen=True)
class RealWalk:
    """A log with its truth, in seconds since log start, reconstructed."""

    truth: Checkpoints
    trajectories: dict[str, Trajectory]
    closures: tuple[Closure, ...]
    result: WalkResult

    def rmse_m(self, name: str) -> float:
        return score(self.trajectories[name], self.truth).rmse_m

    def along(self, building: Building) -> RealWalk:
        """The same walk, told of its building."""
        known = Told(building=building).aids(0.0)
        laid = lay_along_axis(self.result.smoothed, self.result.track, known, self.result.config.graph)
        return replace(self, trajectories={**self.trajectories, "smoothed": laid.trajectory})


def walk(path: Path, *settings: str, closed_walk: bool = False) -> RealWalk:
    log_file = read_log(path)
    log, truth = log_file.log, log_file.truth
    assert truth is not None
    result = reconstruct(log, load_config(preset(log.format), settings), Told(closed_walk=closed_walk))
    return RealWalk(truth.since(log.t0_s), result.trajectories, result.smoothed.closures, result)


@pytest.fixture(scope="module")
def museum(shared_data: Path) -> dict[str, RealWalk]:
    """All eight walks by name, told nothing."""
    return {path.name: walk(path) for path in sorted((shared_data / "ipin2023").glob("*.gz"))}


def on_one_floor(name: str) -> bool:
    return "Trial51" not in name


def mean_rmse_m(walks: list[RealWalk]) -> dict[str, float]:
    return {name: float(np.mean([w.rmse_m(name) for w in walks])) for name in ("pdr", "ekf", "smoothed")}


def test_museum_unaided(museum: dict[str, RealWalk]) -> None:
    walks = [w for name, w in museum.items() if on_one_floor(name)]
    mean = mean_rmse_m(walks)
    assert len(walks) == 7
    assert mean["ekf"] <= 4.0
    assert mean["smoothed"] <= 1.8
    assert mean["smoothed"] <= 0.85 * mean["ekf"]
    assert mean["ekf"] < mean["pdr"]


def learned(walks: Iterable[RealWalk]) -> Building:
    """What they tell of their building, their truth aside."""
    return building_of([walk_in_building(one.result) for one in walks]).building


def wrong(building: Building, degrees: float) -> Building:
    return Building(axis=building.axis.model_copy(update={"heading_deg": building.axis.heading_deg + degrees}))


def test_museum_along_its_axis(museum: dict[str, RealWalk]) -> None:
    building, walks = learned(museum.values()), [w for name, w in museum.items() if on_one_floor(name)]
    assert building.axis.heading_deg == pytest.approx(70.0, abs=2.0 * building.axis.sigma_deg)
    unaided_m = mean_rmse_m(walks)["smoothed"]
    assert mean_rmse_m([w.along(building) for w in walks])["smoothed"] <= 0.85 * unaided_m
    for degrees in (10.0, -10.0):  # refused by all but those whose compass is off as far
        assert mean_rmse_m([w.along(wrong(building, degrees)) for w in walks])["smoothed"] <= 1.25 * unaided_m
    assert mean_rmse_m([w.along(wrong(building, 45.0)) for w in walks])["smoothed"] == unaided_m


def test_museum_closed(shared_data: Path) -> None:
    paths = [path for path in sorted((shared_data / "ipin2023").glob("*.gz")) if on_one_floor(path.name)]
    assert mean_rmse_m([walk(path, closed_walk=True) for path in paths])["smoothed"] <= 1.8


def test_closures_help_the_smoother_on_ways_back(shared_data: Path, museum: dict[str, RealWalk]) -> None:
    paths = sorted((shared_data / "ipin2023").glob("*.gz"))
    alone = [walk(path, "returning.out_and_back=false") for path in paths]
    assert not any(w.closures for w in alone)
    assert all(w.closures for w in museum.values())
    tied_m, alone_m = (mean_rmse_m(walks)["smoothed"] for walks in (list(museum.values()), alone))
    assert tied_m < 0.95 * alone_m


def test_altitude_on_the_stairs(museum: dict[str, RealWalk]) -> None:
    stairs = museum["TrainingTrial51_repetition02.txt.gz"]
    z_m = stairs.trajectories["smoothed"].at(stairs.truth.t_s)[:, 2]
    off_m = z_m - [FLOORS_M[int(floor)] for floor in stairs.truth.floor]
    assert np.abs(off_m).max() < 1.0


def test_shopping_centre_unaided(shared_data: Path) -> None:
    paths = sorted((shared_data / "indoor-location" / "site1").rglob("*.txt.gz"))
    walks = [walk(path) for path in paths]
    mean = mean_rmse_m(walks)
    assert len(paths) == 80
    assert mean["ekf"] <= 4.8
    assert mean["smoothed"] <= 4.1
    assert mean["smoothed"] <= 0.93 * mean["ekf"]
    building = learned(walks)
    assert building.axis.heading_deg == pytest.approx(10.0, abs=2.0 * building.axis.sigma_deg)
    assert mean_rmse_m([w.along(building) for w in walks])["smoothed"] <= 0.99 * mean["smoothed"]
    for degrees in (10.0, -10.0):
        assert mean_rmse_m([w.along(wrong(building, degrees)) for w in walks])["smoothed"] <= 1.05 * mean["smoothed"]


@pytest.mark.parametrize(
    ("name", "within"),
    [
        ("dan_handheld1", 0.06),
        ("ruixuan_handheld2", 0.06),
        ("dan_body1", 0.06),
        ("hao_body2", 0.06),
        ("dan_bag2", 0.12),
        ("dan_leg1", 0.12),
    ],
)
def test_ways_are_as_long_as_walked_however_the_device_is_carried(shared_data: Path, name: str, within: float) -> None:
    """RIDI: hand, chest strap, bag and pocket. The mount is not known, so only the distance is judged."""
    path = shared_data / "ridi" / f"{name}.csv.gz"
    result = reconstruct(read_log(path).log, load_config("phone"))
    truth = np.genfromtxt(path, delimiter=",", names=True)
    coarse = slice(None, None, 100)
    walked_m = np.hypot(np.diff(truth["pos_x"][coarse]), np.diff(truth["pos_y"][coarse])).sum()
    found_m = result.trajectories["smoothed"].distance_m[-1]
    assert found_m == pytest.approx(walked_m, rel=within)
