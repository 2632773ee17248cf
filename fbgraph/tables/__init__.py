"""Tables: what a file, a folder or a zip of logs holds, as columns with names; no table knows what a sensor is.

``read_tables`` reads all of an input; ``members`` its files one by one, for who wants their text; ``Dialect`` reads
lines as they arrive.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fbgraph.core.errors import DataError
from fbgraph.tables.json_tables import is_json, json_tables
from fbgraph.tables.long_tables import by_sensor
from fbgraph.tables.members import Member, members
from fbgraph.tables.scaled_tables import acclog_table, with_gyroflow_scales
from fbgraph.tables.table import Table
from fbgraph.tables.text_table import read_table

_LONG = "nothing but lines of more than 64 KiB"


@dataclass(frozen=True)
class Container:
    """What an input holds.

    Attributes:
        source: the file, folder or zip.
        tables: in the order of their names.
        left_out: files that hold none, and why.
    """

    source: Path
    tables: tuple[Table, ...]
    left_out: tuple[tuple[str, str], ...] = ()


def read_tables(path: str | Path, max_size: int | None = None) -> Container:
    """Read the tables of a file or pipe, gzipped or not, of a folder, or of a zip.

    Args:
        path: opened and read once.
        max_size: bytes of text that are read at most, of all files together; 1 GiB if None, and nothing that grows
            while it is unpacked as none of a walk does.

    Raises:
        DataError: it cannot be read, is larger than allowed, or holds no table.
    """
    path = Path(path)
    found = members(path, max_size)
    tables: list[Table] = []
    for member in found:
        if some := tables_of(member):
            tables += some
        else:
            found.left_out.append((member.source, why_none(member)))
    if not tables:
        raise DataError(nothing_in(path, found.left_out))
    return Container(path, tuple(tables), tuple(found.left_out))


def tables_of(member: Member) -> tuple[Table, ...]:
    """The tables of one file; none if it holds none.

    Raises:
        DataError: more rows or columns than any walk has.
    """
    if member.data:
        return (acclog_table(member.data, member.name, member.source),)
    if is_json(member.text) and (found := json_tables(member.text, member.name, member.source)):
        return found
    table = read_table(member.text, member.name, member.source)
    return by_sensor(with_gyroflow_scales(table)) if table is not None and len(table) else ()


def why_none(member: Member) -> str:
    """What to say of a file without a table."""
    long = member.text.too_long and not member.text.rows
    return _LONG if long else "no table"


def nothing_in(path: Path, left_out: list[tuple[str, str]]) -> str:
    """What to say of an input without a table.

    Args:
        path: of it.
        left_out: its files, each with the reason.
    """
    if not left_out:
        return f"{path}: no file in it"
    if len(left_out) == 1 and left_out[0][0] == str(path):
        why = {
            "empty": "the file is empty; record or copy it again",
            _LONG: f"it holds {_LONG}, which are no rows of a log",
            "a binary file": "a binary file, not a log; `fbgraph formats` lists what can be read",
        }
        return f"{path}: {why.get(left_out[0][1], 'no table in it: no rows of numbers of one width')}"
    said = ", ".join(f"{Path(source).name} ({reason})" for source, reason in left_out[:5])
    return f"{path}: no table in it: {said}{', …' if len(left_out) > 5 else ''}"
