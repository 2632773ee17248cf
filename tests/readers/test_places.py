"""Files of places in the forms that people have: times, sigma, what is left out, and the clock of the log."""

import gzip
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.georeference import Georeference
from fbgraph.core.gnss_fixes import gnss_anchors, require_gnss_use
from fbgraph.core.place_clocks import LogClock, on_logs_clock
from fbgraph.readers.places import gnss_of, read_checkpoints

HERE = Georeference(49.46, 11.11)
EPOCH_S = 1_766_385_750.0
DATA = Path(__file__).parents[2].parent / "shared" / "data"
FORMATS = DATA / "formats"


def sensorlogger(path: Path, rows: Sequence[tuple[float, float, float, float]], first_s: float = EPOCH_S) -> Path:
    """Rows of (seconds, metres East, metres North, radius) as Sensor Logger writes them."""
    lines = ["time,seconds_elapsed,altitude,horizontalAccuracy,longitude,latitude"]
    for t_s, x_m, y_m, radius_m in rows:
        ((lat_deg, lon_deg),) = HERE.geodetic_deg(np.array([[x_m, y_m]])).tolist()
        lines.append(f"{round((first_s + t_s) * 1e9)},{t_s:.3f},310.5,{radius_m},{lon_deg:.9f},{lat_deg:.9f}")
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def walked(count: int, radius_m: float = 5.0) -> list[tuple[float, float, float, float]]:
    return [(float(i), 1.4 * i, 0.0, radius_m) for i in range(count)]


def placed(places: Checkpoints, start_s: float, end_s: float, rate_hz: float = np.nan) -> Checkpoints:
    return on_logs_clock(places, LogClock(start_s, end_s, rate_hz))


def test_a_radius_of_68_per_cent_is_a_sigma_on_each_axis(tmp_path: Path) -> None:
    places = read_checkpoints(sensorlogger(tmp_path / "Location.csv", walked(3, 4.5456)))
    np.testing.assert_allclose(places.sigma_m, 3.0, atol=2e-3)
    rng = np.random.default_rng(1)
    inside = np.hypot(*rng.normal(0.0, places.sigma_m[0], (2, 100_000))) < 4.5456
    assert inside.mean() == pytest.approx(0.6827, abs=0.005)
    np.testing.assert_allclose(places.xy_m, [[0.0, 0.0], [1.4, 0.0], [2.8, 0.0]], atol=1e-3)
    assert np.isnan(places.z_m).all()
    assert (places.gnss, places.clock) == (True, "own")
    assert places.label.endswith("Location.csv (GNSS, 3.0 m 1σ on each axis)")


def test_fixes_that_tell_nothing_are_left_out_and_counted(tmp_path: Path) -> None:
    rows = walked(12)
    rows[3] = (3.0, *rows[2][1:])  # the same again
    rows[5] = (5.0, 7.0, 0.0, 250.0)
    rows[7] = (7.0, 3000.0, 0.0, 5.0)
    rows[0] = (0.0, -5000.0, 100.0, 5.0)  # a place it remembered
    rows[11] = (11.0, 15.4, 0.0, -1.0)  # iOS for none
    places = read_checkpoints(sensorlogger(tmp_path / "Location.csv", rows))
    assert (places.t_s - EPOCH_S).round(3).tolist() == [1, 2, 4, 6, 8, 9, 10]
    (said,) = places.notices
    assert "5 of 12 fixes left out (1 without a place or time, 1 worse than 100 m, 1 repeated, 2 faster than" in said


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_phyphox_in_every_dialect(tmp_path: Path, separator: str, decimal: str) -> None:
    if separator == decimal:
        pytest.skip("phyphox has no such export")
    names = ["Time (s)", "Latitude (°)", "Longitude (°)", "Height (m)", "Horizontal Accuracy (m)"]
    rows = [(0.5, 49.46, 11.11, 300.0, 3.0304), (1.5, 49.4604, 11.11, 300.0, 9.0)]
    lines = [separator.join(f'"{name}"' for name in names)]
    lines += [separator.join(f"{value:.9E}".replace(".", decimal) for value in row) for row in rows]
    path = tmp_path / "Location.csv"
    path.write_text("\n".join(lines), "utf-8")
    places = placed(read_checkpoints(path), 0.01, 60.0)
    assert places.t_s.tolist() == [0.5, 1.5]
    assert places.y_m[1] == pytest.approx(44.5, abs=0.1)
    assert places.sigma_m[0] == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize("start_s", [EPOCH_S, EPOCH_S - 30.0])
def test_unix_times_meet_a_log_in_unix_time(tmp_path: Path, start_s: float) -> None:
    places = read_checkpoints(sensorlogger(tmp_path / "Location.csv", walked(20)))
    np.testing.assert_allclose(placed(places, start_s, start_s + 100).t_s, EPOCH_S + np.arange(20), atol=1e-6)


