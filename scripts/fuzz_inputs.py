"""What ``fuzz`` damages: one walk in every form that is read, its places in all of theirs, and how they are damaged."""

from __future__ import annotations

import gzip
import io
import json
import random
import shutil
import struct
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog

Input = bytes | dict[str, bytes]
"""A file, or a folder of them."""
EPOCH_NS = 1_700_000_000_000_000_000
G = 9.80665
# fmt: off
ODD = (
    "0", "-0", "1", "-1", "nan", "NaN", "inf", "-inf", "1e308", "-1e308", "1e-308", "1e400", "0x10", "1_000",
    "9999999999999999999999", "99999999999999", "-5", "3.5.1", "1,5", "-", "1\n5", "None", "null", "N/A",
    "\"\"", "\"", "'", ";", ",", "\t", "#", "%", "\\", "\x00", "\x1b[2J", "\u202e", "\xe9", "\xb2", "\u0661",
    "True", "[1]", "{}", "[]", "1e15", "4294967296", "65535", "<a>", "&amp;", "2024-02-30", "12:61:00",
    "=1+1", "../..", "/dev/null",
)
# fmt: on
_SEPARATORS = (b";", b"\t", b",", b" ", b":", b"=", b">")
_SENSORS = {"acc": "Accelerometer", "gyro": "Gyroscope", "mag": "Magnetometer", "pressure": "Pressure"}
_NAMES = ("_", "../up.csv", "Location.csv", "Gyroscope.csv", "meta/device.csv", "a/b/c.csv", "x.csv", ".hidden", "\xe9")


def logs(log: SensorLog, m5stickc: bytes) -> dict[str, Input]:
    """The walk in every form, by a name for its file or folder."""
    return {
        "walk.csv": m5stickc,
        "gsd.txt": _gsd(log),
        "indoor.txt": _indoor(log),
        "phyphox": _phyphox(log),
        "logger": _sensor_logger(log),
        "logger.json": _json(log),
        "lines.json": _json_lines(log),
        "long.csv": _long(log),
        "walk.gcsv": _gcsv(log),
        "ACCLOG.BIN": _acclog(log),
    }


def _rows(log: SensorLog, name: str) -> Iterator[tuple[int, list[float]]]:
    stream = getattr(log, name)
    return zip((EPOCH_NS + np.round(1e9 * stream.t_s)).astype(int).tolist(), stream.values.tolist(), strict=True)


def _gsd(log: SensorLog) -> bytes:
    """As GetSensorData writes it."""
    rows = ["% GetSensorData"]
    for tag, name in (("ACCE", "acc"), ("GYRO", "gyro"), ("MAGN", "mag"), ("PRES", "pressure")):
        for t_ns, values in _rows(log, name):
            t_s = (t_ns - EPOCH_NS) / 1e9 + 5.0
            rows.append(f"{tag};{t_s:.3f};{t_s:.3f};{';'.join(f'{v:.5f}' for v in values)};3")
    for k, t_s in enumerate((6.0, 9.0, 12.0)):
        rows.append(f"POSI;{t_s};{k};{49.4613 + 2e-5 * k:.8f};11.11096;0;100")
    return "\n".join(rows).encode()


def _indoor(log: SensorLog) -> bytes:
    """As the Indoor Location Competition's app writes it."""
    rows = []
    for kind, name in (("ACCELEROMETER", "acc"), ("GYROSCOPE", "gyro"), ("MAGNETIC_FIELD", "mag")):
        for t_ns, values in _rows(log, name):
            fields = "\t".join(f"{v:.6f}" for v in values)
            rows.append((t_ns, f"{t_ns // 1_000_000}\tTYPE_{kind}\t{fields}\t3"))
    return "\n".join(line for _, line in sorted(rows)).encode()


