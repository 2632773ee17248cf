"""What inspection says of a log, against logs whose answer is known."""

from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.sensor_log import Stream
from fbgraph.front_end.detect_steps import found_steps
from fbgraph.inspection.field_told import field_told
from fbgraph.inspection.inspect_log import inspect_log, next_command
from fbgraph.inspection.streams_told import gaps, rest_told, still_spans, streams_told
from fbgraph.inspection.wear import worn
from fbgraph.readers import preset_of, read_log
from fbgraph.run.inputs import RunInputs
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import SensorErrors, SimulateOptions

T_S = np.arange(0.0, 60.0, 0.02)


def test_a_stream_is_told_by_its_rate_its_gaps_and_its_rail() -> None:
    keep = (T_S < 10.0) | (T_S > 12.0)
    acc = np.column_stack((np.clip(30.0 * np.sin(T_S), -19.6133, 19.6133), 0.0 * T_S, 9.8 + 0.1 * np.cos(T_S)))[keep]
    stream = Stream(T_S[keep], acc)
    told = streams_told({"acc": stream})["acc"]
    assert told["rate_hz"] == 50.0
    assert told["mean_rate_hz"] == pytest.approx((len(acc) - 1) / 59.98, abs=1e-3)
    assert told["gaps_count"] == 1
    assert told["gaps"] == [[9.98, 12.02]]
    assert np.array(gaps(stream)) == pytest.approx(np.array([[9.98, 12.02]]))
    assert told["longest_gap_s"] == pytest.approx(2.04)
    assert told["rail_m_s2"] == pytest.approx(19.613)
    assert told["samples_at_rail"] == (np.abs(acc[:, 0]) == 19.6133).sum()
    assert "rail_m_s2" not in streams_told({"acc": stream}, {"acc"})["acc"]


def test_still_phases_are_found_without_a_gyroscope_and_tell_the_bias_of_one() -> None:
    rng = np.random.default_rng(1)
    moving = (T_S >= 10.0) & (T_S < 50.0)
    acc = np.column_stack((0.0 * T_S, 0.0 * T_S, 9.8 + 2.0 * moving * np.sin(12.0 * T_S))) + rng.normal(
        0, 0.02, (3000, 3)
    )
    spans = still_spans(None, Stream(T_S, acc))
    assert np.array(spans) == pytest.approx(np.array([[0.0, 9.98], [50.0, 59.98]]), abs=0.021)
    gyro = np.radians([0.5, -1.0, 2.0]) + moving[:, None] * rng.normal(3.0, 1.0, (3000, 3))
    told = rest_told(spans, Stream(T_S, gyro))
    assert told["gyro_bias_deg_s"] == pytest.approx([0.5, -1.0, 2.0], abs=0.01)
    assert told["still_total_s"] == pytest.approx(20.0, abs=0.1)
    assert rest_told([], Stream(T_S, gyro))["gyro_bias_deg_s"] is None


def test_the_field_is_told_by_strength_dip_and_the_level_part_of_its_iron() -> None:
    yaw = 0.9 * T_S + 0.8 * np.sin(0.5 * T_S)
    rate = np.gradient(yaw, T_S)
    level, down = 20.0, 43.0
    mag = np.column_stack((level * np.sin(yaw), level * np.cos(yaw), np.full(len(T_S), -down)))
    gyro, acc = np.column_stack((0 * yaw, 0 * yaw, rate)), np.tile([0.0, 0.0, 9.80665], (len(T_S), 1))
    iron = np.array([6.0, -3.0, 0.0])
    streams = {"acc": Stream(T_S, acc), "gyro": Stream(T_S, gyro), "mag": Stream(T_S, mag + iron)}
    told = field_told(streams, None)
    assert told is not None
    assert told["hard_iron_level_ut"] == pytest.approx(iron.tolist(), abs=0.3)
    assert told["strength_ut"] == pytest.approx(np.hypot(level, down), abs=2.0)
    assert told["dip_deg"] == pytest.approx(np.degrees(np.arctan2(down, level)), abs=4.0)
    assert told["is_earths"]
    still = {**streams, "gyro": Stream(T_S, 0.0 * gyro)}
    quiet = field_told(still, None)
    assert quiet is not None
    assert quiet["hard_iron_level_ut"] is None
    weak = field_told({"mag": Stream(T_S, 0.1 * mag)}, None)
    assert weak is not None
    assert not weak["is_earths"]
    assert weak["dip_deg"] is None
    assert field_told({}, None) is None


def test_of_iron_only_what_is_level_is_told() -> None:
    log = simulate(load_route("square"), SimulateOptions(errors=SensorErrors(hard_iron_ut=9.0)), seed=2).log
    told = field_told({"acc": log.acc, "gyro": log.gyro, "mag": log.mag}, None)
    assert told is not None
    iron, up = np.array(told["hard_iron_level_ut"]), log.acc.values.mean(axis=0)
    assert abs(iron @ up) / np.linalg.norm(up) < 0.15
    assert np.linalg.norm(iron) > 1.0


@pytest.mark.parametrize(
    ("name", "how"),
    [("dan_bag2", "bag"), ("dan_body1", "held"), ("dan_handheld1", "held"), ("dan_leg1", "leg")],
)
def test_how_a_phone_was_worn_is_told_as_those_who_recorded_it_say(shared_data: Path, name: str, how: str) -> None:
    file = read_log(shared_data / "ridi" / f"{name}.csv.gz")
    config = load_config(preset_of(file))
    _, signals = found_steps(file.log, config)
    assert worn(signals, config.attitude.rate_hz).how == how
    brief = worn(signals.head(100), config.attitude.rate_hz)
    assert brief.how == "not told"


def test_earths_field_is_compared_where_the_log_says_that_it_was(shared_data: Path) -> None:
    found = inspect_log(RunInputs.of(shared_data / "ipin2023" / "TrainingTrial01_repetition03.txt.gz"))
    field = found.report["field"]
    assert "WMM" in field["expected"]
    assert not field["is_earths"]
    assert "from Earth's there" in field["why"]
    assert found.report["worn"]["how"] == "held"
    assert found.report["log"]["format"] == "getsensordata"
    assert found.layout is None
    assert len(found.steps_s) == found.report["smooth"]["steps"]


def test_the_next_command_reads_the_log_in_the_same_way(tmp_path: Path) -> None:
    log = tmp_path / "a walk.csv"
    inputs = RunInputs.of(log, layout=tmp_path / "l.toml", rate_hz=62.5, max_size=10**9)
    typed = next_command(inputs, log)
    assert typed == f"fbgraph smooth '{log}' --layout {tmp_path / 'l.toml'} --max-size 1000000000 --rate 62.5"


def test_a_slow_sensor_is_not_missed_between_its_samples() -> None:
    t_s = np.linspace(0.0, 29.0, 30) * 1.05
    assert gaps(Stream(t_s, np.zeros((30, 1)))) == []
    holed = Stream(np.concatenate((t_s[:10], t_s[14:])), np.zeros((26, 1)))
    assert np.array(gaps(holed)) == pytest.approx(np.array([[9.45, 14.7]]))
