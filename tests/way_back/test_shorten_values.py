"""A way without its loops and dead ends: closed forms, and how sure it is that their ends are one place."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from support.commands import fbgraph
from support.trajectories import trajectory

from fbgraph.core.config import load_config
from fbgraph.core.trajectory import Trajectory
from fbgraph.pipeline import reconstruct, write_run
from fbgraph.run.folder import claimed_run
from fbgraph.simulator.routes import Route
from fbgraph.simulator.simulate import simulate
from fbgraph.way_back.shorten import left_out_text, shortened, within

GRAPH = load_config("m5stickc").graph
LAP = [(0.0, 20), (90.0, 20), (180.0, 20), (-90.0, 20)]


def walked(*legs: tuple[float, int], z_m: np.ndarray[tuple[int], np.dtype[np.float64]] | float = 0.0) -> Trajectory:
    yaw = np.concatenate([np.full(count, direction) for direction, count in legs])
    return trajectory(yaw, 1.0, z_m)


def with_sigma(way: Trajectory, sigma_m: float, yaw_rad: float) -> Trajectory:
    cov = np.zeros((len(way), 3, 3))
    cov[:, [0, 1], [0, 1]], cov[:, 2, 2] = sigma_m**2, yaw_rad**2
    return Trajectory(way.t_s, way.x_m, way.y_m, way.z_m, way.yaw_rad, way.gyro_bias_rad_s, cov)


def test_a_way_that_never_comes_by_a_place_again_stays_whole() -> None:
    way = walked((0.0, 30), (90.0, 30), (180.0, 26))
    short, left_out = shortened(way)
    assert left_out == ()
    assert np.array_equal(short.x_m, way.x_m)
    assert left_out_text(left_out) == []


def test_laps_are_left_out_and_the_way_goes_on_from_their_beginning() -> None:
    way = walked((-90.0, 12), *LAP, *LAP, *LAP, (180.0, 15))
    short, left_out = shortened(way)
    assert len(left_out) == 1
    assert left_out[0].after_m == pytest.approx(12.0, abs=2.0)
    assert left_out[0].length_m == pytest.approx(240.0, abs=3.0)
    assert short.distance_m[-1] == pytest.approx(27.0, abs=2.0)
    assert (short.x_m[0], short.x_m[-1]) == (way.x_m[0], way.x_m[-1])
    assert (np.diff(short.t_s) > 0).all()


def test_dead_ends_go_and_a_floor_above_is_another_place() -> None:
    spur = walked((0.0, 15), (90.0, 12), (-90.0, 12), (0.0, 15), (-90.0, 9), (90.0, 9), (0.0, 10))
    short, left_out = shortened(spur)
    assert [round(one.length_m) for one in left_out] == pytest.approx([24, 18], abs=3)
    assert short.distance_m[-1] == pytest.approx(40.0, abs=4.0)
    up = np.interp(np.arange(81), [0, 20, 60, 80], [0.0, 0.0, 3.0, 3.0])
    stairs = walked(*LAP, z_m=up)
    assert shortened(stairs)[1] == ()


def test_how_sure_it_is_follows_the_sigmas() -> None:
    assert within(3.0, 0.0, 2.0) == pytest.approx(1.0 - math.exp(-(3.0**2) / (2 * 2.0**2)))
    rng = np.random.default_rng(1)
    off = rng.normal((1.2, 0.0), 1.5, (200_000, 2))
    assert within(3.0, 1.2, 1.5) == pytest.approx((np.hypot(*off.T) < 3.0).mean(), abs=0.005)
    assert (within(3.0, 2.9, 0.0), within(3.0, 3.1, 0.0)) == (1.0, 0.0)
    way = walked((-90.0, 12), *LAP, (180.0, 15))
    assert shortened(way, GRAPH)[1][0].sure is None
    assert "nobody knows" in left_out_text(shortened(way, GRAPH)[1])[1]
    sharp, vague = (shortened(with_sigma(way, 5.0, yaw), GRAPH)[1][0] for yaw in (0.001, 0.1))
    own_m = math.hypot(GRAPH.sigma_length_rel * math.sqrt(80), GRAPH.sigma_lateral_m * math.sqrt(80))
    assert sharp.sigma_m == pytest.approx(own_m, rel=0.03)
    assert vague.sigma_m == pytest.approx(math.hypot(own_m, 0.1 * math.sqrt(80 * 28.3)), rel=0.05)
    known = shortened(with_sigma(way, 0.2, 0.1), GRAPH)[1][0]
    assert known.sigma_m == pytest.approx(0.4)  # never more than of both places
    assert (known.sure or 0.0) > (sharp.sure or 0.0) > 0.99 > 0.5 > (vague.sure or 0.0)


def test_the_command_line_says_what_it_left_out_and_how_sure_that_is(tmp_path: Path) -> None:
    corners = np.array([(0, 0), (16, 0), (16, 9), (0, 9), (0, 0), (0, -12), (8, -12)], dtype=float)
    xyz_m = np.column_stack((corners, np.zeros(len(corners))))
    log = simulate(Route("lap", xyz_m, np.zeros(len(xyz_m)), tuple(str(k) for k in range(len(xyz_m)))), seed=1).log
    folder = tmp_path / "run"
    with claimed_run(folder) as claim:
        write_run(reconstruct(log, load_config("m5stickc")), claim, recording=False)
    whole, short = (
        json.loads(fbgraph("guide", folder, "--format", "json", *more).stdout) for more in ((), ("--shorten",))
    )
    assert whole["left_out"] == []
    assert whole["length_m"] == pytest.approx(70.0, rel=0.06)
    assert short["length_m"] == pytest.approx(20.0, abs=3.0)
    assert len(short["legs"]) == 2
    (left_out,) = short["left_out"]
    assert left_out["length_m"] == pytest.approx(50.0, rel=0.1)
    assert 0.0 < left_out["sure"] <= 1.0
    assert {mark["label"] for leg in short["legs"] for mark in leg["landmarks"]}.isdisjoint({"1", "2", "3"})
    text = fbgraph("guide", folder, "--shorten").stdout
    assert "in 1 loop or dead end, where the walk came by a place again." in text
    assert "% sure: after" in text