def test_a_log_since_its_start_meets_the_seconds_elapsed(tmp_path: Path) -> None:
    places = read_checkpoints(sensorlogger(tmp_path / "Location.csv", walked(20)))
    same = placed(places, 0.012, 60.0)
    assert (same.t_s.tolist(), same.clock, same.notices) == ([float(i) for i in range(20)], "log", ())
    up = placed(places, 250.0, 260.0)  # since the device was switched on
    assert up.t_s.tolist() == [250.0 + i for i in range(16)]
    assert "counted from the log's first sample, at 250.0 s" in up.notices[0]
    assert "4 of 20 places lie outside" in up.notices[1]


@pytest.mark.parametrize("tick", [1, 1_000, 1_000_000, 1_000_000_000])
def test_the_unit_of_a_time_is_found_on_any_clock(tmp_path: Path, tick: int) -> None:
    for first_s in (5.0, EPOCH_S):
        lines = ["time,latitude,longitude,accuracy"]
        lines += [f"{round((first_s + 2 * i) * tick)},{49.46 + i * 1e-5:.6f},11.11,5" for i in range(9)]
        path = tmp_path / "Location.csv"
        path.write_text("\n".join(lines), "utf-8")
        t_s = placed(read_checkpoints(path), first_s, first_s + 20).t_s
        np.testing.assert_allclose(t_s, first_s + 2 * np.arange(9), atol=1e-5)


@pytest.mark.parametrize("header", ["time_ms,latitude,longitude", "time,latitude,longitude,seconds_elapsed"])
def test_the_unit_of_a_time_is_that_of_its_name_or_of_the_seconds_beside_it(tmp_path: Path, header: str) -> None:
    path = tmp_path / "Location.csv"
    rows = [f"{5000 + 20 * i},{49.46 + i * 1e-6:.6f},11.11,{0.02 * i:.2f}" for i in range(5)]
    path.write_text("\n".join([header, *(",".join(row.split(",")[: header.count(",") + 1]) for row in rows)]), "utf-8")
    np.testing.assert_allclose(read_checkpoints(path).t_s, 5.0 + 0.02 * np.arange(5), atol=1e-9)


def test_clocks_that_do_not_meet_are_refused_with_both_ranges(tmp_path: Path) -> None:
    path = sensorlogger(tmp_path / "Location.csv", walked(5))
    with pytest.raises(DataError, match=r"2025-12-22 06:42:30 UTC to .*2026-01-0.* not on one clock; write .* t_s"):
        placed(read_checkpoints(path), EPOCH_S + 1e6, EPOCH_S + 1e6 + 60)
    lines = ["seconds_elapsed,latitude,longitude", *(f"{i},49.4600{i},11.11" for i in range(5))]
    path.write_text("\n".join(lines), "utf-8")
    with pytest.raises(DataError, match=r"0\.0 s to 4\.0 s since the start of a recording.*2025-12-22 06:42:30 UTC"):
        placed(read_checkpoints(path), EPOCH_S, EPOCH_S + 60)


def test_labels_by_row_count_the_rows_of_a_log_without_clock(tmp_path: Path) -> None:
    path = tmp_path / "gps_label.csv"
    rows = [f"{48 * i},23,59,{58 + i},51.61838{i},-3.8819,22.3" for i in range(2)]
    rows += [f"{48 * i},0,0,{i - 2},51.61838{i},-3.8819,22.3" for i in range(2, 5)]
    path.write_text("\n".join(["StartSampleID,Hour,Min,Sec,Lat,Lng,Alt", *rows]), "utf-8")
    places = read_checkpoints(path)
    assert places.rate_hz == pytest.approx(48.0)
    assert placed(places, 0.0, 9.0, 48.0).t_s.tolist() == [0, 1, 2, 3, 4]
    assert "has 48.0 rows a second, but was read with 50.0" in placed(places, 0.0, 9.0, 50.0).notices[-1]
    assert "5 fixes tell no accuracy; taken as 5 m" in places.notices[0]
    with pytest.raises(DataError, match="the log has a clock of its own"):
        placed(places, 0.0, 9.0)


GPX = """<?xml version="1.0"?><gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">
<wpt lat="49.4601" lon="11.11"><time>2025-12-22T06:42:40Z</time></wpt><trk><trkseg>
<trkpt lat="49.46" lon="11.11"><ele>3</ele><time>2025-12-22T06:42:30Z</time></trkpt>
<trkpt lat="49.46" lon="11.12"></trkpt></trkseg></trk></gpx>"""


