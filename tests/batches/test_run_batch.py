import gzip
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pytest
from support.batches_compared import files_of, require_same_batches
from support.commands import fbgraph

from fbgraph.batches.batch import batch
from fbgraph.batches.index import read_index
from fbgraph.batches.index_row import COLUMNS
from fbgraph.batches.log_entry import BatchOptions
from fbgraph.batches.run_batch import HowToRun, run_batch
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.run.read_run import read_run
from fbgraph.simulator.files import simulate_files
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate_options import SimulateOptions

GOOD = ("east/walk.csv", "loop.csv", "west/walk.csv")


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three short walks, two of one name, and logs that are broken in several ways."""
    folder = tmp_path_factory.mktemp("walks")
    for seed, name in enumerate(GOOD):
        (folder / name).parent.mkdir(exist_ok=True)
        route = load_route("square" if "loop" in name else "straight", 0.4)
        simulate_files(folder / name, route, SimulateOptions(duration_s=12.0), seed)
    whole = (folder / "loop.csv").read_bytes()
    rows = whole.decode().splitlines()
    (folder / "empty.csv").touch()
    (folder / "prose.csv").write_text("It was a long walk.\n")
    (folder / "noise.csv").write_bytes(bytes(range(256)) * 20)
    (folder / "short.csv").write_text("\n".join(rows[:12]) + "\n")
    (folder / "torn.csv.gz").write_bytes(gzip.compress(whole)[:4000])
    (folder / "no_gyro.csv").write_text("\n".join(",".join(row.split(",")[:4]) for row in rows) + "\n")
    still = [",".join([row.split(",")[0], *rows[1].split(",")[1:]]) for row in rows[1:]]
    (folder / "frozen.csv").write_text("\n".join([rows[0], *still]) + "\n")
    return folder


BROKEN = {"empty", "prose", "noise", "short", "torn", "no_gyro", "frozen"}


@pytest.fixture(scope="module")
def two_workers(walks: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A batch of them all by two workers."""
    out = tmp_path_factory.mktemp("batch") / "two"
    batch(walks, out=out, workers=2, recording=False)
    return out


def test_every_good_log_is_done_and_every_broken_one_named(walks: Path, two_workers: Path) -> None:
    index = read_index(str(two_workers))
    assert list(index.columns) == list(COLUMNS)
    assert list(index["log"]) == sorted(index["log"])
    done, failed = index[index["status"] == "done"], index[index["status"] == "failed"]
    assert {Path(log).relative_to(walks).as_posix() for log in done["log"]} == set(GOOD)
    assert set(failed["name"]) == BROKEN
    assert (failed["cause"] == "data").all()
    for row in failed.itertuples():
        assert str(row.log) in str(row.reason)
    assert done["smoothed_rmse_m"].between(0.01, 6.0).all()
    assert (done["steps"] > 10).all()
    assert (index["cpu_s"] > 0.0).all()
    for row in done.itertuples():
        saved = read_run(two_workers / str(row.run))
        assert saved.summary["distance_m"] == row.distance_m
        assert saved.summary["estimators"]["ekf"]["score"]["rmse_m"] == row.ekf_rmse_m
        assert saved.summary["integrity"]["verdict"] == row.verdict


def test_both_indices_say_the_same(two_workers: Path) -> None:
    table = pd.read_csv(two_workers / "index.csv", keep_default_na=False)
    index = read_index(str(two_workers))
    assert list(table["name"]) == list(index["name"])
    assert list(table["reason"]) == list(index["reason"])
    scores = pd.to_numeric(table["pdr_rmse_m"]).dropna()
    assert scores.tolist() == index["pdr_rmse_m"].dropna().tolist()


def test_logs_of_one_name_have_runs_of_their_own(two_workers: Path) -> None:
    names = [name for name in read_index(str(two_workers))["name"] if name.startswith("walk")]
    assert len(set(names)) == 2
    assert all(name.startswith("walk-") and len(name) == 13 for name in names)


def test_the_same_bits_from_one_worker_and_in_this_process(walks: Path, two_workers: Path, tmp_path: Path) -> None:
    for workers in (0, 1):
        out = tmp_path / str(workers)
        batch(walks, out=out, workers=workers, recording=False)
        require_same_batches(out, two_workers)


