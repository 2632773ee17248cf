"""What is known of a building: an axis under each North, on the command line and in a file."""

import math
from pathlib import Path

import pytest

from fbgraph.core.aids import Aids, Told, WalkAxis
from fbgraph.core.building import Building, BuildingAxis, BuildingField
from fbgraph.core.building_files import parse_building_axis, read_building, write_building
from fbgraph.core.errors import ConfigError

FIELD = BuildingField(strength_ut=45.0, sigma_strength_ut=3.0, dip_deg=65.0, sigma_dip_deg=2.0)


@pytest.mark.parametrize(
    ("north", "declination_deg", "walks_deg", "heading_deg"),
    [
        ("walk", None, None, 70.0),
        ("walk", None, 4.0, 70.0),  # of the walk's own North, whichever that is
        ("magnetic", None, None, 70.0),
        ("magnetic", None, 4.0, 74.0),  # a needle that points East of North shows too little
        ("true", 4.0, None, 66.0),
        ("true", 4.0, 4.5, 70.0),  # true North does not wander
        ("true", -15.0, None, 85.0),
    ],
)
def test_an_axis_is_seen_under_the_north_of_the_walk(
    north: str, declination_deg: float | None, walks_deg: float | None, heading_deg: float
) -> None:
    axis = BuildingAxis.model_validate({"heading_deg": 70.0, "north": north, "declination_deg": declination_deg})
    assert axis.yaw_rad(walks_deg) == pytest.approx(math.radians(90.0 - heading_deg))


@pytest.mark.parametrize("heading_deg", [20.0, 110.0, 200.0, 290.0, -70.0])
def test_any_corridor_names_the_axis(heading_deg: float) -> None:
    assert BuildingAxis(heading_deg=heading_deg).yaw_rad(None) == pytest.approx(math.radians(70.0))


def test_true_north_comes_with_its_declination() -> None:
    with pytest.raises(ValueError, match="go together"):
        BuildingAxis(heading_deg=70.0, north="true")
    with pytest.raises(ValueError, match="go together"):
        BuildingAxis(heading_deg=70.0, declination_deg=4.0)


def test_an_axis_on_the_command_line() -> None:
    assert parse_building_axis("70").axis == BuildingAxis(heading_deg=70.0, sigma_deg=2.0, north="walk")
    assert parse_building_axis("-20.5,4").axis == BuildingAxis(heading_deg=-20.5, sigma_deg=4.0)


@pytest.mark.parametrize("text", ["", "north", "70,", "70,2,3", "nan", "70,nan", "400", "70,0", "70,21", "1e400"])
def test_what_is_no_axis_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ConfigError, match="--building-axis 70,2"):
        parse_building_axis(text)


@pytest.mark.parametrize("field", [None, FIELD])
def test_a_building_is_read_as_it_was_written(field: BuildingField | None, tmp_path: Path) -> None:
    axis = BuildingAxis(heading_deg=20.5, sigma_deg=1.5, north="true", declination_deg=4.0)
    building = Building(axis=axis, field=field, walks=12)
    write_building(building, tmp_path / "b.toml")
    assert read_building(tmp_path / "b.toml") == building


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "axis: Field required"),
        ("[axis]\nheading = 70", "unknown key 'axis.heading'|axis.heading_deg: Field required"),
        ("[axis]\nheading_deg = 70\nsigma_deg = 0", "axis.sigma_deg"),
        ("[axis]\nheading_deg = nan", "axis.heading_deg"),
        ("[axis", "not TOML"),
        ("\x00", "not TOML"),
    ],
)
def test_what_is_no_building_is_refused_by_its_key(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "b.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(ConfigError, match=says):
        read_building(path)


def test_a_building_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"gone\.toml"):
        read_building(tmp_path / "gone.toml")


def test_an_estimator_gets_the_axis_in_the_frame_of_its_walk() -> None:
    axis = BuildingAxis(heading_deg=70.0, sigma_deg=3.0, north="magnetic")
    told = Told(building=Building(axis=axis, field=FIELD))
    known = told.aids(0.0, 4.0).axis
    assert known == WalkAxis(BuildingAxis(heading_deg=74.0).yaw_rad(None), math.radians(3.0), FIELD)
    assert Told().aids(0.0, 4.0) == Aids()
