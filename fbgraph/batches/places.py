"""Where logs and results are: paths, or addresses that fsspec knows (``s3://…``, ``memory://…``, ``zip://A::B``)."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import unquote, urlsplit

from fbgraph.core.bounded import BLOCK_BYTES, Allowance
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.whole_writes import locked, whole_file


def is_address(place: str) -> bool:
    """Whether a place is an address and no path."""
    return "://" in place


def settled(place: str) -> str:
    """A place that means the same from anywhere: an address as it is (``file://`` as its path), a path in full."""
    if place.startswith("file://"):
        place = unquote(urlsplit(place).path)
    return place if is_address(place) else str(Path(place).resolve())


def joined(place: str, *names: str) -> str:
    """A place below another."""
    return "/".join((place.rstrip("/"), *names)) if is_address(place) else str(Path(place, *names))


def last_name(place: str) -> str:
    """What a file or folder is called, without its place."""
    inner = place.partition("::")[0] if is_address(place) else place
    return PurePosixPath(inner.partition("://")[2] or inner).name


def file_system(place: str) -> tuple[Any, str]:
    """The file system of an address, and the path there.

    Raises:
        ConfigError: nobody knows such addresses, or their plug-in is not installed.
    """
    import fsspec

    try:
        found: tuple[Any, str] = fsspec.core.url_to_fs(place)
    except (ImportError, ValueError) as error:
        raise ConfigError(f"{place}: {error}") from error
    except FileNotFoundError as error:
        raise DataError(f"{place}: no such file") from error
    except zipfile.BadZipFile as error:
        raise DataError(f"{place}: the zip is truncated or damaged ({error}); copy it again") from error
    return found


def version_of(place: str) -> str:
    """What changes when a file does, as far as can be told without reading it; ``""`` if it is not there."""
    try:
        if is_address(place):
            system, path = file_system(place)
            info = system.info(path)
            named = (info.get(key) for key in ("size", "ETag", "etag", "mtime", "LastModified", "created", "CRC"))
            return " ".join(str(value) for value in named if value is not None)
        path_here = Path(place)
        files = sorted(f for f in path_here.rglob("*") if f.is_file()) if path_here.is_dir() else [path_here]
        return " ".join(f"{f.name} {f.stat().st_size} {f.stat().st_mtime_ns}" for f in files)
    except (OSError, ValueError, DataError):
        return ""


def fetched(place: str, folder: Path, max_size: int | None = None) -> Path:
    """A file or folder where it can be read: what is on another system is copied to a folder.

    Args:
        place: of the file or folder.
        folder: to copy to.
        max_size: bytes of a file that are copied at most; as much as a log may have if None.

    Raises:
        DataError: no such file, one too large, or an archive that does not give it.
        ConfigError: as ``file_system``.
    """
    if not is_address(place):
        return Path(place)
    system, path = file_system(place)
    here = folder / (last_name(place) or "log")
    try:
        if system.isdir(path):
            system.get(path.rstrip("/") + "/", f"{here}/", recursive=True)
        else:
            allowed, size = Allowance.of(max_size), 0
            with system.open(path, "rb") as source, open(here, "wb") as out:
                while block := source.read(BLOCK_BYTES):
                    allowed.refuse(place, size := size + len(block), None)
                    out.write(block)
    except FileNotFoundError as error:
        raise DataError(f"{place}: no such file") from error
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError) as error:
        if not place.startswith("zip://"):
            raise
        raise DataError(f"{place}: truncated, damaged, encrypted or packed in a way not known ({error})") from error
    return here


@contextmanager
def written_file(place: str) -> Iterator[Path]:
    """A path to write to that becomes the file at a place when the block ends well.

    Raises:
        ConfigError: it cannot be written there.
    """
    if not is_address(place):
        with whole_file(Path(place), make_parents=True) as partial:
            yield partial
        return
    system, path = file_system(place)
    with TemporaryDirectory(prefix="fbgraph-") as folder:
        partial = Path(folder) / last_name(place)
        yield partial
        try:
            system.put_file(str(partial), path)
        except OSError as error:
            raise ConfigError(f"{place}: cannot write there: {error}") from error


def put_folder(folder: Path, place: str, last: str) -> None:
    """Bring the files of a folder to an address, that of this name last: who finds it there finds them all."""
    system, path = file_system(place)
    if system.exists(path):
        system.rm(path, recursive=True)
    system.makedirs(path, exist_ok=True)
    for file in sorted(folder.iterdir(), key=lambda one: (one.name == last, one.name)):
        system.put_file(str(file), f"{path.rstrip('/')}/{file.name}")


def names_at(place: str) -> set[str]:
    """What is in a folder; nothing if there is none.

    Raises:
        ConfigError: as ``file_system``, or it is a file.
    """
    if not is_address(place):
        path_here = Path(place)
        if path_here.exists() and not path_here.is_dir():
            raise ConfigError(f"--out {place}: is a file; name a folder")
        return {entry.name for entry in path_here.iterdir()} if path_here.is_dir() else set()
    system, path = file_system(place)
    try:
        return {PurePosixPath(found.rstrip("/")).name for found in system.ls(path, detail=False)}
    except FileNotFoundError:
        return set()


@contextmanager
def held(place: str) -> Iterator[None]:
    """Nobody else on this machine writes a batch to a place meanwhile; of an address nobody can say.

    Raises:
        ConfigError: another process does.
    """
    if is_address(place):
        yield
        return
    with locked(Path(place)):
        yield
