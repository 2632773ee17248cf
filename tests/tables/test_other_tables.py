"""JSON, long format, gyroflow's and IMUtracker's logs; and what no honest input holds."""

import json
import math
import os
import struct
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.errors import DataError
from fbgraph.readers import read_log
from fbgraph.tables import read_tables
from fbgraph.tables.table import Table

DATA = Path(__file__).parents[2].parent / "shared" / "data"


def tables_of(path: Path, data: bytes | str) -> dict[str, Table]:
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return {table.name: table for table in read_tables(path).tables}


def columns(table: Table) -> dict[str, list[object]]:
    return {column.name: list(column.values.tolist()) for column in table.columns}


def test_json_gives_a_table_a_sensor(tmp_path: Path) -> None:
    rows: list[dict[str, str]] = []
    for i in range(5):
        rows.append({"sensor": "Accelerometer", "time": str(1_730_000_000_000_000_001 + i), "x": f"{i}.5", "y": "1"})
        rows.append({"sensor": "Barometer", "time": str(1_730_000_000_000_000_009 + i), "pressure": "1008.5"})
    inner = {"sensor": "accelerometer", "time": 1, "values": {"x": 0.5, "y": 2}}
    for text in (json.dumps(rows), "\n".join(map(json.dumps, rows)), "\n".join(map(json.dumps, [*rows])) + "\n{torn"):
        tables = tables_of(tmp_path / "walk.json", text)
        assert list(tables) == ["Accelerometer", "Barometer"]
        assert columns(tables["Accelerometer"])["time"] == [1_730_000_000_000_000_001 + i for i in range(5)]
        assert columns(tables["Accelerometer"])["x"] == [i + 0.5 for i in range(5)]
        assert columns(tables["Barometer"])["pressure"] == [1008.5] * 5
        assert dict(tables["Barometer"].counts) == ({"lines_unreadable": 1} if text.endswith("torn") else {})
    sent = tables_of(tmp_path / "sent.json", json.dumps({"messageId": 1, "payload": [inner, inner]}))
    assert columns(sent["accelerometer"]) == {"time": [1, 1], "x": [0.5, 0.5], "y": [2, 2]}
    with pytest.raises(DataError, match="nothing but lines of more than 64 KiB"):
        tables_of(tmp_path / "deep.json", '["' * 100_000)


def test_rows_that_name_their_sensor_are_tables(tmp_path: Path) -> None:
    rows = "".join(f"acc,{i},{i}.5,2,3\nbaro,{i},1008.5,,\n" for i in range(20))
    tables = tables_of(tmp_path / "walk.csv", "sensor,timestamp,x,y,z\n" + rows)
    assert list(tables) == ["acc", "baro"]
    assert columns(tables["acc"])["x"] == [i + 0.5 for i in range(20)]
    assert list(columns(tables["baro"])) == ["timestamp", "x"]


def test_gyroflow_says_its_scales(tmp_path: Path) -> None:
    head = "GYROFLOW IMU LOG\nversion,1.3\nid,a\norientation,YxZ\ntscale,0.001\ngscale,0.5\nascale,0.25\n"
    (table,) = tables_of(tmp_path / "a.gcsv", head + "t,gx,gy,gz,ax,ay,az\n" + "250,2,4,6,4,8,12\n" * 60).values()
    assert [(column.name, column.unit, column.values[0]) for column in table.columns] == [
        ("t", "s", 0.25),
        *(("gx", "rad/s", 1.0), ("gy", "rad/s", 2.0), ("gz", "rad/s", 3.0)),
        *(("ax", "g", 1.0), ("ay", "g", 2.0), ("az", "g", 3.0)),
    ]


def test_a_garbled_scale_or_number_of_gyroflow_is_no_warning(tmp_path: Path) -> None:
    """What cannot be a number stays none; numpy says nothing of it on the terminal."""
    head = "GYROFLOW IMU LOG\ntscale,0\ngscale,1e308\nt,gx,gy,gz\n"
    rows = "".join(f"{t},{x},2,3\n" for t, x in [("1e400", 1), (1, "1e308"), *((t, 1) for t in range(2, 60))])
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        (table,) = tables_of(tmp_path / "a.gcsv", head + rows).values()
    assert len(table) == 60
    assert columns(table)["gy"][1] == math.inf