def test_the_same_as_smoothed_alone(walks: Path, two_workers: Path, tmp_path: Path) -> None:
    truth = walks / "loop_truth.csv"
    fbgraph("smooth", walks / "loop.csv", "--truth", truth, "--out", tmp_path / "loop", "--no-recording")
    mine, theirs = files_of(tmp_path / "loop"), files_of(two_workers / "runs" / "loop")
    assert theirs.pop("batch.json")
    assert mine == theirs


def test_resume_keeps_what_is_whole_and_makes_what_is_not(walks: Path, two_workers: Path, tmp_path: Path) -> None:
    out = tmp_path / "batch"
    shutil.copytree(two_workers, out)
    first, second, third = sorted((out / "runs").iterdir())
    crumbs = third / "breadcrumbs.csv"
    crumbs.write_text(crumbs.read_text().replace("0.000000", "0.000001", 1))
    (second / "ekf.tum").unlink()
    (out / "runs" / ".walk.fbgraph-abc").mkdir()  # of a worker that was killed
    before = {run.name: run.stat().st_ino for run in (out / "runs").iterdir()}
    seen: list[bool] = []
    options = BatchOptions(recording=False)
    leftover = out / "runs" / ".walk.fbgraph-abc"
    end = run_batch(
        (), str(out), options, HowToRun(0, resume=True), progress=lambda so_far: seen.append(leftover.exists())
    )
    index = end.index
    assert seen == [True, *[False] * len(index)]
    assert (end.progress.done, end.progress.failed, end.progress.kept) == (3, 7, 1)
    after = {run.name: run.stat().st_ino for run in (out / "runs").iterdir()}
    kept = {name for name in after if before.get(name) == after[name]}
    assert kept == {first.name}
    assert set(after) == {first.name, second.name, third.name}
    require_same_batches(out, two_workers)
    again = batch((), out=out, workers=0, recording=False, resume=True)
    done = index["status"] == "done"
    pd.testing.assert_frame_equal(again[done], index[done])  # what is kept keeps its timings too


def test_a_log_that_changed_is_smoothed_again(walks: Path, tmp_path: Path) -> None:
    log = tmp_path / "walk.csv"
    shutil.copy(walks / "loop.csv", log)
    before = batch(log, out=tmp_path / "b", workers=0, recording=False)
    shutil.copy(walks / "west" / "walk.csv", log)
    after = batch(log, out=tmp_path / "b", workers=0, recording=False, resume=True)
    assert after["distance_m"][0] != before["distance_m"][0]


def finished_runs(out: Path) -> list[Path]:
    return list((out / "runs").glob("[!.]*/summary.json"))


