"""What a file, folder or zip holds, one text after the other; nothing of it is read twice, and no more than allowed."""

from __future__ import annotations

import stat
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path, PurePosixPath

from fbgraph.core.bounded import Allowance, file_blocks, unpacked
from fbgraph.core.errors import DataError
from fbgraph.tables.encoding import is_binary
from fbgraph.tables.log_text import LogText, text_of

MOST_MEMBERS = 1000
"""Of a folder or zip: a recording has a file a sensor."""
_DEEPEST = 2  # parts of a path in a folder or zip
_ZIP = b"PK\x03\x04"
_EMPTY_ZIP = b"PK\x05\x06"
_BINARY_LOGS = (b"ACCLOG",)
_PICTURES = (".mp4", ".mov", ".jpg", ".jpeg", ".png", ".pdf", ".wav", ".m4a", ".mp3")


@dataclass(frozen=True)
class Member:
    """One file.

    Attributes:
        name: without folder and endings.
        source: for messages: ``walk.zip/meta/device.csv``.
        text: what it holds; empty if it is binary.
        data: the bytes of a binary log.
    """

    name: str
    source: str
    text: LogText
    data: bytes = b""


@dataclass
class Members:
    """The files of an input, read as one goes through them, once.

    Attributes:
        source: the file, folder or zip.
        many: whether it is a folder or zip.
        left_out: files that were passed over so far, and why.
    """

    source: Path
    many: bool
    files: Iterable[Member]
    left_out: list[tuple[str, str]] = field(default_factory=list)

    def __iter__(self) -> Iterator[Member]:
        """Each file that may hold a table."""
        return iter(self.files)


def members(
    path: Path,
    max_size: int | None = None,
    *,
    wanted: Callable[[str], bool] = lambda name: True,
    allowed: Allowance | None = None,
) -> Members:
    """The files that an input holds.

    Args:
        path: a file or pipe, gzipped or not; a folder or zip, of whose folders one level is looked into.
        max_size: bytes of text that are read at most, of all of them; None for what any walk keeps within.
        wanted: of a folder or zip, whether a file of this path in it is read.
        allowed: how much is read, where it is no log.

    Raises:
        DataError: no such file, or (here or while they are read) it is a device, unreadable, damaged, encrypted, larger
            than allowed, of more than a thousand files, or a zip that names files outside of itself.
    """
    most = allowed or Allowance.of(max_size)
    any_rows = max_size is not None
    if path.is_dir():
        found = Members(path, True, ())
        found.files = _read(_of_folder(path, most, wanted, found.left_out), any_rows, found.left_out)
    elif _is_zip(path):
        found = Members(path, True, ())
        found.files = _of_zip(path, most, wanted, any_rows, found.left_out)
    else:
        found = Members(path, False, ())
        blocks = file_blocks(path, most, "log file")
        found.files = _read([(path.name, str(path), blocks)], any_rows, found.left_out)
    return found


def table_name(name: str) -> str:
    """What a table in a file of this name is called: without folder and endings."""
    stem = PurePosixPath(name).name
    while True:
        shorter = stem.rpartition(".")[0]
        if not shorter or not 1 <= len(stem) - len(shorter) - 1 <= 5 or stem[len(shorter) + 1 :].isdigit():
            return stem
        stem = shorter


def _is_zip(path: Path) -> bool:
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return False
        with open(path, "rb") as stream:
            return stream.read(4) in (_ZIP, _EMPTY_ZIP)
    except (OSError, ValueError):
        return False  # who reads it says what is wrong


def _read(
    files: Iterable[tuple[str, str, Iterator[bytes]]], any_rows: bool, left_out: list[tuple[str, str]]
) -> Iterator[Member]:
    """Members of files, each a name, a source for messages, and blocks of bytes."""
    for name, source, blocks in files:
        first = next(blocks, b"")
        while 0 < len(first) < 4096 and (more := next(blocks, b"")):
            first += more
        if first.startswith(_BINARY_LOGS):
            yield Member(table_name(name), source, LogText(Path(source), ()), b"".join(chain((first,), blocks)))
        elif is_binary(first):
            left_out.append((source, "a zip in a zip" if first.startswith(_ZIP) else "a binary file"))
        elif not first.strip():
            left_out.append((source, "empty"))
        else:
            text = text_of(chain((first,), blocks), Path(source), any_rows=any_rows)
            yield Member(table_name(name), source, text)


