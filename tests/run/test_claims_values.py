"""Which folders a run may replace: every rule from both sides; nobody writes to a place that another holds."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from fbgraph.core.config import Config, GraphConfig, dump_toml
from fbgraph.core.errors import ConfigError
from fbgraph.run.folder import RAW, claimed_live, claimed_run, require_replaceable
from fbgraph.run.inputs import RunInputs

INPUTS = RunInputs(log="/logs/walk.csv")
CONFIG = Config()
OTHER_CONFIG = Config(graph=GraphConfig(sigma_mag_rad=0.123))
WHOLE = {"fbgraph": "1.0", "inputs": {"log": "/logs/walk.csv"}}


def a_run(place: Path, summary: object = WHOLE, files: Mapping[str, str] | None = None) -> Path:
    """A run folder as far as its claims look into it."""
    place.mkdir(parents=True)
    (place / "summary.json").write_text(json.dumps(summary))
    (place / "config.toml").write_text(dump_toml(CONFIG))
    for name, text in (files or {}).items():
        (place / name).write_text(text)
    return place


def replaced(place: Path, made_by: tuple[RunInputs, Config] | None = (INPUTS, CONFIG), force: bool = False) -> None:
    """Make another run there."""
    with claimed_run(place, made_by, force) as claim, claim.written() as folder:
        (folder / "summary.json").write_text('"new"')


def refused(
    place: Path, why: str, made_by: tuple[RunInputs, Config] | None = (INPUTS, CONFIG), force: bool = False
) -> None:
    """Nothing of what is there changes."""
    before = contents(place)
    with pytest.raises(ConfigError, match=why):
        replaced(place, made_by, force)
    assert contents(place) == before
    assert not list(place.parent.glob(".*fbgraph*"))


def contents(place: Path) -> object:
    if not place.is_dir():
        return place.read_bytes() if place.is_file() else None
    return {path.name: path.read_bytes() for path in place.iterdir()}


def test_nothing_and_an_empty_folder_become_a_run(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("empty", "new", "far/away"):
        replaced(tmp_path / name)
        assert contents(tmp_path / name) == {"summary.json": b'"new"'}


def test_a_run_of_the_same_log_and_configuration_is_replaced(tmp_path: Path) -> None:
    run = a_run(tmp_path / "run", files={"ekf.tum": "", "recording.rrd": "", RAW: ""})
    replaced(run)
    assert contents(run) == {"summary.json": b'"new"'}
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_the_run_of_another_log_needs_force(tmp_path: Path) -> None:
    run, other = a_run(tmp_path / "run"), (RunInputs(log="/logs/other.csv"), CONFIG)
    refused(run, r"run: holds the run of /logs/walk\.csv; name another, or --force replaces it", other)
    replaced(run, other, force=True)
    replaced(a_run(tmp_path / "any"), None)  # who does not care what it was made from
    for number, summary in enumerate(({"fbgraph": "1.0"}, {"fbgraph": "1.0", "inputs": {"log": None}})):
        pipe = a_run(tmp_path / str(number), summary)
        refused(pipe, "holds the run of a log that was no file; name another, or --force")
        replaced(pipe, (INPUTS, CONFIG), force=True)


def test_a_run_with_another_configuration_needs_force(tmp_path: Path) -> None:
    run = a_run(tmp_path / "run")
    refused(run, "run: holds a run with another configuration; name another, or --force", (INPUTS, OTHER_CONFIG))
    replaced(run, (INPUTS, OTHER_CONFIG), force=True)
    (a_run(tmp_path / "lost") / "config.toml").unlink()
    refused(tmp_path / "lost", "holds a run with another configuration")
    replaced(tmp_path / "lost", force=True)


@pytest.mark.parametrize("force", [False, True])
def test_what_is_no_run_is_never_replaced(tmp_path: Path, force: bool) -> None:
    run = a_run(tmp_path / "run", files={"thesis.doc": "mine"})
    refused(run, "run: exists and is not a run folder; name another, or remove it", force=force)
    (tmp_path / "file").write_text("mine")
    refused(tmp_path / "file", "file: exists and is not a run folder", force=force)
    (tmp_path / "link").symlink_to(tmp_path / "file")
    refused(tmp_path / "link", "exists and is not a run folder", force=force)
    live = a_run(tmp_path / "live", files={RAW: "t_ms"})
    refused(live, r"live: holds raw\.csv, the only copy of a live walk; name another folder", force=force)


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("summary", [None, [], 5, {}, {"fbgraph": 1}, {"fbgraph": "1.0", "inputs": "x"}])
def test_what_holds_no_whole_run_is_never_replaced(tmp_path: Path, summary: object, force: bool) -> None:
    run = a_run(tmp_path / "run", summary)
    refused(run, "run: exists and holds no whole run; name another, or remove it", force=force)
    for text in ("", "{"):
        (run / "summary.json").write_text(text)
        refused(run, "holds no whole run", force=force)
    (run / "summary.json").unlink()
    (run / "ekf.tum").write_text("old")
    refused(run, "holds no whole run", force=force)


def test_a_live_walk_of_which_nothing_came_may_be_replaced(tmp_path: Path) -> None:
    place = tmp_path / "run"
    place.mkdir()
    for name in (RAW, "config.toml", ".run.fbgraph-lock"):
        (place / name).write_text("")
        require_replaceable(place, (INPUTS, CONFIG))
    replaced(place)
    assert contents(place) == {"summary.json": b'"new"'}


def test_what_came_meanwhile_stays(tmp_path: Path) -> None:
    """The place is looked at again just before it is replaced."""
    place = tmp_path / "run"

    def too_late() -> None:
        with claimed_run(place) as claim, claim.written():
            place.mkdir()
            (place / "thesis.doc").write_text("mine")

    with pytest.raises(ConfigError, match="is not a run folder"):
        too_late()
    assert contents(place) == {"thesis.doc": b"mine"}


def test_a_run_that_breaks_off_leaves_the_old_one(tmp_path: Path) -> None:
    run = a_run(tmp_path / "run")
    before = contents(run)

    def half() -> None:
        with claimed_run(run) as claim, claim.written() as folder:
            (folder / "summary.json").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert contents(run) == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_a_live_walk_begins_in_an_empty_folder_and_keeps_its_lines(tmp_path: Path) -> None:
    with claimed_live(tmp_path / "live", resume=False) as claim:
        assert contents(claim.place) == {}
        (claim.place / RAW).write_text("lines")
        with claim.written() as folder:
            (folder / "summary.json").write_text("{}")
        assert contents(claim.place) == {"summary.json": b"{}", RAW: b"lines"}


def test_a_live_walk_lets_a_finished_run_go_only_with_force(tmp_path: Path) -> None:
    run = a_run(tmp_path / "run")
    with (
        pytest.raises(ConfigError, match=r"--out .*run: holds a finished run; name another folder, or --force lets it"),
        claimed_live(run, resume=False),
    ):
        raise AssertionError
    assert len(list(run.iterdir())) == 2
    with claimed_live(run, resume=False, force=True) as claim:
        assert contents(claim.place) == {}


@pytest.mark.parametrize("force", [False, True])
def test_a_live_walk_never_lets_another_go(tmp_path: Path, force: bool) -> None:
    live = a_run(tmp_path / "live", files={RAW: "t_ms"})
    with (
        pytest.raises(ConfigError, match=r"holds raw\.csv, the only copy of a live walk"),
        claimed_live(live, resume=False, force=force),
    ):
        raise AssertionError
    assert (live / RAW).read_text() == "t_ms"


def test_only_a_live_walk_is_gone_on_with(tmp_path: Path) -> None:
    place = tmp_path / "live"
    for there in ((), (RAW,), ("config.toml", "summary.json")):
        for name in there:
            place.mkdir(exist_ok=True)
            (place / name).write_text("x")
        with (
            pytest.raises(ConfigError, match=r"--resume .*live: no raw\.csv and config\.toml there, so no walk"),
            claimed_live(place, resume=True),
        ):
            raise AssertionError
        for name in there:
            (place / name).unlink()
    (place / RAW).write_text("lines")
    (place / "config.toml").write_text("")
    with claimed_live(place, resume=True) as claim:
        assert (claim.place / RAW).read_text() == "lines"
    (place / "summary.json").write_text("{}")
    for option in ("--resume", "--finish"):
        with (
            pytest.raises(ConfigError, match=rf"{option} .*live: that walk was finished; begin another with --out"),
            claimed_live(place, resume=True, option=option),
        ):
            raise AssertionError
    (place / "summary.json").unlink()
    (place / RAW).unlink()  # killed before its first byte
    with claimed_live(place, resume=True) as claim:
        assert (claim.place / RAW).read_text() == ""


def test_two_claims_of_one_place_are_one_too_many(tmp_path: Path) -> None:
    place = tmp_path / "run"
    held = f"run: another fbgraph \\(process {os.getpid()}\\) is writing there; wait, or name another"
    with claimed_run(place):
        with pytest.raises(ConfigError, match=held), claimed_run(place):
            raise AssertionError
        with pytest.raises(ConfigError, match=held), claimed_live(tmp_path / "x" / ".." / "run", resume=False):
            raise AssertionError
        with claimed_run(tmp_path / "other"):
            pass
    replaced(place)


def test_a_claim_of_another_process_is_named(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom pathlib import Path\nfrom fbgraph.run.folder import claimed_run\n"
        "with claimed_run(Path(sys.argv[1])):\n    print('held', flush=True)\n    input()\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "run")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with (
            pytest.raises(ConfigError, match=f"another fbgraph \\(process {other.pid}\\)"),
            claimed_run(tmp_path / "run"),
        ):
            raise AssertionError
        other.kill()
    replaced(tmp_path / "run")
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_what_a_dead_process_left_vanishes_at_the_next_claim(tmp_path: Path) -> None:
    run = a_run(tmp_path / "run")
    (tmp_path / ".run.fbgraph-lock").write_text("99999999\n")
    for name in (".run.fbgraph-abc", ".run.fbgraph-old", ".other.fbgraph-abc", ".run2.fbgraph-abc", "run.fbgraph-abc"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "half").write_text("")
    with claimed_run(run):
        there = {path.name for path in tmp_path.iterdir()}
    assert there == {"run", ".run.fbgraph-lock", ".other.fbgraph-abc", ".run2.fbgraph-abc", "run.fbgraph-abc"}
    assert not (tmp_path / ".run.fbgraph-lock").exists()
    assert len(list(run.iterdir())) == 2


def test_what_a_dead_process_had_set_aside_is_put_back(tmp_path: Path) -> None:
    a_run(tmp_path / ".run.fbgraph-old")
    with claimed_run(tmp_path / "run", (INPUTS, CONFIG)) as claim:
        assert (claim.place / "summary.json").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    a_run(tmp_path / ".run.fbgraph-old", files={"ekf.tum": ""})
    with claimed_run(tmp_path / "run"):
        assert not (tmp_path / "run" / "ekf.tum").exists()


def test_no_run_takes_the_place_of_the_current_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "a" / "b"
    here.mkdir(parents=True)
    monkeypatch.chdir(here)
    for place in (".", "..", "../..", "new/..", here, tmp_path, "/"):
        why = f"^{Path(place)}: that is the current folder or one above it; name a folder of its own"
        with pytest.raises(ConfigError, match=why), claimed_run(Path(place)):
            raise AssertionError
        with pytest.raises(ConfigError, match=why), claimed_live(Path(place), resume=False):
            raise AssertionError
    replaced(Path("../c"))
    assert contents(tmp_path / "a" / "c") == {"summary.json": b'"new"'}
    assert not list(tmp_path.rglob(".*fbgraph*"))
