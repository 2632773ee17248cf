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
import io
import json
import os
import random
import resource
import shutil
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

import click
import fuzz_inputs
import numpy as np
import typer
from fuzz_inputs import damaged, mutated

from fbgraph.cli.app import app
from fbgraph.core.aids import Told
from fbgraph.core.config import Config, dump_toml, load_config
from fbgraph.core.errors import FbgraphError
from fbgraph.core.sensor_log import SensorLog
from fbgraph.exports import FORMATS
from fbgraph.pipeline import reconstruct, write_run
from fbgraph.readers import preset, read_log
from fbgraph.readers.layout import layout_toml
from fbgraph.readers.live_lines import LiveReader
from fbgraph.readers.places import gnss_of, read_checkpoints
from fbgraph.readers.raw_recorder import LineCutter
from fbgraph.run.folder import claimed_run
from fbgraph.run.inputs import RunInputs
from fbgraph.run.read_run import read_directions, read_run, read_summary, score_run, trajectory_of
from fbgraph.simulator.files import write_m5stickc_csv, write_truth_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate
from fbgraph.simulator.simulate_options import Device, SimulateOptions
from fbgraph.study.column_names import load_layout
from fbgraph.study.course import simulated_trials, write_trial
from fbgraph.study.dataset import read_dataset

SPRINT_M_S = 12.5
LIMIT_S, PATIENCE_S, LIMIT_BYTES = 10.0, 120.0, 1 << 30
SMOOTHED_EVERY = 12  # logs that are read well are smoothed this often
BRIEF_S = 5.0
SHARES = (70, 27, 3)  # of the beginning of a short walk, all of it, and a longer one: what costs time comes seldom
_NUMBERS = (0, -1, 1e-300, 1e-9, 1e-4, 0.01, 0.5, 2, 10, 1e3, 1e9, 1e308, "inf", "nan", True, "[]", '"x"', "[0,0,1]")
_COMMAND = typer.main.get_command(app)
_PRINTED = ("text", "json", "geojson", "gpx", "csv")


