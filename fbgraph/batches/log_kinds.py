"""Whether a folder or zip is one recording, with a file a sensor, or holds many logs; by how their files begin."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath

from fbgraph.batches.log_entry import MANIFEST, OPTIONS
from fbgraph.columns.column_names import guess_columns
from fbgraph.core.bounded import Allowance, file_blocks, unpacked
from fbgraph.core.errors import DataError
from fbgraph.readers.tagged import tagged_reader
from fbgraph.run.digests import SUMMARY
from fbgraph.tables import tables_of
from fbgraph.tables.log_text import text_of
from fbgraph.tables.members import Member, table_name

NO_LOGS = (
    *(".mp4", ".mov", ".jpg", ".jpeg", ".png", ".pdf", ".wav", ".m4a", ".mp3", ".svg"),
    *(".md", ".toml", ".html", ".rrd", ".parquet", ".py", ".ipynb", ".gpx", ".kml", ".tum"),
)
"""Endings of files beside logs, in folders of them."""
_NO_LOG_NAMES = ("license", "licence", "copying", "readme", "notice", "authors")
_HEAD_BYTES = 20_000
_MOST_LOOKED_AT = 20


def may_be_log(name: str) -> bool:
    """Whether a file of this name, found in a folder or zip, may be a log."""
    parts = PurePosixPath(name).parts
    hidden = any(part.startswith((".", "__MACOSX")) for part in parts)
    last = parts[-1].lower() if parts else ""
    return not hidden and not last.endswith(NO_LOGS) and last.partition(".")[0] not in _NO_LOG_NAMES


def is_recording(names: Sequence[str], head: Callable[[str], bytes]) -> bool | None:
    """Whether files together are one recording: none of them is a walk alone, one has an accelerometer.

    Args:
        names: of the files.
        head: how a file of this name begins.

    Returns:
        Nothing where no file names an accelerometer either.
    """
    found = None
    for name in [name for name in names if may_be_log(name)][:_MOST_LOOKED_AT]:
        sensors = sensors_of(name, head(name))
        if {"acc", "gyro"} <= sensors:
            return False
        if "acc" in sensors:
            found = True
    return found


def sensors_of(name: str, head: bytes) -> set[str]:
    """What a file names in its first lines; of what is a log whatever it names (a zip, binary) both sensors."""
    if head.startswith((b"PK\x03\x04", b"ACCLOG")):
        return {"acc", "gyro"}
    lines = head[: head.rfind(b"\n") + 1] or head
    if not lines.strip():
        return set()
    text = text_of([lines], Path(name))
    if tagged_reader(text.head(_HEAD_BYTES)) is not None:
        return {"acc", "gyro"}
    try:
        tables = tables_of(Member(table_name(name), name, text))
    except DataError:
        return set()
    return {guess.quantity for table in tables for guess in guess_columns(table)}


def head_of(path: Path) -> bytes:
    """How a file begins, unpacked; nothing if it cannot be read."""
    try:
        return next(file_blocks(path, Allowance.of(None)), b"")[:_HEAD_BYTES]
    except DataError:
        return b""


def logs_in_zip(path: Path) -> list[str]:
    """Names of the logs in a zip of several; none if it is one recording, or cannot be read."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [one.filename for one in archive.infolist() if not one.is_dir() and may_be_log(one.filename)]

            def head(name: str) -> bytes:
                try:
                    with archive.open(name) as stream:
                        return next(unpacked(stream, name, Allowance.of(None)), b"")[:_HEAD_BYTES]
                except (zipfile.BadZipFile, OSError, DataError, RuntimeError):
                    return b""  # encrypted, damaged, packed in a way that is not known: who reads it says so

            if len(names) < 2 or is_recording(names, head) is not False:
                return []
            return names
    except (zipfile.BadZipFile, OSError):
        return []  # who reads it says what is wrong


def logs_in_folder(folder: Path) -> Iterator[Path]:
    """The logs of a folder and of those below it: files, zips, and folders that are one recording.

    Raises:
        DataError: it cannot be read.
    """
    try:
        inside = sorted(folder.iterdir())
    except OSError as error:
        raise DataError(f"{folder}: {error.strerror or error}; check the path") from error
    files = {one.name: one for one in inside if one.is_file() and may_be_log(one.name)}  # a pipe would be waited for
    if SUMMARY in files or {MANIFEST, OPTIONS} <= set(files):  # a run or batch, whose logs are elsewhere
        return
    if is_recording(list(files), lambda name: head_of(files[name])):
        yield folder
        return
    for one in inside:
        if not may_be_log(one.name):
            continue
        if not one.is_dir():
            yield one
        elif not one.is_symlink():
            yield from logs_in_folder(one)
