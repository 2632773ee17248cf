import os
from pathlib import Path

import pytest

from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import simulate

SHARED_DATA = Path(__file__).parents[1].parent / "shared" / "data"


@pytest.fixture(autouse=True)
def _no_width_of_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever runs the tests may have told the width of a terminal; tests that want one say so."""
    monkeypatch.delenv("COLUMNS", raising=False)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real logs beside the project; tests that need it are skipped on machines that lack it.

    FBGRAPH_SHARED_DATA says that it lies elsewhere.
    """
    folder = Path(os.environ.get("FBGRAPH_SHARED_DATA", SHARED_DATA))
    if not folder.is_dir():
        pytest.skip(f"the folder of real logs, {folder}, is not on this machine")
    return folder


@pytest.fixture(scope="session")
def device_lines(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A simulated walk as the wearable writes it, line by line."""
    path = tmp_path_factory.mktemp("device") / "walk.csv"
    write_m5stickc_csv(simulate(load_route("square"), seed=7).log, path)
    return path.read_text().splitlines(keepends=True)
