"""Trials in the ForestBack data set's layout: whatever their columns are called, and whatever holds the tables."""

import gzip
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.study.column_names import DatasetConfig, load_layout, load_mapping
from fbgraph.study.course import simulated_trials, write_trial
from fbgraph.study.dataset import read_dataset
from fbgraph.study.trial import Trial

LAYOUT = load_layout("forestback")
AXES = "xyz"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three simulated trials; read them, do not write here."""
    path = tmp_path_factory.mktemp("trials")
    for name, walk, remark in simulated_trials(5, 3):
        write_trial(walk, path / f"{name}.csv", remark)
    return path


@pytest.fixture(scope="module")
def table(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "trial_01.csv", comment="#")


def only(path: Path, layout: DatasetConfig = LAYOUT) -> Trial:
    (trial,) = read_dataset(path, layout).trials
    return trial


def with_units(table: pd.DataFrame) -> pd.DataFrame:
    """Units in brackets, milliseconds, g and degrees."""
    out = pd.DataFrame({"Timestamp (ms)": table["time_s"] * 1e3})
    for axis in AXES:
        out[f"Acc {axis.upper()} (g)"] = table[f"acc_{axis}_ms2"] / 9.80665
        out[f"Gyro {axis.upper()} [deg/s]"] = np.degrees(table[f"gyro_{axis}_rads"])
        out[f"Mag {axis.upper()} (µT)"] = table[f"mag_{axis}_ut"]
    out["Baro Pressure (Pa)"] = table["pressure_hpa"] * 100.0
    out["Ground Truth X (m)"], out["Ground Truth Y (cm)"] = table["gt_x_m"], table["gt_y_m"] * 100.0
    out["GT Heading (deg)"] = np.degrees(table["gt_heading_rad"])
    return out.assign(**{"Step Event": table["step"], "Turn Event": (table["turn"] != "none").astype(int)})


def without_units(table: pd.DataFrame) -> pd.DataFrame:
    """Short names that leave units to be judged; a running count of steps; turns as signs."""
    out = pd.DataFrame({"t": table["time_s"]})
    for axis in AXES:
        out[f"a{axis}"], out[f"g{axis}"] = table[f"acc_{axis}_ms2"], table[f"gyro_{axis}_rads"]
        out[f"m{axis}"] = table[f"mag_{axis}_ut"]
    out["p"], out["true_x"], out["true_y"] = table["pressure_hpa"], table["gt_x_m"], table["gt_y_m"]
    out["step_count"] = table["step"].cumsum()
    return out.assign(turn_label=table["turn"].map({"none": 0, "left": 1, "right": -1}))


def camel_case(table: pd.DataFrame) -> pd.DataFrame:
    """Camel case, nanoseconds since 1970, an altitude for the barometer, columns nobody asked for, back to front."""
    out = pd.DataFrame({"sampleTimeNs": 0, "timestamp_ns": 1_700_000_000 * 10**9 + (table["time_s"] * 1e9).astype(int)})
    for axis in AXES:
        out[f"accel{axis.upper()}_mps2"] = table[f"acc_{axis}_ms2"]
        out[f"gyro{axis.upper()}_dps"] = np.degrees(table[f"gyro_{axis}_rads"])
        out[f"magnetometer{axis.upper()}"] = table[f"mag_{axis}_ut"]
    out["baroAltitude_m"] = 44330.77 * (1.0 - (table["pressure_hpa"] / 1013.25) ** 0.190263)
    out["xTrue"], out["yTrue"], out["temperature"] = table["gt_x_m"], table["gt_y_m"], 30.0
    out["isStep"], out["turn_flag"] = table["step"] == 1, table["turn"].str.upper()
    return out[out.columns[::-1]]


def test_the_preset_is_the_wearables_with_a_layout() -> None:
    assert load_config("forestback") == load_config("m5stickc")
    assert load_layout("m5stickc") == LAYOUT  # a preset that names no columns gets the authors'
    assert all(aliases for _, aliases in LAYOUT.columns)
    with pytest.raises(ConfigError, match=r"dataset\.columns\.acc_w"):
        load_layout("forestback", ["dataset.columns.acc_w=a"])


@pytest.mark.parametrize("style", [with_units, without_units, camel_case])
def test_columns_are_found_under_other_names_and_units(
    folder: Path, table: pd.DataFrame, tmp_path: Path, style: Callable[[pd.DataFrame], pd.DataFrame]
) -> None:
    style(table).to_csv(tmp_path / "other.csv", index=False)
    other, trial = only(tmp_path / "other.csv"), read_dataset(folder, LAYOUT).trials[0]
    for sensor, off in (("acc", 1e-4), ("gyro", 1e-5), ("mag", 1e-4), ("pressure", 1e-3)):
        stream, expected = getattr(other.log, sensor), getattr(trial.log, sensor)
        assert np.allclose(stream.t_s, expected.t_s, atol=1e-6)
        assert np.allclose(stream.values, expected.values, atol=off)
    assert np.allclose(other.truth.xy_m, trial.truth.xy_m, atol=1e-6)
    assert trial.step_s is not None
    assert other.step_s is not None
    assert np.allclose(other.step_s, trial.step_s, atol=1e-6)
    assert trial.turns is not None
    assert other.turns is not None
    assert np.allclose(other.turns.t_s, trial.turns.t_s, atol=1e-6)
    assert other.turns.side.tolist() == trial.turns.side.tolist() == [-1.0, -1.0, 1.0]


def test_a_folder_a_zip_and_one_long_table_hold_the_same_trials(folder: Path, tmp_path: Path) -> None:
    packed = tmp_path / "all.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for file in folder.iterdir():
            archive.write(file, f"dataset/{file.name}")
        archive.writestr("__MACOSX/dataset/._trial_01.csv", "rubbish")
    tables = [pd.read_csv(file, comment="#").assign(trial_id=k) for k, file in enumerate(sorted(folder.iterdir()), 1)]
    long = tmp_path / "long.csv.gz"
    long.write_bytes(gzip.compress(pd.concat(tables).to_csv(index=False, sep=";").encode()))
    expected = read_dataset(folder, LAYOUT)
    assert [trial.name for trial in expected.trials] == ["trial_01", "trial_02", "trial_03"]
    assert expected.trials[0].checkpoints == ("A", "B", "C", "D", "E")
    assert expected.simulated.startswith("simulated")
    for source in (packed, long):
        trials = read_dataset(source, LAYOUT).trials
        assert len(trials) == 3
        for a, b in zip(trials, expected.trials, strict=True):
            assert np.array_equal(a.log.acc.values, b.log.acc.values)
            assert np.array_equal(a.truth.xy_m, b.truth.xy_m)
    assert len(read_dataset(packed, LAYOUT, most=2).trials) == 2


def test_a_table_without_times_has_rows_at_the_data_sets_rate(table: pd.DataFrame, tmp_path: Path) -> None:
    table.drop(columns="time_s").to_csv(tmp_path / "x.csv", index=False)
    trial = only(tmp_path / "x.csv")
    assert trial.log.acc.rate_hz == pytest.approx(100.0)
    assert any("no time column" in notice for notice in trial.log.notices)


def test_a_row_count_is_not_taken_for_steps(table: pd.DataFrame, tmp_path: Path) -> None:
    table.assign(step=np.arange(len(table))).to_csv(tmp_path / "x.csv", index=False)
    trial = only(tmp_path / "x.csv")
    assert trial.step_s is None
    assert any("more than steps can be" in notice for notice in trial.log.notices)


def test_a_mapping_file_names_columns_that_no_alias_covers(table: pd.DataFrame, tmp_path: Path) -> None:
    renamed = table.rename(columns={"gyro_z_rads": "Turn rate", "gt_x_m": "path easting"})
    renamed.assign(**{"Turn rate": np.degrees(table["gyro_z_rads"])}).drop(
        columns=["gyro_x_rads", "gyro_y_rads"]
    ).assign(r1=np.degrees(table["gyro_x_rads"]), r2=np.degrees(table["gyro_y_rads"])).to_csv(
        tmp_path / "x.csv", index=False
    )
    with pytest.raises(DataError, match=r"no column for gyro_x, gyro_y, gyro_z, truth_x; found time_s, .*Turn rate"):
        read_dataset(tmp_path / "x.csv", LAYOUT)
    mapping = tmp_path / "mine.toml"
    mapping.write_text(
        '[dataset.columns]\ngyro_x = "r1"\ngyro_y = "r2"\ngyro_z = ["rate", "turn rate"]\ntruth_x = "Path Easting"\n'
        '[dataset.units]\ngyro = "dps"\n'
    )
    layout = load_mapping(mapping, LAYOUT)
    trial = only(tmp_path / "x.csv", layout)
    assert np.allclose(trial.log.gyro.values.T[2], table["gyro_z_rads"], atol=1e-6)
    assert layout.columns.acc_x == LAYOUT.columns.acc_x  # what the file does not name stays


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[dataset.columns]\nacc_q = 'a'\n", "dataset.columns.acc_q"),
        ("[dataset.units]\nacc = 'furlongs'\n", "dataset.units.acc"),
        ("[graph]\nsigma_mag_rad = 1.0\n", "'graph'"),
        ("", "dataset.columns"),
        ("[[", "TOML"),
    ],
)
def test_a_mapping_file_with_anything_unknown_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(ConfigError, match=said):
        load_mapping(tmp_path / "m.toml", LAYOUT)


def test_the_authors_outputs_and_the_current_are_read(table: pd.DataFrame, tmp_path: Path) -> None:
    table = table.assign(
        pdr_x=table["gt_x_m"] + 1.0,
        pdr_y=table["gt_y_m"],
        pdr_error=1.0,
        fb_x=table["gt_x_m"],
        fb_y=table["gt_y_m"] - 0.5,
    ).assign(fb_heading_deg=np.degrees(table["gt_heading_rad"]) + 3.0, current_mA=60.0)
    table.to_csv(tmp_path / "x.csv", index=False)
    trial = only(tmp_path / "x.csv")
    assert set(trial.logged) == {"pdr", "forestback"}
    assert np.allclose(trial.logged["pdr"].x_m - trial.truth.x_m, 1.0)
    assert np.isnan(trial.logged["pdr"].heading_rad).all()
    assert np.allclose(trial.logged["forestback"].heading_rad - trial.truth.heading_rad, np.radians(3.0))
    assert trial.logged_error_m["pdr"].mean() == 1.0
    assert trial.current_ma.mean() == 60.0


def test_a_turned_map_is_turned_back(table: pd.DataFrame, tmp_path: Path) -> None:
    turned = table.assign(
        gt_x_m=table["gt_y_m"], gt_y_m=-table["gt_x_m"], gt_heading_rad=table["gt_heading_rad"] - np.pi / 2
    )
    turned.to_csv(tmp_path / "x.csv", index=False)  # a map whose x axis is North
    trial = only(tmp_path / "x.csv", LAYOUT.model_copy(update={"map_yaw_deg": 90.0}))
    assert np.allclose(trial.truth.xy_m, table[["gt_x_m", "gt_y_m"]].to_numpy(), atol=1e-9)
    assert np.allclose(np.exp(1j * trial.truth.heading_rad), np.exp(1j * table["gt_heading_rad"]), atol=1e-9)


@pytest.mark.parametrize("column", ["ax", "gy", "mz"])
def test_one_garbled_number_decides_nothing(table: pd.DataFrame, tmp_path: Path, column: str) -> None:
    without_units(table).to_csv(tmp_path / "good.csv", index=False)
    garbled = without_units(table)
    garbled[column] = garbled[column].astype(float)
    garbled.loc[100, column] = 1e300
    garbled.to_csv(tmp_path / "odd.csv", index=False)
    with np.errstate(all="raise"):
        good, odd = (only(tmp_path / name).log for name in ("good.csv", "odd.csv"))
    for name in ("acc", "gyro", "mag"):
        t_s, values = getattr(odd, name).t_s, getattr(odd, name).values
        there = np.isin(getattr(good, name).t_s, t_s)
        assert there.sum() >= len(there) - 1
        np.testing.assert_array_equal(values, getattr(good, name).values[there])


def test_a_field_that_is_empty_or_too_large_empties_no_other(table: pd.DataFrame, tmp_path: Path) -> None:
    odd = table.copy()
    odd.loc[100, "acc_x_ms2"], odd.loc[110, "mag_x_ut"] = np.nan, np.inf
    odd.to_csv(tmp_path / "odd.csv", index=False)
    table.to_csv(tmp_path / "good.csv", index=False)
    with np.errstate(all="raise"):
        good, odd_log = (only(tmp_path / name).log for name in ("good.csv", "odd.csv"))
    assert len(odd_log.gyro) == len(good.gyro)
    assert len(odd_log.acc) >= len(good.acc) - 1


def test_bad_tables_among_good_ones_are_named_and_left_out(folder: Path, tmp_path: Path) -> None:
    for file in folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "summary.csv").write_text("trial,rmse\n1,0.9\n")
    (tmp_path / "noise.csv").write_bytes(bytes(range(256)) * 20)
    found = read_dataset(tmp_path, LAYOUT)
    assert len(found.trials) == 3
    reasons = dict(found.skipped)
    assert set(reasons) == {"empty", "summary", "noise"}
    assert "found trial, rmse" in reasons["summary"]


@pytest.mark.parametrize("name", ["nowhere", "empty_folder", "no_tables.zip", "broken.zip"])
def test_what_holds_no_table_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name == "empty_folder":
        path.mkdir()
    elif name == "no_tables.zip":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("readme.txt", "hello")
    elif name == "broken.zip":
        path.write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(DataError, match=name) as error:
        read_dataset(path, LAYOUT)
    assert "\n" not in str(error.value)
