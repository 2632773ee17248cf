"""The two phone formats, and files that are none."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.waves import check_sound, waves

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers import FORMATS, log_format, read_log
from fbgraph.readers.tagged import TAGGED, reader_of, tagged_reader

N = 500
I = np.arange(N)  # noqa: E741
ACC, GYRO, MAG = waves(N)


def walk_getsensordata(n: int = N) -> list[str]:
    lines = ["% LogFile created by the 'GetSensorData' App for Android."]
    for i in range(n):
        app_s, sensor_s = 0.05 + 0.02 * i + 0.003 * (i % 3), 65093.5 + 0.02 * i
        for tag, row in (("ACCE", ACC[i]), ("GYRO", GYRO[i]), ("MAGN", MAG[i])):
            lines.append(f"{tag};{app_s:.4f};{sensor_s:.4f};" + ";".join(f"{v:.5f}" for v in row) + ";3")
        if i % 10 == 0:
            lines.append(f"PRES;{app_s:.4f};{sensor_s:.4f};{976.0 + 1e-3 * i:.4f};3")
        if i in (100, 400):
            lines.append(f"POSI;{app_s:.4f};{i};{49.46 + i * 1e-7:.9f};11.11;0;100")
    return lines


def walk_indoor(n: int = N) -> list[str]:
    lines = ["#\tstartTime:1574572467394"]
    for i in range(n):
        t_ms = 1574572467394 + 20 * i
        for tag, row in (("ACCELEROMETER", ACC[i]), ("GYROSCOPE", GYRO[i]), ("MAGNETIC_FIELD", MAG[i])):
            lines.append(f"{t_ms}\tTYPE_{tag}\t" + "\t".join(f"{v:.5f}" for v in row) + "\t3")
        if i in (0, 250):
            lines.append(f"{t_ms}\tTYPE_WAYPOINT\t{200.5 + i}\t{100.25}")
    return lines


WALKS = {"getsensordata": walk_getsensordata, "indoor_location": walk_indoor}


def write(tmp_path: Path, lines: list[str]) -> Path:
    path = tmp_path / "walk.txt"
    path.write_bytes("\n".join(lines).encode("latin-1", "replace"))
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_describes_itself(name: str) -> None:
    known = log_format(name)
    assert name == known.name
    assert known.example
    assert "\n" not in known.description


@pytest.mark.parametrize("name", TAGGED)
def test_every_tagged_reader_knows_its_example(name: str, tmp_path: Path) -> None:
    example = log_format(name).example
    assert tagged_reader(example) is reader_of(name)
    raw = reader_of(name).read(write(tmp_path, example.splitlines()))
    assert {"acc", "gyro", "mag"} <= raw.streams.keys()
    assert "lines_unreadable" not in raw.counts


def test_getsensordata_is_on_the_app_clock(tmp_path: Path) -> None:
    file = read_log(write(tmp_path, walk_getsensordata()))
    assert file.log.format == "getsensordata"
    assert file.log.counts == {}
    assert file.log.t0_s == pytest.approx(0.053)
    np.testing.assert_allclose(np.diff(file.log.acc.t_s), 0.02, atol=1e-7)
    np.testing.assert_allclose(file.log.gyro.values, GYRO, atol=1e-5)
    assert len(file.log.pressure) == N // 10
    assert file.truth is not None
    assert file.truth.y_m[1] == pytest.approx(300 * 1e-7 * 111_000, rel=0.01)
    assert file.truth.x_m[1] == pytest.approx(0.0, abs=1e-6)


def test_getsensordata_tells_of_a_drifting_clock(tmp_path: Path) -> None:
    lines = []
    for line in walk_getsensordata():
        fields = line.split(";")
        if fields[0] in ("ACCE", "GYRO", "MAGN"):
            fields[1] = f"{float(fields[1]) * 1.01:.4f}"
        lines.append(";".join(fields))
    notices = read_log(write(tmp_path, lines)).log.notices
    assert any("sensor clock moves 90 ms" in notice or "sensor clock moves 9" in notice for notice in notices)


def test_indoor_location_is_on_unix_time(tmp_path: Path) -> None:
    file = read_log(write(tmp_path, walk_indoor()))
    assert file.log.format == "indoor_location"
    assert file.log.counts == {}
    assert file.log.t0_s == pytest.approx(1574572467.394, abs=1e-6)
    np.testing.assert_allclose(file.log.acc.values, ACC, atol=1e-5)
    assert file.truth is not None
    assert file.truth.x_m.tolist() == [200.5, 450.5]
    np.testing.assert_allclose(file.truth.t_s - file.log.t0_s, [0.0, 5.0], atol=1e-6)


@pytest.mark.parametrize("name", WALKS)
def test_gz_equals_plain(name: str, tmp_path: Path) -> None:
    plain = write(tmp_path, WALKS[name]())
    packed = tmp_path / "walk.txt.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    a, b = read_log(plain).log, read_log(packed).log
    np.testing.assert_array_equal(a.acc.values, b.acc.values)
    np.testing.assert_array_equal(a.mag.t_s, b.mag.t_s)
    assert a.name == b.name == "walk"


@pytest.mark.parametrize("name", WALKS)
@pytest.mark.parametrize("chars", range(1, 40, 6))
def test_a_line_cut_short_is_dropped_not_misread(name: str, chars: int, tmp_path: Path) -> None:
    lines = WALKS[name]()
    lines[901] = lines[901][:-chars]
    log = read_log(write(tmp_path, lines)).log
    for stream, values in ((log.acc, ACC), (log.gyro, GYRO), (log.mag, MAG)):
        assert len(stream) >= N - 1
        np.testing.assert_allclose(stream.values, values[np.round(stream.t_s / 0.02).astype(int)], atol=1e-5)
    if chars == 1:  # only the accuracy, which is not used
        assert log.counts == {}


@given(st.data(), st.sampled_from(sorted(WALKS)))
@settings(max_examples=40, deadline=None)
def test_junk_never_breaks_a_reader(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, name: str) -> None:
    lines = WALKS[name]()
    junk = st.text(st.characters(max_codepoint=255), max_size=10)
    number = st.sampled_from(["nan", "inf", "1e400", "1" * 30, "-9223372036854775808", "1_0", ""])
    for _ in range(data.draw(st.integers(0, 30))):
        row = data.draw(st.integers(1, len(lines) - 1))
        separator = ";" if name == "getsensordata" else "\t"
        fields = lines[row].split(separator)
        fields[data.draw(st.integers(0, len(fields) - 1))] = data.draw(st.one_of(junk, number))
        lines[row] = separator.join(fields)[: data.draw(st.integers(0, 80))]
    file = read_log(write(tmp_path_factory.mktemp("junk"), lines), name)
    check_sound(file.log)
    assert len(file.log.acc) >= N - 60


BAD_FILES = {
    "empty": (b"", "the file is empty"),
    "blank": (b" \n\n \n", "the file is empty"),
    "binary": (bytes(range(256)) * 40, "a binary file"),
    "picture": (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "a binary file"),
    "prose": (b"Dear diary,\ntoday I walked.\n", "no table in it: no rows of numbers"),
    "truncated gz": (gzip.compress("\n".join(walk_indoor()).encode())[:-200], "truncated or damaged"),
    "damaged gz": (b"\x1f\x8b" + b"\x07" * 300, "truncated or damaged"),
    "gz of nothing": (gzip.compress(b""), "the file is empty"),
    "header only, m5stickc": (b"t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n", "no rows of numbers"),
    "header only, getsensordata": (walk_getsensordata(0)[0].encode(), "no usable accelerometer samples .none"),
    "waypoint only": (b"1574572467394\tTYPE_WAYPOINT\t1\t2\n", "no usable accelerometer samples .none"),
    "no gyroscope": (
        b"t_ms,ax_g,ay_g,az_g\n" + b"".join(b"%d,0,0,1.%d\n" % (20 * i, i) for i in range(200)),
        "gyroscope",
    ),
    "three samples": ("\n".join(walk_indoor(3)).encode(), "only 3 accelerometer samples"),
    "all the same": (
        b"t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n" + b"".join(b"%d,0,0,1,0,0,0\n" % (20 * i) for i in range(200)),
        "never changes",
    ),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_files_are_refused_in_one_line_that_names_them(case: str, tmp_path: Path) -> None:
    content, message = BAD_FILES[case]
    path = tmp_path / "bad.log"
    path.write_bytes(content)
    with pytest.raises(DataError, match=message) as error:
        read_log(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_paths_that_are_no_files(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no file in it"):
        read_log(tmp_path)
    with pytest.raises(DataError, match=r"nothing.csv: No such file or directory; check the path"):
        read_log(tmp_path / "nothing.csv")
    with pytest.raises(ConfigError, match="no format named 'csv'; there are getsensordata"):
        read_log(write(tmp_path, walk_indoor()), "csv")


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_of_another_format_is_refused_not_misread(name: str, tmp_path: Path) -> None:
    path = write(tmp_path, ["Dear diary,", "today I walked."])
    with pytest.raises(DataError, match=r"walk\.txt: no (usable accelerometer|table in it)"):
        read_log(path, name)


def test_ipin_logs(shared_data: Path) -> None:
    paths = sorted((shared_data / "ipin2023").glob("*.txt.gz"))
    assert len(paths) == 8
    for path in paths:
        file = read_log(path)
        log, truth = file.log, file.truth
        check_sound(file.log)
        assert log.format == "getsensordata"
        assert log.counts == {}
        assert log.notices == ()
        assert [round(s.rate_hz) for s in (log.acc, log.mag)] == [50, 50]
        assert round(log.gyro.rate_hz) in (50, 100)
        assert 5.0 < log.pressure.rate_hz < 11.0
        assert truth is not None
        assert len(truth) >= 12
        assert log.t0_s < truth.t_s[0] < truth.t_s[-1] < log.t0_s + log.duration_s


def test_indoor_location_logs(shared_data: Path) -> None:
    paths = sorted((shared_data / "indoor-location" / "site1").rglob("*.txt.gz"))
    assert len(paths) == 80
    for path in paths:
        file = read_log(path)
        log, truth = file.log, file.truth
        check_sound(file.log)
        assert log.format == "indoor_location"
        assert log.counts == {}
        assert [round(s.rate_hz) for s in (log.acc, log.gyro, log.mag)] == [50, 50, 50]
        assert truth is not None
        assert len(truth) >= 2
        assert log.t0_s - 2.0 < truth.t_s[0] < truth.t_s[-1] < log.t0_s + log.duration_s + 2.0