def test_acclog_is_unpacked(tmp_path: Path) -> None:
    samples = [(4096, -4096, 8192, 16384, -16384, 0)] * 3
    head = struct.pack("<8sHQQHHHII24s", b"ACCLOG", 0x0200, 7, 5000, 128, 8, 2000, 3, 0, b"")
    (table,) = tables_of(tmp_path / "ACCLOG.BIN", head + b"".join(struct.pack(">6h", *row) for row in samples)).values()
    assert [(c.name, c.unit, c.values[1]) for c in table.columns] == [
        ("t", "s", 1 / 128),
        *(("ax", "g", 1.0), ("ay", "g", -1.0), ("az", "g", 2.0)),
        *(("gx", "dps", 1000.0), ("gy", "dps", -1000.0), ("gz", "dps", 0.0)),
    ]
    meta = struct.pack("<8sHQQHHHHHffII12s", b"ACCLOG", 0x0201, 7, 5000, 128, 8, 2000, 1, 2, 2048.0, 16.384, 3, 0, b"")
    newer = tables_of(tmp_path / "ACCLOG.BIN", meta + struct.pack(">6h", *samples[0]))["ACCLOG"]
    np.testing.assert_allclose([c.values[0] for c in newer.columns[1:]], [2, -2, 4, 1000, -1000, 0], rtol=1e-6)
    old = struct.pack("<8sHQQHHII26s", b"ACCLOG", 0x0100, 7, 5000, 200, 4, 3, 0, b"")
    oldest = tables_of(tmp_path / "ACCLOG.BIN", old + struct.pack(">3h", 8192, 0, -8192) + b"\1")["ACCLOG"]
    assert [c.values.tolist() for c in oldest.columns] == [[0.0], [1.0], [0.0], [-1.0]]
    for data, why in ((b"ACCLOG\0\0" + b"\1" * 9, "cut short"), (head[:8] + b"\1\x03" + head[10:], "version 3.1")):
        with pytest.raises(DataError, match=f"ACCLOG.BIN: .*{why}"):
            tables_of(tmp_path / "ACCLOG.BIN", data)


def zipped(path: Path, files: dict[str, str], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


TABLE = "t,x,y\n" + "1,2,3\n" * 50


@pytest.mark.parametrize("name", ["../walk.csv", "a/../../walk.csv", "/etc/walk.csv", "C:\\walk.csv", "..\\walk.csv"])
def test_a_zip_that_names_files_outside_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match="names a file outside of itself"):
        read_tables(zipped(tmp_path / "a.zip", {"walk.csv": TABLE, name: TABLE}))


def test_bombs_are_refused_and_damage_is_said(tmp_path: Path) -> None:
    bomb = zipped(tmp_path / "bomb.zip", {"walk.csv": "1,2,3\n" * 12_000_000})
    with pytest.raises(DataError, match=r"bomb.zip: .* unpack to"):
        read_tables(bomb)
    small = zipped(tmp_path / "small.zip", {f"{i}.csv": TABLE for i in range(3)})
    assert len(read_tables(small, max_size=3 * len(TABLE)).tables) == 3
    with pytest.raises(DataError, match="the limit is"):
        read_tables(small, max_size=3 * len(TABLE) - 1)
    folder = tmp_path / "folder"
    folder.mkdir()
    for i in range(3):
        (folder / f"{i}.csv").write_text(TABLE)
    assert len(read_tables(folder, max_size=3 * len(TABLE)).tables) == 3
    with pytest.raises(DataError, match="the limit is"):
        read_tables(folder, max_size=3 * len(TABLE) - 1)
    data = small.read_bytes()
    for damaged in (data[:-30], data[:40] + b"\xff" * 9 + data[49:]):
        small.write_bytes(damaged)
        with pytest.raises(DataError, match=r"small.zip: .*truncated or damaged"):
            read_tables(small)
    locked = bytearray(data)
    for mark, at in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        start = locked.find(mark)
        while start >= 0:
            locked[start + at] |= 1
            start = locked.find(mark, start + 4)
    small.write_bytes(bytes(locked))
    with pytest.raises(DataError, match="is encrypted"):
        read_tables(small)
    with pytest.raises(DataError, match="1001 files"):
        read_tables(zipped(tmp_path / "many.zip", {f"{i}.csv": "" for i in range(1001)}))


