"""Which logs are meant by files, globs, folders, zips, manifests and addresses: each once, with a name of its own."""

from __future__ import annotations

import glob
import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from fbgraph.batches.log_entry import LogEntry
from fbgraph.batches.log_kinds import logs_in_folder, logs_in_zip, may_be_log
from fbgraph.batches.manifest import is_manifest, plain, read_manifest
from fbgraph.batches.places import file_system, is_address, last_name, settled
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers.cleaning import log_name
from fbgraph.study.containers import natural

_TRUTH = "_truth"
"""What ``fbgraph simulate`` adds to a log's name for the truth beside it."""
_LONGEST_NAME = 100
_DIGEST_CHARS = 8

Tell = Callable[[str], None]
"""Called with a sentence for the user."""


def find_logs(named: Sequence[str], tell: Tell = lambda text: None) -> list[LogEntry]:
    """The logs that are meant, each once, in the order in which they were named; still without names.

    Args:
        named: files, globs, folders, zips, manifests or addresses.
        tell: told what was assumed.

    Raises:
        ConfigError: nothing is there, or nothing that may be a log.
        DataError: a manifest or folder that cannot be read.
    """
    found: dict[LogEntry, None] = {}
    for one in named:
        there = list(_logs_of(one))
        if not there:
            raise ConfigError(f"{one}: no log there")
        found |= dict.fromkeys(there)
    entries = _with_truth_beside(list(found))
    if beside := sum(entry.truth is not None and entry not in found for entry in entries):
        tell(f"{beside} log{'s have' if beside > 1 else ' has'} truth beside, called NAME{_TRUTH}; that is not a log")
    return entries


def _logs_of(named: str) -> Iterator[LogEntry]:
    if is_address(named) and not named.startswith("file://"):
        yield from (LogEntry(place) for place in _at_address(named))
        return
    named = settled(named) if is_address(named) else named
    if not Path(named).exists() and glob.has_magic(named):
        matches = sorted(glob.glob(named, recursive=True), key=natural)
        if not matches:
            raise ConfigError(f"{named}: no file matches")
        for match in matches:
            yield from _at_path(Path(match))
        return
    if not Path(named).exists():
        raise ConfigError(f"{named}: no such file or folder")
    yield from _at_path(Path(named))


def _at_path(path: Path) -> Iterator[LogEntry]:
    if is_manifest(path):
        yield from read_manifest(path)
        return
    logs = sorted(logs_in_folder(path), key=lambda one: natural(str(one))) if path.is_dir() else [path]
    for log in logs:
        inside = logs_in_zip(log) if log.suffix.lower() == ".zip" else []
        place = settled(str(log))
        yield from (LogEntry(f"zip://{name}::{place}") for name in sorted(inside, key=natural))
        if not inside:
            yield LogEntry(place)


def _at_address(named: str) -> list[str]:
    """Places of files; of a folder all below it."""
    system, path = file_system(named)
    try:
        if glob.has_magic(path):
            found = system.glob(path)
        elif system.isdir(path):
            found = [one for one in system.find(path) if may_be_log(one.removeprefix(path).lstrip("/"))]
        else:
            return [named]
    except OSError as error:
        raise DataError(f"{named}: {error}") from error
    inner, chained, outer = named.partition("::")
    scheme = inner.partition("://")[0]
    places = (f"{scheme}://{one.lstrip('/')}" if chained else system.unstrip_protocol(one) for one in found)
    return sorted((f"{place}{chained}{outer}" for place in places), key=natural)


def _with_truth_beside(entries: Sequence[LogEntry]) -> list[LogEntry]:
    """Where ``walk_truth.csv`` is beside ``walk.csv``, it is its truth; named as a log or not."""
    by_stem = {_stem(entry.log): entry.log for entry in entries if entry.truth is None}

    def beside(entry: LogEntry) -> str | None:
        if (named := by_stem.get(_stem(entry.log) + _TRUTH)) is not None or is_address(entry.log):
            return named
        path = Path(entry.log).with_name(f"{log_name(Path(entry.log))}{_TRUTH}.csv")
        return str(path) if path.is_file() else None

    told = [replace(entry, truth=beside(entry)) if entry.truth is None else entry for entry in entries]
    truths = {entry.truth for entry in told}
    return [entry for entry in told if entry.log not in truths]


def _stem(place: str) -> str:
    """A place without the endings of its name; of what is in a zip, with the zip."""
    inner, chained, outer = place.partition("::")
    return f"{outer}{chained}{inner.removesuffix(last_name(place))}{log_name(Path(last_name(place)))}"


def named_entries(entries: Sequence[LogEntry], before: Sequence[LogEntry] = ()) -> list[LogEntry]:
    """Logs with a name each, for their run folders; who had one before keeps it.

    Args:
        entries: with names, or without.
        before: those of the batch that is resumed.

    Raises:
        ConfigError: two logs were given one name.
    """
    given = Counter(entry.name.casefold() for entry in entries if entry.name)
    if twice := [entry for entry in entries if given[entry.name.casefold()] > 1]:
        raise ConfigError(f"two logs are to be called {twice[0].name!r}: {twice[0].log} and {twice[1].log}")
    kept = {(entry.log, entry.config): entry.name for entry in reversed(before)}
    taken = {*given, *(entry.name.casefold() for entry in before)}
    stems = Counter(_folder_name(entry.log).casefold() for entry in entries if not entry.name)
    named = []
    for entry in entries:
        name = entry.name or kept.pop((entry.log, entry.config), "")
        if not name:
            name = _folder_name(entry.log)
            if stems[name.casefold()] > 1 or name.casefold() in taken:
                name = f"{name}-{_digest(repr(entry))}"
        named.append(replace(entry, name=name))
    return named


def _folder_name(place: str) -> str:
    """What a log's run is called: as the log, as far as a folder can be."""
    name = log_name(Path(last_name(place)))
    if plain(name) and len(name.encode()) <= _LONGEST_NAME:
        return name
    shown = "".join(c if plain(f"a{c}") else "_" for c in name).lstrip(".")
    short = shown.encode()[: _LONGEST_NAME - _DIGEST_CHARS].decode("utf-8", "ignore")
    return f"{short}-{_digest(place)}"


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:_DIGEST_CHARS]
