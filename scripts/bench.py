#!/usr/bin/env python3
"""How fast: a one-hour walk through every stage, against the length of the walk and against each other."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def timed(*command: object) -> float:
    start = time.perf_counter()
    subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    fbgraph = (sys.executable, "-m", "fbgraph.cli")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "hour.csv"
        simulate_s = timed(*fbgraph, "simulate", log, "--route", "out-and-back", "--duration", 3600, "--seed", 1)
        help_s = min(timed(*fbgraph, "--help") for _ in range(3))
        bare_s = timed(*fbgraph, "smooth", log, "--out", Path(folder) / "bare", "--no-recording")
        smooth_s = timed(*fbgraph, "smooth", log, "--out", Path(folder) / "run")
        size_mb = (Path(folder) / "run" / "recording.rrd").stat().st_size / 1e6
    peak_gb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    print("| one hour at 100 Hz | |\n|---|---|")
    print(f"| `fbgraph smooth`, start to finished folder | {smooth_s:.1f} s ({3600 / smooth_s:.0f} x real time) |")
    print(f"| the same without recording | {bare_s:.1f} s |")
    print(f"| recording | {size_mb:.0f} MB |")
    print(f"| peak memory of any command | {peak_gb:.2f} GB |")
    print(f"| `fbgraph simulate` | {simulate_s:.1f} s |")
    print(f"| `fbgraph --help` | {help_s:.2f} s |")


if __name__ == "__main__":
    main()