def test_what_is_left_out_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    (folder / "a" / "b").mkdir(parents=True)
    (tmp_path / "outside.csv").write_text(TABLE)
    (folder / "link.csv").symlink_to(tmp_path / "outside.csv")
    (folder / "walk.csv").write_text(TABLE)
    (folder / "empty.csv").write_text("")
    (folder / "raw.bin").write_bytes(bytes(range(256)) * 20)
    (folder / "a" / "b" / "deep.csv").write_text(TABLE)
    (folder / ".hidden.csv").write_text(TABLE)
    Path(os.fsdecode(os.fsencode(folder) + b"/w\xe4lk.csv")).write_text(TABLE)
    found = read_tables(folder)
    assert len(found.tables) == 2
    assert {(Path(source).name, why) for source, why in found.left_out} == {
        ("link.csv", "a link out of the folder"),
        ("empty.csv", "empty"),
        ("raw.bin", "a binary file"),
        ("b", "more than one folder deep"),
        (".hidden.csv", "hidden"),
    }


def test_lines_that_run_on_give_both_records(tmp_path: Path) -> None:
    path = tmp_path / "trace.txt"
    kinds = ("ACCELEROMETER", "GYROSCOPE")
    rows = [f"{1730000000000 + 10 * i}\tTYPE_{kinds[i % 2]}\t0.5\t{i / 100}\t9.5\t3" for i in range(600)]
    path.write_text("".join(row + ("" if i % 50 == 7 else "\n") for i, row in enumerate(rows)))
    log = read_log(path).log
    assert len(log.acc) == 300
    np.testing.assert_array_equal(log.acc.values[:, 1], np.arange(0, 600, 2) / 100)


@pytest.mark.skipif(not DATA.is_dir(), reason="the real logs are not beside the project")
def test_real_logs_of_every_logger_are_tables() -> None:
    rows = {
        "formats/sensorlogger_android": {"TotalAcceleration": 9333, "Metadata": 1, "Annotation": 1, "Location": 168},
        "formats/phyphox_android_nju": {"Accelerometer": 29829, "Barometer": 564},
        "formats/esp32_icm20948_gps_kris_Apache2": {"sensor": 19864, "gps_label": 420},
        "formats/m5stickc_plus_kilian_tcp": {"hammering_3_IMU_R_data": 1544},
        "ipin21/eight": {"acc": 12933, "bar": 12933, "ref": 15},
        "ridi": {"dan_leg1": 12438},
    }
    for folder, expected in rows.items():
        found = read_tables(DATA / folder)
        lengths = {table.name: len(table) for table in found.tables}
        assert expected.items() <= lengths.items()
        assert not found.left_out
        assert all(column.unreadable == 0 for table in found.tables for column in table.columns if "M5" not in folder)
    (acc,) = [table for table in read_tables(DATA / "ipin21/eight").tables if table.name == "acc"]
    assert not acc.headed
    assert acc.columns[0].values[0] == 1606391908305


CASES = DATA.parent / "cases" / "input"


@pytest.mark.skipif(not CASES.is_dir(), reason="the collected inputs are not beside the project")
def test_collected_inputs_keep_every_row_and_field() -> None:
    for folder in sorted(path for path in CASES.iterdir() if path.is_dir() and path.name != "ilc_run_on_lines"):
        for path in folder.iterdir():
            if path.name == "expected.txt":
                continue
            found = read_tables(path)
            assert not found.left_out
            for table in found.tables:
                assert dict(table.counts) == {}
                assert (len(table.columns) >= 3 and len(table) >= 40) or table.name in ("device", "Metadata")
                assert table.headed == (folder.name != "headerless_six")
                assert sum(column.unreadable for column in table.columns) == 0
                assert len({column.name for column in table.columns}) == (len(table.columns) if table.headed else 1)
