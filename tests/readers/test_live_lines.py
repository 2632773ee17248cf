"""Lines as they come from a device: what a file would give, junk and silences included."""

import random
from dataclasses import replace
from pathlib import Path

import numpy as np
from support.walking import walked

from fbgraph.core.sensor_log import SensorLog
from fbgraph.readers import read_log
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.raw_recorder import saved_log


def pushed(lines: list[str], chunk: int = 50) -> tuple[LiveReader, SensorLog]:
    reader = LiveReader()
    parts = [reader.push(lines[at : at + chunk]) for at in range(0, len(lines), chunk)]
    parts.append(reader.finish())
    streams = {
        name: replace(
            getattr(parts[0], name),
            t_s=np.concatenate([getattr(p, name).t_s for p in parts]),
            values=np.concatenate([getattr(p, name).values for p in parts]),
        )
        for name in ("acc", "gyro", "mag", "pressure")
    }
    return reader, replace(parts[0], t0_s=reader.t0_s, **streams)


def test_live_lines_give_what_the_file_gives(device_lines: list[str], tmp_path: Path) -> None:
    (tmp_path / "walk.csv").write_text("".join(device_lines))
    file = read_log(tmp_path / "walk.csv").log
    for chunk in (1, 17, len(device_lines)):
        _, live = pushed(device_lines, chunk)
        for name in ("acc", "gyro", "mag", "pressure"):
            assert np.array_equal(getattr(live, name).t_s, getattr(file, name).t_s)
            assert np.array_equal(getattr(live, name).values, getattr(file, name).values)


def test_junk_costs_samples_but_never_the_walk(device_lines: list[str]) -> None:
    """Half device_lines, garbled numbers, lost device_lines, bursts, a restarted clock and a long silence."""
    rng = random.Random(3)
    clean = walked(pushed(device_lines)[1])
    header, rows = device_lines[0], device_lines[1:]
    half = len(rows) // 2
    junk = [header]
    for i, row in enumerate(rows):
        fields = row.split(",")
        if i >= half:  # the device restarted, after thirty seconds of silence that its own clock did not see
            fields[0] = str(int(fields[0]) - int(rows[half].split(",")[0]) + 12)
        if rng.random() < 0.10:
            continue
        if rng.random() < 0.01:
            junk.append(",".join(fields)[: rng.randrange(3, 30)] + "\n")
            continue
        if rng.random() < 0.01:
            fields[rng.randrange(1, 9)] = rng.choice(["", "NaN", "xx", "-", "1e99", "\x00\xff"])
        if rng.random() < 0.002:
            fields[0] = str(rng.randrange(10**12))
        junk.append(",".join(fields))
        if rng.random() < 0.002:
            junk.append(header)
    reader, log = pushed(junk, 13)
    assert reader.counts["clock_restarts"] == 1
    assert reader.counts["lines_unreadable"] > 20
    trajectory = walked(log)
    assert np.isfinite(trajectory.xy_m).all()
    hops = np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m))
    assert hops.max() < 1.5  # continuous
    assert abs(len(trajectory) - len(clean)) <= 4
    assert np.hypot(*(trajectory.xy_m[-1] - clean.xy_m[-1])) < 4.0


def test_a_silence_is_a_gap(device_lines: list[str]) -> None:
    rows = device_lines[:1500] + [
        ",".join([str(int(row.split(",")[0]) + 30_000), *row.split(",")[1:]]) for row in device_lines[1500:]
    ]
    reader, log = pushed(rows)
    assert reader.counts["silences"] == 1
    assert np.diff(log.acc.t_s).max() > 29.0
    trajectory = walked(log)
    assert np.hypot(np.diff(trajectory.x_m), np.diff(trajectory.y_m)).max() < 1.5


def test_saved_lines_are_the_samples_that_were_used(device_lines: list[str], tmp_path: Path) -> None:
    _, live = pushed(device_lines)
    (tmp_path / "raw.csv").write_text("".join(device_lines))
    saved = saved_log(tmp_path / "raw.csv")
    assert np.array_equal(saved.acc.values, live.acc.values)
    assert saved.t0_s == live.t0_s
