#!/usr/bin/env python3
"""Plants one-line faults and asks whether a test notices: .venv/bin/python scripts/mutants.py [--ci] [ROOM …]

Faults are listed in ``tests/mutants/ROOM.toml``: the file, what stands there once, what is put instead, why that would
hurt, and the tests that must fail. Each is planted in a copy of the checkout; the work tree is never touched.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_COPIED = ("fbgraph", "configs", "tests", "scripts", "pyproject.toml", "README.md")


@dataclass(frozen=True)
class Fault:
    """One line gone wrong; ``ci`` says that it is planted in every run of the tests."""

    room: str
    file: str
    find: str
    replace: str
    why: str
    tests: tuple[str, ...]
    ci: bool = False


def read_faults(rooms: list[str]) -> Iterator[Fault]:
    """The faults of these rooms, all if none is named.

    Raises:
        ValueError: a fault that cannot be planted as it is written.
    """
    for path in sorted((ROOT / "tests" / "mutants").glob("*.toml")):
        if rooms and path.stem not in rooms:
            continue
        for entry in tomllib.loads(path.read_text("utf-8"))["fault"]:
            fault = Fault(room=path.stem, **{**entry, "tests": tuple(entry["tests"])})
            if (ROOT / fault.file).read_text("utf-8").count(fault.find) != 1:
                raise ValueError(f"{path.name}: {fault.find!r} does not stand once in {fault.file}")
            yield fault


def noticed(fault: Fault) -> bool:
    """Whether a test fails once the fault is planted."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "checkout"
        copy.mkdir()
        for name in _COPIED:
            source, target = ROOT / name, copy / name
            if source.is_dir():
                shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__", "mutants"))
            else:
                shutil.copyfile(source, target)
        if (ROOT.parent / "shared").is_dir():
            (Path(folder) / "shared").symlink_to(ROOT.parent / "shared")
        planted = copy / fault.file
        planted.write_text(planted.read_text("utf-8").replace(fault.find, fault.replace), "utf-8")
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "--no-header", *fault.tests]
        environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, timeout=600)
        if done.returncode not in (0, 1):
            raise RuntimeError(
                f"{fault.file}: {fault.find!r}: pytest ended with {done.returncode}\n{done.stdout[-2000:]}"
            )
        return done.returncode == 1


def main() -> int:
    """Plant the faults; 0 if every one is noticed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rooms", nargs="*", help="rooms whose faults to plant; all if none")
    parser.add_argument("--ci", action="store_true", help="only those that every run of the tests plants")
    given = parser.parse_args()
    faults = [fault for fault in read_faults(given.rooms) if fault.ci or not given.ci]
    with ThreadPoolExecutor(max_workers=2) as pool:
        results = list(pool.map(noticed, faults))
    for fault, found in zip(faults, results, strict=True):
        if not found:
            print(f"NOT NOTICED {fault.file}: {fault.find!r} -> {fault.replace!r}: {fault.why}")
    print(f"{sum(results)} of {len(results)} faults noticed")
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
