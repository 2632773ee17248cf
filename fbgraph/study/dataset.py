"""A data set of trials, laid out as ForestBack's: a table a trial, as CSVs in a folder or zip, or all in one table."""

from __future__ import annotations

from dataclasses import dataclass
from io import StringIO
from pathlib import Path

from fbgraph.core.bounded import MOST_COLUMNS
from fbgraph.core.errors import DataError
from fbgraph.study.column_names import ColumnsConfig, DatasetConfig
from fbgraph.study.containers import natural, tables_in
from fbgraph.study.trial import Table, Trial, find_columns, read_trial

_MOST_REMARKS = 100


@dataclass(frozen=True)
class Dataset:
    """All trials of a data set.

    Attributes:
        source: where it was read from.
        trials: in natural order of their names.
        skipped: name and reason of every table that could not be used.
        simulated: how the trials were simulated, as they say themselves; empty for real ones.
        layout: by which they were read.
    """

    source: str
    trials: tuple[Trial, ...]
    skipped: tuple[tuple[str, str], ...]
    simulated: str
    layout: DatasetConfig


def read_dataset(path: Path, config: DatasetConfig, most: int | None = None, max_size: int | None = None) -> Dataset:
    """Read a data set.

    Args:
        path: a CSV, a folder or a zip of them.
        config: its layout.
        most: no more than the first so many trials.
        max_size: bytes of text that are read of all tables together; 1 GiB if None, and no bombs.

    Raises:
        DataError: no such path, no table in it, or no table that is a trial; the message lists what was found and what
            is missing. Single bad tables among good ones end up in ``skipped`` instead.
    """
    trials: list[Trial] = []
    skipped: list[tuple[str, str]] = []
    remarks: list[str] = []
    found = False
    for name, text in tables_in(path, max_size):
        found = True
        if most is not None and len(trials) >= most:
            break
        try:
            if isinstance(text, DataError):
                raise text
            tables = _split(_parse(name, text), config.columns)
        except DataError as error:
            skipped.append((name, _reason(error, name)))
            continue
        for table in tables:
            if most is not None and len(trials) >= most:
                break
            try:
                trials.append(read_trial(table, config))
                remarks.append(table.remark)
            except DataError as error:
                skipped.append((table.name, _reason(error, table.name)))
    if not found:
        raise DataError(f"{path}: no CSV in it; a data set is a CSV a trial, or a folder or zip of them")
    if not trials:
        more = f" (and {len(skipped) - 1} more tables)" if len(skipped) > 1 else ""
        raise DataError(f"{path}: no usable trial. {skipped[0][0]}: {skipped[0][1]}{more}")
    simulated = next((remark.partition(", trial")[0] for remark in remarks if remark.startswith("simulated")), "")
    return Dataset(str(path), tuple(trials), tuple(skipped), simulated, config)


def _reason(error: DataError, name: str) -> str:
    return str(error).removeprefix(f"{name}: ")


def _parse(name: str, text: str) -> Table:
    import pandas as pd  # here, because it takes a second to import

    remarks, start = _before_header(text)
    header = text[start : _line_end(text, start)]
    remark = " ".join(line.lstrip("# ").strip() for line in remarks)
    if start == len(text) or "\x00" in header:
        raise DataError(f"{name}: empty or binary, not a table")
    separator = max(",;\t", key=header.count)
    if (width := header.count(separator) + 1) > MOST_COLUMNS:
        raise DataError(f"{name}: {width} columns, the limit is {MOST_COLUMNS}")
    try:
        frame = pd.read_csv(StringIO(text[start:]), sep=separator, skipinitialspace=True, low_memory=False)
    except ValueError as error:  # pandas' parser errors are ValueErrors
        raise DataError(f"{name}: not a readable CSV: {str(error).splitlines()[0]}") from error
    if frame.empty:
        raise DataError(f"{name}: a header and no row")
    return Table(name, frame.rename(columns=lambda column: str(column).strip()), remark)


def _before_header(text: str) -> tuple[list[str], int]:
    """The remarks before a table's header, and where that begins."""
    remarks: list[str] = []
    start = 0
    while start < len(text):
        end = _line_end(text, start)
        line = text[start:end]
        if line.strip() and line[0] != "#":
            break
        if line.strip() and len(remarks) < _MOST_REMARKS:
            remarks.append(line)
        start = min(end + 1, len(text))
    return remarks, start


def _line_end(text: str, start: int) -> int:
    """Where the line that begins there ends."""
    end = text.find("\n", start)
    return len(text) if end < 0 else end


def _split(table: Table, columns: ColumnsConfig) -> list[Table]:
    """One table a trial."""
    found = find_columns(list(table.frame.columns), columns)
    if "trial" not in found:
        return [table]
    groups = table.frame.groupby(table.frame.columns[found["trial"][0]], sort=False)
    if len(groups) < 2:
        return [table]
    parts = [
        Table(f"{table.name}-{str(value).removesuffix('.0')}", part.reset_index(drop=True), table.remark)
        for value, part in groups
    ]
    return sorted(parts, key=lambda part: natural(part.name))
