from collections.abc import Iterator

import pytest
from support.worker_tasks import work

from fbgraph.core.errors import ConfigError
from fbgraph.workers import dask_cluster
from fbgraph.workers.run_tasks import run_tasks

distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install fbgraph[cluster]")


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a scheduler whose one worker is a thread of this process."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


def test_outcomes_are_those_of_this_machine(scheduler: str) -> None:
    items: list[int | str] = [3, "hang", "data", "die", *range(10, 20)]
    there = {one.number: one for one in run_tasks(work, items, timeout=1.5, scheduler=scheduler)}
    here = {one.number: one for one in run_tasks(work, items, 2, 1.5)}
    assert sorted(there) == list(range(len(items)))
    for number in here:
        a, b = here[number], there[number]
        assert (a.value, a.cause, a.reason) == (b.value, b.cause, b.reason)
    assert [here[number].cause for number in range(4)] == ["", "time-out", "data", "died"]


def test_nobody_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_cluster, "_ANSWER_S", 0.2)
    with pytest.raises(ConfigError, match=r"--scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers there"):
        list(run_tasks(work, [1], scheduler="tcp://127.0.0.1:9"))


def test_a_worker_with_another_version_is_refused(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_cluster, "_version", lambda: "0.0.9")
    with pytest.raises(ConfigError, match=r"has fbgraph 0\.0\.9, here it is .*install the same"):
        list(run_tasks(work, [1], scheduler=scheduler))