def test_gpx_points_and_waypoints_with_their_times(tmp_path: Path) -> None:
    path = tmp_path / "walk.gpx"
    path.write_text(GPX, "utf-8")
    places = placed(read_checkpoints(path), EPOCH_S, EPOCH_S + 60)
    assert (places.t_s - EPOCH_S).tolist() == [0.0, 10.0]
    assert places.y_m.tolist() == pytest.approx([0.0, 11.12], abs=0.02)
    assert "1 of 3 points have no time" in places.notices[0]
    for text, said in (
        (GPX.replace("time>", "desc>"), "none of its 3 points has a time"),
        (GPX[:-20], "not a readable GPX"),
        ('<!DOCTYPE x [<!ENTITY a "b">]>' + GPX, "DOCTYPE"),
        ("<kml></kml>", "XML, but no GPX"),
    ):
        path.write_text(text, "utf-8")
        with pytest.raises(DataError, match=said):
            read_checkpoints(path)


def test_tum_and_ridi_and_utf16(tmp_path: Path) -> None:
    path = tmp_path / "truth.tum"
    path.write_text("# t x y z\n100.5 1 2 3 0 0 0 1\n101.5 2 2 3 0 0 0 1\n", "utf-8")
    places = placed(read_checkpoints(path), 100.0, 110.0)
    assert (places.t_s.tolist(), places.x_m.tolist(), places.z_m.tolist()) == ([100.5, 101.5], [1, 2], [3, 3])
    path.write_text("100.5 1 2 3 0 0 0 1\n101.5 2 x 3 0 0 0 1\n", "utf-8")
    with pytest.raises(DataError, match="line 2: not t x y z"):
        read_checkpoints(path)
    text = (
        "time,gyro_x,gyro_y,gyro_z,acce_x,acce_y,acce_z,pos_x,pos_y\n9.0,0,0,0,0,9.8,0,1.5,2.5\n9.5,0,0,0,0,9.8,0,2,3\n"
    )
    (tmp_path / "ridi.csv.gz").write_bytes(gzip.compress(text.encode("utf-16")))
    ridi = placed(read_checkpoints(tmp_path / "ridi.csv.gz"), 9.0, 10.0)
    assert (ridi.t_s.tolist(), ridi.xy_m.tolist(), ridi.gnss) == ([9.0, 9.5], [[1.5, 2.5], [2, 3]], False)


def test_logs_that_carry_truth_are_truth(tmp_path: Path) -> None:
    log = tmp_path / "log.txt"
    log.write_text("ACCE;0.0;1.0;0;0;9.8;3\nPOSI;1.5;1;49.46;11.11;2;100\nPOSI;9.5;2;49.4601;11.11;2;100\n", "utf-8")
    places = read_checkpoints(log)
    assert (places.t_s.tolist(), places.floor.tolist()) == ([1.5, 9.5], [2, 2])
    log.write_text("ACCE;0.0;1.0;0;0;9.8;3\n", "utf-8")
    with pytest.raises(DataError, match="carries no truth"):
        read_checkpoints(log)


def test_fixes_of_a_folder_a_zip_and_beside_a_log(tmp_path: Path) -> None:
    location = sensorlogger(tmp_path / "Location.csv", walked(4))
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.write(location, "inner/Location.csv")
    (tmp_path / "walk.csv").write_text("x")
    for log in (tmp_path, tmp_path / "walk.csv", tmp_path / "walk.zip", tmp_path.parent):
        fixes = gnss_of(log) if log != tmp_path.parent else gnss_of(tmp_path)
        assert fixes is not None
        assert len(fixes) == 4
    location.unlink()
    assert gnss_of(tmp_path / "walk.csv") is None
    assert gnss_of(tmp_path) is None
    (tmp_path / "walk.zip").write_bytes(b"PK\x03\x04 no zip")
    with pytest.raises(DataError, match="the zip is truncated or damaged"):
        gnss_of(tmp_path / "walk.zip")


def test_of_a_zip_nothing_but_its_fixes_is_read(tmp_path: Path) -> None:
    """What a recording holds besides may be large or damaged; Location.csv goes before labels by row."""
    location = sensorlogger(tmp_path / "Location.csv", walked(4)).read_bytes()
    with zipfile.ZipFile(tmp_path / "walk.zip", "w") as archive:
        archive.writestr("a/GPS_label.csv", "StartSampleID,Hour,Min,Sec,Lat,Lng\n1,1,1,1,49.0,11.0\n")
        archive.writestr("b/LOCATION.CSV", location)
        archive.writestr("Gyroscope.csv", b"x" * 1000)
    packed = (tmp_path / "walk.zip").read_bytes()
    (tmp_path / "walk.zip").write_bytes(packed.replace(b"x" * 1000, b"y" * 1000))  # its checksum is wrong
    fixes = gnss_of(tmp_path / "walk.zip")
    assert fixes is not None
    assert len(fixes) == 4


