import gzip
import os
import zipfile
from pathlib import Path

import pytest

from fbgraph.batches.log_entry import LogEntry
from fbgraph.batches.manifest import is_manifest, manifest_text, read_manifest
from fbgraph.batches.which_logs import find_logs, named_entries
from fbgraph.core.errors import ConfigError, DataError

ALONE = "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n" + "".join(f"{10 * k},0,0,1,0,0,{k}\n" for k in range(20))
ACC = "time,seconds_elapsed,z,y,x\n" + "".join(f"{k},{0.01 * k:.2f},9.8,0.1,{k}\n" for k in range(20))


def write(folder: Path, *names: str, text: str = ALONE) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def found(*named: object) -> list[str]:
    return [entry.log for entry in find_logs([str(one) for one in named])]


def below(folder: Path, *named: object) -> list[str]:
    return [str(Path(log).relative_to(folder)) for log in found(*named)]


def test_a_folder_of_walks_is_many_logs_in_natural_order(tmp_path: Path) -> None:
    write(tmp_path, "walk10.csv", "walk2.csv", "deep/er/walk1.csv", ".hidden.csv", "notes.md", "LICENSE", "README.txt")
    (tmp_path / "more.txt.gz").write_bytes(gzip.compress(ALONE.encode()))
    (tmp_path / "broken.csv").touch()
    os.mkfifo(tmp_path / "pipe.csv")  # nobody waits for it here
    there = ["broken.csv", "deep/er/walk1.csv", "more.txt.gz", "pipe.csv", "walk2.csv", "walk10.csv"]
    assert below(tmp_path, tmp_path) == there
    assert below(tmp_path, f"{tmp_path}/walk*.csv") == ["walk2.csv", "walk10.csv"]
    assert below(tmp_path, f"{tmp_path}/**/walk1*.csv") == ["deep/er/walk1.csv", "walk10.csv"]
    assert below(tmp_path, tmp_path / "walk10.csv", tmp_path, f"file://{tmp_path}/walk2.csv")[0] == "walk10.csv"
    assert len(below(tmp_path, tmp_path / "walk10.csv", tmp_path, f"file://{tmp_path}/walk2.csv")) == len(there)


def test_a_folder_with_a_file_a_sensor_is_one_log(tmp_path: Path) -> None:
    for trial in ("a", "b"):
        write(tmp_path, f"{trial}/TotalAcceleration.csv", f"{trial}/Gyroscope.csv", text=ACC)
    assert below(tmp_path, tmp_path) == ["a", "b"]
    assert below(tmp_path, tmp_path / "a") == ["a"]
    with zipfile.ZipFile(tmp_path / "c.zip", "w") as archive:
        archive.write(tmp_path / "a" / "TotalAcceleration.csv", "TotalAcceleration.csv")
        archive.write(tmp_path / "a" / "Gyroscope.csv", "Gyroscope.csv")
    assert below(tmp_path, tmp_path) == ["a", "b", "c.zip"]


def test_a_run_in_the_folder_is_no_log(tmp_path: Path) -> None:
    write(tmp_path, "walk.csv", "run/breadcrumbs.csv", "run/raw.csv", "run/summary.json")
    write(tmp_path, "batch/manifest.csv", "batch/index.csv", "batch/options.json", "batch/runs/walk/raw.csv")
    assert below(tmp_path, tmp_path) == ["walk.csv"]


def test_a_zip_of_walks_is_many_logs(tmp_path: Path) -> None:
    write(tmp_path, "one.csv")
    with zipfile.ZipFile(tmp_path / "trials.zip", "w") as archive:
        for name in ("t/walk10.csv", "t/walk2.csv", "t/picture.png", "t/walk2_truth.csv"):
            archive.writestr(name, ALONE)
    zipped = f"::{tmp_path}/trials.zip"
    entries = find_logs([str(tmp_path / "trials.zip")])
    assert [entry.log for entry in entries] == [f"zip://t/walk2.csv{zipped}", f"zip://t/walk10.csv{zipped}"]
    assert [entry.truth for entry in entries] == [f"zip://t/walk2_truth.csv{zipped}", None]
    assert [entry.name for entry in named_entries(entries)] == ["walk2", "walk10"]
    with zipfile.ZipFile(tmp_path / "single.zip", "w") as archive:
        archive.writestr("walk.csv", ALONE)
    assert below(tmp_path, tmp_path / "single.zip") == ["single.zip"]


def test_truth_beside_a_log_is_told(tmp_path: Path) -> None:
    write(tmp_path, "walk.csv", "walk_truth.csv", "lonely_truth.csv")
    said: list[str] = []
    entries = find_logs([str(tmp_path)], said.append)
    assert [(Path(e.log).name, e.truth and Path(e.truth).name) for e in entries] == [
        ("lonely_truth.csv", None),
        ("walk.csv", "walk_truth.csv"),
    ]
    assert find_logs([str(tmp_path / "walk.csv")]) == entries[1:]
    assert said == ["1 log has truth beside, called NAME_truth; that is not a log"]


