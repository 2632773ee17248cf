"""What all readers share, and the two phone formats."""

from __future__ import annotations

import gzip
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers import FORMATS, detect, read_log, reader
from fbgraph.readers.base import LogFile, RawLog, RawStream, _increasing, assemble, to_ns

S = 1_000_000_000
N = 500
I = np.arange(N)  # noqa: E741
T_NS = 100 * S + I * 20_000_000
ACC = np.column_stack((0.5 * np.sin(I / 5), 0.8 * np.cos(I / 7), 9.8 + 2.5 * np.sin(I / 4)))
GYRO = np.column_stack((0.9 * np.sin(I / 6), 1.1 * np.cos(I / 9), 1.3 * np.sin(I / 11)))
MAG = np.column_stack((20 + np.sin(I / 30), -5 + np.cos(I / 30), -38 + np.sin(I / 20)))
HERE = Path("walk.log")


def made(**changes: RawStream | None) -> LogFile:
    """A clean walk with some streams exchanged or, if None, removed; cleaned and assembled."""
    streams = {"acc": RawStream(T_NS, ACC), "gyro": RawStream(T_NS, GYRO), "mag": RawStream(T_NS, MAG)} | changes
    return assemble(RawLog({name: stream for name, stream in streams.items() if stream is not None}), HERE, "test")


def at(t_ns: object) -> dict[str, RawStream]:
    """The walk's streams on another clock."""
    t = np.asarray(t_ns, dtype=np.int64)
    return {"acc": RawStream(t, ACC), "gyro": RawStream(t, GYRO), "mag": RawStream(t, MAG)}


def changed(array: np.ndarray, where: object, value: object) -> np.ndarray:
    array = array.copy()
    array[where] = value
    return array


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


def check_sound(file: LogFile) -> None:
    log = file.log
    for stream in (log.acc, log.gyro, log.mag, log.pressure):
        assert np.isfinite(stream.t_s).all()
        assert np.isfinite(stream.values).all()
        assert (np.diff(stream.t_s) > 0).all()
    assert min(log.acc.t_s[0], log.gyro.t_s[0]) == 0.0


# --- cleaning ---------------------------------------------------------------------------------------------------------


def test_a_clean_walk_passes_unchanged() -> None:
    file = made()
    check_sound(file)
    np.testing.assert_array_equal(file.log.acc.values, ACC)
    np.testing.assert_allclose(file.log.acc.t_s, 0.02 * I, atol=1e-12)
    assert file.log.t0_s == 100.0
    assert file.log.counts == {}
    assert file.log.notices == ("no barometer: altitude stays at 0",)


def test_bad_values_are_dropped_and_counted() -> None:
    acc = changed(changed(changed(ACC, 5, np.nan), (6, 0), np.inf), (7, 1), 1e4)
    log = made(acc=RawStream(T_NS, acc), pressure=RawStream(T_NS, np.linspace(200, 1000, N)[:, None])).log
    assert log.counts["acc_not_finite"] == 2
    assert log.counts["acc_out_of_range"] == 1
    assert log.counts["pressure_out_of_range"] == (np.linspace(200, 1000, N) < 300).sum()
    assert len(log.acc) == N - 3


@pytest.mark.parametrize("row", [0, 1, 2, 250, N - 2, N - 1])
@pytest.mark.parametrize("t_ns", [-(2**63), -5 * S, 0, 90 * S, 100 * S + 5, 200 * S, 10**15, 4 * 10**18, 2**63 - 1])
def test_one_garbled_time_costs_at_most_two_samples(row: int, t_ns: int) -> None:
    file = made(**at(changed(T_NS, row, t_ns)))
    check_sound(file)
    assert len(file.log.acc) >= N - 2
    assert file.log.duration_s < 20.0


def test_a_block_of_garbled_times_costs_only_itself() -> None:
    file = made(**at(changed(T_NS, slice(200, 203), [10**15, 10**15 + 1, 10**15 + 2])))
    assert len(file.log.acc) == N - 3
    assert file.log.counts["acc_not_later"] == 3


