"""Readers: from a file, folder or zip to one walk's samples, its format found by content or named by ``--format``.

Formats whose lines are tagged have a module of their own, with ``FORMAT``, ``detects(head) -> bool`` and
``read(text) -> RawLog``: write it and name it in ``readers.tagged``. All others are tables: ``readers.decide`` says
what their columns are (names propose, physics decides), ``readers.apply_layout`` reads them so; an app whose names
mislead is one entry in ``columns.app_layouts``, and one in ``readers.formats`` to be listed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers.apply_layout import apply_layout
from fbgraph.readers.cleaning import LogFile, RawLog, assemble
from fbgraph.readers.decide import decide
from fbgraph.readers.formats import TABLE_FORMATS, LogFormat
from fbgraph.readers.layout import SAVED_LAYOUT, Layout, read_layout
from fbgraph.readers.reading import Reading
from fbgraph.readers.tagged import TAGGED, reader_of, tagged_reader
from fbgraph.readers.truth_columns import truth_of
from fbgraph.tables import nothing_in, tables_of, why_none
from fbgraph.tables.log_text import LogText
from fbgraph.tables.members import members
from fbgraph.tables.table import Table

FORMATS = (*TAGGED, *(known.name for known in TABLE_FORMATS))
"""Names that ``--format`` takes; those of tables are all read alike."""
_HEAD_CHARS = 20_000


def log_format(name: str) -> LogFormat:
    """The format of this name.

    Raises:
        ConfigError: there is none.
    """
    if name in TAGGED:
        found: LogFormat = reader_of(name).FORMAT
        return found
    known = next((known for known in TABLE_FORMATS if known.name == name), None)
    if known is None:
        raise ConfigError(f"no format named {name!r}; there are {', '.join(FORMATS)}")
    return known


def preset(format_name: str) -> str:
    """Name of the configuration preset for the devices that write this format."""
    return log_format(format_name).preset


def preset_of(file: LogFile) -> str:
    """Name of the configuration preset for a device that is worn as this log's was."""
    return preset(file.log.format) if file.reading is None else file.reading.layout.preset


def read_log(
    path: str | Path,
    format_name: str | None = None,
    max_size: int | None = None,
    *,
    layout: str | Path | None = None,
    rate_hz: float | None = None,
) -> LogFile:
    """Read a log, and the truth that it may carry.

    Args:
        path: a log file or pipe, gzipped or not, a folder or a zip; it is read once.
        format_name: one of ``FORMATS``; found by content if None.
        max_size: bytes of text that are read at most; 1 GiB if None, and nothing that grows as none of a walk does.
        layout: a file that says what the columns of its tables are; decided by names and physics if None.
        rate_hz: of the samples, for tables without a clock.

    Raises:
        DataError: nothing usable; the message says why.
        ConfigError: no such format, or a layout that is none.
    """
    path = Path(path)
    if format_name is not None:
        log_format(format_name)
    laid_out = layout_of(path, layout)
    return log_of(contents(path, format_name, max_size), format_name, laid_out, rate_hz)


@dataclass(frozen=True)
class Contents:
    """What an input holds: the log of a tagged format, else tables.

    Attributes:
        source: the file, folder or zip.
        tagged: name of the format, and its log.
        tables: in the order of their names.
        left_out: files that hold none, and why.
    """

    source: Path
    tagged: tuple[str, RawLog] | None
    tables: list[Table]
    left_out: list[tuple[str, str]]


def layout_of(path: Path, layout: str | Path | None = None) -> Layout | None:
    """The layout that a log is to be read by: the one that is named, or that of the live walk whose lines it holds.

    Raises:
        ConfigError: it cannot be read, or is none.
    """
    return _layout_beside(path) if layout is None else read_layout(Path(layout))


def log_of(
    found: Contents, format_name: str | None = None, laid_out: Layout | None = None, rate_hz: float | None = None
) -> LogFile:
    """The log of what was found.

    Args:
        found: as ``contents`` gives it.
        format_name, rate_hz: as of ``read_log``.
        laid_out: as ``layout_of`` gives it.

    Raises:
        DataError: nothing usable; the message says why.
    """
    if found.tagged is not None:
        name, raw = found.tagged
        return assemble(raw, found.source, name)
    raw, reading = read_table_log(found.tables, found.source, laid_out, rate_hz, found.left_out)
    named = reading.layout.app if format_name in (None, *TAGGED) else str(format_name)
    return assemble(raw, found.source, named, reading)


def read_table_log(
    tables: list[Table],
    source: Path,
    laid_out: Layout | None = None,
    rate_hz: float | None = None,
    left_out: list[tuple[str, str]] | None = None,
) -> tuple[RawLog, Reading]:
    """The samples of a log that is tables, and how they were read.

    Raises:
        DataError: no table, or none that a walk can be read from.
    """
    if not tables:
        raise DataError(nothing_in(source, left_out or []))
    reading = decide(tables, source, rate_hz) if laid_out is None else Reading.as_told(tables, laid_out)
    raw = apply_layout(tables, reading.layout, source)
    raw.notices[:0] = reading.notices
    raw.truth = truth_of(tables, reading.chosen, source)
    for table in tables:
        if number := table.counts.get("lines_too_long"):
            raw.notices.append(f"{number} lines of more than 64 KiB left out: no rows of a log")
    return raw, reading


def contents(path: Path, format_name: str | None = None, max_size: int | None = None) -> Contents:
    """The log of the first file of a tagged format, if there is one and no other was asked for; or all tables.

    Raises:
        DataError: it cannot be read, or is larger than allowed.
    """
    found = members(path, max_size)
    asked = TAGGED if format_name is None else tuple(name for name in TAGGED if name == format_name)
    tables: list[Table] = []
    for member in found:
        head = member.text.head(_HEAD_CHARS)
        found_reader = tagged_reader(head, asked)
        name = None if found_reader is None else found_reader.FORMAT.name
        if name is None and format_name in TAGGED and not found.many:
            name = format_name
        if name is not None:
            raw: RawLog = reader_of(name).read(member.text)
            _note_long_lines(raw, member.text)
            return Contents(path, (name, raw), [], found.left_out)
        if some := tables_of(member):
            tables += some
        else:
            found.left_out.append((member.source, why_none(member)))
    return Contents(path, None, tables, found.left_out)


def _note_long_lines(raw: RawLog, text: LogText) -> None:
    if text.too_long:
        raw.counts["lines_too_long"] = text.too_long
        raw.notices.append(f"{text.too_long} lines of more than 64 KiB left out: no rows of a log")


def _layout_beside(path: Path) -> Layout | None:
    """How the raw lines of a live walk were read while it went on."""
    beside = path.with_name(SAVED_LAYOUT)
    return read_layout(beside) if path.name == "raw.csv" and beside.is_file() else None
