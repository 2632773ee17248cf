#!/usr/bin/env python3
"""Damaged logs, configurations, places and runs: each must give a result or one clear line.

.venv/bin/python scripts/fuzz.py [--cases N | --seconds S] [--seed N]

Every case has ten seconds and a gigabyte. A walk that comes out must be finite, nowhere faster than a sprinter, and no
longer than its time allows.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from fbgraph.core.aids import Told
from fbgraph.core.config import Config, load_config
from fbgraph.core.errors import FbgraphError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.pipeline import reconstruct, write_run
from fbgraph.readers import preset, read_log
from fbgraph.readers.places import read_checkpoints
from fbgraph.run.folder import claimed_run
from fbgraph.run.inputs import RunInputs
from fbgraph.run.read_run import read_directions, read_run, read_summary, score_run, trajectory_of
from fbgraph.simulator.files import write_m5stickc_csv, write_truth_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.study.column_names import load_layout

SPRINT_M_S = 12.5
LIMIT_S, LIMIT_KB = 10, 1 << 20
SMOOTHED_EVERY = 10  # logs that are read well are smoothed this often
# fmt: off
ODD = (
    "0", "-0", "1", "-1", "nan", "NaN", "inf", "-inf", "1e308", "-1e308", "1e-308", "1e400", "0x10", "1_000",
    "9999999999999999999999", "99999999999999", "-5", "3.5.1", "1,5", "-", "1\n5", "None", "null", "N/A",
    "\"\"", "\"", "'", ";", ",", "\t", "#", "%", "\\", "\x00", "\x1b[2J", "\u202e", "\xe9", "\xb2", "\u0661",
    "True", "[1]", "{}",
    "=1+1", "../..", "/dev/null", "1e15", "4294967296", "65535",
)
# fmt: on


def gsd_lines(log: SensorLog) -> str:
    """A log as GetSensorData writes it."""
    rows = ["% GetSensorData"]
    for kind, name in (("ACCE", "acc"), ("GYRO", "gyro"), ("MAGN", "mag"), ("PRES", "pressure")):
        stream = getattr(log, name)
        for t_s, values in zip(stream.t_s + 5.0, stream.values, strict=True):
            rows.append(f"{kind};{t_s:.3f};{t_s:.3f};{';'.join(f'{v:.5f}' for v in values)};3")
    return "\n".join(rows) + "\n"


def indoor_lines(log: SensorLog) -> str:
    """A log as the Indoor Location Competition's app writes it."""
    rows = []
    for kind, name in (("ACCELEROMETER", "acc"), ("GYROSCOPE", "gyro"), ("MAGNETIC_FIELD", "mag")):
        stream = getattr(log, name)
        for t_s, values in zip(stream.t_s, stream.values, strict=True):
            rows.append(
                (
                    t_s,
                    f"{1574572467406 + round(1e3 * t_s)}\tTYPE_{kind}\t"
                    + "\t".join(f"{v:.6f}" for v in values)
                    + "\t3",
                )
            )
    return "\n".join(line for _, line in sorted(rows)) + "\n"