def test_places_on_one_line_in_utf_16_or_with_a_garbled_byte(tmp_path: Path) -> None:
    """A GPX may be one line, longer than any row of a log; a byte that is garbled costs its own line."""
    points = "".join(
        f'<wpt lat="49.4{k:05}" lon="11.1"><time>2024-05-01T10:{k // 60:02}:{k % 60:02}Z</time></wpt>'
        for k in range(1500)
    )
    for encoding in ("utf-8", "utf-16", "utf-16-be"):
        (tmp_path / "track.gpx").write_bytes(f'<gpx version="1.1">{points}</gpx>'.encode(encoding))
        assert len(read_checkpoints(tmp_path / "track.gpx")) == 1500
    (tmp_path / "truth.csv").write_bytes(b"# Stra\xdfe\nt_s,x_m,y_m\n1,2,3\n2,2,3\n")
    assert len(read_checkpoints(tmp_path / "truth.csv")) == 2


def test_a_time_that_no_clock_shows_is_none(tmp_path: Path) -> None:
    rows = walked(5)
    rows[2] = (1e20, *rows[2][1:])
    fixes = read_checkpoints(sensorlogger(tmp_path / "Location.csv", rows))
    assert len(fixes) == 4
    assert "1 without a place or time" in fixes.notices[0]


def test_metres_beside_degrees_that_are_nowhere_on_earth_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "both.csv"
    path.write_text("t_s,x_m,y_m,lat_deg,lon_deg\n0,1e200,0,49.4,11.1\n9,1e200,5,49.4,11.1\n")
    with pytest.raises(DataError, match=r"both\.csv: row 1 after the header: a place 1e\+200, 0 m is none on Earth"):
        read_checkpoints(path)


def test_what_is_used_of_fixes(tmp_path: Path) -> None:
    rows = walked(100)
    rows[0], rows[99] = (*rows[0][:3], 60.0), (*rows[99][:3], 40.0)  # not yet, and no more, a good one
    fixes = placed(read_checkpoints(sensorlogger(tmp_path / "Location.csv", rows)), EPOCH_S, EPOCH_S + 100)
    since = [(gnss_anchors(fixes, use).t_s - EPOCH_S).round(6).tolist() for use in ("start", "ends", "all")]
    assert since[:2] == [[1.0], [1.0, 98.0]]
    assert since[2] == [5.0, 15.0, 25.0, 35.0, 45.0, 55.0, 65.0, 75.0, 85.0, 95.0]
    assert gnss_anchors(fixes, "ends").sigma_m == pytest.approx(5.0 / 1.5152, rel=1e-3)
    assert gnss_anchors(fixes, "all").sigma_m == pytest.approx(np.sqrt(6.0) * 5.0 / 1.5152, rel=1e-3)
    with pytest.raises(ConfigError, match="--use-gnss both: expected none, start, ends or all"):
        require_gnss_use("both")


@pytest.mark.skipif(not FORMATS.is_dir(), reason="needs ../shared/data")
@pytest.mark.parametrize(
    ("name", "count", "length_m", "sigma_m", "seconds"),
    [
        ("phyphox_android_nju", 601, 819, 3.1, 599.2),
        ("phyphox_ios_aymdi_MIT", 33, 139, 23.1, 104.1),
        ("sensorlogger_android", 168, 135, 2.5, 157.4),
        ("sensorlogger_ios_excerpt", 363, 2460, 3.8, 471.0),
    ],
)
def test_real_location_files(name: str, count: int, length_m: float, sigma_m: float, seconds: float) -> None:
    fixes = gnss_of(FORMATS / name)
    assert fixes is not None
    assert len(fixes) == count
    assert np.hypot(*np.diff(fixes.xy_m, axis=0).T).sum() == pytest.approx(length_m, abs=1.0)
    assert np.median(fixes.sigma_m) == pytest.approx(sigma_m, abs=0.06)
    assert np.ptp(fixes.t_s) == pytest.approx(seconds, abs=0.1)
    assert fixes.doubt == ""


@pytest.mark.skipif(not FORMATS.is_dir(), reason="needs ../shared/data")
def test_the_real_labels_of_an_esp32_tell_its_rate() -> None:
    fixes = gnss_of(FORMATS / "esp32_icm20948_gps_kris_Apache2")
    assert fixes is not None
    assert fixes.rate_hz == pytest.approx(45.6, abs=0.1)
    at_s = placed(fixes, 0.0, 440.0, fixes.rate_hz).t_s
    assert (at_s[0], at_s[-1]) == (0.0, pytest.approx(436.0, abs=1.0))
