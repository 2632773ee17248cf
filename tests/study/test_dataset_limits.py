"""Data sets that do harm: names that lead out of a zip, zips in zips, passwords, bombs, tables without end."""

import gzip
import zipfile
from pathlib import Path

import pytest

from fbgraph.core.bounded import MIB, MOST_COLUMNS
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.study import containers
from fbgraph.study.column_names import load_layout, load_mapping
from fbgraph.study.containers import tables_in
from fbgraph.study.course import simulated_trials, write_trial
from fbgraph.study.dataset import read_dataset

LAYOUT = load_layout("forestback")


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A simulated trial, as its CSV."""
    path = tmp_path_factory.mktemp("trial") / "trial.csv"
    ((name, walk, remark),) = simulated_trials(5, 1)
    assert name
    write_trial(walk, path, remark)
    return path.read_bytes()


def packed(path: Path, **entries: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return path


def encrypt(path: Path, name: str) -> None:
    """Mark an entry as encrypted, in its header and in the directory."""
    data = bytearray(path.read_bytes())
    for signature, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        at = -1
        while (at := data.find(signature, at + 1)) >= 0:
            length = int.from_bytes(data[at + (26 if flags == 6 else 28) : at + (28 if flags == 6 else 30)], "little")
            start = at + (30 if flags == 6 else 46)
            if data[start : start + length] == name.encode():
                data[at + flags] |= 1
    path.write_bytes(data)


def test_harmful_entries_are_left_out_with_a_reason_and_the_good_one_is_read(trial: bytes, tmp_path: Path) -> None:
    path = packed(
        tmp_path / "all.zip",
        **{
            "good.csv": trial,
            "../up.csv": trial,
            "a/../../b.csv": trial,
            "/etc/c.csv": trial,
            "C:\\d.csv": trial,
            "more.zip": b"PK\x05\x06" + b"\0" * 18,
            "secret.csv": trial,
            "bomb.csv": b"\n" * (70 * MIB),
            "inner.csv.gz": gzip.compress(b"\n" * (70 * MIB)),
            "torn.csv.gz": gzip.compress(trial)[:-100],
        },
    )
    encrypt(path, "secret.csv")
    found = read_dataset(path, LAYOUT)
    assert [trial.name for trial in found.trials] == ["good"]
    reasons = dict(found.skipped)
    for name in ("../up", "a/../../b", "/etc/c", "C:\\d"):
        assert reasons[name] == "its name leads out of the zip"
    assert reasons["more.zip"] == "a zip within the zip; unpack it first"
    assert reasons["secret"] == "encrypted; unpack it first"
    assert "the limit is 64 MiB or 100 times as much as packed" in reasons["bomb"]
    assert "the limit is 64 MiB or 100 times as much as packed" in reasons["inner"]
    assert "truncated or damaged" in reasons["torn"]
    assert not (tmp_path / "up.csv").exists()


@pytest.mark.parametrize("in_zip", [False, True])
def test_all_tables_together_are_bounded(in_zip: bool, tmp_path: Path) -> None:
    texts = {"a.csv": b"x\n" * 50, "b.csv": b"y\n" * 100, "c.csv": b"z\n" * 25}
    source = tmp_path / "set.zip" if in_zip else tmp_path
    if in_zip:
        packed(source, **texts)
    else:
        for name, data in texts.items():
            (tmp_path / name).write_bytes(data)
    assert [len(text) for _, text in tables_in(source, 350) if isinstance(text, str)] == [100, 200, 50]
    read = dict(tables_in(source, 349))
    assert isinstance(read["c"], DataError)
    assert "c: 50 bytes or more, the limit is 49 bytes; --max-size SIZE allows more" in str(read["c"])
    read = dict(tables_in(source, 299))  # what does not fit makes room for what does
    assert isinstance(read["b"], DataError)
    assert read["c"] == "z\n" * 25


def test_more_tables_than_a_data_set_has_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = packed(tmp_path / "many.zip", **{f"{k}.csv": b"x\n" for k in range(4)})
    monkeypatch.setattr(containers, "_MOST_TABLES", 4)
    assert len(list(tables_in(path))) == 4
    monkeypatch.setattr(containers, "_MOST_TABLES", 3)
    with pytest.raises(DataError, match=r"many\.zip: 4 tables, the limit is 3"):
        list(tables_in(path))


@pytest.mark.parametrize("more", [0, 1])
def test_a_table_has_4096_columns_at_most(more: int, trial: bytes, tmp_path: Path) -> None:
    lines = [line for line in trial.decode().splitlines() if not line.startswith("#")]
    extra = MOST_COLUMNS - len(lines[0].split(",")) + more
    head = lines[0] + "".join(f",c{k}" for k in range(extra))
    (tmp_path / "wide.csv").write_text("\n".join([head, *(line + "," * extra for line in lines[1:1200])]))
    if more:
        with pytest.raises(DataError, match="4097 columns, the limit is 4096"):
            read_dataset(tmp_path / "wide.csv", LAYOUT)
    else:
        assert len(read_dataset(tmp_path / "wide.csv", LAYOUT).trials) == 1


def test_an_endless_line_among_the_rows_of_a_trial_is_left_out(trial: bytes, tmp_path: Path) -> None:
    lines = trial.split(b"\n")
    lines[500:500] = [b"1," * 100_000]
    (tmp_path / "a.csv").write_bytes(b"\n".join(lines))
    (tmp_path / "b.csv").write_bytes(trial)
    a, b = read_dataset(tmp_path, LAYOUT).trials
    assert a.rows == b.rows


def test_a_mapping_of_gigabytes_or_of_no_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    with open(path, "wb") as out:
        out.truncate(1 << 32)
    with pytest.raises(ConfigError, match=r"--mapping .*: not a readable file .*4 GiB or more, the limit is 64 KiB"):
        load_mapping(path, LAYOUT)
    with pytest.raises(ConfigError, match="is a device"):
        load_mapping(Path("/dev/zero"), LAYOUT)
