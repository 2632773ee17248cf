import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from support.worker_tasks import note_and_die_once, slowly, threads_told, work

from fbgraph.core.errors import ConfigError, DataError, FbgraphError
from fbgraph.workers.limits import LEAST_BYTES, share_of_memory
from fbgraph.workers.outcome import Outcome
from fbgraph.workers.run_tasks import run_tasks

MIB = 1 << 20


def by_number(outcomes: Iterable[Outcome[int]]) -> dict[int, Outcome[int]]:
    return {one.number: one for one in outcomes}


def test_what_goes_wrong_is_named_and_stops_no_other() -> None:
    items: list[int | str] = [1, "hang", 2, "eat", "die", 3, "exit", "disk", "data", "bug", *range(10, 20)]
    found = by_number(run_tasks(work, items, 2, 4.0, memory=200 * MIB))
    assert sorted(found) == list(range(len(items)))
    for number, item in enumerate(items):
        if isinstance(item, int):
            assert (found[number].value, found[number].cause, found[number].reason) == (item * item, "", "")
    causes = {item: found[number].cause for number, item in enumerate(items) if isinstance(item, str)}
    assert causes == {
        "hang": "time-out",
        "eat": "memory",
        "die": "died",
        "exit": "unexpected",
        "disk": "system",
        "data": "data",
        "bug": "unexpected",
    }
    reasons = [found[number].reason for number in (1, 3, 4, 8, 9)]
    assert reasons[0] == "not done after 4 s, and stopped"
    assert reasons[1] == "needs more memory than it may have"
    assert "SIGKILL" in reasons[2]
    assert reasons[3] == "walk.csv: nothing in it"
    assert reasons[4].startswith("KeyError: 'bug' (worker_tasks.py, line ")


def test_the_same_here_and_in_processes() -> None:
    items: list[int | str] = [3, "data", "disk", 4]
    here = by_number(run_tasks(work, items, 0, retries=1))
    there = by_number(run_tasks(work, items, 1, retries=1))
    for number in range(4):
        a, b = here[number], there[number]
        assert (a.value, a.cause, a.reason, a.tries) == (b.value, b.cause, b.reason, b.tries)
    assert [here[number].tries for number in range(4)] == [1, 1, 2, 1]  # a disk may recover, data do not


def test_who_needs_all_values_gets_the_error_of_the_first_that_has_none() -> None:
    items: list[int | str] = [3, "data", "bug"]
    good, bad, worse = run_tasks(work, items, 0)
    assert good.required() == 9
    with pytest.raises(DataError, match=r"walk\.csv: nothing in it"):
        bad.required()
    with pytest.raises(FbgraphError, match="KeyError: 'bug'"):
        worse.required()


def test_who_died_is_tried_again(tmp_path: Path) -> None:
    (outcome,) = run_tasks(note_and_die_once, [str(tmp_path / "begun")], 1, retries=1)
    assert (outcome.value, outcome.cause, outcome.tries) == ("done", "", 2)


def test_items_are_taken_as_they_are_needed() -> None:
    taken: list[int] = []

    def numbers() -> Iterator[int]:
        for number in range(1000):
            taken.append(number)
            yield number

    outcomes = run_tasks(work, numbers(), 1)
    next(outcomes)
    outcomes.close()  # type: ignore[attr-defined]
    assert len(taken) <= 4


def alive(process: int) -> bool:
    """Whether it is there and no zombie."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="asks /proc")
def test_processes_end_with_the_one_that_started_them(tmp_path: Path) -> None:
    place = tmp_path / "process"
    code = (
        "from support.worker_tasks import slowly\nfrom fbgraph.workers.run_tasks import run_tasks\n"
        f"if __name__ == '__main__':\n    list(run_tasks(slowly, [{str(place)!r}], 1))"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    main = subprocess.Popen([sys.executable, "-c", code], env=environment)
    deadline = time.monotonic() + 60.0
    while not (place.is_file() and place.read_text()) and time.monotonic() < deadline:
        time.sleep(0.05)
    worker = int(place.read_text())
    assert alive(worker)
    main.send_signal(signal.SIGKILL)
    main.wait()
    while alive(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(worker)


def test_leaving_early_ends_them_too(tmp_path: Path) -> None:
    place = tmp_path / "process"
    outcomes = run_tasks(slowly, [str(place)], 1, 1.0)
    assert next(outcomes).cause == "time-out"
    outcomes.close()  # type: ignore[attr-defined]
    assert not alive(int(place.read_text()))


def test_each_process_has_one_core() -> None:
    assert [one.value for one in run_tasks(threads_told, [0], 1)] == ["1"]
    assert threads_told(0) != "1" or "OPENBLAS_NUM_THREADS" in os.environ


def test_memory_is_shared_out() -> None:
    assert share_of_memory(10**6) == LEAST_BYTES
    assert share_of_memory(1) > 1.9 * share_of_memory(2) or share_of_memory(2) == LEAST_BYTES


def test_options_that_cannot_be() -> None:
    with pytest.raises(ConfigError, match="--workers -1"):
        list(run_tasks(math.sqrt, [1.0], -1))
    with pytest.raises(ConfigError, match="a --scheduler has its own"):
        list(run_tasks(math.sqrt, [1.0], 2, scheduler="tcp://127.0.0.1:1"))


def test_a_script_without_a_guard_is_told(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("import math, fbgraph.workers.run_tasks as engine\nlist(engine.run_tasks(math.sqrt, [4], 1))\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 1
    assert "ConfigError: no process can be started to work in: a script that asks" in ended.stderr
