"""Tables as loggers write them give the same numbers, however they are written."""

import csv
import gzip
import io
import itertools
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fbgraph.core.errors import DataError
from fbgraph.tables import read_tables
from fbgraph.tables.dialect import find_dialect
from fbgraph.tables.fields import number
from fbgraph.tables.table import Table

NAMES = ("t_ns", "ax_g", "ay_g", "az_g", "label")
ROWS = [
    (
        1_730_000_000_000_000_001 + 20_000_000 * i,
        round(0.1 * i - 1.25, 3),
        round(0.5 - i / 7, 5),
        9 - i,
        f"word {i % 3}",
    )
    for i in range(30)
]


def one(path: Path) -> Table:
    (table,) = read_tables(path).tables
    return table


def table_of(tmp_path: Path, text: str | bytes, name: str = "walk.csv") -> Table:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return one(path)


def values(table: Table, name: str) -> list[object]:
    (column,) = [column for column in table.columns if column.name == name]
    return list(column.values.tolist())


@settings(max_examples=60, deadline=None)
@given(
    separator=st.sampled_from([",", ";", "\t", "|"]),
    decimal=st.sampled_from([".", ","]),
    quoting=st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
    header=st.sampled_from(["", "names", "units", "comment", "sep", "boot"]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    trailing=st.booleans(),
)
def test_the_same_numbers_come_back(
    tmp_path_factory: pytest.TempPathFactory,
    separator: str,
    decimal: str,
    quoting: int,
    header: str,
    encoding: str,
    end: str,
    trailing: bool,
) -> None:
    stream = io.StringIO()
    writer = csv.writer(stream, delimiter=separator, quoting=quoting, lineterminator=end)  # type: ignore[arg-type]
    first = {"sep": f"sep={separator}{end}", "boot": f"rst:0x1 (POWERON_RESET),boot:0x13{end}IMU OK{end}"}
    stream.write(first.get(header, "") + ("# " if header == "comment" and quoting == csv.QUOTE_MINIMAL else ""))
    if header:
        writer.writerow(NAMES)
    if header == "units":
        writer.writerow(["ns", "g", "g", "m/s²", "-"])
    for row in ROWS:
        fields = [str(field).replace(".", decimal) if isinstance(field, float) else field for field in row]
        writer.writerow([*fields, ""] if trailing else fields)
    path = tmp_path_factory.mktemp("walk") / "walk.csv"
    path.write_bytes(stream.getvalue().encode(encoding))
    table = one(path)
    assert [column.name for column in table.columns] == (list(NAMES) if header else [""] * 5)
    assert table.headed == bool(header)
    assert [column.unit for column in table.columns][:2] == (["ns", "g"] if header == "units" else ["", ""])
    for column, expected in zip(table.columns, zip(*ROWS, strict=True), strict=True):
        assert column.values.tolist() == list(expected)
        assert column.unreadable == 0
    assert [column.values.dtype.kind for column in table.columns] == ["i", "f", "f", "i", "O"]
    assert table.widths is None
    assert dict(table.counts) == {}


def test_lines_read_the_same_in_any_chunks_and_in_a_file(tmp_path: Path) -> None:
    lines = ["boot 1", "t_ms,x,y,event", *(f"{20 * i},{i / 8},{-i},{'' if i % 9 else f'b{i}'}" for i in range(200))]
    lines[20] = "360,1.5"
    lines[30] = "t_ms,x,y,event"
    lines[40] = "garbage"
    lines[50] = "920,4.x,-,go"
    lines[60] = "1,2,3,4,5,6,7"
    lines[70] = "# a remark, 1,2"
    dialect = find_dialect(lines)
    assert dialect is not None
    rows = lines[dialect.first_row :]
    whole = dialect.parse(rows)
    assert whole.counts == {"headers_repeated": 1, "lines_unreadable": 1, "rows_too_long": 1}
    assert whole.remarks == ("a remark, 1,2",)
    for size in (1, 7, 50):
        parts = [dialect.parse(rows[at : at + size]) for at in range(0, len(rows), size)]
        for i, column in enumerate(whole.columns):
            again = list(itertools.chain.from_iterable(part.columns[i].values.tolist() for part in parts))
            assert [str(value) for value in again] == [str(value) for value in column.values.tolist()] or i == 2
        assert sum((part.widths for part in parts), ()) == whole.widths
    table = table_of(tmp_path, "\n".join(lines) + "\n")
    assert dict(table.counts) == whole.counts
    assert table.remarks == ("boot 1", "a remark, 1,2")
    assert table.widths is not None
    assert table.widths.tolist() == list(whole.widths)
    for ours, theirs in zip(table.columns, whole.columns, strict=True):
        assert (ours.name, ours.unreadable, ours.values.dtype) == (theirs.name, theirs.unreadable, theirs.values.dtype)
        np.testing.assert_array_equal(ours.values, theirs.values)
    assert values(table, "x")[18] == 1.5
    assert values(table, "event")[:1] == ["b0"]


FIELDS = ["1_000", "0x10", "١٢", " 5 ", "+5", "5.", ".5", "1e5", "1e", "inf", "-nan", "True", "1d5", "--5", "1.2.3"]
FIELDS += ["99999999999999999999", "1" * 400, "-", "N/A", "null", "None", "5f", "1e400", "5\x0b", "\xa05", "-0", "0005"]


@pytest.mark.parametrize("decimal", [".", ","])
def test_a_field_is_the_same_number_in_a_file_and_in_a_line(tmp_path: Path, decimal: str) -> None:
    fields = [*(field.replace(".", decimal) for field in FIELDS), "1.5", "1,5"]
    rows = [
        f"{i};{field};" + f"{i / 4}".replace(".", decimal)
        for i, field in enumerate([*["2", f"0{decimal}5"] * 90, *fields])
    ]
    table = table_of(tmp_path, "n;v;w\n" + "\n".join(rows) + "\n")
    dialect = find_dialect(["n;v;w", *rows])
    assert dialect is not None
    parsed = dialect.parse(rows).columns[1]
    np.testing.assert_array_equal(table.columns[1].values, parsed.values)
    assert table.columns[1].unreadable == parsed.unreadable
    expected = [number(field, decimal) for field in fields]
    got = table.columns[1].values[-len(fields) :].tolist()
    assert [str(None if value is None else float(value)) for value in expected] == [
        str(None if np.isnan(value) else value) for value in got
    ]


def test_what_says_no_value_costs_a_field(tmp_path: Path) -> None:
    text = (
        "t,a,b\n1,-,2\n2,None,3\n3,null,4\n4,N/A,5\n5,NaN,6\n6,,7\n7,1.5,8\n8,oops,9\n9,2.5,10\n" + "10,3.5,11\n" * 30
    )
    table = table_of(tmp_path, text)
    assert len(table) == 39
    assert table.columns[1].unreadable == 1
    np.testing.assert_array_equal(table.columns[1].values[:9], [*[np.nan] * 6, 1.5, np.nan, 2.5])
    assert values(table, "b")[:9] == list(range(2, 11))


def test_no_row_may_have_the_last_column(tmp_path: Path) -> None:
    rows = [f"{i},{0.5 * i},word{i % 3}" for i in range(300)]
    rows[100] = "100,3.5.1,word"
    (tmp_path / "log.csv").write_text("t,x,label,event\n" + "\n".join(rows) + "\n")
    (table,) = read_tables(tmp_path / "log.csv").tables
    assert [len(column.values) for column in table.columns] == [300] * 4
    assert table.columns[1].unreadable == 1
    assert table.columns[2].values[1] == "word1"


def test_rows_may_end_early_and_a_last_line_without_its_end_may_be_cut(tmp_path: Path) -> None:
    table = table_of(tmp_path, "t,a,b\n" + "1,2,3\n2,3\n" * 20 + "5,6")
    assert table.widths is not None
    assert table.widths.tolist() == [3, 2] * 20
    assert dict(table.counts) == {"lines_cut_short": 1}


def test_headers_of_two_rows_are_joined_and_late_ones_found(tmp_path: Path) -> None:
    two = ",left,,right,\ntime [s],x,y,x,y\n" + "".join(f"{i / 8},1,2,3,4\n" for i in range(9))
    assert [column.name for column in table_of(tmp_path, two).columns] == [
        "time [s]", "left x", "left y", "right x", "right y",
    ]  # fmt: skip
    late = "".join(f"booting {i} of 900, 0x{i:x}\n" for i in range(900)) + "t,x,y\n" + "1,2.5,3\n" * 40
    table = table_of(tmp_path, late)
    assert [column.name for column in table.columns] == ["t", "x", "y"]
    assert len(table) == 40
    assert table.remarks[0] == "booting 0 of 900, 0x0"


def test_a_serial_monitors_time_becomes_a_column(tmp_path: Path) -> None:
    table = table_of(tmp_path, "".join(f"13:59:0{i}.5 -> {row}\n" for i, row in enumerate(["t,x", "1,2.5", "2,3.5"])))
    assert [column.name for column in table.columns] == ["serial monitor time", "t", "x"]
    assert values(table, "serial monitor time") == ["13:59:01.5", "13:59:02.5"]
    assert values(table, "x") == [2.5, 3.5]


def test_blanks_of_any_number_separate(tmp_path: Path) -> None:
    table = table_of(tmp_path, "  1.5   2\t3\n 2.5  4     5 \n" * 5)
    assert [column.values.tolist()[:2] for column in table.columns] == [[1.5, 2.5], [2, 4], [3, 5]]
    assert not table.headed


def test_garbled_bytes_cost_their_line_only(tmp_path: Path) -> None:
    data = "t,B (µT),note\n".encode() + b"1,2.5,ok\n" * 40 + b"2,\xff\xfe,x\n" + b"\0" * 20 + "3,4.5,Brücke\n".encode()
    table = table_of(tmp_path, data)
    assert [column.name for column in table.columns] == ["t", "B (µT)", "note"]
    assert values(table, "t")[-2:] == [2, 3]
    assert values(table, "note")[-1] == "Brücke"
    assert table.columns[1].unreadable == 1


def test_files_folders_and_zips_hold_the_same(tmp_path: Path) -> None:
    files = {"Acc.csv": "t,x,y\n" + "1,2,3\n" * 9, "meta/device.csv": "property,value\nversion,1.2\nname,a\nmodel,b\n"}
    folder = tmp_path / "walk"
    with zipfile.ZipFile(tmp_path / "walk.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
            archive.writestr(name, text)
    (tmp_path / "Acc.csv.gz").write_bytes(gzip.compress(files["Acc.csv"].encode()))
    for name in ("walk", "walk.zip"):
        tables = read_tables(tmp_path / name).tables
        assert [table.name for table in tables] == ["Acc", "device"]
        assert tables[1].source == str(tmp_path / name / "meta/device.csv")
        assert values(tables[0], "y") == [3] * 9
        assert values(tables[1], "property") == ["version", "name", "model"]
    assert one(tmp_path / "Acc.csv.gz").name == "Acc"


def test_nothing_to_read_is_said(tmp_path: Path) -> None:
    for name, data, why in (
        ("a.csv", b"", "the file is empty"),
        ("b.csv", bytes(range(256)) * 40, "a binary file, not a log"),
        ("c.csv", b"Dear reader,\nthis is no table.\n\nYours\n", "no table in it"),
        ("d.csv", b",".join([b"a"] * 5000) + b"\n1,2\n", "a line of 5000 columns, of which a log has 4096 at most"),
        ("e.csv", b"1," * 1_000_000, "nothing but lines of more than 64 KiB"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(DataError, match=rf"{name}: .*{why}"):
            read_tables(tmp_path / name)