def mutated(rng: random.Random, text: bytes) -> bytes:
    """A text with one to four things gone wrong in it."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        lines = text.split(b"\n")
        at = rng.randrange(len(lines))
        kind = rng.randrange(12)
        if kind == 0:
            text = text[: rng.randrange(len(text) + 1)]
        elif kind == 1:
            text = text[rng.randrange(len(text) + 1) :]
        elif kind == 2 and text:
            place = rng.randrange(len(text))
            text = text[:place] + bytes([rng.randrange(256)]) + text[place + 1 :]
        elif kind == 3:
            text = b"\n".join(lines[:at] + lines[at + rng.choice((1, 1, 10, 500)) :])
        elif kind == 4:
            text = b"\n".join(lines[:at] + lines[at : at + 50] * 2 + lines[at + 50 :])
        elif kind == 5:
            other = rng.randrange(len(lines))
            lines[at], lines[other] = lines[other], lines[at]
            text = b"\n".join(lines)
        elif kind in (6, 7, 8):
            separator = next((s for s in (b";", b"\t", b",") if s in lines[at]), b",")
            fields = lines[at].split(separator)
            fields[rng.randrange(len(fields))] = rng.choice(ODD).encode()
            lines[at] = separator.join(fields)
            text = b"\n".join(lines)
        elif kind == 9:
            column, odd = rng.randrange(12), rng.choice(ODD).encode()
            start, separator = rng.randrange(len(lines)), rng.choice((b",", b"\t", b";"))
            for i in range(start, min(start + rng.choice((1, 30, 100_000)), len(lines))):
                fields = lines[i].split(separator)
                if len(fields) > column:
                    fields[column] = odd
                    lines[i] = separator.join(fields)
            text = b"\n".join(lines)
        elif kind == 10:
            text = text.replace(rng.choice((b",", b";", b"\t", b".")), rng.choice((b",", b";", b"\t", b"", b" ")))
        else:
            text = rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"[boot]\n" * 70, b"\x00" * 100, b"\r")) + text
        if not text:
            return b"\n"
    return text


class Work:
    """What is damaged: logs of three formats, truth, a run folder; made once a process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        walk = simulate(load_route("square"), seed=3)
        self.log = walk.log
        write_m5stickc_csv(walk.log, folder / "walk.csv")
        write_truth_csv(walk, folder / "truth.csv", rate_hz=0.5)
        (folder / "gsd.txt").write_text(gsd_lines(walk.log), "utf-8")
        (folder / "indoor.txt").write_text(indoor_lines(walk.log), "utf-8")
        self.config = load_config("m5stickc")
        self.inputs = RunInputs.of(folder / "walk.csv")
        with claimed_run(folder / "run") as claim:
            write_run(reconstruct(walk.log, self.config, inputs=self.inputs), claim, recording=False)
        self.keys = [f"{t}.{k}" for t, values in self.config.model_dump().items() for k in values]

    def a_log(self, rng: random.Random) -> None:
        """A damaged log is read, and now and then smoothed."""
        source = rng.choice(("walk.csv", "walk.csv", "gsd.txt", "indoor.txt"))
        path = self.folder / f"odd-{source}"
        path.write_bytes(mutated(rng, (self.folder / source).read_bytes()))
        file = read_log(path)
        if rng.randrange(SMOOTHED_EVERY) == 0:
            believable(file.log, load_config(preset(file.log.format)), Told(truth=file.truth))

    def a_configuration(self, rng: random.Random) -> None:
        """Odd values of one to three keys."""
        numbers = (
            0,
            -1,
            1e-300,
            1e-9,
            1e-4,
            0.01,
            0.5,
            2,
            10,
            1e3,
            1e9,
            1e308,
            "inf",
            "nan",
            True,
            "[]",
            '"x"',
            "[0,0,1]",
        )
        keys = rng.sample(self.keys, rng.choice((1, 2, 3)))
        config = load_config("m5stickc", [f"{key}={rng.choice(numbers)}" for key in keys])
        if rng.randrange(3) == 0:
            believable(self.log, config, Told(), by_config=True)

    def places(self, rng: random.Random) -> None:
        """Damaged truth and anchors."""
        path = self.folder / "odd-places.csv"
        path.write_bytes(mutated(rng, (self.folder / "truth.csv").read_bytes()))
        known = read_checkpoints(path)
        told = Told(truth=known) if rng.randrange(2) else Told(anchors=known)
        if rng.randrange(3) == 0:
            believable(self.log, self.config, told)

    def a_mapping(self, rng: random.Random) -> None:
        """A damaged mapping file, and a damaged configuration file."""
        path = self.folder / "odd.toml"
        path.write_bytes(
            mutated(rng, b'[dataset]\nrate_hz = 100.0\n[dataset.columns]\ntruth_x = ["x", "east"]\ntime = "t"\n')
        )
        load_layout("forestback", mapping=path)

    def a_run(self, rng: random.Random) -> None:
        """A damaged run folder is scored and followed back."""
        run = self.folder / "odd-run"
        shutil.rmtree(run, ignore_errors=True)
        shutil.copytree(self.folder / "run", run)
        name = rng.choice(sorted(p.name for p in run.iterdir()))
        (run / name).write_bytes(mutated(rng, (run / name).read_bytes()))
        read_summary(run)
        saved = read_run(run)
        for estimator in ("smoothed", "ekf"):
            trajectory = trajectory_of(saved, estimator)
            require_believable(trajectory.xy_m, trajectory.t_s)
        read_directions(saved)
        score_run(saved, read_checkpoints(self.folder / "truth.csv"))


