#!/usr/bin/env python3
"""Does it know when it is wrong? .venv/bin/python scripts/integrity.py [--walks 2000] [--kind NAME] [--only SEED]

Simulated walks with exact truth, of every kind of disturbance at random strengths, each drawn by its seed. Of the walks
that fbgraph calls ``sound`` the truth must be inside its ellipses; walks on which nothing is wrong must be called so.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from dataclasses import asdict
from functools import partial
from pathlib import Path

from judged_walks import figures, judged, table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--walks", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--part", type=int, default=1, help="every so manieth seed only; the tests take every 40th")
    parser.add_argument("--kind", default="", help="only walks of this kind")
    parser.add_argument("--only", type=int, help="one seed, in full")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path, help="where to write what came of each walk")
    given = parser.parse_args()
    if given.only is not None:
        print(json.dumps(asdict(judged(given.only, given.kind)), indent=1, ensure_ascii=False))
        return
    seeds = range(given.first, given.first + given.walks, given.part)
    with multiprocessing.get_context("spawn").Pool(given.processes) as pool:
        walks = pool.map(partial(judged, only=given.kind), seeds, chunksize=4)
    print(table(walks))
    for name, value in figures(walks).items():
        print(f"{name}: {value:.4g}")
    if given.json:
        given.json.write_text(json.dumps([asdict(walk) for walk in walks], ensure_ascii=False))


if __name__ == "__main__":
    main()
