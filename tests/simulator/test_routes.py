"""Routes and options: what is walked, and what is refused."""

import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.simulated import perfect

from fbgraph.core import bounded
from fbgraph.core.bounded import PLACES_BYTES
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.units import STANDARD_GRAVITY_M_S2
from fbgraph.simulator import simulate as module
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import ROUTE_NAMES, load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import Device, Environment, SensorErrors, SimulateOptions

TURNS_DEG = {
    "obstacle": [-45, -90, 90],
    "square": [90, 90, 90],
    "straight": [],
    "eight": [-45, -90, -90, -45, 45, 90, 90, 45],
    "out-and-back": [90, -90, -90, 90, -180, -90, 90, 90, -90],
    "stairs": [90, -90, -180, 90, -90],
}


class TestRoutes:
    @pytest.mark.parametrize("route", ROUTE_NAMES)
    def test_turns(self, route: str) -> None:
        walk = perfect(route)
        assert np.degrees(walk.turns.angle_rad) == pytest.approx(TURNS_DEG[route])
        assert (np.diff(walk.turns.t_s) > 0).all()
        assert np.degrees(walk.yaw_rad[-1] - walk.yaw_rad[0]) == pytest.approx(sum(TURNS_DEG[route]), abs=1e-6)
        assert np.interp(walk.turns.t_s, walk.t_s, walk.x_m) == pytest.approx(walk.turns.x_m, abs=1e-3)

    @pytest.mark.parametrize("route", ROUTE_NAMES)
    def test_starts_at_the_origin_and_ends_at_its_end(self, route: str) -> None:
        walk = perfect(route)
        end = load_route(route).waypoints_m[-1]
        assert (walk.x_m[0], walk.y_m[0], walk.z_m[0]) == (0.0, 0.0, 0.0)
        assert (walk.x_m[-1], walk.y_m[-1], walk.z_m[-1]) == pytest.approx(tuple(end), abs=1e-6)
        assert load_route(route).closed == (route not in ("straight", "obstacle"))

    def test_obstacle_is_as_in_the_paper(self) -> None:
        walks = [simulate(load_route("obstacle"), SimulateOptions(noise=0.0), seed) for seed in range(36)]
        seconds = [walk.checkpoints.t_s[-1] - walk.checkpoints.t_s[0] for walk in walks]
        assert np.mean(seconds) == pytest.approx(11.8, abs=0.2)  # 42,474 samples in 36 trials
        assert walks[0].labels == ("A", "B", "C", "D", "E")
        assert [event.label for event in walks[0].log.events] == list("ABCDE")

    def test_laps(self) -> None:
        walk = simulate(load_route("square", laps=3), SimulateOptions(noise=0.0))
        assert np.degrees(walk.turns.angle_rad) == pytest.approx([90] * 11)
        assert np.hypot(walk.x_m[-1], walk.y_m[-1]) < 1e-6
        assert len(walk.checkpoints) == 13
        to_and_fro = simulate(load_route("straight", laps=2), SimulateOptions(noise=0.0))
        assert np.abs(np.degrees(to_and_fro.turns.angle_rad)) == pytest.approx([180])
        assert to_and_fro.x_m[-1] == pytest.approx(0.0, abs=1e-6)

    def test_duration(self) -> None:
        walk = simulate(load_route("square"), SimulateOptions(noise=0.0, duration_s=300.0))
        assert walk.log.duration_s == pytest.approx(300.0, abs=17.0)
        assert np.hypot(walk.x_m[-1], walk.y_m[-1]) < 1e-6
        assert simulate(load_route("square"), SimulateOptions(duration_s=1.0)).log.duration_s > 30.0

    def test_pause_at_the_far_end(self) -> None:
        walk = perfect("out-and-back")
        standing = np.hypot(np.gradient(walk.x_m), np.gradient(walk.y_m)) < 1e-9
        far = (walk.x_m > 31.9) & standing
        assert 30.0 < far.sum() / 100 < 33.0
        rest = far & (walk.t_s > walk.t_s[far][0] + 1.0) & (walk.t_s < walk.t_s[far][0] + 29.0)
        assert np.linalg.norm(walk.log.acc.values[rest], axis=1) == pytest.approx(STANDARD_GRAVITY_M_S2, abs=1e-9)

    def test_file(self, tmp_path: Path) -> None:
        path = tmp_path / "garden.csv"
        path.write_text("# my garden\nx_m, y_m, pause_s\n5,5,4\n15,5,2\n15,12,0\n")
        route = load_route(str(path))
        assert route.waypoints_m.tolist() == [[0, 0, 0], [10, 0, 0], [10, 7, 0]]
        walk = simulate(route, SimulateOptions(noise=0.0))
        assert walk.log.name == "garden-0"
        assert walk.steps.t_s[0] > 7.0
        assert np.degrees(walk.turns.angle_rad) == pytest.approx([90])
        assert (walk.checkpoints.x_m[1], walk.checkpoints.y_m[1]) == pytest.approx((10.0, 0.0))

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "not a readable route"),
            ("x_m,y_m\n", "no waypoint"),
            ("x_m,y_m\n0,0\n", "at least two"),
            ("x,y\n0,0\n1,1\n", "no column x_m, y_m"),
            ("x_m,y_m,speed\n0,0,1\n5,0,1\n", "unknown column speed"),
            ("x_m,y_m\n0,0\n5,five\n", "row 2 after the header: y_m is not a number"),
            ("x_m,y_m\n0,0\n5,\n", "row 2 after the header: y_m"),
            ("x_m,y_m\n0,0\n5,0\n5,0\n", "waypoints 2 and 3"),
            ("x_m,y_m,z_m\n0,0,0\n1,0,9\n", "too steep"),
            ("x_m,y_m,pause_s\n0,0,-1\n5,0,0\n", "negative pause"),
            ("x_m,y_m\n0,0\ninf,0\n", "not a number"),
        ],
    )
    def test_bad_files(self, tmp_path: Path, text: str, message: str) -> None:
        path = tmp_path / "route.csv"
        path.write_text(text)
        with pytest.raises(DataError, match=message) as caught:
            load_route(str(path))
        assert str(path) in str(caught.value)

    def test_files_are_bounded_as_truth_is(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        path = tmp_path / "route.csv"
        with open(path, "wb") as out:
            out.truncate(PLACES_BYTES + 1)
        with pytest.raises(DataError, match=r"route\.csv: 64 MiB or more, the limit is 64 MiB"):
            load_route(str(path))
        path.write_text("x_m,y_m\n0,0\n5,0\n")
        monkeypatch.setattr(bounded, "MOST_PLACES", 3)
        assert load_route(str(path)).length_m == 5.0
        monkeypatch.setattr(bounded, "MOST_PLACES", 2)
        with pytest.raises(DataError, match=r"route\.csv: 3 lines, the limit of a route CSV is 2"):
            load_route(str(path))
        with pytest.raises(DataError, match=r"/dev/zero: is a device or socket, not a route CSV"):
            load_route("/dev/zero")
        with pytest.raises(DataError, match="is a directory, not a route CSV; name one file in it"):
            load_route(str(tmp_path))

    def test_pipe(self, tmp_path: Path) -> None:
        pipe = tmp_path / "route"
        os.mkfifo(pipe)
        writer = threading.Thread(target=pipe.write_text, args=("x_m,y_m\n0,0\n5,0\n",))
        writer.start()
        assert load_route(str(pipe)).length_m == 5.0
        writer.join()

    def test_binary_file(self, tmp_path: Path) -> None:
        path = tmp_path / "route.csv"
        path.write_bytes(bytes(range(256)))
        with pytest.raises(DataError, match=r"route\.csv"):
            load_route(str(path))


class TestOptions:
    def test_unknown_route(self) -> None:
        with pytest.raises(ConfigError, match="neither obstacle, square"):
            load_route("labyrinth")

    @pytest.mark.parametrize("kwargs", [{"laps": 0}, {"scale": 0.0}, {"scale": float("nan")}])
    def test_impossible_routes(self, kwargs: dict[str, Any]) -> None:
        with pytest.raises(ConfigError):
            load_route("square", **kwargs)

    @pytest.mark.parametrize(
        ("section", "kwargs"),
        [
            (Walker, {"cadence_hz": 0.0}),
            (Walker, {"cadence_hz": float("nan")}),
            (Walker, {"gait_variation": -1.0}),
            (Walker, {"alpha_m": -0.4}),
            (Walker, {"gamma_m": 1.0}),
            (Walker, {"shake_s": 1.0}),
            (Device, {"tilt_deg": 90.0}),
            (Device, {"rate_hz": 1000.0}),
            (Device, {"mag_rate_hz": 0.0}),
            (SensorErrors, {"mag_noise_ut": -1.0}),
            (Environment, {"pressure_hpa": 100800.0}),
            (SimulateOptions, {"noise": -1.0}),
            (SimulateOptions, {"anomalies": float("inf")}),
            (SimulateOptions, {"duration_s": 0.0}),
        ],
    )
    def test_impossible_options(self, section: type, kwargs: dict[str, float]) -> None:
        with pytest.raises(ConfigError):
            section(**kwargs)

    def test_too_long(self) -> None:
        with pytest.raises(ConfigError, match="at most a day"):
            simulate(load_route("square"), SimulateOptions(duration_s=1e6))

    def test_a_walk_is_as_long_as_it_may_be(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(module, "_LONGEST_S", 32.0)
        assert simulate(load_route("square")).log.duration_s > 32.0  # with its corners
        monkeypatch.setattr(module, "_LONGEST_S", 28.0)
        with pytest.raises(ConfigError, match="at most a day, and square takes"):
            simulate(load_route("square"))

    def test_a_route_of_more_than_a_day_is_refused_before_it_is_planned(self, tmp_path: Path) -> None:
        path = tmp_path / "far.csv"
        path.write_text("x_m,y_m,pause_s\n0,0,0\n1e9,0,0\n")
        for options in (None, SimulateOptions(duration_s=100.0)):
            with pytest.raises(ConfigError, match=r"at most a day, and .*far\.csv takes 2\.\d+e\+05 h"):
                simulate(load_route(str(path)), options)
        path.write_text("x_m,y_m,pause_s\n0,0,86401\n5,0,0\n")
        with pytest.raises(ConfigError, match=r"at most a day, and .*far\.csv takes 24 h"):
            simulate(load_route(str(path)))

    def test_more_laps_than_anybody_walks_are_refused(self) -> None:
        assert len(load_route("straight", laps=1000).labels) == 1001
        with pytest.raises(ConfigError, match="1000001 laps of 2 waypoints, the limit is 2000000 in all"):
            load_route("straight", laps=1_000_001)

    def test_negative_seed(self) -> None:
        with pytest.raises(ConfigError, match="seed"):
            simulate(load_route("square"), seed=-1)
