"""The Earth's field by the World Magnetic Model, against the tables that NOAA publishes with it."""

from __future__ import annotations

import math
import os
from datetime import UTC, date, datetime
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.aids import Told
from fbgraph.core.checkpoints import checkpoints
from fbgraph.core.config import Config, dump_toml, load_config
from fbgraph.core.earth_field import declination_text, degrees_text, earth_field, walk_day, with_declination
from fbgraph.core.errors import ConfigError
from fbgraph.core.georeference import Georeference

ANCHORAGE = Georeference(61.2, -149.9)
IN_2022 = datetime(2022, 7, 2, 12, tzinfo=UTC).timestamp()
TABLE = [  # WMM2015v2testvalues, WMM2020testvalues (NOAA), height 0 km: day, latitude, longitude, D, I, F in nT
    (date(2015, 1, 1), 80.0, 0.0, -3.90, 83.03, 54814.0),
    (date(2015, 1, 1), 0.0, 120.0, 0.55, -15.86, 41087.1),
    (date(2015, 1, 1), -80.0, -120.0, 69.81, -72.40, 55526.8),
    (date(2020, 1, 1), 80.0, 0.0, -1.28, 83.14, 55000.1),
    (date(2020, 1, 1), 0.0, 120.0, 0.16, -15.42, 41104.9),
    (date(2020, 1, 1), -80.0, -120.0, 69.36, -72.20, 55120.6),
    (date(2022, 7, 2), 80.0, 0.0, 0.01, 83.19, 55101.7),
    (date(2022, 7, 2), 0.0, 120.0, -0.06, -15.24, 41130.5),
    (date(2022, 7, 2), -80.0, -120.0, 69.13, -72.09, 54912.1),
]


@pytest.mark.parametrize(("day", "lat_deg", "lon_deg", "d_deg", "i_deg", "f_nt"), TABLE)
def test_the_field_is_that_of_the_published_tables(
    day: date, lat_deg: float, lon_deg: float, d_deg: float, i_deg: float, f_nt: float
) -> None:
    field = earth_field(Georeference(lat_deg, lon_deg), day)
    assert field.declination_deg == pytest.approx(d_deg, abs=0.006)
    assert math.degrees(field.dip_rad) == pytest.approx(i_deg, abs=0.006)
    assert field.strength_ut == pytest.approx(f_nt / 1000.0, abs=2e-4)
    assert field.level_ut == pytest.approx(f_nt / 1000.0 * math.cos(math.radians(i_deg)), abs=0.01)
    assert field.covered


def test_the_year_counts_its_days() -> None:
    """At 80° North it turns East by 0.52° a year, so by 0.26° until the second of July."""
    there = Georeference(80.0, 0.0)
    a, b = (earth_field(there, date(2021, month, day)).declination_deg for month, day in ((1, 1), (7, 2)))
    assert b - a == pytest.approx(0.26, abs=0.01)


def test_days_that_no_model_covers_take_the_nearest_and_say_so() -> None:
    early, first = (earth_field(ANCHORAGE, day) for day in (date(2003, 5, 5), date(2010, 1, 1)))
    assert early.declination_deg == first.declination_deg
    assert (early.covered, first.covered, early.model) == (False, True, "WMM-2010")
    late, last = (earth_field(ANCHORAGE, day) for day in (date(2041, 5, 5), date(2029, 12, 31)))
    assert late.declination_deg == pytest.approx(last.declination_deg, abs=0.01)
    assert (late.covered, last.covered, late.model) == (False, True, "WMM-2025")
    assert "the nearest that it covers" in late.text
    assert "nearest" not in last.text


def test_where_the_field_is_all_but_vertical_that_is_said() -> None:
    pole = earth_field(Georeference(86.0, 142.0), date(2026, 1, 1))
    assert pole.level_ut < 0.3
    assert "of little use" in pole.text
    assert "of little use" not in earth_field(ANCHORAGE, date(2026, 1, 1)).text


def test_the_day_is_the_clocks_then_the_files_then_today(tmp_path: Path) -> None:
    file, today = tmp_path / "walk.csv", datetime.now(UTC).date()
    file.touch()
    os.utime(file, (IN_2022, IN_2022))
    assert walk_day(datetime(2024, 2, 29, 23, tzinfo=UTC).timestamp(), file) == date(2024, 2, 29)
    for no_date_s in (5.0, math.nan, -3.0, 946_684_800.0, 4e9):  # since start; unknown; a clock never set; years ahead
        assert walk_day(no_date_s, file) == date(2022, 7, 2)
        assert walk_day(no_date_s, tmp_path / "gone.csv") == walk_day(no_date_s) == today
    os.utime(file, (0, 0))
    assert walk_day(5.0, file) == walk_day(5.0, Path("\x00")) == today


def test_it_is_looked_up_where_the_place_is_known_and_nobody_set_it() -> None:
    asked = load_config("m5stickc")
    assert asked.device.declination_deg is None
    assert with_declination(asked, None, IN_2022) is asked
    assert declination_text(asked) is None
    found = with_declination(asked, ANCHORAGE, IN_2022)
    assert found.device.declination_deg == round(earth_field(ANCHORAGE, date(2022, 7, 2)).declination_deg, 1) == 15.2
    text = "declination 15.2° East at 61.2, -149.9 by the World Magnetic Model (WMM-2020, 2022-07-02)"
    assert declination_text(found) == text
    assert with_declination(found, Georeference(0.0, 0.0), IN_2022) is found
    assert found.model_copy(update={"device": asked.device}) == asked  # and nothing else has changed


@pytest.mark.parametrize("by_hand", [0.0, -3.25])
def test_a_value_set_by_hand_stays(by_hand: float) -> None:
    asked = load_config("m5stickc", [f"device.declination_deg={by_hand}"])
    assert with_declination(asked, ANCHORAGE, IN_2022) is asked
    assert declination_text(asked) == f"declination {degrees_text(by_hand)}, as it was set"


def test_what_was_looked_up_comes_back_from_its_file_and_gives_way_to_a_hand(tmp_path: Path) -> None:
    found, path = with_declination(Config(), ANCHORAGE, IN_2022), tmp_path / "config.toml"
    path.write_text(dump_toml(found), "utf-8")
    assert load_config(str(path)) == found
    assert (
        declination_text(load_config(str(path), ["device.declination_deg=2"])) == "declination 2.0° East, as it was set"
    )
    assert load_config(str(path), ["device.declination_deg=auto"]).device.declination_deg is None
    assert 'declination_deg = "auto"' in dump_toml(Config())
    with pytest.raises(ConfigError, match=r"device\.declination_deg: "):
        load_config(None, ["device.declination_deg=East"])


def test_degrees_are_said_with_their_side() -> None:
    said = {15.06: "15.1° East", -0.04: "0.0° East", 0.0: "0.0° East", -2.55: "2.5° West", -179.96: "180.0° West"}
    assert {degrees: degrees_text(degrees) for degrees in said} == said


def test_the_place_is_the_origins_else_the_anchors_never_the_truths() -> None:
    two = np.array([0.0, 10.0])
    there, nowhere = checkpoints(two, two, two, georeference=ANCHORAGE), checkpoints(two, two, two)
    assert Told(truth=there).place is None
    assert Told(anchors=nowhere).place is None
    of_anchors = Told(anchors=there).place
    assert of_anchors is not None
    assert of_anchors.apart_m(ANCHORAGE) < 0.01
    assert Told(anchors=there, origin=Georeference(1.0, 2.0)).place == Georeference(1.0, 2.0)
