#!/usr/bin/env python3
"""Damaged logs, layouts, configurations, places, runs and data sets: each must give a result or one clear line.

.venv/bin/python scripts/fuzz.py [--cases N | --seconds S] [--seed N] [--kinds NAME …] [--only SEED-NUMBER …]

A process imports everything once and damages one short walk, mostly its beginning, now and then a longer one, in the
forms of ``fuzz_inputs.py``; a share of the logs that are read well is smoothed too. Every case has ten seconds of the
processor, two minutes of the clock and a gigabyte. A walk that comes out must be finite, nowhere faster than a
sprinter, and no longer than its time allows; what commands print must be JSON where they say so. ``--only`` runs single
cases again and shows where they fail.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from multiprocessing import Pool
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a second thread gains nothing with matrices this small,
os.environ.setdefault("OMP_NUM_THREADS", "1")  # nor with tables

from fuzz_work import KINDS, Work

from fbgraph.core.errors import FbgraphError

LIMIT_S, PATIENCE_S, LIMIT_BYTES = 10.0, 120.0, 1 << 30


def late(number: int, frame: object) -> None:
    raise TimeoutError(f"longer than {LIMIT_S} s")


def one_case(work: Work, kinds: list[str], name: str) -> tuple[str, str]:
    """How a case ended, and what was wrong."""
    rng = random.Random(name)
    kind = rng.choice(kinds)
    error = bounded(getattr(work, kind), rng)
    if error is None:
        return f"{kind}: a result", ""
    text = str(error)
    if isinstance(error, FbgraphError):
        clear = 10 < len(text) < 2000 and "\n" not in text.strip()
        return f"{kind}: {type(error).__name__}", "" if clear else f"{kind}: an unclear line: {text[:200]!r}"
    frames = traceback.extract_tb(error.__traceback__)
    ours = "".join([f" {Path(f.filename).name}:{f.lineno}" for f in frames if "fbgraph/" in f.filename][-1:])
    return f"{kind}: wrong", f"{kind}: {type(error).__name__}{ours}: {text[:300]}"


def bounded(method: Callable[[random.Random], None], rng: random.Random) -> Exception | None:
    """What is raised by a method that may not take for ever."""
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    signal.alarm(round(PATIENCE_S))
    try:
        method(rng)
    except Exception as error:
        return error
    finally:
        signal.alarm(0)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return None


def one_process(given: tuple[int, int, float, list[str]]) -> tuple[int, Counter[str], list[str]]:
    """Cases of one process: how many, how they ended by kind, what was wrong."""
    seed, count, until_s, kinds = given
    ended: Counter[str] = Counter()
    wrong: list[str] = []
    done = 0
    with prepared() as work:
        while done < count and time.monotonic() < until_s:
            end, text = one_case(work, kinds, f"{seed}-{done}")
            ended[end] += 1
            if text:
                wrong.append(f"{seed}-{done} {text}")
                print(f"WRONG {wrong[-1]}", flush=True)
            done += 1
            if done % 5000 == 0:
                print(f"{done} cases", file=sys.stderr, flush=True)
    return done, ended, wrong


@contextlib.contextmanager
def prepared() -> Any:
    """All that is damaged, in a folder that vanishes; signals and warnings as errors."""
    signal.signal(signal.SIGALRM, late)
    signal.signal(signal.SIGPROF, late)
    resource.setrlimit(resource.RLIMIT_DATA, (LIMIT_BYTES, LIMIT_BYTES))  # beyond it, a MemoryError
    warnings.simplefilter("error", RuntimeWarning)  # of numpy: a second line on the terminal, and often nonsense
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=memory if memory.is_dir() else None) as folder:
        yield Work(Path(folder))


def main() -> int:
    """Damage and see; 0 if nothing was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=200_000)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--kinds", nargs="+", choices=sorted(KINDS), default=sorted(KINDS))
    parser.add_argument("--only", nargs="+", metavar="SEED-NUMBER", help="these cases alone, with a traceback")
    given = parser.parse_args()
    kinds = [kind for kind in given.kinds for _ in range(KINDS[kind])]
    if given.only:
        return again(given.only, kinds)
    until_s, share = time.monotonic() + given.seconds, -(-given.cases // given.processes)
    cases = [(1000 * given.seed + i, share, until_s, kinds) for i in range(given.processes)]
    with Pool(given.processes) as pool:
        found = pool.map(one_process, cases)
    ended: Counter[str] = Counter()
    for _, by_kind, _ in found:
        ended += by_kind
    for text, count in sorted(ended.items()):
        print(f"{count:8d}  {text}")
    wrong = [text for _, _, texts in found for text in texts]
    print(f"{sum(done for done, _, _ in found)} cases, {len(wrong)} wrong")
    return 1 if wrong else 0


def again(names: list[str], kinds: list[str]) -> int:
    """Run single cases and show where they fail."""
    with prepared() as work:
        for name in names:
            rng = random.Random(name)
            kind, began = rng.choice(kinds), time.process_time()
            error = bounded(getattr(work, kind), rng)
            print(f"{name} {kind}: {'a result' if error is None else ''} {time.process_time() - began:.2f} s")
            if error is not None:
                traceback.print_exception(error, limit=-8, file=sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