def _phyphox(log: SensorLog) -> dict[str, bytes]:
    heads = {
        "acc": '"Time (s)","X (m/s^2)","Y (m/s^2)","Z (m/s^2)"',
        "gyro": '"Time (s)","X (rad/s)","Y (rad/s)","Z (rad/s)"',
        "mag": '"Time (s)","X (µT)","Y (µT)","Z (µT)"',
        "pressure": '"Time (s)","X (hPa)"',
    }
    files = {
        f"{_SENSORS[name]}.csv": "\n".join(
            [head, *(",".join(f"{v:.6E}" for v in ((t - EPOCH_NS) / 1e9, *values)) for t, values in _rows(log, name))]
        ).encode()
        for name, head in heads.items()
    }
    files["Location.csv"] = _phyphox_location()
    files["meta/device.csv"] = b'"property","value"\n"version","1.1.16"\n"deviceModel","Pixel"\n'
    files["meta/time.csv"] = (
        b'"event","experiment time","system time","system time text"\n'
        b'"START",0.0,1700000000.0,"2023-11-14 22:13:20.000 UTC"\n'
    )
    return files


def _phyphox_location() -> bytes:
    head = '"Time (s)","Latitude (°)","Longitude (°)","Height (m)","Horizontal Accuracy (m)"'
    rows = (f"{t}.5,{49.46 + 1e-5 * t:.7f},11.11,300,4.2" for t in range(0, 10, 2))
    return "\n".join((head, *rows)).encode()


def _sensor_logger(log: SensorLog) -> dict[str, bytes]:
    files = {"Metadata.csv": b"version,device name\n3,Pixel\n", "Location.csv": _location()}
    for name, sensor in (("acc", "TotalAcceleration"), ("gyro", "Gyroscope"), ("mag", "Magnetometer")):
        rows = (f"{t},{(t - EPOCH_NS) / 1e9:.6f},{z:.6f},{y:.6f},{x:.6f}" for t, (x, y, z) in _rows(log, name))
        files[f"{sensor}.csv"] = "\n".join(("time,seconds_elapsed,z,y,x", *rows)).encode()
    return files


def _location() -> bytes:
    head = "time,seconds_elapsed,latitude,longitude,horizontalAccuracy"
    rows = (f"{EPOCH_NS + t * 10**9},{t}.0,{49.46 + 1e-5 * t:.7f},11.11,{3 + t}" for t in range(0, 10, 2))
    return "\n".join((head, *rows)).encode()


def _records(log: SensorLog) -> Iterator[tuple[str, int, list[float]]]:
    for name in ("acc", "gyro", "mag"):
        for t_ns, values in _rows(log, name):
            yield "TotalAcceleration" if name == "acc" else _SENSORS[name], t_ns, values


def _json(log: SensorLog) -> bytes:
    """As Sensor Logger exports it."""
    return json.dumps(
        [
            {"sensor": sensor, "time": str(t), "x": f"{x:.6f}", "y": f"{y:.6f}", "z": f"{z:.6f}"}
            for sensor, t, (x, y, z) in _records(log)
        ]
    ).encode()


def _json_lines(log: SensorLog) -> bytes:
    """As Sensor Logger sends it, a message a line."""
    rows = [
        {"name": sensor.lower(), "time": t, "values": {"x": round(x, 6), "y": round(y, 6), "z": round(z, 6)}}
        for sensor, t, (x, y, z) in _records(log)
    ]
    return "\n".join(json.dumps({"payload": rows[i : i + 50]}) for i in range(0, len(rows), 50)).encode()


def _long(log: SensorLog) -> bytes:
    rows = sorted((t, f"{sensor},{t},{x:.6f},{y:.6f},{z:.6f}") for sensor, t, (x, y, z) in _records(log))
    return "\n".join(("sensor,timestamp_ns,x,y,z", *(row for _, row in rows))).encode()


def _gcsv(log: SensorLog) -> bytes:
    head = "GYROFLOW IMU LOG\nversion,1.3\ntscale,0.001\ngscale,0.00122173\nascale,0.00048828\nt,gx,gy,gz,ax,ay,az"
    rows = (
        ",".join(str(round(v)) for v in (1e3 * t, *(gyro / 0.00122173), *(acc / G / 0.00048828)))
        for t, gyro, acc in zip(log.acc.t_s, log.gyro.values, log.acc.values, strict=True)
    )
    return "\n".join((head, *rows)).encode()


