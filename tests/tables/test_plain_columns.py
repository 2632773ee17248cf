"""One odd line or field costs itself: all else is the number that it is in a table without one."""

from pathlib import Path

import numpy as np
import pytest

from fbgraph.tables.fields import is_empty, number
from fbgraph.tables.log_text import text_of
from fbgraph.tables.plain_columns import plain_columns
from fbgraph.tables.table import Table
from fbgraph.tables.text_table import read_table

KINDS = ("number", "number", "text", "")
NAMES = "t_ns,x,label,event"
ROWS = [f"{1_730_000_000_000_000_001 + 10 * i},{i / 7 - 3!r},word {i % 3}," for i in range(120)]
AT = 70  # later than what the dialect is found from


def table_of(rows: list[str], names: str = NAMES) -> Table:
    table = read_table(text_of(["\n".join([names, *rows, ""]).encode()], Path("walk.csv")), "walk", "walk.csv")
    assert table is not None
    return table


def plain(rows: list[str], kinds: tuple[str, ...] = KINDS) -> bool:
    return plain_columns(["\n".join(rows).encode()], ",", ".", kinds) is not None


def test_rows_that_are_all_alike_are_read_as_they_are_written() -> None:
    assert plain(ROWS)
    t, x, label, event = (column.values for column in table_of(ROWS).columns)
    assert t.dtype == np.int64
    assert t.tolist() == [int(row.split(",")[0]) for row in ROWS]
    assert x.tolist() == [float(row.split(",")[1]) for row in ROWS]
    assert label.tolist() == [row.split(",")[2] for row in ROWS]
    assert np.isnan(event).all()
    assert all(values.flags.writeable for values in (t, x, label, event))


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("# a remark", {}),
        ("#1,2,3,4", {}),
        (NAMES, {"headers_repeated": 1}),
        (",,,", {"lines_unreadable": 1}),
        ("1,2,3,4,5", {"rows_too_long": 1}),
        ("", {}),
        ("torn", {"lines_unreadable": 1}),
    ],
)
def test_an_odd_line_costs_itself(line: str, told: dict[str, int]) -> None:
    clean, table = table_of(ROWS), table_of([*ROWS[:AT], line, *ROWS[AT:]])
    assert dict(table.counts) == told
    for ours, theirs in zip(table.columns, clean.columns, strict=True):
        np.testing.assert_array_equal(ours.values, theirs.values)
    assert len(table.remarks) == line.startswith("#")


def test_a_short_row_keeps_the_fields_that_it_has() -> None:
    table = table_of([*ROWS[:AT], "7,8.5", *ROWS[AT:]])
    assert len(table) == len(ROWS) + 1
    assert table.widths is not None
    assert table.widths[AT] == 2
    assert [column.values[AT] for column in table.columns[:3]] == [7, 8.5, None]


@pytest.mark.parametrize("field", ["0x10", "+5", "1_2", "1e400", " 8", "-", "oops", '"9"', "١٢", "1" * 30])
def test_a_field_is_the_number_that_it_is_by_itself(field: str) -> None:
    rows = [f"{i},{3 * i}" for i in range(120)]
    rows[AT] = f"{AT},{field}"
    values, unreadable = (table_of(rows, "n,v").columns[1].values, table_of(rows, "n,v").columns[1].unreadable)
    expected = number(field.strip('"'))
    assert unreadable == (expected is None and not is_empty(field))
    assert values.dtype == (np.int64 if isinstance(expected, int) and field != "+5" else np.float64)
    np.testing.assert_array_equal(values[AT], np.nan if expected is None else float(expected))
    np.testing.assert_array_equal(np.delete(values, AT), [3 * i for i in range(120) if i != AT])


def test_text_that_begins_late_is_text_from_the_first_row_on() -> None:
    rows = [*ROWS[:AT], ROWS[AT] + "button", *ROWS[AT + 1 :]]
    assert plain(rows)
    event = table_of(rows).columns[3].values.tolist()
    assert event == [None] * AT + ["button"] + [None] * (len(ROWS) - AT - 1)


def test_dates_and_truths_are_text() -> None:
    rows = [f"2025-05-0{1 + i % 9},{'true' if i % 2 else 'false'},12:00:0{i % 10},{i}" for i in range(90)]
    assert [column.values[1] for column in table_of(rows, "date,on,time,n").columns] == [
        "2025-05-02", "true", "12:00:01", 1,
    ]  # fmt: skip
    assert not plain(rows, ("", "", "", "number"))


@pytest.mark.parametrize("word", ["one, two", "one"])
def test_quotes_are_no_part_of_a_word_and_hold_a_separator(word: str) -> None:
    rows = [*ROWS[:AT], f'5,6.5,"{word}",', *ROWS[AT + 1 :]]
    assert [column.values[AT] for column in table_of(rows).columns[:3]] == [5, 6.5, word]
