#!/usr/bin/env python3
"""Whether another checkout gives the very same results: after a change that was to change none.

git worktree add ../before COMMIT
.venv/bin/python scripts/same_results.py ../before ../shared/data

Every command runs under both checkouts, with this environment; what it wrote is compared to the byte, ``summary.json``
and the printed text without timings, recordings by ``rerun rrd compare``.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
COMMANDS = ("", "smooth", "online", "view", "record", "evaluate", "guide", "simulate", "formats", "study", "config")
_TIMINGS = ("seconds", "fit_seconds", "took_s", "began", "written", "sha256")


def fbgraph(checkout: Path, *arguments: object) -> str:
    """Run the command line of a checkout; what it printed, or how it failed."""
    code = "import sys; from fbgraph.cli import main; sys.argv[0] = 'fbgraph'; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(checkout), "COLUMNS": "80", "OMP_NUM_THREADS": "1"},
    )
    return f"{done.stdout}{done.stderr}exit {done.returncode}\n"


def cases(data: Path | None, work: Path) -> dict[str, list[object]]:
    """Arguments of every command to compare, by name; the output folder is added."""
    found: dict[str, list[object]] = {"builtin": ["smooth", work / "builtin.csv"]}
    found["builtin-online"] = ["online", work / "builtin.csv", "--return-at", "auto"]
    if data is not None:
        ipin = sorted((data / "ipin2023").glob("*.gz"))
        indoor = sorted((data / "indoor-location" / "site1").rglob("*.txt.gz"))[::8]
        found |= {f"smooth-{path.name}": ["smooth", path] for path in (*ipin, *indoor)}
        found |= {f"online-{path.name}": ["online", path, "--return-at", "auto"] for path in ipin[:2]}
        found |= {f"closed-{ipin[0].name}": ["smooth", ipin[0], "--closed-loop"]}
    return found


def run_all(checkout: Path, data: Path | None, work: Path, out: Path) -> None:
    """Every command under one checkout, two at a time."""
    for command in COMMANDS:
        (out / f"help-{command}.txt").write_text(fbgraph(checkout, *filter(None, [command]), "--help"))

    def one(name: str, arguments: list[object]) -> None:
        text = fbgraph(checkout, *arguments, "--out", out / name)
        (out / f"{name}.stdout.txt").write_text(text.replace(str(out), "OUT"))
        for kind in ("text", "json", "csv"):
            (out / f"{name}.guide.{kind}.txt").write_text(fbgraph(checkout, "guide", out / name, "--format", kind))

    with ThreadPoolExecutor(max_workers=2) as pool:
        for done in [pool.submit(one, name, arguments) for name, arguments in cases(data, work).items()]:
            done.result()
    text = fbgraph(checkout, "study", "simulated", "--seed", 1, "--out", out / "study")
    (out / "study.stdout.txt").write_text(text.replace(str(out), "OUT"))


def comparable(path: Path) -> bytes:
    """A file without what differs from run to run: timings, and where it was written."""
    if path.name == "summary.json":
        summary = json.loads(path.read_text())
        for name in _TIMINGS:
            summary.pop(name, None)
        return json.dumps(summary).encode()
    if path.name == "report.html":
        return b""  # its figures hold the time of writing; its numbers are those of table.csv and trials.csv
    return (
        re.sub(rb"\d+(\.\d+)? s\b", b"# s", path.read_bytes())
        if path.name.endswith("stdout.txt")
        else path.read_bytes()
    )


def same(before: Path, after: Path) -> bool:
    """Whether two written files agree."""
    if before.suffix == ".rrd":
        command = [sys.executable, "-m", "rerun", "rrd", "compare", str(before), str(after)]
        return subprocess.run(command, capture_output=True).returncode == 0
    return comparable(before) == comparable(after)


def main() -> int:
    """Run, compare, list what differs; 0 if nothing does."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="the other checkout")
    parser.add_argument("data", type=Path, nargs="?", help="the folder of real logs")
    parser.add_argument("--keep", type=Path, help="keep what was written here; what is there already is not run again")
    given = parser.parse_args()
    data = given.data.resolve() if given.data else None
    with tempfile.TemporaryDirectory() as folder:
        work = (given.keep or Path(folder)).resolve()
        work.mkdir(parents=True, exist_ok=True)
        before, after = work / "before", work / "after"
        if not (work / "builtin.csv").exists():
            fbgraph(given.before.resolve(), "simulate", work / "builtin.csv", "--route", "out-and-back", "--seed", 1)
        for checkout, out in ((given.before.resolve(), before), (HERE, after)):
            if not (out / "study.stdout.txt").exists():
                out.mkdir(exist_ok=True)
                run_all(checkout, data, work, out)
        files = sorted({p.relative_to(root) for root in (before, after) for p in root.rglob("*") if p.is_file()})
        missing = [f for f in files if not ((before / f).exists() and (after / f).exists())]
        different = [f for f in files if f not in missing and not same(before / f, after / f)]
        for text, paths in (("only in one", missing), ("different", different)):
            print("".join(f"{text}: {path}\n" for path in paths), end="")
        print(f"{len(files)} files, {len(different)} different, {len(missing)} only in one")
        return 1 if different or missing else 0


if __name__ == "__main__":
    sys.exit(main())
