"""Digests of a run's files: of the text whatever its line ends, and of the summary's content whatever its layout."""

import hashlib
from pathlib import Path

import pytest

from fbgraph.core.errors import DataError
from fbgraph.run.digests import noted_digests, require_as_written, require_summary_as_written


def sha(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def test_every_text_file_is_noted_and_the_summary_that_is_to_be(tmp_path: Path) -> None:
    for name in ("ekf.tum", "breadcrumbs.csv", "config.toml", "recording.rrd", "summary.json"):
        (tmp_path / name).write_bytes(f"{name}\r\n".encode())
    assert noted_digests(tmp_path, {"b": 1, "a": 2.5}) == {
        "breadcrumbs.csv": sha("breadcrumbs.csv\n"),
        "config.toml": sha("config.toml\n"),
        "ekf.tum": sha("ekf.tum\n"),
        "summary.json": sha('{"a": 2.5, "b": 1}'),
    }


def test_another_text_is_refused_where_its_digest_is_known(tmp_path: Path) -> None:
    path = tmp_path / "ekf.tum"
    path.write_bytes(b"1 2\r\n")
    for known in ({}, {"pdr.tum": sha("other")}, {"ekf.tum": ""}, {"ekf.tum": sha("1 2\n")}):
        require_as_written(path, known)
    with pytest.raises(DataError, match=r"ekf\.tum: not as it was written: its SHA-256 is not the one that summary"):
        require_as_written(path, {"ekf.tum": sha("1 3\n")})


def test_another_summary_is_refused_and_another_layout_is_not(tmp_path: Path) -> None:
    path, known = tmp_path / "summary.json", {"summary.json": sha('{"a": 2, "b": 1}')}
    require_summary_as_written(path, {"b": 1, "a": 2}, known)
    with pytest.raises(DataError, match=r"summary\.json: not as it was written"):
        require_summary_as_written(path, {"b": 1, "a": 3}, known)