def test_killed_in_the_middle_and_resumed(walks: Path, two_workers: Path, tmp_path: Path) -> None:
    out = tmp_path / "batch"
    typed = [
        sys.executable,
        "-m",
        "fbgraph",
        "batch",
        str(walks),
        "--out",
        str(out),
        "--no-recording",
        "--workers",
        "1",
    ]
    main = subprocess.Popen(typed, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    deadline = time.monotonic() + 120.0
    while not finished_runs(out) and main.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    main.send_signal(signal.SIGKILL)
    main.communicate()
    assert not (out / "index.csv").exists()
    assert 1 <= len(finished_runs(out)) < 3
    with pytest.raises(DataError, match="has not come to its end: go on with --resume"):
        read_index(str(out))
    fbgraph("batch", walks, "--out", out, "--no-recording", "--workers", 0, "--resume", code=3)
    require_same_batches(out, two_workers)


def test_ctrl_c_ends_cleanly_and_says_how_to_go_on(walks: Path, tmp_path: Path) -> None:
    out, pipe = tmp_path / "batch", tmp_path / "pipe.csv"
    os.mkfifo(pipe)  # who opens it waits
    typed = [sys.executable, "-m", "fbgraph", "batch", str(walks / "loop.csv"), str(pipe), "--out", str(out)]
    main = subprocess.Popen([*typed, "--no-recording", "--workers", "1"], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120.0
    while not finished_runs(out) and main.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    main.send_signal(signal.SIGINT)
    _, said = main.communicate(timeout=60)
    assert main.returncode == 130
    assert "--resume goes on with the batch" in said
    assert "Traceback" not in said
    assert os.listdir(out / "runs") == ["loop"]
    assert [name for name in os.listdir(tmp_path) if name.startswith(".")] == []


def test_what_hangs_is_stopped(walks: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    index = batch([pipe, walks / "prose.csv"], out=tmp_path / "b", workers=2, timeout_s=1.5, recording=False)
    assert list(index["cause"]) == ["time-out", "data"]
    assert index["reason"][0] == "not done after 1.5 s, and stopped"


def test_a_log_that_does_not_walk_has_a_recording_too_only_if_wanted(walks: Path, tmp_path: Path) -> None:
    index = batch(walks / "loop.csv", out=tmp_path / "b", workers=0)
    recording = tmp_path / "b" / index["run"][0] / "recording.rrd"
    assert recording.stat().st_size > 10_000
    recording.write_bytes(recording.read_bytes()[:5000])
    batch(walks / "loop.csv", out=tmp_path / "b", workers=0, resume=True)
    assert recording.stat().st_size > 10_000


def refused(out: Path, logs: Sequence[Path | str], words: str, **options: object) -> None:
    with pytest.raises(ConfigError, match=words):
        batch([str(log) for log in logs], out=out, workers=0, **options)  # type: ignore[arg-type]


def test_places_that_are_not_for_a_batch(walks: Path, two_workers: Path, tmp_path: Path) -> None:
    logs = [walks / "loop.csv"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    refused(tmp_path / "mine", logs, "exists and is not a batch")
    refused(two_workers, logs, "holds a batch; --resume goes on with it")
    refused(two_workers, logs, "begun with another --set", resume=True, recording=False, overrides=["steps.min_run=5"])
    refused(two_workers, logs, "begun with another --recording", resume=True)
    refused(walks / "loop.csv", logs, "is a file")
    refused(tmp_path / "new", (), "no logs")
    refused(tmp_path / "new", [walks / "nowhere.csv"], "no such file or folder")
    refused(tmp_path / "new", [f"{walks}/no*.xyz"], "no file matches")
    refused(tmp_path / "new", logs, "unknown key|no such|expected", overrides=["steps.nonsense=1"])
    refused(tmp_path / "new", logs, "unknown option 'colour'", colour="red")
    assert not (tmp_path / "new").exists()


def test_the_command_tells_what_became_of_them(walks: Path, tmp_path: Path) -> None:
    logs = [walks / "loop.csv", walks / "loop_truth.csv", walks / "empty.csv", walks / "prose.csv"]
    ended = fbgraph("batch", *logs, "--out", tmp_path / "b", "--no-recording", "--workers", 0, code=3)
    assert re.match(r"3 logs: 1 done \(1 (sound|doubtful)\), 2 failed\n", ended.stdout)
    assert "1 scored: RMSE median 0." in ended.stdout
    assert "failed, data: 2; first empty: " in ended.stdout
    assert "1 log has truth beside, called NAME_truth" in ended.stderr
    assert "2 of 3 logs failed" in ended.stderr
    again = fbgraph("batch", "--out", tmp_path / "b", "--no-recording", "--workers", 0, "--resume", "--json", code=3)
    said = json.loads(again.stdout)
    assert (said["logs"], said["done"], said["failed"], said["kept"]) == (3, 1, 2, 1)
    assert [one["name"] for one in said["failures"]] == ["empty", "prose"]


def test_from_python_too_what_cannot_be_meant_is_told_before_anything_is_written(walks: Path, tmp_path: Path) -> None:
    for options, words in (
        (BatchOptions(building_axis="rubbish"), "rubbish"),
        (BatchOptions(building=str(tmp_path / "nowhere.toml")), "nowhere"),
        (BatchOptions(use_gnss="none at all"), "gnss"),
    ):
        with pytest.raises(ConfigError, match=words):
            run_batch([str(walks)], str(tmp_path / "out"), options)
    assert not (tmp_path / "out").exists()
