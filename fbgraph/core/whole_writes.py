"""Files and folders that appear whole or not at all: written beside their place, then renamed into it."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from fbgraph.core.errors import ConfigError


@contextmanager
def whole_folder(out: Path, keep: Collection[str] = ()) -> Iterator[Path]:
    """A folder to write into that replaces ``out`` when the block ends well, and vanishes when it does not.

    Args:
        out: the folder to be.
        keep: names of files of the folder that is replaced which stay.

    Raises:
        ConfigError: its parent cannot be written.
    """
    with _beside(out, make_parents=True) as partial:
        partial.chmod(0o755)
        yield partial
        for name in keep:
            if (out / name).is_file() and not (partial / name).exists():
                os.link(out / name, partial / name)
        if out.exists():
            shutil.rmtree(out)
        partial.rename(out)


@contextmanager
def whole_file(path: Path, make_parents: bool = False) -> Iterator[Path]:
    """A path to write to that replaces ``path`` when the block ends well, and vanishes when it does not.

    Args:
        path: the file to be.
        make_parents: make the folders above it; else they must be there.

    Raises:
        ConfigError: the file cannot be written.
    """
    with _beside(path, make_parents) as folder:
        partial = folder / path.name
        try:
            yield partial
            partial.replace(path)
        except OSError as error:
            raise ConfigError(f"{path}: cannot write there: {error.strerror or error}") from error


@contextmanager
def _beside(path: Path, make_parents: bool) -> Iterator[Path]:
    """A folder of our own on the same file system."""
    try:
        if make_parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise ConfigError(f"{path}: cannot write there: {error.strerror}") from error
    try:
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)