def _acclog(log: SensorLog) -> bytes:
    head = b"ACCLOG\0\0" + struct.pack("<HQQHHH", 0x0201, 1, 0, 50, 8, 2000)
    head = head.ljust(36, b"\0") + struct.pack("<ff", 4096.0, 16.4)
    counts = np.hstack((log.acc.values / G * 4096.0, np.degrees(log.gyro.values) * 16.4))
    return head.ljust(64, b"\0") + np.clip(counts, -32767, 32767).astype(">i2").tobytes()


def places(truth: bytes, xy_m: FloatArray, t_s: FloatArray) -> dict[str, bytes]:
    """Where somebody was, in every form."""
    start = "2023-11-14T22:13:"
    points = "".join(
        f'<trkpt lat="{49.46 + 1e-5 * k:.7f}" lon="11.11"><ele>3</ele><time>{start}{20 + k}Z</time></trkpt>\n'
        for k in range(10)
    )
    rows = list(zip(t_s.tolist(), *xy_m.T.tolist(), strict=True))
    return {
        "truth.csv": truth,
        "anchors.csv": "\n".join(("t_s,x_m,y_m", *(f"{t:.2f},{x:.3f},{y:.3f}" for t, x, y in rows))).encode(),
        "ipin.csv": (
            b"t_app_s,checkpoint,lat_deg,lon_deg,floor,east_m,north_m\n"
            b"6.0,1,49.4613,11.1109,0,0,0\n9.0,2,49.46131,11.1109,0,0.1,1.1\n12.0,3,49.46133,11.1109,1,0,3.3\n"
        ),
        "Location.csv": _location(),
        "phyphox.csv": _phyphox_location(),
        "track.gpx": (
            f'<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="x" '
            f'xmlns="http://www.topografix.com/GPX/1/1"><trk><name>a</name><trkseg>\n{points}</trkseg></trk>\n'
            f'<wpt lat="49.46" lon="11.11"><time>{start}40Z</time><name>b</name></wpt></gpx>\n'
        ).encode(),
        "walk.tum": "\n".join(f"{t:.4f} {x:.4f} {y:.4f} 0 0 0 0 1" for t, x, y in rows).encode(),
    }


def damaged(rng: random.Random, whole: Input, folder: Path, name: str) -> Path:
    """A damaged copy of an input, in a place where nothing else is: as it was, or packed."""
    place = folder / "odd"
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    if isinstance(whole, bytes):
        path, data = place / name, mutated(rng, whole)
        if rng.randrange(12) == 0:
            path, data = place / f"{name}.gz", maybe_mutated(rng, gzip.compress(data, 1))
        path.write_bytes(data)
        return path
    files = _odd_files(rng, whole)
    if rng.randrange(3) == 0:
        path = place / name
        for file, data in files.items():
            where = path / file
            if where.resolve().is_relative_to(path):
                where.parent.mkdir(parents=True, exist_ok=True)
                where.write_bytes(data)
        return path
    path = place / f"{name}.zip"
    path.write_bytes(maybe_mutated(rng, zipped(files, rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)))))
    return path


def _odd_files(rng: random.Random, whole: dict[str, bytes]) -> dict[str, bytes]:
    files = dict(whole)
    for _ in range(rng.choice((1, 1, 2, 3))):
        name = rng.choice(sorted(files)) if files else "x.csv"
        data, kind = files.get(name, b""), rng.randrange(8)
        if kind == 0:
            files.pop(name, None)
        elif kind == 1:
            files[rng.choice(_NAMES)] = data
        elif kind == 2:
            files[f"run {rng.randrange(3)}/{name}"] = files.pop(name, b"")
        elif kind == 3:
            files[name] = rng.choice((b"", b"\n", b"\0" * 5000, zipped(whole, zipfile.ZIP_STORED), rng.randbytes(3000)))
        else:
            files[name] = mutated(rng, data)
    return files


