"""The files of a run folder, digit for digit."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.by_hand import way_along
from support.results_by_hand import hand_result

from fbgraph.core.config import Config, GraphConfig, load_config
from fbgraph.core.errors import ConfigError
from fbgraph.core.trajectory import Trajectory
from fbgraph.core.tum_files import read_tum, write_tum
from fbgraph.run.digests import noted_digests
from fbgraph.run.folder import (
    BREADCRUMB_HEADER,
    RETURN_HEADER,
    RUN_FILES,
    require_free,
    write_breadcrumbs,
    write_returns,
    write_tables,
)
from fbgraph.way_back.records import ReturnUpdate

T0_S = 1_574_572_467.5
COV = np.zeros((2, 3, 3))
COV[1] = [[0.09, -0.0123456789, 7.0], [-0.0123456789, 0.16, 7.0], [7.0, 7.0, 0.0025]]
WAY = Trajectory(
    t_s=np.array([0.25, 0.75]),
    x_m=np.array([0.0, 1.23456789]),
    y_m=np.array([0.0, -2.0]),
    z_m=np.array([0.0, 0.5]),
    yaw_rad=np.array([0.1, math.pi / 2]),
    gyro_bias_rad_s=np.array([0.0, 0.0012345678912]),
    cov_xy_yaw=COV,
    sigma_z_m=np.array([0.0, 0.7]),
)
UPDATES = (
    ReturnUpdate(
        70.0, 141, 60, 30.5, 41.23456, 40.98765, -0.1234, 3.2, -1.0, 0.3, False, False, "turn right 90° in 3 m"
    ),
    ReturnUpdate(
        70.5, 142, 59, 30.0, 40.5, 40.5, 6.0, None, None, 0.3, True, False, "off route: the route is 6 m ahead"
    ),
)


def test_breadcrumbs_have_a_row_each(tmp_path: Path) -> None:
    write_breadcrumbs(tmp_path / "b.csv", WAY, T0_S)
    header, first, second = (tmp_path / "b.csv").read_text().splitlines()
    assert header == BREADCRUMB_HEADER
    assert first == (
        "0,1574572467.750000,0.000000,0.000000,0.000000,0.100000,0.000000000,"
        "0.000000,0.000000,0.000000,0.000000,0.000000"
    )
    assert second == (
        "1,1574572468.250000,1.234568,-2.000000,0.500000,1.570796,0.001234568,"
        "0.300000,0.400000,-0.012346,0.700000,0.050000"
    )


def test_columns_are_named_in_their_order() -> None:
    assert BREADCRUMB_HEADER == (
        "k,t_s,x_m,y_m,z_m,yaw_rad,gyro_bias_rad_s,sigma_x_m,sigma_y_m,cov_xy_m2,sigma_z_m,sigma_yaw_rad"
    )
    assert RETURN_HEADER == "t_s,breadcrumb,breadcrumb_t_s,route_m,remaining_m,cross_track_m,instruction,off_route"


def test_what_an_estimator_does_not_say_is_nan(tmp_path: Path) -> None:
    write_breadcrumbs(tmp_path / "b.csv", replace(WAY, cov_xy_yaw=None, sigma_z_m=None), 0.0)
    assert (tmp_path / "b.csv").read_text().splitlines()[2].split(",")[-5:] == ["nan"] * 5


def test_the_way_back_has_a_row_a_step(tmp_path: Path) -> None:
    write_returns(tmp_path / "r.csv", UPDATES, T0_S)
    assert (tmp_path / "r.csv").read_bytes().decode() == (
        RETURN_HEADER + "\n"
        '1574572537.500000,60,1574572498.000000,41.235,40.988,-0.123,"turn right 90° in 3 m",false\n'
        '1574572538.000000,59,1574572497.500000,40.500,40.500,6.000,"off route: the route is 6 m ahead",true\n'
    )


def test_tum_turns_about_the_vertical(tmp_path: Path) -> None:
    write_tum(tmp_path / "w.tum", WAY, T0_S)
    assert (tmp_path / "w.tum").read_text().splitlines()[1] == (
        "1574572468.250000 1.234568 -2.000000 0.500000 0.000000000 0.000000000 0.707106781 0.707106781"
    )
    back = read_tum(tmp_path / "w.tum", T0_S)
    assert back.t_s == pytest.approx([0.25, 0.75])
    assert back.yaw_rad == pytest.approx([0.1, math.pi / 2])
    assert (back.x_m[1], back.y_m[1], back.z_m[1]) == pytest.approx((1.234568, -2.0, 0.5))


def test_a_run_holds_these_files(tmp_path: Path) -> None:
    way = way_along((0.0, 0.0), (25.0, 0.0), t0_s=1.0)
    ekf = replace(way, y_m=way.y_m + 3.0)
    result = hand_result(way, ekf, config=Config(graph=GraphConfig(sigma_mag_rad=0.123)), returning=UPDATES)
    write_tables(result, tmp_path, {"steps": 50})
    expected = {"pdr.tum", "ekf.tum", "smoothed.tum", "breadcrumbs.csv", "return.csv", "config.toml", "summary.json"}
    assert {path.name for path in tmp_path.iterdir()} == expected
    assert expected < RUN_FILES
    assert read_tum(tmp_path / "ekf.tum", 1000.0).y_m == pytest.approx(3.0)
    assert read_tum(tmp_path / "smoothed.tum").t_s[0] == pytest.approx(1001.0)
    assert np.loadtxt(tmp_path / "breadcrumbs.csv", delimiter=",", skiprows=1)[0, 1] == pytest.approx(1001.0)
    assert (tmp_path / "return.csv").read_text().splitlines()[1].startswith("1070.000000,60,1030.500000,")
    assert load_config(str(tmp_path / "config.toml")).graph.sigma_mag_rad == 0.123
    text = (tmp_path / "summary.json").read_text()
    assert text.startswith('{\n  "steps": 50,\n  "sha256": {\n    "breadcrumbs.csv": "')
    summary = json.loads(text)
    assert summary.pop("sha256") == noted_digests(tmp_path, summary)
    assert summary == {"steps": 50}


def test_without_a_way_back_there_is_no_return_csv(tmp_path: Path) -> None:
    write_tables(hand_result(), tmp_path, {})
    assert not (tmp_path / "return.csv").exists()


def test_run_files_are_these() -> None:
    assert {
        *("pdr.tum", "ekf.tum", "smoothed.tum", "online.tum", "breadcrumbs.csv", "summary.json", "config.toml"),
        *("recording.rrd", "raw.csv", "layout.toml", "return.csv", "truth.tum", "batch.json"),
    } == RUN_FILES


def test_a_runs_own_files_are_not_written_onto(tmp_path: Path) -> None:
    require_free(tmp_path / "ekf.tum", "--output")  # not in a run
    for mark in ("summary.json", "raw.csv"):
        run = tmp_path / mark.partition(".")[0]
        run.mkdir()
        (run / mark).write_text("{}")
        require_free(run / "way.gpx", "--output")
        with pytest.raises(ConfigError, match=r"--output .*ekf.tum: that is a run's own file; name another"):
            require_free(run / "ekf.tum", "--output")
