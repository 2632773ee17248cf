import zipfile
from collections.abc import Iterator
from pathlib import Path

import fsspec
import pytest

from fbgraph.batches.batch import batch
from fbgraph.batches.index import read_index
from fbgraph.batches.index_row import TIMINGS
from fbgraph.batches.places import fetched, joined, last_name, names_at, put_folder, settled, version_of
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.run.read_run import read_run
from fbgraph.simulator.files import simulate_files
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate_options import SimulateOptions


@pytest.fixture
def memory() -> Iterator[fsspec.AbstractFileSystem]:
    """fsspec's file system in memory, empty."""
    system = fsspec.filesystem("memory")
    yield system
    system.store.clear()
    system.pseudo_dirs[:] = [""]


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = tmp_path_factory.mktemp("walk") / "loop.csv"
    simulate_files(log, load_route("square"), SimulateOptions(duration_s=12.0), 3)
    return log


def test_words_about_places(tmp_path: Path) -> None:
    assert settled(f"file://{tmp_path}/a%20b.csv") == f"{tmp_path}/a b.csv"
    assert settled("s3://bucket/x/../y") == "s3://bucket/x/../y"
    assert joined("memory://a/", "runs", "x") == "memory://a/runs/x"
    assert [last_name(p) for p in ("s3://b/c/d.csv", "zip://t/w.csv::/x/y.zip", "/a/b.txt")] == [
        "d.csv",
        "w.csv",
        "b.txt",
    ]


def test_memory_holds_logs_and_batch(memory: fsspec.AbstractFileSystem, walk: Path, tmp_path: Path) -> None:
    for name in ("a/loop.csv", "a/loop_truth.csv", "b/loop.csv"):
        memory.pipe(f"/logs/{name}", (walk.parent / Path(name).name).read_bytes())
    memory.pipe("/logs/bad.csv", b"nothing\n")
    there = batch("memory://logs", out="memory://out", workers=0, recording=False)
    assert list(there["log"]) == [f"memory:///logs/{name}" for name in ("a/loop.csv", "b/loop.csv", "bad.csv")]
    assert list(there["status"]) == ["done", "done", "failed"]
    assert there["reason"][2].startswith(f"{there['log'][2]}: no table in it")
    here = batch(walk, out=tmp_path / "b", workers=0, recording=False)
    same = [name for name in here.columns if name not in (*TIMINGS, "name", "log", "truth", "run")]
    assert list(map(str, there[same].iloc[0])) == list(map(str, here[same].iloc[0]))
    assert there["distance_m"][1] == there["distance_m"][0]
    assert there["checkpoints"].isna().tolist() == [False, True, True]
    assert names_at("memory://out") == {"runs", "index.parquet", "index.csv", "manifest.csv", "options.json"}
    run = read_run(fetched(f"memory://out/{there['run'][0]}", tmp_path))
    assert run.summary["inputs"]["log"] == there["log"][0]
    assert str(there["log"][0]).startswith("memory://")
    before = {path: memory.created(path) for path in memory.find("/out/runs")}
    again = batch("memory://logs", out="memory://out", workers=0, recording=False, resume=True)
    assert {path: memory.created(path) for path in memory.find("/out/runs")} == before
    assert list(again["wall_s"][[0, 1]]) == list(there["wall_s"][[0, 1]])
    memory.pipe(f"/out/{there['run'][1]}/pdr.tum", b"")
    batch("memory://logs", out="memory://out", workers=0, recording=False, resume=True)
    assert memory.size(f"/out/{there['run'][1]}/pdr.tum") > 1000
    assert list(read_index("memory://out")["log"]) == list(there["log"])


def test_memory_is_of_this_process_alone(memory: fsspec.AbstractFileSystem, walk: Path) -> None:
    with pytest.raises(ConfigError, match="is in the memory of this process alone; --workers 0"):
        batch(walk, out="memory://out", workers=2)


def test_file_addresses_are_paths(walk: Path, tmp_path: Path) -> None:
    index = batch(f"file://{walk}", out=f"file://{tmp_path}/b", workers=0, recording=False)
    assert index["log"][0] == str(walk)
    assert read_run(tmp_path / "b" / "runs" / "loop").summary["steps"] == index["steps"][0]


def test_logs_in_a_zip(walk: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "trials.zip", "w") as archive:
        archive.write(walk, "t/one.csv")
        archive.writestr("t/two.csv", walk.read_text().replace("\n", "\nbroken", 1)[:3000])
        archive.write(walk.with_name("loop_truth.csv"), "t/one_truth.csv")
    index = batch(tmp_path / "trials.zip", out=tmp_path / "b", workers=0, recording=False)
    alone = batch(walk, out=tmp_path / "c", workers=0, recording=False)
    assert list(index["status"]) == ["done", "failed"]
    assert index["smoothed_rmse_m"][0] == alone["smoothed_rmse_m"][0]
    assert f"zip://t/two.csv::{tmp_path}/trials.zip" in index["reason"][1]


def test_places_that_are_not_there(memory: fsspec.AbstractFileSystem, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"memory://nowhere/walk\.csv: no such file"):
        fetched("memory://nowhere/walk.csv", tmp_path)
    memory.pipe("/large/walk.csv", b"0" * 5000)
    with pytest.raises(DataError, match=r"memory://large/walk\.csv: 4\.883 KiB or more, the limit is 2 KiB"):
        fetched("memory://large/walk.csv", tmp_path, 2048)
    with pytest.raises(ConfigError, match="nosuch://a: "):
        fetched("nosuch://a", tmp_path)
    assert version_of("memory://nowhere/walk.csv") == ""
    assert version_of(str(tmp_path / "nowhere")) == ""
    (tmp_path / "a").write_text("1")
    before = version_of(str(tmp_path / "a"))
    (tmp_path / "a").write_text("12")
    assert version_of(str(tmp_path / "a")) != before


def test_the_summary_of_a_run_is_put_last(memory: fsspec.AbstractFileSystem, tmp_path: Path) -> None:
    for name in ("a.tum", "summary.json", "z.csv"):
        (tmp_path / name).write_text(name)
    memory.pipe("/out/run/old.tum", b"of before")
    put_folder(tmp_path, "memory://out/run", last="summary.json")
    there = sorted(memory.find("/out/run"), key=memory.created)
    assert there == ["/out/run/a.tum", "/out/run/z.csv", "/out/run/summary.json"]


def test_what_is_wrong_with_a_zip_by_its_address_is_a_line(tmp_path: Path) -> None:
    none = tmp_path / "none.zip"
    none.write_bytes(b"no zip at all")
    for place in (f"zip://a.csv::{none}",):
        with pytest.raises(DataError, match="truncated or damaged"):
            fetched(place, tmp_path)
    path = tmp_path / "torn.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.csv", "t,ax\n" * 5000)
    data = bytearray(path.read_bytes())
    data[45:60] = bytes(15)
    path.write_bytes(bytes(data))
    with pytest.raises(DataError, match="damaged"):
        fetched(f"zip://a.csv::{path}", tmp_path)
