"""What walks in one building tell of it: its axis under their North, the field, and when they tell nothing."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from support.by_hand import way_along
from support.commands import fbgraph as command
from support.results_by_hand import hand_result

import fbgraph
from fbgraph.core.building import Building
from fbgraph.core.config import Config, DeviceConfig
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.estimators.building_axis import OFFSETS_RAD, Legs
from fbgraph.estimators.learned_axis import votes_of
from fbgraph.learning import WalkInBuilding, building_of, walk_in_building
from fbgraph.simulator.files import write_m5stickc_csv

COUNT = 12


def walks(
    heading_deg: float | None = 20.0, count: int = COUNT, declination_deg: float | None = None
) -> list[WalkInBuilding]:
    """Walks that are off by 4° each, whose votes are from magnetic North."""
    rng = np.random.default_rng(4)
    found = []
    for k in range(count):
        legs = rng.uniform(0.0, 360.0, 5) if heading_deg is None else 90.0 - heading_deg + 90.0 * rng.integers(0, 4, 5)
        yaw_rad = np.radians(legs + rng.normal(0.0, 4.0) + rng.normal(0.0, 4.0, 5))
        votes = votes_of(Legs(yaw_rad, np.full(5, 20.0), np.arange(5)))
        field = 45.0 + (k % 3 - 1) * 2.0, math.radians(65.0 + (k % 2) * 4.0)
        found.append(WalkInBuilding(f"walk{k}", votes, declination_deg, *field))
    return found


def silent(name: str = "silent") -> WalkInBuilding:
    return WalkInBuilding(name, None, None, math.nan, math.nan)


def test_the_axis_and_field_of_a_building() -> None:
    found = building_of(walks())
    axis, field = found.building.axis, found.building.field
    assert (axis.north, axis.declination_deg) == ("magnetic", None)
    assert axis.heading_deg == pytest.approx(20.0, abs=2.0 * axis.sigma_deg)
    assert 0.5 <= axis.sigma_deg < 3.0
    assert found.building.walks == len(found.walks) == COUNT
    assert field is not None
    assert (field.strength_ut, field.dip_deg) == pytest.approx((45.0, 67.0))
    assert (field.sigma_strength_ut, field.sigma_dip_deg) == pytest.approx((1.4826 * 2.0, 1.4826 * 2.0), abs=0.01)
    assert found.notes == ()


def test_walks_that_knew_true_north_tell_an_axis_from_there() -> None:
    known = building_of(walks(declination_deg=4.0)).building.axis
    unknown = building_of(walks()).building.axis
    assert (known.north, known.declination_deg) == ("true", 4.0)
    assert known.heading_deg == pytest.approx(unknown.heading_deg + 4.0, abs=0.01)
    assert known.yaw_rad(None) == pytest.approx(unknown.yaw_rad(None), abs=1e-3)
    some = building_of([*walks(declination_deg=4.0)[:6], *walks()[6:]]).building.axis
    assert (some.north, some.heading_deg) == ("magnetic", unknown.heading_deg)


def test_few_walks_are_believed_if_they_are_clear_and_it_is_said() -> None:
    found = building_of([*walks(count=6), silent()])
    assert found.building.walks == 6
    assert "1 walk(s) without a compass, or that bend most of the way, tell no axis: silent" in found.notes[0]
    assert "from 6 walks the axis is known to" in found.notes[1]


@pytest.mark.parametrize(
    ("of", "says"),
    [
        (walks(heading_deg=None, count=40), "40 walks show no axis: their straight legs lie in all directions"),
        (walks(count=1), "1 walk shows no axis"),
        (walks(count=2), "2 walks show no axis: .* learn it from 10 walks or more"),
        ([silent()], "none of the logs is a walk with a compass"),
        ([], "none of the logs"),
    ],
)
def test_walks_that_show_no_axis_are_refused(of: list[WalkInBuilding], says: str) -> None:
    with pytest.raises(DataError, match=says):
        building_of(of)


def test_a_field_that_hardly_differs_is_known_to_a_microtesla() -> None:
    same = [WalkInBuilding(w.name, w.votes, None, 45.0, math.radians(65.0)) for w in walks()]
    field = building_of(same).building.field
    assert field is not None
    assert (field.sigma_strength_ut, field.sigma_dip_deg) == (1.0, 1.0)
    few = [*same[:2], *(WalkInBuilding(w.name, w.votes, None, math.nan, math.nan) for w in same[2:])]
    assert building_of(few).building.field is None


def test_votes_are_from_magnetic_north_whatever_the_walk_knew() -> None:
    way = way_along((0.0, 0.0), (30.0, 0.0), (30.0, 30.0), t0_s=1.0)
    for declination_deg in (None, 10.0, -10.0):
        device = DeviceConfig(declination_deg=declination_deg)
        steps = {
            "yaw_mag_rad": way.yaw_rad,
            "mag_norm_ut": np.full(len(way), 45.0),
            "mag_dip_rad": np.full(len(way), 1.0),
        }
        told = walk_in_building(hand_result(way, steps=steps, config=Config(device=device)))
        assert told.votes is not None
        yaw_deg = math.degrees(OFFSETS_RAD[int(told.votes.argmax())])
        assert yaw_deg == pytest.approx(
            declination_deg or 0.0, abs=1.0
        )  # a needle that points East sees more of it left
        assert (told.declination_deg, told.strength_ut, told.dip_rad) == (declination_deg, 45.0, 1.0)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Six simulated walks round a block whose streets run North and East."""
    folder = tmp_path_factory.mktemp("walks")
    for seed in range(6):
        write_m5stickc_csv(fbgraph.simulate("square", seed=seed).log, folder / f"{seed}.csv")
    return sorted(folder.iterdir())


def test_a_building_is_learned_and_used(logs: list[Path], tmp_path: Path) -> None:
    (broken := tmp_path / "broken.csv").write_text("no log", "utf-8")
    told = json.loads(command("learn-building", *logs, broken, "--out", tmp_path / "b.toml", "--json").stdout)
    written = tomllib.loads((tmp_path / "b.toml").read_text("utf-8"))
    assert written["axis"]["heading_deg"] == told["axis"]["heading_deg"]
    off_deg = (told["axis"]["heading_deg"] + 45.0) % 90.0 - 45.0
    assert abs(off_deg) < 2.0 * told["axis"]["sigma_deg"] < 10.0
    assert (told["walks"], told["logs"]) == (6, [log.name for log in logs])
    assert any(f"left out: {broken}" in note for note in told["notes"])
    assert (told["field"]["strength_ut"], told["field"]["dip_deg"]) == (
        pytest.approx(45.0, abs=4.0),
        pytest.approx(60.0, abs=4.0),
    )
    learned = fbgraph.learn_building(logs)
    assert Building.model_validate(written) == learned.building
    walk = fbgraph.smooth(logs[0], building=learned.building)
    assert walk.summary["axis"]["used"]
    assert walk.summary["axis"]["sigma_deg"] == told["axis"]["sigma_deg"]


def test_what_shows_no_axis_writes_nothing(logs: list[Path], tmp_path: Path) -> None:
    done = command("learn-building", logs[0], "--out", tmp_path / "b.toml", code=3)
    assert "1 walk shows no axis" in done.stderr
    assert not (tmp_path / "b.toml").exists()
    with pytest.raises(ConfigError, match=r"steps\.lamda"):
        fbgraph.learn_building(logs, overrides=["steps.lamda=1"])
