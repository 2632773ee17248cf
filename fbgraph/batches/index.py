"""The index of a batch: a row a log, as Parquet and as CSV."""

from __future__ import annotations

import json
from array import array
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import TYPE_CHECKING, Any

from fbgraph.batches.index_row import COLUMNS
from fbgraph.batches.log_entry import MANIFEST
from fbgraph.batches.places import fetched, joined, names_at, written_file
from fbgraph.core.errors import DataError
from fbgraph.core.safe_text import for_csv, visible

if TYPE_CHECKING:
    import pandas as pd

INDEX = "index.parquet"
INDEX_CSV = "index.csv"
_PART = 10_000  # rows that are objects of Python at a time


class Rows:
    """Rows as they come, kept on the disk, so that a million of them take no memory."""

    def __init__(self, count: int) -> None:
        """For so many logs."""
        self._file = TemporaryFile()  # noqa: SIM115 it lives as long as the rows
        self._at = array("q", [-1]) * count

    def put(self, number: int, row: Mapping[str, Any]) -> None:
        """Keep the row of the log of this number."""
        self._at[number] = self._file.seek(0, 2)
        self._file.write(json.dumps(row).encode() + b"\n")

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """All of them, in the order of the logs."""
        for at in self._at:
            self._file.seek(at)
            yield json.loads(self._file.readline())

    def __len__(self) -> int:
        return len(self._at)


def index_frame(rows: Rows) -> pd.DataFrame:
    """The index: ``COLUMNS``, a row a log; text in it is shown, whatever was in the log or its name."""
    import pandas as pd

    parts, coming = [], iter(rows)
    while some := list(islice(coming, _PART)):
        cells = {name: [_cell(row.get(name), kind) for row in some] for name, kind in COLUMNS.items()}
        parts.append(pd.DataFrame(cells).astype(COLUMNS))
    return pd.concat(parts, ignore_index=True)


def _cell(value: Any, kind: str) -> Any:
    return visible(value or "") if kind == "string" else value


def write_index(frame: pd.DataFrame, out: str) -> None:
    """Write both files.

    Raises:
        ConfigError: they cannot be written.
    """
    with written_file(joined(out, INDEX)) as partial:
        frame.to_parquet(partial, index=False)
    safe = frame.copy(deep=False)
    for name, kind in COLUMNS.items():
        if kind == "string":
            safe[name] = frame[name].map(for_csv)
    with written_file(joined(out, INDEX_CSV)) as partial:
        safe.to_csv(partial, index=False, lineterminator="\n")


def read_index(batch: str) -> pd.DataFrame:
    """The index of a batch.

    Raises:
        DataError: no batch, one that has not come to its end, or a file that is no index.
    """
    import pandas as pd

    there = names_at(batch) if "://" in batch or Path(batch).is_dir() else set()
    if INDEX not in there:
        begun = "a batch that has not come to its end: go on with --resume" if MANIFEST in there else "no batch"
        raise DataError(f"{batch}: {begun} (no {INDEX} there); `fbgraph batch LOGS… --out DIR` makes one")
    with TemporaryDirectory(prefix="fbgraph-") as folder:
        path = fetched(joined(batch, INDEX), Path(folder))
        try:
            frame = pd.read_parquet(path)
            return frame[list(COLUMNS)].astype(COLUMNS)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DataError(
                f"{batch}: {INDEX} is damaged, or of another fbgraph ({error}); --resume writes it"
            ) from error