def test_duplicates_and_shared_times() -> None:
    twice = np.repeat(np.arange(N), 2)
    t_ns = T_NS[twice]
    log = made(acc=RawStream(t_ns, ACC[twice]), gyro=RawStream(t_ns, GYRO[twice]), mag=None).log
    assert log.counts == {"acc_duplicate": N, "gyro_duplicate": N}
    np.testing.assert_array_equal(log.acc.values, ACC)

    pairs = at(T_NS[I // 2 * 2])  # two samples arrive at once
    log = made(**pairs).log
    assert len(log.acc) == N - 1  # nothing before the first pair to spread it over
    np.testing.assert_allclose(np.diff(log.acc.t_s), 0.02, atol=1e-9)
    assert any("time of another" in notice for notice in log.notices)


def test_backward_samples_are_dropped() -> None:
    order = I.copy()
    order[[100, 101]] = [101, 100]
    log = made(**at(T_NS[order])).log
    assert log.counts["acc_not_later"] == 1
    again = np.concatenate((I[:300], I[200:]))  # a piece sent twice
    log = made(acc=RawStream(T_NS[again], ACC[again])).log
    np.testing.assert_array_equal(log.acc.values, ACC)


def test_a_clock_set_during_the_log_leaves_the_longer_piece() -> None:
    t_ns = T_NS.copy()
    t_ns[120:] += 1_700_000_000 * S
    file = made(**at(t_ns))
    check_sound(file)
    assert len(file.log.acc) == N - 120
    assert file.log.counts["acc_stray_time"] == 120
    assert any("time jumps" in notice for notice in file.log.notices)
    assert file.log.t0_s == pytest.approx(1_700_000_102.4)


def test_saturation_is_counted_not_dropped() -> None:
    gyro = changed(GYRO, (slice(50, 60), 1), 34.906586)
    log = made(
        gyro=RawStream(T_NS, gyro), acc=RawStream(T_NS, np.clip(ACC * [1, 1, 3], -19.6133, 19.6133) / [1, 1, 1])
    ).log
    assert len(log.gyro) == N
    assert log.counts["gyro_saturated"] == 10
    assert log.counts["acc_saturated"] > 100
    assert any("10 samples at the gyroscope's limit of 2000 °/s" in notice for notice in log.notices)
    assert "acc_saturated" not in made().log.counts


def test_stuck_sensors() -> None:
    log = made(
        gyro=RawStream(T_NS, GYRO * 0),
        mag=RawStream(T_NS, MAG * 0 + 30),
        pressure=RawStream(T_NS, I[:, None] * 0 + 1013.0),
    ).log
    assert len(log.gyro) == N
    assert len(log.mag) == len(log.pressure) == 0
    text = "; ".join(log.notices)
    assert "gyroscope never changes" in text
    assert "magnetometer not used" in text
    assert "barometer not used" in text


def test_gaps_and_slow_rates_are_told() -> None:
    t_ns = T_NS * 5
    t_ns[300:] += 3 * S
    notices = "; ".join(made(**at(t_ns)).log.notices)
    assert "the accelerometer runs at 10.0 Hz; steps need 20 Hz" in notices
    assert "1 gaps of more than 1 s in the accelerometer, the longest 3.1 s at 29.9 s" in notices


SHORT = slice(0, 3)
REFUSED = {
    "no accelerometer": ({"acc": None}, "no usable accelerometer"),
    "no gyroscope": ({"gyro": None}, "no usable gyroscope samples .none in the file.; a walk cannot"),
    "only nan": ({"acc": RawStream(T_NS, ACC * np.nan)}, "no usable accelerometer samples .500 acc_not_finite"),
    "three samples": ({"acc": RawStream(T_NS[SHORT], ACC[SHORT])}, "only 3 accelerometer samples over 0.04 s"),
    "three gyro samples": ({"gyro": RawStream(T_NS[SHORT], GYRO[SHORT])}, "only 3 gyroscope samples"),
    "constant": ({"acc": RawStream(T_NS, ACC * 0 + 5.66)}, "accelerometer never changes"),
    "in g": ({"acc": RawStream(T_NS, ACC / 9.8)}, "median magnitude is .* unit is wrong"),
    "apart": ({"gyro": RawStream(T_NS + 600 * S, GYRO)}, "only 0 gyroscope samples"),
    "backwards": (at(T_NS[::-1]), "time goes backwards"),
    "time stands still": (at(T_NS * 0), "time goes backwards or stands still"),
    "shuffled": (at(np.random.default_rng(0).permutation(T_NS)), "time goes backwards"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_a_walk_is_refused(case: str) -> None:
    changes, message = REFUSED[case]
    with pytest.raises(DataError, match=message) as error:
        made(**changes)
    assert str(error.value).startswith("walk.log: ")
    assert "\n" not in str(error.value)


@given(st.lists(st.integers(0, 30), max_size=60))
def test_increasing_drops_as_few_as_possible(times: list[int]) -> None:
    t = np.asarray(times, dtype=np.int64)
    keep = _increasing(t)
    assert (np.diff(t[keep]) > 0).all()
    best = [1] * len(times)
    for i, later in enumerate(times):
        best[i] = 1 + max((best[j] for j in range(i) if times[j] < later), default=0)
    assert keep.sum() == max(best, default=0)


@given(
    st.lists(st.tuples(st.integers(0, N - 1), st.integers(-(2**63), 2**63 - 1)), max_size=30),
    st.lists(st.tuples(st.integers(0, N - 1), st.floats(allow_nan=True)), max_size=30),
)
@settings(max_examples=60, deadline=None)
def test_any_times_and_values_give_a_sound_log(times: list[tuple[int, int]], values: list[tuple[int, float]]) -> None:
    t_ns, acc = T_NS.copy(), ACC.copy()
    for i, t in times:
        t_ns[i] = t
    for i, value in values:
        acc[i, i % 3] = value
    file = made(**(at(t_ns) | {"acc": RawStream(t_ns, acc)}))
    check_sound(file)
    assert len(file.log.gyro) >= N - 2 * len(times)


@given(st.floats(), st.sampled_from([1, 1000, 10**6, 10**9]))
def test_to_ns_never_overflows(t: float, tick_ns: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (t_ns,) = to_ns(np.array([t]), tick_ns).tolist()
    if abs(t) <= 4e18 // tick_ns:
        assert abs(t_ns - t * tick_ns) <= max(512.0, abs(t * tick_ns) * 1e-15)
    else:
        assert t_ns == 4 * 10**18 + 1


# --- files ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FORMATS)
def test_every_reader_describes_itself_and_knows_its_example(name: str, tmp_path: Path) -> None:
    module = reader(name)
    assert name == module.NAME
    assert "\n" not in module.DESCRIPTION
    assert detect(write(tmp_path, module.EXAMPLE.splitlines())) == name
    raw = module.read(tmp_path / "walk.txt")
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
@pytest.mark.parametrize("chars", range(1, 40, 3))
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
    check_sound(file)
    assert len(file.log.acc) >= N - 60


BAD_FILES = {
    "empty": (b"", "the file is empty"),
    "blank": (b" \n\n \n", "the file is empty"),
    "binary": (bytes(range(256)) * 40, "a binary file"),
    "picture": (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", "a binary file"),
    "prose": (b"Dear diary,\ntoday I walked.\n", "unknown format .it begins 'Dear diary,'.; `fbgraph formats`"),
    "truncated gz": (gzip.compress("\n".join(walk_indoor()).encode())[:-200], "truncated or damaged"),
    "damaged gz": (b"\x1f\x8b" + b"\x07" * 300, "truncated or damaged"),
    "gz of nothing": (gzip.compress(b""), "the file is empty"),
    "header only, m5stickc": (b"t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n", "no usable accelerometer samples .none"),
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
    with pytest.raises(DataError, match="is a directory, not a log file"):
        read_log(tmp_path)
    with pytest.raises(DataError, match=r"nothing.csv: No such file or directory; check the path"):
        read_log(tmp_path / "nothing.csv")
    with pytest.raises(ConfigError, match="no format named 'csv'; there are getsensordata"):
        read_log(write(tmp_path, walk_indoor()), "csv")


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_of_another_format_is_refused_not_misread(name: str, tmp_path: Path) -> None:
    path = write(tmp_path, ["Dear diary,", "today I walked."])
    with pytest.raises(DataError, match=r"walk\.txt: no (usable accelerometer|line names accelerometer)"):
        read_log(path, name)


# --- the real logs ----------------------------------------------------------------------------------------------------


def test_ipin_logs(shared_data: Path) -> None:
    paths = sorted((shared_data / "ipin2023").glob("*.txt.gz"))
    assert len(paths) == 8
    for path in paths:
        file = read_log(path)
        log, truth = file.log, file.truth
        check_sound(file)
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
        check_sound(file)
        assert log.format == "indoor_location"
        assert log.counts == {}
        assert [round(s.rate_hz) for s in (log.acc, log.gyro, log.mag)] == [50, 50, 50]
        assert truth is not None
        assert len(truth) >= 2
        assert log.t0_s - 2.0 < truth.t_s[0] < truth.t_s[-1] < log.t0_s + log.duration_s + 2.0
