"""``fbgraph export`` as typed: where it writes, what it says, what it refuses."""

import io
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from support.commands import fbgraph
from support.evo_figures import evo_ape

from fbgraph.core.sensor_log import SensorLog
from fbgraph.exports import FORMATS
from fbgraph.readers import read_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk's log and a few known places."""
    folder = tmp_path_factory.mktemp("log")
    fbgraph("simulate", folder / "walk.csv", "--route", "square", "--seed", "3")
    rows = (folder / "walk_truth.csv").read_text().splitlines()
    (folder / "places.csv").write_text("\n".join([rows[0], *rows[40::30]]) + "\n")
    return folder / "walk.csv"


@pytest.fixture(scope="module")
def run(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("runs") / "walk"
    fbgraph("smooth", log, "--out", out, "--truth", log.with_name("places.csv"), "--no-recording")
    return out


@pytest.fixture(scope="module")
def samples(log: Path) -> SensorLog:
    return read_log(log).log


def test_text_goes_to_stdout_or_a_file(run: Path, tmp_path: Path) -> None:
    for name in ("tum", "csv", "g2o", "euroc", "gpx", "geojson", "kml"):
        printed = fbgraph("export", run, "--to", name, "--origin", "49,11").stdout
        done = fbgraph("export", run, "--to", name, "--origin", "49,11", "--out", tmp_path / name)
        assert done.stdout == f"written to {tmp_path / name}\n"
        assert (tmp_path / name).read_text("utf-8") == printed
    assert fbgraph("export", run, "--to", "tum").stdout == (run / "smoothed.tum").read_text()


def test_binary_goes_beside_us_but_never_onto_anything(run: Path, tmp_path: Path) -> None:
    done = fbgraph("export", run, "--to", "parquet", cwd=tmp_path)
    assert done.stdout == "written to walk.parquet\n"
    assert (tmp_path / "walk.parquet").read_bytes()[:4] == b"PAR1"
    assert "is there already; name --out FILE" in fbgraph("export", run, "--to", "parquet", cwd=tmp_path, code=2).stderr
    before = sorted(run.iterdir())
    assert "name --out FILE" in fbgraph("export", ".", "--to", "mcap", cwd=run, code=2).stderr
    assert "a run's own file" in fbgraph("export", run, "--to", "csv", "--out", run / "truth.tum", code=2).stderr
    assert sorted(run.iterdir()) == before


def test_mcap_has_every_sample_of_the_log(run: Path, samples: SensorLog, tmp_path: Path) -> None:
    done = fbgraph("export", run, "--to", "mcap", "--out", tmp_path / "walk.mcap")
    assert "sensors" not in done.stderr
    data = io.BytesIO((tmp_path / "walk.mcap").read_bytes())
    reader = make_reader(data, validate_crcs=True, decoder_factories=[DecoderFactory()])
    rows: dict[str, list[list[float]]] = {}
    last_ns = 0
    for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
        assert message.log_time >= last_ns  # as it stands in the file
        last_ns = message.log_time
        values = [decoded.x, decoded.y, decoded.z] if hasattr(decoded, "z") else [getattr(decoded, "value", np.nan)]
        rows.setdefault(channel.topic, []).append([message.log_time / 1e9, *values])
    for name, topic in (
        ("acc", "/acc_m_s2"),
        ("gyro", "/gyro_rad_s"),
        ("mag", "/mag_ut"),
        ("pressure", "/pressure_hpa"),
    ):
        stream = getattr(samples, name)
        assert np.array(rows[topic]) == pytest.approx(
            np.column_stack((stream.t_s + samples.t0_s, stream.values)), abs=1e-6
        )
    assert "/fix" not in rows


def test_without_its_log_mcap_has_the_poses_and_says_so(run: Path, log: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone"
    shutil.copytree(run, alone)
    path = alone / "summary.json"
    summary = json.loads(path.read_text())
    summary.pop("sha256")
    summary["inputs"]["log"] = str(tmp_path / "gone.csv")
    path.write_text(json.dumps(summary))
    done = fbgraph("export", alone, "--to", "mcap", "--out", tmp_path / "poses.mcap")
    assert f"without the sensors: {alone}: its log {tmp_path / 'gone.csv'} is not there any more" in done.stderr
    assert (
        "sensors" not in fbgraph("export", alone, "--to", "mcap", "--log", log, "--out", tmp_path / "all.mcap").stderr
    )
    cut = tmp_path / "cut.csv"
    cut.write_text("".join(log.read_text().splitlines(keepends=True)[:-100]))
    done = fbgraph("export", alone, "--to", "mcap", "--log", cut, "--out", tmp_path / "poses.mcap")
    assert "its log is not what it was when the run was made" in done.stderr


def test_evo_gives_our_figure_without_a_flag(run: Path, tmp_path: Path) -> None:
    scores = {name: one["score"] for name, one in json.loads((run / "summary.json").read_text())["estimators"].items()}
    ours = scores["smoothed"]
    theirs = evo_ape(run / "truth.tum", run / "smoothed.tum")
    assert theirs["pairs"] == ours["checkpoints"] > 5
    assert [theirs[name] for name in ("rmse", "mean", "max")] == pytest.approx(
        [ours[f"{name}_m"] for name in ("rmse", "mean", "max")], abs=1e-5
    )
    for name, score in scores.items():
        out = tmp_path / f"{name}.tum"
        fbgraph("export", run, "--to", "tum", "--at", "truth", "--estimator", name, "--out", out)
        assert evo_ape(run / "truth.tum", out)["rmse"] == pytest.approx(score["rmse_m"], abs=1e-5)


def test_with_truth_all_along_evo_needs_poses_there(run: Path, log: Path, tmp_path: Path) -> None:
    out = tmp_path / "dense"
    fbgraph("smooth", log, "--out", out, "--truth", log.with_name("walk_truth.csv"), "--no-recording")
    ours = json.loads((out / "summary.json").read_text())["estimators"]["smoothed"]["score"]
    fbgraph("export", out, "--to", "tum", "--at", "truth", "--out", tmp_path / "at.tum")
    theirs = evo_ape(out / "truth.tum", tmp_path / "at.tum")
    assert theirs["rmse"] == pytest.approx(ours["rmse_m"], abs=1e-5)
    assert theirs["pairs"] == ours["checkpoints"]
    assert "more places than steps" in (out / "truth.tum").read_text().splitlines()[1]


@pytest.mark.parametrize(
    ("arguments", "code", "cause"),
    [
        (("--to", "shp"), 2, "no such format; there are tum, csv"),
        (("--to", "x\x1b[2J"), 2, r"x\x1b[2J"),
        (("--to", "gpx"), 2, "gpx needs latitude and longitude"),
        (("--to", "kml", "--origin", "north"), 2, "LAT,LON"),
        (("--to", "gpx", "--origin", "1,2", "--start-height-m", "nan"), 2, "not a number of metres"),
        (("--to", "csv", "--estimator", "magic"), 2, "unknown estimator"),
        (("--to", "csv", "--estimator", "online"), 3, "no online trajectory, only pdr, ekf, smoothed"),
        (("--to", "csv", "--at", "truth"), 2, "with --to tum"),
        (("--to", "tum", "--at", "noon"), 2, "expected steps"),
        (("--to", "csv", "--out", "/dev/null/walk.csv"), 2, "cannot write"),
    ],
)
def test_what_cannot_be_is_one_line(run: Path, arguments: tuple[str, ...], code: int, cause: str) -> None:
    done = fbgraph("export", run, *arguments, code=code)
    assert cause in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def test_no_run_no_truth(run: Path, log: Path, tmp_path: Path) -> None:
    assert "not a run folder" in fbgraph("export", tmp_path, "--to", "csv", code=3).stderr
    fbgraph("smooth", log, "--out", tmp_path / "bare", "--no-recording")
    assert not (tmp_path / "bare" / "truth.tum").exists()
    assert "given no truth" in fbgraph("export", tmp_path / "bare", "--to", "tum", "--at", "truth", code=3).stderr


def test_help_shows_examples_and_every_format() -> None:
    shown = " ".join(fbgraph("export", "--help").stdout.split())
    assert "fbgraph export run --to gpx --origin" in shown
    assert set(FORMATS) <= set(re.findall(r"\w+", shown.partition("--to")[2].partition("--estimator")[0]))
