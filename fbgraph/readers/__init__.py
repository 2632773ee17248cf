"""Readers: one format a file, found by content or named by ``--format``.

A reader is a module with ``NAME``, ``DESCRIPTION`` (one line), ``EXAMPLE`` (a few lines of such a log), ``PRESET``
(the configuration for the devices that write it), ``detects(head) -> bool`` and ``read(source) -> RawLog``. To add one,
write the module and list it in ``FORMATS``; modules are imported only when asked for.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers.cleaning import LogFile, assemble
from fbgraph.tables.log_text import LogText, log_text

FORMATS = ("getsensordata", "indoor_location", "m5stickc")
"""In the order in which detection asks them; the plain CSV last."""

_HEAD_CHARS = 20_000


def reader(name: str) -> ModuleType:
    """The reader of this name.

    Raises:
        ConfigError: there is none.
    """
    if name not in FORMATS:
        raise ConfigError(f"no format named {name!r}; there are {', '.join(FORMATS)}")
    return import_module(f"fbgraph.readers.{name}")


def preset(format_name: str) -> str:
    """Name of the configuration preset for the devices that write this format."""
    return str(reader(format_name).PRESET)


def detect(source: Path | LogText) -> str:
    """Name of the format of a log, by its content.

    Raises:
        DataError: unreadable, empty, binary, or no reader knows it.
    """
    text = log_text(source)
    path, head = text.source, text.head(_HEAD_CHARS)
    if not head.strip() and text.too_long:
        raise DataError(f"{path}: not a log: it holds nothing but lines of more than 64 KiB")
    if not head.strip() and not text.binary:
        raise DataError(f"{path}: the file is empty; record or copy it again")
    for name in FORMATS:
        if reader(name).detects(head):
            return name
    if text.binary:
        raise DataError(f"{path}: a binary file, not a log; `fbgraph formats` lists what can be read")
    first = head.lstrip().splitlines()[0][:60]
    raise DataError(f"{path}: unknown format (it begins {first!r}); `fbgraph formats` lists what can be read")


def read_log(path: str | Path, format_name: str | None = None, max_size: int | None = None) -> LogFile:
    """Read a log, and the truth its file may carry.

    Args:
        path: a log file or pipe, gzipped or not; it is read once.
        format_name: one of ``FORMATS``; found by content if None.
        max_size: bytes of text that are read at most; 1 GiB if None, and no .gz that grows as none of a walk does.

    Raises:
        DataError: nothing usable; the message says why.
        ConfigError: no such format.
    """
    path = Path(path)
    chosen = None if format_name is None else reader(format_name)
    text = log_text(path, max_size)
    name = format_name or detect(text)
    raw = (chosen or reader(name)).read(text)
    if text.too_long:
        raw.counts["lines_too_long"] = text.too_long
        raw.notices.append(f"{text.too_long} lines of more than 64 KiB left out: no rows of a log")
    del text  # up to a gigabyte
    return assemble(raw, path, name)