def zipped(files: dict[str, bytes], method: int) -> bytes:
    """A zip of some files."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method, compresslevel=1) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return out.getvalue()


def maybe_mutated(rng: random.Random, data: bytes) -> bytes:
    """Bytes that are damaged one time in four: one changed, or cut off."""
    kind = rng.randrange(8)
    if kind > 1 or not data:
        return data
    at = rng.randrange(len(data))
    return data[:at] if kind else data[:at] + rng.randbytes(1) + data[at + 1 :]


def mutated(rng: random.Random, text: bytes) -> bytes:
    """A text with one to four things gone wrong in it."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        text = rng.choice(_WAYS)(rng, text or b"\n")
    return text


def _cut(rng: random.Random, text: bytes) -> bytes:
    at = rng.randrange(len(text) + 1)
    return text[:at] if rng.randrange(2) else text[at:]


def _byte(rng: random.Random, text: bytes) -> bytes:
    at = rng.randrange(len(text))
    return text[:at] + rng.randbytes(1) + text[at + 1 :]


def _lines(rng: random.Random, text: bytes) -> bytes:
    """Some are lost, doubled or exchanged."""
    lines = text.split(b"\n")
    at, kind = rng.randrange(len(lines)), rng.randrange(3)
    if kind == 0:
        return b"\n".join(lines[:at] + lines[at + rng.choice((1, 1, 10, 500)) :])
    if kind == 1:
        return b"\n".join(lines[:at] + lines[at : at + 50] * 2 + lines[at + 50 :])
    other = rng.randrange(len(lines))
    lines[at], lines[other] = lines[other], lines[at]
    return b"\n".join(lines)


def _field(rng: random.Random, text: bytes) -> bytes:
    """One holds something odd; of the first lines as often as of all others."""
    lines = text.split(b"\n")
    at = rng.randrange(len(lines)) if rng.randrange(2) else min(rng.randrange(8), len(lines) - 1)
    there = [separator for separator in _SEPARATORS if separator in lines[at]]
    separator = rng.choice(there) if there else b","
    fields = lines[at].split(separator)
    fields[rng.randrange(len(fields))] = rng.choice(ODD).encode()
    lines[at] = separator.join(fields)
    return b"\n".join(lines)


def _column(rng: random.Random, text: bytes) -> bytes:
    """One holds something odd for many lines."""
    lines = text.split(b"\n")
    column, odd = rng.randrange(12), rng.choice(ODD).encode()
    start, separator = rng.randrange(len(lines)), rng.choice((b",", b"\t", b";"))
    for i in range(start, min(start + rng.choice((1, 30, 100_000)), len(lines))):
        fields = lines[i].split(separator)
        if len(fields) > column:
            fields[column] = odd
            lines[i] = separator.join(fields)
    return b"\n".join(lines)


def _letters(rng: random.Random, text: bytes) -> bytes:
    """Another separator everywhere, or another encoding."""
    if rng.randrange(3):
        return text.replace(rng.choice((b",", b";", b"\t", b".")), rng.choice((b",", b";", b"\t", b"", b" ")))
    return text.decode("latin-1").encode(rng.choice(("utf-16", "utf-16-be", "utf-8-sig")))


def _before(rng: random.Random, text: bytes) -> bytes:
    """Something stands before it or after it."""
    odd = rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"[boot]\n" * 70, b"\x00" * 100, b"\r", b"{", b"PK\x03\x04", b"#"))
    return odd + text if rng.randrange(4) else text + odd


def _scaled(rng: random.Random, text: bytes) -> bytes:
    """The numbers of a stretch in another unit, or without their signs."""
    lines = text.split(b"\n")
    at = rng.randrange(len(lines))
    old, new = rng.choice(((b"-", b""), (b".", b""), (b",", b",-"), (b"0", b"9"), (b",", b",0.000"), (b"e", b"E5")))
    some = slice(at, at + rng.choice((20, 400, 100_000)))
    lines[some] = [line.replace(old, new) for line in lines[some]]
    return b"\n".join(lines)


_WAYS: Sequence[Callable[[random.Random, bytes], bytes]] = (
    *(_cut, _cut, _byte, _byte, _lines, _lines, _lines, _field, _field, _field, _field, _column, _column),
    *(_letters, _before, _scaled),
)
