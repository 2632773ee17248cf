"""A log that comes through a pipe gives the walk of the file; ``--max-size`` reaches whoever reads."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.commands import fbgraph, fbgraph_process


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated M5StickC log; do not write here."""
    folder = tmp_path_factory.mktemp("walk")
    fbgraph("simulate", folder / "walk.csv", "--route", "square", "--seed", 3)
    return folder / "walk.csv"


@pytest.mark.parametrize("command", ["smooth", "online"])
def test_standard_input_gives_the_walk_of_the_file(command: str, walk: Path, tmp_path: Path) -> None:
    fbgraph(command, walk, "--out", tmp_path / "file", "--no-recording")
    fbgraph_process(command, "/dev/stdin", "--out", tmp_path / "pipe", "--no-recording", stdin=walk.read_text())
    for name in ("smoothed.tum", "breadcrumbs.csv"):
        assert (tmp_path / "pipe" / name).read_bytes() == (tmp_path / "file" / name).read_bytes()
    summary = json.loads((tmp_path / "pipe" / "summary.json").read_text())
    assert summary["inputs"]["log"] is None
    assert summary["log"]["name"] == "stdin"
    again = fbgraph("record", tmp_path / "pipe", code=3)
    assert "smooth the log again" in again.stderr
    other = fbgraph_process("smooth", "/dev/stdin", "--out", tmp_path / "pipe", stdin=walk.read_text(), code=2)
    assert "--force replaces it" in other.stderr  # nobody knows whether it is the same log


def test_a_named_pipe_as_log_and_one_as_truth(walk: Path, tmp_path: Path) -> None:
    truth = walk.with_name("walk_truth.csv")
    fbgraph("smooth", walk, "--truth", truth, "--out", tmp_path / "file", "--no-recording")
    writers = []
    for name, source in (("log", walk), ("truth", truth)):
        os.mkfifo(tmp_path / name)
        code = "import sys; open(sys.argv[2], 'wb').write(open(sys.argv[1], 'rb').read())"
        writers.append(subprocess.Popen([sys.executable, "-c", code, source, tmp_path / name]))
    options = ("--truth", tmp_path / "truth", "--out", tmp_path / "pipe", "--no-recording")
    fbgraph("smooth", tmp_path / "log", *options)
    assert [writer.wait(timeout=10) for writer in writers] == [0, 0]
    noted = json.loads((tmp_path / "pipe" / "summary.json").read_text())["inputs"]
    assert (noted["log"], noted["truth"]) == (None, None)
    scores = [json.loads((tmp_path / run / "summary.json").read_text())["estimators"] for run in ("file", "pipe")]
    assert scores[0] == scores[1]


@pytest.mark.parametrize("aid", ["truth", "anchors"])
def test_a_run_told_of_places_through_a_pipe_is_not_made_again_without_them(
    aid: str, walk: Path, tmp_path: Path
) -> None:
    places = "t_s,x_m,y_m\n6,0,0\n20,10,5\n"
    fbgraph_process("smooth", walk, f"--{aid}", "/dev/stdin", "--out", tmp_path / "run", "--no-recording", stdin=places)
    noted = json.loads((tmp_path / "run" / "summary.json").read_text())["inputs"]
    assert (noted["log"], noted[aid], noted["piped"]) == (str(walk), None, [aid])
    told = fbgraph("record", tmp_path / "run", code=3).stderr
    assert f"its {aid} came through a pipe and cannot be read again; smooth the log again, with a file" in told
    assert told.count("\n") == 1


def test_empty_standard_input_and_devices_are_told(tmp_path: Path) -> None:
    assert "is empty" in fbgraph_process("smooth", "/dev/stdin", "--out", tmp_path / "run", stdin="", code=3).stderr
    assert "is a device" in fbgraph("smooth", "/dev/zero", "--out", tmp_path / "run", code=3).stderr
    assert "is a device" in fbgraph("study", "/dev/zero", "--out", tmp_path / "run", code=3).stderr
    assert "is a device" in fbgraph("smooth", "/dev/null", "--config", "/dev/zero", code=2).stderr


@pytest.mark.parametrize("command", ["smooth", "online", "study"])
def test_max_size_reaches_whoever_reads(command: str, walk: Path, tmp_path: Path) -> None:
    told = fbgraph(command, walk, "--out", tmp_path / "run", "--max-size", "100K", code=3).stderr
    assert "KiB or more, the limit is 100 KiB; --max-size SIZE allows more" in told
    assert "expected a size" in fbgraph(command, walk, "--out", tmp_path / "run", "--max-size", "much", code=2).stderr
    assert not (tmp_path / "run").exists()


def test_a_run_is_made_again_within_the_size_that_was_told(walk: Path, tmp_path: Path) -> None:
    fbgraph("smooth", walk, "--out", tmp_path / "run", "--no-recording", "--max-size", "2G")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["inputs"]["max_size"] == 2 << 30
    fbgraph("record", tmp_path / "run")
