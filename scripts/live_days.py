#!/usr/bin/env python3
"""What a live walk of many hours takes: its lines come as fast as they are taken, memory and time are told every hour.

.venv/bin/python scripts/live_days.py [--hours N] [--walking SHARE] [--no-recording]
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fbgraph.core.config import load_config
from fbgraph.pipeline import write_run
from fbgraph.run.folder import claimed_live
from fbgraph.session import follow_source
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import Route
from fbgraph.simulator.simulate import simulate

HOUR_MS = 3_600_000
LAP_M = ((0, 0), (5, 0), (5, 10), (-5, 10), (-5, 0), (0, 0))  # begins and ends to the East: hours can be joined
LAP_S = 33.0
PIECE_ROWS = 100  # a second of them


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def an_hour(walking: float, folder: Path) -> tuple[str, list[tuple[int, str]]]:
    """Header, and (time, rest of the line) of each row: laps for this share of an hour, then standing still."""
    laps = max(round(walking * 3600.0 / LAP_S), 1)
    rows = np.array([(*place, 0.0) for place in LAP_M])
    route = Route("laps", rows, np.zeros(len(rows)), tuple("012345")).repeated(laps)
    route.pause_s[-1] = max(3600.0 - laps * LAP_S, 0.0)
    write_m5stickc_csv(simulate(route, seed=1).log, folder / "hour.csv")
    header, *lines = (folder / "hour.csv").read_text("utf-8").splitlines()
    cut = (line.partition(",") for line in lines)
    return header, [(int(t_ms), rest) for t_ms, _, rest in cut]


def device(hours: float, header: str, rows: list[tuple[int, str]]) -> Iterator[bytes]:
    """The hour again and again."""
    yield f"{header}\n".encode()
    begun, length_ms, told = time.monotonic(), rows[-1][0] - rows[0][0] + 10, 0
    for again in range(int(np.ceil(hours * HOUR_MS / length_ms))):
        for at in range(0, len(rows), PIECE_ROWS):
            piece = rows[at : at + PIECE_ROWS]
            now_ms = piece[0][0] + again * length_ms
            if now_ms - rows[0][0] > hours * HOUR_MS:
                return
            if now_ms - rows[0][0] >= told * HOUR_MS:
                print(f"{told:3d} h  {time.monotonic() - begun:7.0f} s  {resident_mb():7.0f} MB", flush=True)
                told += 1
            yield "".join(f"{t_ms + again * length_ms},{rest}\n" for t_ms, rest in piece).encode()
    print(f"{told:3d} h  {time.monotonic() - begun:7.0f} s  {resident_mb():7.0f} MB", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=48.0)
    parser.add_argument("--walking", type=float, default=1 / 3, help="share of the time that is walked")
    parser.add_argument("--no-recording", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        header, rows = an_hour(given.walking, folder)
        with claimed_live(folder / "run", resume=False) as claim:
            source = device(given.hours, header, rows)
            result = follow_source(
                source, claim.place, load_config("m5stickc"), tell=print, recording=not given.no_recording
            )
            begun = time.monotonic()
            print(f"{len(result.track)} breadcrumbs; smoothed, {resident_mb():.0f} MB", flush=True)
            write_run(result, claim, recording=not given.no_recording)
            print(f"written in {time.monotonic() - begun:.0f} s")
        for path in sorted((folder / "run").iterdir()):
            print(f"{path.stat().st_size / 1e6:9.1f} MB  {path.name}")
    print(f"peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3:.0f} MB")


if __name__ == "__main__":
    main()
