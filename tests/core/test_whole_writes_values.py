"""Files and folders appear whole or not at all."""

from pathlib import Path

import pytest

from fbgraph.core.errors import ConfigError
from fbgraph.core.whole_writes import (
    clear_leftovers_in,
    is_leftover,
    locked,
    real_place,
    whole_file,
    whole_files,
    whole_folder,
)


class BreakOffError(Exception):
    """Something in the middle of writing."""


def break_off(partial: Path) -> None:
    partial.write_text("half")
    raise BreakOffError


def test_a_file_replaces_the_old_one_when_all_is_written(tmp_path: Path) -> None:
    path = tmp_path / "new" / "walk.csv"
    for text in ("one", "two"):
        with whole_file(path, make_parents=True) as partial:
            partial.write_text(text)
            assert not path.exists() or path.read_text() == "one"
            assert partial.name == path.name
        assert path.read_text() == text
    assert [p.name for p in path.parent.iterdir()] == ["walk.csv"]


def test_a_file_that_is_not_finished_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("old")
    with pytest.raises(BreakOffError), whole_file(path) as partial:
        break_off(partial)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_belongs_to_a_file_never_stands_beside_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Walk and truth, at every instant: both old, the old or new walk alone, both new."""
    walk, truth = tmp_path / "walk.csv", tmp_path / "truth.csv"
    seen: list[list[str]] = []

    def look(path: Path) -> None:
        seen.append([p.read_text() if p.exists() else "" for p in (walk, truth)])

    monkeypatch.setattr("fbgraph.core.whole_writes._sync", look)
    for text in ("old", "new"):
        with whole_files((walk, truth)) as partials:
            for partial in partials:
                partial.write_text(text)
    states = [["", ""], ["old", ""], ["old", "old"], ["old", ""], ["new", ""], ["new", "new"]]
    assert [state for i, state in enumerate(seen) if state != seen[i - 1] or not i] == states
    assert sorted(tmp_path.iterdir()) == [truth, walk]


def test_of_two_files_none_is_replaced_when_one_is_not_finished(tmp_path: Path) -> None:
    walk, truth = tmp_path / "walk.csv", tmp_path / "truth.csv"
    for path in (walk, truth):
        path.write_text("old")
    with pytest.raises(BreakOffError), whole_files((walk, truth)) as partials:
        break_off(partials[1])
    assert [path.read_text() for path in (walk, truth)] == ["old", "old"]
    assert sorted(tmp_path.iterdir()) == [truth, walk]


def test_a_lock_that_cannot_be_removed_is_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "walk.csv"
    with monkeypatch.context() as disk:

        def unlink(path: Path, missing_ok: bool = False) -> None:
            raise OSError(5, "Input/output error")

        disk.setattr(Path, "unlink", unlink)
        with whole_file(path) as partial:
            partial.write_text("text")
    assert path.read_text() == "text"
    with whole_file(path) as partial:
        partial.write_text("more")
    assert list(tmp_path.iterdir()) == [path]


def test_a_mistyped_folder_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot write there"), whole_file(tmp_path / "no" / "walk.csv"):
        pass
    assert not list(tmp_path.iterdir())


def test_a_folder_replaces_the_old_one_but_for_what_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "run"
    out.mkdir()
    for name in ("raw.csv", "old.tum", "both.txt"):
        (out / name).write_text("old")
    with whole_folder(out, keep=("raw.csv", "both.txt", "never.was")) as partial:
        (partial / "new.tum").write_text("new")
        (partial / "both.txt").write_text("new")
        assert (out / "old.tum").exists()
    assert {p.name: p.read_text() for p in out.iterdir()} == {"raw.csv": "old", "new.tum": "new", "both.txt": "new"}
    assert list(tmp_path.iterdir()) == [out]
    assert out.stat().st_mode & 0o777 == 0o755


def test_a_folder_that_is_not_finished_leaves_the_old_one(tmp_path: Path) -> None:
    out = tmp_path / "run"
    out.mkdir()
    (out / "raw.csv").write_text("old")
    with pytest.raises(BreakOffError), whole_folder(out) as partial:
        break_off(partial / "raw.csv")
    assert (out / "raw.csv").read_text() == "old"
    assert list(tmp_path.iterdir()) == [out]


def test_where_nothing_can_be_written_that_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for whole in (whole_file, whole_folder):
        with pytest.raises(ConfigError, match=r"file/walk: cannot write there: "), whole(tmp_path / "file" / "walk"):
            raise AssertionError("never entered")
    (tmp_path / "folder").mkdir()
    with (
        pytest.raises(ConfigError, match="folder: cannot write there: Is a directory"),
        whole_file(tmp_path / "folder") as partial,
    ):
        partial.write_text("text")


@pytest.mark.parametrize("offered", [True, False])
def test_one_folder_takes_the_place_of_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, offered: bool) -> None:
    """In one step, or in three where the system cannot exchange two."""
    if not offered:
        monkeypatch.setattr("sys.platform", "other")
    out = tmp_path / "run"
    out.mkdir()
    (out / "old").write_text("old")
    with whole_folder(out) as partial:
        (partial / "new").write_text("new")
    assert [path.name for path in out.iterdir()] == ["new"]
    assert list(tmp_path.iterdir()) == [out]


def test_what_must_stay_is_looked_at_first_and_last(tmp_path: Path) -> None:
    looked: list[Path] = []
    with whole_folder(tmp_path / "a" / ".." / "run", check=looked.append):
        assert looked == [tmp_path / "run"]
    assert looked == [tmp_path / "run"] * 2


def test_a_file_that_another_holds_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    with locked(path) as place:
        assert place == path
        with (
            pytest.raises(ConfigError, match=r"walk\.csv: another fbgraph \(process \d+\) is writing there"),
            whole_file(path),
        ):
            raise AssertionError("never entered")
    with whole_file(path) as partial:
        partial.write_text("text")
    assert list(tmp_path.iterdir()) == [path]


def test_links_and_dots_are_followed(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "there")
    assert real_place(tmp_path / "link" / "run") == tmp_path / "there" / "run"
    assert real_place(tmp_path / "no" / ".." / "run") == tmp_path / "run"
    for place in (Path(), Path(".."), Path("/"), Path.cwd()):
        with pytest.raises(ConfigError, match="that is the current folder or one above it; name a folder of its own"):
            real_place(place)


def test_leftovers_are_known_by_their_names() -> None:
    assert [is_leftover(name) for name in (".run.fbgraph-lock", ".run.fbgraph-x1", "run.fbgraph-x1", ".run")] == [
        *(True, True, False, False)
    ]


def test_leftovers_in_a_folder_go_but_for_what_is_held_and_what_was_set_aside_comes_back(tmp_path: Path) -> None:
    for name in (".gone.fbgraph-old", ".torn.fbgraph-x1", ".busy.fbgraph-x2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(name)
    (tmp_path / "torn").mkdir()
    with locked(tmp_path / "busy"):
        (tmp_path / ".busy.fbgraph-x3").mkdir()
        clear_leftovers_in(tmp_path)
        assert (tmp_path / ".busy.fbgraph-x3").is_dir()
        assert (tmp_path / ".busy.fbgraph-lock").is_file()
    assert (tmp_path / "gone" / "summary.json").read_text() == ".gone.fbgraph-old"
    assert not (tmp_path / ".torn.fbgraph-x1").exists()
    assert not (tmp_path / ".torn.fbgraph-lock").exists()