def _passed_over(name: str) -> str:
    """Why a file of this name in a folder or zip is not looked at; ``""`` if it is."""
    parts = PurePosixPath(name).parts
    if any(part.startswith(".") or part == "__MACOSX" for part in parts):
        return "hidden"
    if len(parts) > _DEEPEST:
        return "more than one folder deep"
    return "a picture, film or sound" if name.lower().endswith(_PICTURES) else ""


def _of_folder(
    path: Path, most: Allowance, wanted: Callable[[str], bool], left_out: list[tuple[str, str]]
) -> Iterator[tuple[str, str, Iterator[bytes]]]:
    found = []
    root = path.resolve()
    for file in _files_below(path, left_out):
        name = file.relative_to(path).as_posix()
        why = _passed_over(name)
        if not why and not file.resolve().is_relative_to(root):
            why = "a link out of the folder"
        if not why and not file.is_file():
            why = "no file"
        if why:
            left_out.append((str(file), why))
        elif wanted(name):
            found.append((name, file))
    _refuse_many(path, len(found))
    allowed = _Shared(most)
    for name, file in found:
        yield name, str(file), allowed.of(file_blocks(file, allowed.left, "log file"))


def _files_below(path: Path, left_out: list[tuple[str, str]]) -> Iterator[Path]:
    """Files of a folder and of the folders in it."""
    try:
        inside = sorted(path.iterdir())
        for entry in inside:
            if not entry.is_dir() or entry.is_symlink():
                yield entry
                continue
            deeper = sorted(entry.iterdir())
            for file in deeper:
                if file.is_dir():
                    left_out.append((str(file), "more than one folder deep"))
                else:
                    yield file
    except OSError as error:
        raise DataError(f"{path}: {error.strerror or error}; check the path") from error


def _of_zip(
    path: Path, most: Allowance, wanted: Callable[[str], bool], any_rows: bool, left_out: list[tuple[str, str]]
) -> Iterator[Member]:
    try:
        with zipfile.ZipFile(path) as archive:
            infos = [info for info in archive.infolist() if not info.is_dir()]
            found = []
            for info in infos:
                why = _refused(info, path) or _passed_over(info.filename)
                if why:
                    left_out.append((f"{path}/{info.filename}", why))
                elif wanted(info.filename):
                    found.append(info)
            _refuse_many(path, len(infos))
            allowed = _Shared(most)
            size = sum(info.file_size for info in found)
            allowed.left.refuse(path, size, path.stat().st_size)
            files = (
                (
                    info.filename,
                    f"{path}/{info.filename}",
                    allowed.of(_member_blocks(archive, info, path, allowed.left)),
                )
                for info in found
            )
            yield from _read(files, any_rows, left_out)
    except zipfile.BadZipFile as error:
        raise DataError(f"{path}: the zip is truncated or damaged ({error}); copy it again") from error
    except OSError as error:
        raise DataError(f"{path}: {error.strerror or error}; check the path") from error


def _refused(info: zipfile.ZipInfo, path: Path) -> str:
    """Why an entry of a zip is no file to read.

    Raises:
        DataError: no honest zip has such an entry.
    """
    name = info.filename.replace("\\", "/")
    if name.startswith("/") or name[1:3] == ":/" or ".." in PurePosixPath(name).parts:
        raise DataError(f"{path}: names a file outside of itself, {info.filename!r}; it is not read")
    if info.flag_bits & 1:
        raise DataError(f"{path}: {info.filename!r} is encrypted; unpack it with its password and name the folder")
    return "a link" if stat.S_ISLNK(info.external_attr >> 16) else ""


def _member_blocks(archive: zipfile.ZipFile, info: zipfile.ZipInfo, path: Path, allowed: Allowance) -> Iterator[bytes]:
    try:
        with archive.open(info) as stream:
            yield from unpacked(stream, f"{path}/{info.filename}", allowed, info.file_size)
    except (zipfile.BadZipFile, OSError) as error:  # bz2 tells damage as an OSError
        raise DataError(f"{path}: {info.filename!r} is truncated or damaged ({error}); copy the zip again") from error
    except NotImplementedError as error:
        raise DataError(f"{path}: {info.filename!r} is packed in a way that cannot be read ({error})") from error


class _Shared:
    """What several files may take together."""

    def __init__(self, allowed: Allowance) -> None:
        self.left = allowed

    def of(self, blocks: Iterator[bytes]) -> Iterator[bytes]:
        """The blocks of one of them."""
        for block in blocks:
            self.left = self.left.less(len(block))
            yield block


def _refuse_many(path: Path, count: int) -> None:
    if count > MOST_MEMBERS:
        raise DataError(f"{path}: {count} files, of which a recording has {MOST_MEMBERS} at most; name one of them")
