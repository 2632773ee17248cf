"""A data set of trials, laid out as ForestBack's: a table a trial, as CSVs in a folder or zip, or all in one table."""

from __future__ import annotations

import gzip
import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

from fbgraph.core.errors import DataError
from fbgraph.study.layout import ColumnsConfig, DatasetConfig
from fbgraph.study.trial import Table, Trial, find_columns, read_trial


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


def read_dataset(path: Path, config: DatasetConfig, most: int | None = None) -> Dataset:
    """Read a data set.

    Args:
        path: a CSV, a folder or a zip of them.
        config: its layout.
        most: no more than the first so many trials.

    Raises:
        DataError: no such path, no table in it, or no table that is a trial; the message lists what was found and what
            is missing. Single bad tables among good ones end up in ``skipped`` instead.
    """
    trials: list[Trial] = []
    skipped: list[tuple[str, str]] = []
    remarks: list[str] = []
    found = False
    for name, text in _texts(path):
        found = True
        if most is not None and len(trials) >= most:
            break
        try:
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


def _natural(name: str) -> list[Any]:
    """Sorts ``trial_2`` before ``trial_10``."""
    parts = (part for part in re.split(r"(\d{1,999})", name) if part)
    return [(0, int(part)) if part.isdecimal() else (1, part.lower()) for part in parts]


def _texts(path: Path) -> Iterator[tuple[str, str]]:
    """Name and text of every CSV."""
    try:
        if path.is_dir():
            files = [f for f in path.rglob("*") if f.is_file() and _is_table(f.relative_to(path).as_posix())]
            for file in sorted(files, key=lambda f: _natural(f.relative_to(path).as_posix())):
                yield _stem(file.relative_to(path).as_posix()), _decoded(file.read_bytes())
        elif zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                for entry in sorted(filter(_is_table, archive.namelist()), key=_natural):
                    yield _stem(entry), _decoded(archive.read(entry))
        elif path.suffix.lower() == ".zip" and path.is_file():
            raise DataError(f"{path}: not a readable zip; copy it again")
        else:
            yield _stem(path.name), _decoded(path.read_bytes())
    except (zipfile.BadZipFile, EOFError, zlib.error, gzip.BadGzipFile, NotImplementedError) as error:
        raise DataError(f"{path}: truncated or damaged ({error}); copy it again") from error
    except (OSError, RuntimeError) as error:  # zipfile asks for a password with a RuntimeError
        raise DataError(f"{path}: {getattr(error, 'strerror', None) or error}; check the path") from error


def _is_table(name: str) -> bool:
    hidden = any(part.startswith((".", "__MACOSX")) for part in name.split("/"))
    return not hidden and name.lower().endswith((".csv", ".csv.gz"))


def _stem(name: str) -> str:
    return re.sub(r"\.csv(\.gz)?$", "", name, flags=re.IGNORECASE)


def _decoded(data: bytes) -> str:
    if data[:2] == b"\x1f\x8b":
        data = gzip.decompress(data)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _parse(name: str, text: str) -> Table:
    import pandas as pd  # here, because it takes a second to import

    lines = text.split("\n")
    first = next((i for i, line in enumerate(lines) if line.strip() and line[0] != "#"), len(lines))
    remark = " ".join(line.lstrip("# ").strip() for line in lines[:first] if line.strip())
    if first == len(lines) or "\x00" in lines[first]:
        raise DataError(f"{name}: empty or binary, not a table")
    separator = max(",;\t", key=lines[first].count)
    try:
        frame = pd.read_csv(StringIO("\n".join(lines[first:])), sep=separator, skipinitialspace=True, low_memory=False)
    except ValueError as error:  # pandas' parser errors are ValueErrors
        raise DataError(f"{name}: not a readable CSV: {str(error).splitlines()[0]}") from error
    if frame.empty:
        raise DataError(f"{name}: a header and no row")
    return Table(name, frame.rename(columns=lambda column: str(column).strip()), remark)


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
    return sorted(parts, key=lambda part: _natural(part.name))
