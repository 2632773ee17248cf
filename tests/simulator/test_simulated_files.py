"""Simulated walks as files."""

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fbgraph.core.errors import DataError
from fbgraph.core.units import STANDARD_GRAVITY_M_S2
from fbgraph.readers import read_log
from fbgraph.readers.places import read_checkpoints
from fbgraph.simulator.files import write_m5stickc_csv, write_truth_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import Device, SimulateOptions


class TestFiles:
    def test_m5stickc_csv(self, tmp_path: Path) -> None:
        log = simulate(load_route("obstacle"), seed=2).log
        write_m5stickc_csv(log, tmp_path / "walk.csv")
        table = pd.read_csv(tmp_path / "walk.csv")
        assert ",".join(table.columns) == (
            "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa,temp_c,event"
        )
        assert table["t_ms"].dtype == np.int64
        assert table["t_ms"].to_numpy() / 1000 == pytest.approx(log.acc.t_s + log.t0_s)
        acc, gyro, mag = (
            table[list(names)].to_numpy()
            for names in (("ax_g", "ay_g", "az_g"), ("gx_dps", "gy_dps", "gz_dps"), ("mx_ut", "my_ut", "mz_ut"))
        )
        assert acc * STANDARD_GRAVITY_M_S2 == pytest.approx(log.acc.values, abs=1e-5)
        assert np.radians(gyro) == pytest.approx(log.gyro.values, abs=1e-7)
        assert mag[~np.isnan(mag[:, 0])] == pytest.approx(log.mag.values, abs=1e-4)
        assert table["p_hpa"].dropna().to_numpy() == pytest.approx(log.pressure.values[:, 0], abs=1e-5)
        assert table["event"].dropna().tolist() == ["A", "B", "C", "D", "E"]

    @pytest.mark.parametrize("noise", [0.0, 1.0])
    def test_reads_back(self, tmp_path: Path, noise: float) -> None:
        log = simulate(load_route("obstacle"), SimulateOptions(noise=noise), seed=2).log
        write_m5stickc_csv(log, tmp_path / "walk.csv")
        back = read_log(tmp_path / "walk.csv").log
        assert back.format == log.format
        assert back.t0_s == pytest.approx(log.t0_s)
        assert back.acc.t_s == pytest.approx(log.acc.t_s)
        assert back.acc.values == pytest.approx(log.acc.values, abs=1e-5)
        assert back.gyro.values == pytest.approx(log.gyro.values, abs=1e-7)
        assert [event.label for event in back.events] == list("ABCDE")
        assert [event.t_s for event in back.events] == pytest.approx([event.t_s for event in log.events])

    def test_odd_labels_and_clocks(self, tmp_path: Path) -> None:
        walk = simulate(load_route("obstacle"), SimulateOptions(noise=0.0, device=Device(rate_hz=60.0)))
        first, *others = walk.log.events
        log = dataclasses.replace(walk.log, events=(dataclasses.replace(first, label='the "door", left'), *others))
        write_m5stickc_csv(log, tmp_path / "walk.csv")
        table = pd.read_csv(tmp_path / "walk.csv")
        assert table["event"].dropna().iloc[0] == "the 'door', left"
        assert table["t_ms"].to_numpy() / 1000 == pytest.approx(log.acc.t_s + log.t0_s, abs=1e-6)
        late = dataclasses.replace(log.gyro, t_s=log.gyro.t_s + 0.001)
        with pytest.raises(DataError, match="clocks of their own"):
            write_m5stickc_csv(dataclasses.replace(log, gyro=late), tmp_path / "other.csv")

    def test_truth_csv(self, tmp_path: Path) -> None:
        walk = simulate(load_route("stairs"), seed=2)
        write_truth_csv(walk, tmp_path / "truth.csv")
        places = read_checkpoints(tmp_path / "truth.csv")
        assert (np.diff(places.t_s) >= 0).all()
        t_s = places.t_s - walk.log.t0_s
        for found, truth in ((places.x_m, walk.x_m), (places.y_m, walk.y_m), (places.z_m, walk.z_m)):
            assert found == pytest.approx(np.interp(t_s, walk.t_s, truth), abs=2e-3)
        table = pd.read_csv(tmp_path / "truth.csv")
        steps, turns = table.dropna(subset="step"), table.dropna(subset="turn_rad")
        assert steps["step"].tolist() == list(range(1, len(walk.steps.t_s) + 1))
        assert steps["length_m"].to_numpy() == pytest.approx(walk.steps.length_m, abs=1e-4)
        assert turns["turn_rad"].to_numpy() == pytest.approx(walk.turns.angle_rad, abs=1e-6)

    def test_checkpoints_are_on_the_event_clock(self) -> None:
        walk = simulate(load_route("square"), SimulateOptions(device=Device(clock_start_s=77.0)), seed=1)
        assert walk.log.t0_s == 77.0
        assert walk.checkpoints.t_s[0] == pytest.approx(80.0)
        t_s = walk.checkpoints.t_s - 77.0
        assert np.interp(t_s, walk.t_s, walk.x_m) == pytest.approx(walk.checkpoints.x_m, abs=1e-3)
        corners = load_route("square").waypoints_m[:, :2]
        assert np.hypot(*(walk.checkpoints.xy_m - corners).T).max() < 0.45
        assert [event.t_s for event in walk.log.events] == pytest.approx(t_s, abs=0.02)
