"""``fbgraph inspect``, ``--layout`` and ``--rate``, as typed."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from support.commands import fbgraph

ROWS = 1500


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("inspect") / "walk.csv"
    fbgraph("simulate", path, "--route", "square", "--seed", 5)
    return path


def relabelled(walk: Path, out: Path, header: str, columns: str) -> Path:
    """Some columns of the walk, in the order of these numbers, under another header."""
    rows = [line.split(",") for line in walk.read_text().splitlines()[1:]]
    wanted = [int(column) for column in columns.split()]
    out.write_text("\n".join([header, *(",".join(row[i] for i in wanted) for row in rows)]) + "\n")
    return out


def test_it_says_what_was_read_shown_and_would_be_found(walk: Path) -> None:
    printed = fbgraph("inspect", walk).stdout
    assert "  ax_g: acc x in g (" in printed
    assert "  ignored: temp_c (" in printed
    assert "accelerometer: g, as named, sure\n" in printed
    assert "worn: held (" in printed
    assert "smooth would say: sound, " in printed
    assert printed.endswith(f"next:\n  fbgraph smooth {walk}\n")
    assert max(len(line) for line in printed.splitlines()[:-1]) <= 80


def test_json_says_the_same_with_units_in_its_keys(walk: Path) -> None:
    report = json.loads(fbgraph("inspect", walk, "--json").stdout)
    columns = {column["name"]: column for column in report["tables"][0]["columns"]}
    assert columns["gz_dps"]["taken_for"] == "gyro z"
    assert columns["gz_dps"]["unit"] == "°/s"
    assert columns["t_ms"]["taken_for"] == "time"
    assert not columns["temp_c"]["used"]
    assert report["sensors"]["acc"]["rate_hz"] == pytest.approx(100.0, abs=1.0)
    assert report["sensors"]["acc"]["gaps"] == []
    assert report["physics"]["acc"]["sure"] is True
    assert report["smooth"]["verdict"] == "sound"
    assert len(report["rest"]["gyro_bias_deg_s"]) == 3
    assert 30.0 < report["field"]["strength_ut"] < 60.0


def test_a_picture_is_drawn(walk: Path, tmp_path: Path) -> None:
    fbgraph("inspect", walk, "--plot", tmp_path / "walk.png")
    assert (tmp_path / "walk.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("header", "columns", "said"),
    [
        ("t_ms,ax_g,ay_g,az_g,mx_ut,my_ut,mz_ut", "0 1 2 3 7 8 9", "no gyroscope"),
        ("t_ms,gx_dps,gy_dps,gz_dps", "0 4 5 6", "no accelerometer"),
    ],
)
def test_what_smooth_refuses_is_inspected_all_the_same(
    walk: Path, tmp_path: Path, header: str, columns: str, said: str
) -> None:
    log = relabelled(walk, tmp_path / "part.csv", header, columns)
    report = json.loads(fbgraph("inspect", log, "--json", "--plot", tmp_path / "part.png").stdout)
    assert report["smooth"]["verdict"] == "refused"
    assert said in report["smooth"]["reasons"][0]
    inertial = report["sensors"].get("acc") or report["sensors"]["gyro"]
    assert inertial["samples"] > ROWS
    assert inertial["rate_hz"] == pytest.approx(100.0, abs=1.0)
    assert (tmp_path / "part.png").stat().st_size > 5000
    assert "next, once that is mended:\n" in fbgraph("inspect", log).stdout
    assert said in fbgraph("inspect", log, "--write-layout", tmp_path / "l.toml", code=3).stderr
    assert not (tmp_path / "l.toml").exists()


def test_a_layout_that_was_written_and_changed_reads_a_table_that_explains_itself_badly(
    walk: Path, tmp_path: Path
) -> None:
    fbgraph("inspect", walk, "--write-layout", tmp_path / "good.toml")
    layout = tomllib.loads((tmp_path / "good.toml").read_text())
    for name, first in (("acc", 1), ("gyro", 4), ("mag", 7)):
        layout[name]["columns"] = [f"c{first + i}" for i in range(3)]
    del layout["pressure"], layout["event"]
    layout["clocks"][0]["columns"] = ["c0"]
    (tmp_path / "own.toml").write_text(tomli_w.dumps(layout))
    header = ",".join(f"c{i}" for i in range(10))
    log = relabelled(walk, tmp_path / "own.csv", header, "0 1 2 3 4 5 6 7 8 9")
    fbgraph("smooth", log, "--out", tmp_path / "refused", "--no-recording", code=3)
    fbgraph("smooth", log, "--layout", tmp_path / "own.toml", "--out", tmp_path / "own")
    summary = json.loads((tmp_path / "own" / "summary.json").read_text())
    assert summary["inputs"]["layout"] == str(tmp_path / "own.toml")
    assert summary["log"]["reading"]["sensors"]["gyro"]["columns"] == ["c4", "c5", "c6"]
    fbgraph("smooth", walk, "--out", tmp_path / "named", "--no-recording")
    own, named = (np.loadtxt(tmp_path / run / "smoothed.tum") for run in ("own", "named"))
    assert own[:, 1:3] == pytest.approx(named[:, 1:3], abs=0.05)  # without its barometer
    fbgraph("record", tmp_path / "own", "--out", tmp_path / "again.rrd")  # reads it so again


def test_a_rate_is_kept_with_the_run(walk: Path, tmp_path: Path) -> None:
    log = relabelled(walk, tmp_path / "rows.csv", "ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", "1 2 3 4 5 6")
    fbgraph("smooth", log, "--rate", "25", "--out", tmp_path / "slow", "--no-recording", "--force")
    summary = json.loads((tmp_path / "slow" / "summary.json").read_text())
    assert summary["inputs"]["rate_hz"] == 25.0
    assert summary["log"]["rates_hz"]["acc"] == 25.0
    assert "note: no time column" not in fbgraph("inspect", log, "--rate", "50").stdout
    assert "--rate 0: expected" in fbgraph("smooth", log, "--rate", "0", "--out", tmp_path / "x", code=2).stderr


def test_a_layout_in_which_one_column_is_two_axes_is_refused(walk: Path, tmp_path: Path) -> None:
    (tmp_path / "twice.toml").write_text(_layout(walk, tmp_path).replace('"ay_g"', '"ax_g"'))
    error = fbgraph("smooth", walk, "--layout", tmp_path / "twice.toml", "--out", tmp_path / "x", code=2).stderr
    assert "acc.columns: Value error, one column for two axes" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("speed = 1\n", "unknown key 'speed'; `fbgraph inspect LOG --write-layout FILE` writes a layout"),
        ("app = 'x'\n", "acc: Field required; `fbgraph inspect"),
    ],
)
def test_a_layout_that_is_none_is_told_in_its_own_words(walk: Path, tmp_path: Path, text: str, said: str) -> None:
    whole = {"speed = 1\n": text + _layout(walk, tmp_path)}.get(text, text)
    (tmp_path / "bad.toml").write_text(whole)
    error = fbgraph("inspect", walk, "--layout", tmp_path / "bad.toml", code=2).stderr
    assert said in error
    assert "fbgraph config" not in error


def _layout(walk: Path, folder: Path) -> str:
    fbgraph("inspect", walk, "--write-layout", folder / "written.toml")
    return (folder / "written.toml").read_text()


def test_smooth_says_how_it_read_the_log(walk: Path, tmp_path: Path) -> None:
    printed = fbgraph("smooth", walk, "--out", tmp_path / "run", "--no-recording").stdout
    assert "read: acceleration ax_g… in g, 100 Hz; rotation gx_dps… in °/s, 100 Hz; field mx_ut… in µT, " in printed
    assert "time t_ms\n" in printed
    assert "assumed:" not in printed
    online = fbgraph("online", walk, "--out", tmp_path / "online", "--no-recording").stdout
    assert "read: acceleration ax_g… in g, 100 Hz" in online


def test_a_log_too_slow_for_steps_is_withheld(shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "formats" / "m5stickc_plus_kilian_tcp" / "hammering_3_IMU_R_data.csv"
    done = fbgraph("smooth", log, "--out", tmp_path / "run", "--no-recording", code=4)
    assert "too slow for steps" in done.stderr
    assert "withheld" in fbgraph("inspect", log).stdout