class Work:
    """What is damaged, made once a process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        short = SimulateOptions(device=Device(rate_hz=50.0))
        walk, longer = simulate(load_route("square", 0.2), short, seed=3), simulate(load_route("square"), seed=3)
        self.log = walk.log
        self.logs = [
            _written(walk.log.between(-np.inf, BRIEF_S), folder / "brief.csv"),
            _written(walk.log, folder / "walk.csv"),
            _written(longer.log, folder / "longer.csv"),
        ]
        write_truth_csv(walk, folder / "truth.csv", rate_hz=0.5)
        self.truth = (folder / "truth.csv").read_bytes()
        self.config = load_config("m5stickc")
        file, inputs = read_log(folder / "walk.csv"), RunInputs.of(folder / "walk.csv")
        assert file.reading is not None
        self.layout, self.config_toml = layout_toml(file.reading.layout).encode(), dump_toml(self.config).encode()
        with claimed_run(folder / "run") as claim:
            result = reconstruct(walk.log, self.config, Told(truth=read_checkpoints(folder / "truth.csv")), inputs)
            write_run(result, claim, recording=False)
        xy_m = result.smoothed.trajectory.xy_m[::2]
        self.places = fuzz_inputs.places(self.truth, xy_m, result.smoothed.trajectory.t_s[::2] + walk.log.t0_s)
        self.keys = [f"{t}.{k}" for t, values in self.config.model_dump().items() for k in values]
        _, trial, remark = next(iter(simulated_trials(1, 1)))
        write_trial(trial, folder / "trial.csv", remark)
        lines = (folder / "trial.csv").read_bytes().split(b"\n")
        self.trial = b"\n".join(lines[:400])

    def a_log(self, rng: random.Random) -> None:
        """A damaged log is read, and now and then smoothed."""
        path = self._odd_log(rng)
        rate_hz = 50.0 if rng.randrange(8) == 0 else None
        file = read_log(path, rate_hz=rate_hz)
        if path.suffix == ".zip" or path.is_dir():
            gnss_of(path)
        if rng.randrange(SMOOTHED_EVERY) == 0:
            believable(file.log, load_config(preset(file.log.format)), Told(truth=file.truth))

    def a_layout(self, rng: random.Random) -> None:
        """A log is read by a damaged layout."""
        path = damaged(rng, self.layout, self.folder, "layout.toml")
        read_log(self.folder / "walk.csv", layout=path)

    def live_lines(self, rng: random.Random) -> None:
        """Damaged lines come in pieces of any size."""
        data, reader, cutter = mutated(rng, self._bytes(rng)), LiveReader(), LineCutter()
        last_s, piece = -1.0, rng.choice((100, 3000, 20_000, 10**6))
        for at in range(0, len(data), piece):
            some = reader.push(cutter.push(data[at : at + piece]))
            assert not len(some.acc.t_s) or (np.diff(some.acc.t_s, prepend=last_s) > 0).all(), "time goes back"
            last_s = float(some.acc.t_s[-1]) if len(some.acc.t_s) else last_s
        reader.push(cutter.finish())
        reader.finish()

    def a_configuration(self, rng: random.Random) -> None:
        """Odd values of one to three keys, or a damaged file of them."""
        if rng.randrange(3) == 0:
            config = load_config(str(damaged(rng, self.config_toml, self.folder, "odd.toml")))
        else:
            keys = rng.sample(self.keys, rng.choice((1, 2, 3)))
            config = load_config("m5stickc", [f"{key}={rng.choice(_NUMBERS)}" for key in keys])
        if rng.randrange(3) == 0:
            believable(self.log, config, Told(), by_config=True)

    def some_places(self, rng: random.Random) -> None:
        """Damaged truth and anchors."""
        name = rng.choice(sorted(self.places))
        known = read_checkpoints(damaged(rng, self.places[name], self.folder, name))
        told = Told(truth=known) if rng.randrange(2) else Told(anchors=known)
        if rng.randrange(8) == 0:
            believable(self.log, self.config, told)

    def a_mapping(self, rng: random.Random) -> None:
        """A damaged mapping file."""
        whole = b'[dataset]\nrate_hz = 100.0\n[dataset.columns]\ntruth_x = ["x", "east"]\ntime = "t"\n'
        load_layout("forestback", mapping=damaged(rng, whole, self.folder, "odd.toml"))

    def a_data_set(self, rng: random.Random) -> None:
        """A damaged trial, alone or among others."""
        whole = self.trial if rng.randrange(2) else {"trial_01.csv": self.trial, "trial_02.csv": self.trial[:9000]}
        read_dataset(
            damaged(rng, whole, self.folder, "trials" if isinstance(whole, dict) else "t.csv"),
            load_layout("forestback"),
        )

    def a_run(self, rng: random.Random) -> None:
        """A damaged run folder is read, scored and followed back."""
        run = self._odd_run(rng)
        read_summary(run)
        saved = read_run(run)
        for estimator in saved.trajectories:
            trajectory = trajectory_of(saved, estimator)
            require_believable(trajectory.xy_m, trajectory.t_s)
        if rng.randrange(2):
            score_run(saved, read_checkpoints(self.folder / "truth.csv"))
        else:
            read_directions(saved)

    def a_run_command(self, rng: random.Random) -> None:
        """A damaged run folder is evaluated, exported or followed back from the command line."""
        run, kind, out = self._odd_run(rng), rng.randrange(3), str(self.folder / "out")
        where = ["--origin", "49.46,11.11"] if rng.randrange(2) else []
        if kind == 0:
            truth = rng.choice(("truth.csv", "odd-truth.csv"))
            (self.folder / "odd-truth.csv").write_bytes(mutated(rng, self.truth))
            require_json(said("evaluate", str(run), "--truth", str(self.folder / truth), "--json"))
        elif kind == 1:
            printed = rng.choice(_PRINTED)
            text = said("guide", str(run), "--format", printed, *where)
            if printed in ("json", "geojson"):
                require_json(text)
        else:
            said("export", str(run), "--to", rng.choice(sorted(FORMATS)), "--out", out, *where)

    def a_log_command(self, rng: random.Random) -> None:
        """A damaged log is inspected, or converted and read back the same."""
        path = self._odd_log(rng)
        if rng.randrange(2):
            require_json(said("inspect", str(path), "--json"))
            return
        out = self.folder / "converted.csv"
        for old in self.folder.glob("converted*"):
            old.unlink()
        said("convert", str(path), str(out))
        before, after = read_log(path).log, read_log(out).log
        assert len(before.acc.t_s) == len(after.acc.t_s), f"{len(before.acc.t_s)} samples, {len(after.acc.t_s)} back"

    def _some_logs(self, rng: random.Random) -> dict[str, fuzz_inputs.Input]:
        return rng.choices(self.logs, SHARES)[0]

    def _bytes(self, rng: random.Random) -> bytes:
        """A log that is one file."""
        found = self._some_logs(rng)[
            rng.choice(("walk.csv", "walk.csv", "long.csv", "walk.gcsv", "gsd.txt", "lines.json"))
        ]
        assert isinstance(found, bytes)
        return found

    def _odd_log(self, rng: random.Random) -> Path:
        logs = self._some_logs(rng)
        name = rng.choice(("walk.csv", "walk.csv", *sorted(logs)))
        return damaged(rng, logs[name], self.folder, name)

    def _odd_run(self, rng: random.Random) -> Path:
        """A run of which one file is damaged, by somebody who did not mind its digests."""
        run = self.folder / "odd-run"
        shutil.rmtree(run, ignore_errors=True)
        run.mkdir()
        names = sorted(p.name for p in (self.folder / "run").iterdir())
        files = {name: (self.folder / "run" / name).read_bytes() for name in names}
        if rng.randrange(4):
            summary = json.loads(files["summary.json"])
            summary.pop("sha256", None)
            files["summary.json"] = json.dumps(summary, indent=2).encode()
        name = rng.choice(names)
        if rng.randrange(20) == 0:
            files.pop(name)
        else:
            files[name] = mutated(rng, files[name])
        for name, data in files.items():
            (run / name).write_bytes(data)
        return run


def _written(log: SensorLog, path: Path) -> dict[str, fuzz_inputs.Input]:
    write_m5stickc_csv(log, path)
    return fuzz_inputs.logs(log, path.read_bytes())


def said(*arguments: str) -> str:
    """What a command prints to stdout."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", errors="backslashreplace") for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            _COMMAND.main(list(arguments), standalone_mode=False)
        except click.ClickException as error:
            raise AssertionError(f"{arguments[0]}: {error.format_message()}") from error
    out.flush()
    return out.buffer.getvalue().decode() if isinstance(out.buffer, io.BytesIO) else ""


def require_json(text: str) -> None:
    """Of numbers that are finite."""

    def refuse(constant: str) -> Any:
        raise AssertionError(f"{constant} in JSON")

    json.loads(text, parse_constant=refuse)


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


KINDS = {
    **{"a_log": 8, "a_log_command": 3, "live_lines": 1, "a_layout": 4, "some_places": 6, "a_run": 6},
    **{"a_run_command": 6, "a_configuration": 3, "a_mapping": 1, "a_data_set": 3},
}
"""Methods of ``Work``, and how often each is drawn."""


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
