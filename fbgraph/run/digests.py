"""SHA-256 of a run's files as its summary notes them: the last resort where damage contradicts nothing else.

Of text whatever its line ends, and of the summary's content, so that neither line ends nor another layout of the JSON
are taken for damage. Runs of before fbgraph noted them are read without.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fbgraph.core.errors import DataError
from fbgraph.core.tables import read_text

SUMMARY = "summary.json"
DIGESTS = "sha256"
"""The summary's key of them."""


def noted_digests(folder: Path, summary: Mapping[str, Any]) -> dict[str, str]:
    """By name: of every text file that was written into a folder, and of the summary that is to be."""
    tables = sorted(path for path in folder.iterdir() if path.suffix in (".tum", ".csv", ".toml"))
    digests = {path.name: _digest(read_text(path, "text")) for path in tables}
    return {**digests, SUMMARY: _digest(_canonical(summary))}


def require_as_written(path: Path, digests: Mapping[str, str]) -> None:
    """Refuse a file of a run that is not what was written.

    Raises:
        DataError: it is not.
    """
    _compare(path, read_text(path, "text"), digests)


def require_summary_as_written(path: Path, summary: Mapping[str, Any], digests: Mapping[str, str]) -> None:
    """Refuse a summary, without its digests, that is not what was written.

    Raises:
        DataError: it is not.
    """
    _compare(path, _canonical(summary), digests)


def _compare(path: Path, text: str, digests: Mapping[str, str]) -> None:
    if digests.get(path.name, "") not in ("", _digest(text)):
        raise DataError(f"{path}: not as it was written: its SHA-256 is not the one that {SUMMARY} notes")


def _canonical(summary: Mapping[str, Any]) -> str:
    return json.dumps(summary, sort_keys=True)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
