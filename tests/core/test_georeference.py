"""Where on Earth a walk was, and checkpoints that are given there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.georeference import Georeference, parse_origin
from fbgraph.readers.places import read_checkpoints

NUREMBERG = Georeference(49.4613, 11.1110)


def test_there_and_back_again_on_the_globe() -> None:
    places = np.array(((0.0, 0.0), (120.0, -35.0), (-900.0, 400.0)))
    np.testing.assert_allclose(NUREMBERG.local_m(NUREMBERG.geodetic_deg(places)), places, atol=1e-3)
    north = NUREMBERG.moved(0.0, 1000.0)
    assert (north.lat_deg - NUREMBERG.lat_deg) * 111_200 == pytest.approx(1000.0, rel=2e-3)
    assert north.lon_deg == pytest.approx(NUREMBERG.lon_deg, abs=1e-9)
    assert parse_origin("49.4613, 11.1110") == NUREMBERG


@pytest.mark.parametrize("text", ["", "49", "49,11,3", "north,east", "91,0", "0,181", "nan,0"])
def test_an_origin_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="--origin"):
        parse_origin(text)


def test_checkpoints_may_be_in_latitude_and_longitude(tmp_path: Path) -> None:
    places = np.array(((0.0, 0.0), (30.0, 40.0), (-10.0, 5.0)))
    rows = NUREMBERG.geodetic_deg(places)
    lines = [f"{i}.0,{lat:.9f},{lon:.9f}" for i, (lat, lon) in enumerate(rows)]
    path = tmp_path / "truth.csv"
    path.write_text("\n".join(["t_s,lat_deg,lon_deg", *lines]), "utf-8")
    truth = read_checkpoints(path)
    np.testing.assert_allclose(truth.xy_m, places, atol=1e-3)
    assert truth.georeference == Georeference(*rows[0].round(9))
    path.write_text("t_s,lat_deg\n0,49.0\n", "utf-8")
    with pytest.raises(DataError, match=r"no column x_m, y_m .*lat_deg,lon_deg"):
        read_checkpoints(path)


def test_metres_beside_degrees_tell_where_the_frame_lies(tmp_path: Path) -> None:
    lat, lon = NUREMBERG.geodetic_deg(np.array(((5.0, -7.0),)))[0]
    path = tmp_path / "truth.csv"
    path.write_text(f"t_s,x_m,y_m,lat_deg,lon_deg\n0,5,-7,{lat:.9f},{lon:.9f}\n9,6,-7,,\n", "utf-8")
    found = read_checkpoints(path).georeference
    assert found is not None
    np.testing.assert_allclose((found.lat_deg, found.lon_deg), (NUREMBERG.lat_deg, NUREMBERG.lon_deg), atol=1e-7)
