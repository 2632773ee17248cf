"""One walk written in thirty ways is one walk: the same steps, and a track within a centimetre."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fbgraph.core.config import load_config
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.estimators.baselines import baselines
from fbgraph.front_end.detect_steps import detect_steps
from fbgraph.readers import read_log
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.raw_recorder import LineCutter
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate

DIALECTS = 30
G, DEG = 9.80665, np.pi / 180.0
SEPARATORS = (",", ";", "\t", "|", " ")
DECIMALS = (".", ",")
QUOTED = ("nothing", "names", "all")
UNITS = (
    ("g", G, "dps", DEG, "uT", 1.0),
    ("m/s2", 1.0, "rad/s", 1.0, "nT", 1e-3),
    ("mg", G / 1e3, "deg/s", DEG, "uT", 1.0),
)
NAMES = ("a{axis}_{unit}", "{sensor} {axis} ({unit})", "{sensor}_{axis} [{unit}]", "{sensor}{axis}")
TIMES = ("t_ms", "time_s", "t_us", "timestamp_ns", "iso", "clock")
CONVENTIONS = ("as named", "ICM-20948", "iOS")
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "latin-1")


@dataclass(frozen=True)
class Writing:
    separator: str
    decimal: str
    quoted: str
    units: tuple[str, float, str, float, str, float]
    names: str
    time: str
    convention: str
    encoding: str

    @property
    def lines(self) -> bool:
        """Whether a device could send it."""
        return self.encoding.startswith("utf-8")


def drawn() -> list[Writing]:
    """Thirty, in which every value of every dimension occurs."""
    rng = np.random.default_rng(12)
    dimensions: tuple[tuple[Any, ...], ...] = (
        *(SEPARATORS, DECIMALS, QUOTED, UNITS, NAMES, TIMES, CONVENTIONS, ENCODINGS),
    )
    orders = [rng.permutation(DIALECTS) for _ in dimensions]
    found = []
    for i in range(DIALECTS):
        how = Writing(*(some[order[i] % len(some)] for some, order in zip(dimensions, orders, strict=True)))
        decimal = "." if how.separator == "," and how.quoted != "all" else how.decimal
        found.append(replace(how, decimal=decimal, quoted="nothing" if how.separator == " " else how.quoted))
    return found


def time_texts(t_s: FloatArray, time: str) -> tuple[str, list[str]]:
    ms = np.round(t_s * 1e3).astype(int)
    if time == "iso":
        start = datetime(2024, 5, 1, 12, 30, tzinfo=UTC)
        return "time", [(start + timedelta(milliseconds=int(t))).isoformat("T", "milliseconds") for t in ms]
    if time == "clock":
        day = (ms + 86_390_000) % 86_400_000
        return "time", [f"{t // 3_600_000:02d}:{t // 60_000 % 60:02d}:{t // 1000 % 60:02d}.{t % 1000:03d}" for t in day]
    if time == "time_s":
        return time, [f"{t / 1000:.3f}" for t in ms]
    scale, first = {"t_ms": (1, 0), "t_us": (1000, 0), "timestamp_ns": (10**6, 1_700_000_000 * 10**9)}[time]
    return time, [str(int(t) * scale + first) for t in ms]


def written(log: SensorLog, how: Writing) -> bytes:
    acc_unit, acc_scale, gyro_unit, gyro_scale, mag_unit, mag_scale = how.units
    acc, gyro = log.acc.values / acc_scale, log.gyro.values / gyro_scale
    mag = np.column_stack([np.interp(log.acc.t_s, log.mag.t_s, axis) for axis in log.mag.values.T]) / mag_scale
    acc = -acc if how.convention == "iOS" else acc
    mag = mag * (1.0, -1.0, -1.0) if how.convention == "ICM-20948" else mag
    time, times = time_texts(log.acc.t_s + 100.0, how.time)
    sensors = (("acc", acc_unit), ("gyro", gyro_unit), ("mag", mag_unit))
    if how.names.startswith("a{"):
        names = [f"{letter}{axis}_{unit}" for letter, (_, unit) in zip("agm", sensors, strict=True) for axis in "xyz"]
    else:
        names = [how.names.format(sensor=sensor, axis=axis, unit=unit) for sensor, unit in sensors for axis in "xyz"]
    names = [time, *[name.replace(" ", "_") if how.separator == " " else name for name in names]]
    fields = [[f"{value:.7g}".replace(".", how.decimal) for value in row] for row in np.column_stack((acc, gyro, mag))]
    stamps = [stamp.replace(".", how.decimal) if how.time == "time_s" else stamp for stamp in times]
    rows = [names, *[[stamp, *row] for stamp, row in zip(stamps, fields, strict=True)]]
    quote = {"nothing": 0, "names": 1, "all": len(rows)}[how.quoted]
    lines = [how.separator.join(f'"{f}"' if i < quote else f for f in row) for i, row in enumerate(rows)]
    return ("\n".join(lines) + "\n").encode(how.encoding)


def track(log: SensorLog) -> Trajectory:
    config = load_config("m5stickc")
    return baselines(detect_steps(log, config)[0], config)["ekf"]


@pytest.fixture(scope="module")
def walk() -> tuple[SensorLog, Trajectory]:
    log = simulate(load_route("square"), seed=7).log.between(-np.inf, 32.0)
    return log, track(log)


def test_every_value_of_every_dimension_is_drawn() -> None:
    ways = drawn()
    assert len(ways) == DIALECTS
    for i, some in enumerate((SEPARATORS, DECIMALS, QUOTED, UNITS, NAMES, TIMES, CONVENTIONS, ENCODINGS)):
        assert {list(vars(how).values())[i] for how in ways} == set(some)


@pytest.mark.parametrize("i", range(DIALECTS))
def test_a_walk_in_any_writing_is_the_same(i: int, walk: tuple[SensorLog, Trajectory], tmp_path: Path) -> None:
    log, expected = walk
    how = drawn()[i]
    data = written(log, how)
    (tmp_path / "walk.csv").write_bytes(data)
    read = [read_log(tmp_path / "walk.csv").log]
    if how.lines and i % 2:
        reader, cutter = LiveReader(), LineCutter()
        read.append(SensorLog.concatenate([reader.push(cutter.push(data)), reader.finish()]))
    for one in read:
        found = track(one)
        assert len(found) == len(expected), how
        assert np.hypot(*(found.xy_m - expected.xy_m).T).max() < 0.01, how
