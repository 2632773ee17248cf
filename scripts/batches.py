#!/usr/bin/env python3
"""Many logs, measured: thousands of short simulated ones with some broken, killed in the middle and resumed; and how
many times faster two workers are than one on real walks.

.venv/bin/python scripts/batches.py --logs 2000
.venv/bin/python scripts/batches.py --ratio ../shared/data/indoor-location
"""

from __future__ import annotations

import argparse
import gzip
import os
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from fbgraph.batches.index import read_index
from fbgraph.batches.index_row import TIMINGS
from fbgraph.simulator.files import simulate_files
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate_options import SimulateOptions
from fbgraph.workers.run_tasks import run_tasks

ROUTES = ("square", "straight", "eight", "out-and-back")
TIMEOUT_S = 60


def simulate_one(task: tuple[str, int]) -> None:
    path, seed = task
    route = load_route(ROUTES[seed % len(ROUTES)], 0.5)
    simulate_files(Path(path), route, SimulateOptions(duration_s=15.0), seed)


def zipped(rows: list[str], path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("walk.csv", "\n".join(rows))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)


def fields(rows: list[str], change: Callable[[int, list[str]], list[str]]) -> str:
    return "\n".join([rows[0], *(",".join(change(k, row.split(","))) for k, row in enumerate(rows[1:]))]) + "\n"


BREAK: tuple[tuple[str, Callable[[list[str], Path], object]], ...] = (
    ("empty.csv", lambda rows, path: path.touch()),
    ("prose.csv", lambda rows, path: path.write_text("It was a long walk.\n")),
    ("noise.csv", lambda rows, path: path.write_bytes(bytes(range(256)) * 50)),
    ("torn.csv.gz", lambda rows, path: path.write_bytes(gzip.compress("\n".join(rows).encode())[:5000])),
    ("damaged.zip", zipped),
    ("short.csv", lambda rows, path: path.write_text("\n".join(rows[:10]))),
    ("no_gyro.csv", lambda rows, path: path.write_text("\n".join(",".join(r.split(",")[:4]) for r in rows))),
    ("frozen.csv", lambda rows, path: path.write_text(fields(rows, lambda k, r: [r[0], *rows[1].split(",")[1:]]))),
    ("nothing.csv", lambda rows, path: path.write_text(fields(rows, lambda k, r: [r[0], *["nan"] * (len(r) - 1)]))),
    ("hangs.csv", lambda rows, path: os.mkfifo(path)),  # who opens it waits
)


def make_logs(folder: Path, count: int) -> tuple[int, int]:
    """Write so many logs, one in a hundred broken; how many are good and broken."""
    broken = max(count // 100, len(BREAK))
    good = [(str(folder / f"walk{seed:05d}.csv"), seed) for seed in range(count - broken)]
    failed = [one for one in run_tasks(simulate_one, good) if one.cause]
    assert not failed, failed[0]
    rows = Path(good[0][0]).read_text().splitlines()
    for number in range(broken):
        name, make = BREAK[number % len(BREAK)]
        make(rows, folder / f"broken{number:03d}_{name}")
    return len(good), broken


def resident_mb(process: int) -> dict[str, float]:
    """Of a process and the largest of those below it."""
    found = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields_ = path.read_text().rpartition(")")[2].split()
            found[int(path.parent.name)] = (int(fields_[1]), int(fields_[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6)
        except OSError:
            continue
    below = {process}
    while more := {pid for pid, (parent, _) in found.items() if parent in below} - below:
        below |= more
    workers = [found[pid][1] for pid in below - {process} if pid in found]
    return {"main": found.get(process, (0, 0.0))[1], "largest worker": max(workers, default=0.0)}


def run(
    logs: list[Path], out: Path, *options: object, kill_at: int | None = None
) -> tuple[float, list[dict[str, float]]]:
    """The command; its seconds, and its memory every second."""
    typed = [sys.executable, "-m", "fbgraph", "batch", *logs, "--out", out, "--no-recording", *options]
    begun, memory = time.monotonic(), []
    main = subprocess.Popen(list(map(str, typed)), stdout=subprocess.DEVNULL)
    while main.poll() is None:
        time.sleep(1.0)
        memory.append(resident_mb(main.pid))
        if kill_at is not None and (out / "runs").is_dir() and len(os.listdir(out / "runs")) >= kill_at:
            main.send_signal(signal.SIGKILL)
            main.wait()
    return time.monotonic() - begun, memory


def told(out: Path) -> pd.DataFrame:
    return read_index(str(out)).drop(columns=list(TIMINGS))


def many(count: int) -> None:
    with tempfile.TemporaryDirectory(prefix="fbgraph-") as place:
        folder = Path(place) / "logs"
        folder.mkdir()
        good, broken = make_logs(folder, count)
        whole, cut = Path(place) / "whole", Path(place) / "cut"
        took_s, memory = run([folder], whole, "--timeout", TIMEOUT_S)
        index = read_index(str(whole))
        done = index[index["status"] == "done"]
        named = set(index[index["status"] == "failed"]["name"])
        print(
            f"| {count} logs of {done['duration_s'].median():.0f} s each, {broken} broken in {len(BREAK)} ways | |\n"
            "|---|---|"
        )
        print(f"| done, of {good} good | {len(done)} |")
        print(f"| broken and named | {sum(name.startswith('broken') for name in named)} of {len(named)} failed |")
        print(f"| causes | {index[index['status'] == 'failed']['cause'].value_counts().to_dict()} |")
        print(f"| seconds, on {os.cpu_count()} cores | {took_s:.0f} ({count / took_s:.1f} a second) |")
        print(f"| CPU of a log, median | {done['cpu_s'].median():.3f} s |")
        quarter = max(len(memory) // 4, 1)
        for name in ("main", "largest worker"):
            first, last = (max(one[name] for one in part) for part in (memory[: 2 * quarter], memory[-quarter:]))
            print(f"| memory of {name}, first half and last quarter | {first:.0f} MB, {last:.0f} MB |")
        run([folder], cut, "--timeout", TIMEOUT_S, kill_at=count // 2)
        kept = len(list((cut / "runs").glob("[!.]*/summary.json")))
        resumed_s, _ = run([folder], cut, "--timeout", TIMEOUT_S, "--resume")
        same = told(whole).equals(told(cut))
        print(f"| killed at {kept} runs and resumed: the same index | {'yes' if same else 'NO'}, {resumed_s:.0f} s |")


def ratio(data: Path) -> None:
    logs = sorted(data.rglob("*.txt.gz"))
    for workers in (1, 2):
        with tempfile.TemporaryDirectory(prefix="fbgraph-") as place:
            took_s, _ = run(logs, Path(place) / "b", "--workers", workers)
            index = read_index(f"{place}/b")
            busy = float(index["wall_s"].sum()) / workers / took_s
            walked_s, cpu_s = (float(index[name].sum()) for name in ("duration_s", "cpu_s"))
            print(
                f"{workers} worker(s), {len(index)} logs, {walked_s:.0f} s of walks: {took_s:.1f} s, "
                f"workers busy for {100.0 * busy:.0f} % of it, CPU {cpu_s:.1f} s"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure batches.")
    parser.add_argument("--logs", type=int, help="simulate so many, break one in a hundred, kill, resume")
    parser.add_argument("--ratio", type=Path, help="folder of real logs: one worker against two")
    asked = parser.parse_args()
    if asked.logs:
        many(asked.logs)
    if asked.ratio:
        ratio(asked.ratio)


if __name__ == "__main__":
    main()
