"""The phones' formats line by line: which field is what, and which lines are none."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.nanoseconds import MAX_T_NS
from fbgraph.readers import FORMATS, getsensordata, indoor_location, preset, read_log
from fbgraph.readers.cleaning import RawLog
from fbgraph.readers.tagged import TAGGED, tagged_reader


def written(folder: Path, *lines: str) -> Path:
    path = folder / "log.txt"
    path.write_text("\n".join(lines) + "\n", encoding="latin-1")
    return path


def getsensor(folder: Path, *lines: str) -> RawLog:
    return getsensordata.read(written(folder, *lines))


def indoor(folder: Path, *lines: str) -> RawLog:
    return indoor_location.read(written(folder, *lines))


def test_each_tag_is_a_sensor(tmp_path: Path) -> None:
    raw = getsensor(
        tmp_path,
        "ACCE;1.0;101.0;1;2;3;0",
        "GYRO;1.0;101.0;4;5;6;0",
        "MAGN;1.0;101.0;7;8;9;0",
        "PRES;1.0;101.0;976.5;0",
        "AHRS;1.0;101.0;1;1;1;0",
    )
    values = {name: stream.values.tolist() for name, stream in raw.streams.items()}
    assert values == {"acc": [[1, 2, 3]], "gyro": [[4, 5, 6]], "mag": [[7, 8, 9]], "pressure": [[976.5]]}
    assert {int(stream.t_ns[0]) for stream in raw.streams.values()} == {10**9}
    assert (raw.counts, raw.truth, raw.notices) == ({}, None, [])


def test_times_are_the_sensors_moved_by_the_median_to_the_apps_clock(tmp_path: Path) -> None:
    """Offsets of 40, 41, 41, 90 and 40.5 s: the median is 41."""
    app = [140.0, 141.5, 142.0, 191.5, 142.5]
    sensor = [100.0, 100.5, 101.0, 101.5, 102.0]
    raw = getsensor(tmp_path, *(f"ACCE;{a};{s};1;2;3;0" for a, s in zip(app, sensor, strict=True)))
    np.testing.assert_array_equal(raw.streams["acc"].t_ns, (np.array(sensor) + 41.0) * 1e9)


@pytest.mark.parametrize(("drift_ms", "told"), [(19, False), (21, True), (-21, True)])
def test_a_clock_that_moves_by_twenty_milliseconds_is_told(tmp_path: Path, drift_ms: int, told: bool) -> None:
    """From the first tenth to the last: of thirty rows three."""
    offsets = [0.0] * 3 + [0.5] * 24 + [drift_ms / 1000.0] * 3
    rows = [f"{10.0 + i + offset:.4f};{20.0 + i:.4f}" for i, offset in enumerate(offsets)]
    raw = getsensor(tmp_path, *(f"GYRO;{row};1;2;3;0" for row in rows), *(f"PRES;{row};976;0" for row in rows))
    text = f"GYRO: the sensor clock moves {drift_ms} ms against the app clock; checkpoint times are that uncertain"
    assert raw.notices == ([text] if told else [])


def test_garbled_times_warn_nobody(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        raw = getsensor(tmp_path, *(f"ACCE;{app};-1e308;1;2;3;0" for app in ("1e308", "-1e308", "1e308", "1e308")))
    assert raw.streams["acc"].t_ns.tolist() == [MAX_T_NS + 1] * 4


def test_lines_cut_short_are_counted(tmp_path: Path) -> None:
    good = "ACCE;1.0;101.0;1;2;3;0"
    bad = [
        "ACCE;1.0;101.0;1;2;3",
        "ACCE;1.0;101.0;1;x;3;0",
        "PRES;1.0;101.0;976",
        "ACCE;nan;101.0;1;2;3;0",
        "GYRO;1;inf;1;2;3;0",
    ]
    raw = getsensor(tmp_path, good, *bad)
    assert raw.counts == {"lines_unreadable": 5}
    assert list(raw.streams) == ["acc"]


def test_posi_lines_are_places_metres_from_the_first(tmp_path: Path) -> None:
    """North is 111 132.9 m a degree of latitude at 45°; East 78 847 m a degree of longitude."""
    raw = getsensor(
        tmp_path,
        "POSI;61.5;1;45.0;11.0;0;100",
        "POSI;71.5;2;45.001;11.002;1;100",
        "POSI;1;3;90.1;11.0;0;100",
        "POSI;1;3;nan;11.0;0;100",
        "POSI;1;3;45.0",
    )
    truth = raw.truth
    assert truth is not None
    assert truth.t_s.tolist() == [61.5, 71.5]
    assert truth.x_m == pytest.approx([0.0, 157.69], abs=0.05)
    assert truth.y_m == pytest.approx([0.0, 111.13], abs=0.05)
    assert truth.floor.tolist() == [0.0, 1.0]
    assert truth.georeference is not None
    assert (truth.georeference.lat_deg, truth.georeference.lon_deg) == (45.0, 11.0)
    assert truth.source == f"{tmp_path / 'log.txt'} (POSI)"
    assert raw.counts == {}


def test_indoor_traces_are_in_unix_milliseconds(tmp_path: Path) -> None:
    raw = indoor(
        tmp_path,
        "1574572467406\tTYPE_WAYPOINT\t208.5\t216.25",
        "1574572467526\tTYPE_ACCELEROMETER\t1\t2\t3\t2",
        "1574572467527\tTYPE_GYROSCOPE\t4\t5\t6\t2",
        "1574572467528\tTYPE_MAGNETIC_FIELD\t7\t8\t9\t2",
        "1574572467529\tTYPE_PRESSURE\t1001.5",
        "1574572467530\tTYPE_WIFI\tx",
        "1574572468406\tTYPE_WAYPOINT\t209.5\t217.25",
        "1574572469406\tTYPE_WAYPOINT\tnan\t217.25",
    )
    values = {name: (int(s.t_ns[0]) - 1574572467000000000, s.values.tolist()) for name, s in raw.streams.items()}
    assert values == {
        "acc": (526_000_000, [[1, 2, 3]]),
        "gyro": (527_000_000, [[4, 5, 6]]),
        "mag": (528_000_000, [[7, 8, 9]]),
        "pressure": (529_000_000, [[1001.5]]),
    }
    assert raw.truth is not None
    assert raw.truth.t_s == pytest.approx([1574572467.406, 1574572468.406])
    assert (raw.truth.x_m.tolist(), raw.truth.y_m.tolist()) == ([208.5, 209.5], [216.25, 217.25])
    assert raw.truth.source == f"{tmp_path / 'log.txt'} (TYPE_WAYPOINT)"
    assert raw.counts == {}


def test_indoor_lines_that_are_none_are_counted(tmp_path: Path) -> None:
    most = MAX_T_NS // 1_000_000
    good = ["5\tTYPE_GYROSCOPE\t1\t2\t3\t0", f"{most}\tTYPE_GYROSCOPE\t1\t2\t3\t0", f"{-most}\tTYPE_PRESSURE\t999"]
    bad = [
        "5\tTYPE_GYROSCOPE\t1\t2\t3",
        "x\tTYPE_GYROSCOPE\t1\t2\t3\t0",
        "5.5\tTYPE_GYROSCOPE\t1\t2\t3\t0",
        "5\tTYPE_GYROSCOPE\t1\tx\t3\t0",
        f"{most + 1}\tTYPE_GYROSCOPE\t1\t2\t3\t0",
        f"{-most - 1}\tTYPE_GYROSCOPE\t1\t2\t3\t0",
        "5\tTYPE_WAYPOINT\t1",
    ]
    raw = indoor(tmp_path, *good, *bad)
    assert raw.counts == {"lines_unreadable": 7}
    assert (len(raw.streams["gyro"].t_ns), len(raw.streams["pressure"].t_ns)) == (2, 1)
    assert raw.truth is None


def test_formats_are_found_by_content() -> None:
    assert FORMATS[:3] == (*TAGGED, "m5stickc") == ("getsensordata", "indoor_location", "m5stickc")
    for text, name in (
        ("% by GetSensorData", "getsensordata"),
        ("x\nPRES;1;2;3;4", "getsensordata"),
        ("# a\n1\tTYPE_X\t1", "indoor_location"),
        ("t_ms,ax,ay,az,gx,gy,gz", None),
    ):
        found = tagged_reader(text)
        assert (None if found is None else found.FORMAT.name) == name
    assert [preset(name) for name in FORMATS[:4]] == ["phone", "phone", "m5stickc", "phone"]


def test_files_that_are_no_logs_are_refused(tmp_path: Path) -> None:
    for text, message in (
        (" \n \n", "the file is empty; record or copy it again"),
        ("  <html>\nnothing", "no table in it: no rows of numbers"),
        ("\x00\x01", "a binary file, not a log"),
        ("y" * 90, "no table in it"),
    ):
        with pytest.raises(DataError, match=message):
            read_log(written(tmp_path, text))
    with pytest.raises(ConfigError, match="no format named 'gpx'; there are getsensordata, indoor_location, m5stickc"):
        read_log(written(tmp_path, "x"), "gpx")
