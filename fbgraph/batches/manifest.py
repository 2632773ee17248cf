"""The manifest of a batch: a CSV with a row a log. Users write one, and each batch leaves its own."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from fbgraph.batches.log_entry import LogEntry
from fbgraph.batches.places import is_address, settled
from fbgraph.core.bounded import MIB, small_file
from fbgraph.core.errors import ConfigError, DataError

MANIFEST_FIELDS = ("log", "name", "truth", "anchors", "config")
_MOST_BYTES = 1024 * MIB
_HEAD_BYTES = 4096


def is_manifest(path: Path) -> bool:
    """Whether a file is a manifest: a CSV whose first line names a column ``log``, and none that it does not know."""
    if path.suffix.lower() != ".csv" or not path.is_file():
        return False
    try:
        with open(path, encoding="utf-8-sig", errors="replace") as stream:
            return _is_head(stream.readline(_HEAD_BYTES))
    except OSError:
        return False


def _is_head(line: str) -> bool:
    names = [name.strip().lower() for name in next(csv.reader([line], delimiter=_separator(line)), [])]
    return "log" in names and set(names) <= set(MANIFEST_FIELDS) and len(set(names)) == len(names)


def _separator(head: str) -> str:
    """What a spreadsheet put between fields, by the first line: names of columns have none of them."""
    return next((mark for mark in ";\t" if mark in head), ",")


def read_manifest(path: Path) -> list[LogEntry]:
    """The logs of a manifest; paths in it are beside it, unless they are whole ones or addresses.

    Raises:
        ConfigError: a name that no folder can have; with its line.
        DataError: it cannot be read, or a row names no log; with its line.
    """
    data = small_file(path, _MOST_BYTES, "manifest")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: not UTF-8 ({error}); save it so") from error
    separator = _separator(text.partition("\n")[0])
    rows = csv.DictReader(io.StringIO(text, newline=""), restkey="", strict=True, delimiter=separator)
    rows.fieldnames = [name.strip().lower() for name in rows.fieldnames or ()]
    entries = []
    try:
        for row in rows:
            if row.pop("", None):
                raise DataError(f"{path}: line {rows.line_num}: more fields than the first line names")
            known = {name: (value or "").strip() for name, value in row.items()}
            if not any(known.values()):
                continue
            if not known["log"]:
                raise DataError(f"{path}: line {rows.line_num}: no log; write its path")
            entries.append(_entry(known, path, rows.line_num))
    except csv.Error as error:
        raise DataError(f"{path}: after line {rows.line_num}: {error}") from error
    return entries


def _entry(row: dict[str, str], path: Path, line: int) -> LogEntry:
    where = path.parent
    if name := row.get("name", ""):
        require_name(name, f"{path}: line {line}")
    config = row.get("config") or None
    if config is not None and config.endswith(".toml"):
        config = _beside(config, where)
    truth, anchors = (_beside(row[key], where) if row.get(key) else None for key in ("truth", "anchors"))
    return LogEntry(_beside(row["log"], where), name, truth, anchors, config)


def _beside(place: str, folder: Path) -> str:
    return settled(place if is_address(place) else str(folder / place))


def require_name(name: str, where: str) -> None:
    """Refuse a name that is none of a folder.

    Raises:
        ConfigError: it is not.
    """
    if not plain(name):
        raise ConfigError(f"{where}: name {name!r}: expected what a folder can be called: no /, no leading dot")


def plain(name: str) -> bool:
    """Whether a folder can be called so anywhere, and shows what it is called."""
    return bool(name) and name.isprintable() and not name.startswith(".") and not set(name) & set('/\\:*?"<>|')


def manifest_text(entries: Sequence[LogEntry]) -> str:
    """The manifest of some logs, with whole paths."""
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(MANIFEST_FIELDS)
    rows.writerows([getattr(entry, field) or "" for field in MANIFEST_FIELDS] for entry in entries)
    return out.getvalue()
