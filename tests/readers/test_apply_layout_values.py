"""Which rows of a table are samples: those that have their fields, and numbers that such sensors can give."""

import math
from pathlib import Path

import numpy as np
import pytest
from support.m5stickc_lines import ACC, GYRO, G, lines_of_a_walk, read_lines, read_rows

from fbgraph.core.errors import FbgraphError
from fbgraph.readers import read_log
from fbgraph.readers.apply_layout import stream_values
from fbgraph.readers.layout import StreamLayout, layout_toml
from fbgraph.tables.table import Column, Table

HEADER = "t_ms,ax_ms2,ay_ms2,az_ms2,gx_rads,gy_rads,gz_rads,event"


def rows(count: int) -> list[str]:
    numbers = (",".join(f"{v:.5f}" for v in (*ACC[i % 300], *GYRO[i % 300])) for i in range(count))
    return [f"{20 * i},{text}," for i, text in enumerate(numbers)]


def test_a_row_that_no_sensor_can_give_is_dropped_whole(tmp_path: Path) -> None:
    lines = rows(200)
    for i, numbers in (
        (50, "160,0,0,37,0,0,a"),
        (60, "160.1,0,0,0,0,0,b"),
        (70, "0,0,0,0,0,-37.1,c"),
        (80, ",0,9.8,0,0,0,f"),
    ):
        lines[i] = f"{20 * i},{numbers}"
    lines[90] = f"{10**19},0,0,9.8,0,0,0,d"
    raw = read_rows(tmp_path, [HEADER, *lines])
    assert raw.counts == {"rows_impossible": 3}
    assert [(t_ns // 20_000_000, text) for t_ns, text in raw.events] == [(50, "a"), (80, "f")]
    assert raw.streams["acc"].t_ns.tolist() == [20_000_000 * i for i in range(200) if i not in (60, 70, 90)]
    np.testing.assert_array_equal(raw.streams["acc"].values[[50, 78]], [[160.0, 0.0, 0.0], [math.nan, 0.0, 9.8]])
    np.testing.assert_array_equal(raw.streams["gyro"].values[50], [37.0, 0.0, 0.0])


@pytest.mark.parametrize("count", [40, 4000])
def test_rows_with_the_wrong_fields_are_counted_and_shift_nothing(count: int, tmp_path: Path) -> None:
    good = rows(count)
    lost = good[3].replace(",", "", 1)  # a separator: all columns after it stand one to the left
    bad = ["1,2,3", good[5] + ",5,6", lost, "torn", good[9][:25]]
    raw = read_rows(tmp_path, [HEADER, *good[:20], *bad, *good[20:]])
    assert raw.counts == {"lines_unreadable": len(bad)}
    np.testing.assert_array_equal(raw.streams["acc"].t_ns, 20_000_000 * np.arange(count))
    np.testing.assert_allclose(raw.streams["acc"].values, ACC[np.arange(count) % 300], atol=1e-5)
    assert any(f"{len(bad)} that cannot be read" in notice for notice in raw.notices) == (count == 40)


def test_a_garbled_field_costs_the_field(tmp_path: Path) -> None:
    lines = rows(300)
    fields = lines[100].split(",")
    for field in ("x", "1_0", "0x10", "--1", "1e"):
        lines[100] = ",".join([*fields[:2], field, *fields[3:]])
        raw = read_rows(tmp_path, [HEADER, *lines])
        assert raw.counts == {}
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(raw.streams["acc"].values).any(axis=1)), [100])
        assert not np.isnan(raw.streams["gyro"].values).any()


@pytest.mark.parametrize("garbled", ["442355.0", "-1e308", "inf", "98.5"])
def test_one_garbled_number_decides_nothing(garbled: str, tmp_path: Path) -> None:
    """No unit in a name: a number a million times as large as the others says nothing of gravity or turns."""
    for column in (1, 4, 7):
        lines = lines_of_a_walk()
        lines[0] = "t_ms,ax,ay,az,gx,gy,gz,mx,my,mz,p,temp_c,event"
        lines[150] = ",".join(garbled if i == column else field for i, field in enumerate(lines[150].split(",")))
        log = read_lines(tmp_path, lines)
        assert np.median(np.linalg.norm(log.acc.values, axis=1)) == pytest.approx(G, rel=0.01)
        np.testing.assert_allclose(log.gyro.values[:100], GYRO[:100], atol=1e-5)
        assert 20.0 < np.median(np.linalg.norm(log.mag.values, axis=1)) < 60.0
        assert len(log.acc) >= 299


def test_axes_are_turned_as_laid_out_and_an_empty_field_stays_one(tmp_path: Path) -> None:
    numbers = np.array([[1.0, 2.0, 3.0], [4.0, math.nan, 6.0]])
    columns = tuple(Column(name, "", values) for name, values in zip("abc", numbers.T, strict=True))
    stream = StreamLayout(columns=("a", "b", "c"), scale=2.0, axes=("-y", "z", "-x"))
    found = stream_values(Table("t", "t", columns), stream, "t")
    np.testing.assert_array_equal(found, [[-4.0, 6.0, -2.0], [math.nan, 12.0, -8.0]])
    np.testing.assert_array_equal(found[0], 2.0 * stream.rotation @ numbers[0])


@pytest.mark.parametrize(
    ("kind", "columns", "said"),
    [
        ("ticks", [], "ticks takes 1 columns, here are 0"),
        ("hms", ["t_ms", "event"], "hms takes 3 columns, here are 2"),
        ("date_and_time", ["t_ms"], "date_and_time takes 2 columns, here are 1"),
        ("minutes", ["t_ms"], "clocks.0.kind"),
        ("ticks", ["event"], "the layout takes ticks from 'event', which holds text; name its kind"),
        ("stamps", ["t_ms"], r"walk\.csv: "),
        ("time_of_day", ["event"], r"walk\.csv: "),
    ],
)
def test_a_clock_that_a_layout_tells_wrongly_is_said(kind: str, columns: list[str], said: str, tmp_path: Path) -> None:
    lines = [HEADER, *(f"{row}{'marked' if i % 9 == 0 else ''}" for i, row in enumerate(rows(200)))]
    (tmp_path / "walk.csv").write_text("\n".join(lines))
    reading = read_log(tmp_path / "walk.csv").reading
    assert reading is not None
    text = (
        layout_toml(reading.layout)
        .replace('"ticks"', f'"{kind}"')
        .replace('"t_ms",', "".join(f'"{c}",' for c in columns))
    )
    (tmp_path / "layout.toml").write_text(text)
    with pytest.raises(FbgraphError, match=said):
        read_log(tmp_path / "walk.csv", layout=tmp_path / "layout.toml")
