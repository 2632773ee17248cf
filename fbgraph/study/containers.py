"""What holds the tables of a data set: a folder, a zip, a file; each table is read with bounds, and only read."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from fbgraph.core.bounded import Allowance, WholeLines, file_blocks, unpacked
from fbgraph.core.errors import DataError

_MOST_TABLES = 10_000
Table = tuple[str, str | DataError]
"""Name and text; or why it was not read."""


def natural(name: str) -> list[Any]:
    """Sorts ``trial_2`` before ``trial_10``."""
    parts = (part for part in re.split(r"(\d{1,999})", name) if part)
    return [(0, int(part)) if part.isdecimal() else (1, part.lower()) for part in parts]


def tables_in(path: Path, max_size: int | None = None) -> Iterator[Table]:
    """Every CSV in natural order of its name.

    A table that cannot be read stands there with the reason. All texts together are bounded.

    Args:
        path: a CSV, a folder or a zip of them.
        max_size: bytes of text at most, as in ``Allowance.of``.

    Raises:
        DataError: no such path, a zip that cannot be read, too many tables.
    """
    allowed = Allowance.of(max_size)
    try:
        if path.is_dir():
            yield from _of_folder(path, allowed)
        elif path.is_file() and zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                yield from _of_zip(archive, allowed)
        elif path.suffix.lower() == ".zip" and path.is_file():
            raise DataError(f"{path}: not a readable zip; copy it again")
        else:
            yield _stem(path.name), _text(file_blocks(path, allowed, "data set"))[0]
    except zipfile.BadZipFile as error:
        raise DataError(f"{path}: truncated or damaged ({error}); copy it again") from error
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: {getattr(error, 'strerror', None) or error}; check the path") from error


def _of_folder(path: Path, allowed: Allowance) -> Iterator[Table]:
    """Tables in a folder and those below it."""
    below = {f.relative_to(path).as_posix(): f for f in path.rglob("*")}
    files = {name: f for name, f in below.items() if _is_table(name) and f.is_file()}
    taken = 0
    for name in _in_order(files, path):
        try:
            text, size = _text(file_blocks(files[name], allowed.less(taken), "table"))
        except DataError as error:
            yield _stem(name), DataError(f"{_stem(name)}: {str(error).removeprefix(f'{files[name]}: ')}")
            continue
        taken += size
        yield _stem(name), text


def _of_zip(archive: zipfile.ZipFile, allowed: Allowance) -> Iterator[Table]:
    """Tables in a zip; nothing is ever unpacked to the disk."""
    taken = 0
    entries = {entry.filename: entry for entry in archive.infolist() if not entry.is_dir()}
    for name in _in_order((name for name in entries if _is_table(name) or _is_zip(name)), archive.filename):
        try:
            text, size = _zipped_text(archive, entries[name], allowed.less(taken))
        except DataError as error:
            yield _stem(name), error
            continue
        taken += size
        yield _stem(name), text


def _zipped_text(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, allowed: Allowance) -> tuple[str, int]:
    """Text and size of one entry.

    Raises:
        DataError: encrypted, damaged, a bomb, a zip, or its name leads out of the zip.
    """
    name = _stem(entry.filename)
    if _escapes(entry.filename):
        raise DataError(f"{name}: its name leads out of the zip")
    if _is_zip(entry.filename):
        raise DataError(f"{name}: a zip within the zip; unpack it first")
    if entry.flag_bits & 1:
        raise DataError(f"{name}: encrypted; unpack it first")
    try:
        with archive.open(entry) as stream:
            return _text(_grown(unpacked(stream, name, allowed), entry, allowed))
    except (zipfile.BadZipFile, OSError, NotImplementedError) as error:
        raise DataError(f"{name}: damaged, or packed in a way that is not known ({error})") from error


def _grown(blocks: Iterable[bytes], entry: zipfile.ZipInfo, allowed: Allowance) -> Iterator[bytes]:
    """The same blocks, until they are too many for what the entry takes up in the zip."""
    size = 0
    for block in blocks:
        size += len(block)
        allowed.refuse(_stem(entry.filename), size, entry.compress_size)
        yield block


def _in_order(names: Iterable[str], source: object) -> list[str]:
    """In natural order.

    Raises:
        DataError: more than any data set holds.
    """
    ordered = sorted(names, key=natural)
    if len(ordered) > _MOST_TABLES:
        raise DataError(f"{source}: {len(ordered)} tables, the limit is {_MOST_TABLES}")
    return ordered


def _is_table(name: str) -> bool:
    return not _is_hidden(name) and name.lower().endswith((".csv", ".csv.gz"))


def _is_zip(name: str) -> bool:
    return not _is_hidden(name) and name.lower().endswith(".zip")


def _is_hidden(name: str) -> bool:
    return any(part.startswith((".", "__MACOSX")) and part not in (".", "..") for part in name.split("/"))


def _escapes(name: str) -> bool:
    parts = re.split(r"[/\\]", name)
    return ".." in parts or parts[0] == "" or re.match(r"[A-Za-z]:[/\\]", name) is not None


def _stem(name: str) -> str:
    return re.sub(r"\.csv(\.gz)?$", "", name, flags=re.IGNORECASE)


def _text(blocks: Iterable[bytes]) -> tuple[str, int]:
    """Blocks of bytes as text without endless lines, in UTF-8 or else latin-1; and its size."""
    data = b"".join(WholeLines().pieces(blocks))
    try:
        return data.decode("utf-8-sig"), len(data)
    except UnicodeDecodeError:
        return data.decode("latin-1"), len(data)