def test_a_manifest_names_what_belongs_to_each_log(tmp_path: Path) -> None:
    write(tmp_path, "a.csv", "b.csv")
    manifest = tmp_path / "walks.csv"
    manifest.write_text('\ufeffLog, config ,truth,name\na.csv,phone,t/a.csv,first\n\n"s3://b/c,d.csv",mine.toml,,\n')
    assert is_manifest(manifest)
    assert not is_manifest(tmp_path / "a.csv")
    entries = find_logs([str(manifest)])
    assert entries == [
        LogEntry(f"{tmp_path}/a.csv", "first", f"{tmp_path}/t/a.csv", None, "phone"),
        LogEntry("s3://b/c,d.csv", "", None, None, f"{tmp_path}/mine.toml"),
    ]
    again = tmp_path / "again.csv"
    again.write_text(manifest_text(entries))
    assert read_manifest(again) == entries


@pytest.mark.parametrize("mark", [";", "\t"])
def test_a_manifest_as_spreadsheets_write_it(tmp_path: Path, mark: str) -> None:
    write(tmp_path, "a,b.csv")
    manifest = tmp_path / "walks.csv"
    manifest.write_text(f"\ufefflog{mark}name\r\na,b.csv{mark}first\r\n")
    assert find_logs([str(manifest)]) == [LogEntry(f"{tmp_path}/a,b.csv", "first")]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("log,truth\na.csv,t.csv,more\n", "line 2: more fields than the first line names"),
        ("log,truth\n,t.csv\n", "line 2: no log; write its path"),
        ('log\na.csv\n"b.csv\n', "after line 2: unexpected end of data"),
        ("log,name\na.csv,../../etc\n", "line 2: name '../../etc': expected what a folder can be called"),
        ("log,name\na.csv,.ssh\n", "line 2: name '.ssh'"),
        ("log,name\na.csv,\x1b[2J\n", r"line 2: name '\\x1b\[2J'"),
    ],
)
def test_a_manifest_that_is_wrong(tmp_path: Path, text: str, words: str) -> None:
    manifest = tmp_path / "walks.csv"
    manifest.write_text(text)
    with pytest.raises((ConfigError, DataError), match=words):
        find_logs([str(manifest)])


def names(*logs: str, before: tuple[LogEntry, ...] = ()) -> list[str]:
    return [entry.name for entry in named_entries([LogEntry(log) for log in logs], before)]


def test_names_are_distinct_and_do_not_depend_on_the_order() -> None:
    a, b, c = names("/x/walk.csv", "/y/Walk.csv.gz", "/x/other.txt")
    assert c == "other"
    assert len({a.casefold(), b.casefold()}) == 2
    assert a.startswith("walk-")
    assert b.startswith("Walk-")
    assert names("/y/Walk.csv.gz", "/x/other.txt", "/x/walk.csv") == [b, c, a]
    twice = named_entries([LogEntry("/x/walk.csv"), LogEntry("/x/walk.csv", config="phone")])
    assert len({entry.name for entry in twice}) == 2


def test_who_had_a_name_keeps_it() -> None:
    before = tuple(named_entries([LogEntry("/x/walk.csv")]))
    assert before[0].name == "walk"
    first, second = names("/x/walk.csv", "/y/walk.csv", before=before)
    assert first == "walk"
    assert second.startswith("walk-")
    assert names("/y/walk.csv", before=before) == [second] or names("/y/walk.csv", before=before)[0] != "walk"


def test_names_are_those_that_folders_can_have() -> None:
    odd = names("/x/a\x1b[2J.csv", "/x/" + "y" * 240 + ".csv", "/x/...", "/x/con:1.csv", "/x/\udcff.csv")
    for name in odd:
        assert name.isprintable()
        assert len(name.encode()) <= 110
        assert not name.startswith(".")
        assert not set(name) & set('/\\:*?"<>|')
    assert len(set(odd)) == 5


def test_two_logs_of_one_given_name_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"two logs are to be called 'a': /x/1\.csv and /x/2\.csv"):
        named_entries([LogEntry("/x/1.csv", "a"), LogEntry("/x/2.csv", "A")])


@pytest.mark.parametrize("packing", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_a_damaged_entry_of_a_zip_of_walks_stops_no_other(tmp_path: Path, packing: int) -> None:
    path = tmp_path / "walks.zip"
    with zipfile.ZipFile(path, "w", packing) as archive:
        for name in ("a.csv", "b.csv", "c.csv"):
            archive.writestr(name, ALONE * 200)
    with zipfile.ZipFile(path) as archive:
        info = archive.getinfo("a.csv")
    damaged = bytearray(path.read_bytes())
    begin = info.header_offset + 30 + len(info.filename)
    for at in range(begin + 8, begin + info.compress_size):
        damaged[at] ^= 0xFF
    path.write_bytes(bytes(damaged))
    assert [Path(one.log.partition("::")[0]).name for one in find_logs([str(path)], lambda text: None)] == [
        "a.csv",
        "b.csv",
        "c.csv",
    ]