def believable(log: SensorLog, config: Config, told: Told, by_config: bool = False) -> None:
    """Smooth a walk; AssertionError if what comes out cannot have been walked."""
    result = reconstruct(log, config, told)
    for name, trajectory in result.trajectories.items():
        assert np.isfinite(trajectory.xy_m).all(), f"{name} is not finite"
        free = by_config or (name == "smoothed" and told.anchors is not None)
        if not free:
            require_believable(trajectory.xy_m, trajectory.t_s)


def require_believable(xy_m: np.ndarray, t_s: np.ndarray) -> None:
    """Nowhere faster than a sprinter."""
    steps_m, dt_s = np.hypot(*np.diff(xy_m, axis=0).T), np.diff(t_s)
    fast = steps_m > SPRINT_M_S * dt_s + 1.0
    assert not fast.any(), f"{steps_m[fast][:1]} m in {dt_s[fast][:1]} s"


def late(number: int, frame: object) -> None:
    raise TimeoutError(f"longer than {LIMIT_S} s")


def one_process(given: tuple[int, int, float]) -> tuple[int, Counter[str], list[str]]:
    """Cases of one process: how many, how they ended by kind, what was wrong."""
    seed, count, until_s = given
    signal.signal(signal.SIGALRM, late)
    warnings.simplefilter("error", RuntimeWarning)  # of numpy: a second line on the terminal, and often nonsense
    ended: Counter[str] = Counter()
    wrong: list[str] = []
    done = 0
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        work = Work(Path(folder))
        kinds: list[Callable[[random.Random], None]] = [work.a_configuration, work.places, work.a_mapping]
        kinds += [*[work.a_log] * 5, *[work.a_run] * 2]
        while done < count and time.monotonic() < until_s:
            rng = random.Random(f"{seed}-{done}")
            kind = rng.choice(kinds)
            signal.alarm(LIMIT_S)
            try:
                kind(rng)
                ended[f"{kind.__name__}: a result"] += 1
            except FbgraphError as error:
                ended[f"{kind.__name__}: {type(error).__name__}"] += 1
                if not 10 < len(str(error)) < 2000:
                    wrong.append(f"{seed}-{done} {kind.__name__}: an unclear line: {str(error)[:200]!r}")
            except Exception as error:
                wrong.append(f"{seed}-{done} {kind.__name__}: {type(error).__name__}: {str(error)[:300]}")
            finally:
                signal.alarm(0)
            done += 1
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > LIMIT_KB:
            wrong.append(f"{seed}: more than a gigabyte")
    return done, ended, wrong


def main() -> int:
    """Damage and see; 0 if nothing was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=200_000)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    until_s, share = time.monotonic() + given.seconds, -(-given.cases // given.processes)
    with Pool(given.processes) as pool:
        found = pool.map(one_process, [(1000 * given.seed + i, share, until_s) for i in range(given.processes)])
    ended: Counter[str] = Counter()
    for _, kinds, _ in found:
        ended += kinds
    for text, count in sorted(ended.items()):
        print(f"{count:8d}  {text}")
    wrong = [text for _, _, texts in found for text in texts]
    with contextlib.suppress(BrokenPipeError):
        print("".join(f"WRONG {text}\n" for text in wrong), end="")
    print(f"{sum(done for done, _, _ in found)} cases, {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
