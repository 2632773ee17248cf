#!/usr/bin/env python3
"""How fast: a one-hour walk through every stage, against the length of the walk and against each other."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from fbgraph import reruns
from fbgraph.core.config import load_config
from fbgraph.estimators.online_smoother import OnlineSmoother
from fbgraph.readers import read_log
from fbgraph.recording.recorder import write_recording
from fbgraph.run.summary import summarize, summary_markdown
from fbgraph.session import cut_log
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import SimulateOptions
from fbgraph.way_back.guide import ReturnGuide


def timed(*command: object) -> float:
    start = time.perf_counter()
    subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def resident_kb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1024


def recording_s(run: Path) -> float:
    """To write the recording of a run alone, at best."""
    result = reruns.repeat_run(run)
    text = summary_markdown(summarize(result))
    took = []
    for _ in range(3):
        begin = time.perf_counter()
        write_recording(result, run / "recording.rrd", text)
        took.append(time.perf_counter() - begin)
    return min(took)


def reading_ratio(log: Path) -> tuple[float, float]:
    """CPU seconds to read a log, and how often as many as ``pandas.read_csv`` of it takes; the best of five."""
    took: dict[str, list[float]] = {"ours": [], "pandas": []}
    for _ in range(5):  # in turns, so that both see the same machine
        for name, read in (("ours", read_log), ("pandas", pd.read_csv)):
            begin = time.process_time()
            read(log)
            took[name].append(time.process_time() - begin)
    return min(took["ours"]), min(took["ours"]) / min(took["pandas"])


def online(window_steps: int, steps: int, return_at: str = "never", piece_s: float = 0.1) -> str:
    """From a step's last sample to its updated pose, over a long walk: one row of the table."""
    config = load_config("m5stickc", [f"online.window_steps={window_steps}", f'returning.at="{return_at}"'])
    route = "square" if return_at == "never" else "out-and-back"
    log = simulate(load_route(route), SimulateOptions(duration_s=steps / 1.7)).log
    smoother, took_ms = OnlineSmoother(config, companion=ReturnGuide(config)), []
    memory_kb = resident_kb()
    for piece, _ in cut_log(log, piece_s, np.inf, lambda: False):
        begin = time.perf_counter()
        updates = smoother.feed(piece)
        if len(updates) == 1:
            took_ms.append(1e3 * (time.perf_counter() - begin))
        if len(took_ms) >= steps:
            break
    memory_kb = resident_kb() - memory_kb
    quarter = len(took_ms) // 4
    first, last = np.median(took_ms[:quarter]), np.median(took_ms[-quarter:])
    p50, p99 = np.percentile(took_ms, (50, 99))
    name = f"{window_steps}{'' if return_at == 'never' else ', guiding back'}"
    return (
        f"| {name} | {len(took_ms)} | {p50:.2f} ms | {p99:.2f} ms | {max(took_ms):.0f} ms | "
        f"{last / first:.2f} | {memory_kb / len(took_ms):.1f} kB |"
    )


def main() -> None:
    fbgraph = (sys.executable, "-m", "fbgraph")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "hour.csv"
        simulate_s = timed(*fbgraph, "simulate", log, "--route", "out-and-back", "--duration", 3600, "--seed", 1)
        read_s, ratio = reading_ratio(log)
        help_s = min(timed(*fbgraph, "--help") for _ in range(3))
        bare_s = timed(*fbgraph, "smooth", log, "--out", Path(folder) / "bare", "--no-recording")
        smooth_s = timed(*fbgraph, "smooth", log, "--out", Path(folder) / "run")
        record_s = recording_s(Path(folder) / "run")
        size_mb = (Path(folder) / "run" / "recording.rrd").stat().st_size / 1e6
    peak_gb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    print("| one hour at 100 Hz | |\n|---|---|")
    print(f"| `fbgraph smooth`, start to finished folder | {smooth_s:.1f} s ({3600 / smooth_s:.0f} x real time) |")
    print(f"| the same without recording | {bare_s:.1f} s |")
    print(f"| its recording alone | {record_s:.1f} s, {size_mb:.0f} MB |")
    print(f"| peak memory of any command | {peak_gb:.2f} GB |")
    print(f"| `read_log`, against `pandas.read_csv` | {read_s:.2f} s, {ratio:.1f} times |")
    print(f"| `fbgraph simulate` | {simulate_s:.1f} s |")
    print(f"| `fbgraph --help` | {help_s:.2f} s |")
    print(
        "\n| window, steps | steps walked | p50 | p99 | max | last / first quarter's median | memory a step |\n"
        "|---|---|---|---|---|---|---|"
    )
    for window_steps, steps in ((150, 20_000), (300, 20_000), (1000, 5_000), (1_000_000, 5_000)):
        print(online(window_steps, steps), flush=True)
    print(online(150, 5_000, "auto"))


if __name__ == "__main__":
    main()
