"""Files and folders that appear whole or not at all, and stay when the power goes: the one place that replaces any.

What is new is written beside its place, synced to the disk, and then exchanged with what was there, so that at every
instant the old or the new stands whole. Who writes holds a lock, so that two processes never replace one place at
once, and what a dead process left beside it is cleared away by the next one.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from fbgraph.core.errors import ConfigError

_OURS = "fbgraph"  # in the names of what lies beside a place while it is written
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2
_NOT_OFFERED = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EPERM)


def real_place(path: Path) -> Path:
    """Where a path really leads, links and ``..`` followed, whether it exists or not.

    Raises:
        ConfigError: to a folder that holds the current one, or to nothing that could be named.
    """
    try:
        place = Path(os.path.realpath(path))
        here = Path.cwd()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from error
    if place == here or place in here.parents:
        raise ConfigError(f"{path}: that is the current folder or one above it; name a folder of its own")
    return place


@contextmanager
def locked(place: Path, make_parents: bool = True) -> Iterator[Path]:
    """Nobody else writes to a place meanwhile; leftovers of dead processes beside it are cleared away first.

    Args:
        place: a file or folder, which need not exist.
        make_parents: make the folders above it; else they must be there.

    Yields:
        Where it really is.

    Raises:
        ConfigError: another process holds it, or nothing can be written beside it.
    """
    place = real_place(place)
    lock = place.parent / f".{place.name}.{_OURS}-lock"
    try:
        if make_parents:
            place.parent.mkdir(parents=True, exist_ok=True)
        descriptor = _hold(lock)
    except OSError as error:
        raise ConfigError(f"{place}: cannot write there: {error.strerror or error}") from error
    if descriptor is None:
        raise ConfigError(f"{place}: another fbgraph (process {_owner(lock)}) is writing there; wait, or name another")
    try:
        _clear_leftovers(place)
        yield place
    finally:
        with suppress(OSError):  # who comes next finds that nobody holds it
            lock.unlink()
        os.close(descriptor)


@contextmanager
def whole_folder(
    out: Path, keep: Collection[str] = (), check: Callable[[Path], None] = lambda place: None
) -> Iterator[Path]:
    """A folder to write into that takes the place of ``out`` when the block ends well, and vanishes when it does not.

    Args:
        out: the folder to be; its place must be ``locked``.
        keep: names of files of the folder that is replaced which stay.
        check: called with what is there now, at once and again just before it is replaced; raises if it must stay.

    Raises:
        ConfigError: it cannot be written.
    """
    place = real_place(out)
    check(place)
    with _beside(place) as partial, _told(out):
        partial.chmod(0o755)
        yield partial
        check(place)
        for name in keep:
            if (place / name).is_file() and not (partial / name).exists():
                os.link(place / name, partial / name)
        for path in (*partial.rglob("*"), partial):
            _sync(path)
        _put(partial, place)


@contextmanager
def whole_file(path: Path, make_parents: bool = False) -> Iterator[Path]:
    """A path to write to that takes the place of ``path`` when the block ends well, and vanishes when it does not.

    Args:
        path: the file to be.
        make_parents: make the folders above it; else they must be there.

    Raises:
        ConfigError: the file cannot be written, or another process is writing it.
    """
    with whole_files((path,), make_parents) as (partial,):
        yield partial


@contextmanager
def whole_files(paths: Sequence[Path], make_parents: bool = False) -> Iterator[tuple[Path, ...]]:
    """As ``whole_file``, of a file and others that belong to it.

    Those others are gone before it is replaced and there after it, so that never one of the old stands beside one of
    the new.

    Args:
        paths: the files to be; what belongs to the first comes after it.
        make_parents: as in ``whole_file``.

    Raises:
        ConfigError: as in ``whole_file``.
    """
    with ExitStack() as held:
        moves = []
        for path in paths:
            if path.exists() and not path.is_file() and not path.is_dir():  # a pipe, a terminal
                moves.append((path, path))
            else:
                place = held.enter_context(locked(path, make_parents))
                moves.append((held.enter_context(_beside(place)) / place.name, place))
        held.enter_context(_told(paths[0]))
        yield tuple(partial for partial, _ in moves)
        moves = [(partial, place) for partial, place in moves if partial != place]
        for partial, _ in moves:
            _sync(partial)
        for _, place in moves[1:]:
            if place.exists():
                place.unlink()
                _sync(place.parent)
        for partial, place in moves:
            partial.replace(place)
            _sync(place.parent)


@contextmanager
def _beside(place: Path) -> Iterator[Path]:
    """A folder of our own on the same file system."""
    try:
        partial = Path(tempfile.mkdtemp(prefix=f".{place.name}.{_OURS}-", dir=place.parent))
    except OSError as error:
        raise ConfigError(f"{place}: cannot write there: {error.strerror or error}") from error
    try:
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Says what the system had against writing."""
    try:
        yield
    except OSError as error:
        raise ConfigError(f"{path}: cannot write there: {error.strerror or error}") from error


def _put(partial: Path, place: Path) -> None:
    """Move a folder to its place; what was there goes where the folder was, or vanishes."""
    if not os.path.lexists(place):
        partial.rename(place)
    elif not _exchanged(partial, place):
        old = place.parent / f".{place.name}.{_OURS}-old"
        place.rename(old)  # from here on, until the next line is done, ``_clear_leftovers`` puts it back
        partial.rename(place)
        shutil.rmtree(old)
    _sync(place.parent)


def _exchanged(a: Path, b: Path) -> bool:
    """Exchange two folders in one step; False where the system does not offer it."""
    if not sys.platform.startswith("linux"):
        return False
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    if rename(_AT_FDCWD, os.fsencode(a), _AT_FDCWD, os.fsencode(b), _RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in _NOT_OFFERED:
        return False
    raise OSError(code, os.strerror(code), str(b))


def _clear_leftovers(place: Path) -> None:
    """Remove what a process that died left beside a place; put back what it had set aside. The lock must be held."""
    old = place.parent / f".{place.name}.{_OURS}-old"
    if old.exists() and not os.path.lexists(place):
        old.rename(place)
    prefix, lock = f".{place.name}.{_OURS}-", f".{place.name}.{_OURS}-lock"
    for entry in place.parent.iterdir():
        if entry.name.startswith(prefix) and entry.name != lock and entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry, ignore_errors=True)


def clear_leftovers_in(folder: Path) -> None:
    """Remove what dead processes left beside the places of a folder; what another process holds stays."""
    names = {one.name[1:].partition(f".{_OURS}-")[0] for one in folder.iterdir() if is_leftover(one.name)}
    for name in names:
        with suppress(ConfigError), locked(folder / name, make_parents=False):
            pass


def is_leftover(name: str) -> bool:
    """Whether a name is that of a lock, or of something that was being written when its process died."""
    return name.startswith(".") and f".{_OURS}-" in name


def _hold(lock: Path) -> int | None:
    """An open lock file that is ours; None if another process holds it."""
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return None
        try:  # who held it before us may have removed the file meanwhile
            still_there = os.path.samestat(os.fstat(descriptor), os.stat(lock))
        except FileNotFoundError:
            still_there = False
        if still_there:
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"{os.getpid()}\n".encode())
            return descriptor
        os.close(descriptor)


def _owner(lock: Path) -> str:
    try:
        return lock.read_text("ascii").strip() or "unknown"
    except (OSError, UnicodeDecodeError):
        return "unknown"


def _sync(path: Path) -> None:
    """Bring a file or folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some file systems cannot sync folders
            raise
    finally:
        os.close(descriptor)
