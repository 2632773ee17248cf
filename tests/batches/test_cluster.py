import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Thread

import pytest
from support.batches_compared import require_same_batches

from fbgraph.batches.batch import batch
from fbgraph.simulator.files import simulate_files
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate_options import SimulateOptions

pytest.importorskip("distributed", reason="Dask is not installed: pip install fbgraph[cluster]")


@contextmanager
def process(*typed: object) -> Iterator[subprocess.Popen[bytes]]:
    """A module run by another interpreter until the block ends."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    command = [sys.executable, "-m", *map(str, typed)]
    started = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield started
    finally:
        started.kill()
        started.wait()


def until(true: object, what: str) -> None:
    assert callable(true)
    deadline = time.monotonic() + 60.0
    while not true():
        assert time.monotonic() < deadline, what
        time.sleep(0.02)


def test_a_cluster_gives_the_same_bits_and_bears_the_death_of_a_worker(tmp_path: Path) -> None:
    walks, there, here = tmp_path / "walks", tmp_path / "there", tmp_path / "here"
    walks.mkdir()
    for seed in range(4):
        simulate_files(walks / f"walk{seed}.csv", load_route("straight", 0.4), SimulateOptions(duration_s=12.0), seed)
    (walks / "bad.csv").write_text("nothing\n")
    shared = tmp_path / "scheduler.json"
    worker = (
        "distributed.cli.dask_worker",
        "--scheduler-file",
        shared,
        "--no-nanny",
        "--nthreads",
        1,
        "--no-dashboard",
    )
    with ExitStack() as started:
        start = started.enter_context
        start(process("distributed.cli.dask_scheduler", "--scheduler-file", shared, "--port", 0, "--no-dashboard"))
        until(shared.is_file, "no scheduler")
        workers = [start(process(*worker)) for _ in range(2)]
        address = json.loads(shared.read_text())["address"]

        def kill_one() -> None:
            until(lambda: list((there / "runs").glob("[!.]*/summary.json")), "no run")
            workers[0].kill()

        death = Thread(target=kill_one)
        death.start()
        index = batch(walks, out=there, scheduler=address, recording=False)
        death.join()
    assert list(index["status"]) == ["failed", *["done"] * 4]
    batch(walks, out=here, workers=0, recording=False)
    require_same_batches(there, here)
