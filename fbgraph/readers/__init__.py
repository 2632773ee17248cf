"""Readers: one format a file, found by content or named by ``--format``.

A reader is a module with ``NAME``, ``DESCRIPTION`` (one line), ``EXAMPLE`` (a few lines of such a log), ``PRESET``
(the configuration for the devices that write it), ``detects(head) -> bool`` and ``read(path) -> RawLog``. To add one,
write the module and list it in ``FORMATS``; modules are imported only when asked for.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers.base import LogFile, assemble, open_text

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


def detect(path: Path) -> str:
    """Name of the format of a file, by its content.

    Raises:
        DataError: unreadable, empty, binary, or no reader knows it.
    """
    with open_text(path) as stream:
        head = stream.read(_HEAD_CHARS)
    if not head.strip():
        raise DataError(f"{path}: the file is empty; record or copy it again")
    for name in FORMATS:
        if reader(name).detects(head):
            return name
    if "\x00" in head:
        raise DataError(f"{path}: a binary file, not a log; `fbgraph formats` lists what can be read")
    first = head.lstrip().splitlines()[0][:60]
    raise DataError(f"{path}: unknown format (it begins {first!r}); `fbgraph formats` lists what can be read")


def read_log(path: str | Path, format_name: str | None = None) -> LogFile:
    """Read a log, and the truth its file may carry.

    Args:
        path: a log file, gzipped or not.
        format_name: one of ``FORMATS``; found by content if None.

    Raises:
        DataError: nothing usable; the message says why.
        ConfigError: no such format.
    """
    path = Path(path)
    name = format_name or detect(path)
    return assemble(reader(name).read(path), path, name)
