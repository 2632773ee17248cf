"""Batches and their runs, without the seconds that they took."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pandas as pd

from fbgraph.batches.index import read_index
from fbgraph.batches.index_row import TIMINGS


def told(out: Path) -> pd.DataFrame:
    """The index without what differs from run to run."""
    return read_index(str(out)).drop(columns=list(TIMINGS))


def files_of(run: Path) -> dict[str, str]:
    """What a run folder holds, without the seconds that it took."""
    found = {}
    for path in sorted(run.iterdir()):
        if path.suffix == ".json":
            content = json.loads(path.read_text())
            for key in ("seconds", "sha256", "row", "key"):
                content.pop(key, None)
            found[path.name] = json.dumps(content)
        else:
            found[path.name] = path.read_text("latin-1")
    return found


def require_same_batches(a: Path, b: Path) -> None:
    """The same index and, to the last bit, the same runs."""
    assert sorted(os.listdir(a / "runs")) == sorted(os.listdir(b / "runs"))
    for run in (a / "runs").iterdir():
        assert files_of(run) == files_of(b / "runs" / run.name)
    pd.testing.assert_frame_equal(told(a), told(b))
