#!/usr/bin/env python3
"""What is left when a disk fails or a process is killed.

.venv/bin/python scripts/crash_tests.py [--case NAME …] [--part N] [--kills N] [--patience S]

Every call that changes the disk (write, sync, rename, link; a file or folder made, cut or removed) of ``smooth``,
``online`` (replayed, live, resumed), ``record``, ``study`` and the commands that write a file fails once with ENOSPC,
once with EIO, and is once the last thing a process does (``faulty_disk.c``); then commands are killed at random
moments. Each time the old or the new must stand whole, the lines of a live walk must be there to the byte, a command
that says that it went well must have written, and the next start must leave nothing beside it. Commands are forks of
one process (``forked_command.py``). Needs Linux and a C compiler.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from crash_cases import LIVE, Case, cases
from forked_command import Ended, import_everything, run

ROOT = Path(__file__).resolve().parents[1]
KINDS = ("ENOSPC", "EIO", "KILL")


def leftovers(folder: Path) -> list[str]:
    """What was left beside or inside the places that are written."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob(".*fbgraph*"))


def shim(folder: Path) -> Path:
    """The failing disk, compiled."""
    library = folder / "faulty_disk.so"
    source = str(ROOT / "scripts" / "faulty_disk.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(library), source, "-ldl"], check=True)
    return library


class Trials:
    """Lets commands fail and looks at what they leave."""

    def __init__(self, work: Path, patience_s: float) -> None:
        """Works in a folder of its own; a command that takes longer than ``patience_s`` hangs."""
        self._work = work
        self._patience_s = patience_s
        self._took_s = 0.0
        self.longest_s = 0.0
        """By how much a command that failed took longer than it takes undisturbed."""

    def inject(self, case: Case, part: random.Random | None, share: int) -> tuple[int, list[str]]:
        """Let every call fail, or a drawn share of them; how many did, and what was wrong."""
        folder, log = self._prepared(case), self._work / "calls"
        log.unlink(missing_ok=True)
        counted = self._run(case, folder, {"FAULT_UNDER": str(folder), "FAULT_AT": "0", "FAULT_LOG": str(log)})
        if counted.code:
            raise RuntimeError(f"{case.name}: {counted.said}")
        self._took_s = counted.took_s
        calls = log.read_text("utf-8", "replace").replace(str(folder), "").splitlines()
        shutil.rmtree(folder)
        todo = [(at, kind) for at in range(1, len(calls) + 1) for kind in KINDS]
        if part is not None:
            todo = part.sample(todo, min(max(share, 1), len(todo)))
        wrong = []
        for number, (at, kind) in enumerate(todo, 1):
            folder = self._prepared(case)
            ended = self._run(
                case, folder, {"FAULT_UNDER": str(folder), "FAULT_AT": str(at), "FAULT_KIND": kind, "FAULT_LOG": ""}
            )
            self.longest_s = max(self.longest_s, ended.took_s - self._took_s)
            wrong += [
                f"{case.name}: call {calls[at - 1]} {kind}: {text}" for text in self._checked(case, folder, ended)
            ]
            shutil.rmtree(folder)
            if number % 50 == 0:
                print(f"{case.name}: {number} of {len(todo)}", file=sys.stderr, flush=True)
        return len(todo), wrong

    def kill(self, case: Case, rng: random.Random) -> list[str]:
        """Kill a command at a random moment; what was wrong."""
        if not self._took_s:
            folder = self._prepared(case)
            self._took_s = self._run(case, folder, {}).took_s
            shutil.rmtree(folder)
        folder, after_s = self._prepared(case), rng.uniform(0.0, 1.1 * self._took_s)
        ended = run(folder, case.arguments, case.stdin, self._patience_s, after_s)
        wrong = [f"{case.name}: killed after {after_s:.2f} s: {t}" for t in self._checked(case, folder, ended)]
        shutil.rmtree(folder)
        return wrong

    def _prepared(self, case: Case) -> Path:
        folder = self._work / "place"
        folder.mkdir()
        case.prepare(folder)
        if (folder / "live" / "raw.csv").exists():
            shutil.copyfile(folder / "live" / "raw.csv", folder / "before.raw")
        return folder

    def _run(self, case: Case, folder: Path, faults: dict[str, str]) -> Ended:
        return run(folder, case.arguments, case.stdin, self._patience_s, environment=faults)

    def _checked(self, case: Case, folder: Path, ended: Ended) -> list[str]:
        """What is wrong after a command met its fate: in what is left, in what it said, after the next start."""
        wrong = [text for text in (case.whole(folder, ended.code == 0),) if text]
        said = [line for line in ended.said.strip().splitlines() if line.strip()]
        if "Traceback" in ended.said or "unexpected" in ended.said:
            wrong.append(f"exit {ended.code}: {said[-1]}")
        elif ended.code > 0 and not any(line.startswith("fbgraph: ") for line in said):
            wrong.append(f"exit {ended.code} without a word")
        wrong += self._next_start(case, folder)
        if left := leftovers(folder):
            wrong.append(f"left after the next start: {left}")
        return wrong

    def _next_start(self, case: Case, folder: Path) -> list[str]:
        """Whoever comes next writes there as if nothing had been, and a live walk goes on to the byte."""
        arguments, rest, wrong = case.arguments, b"", []
        live = folder / "live"
        if case.name.startswith(("smooth", "replay")):
            arguments = (*arguments, "--force")
        elif case.name.startswith("live") and (live / "summary.json").exists():
            arguments = ("record", "live")  # finished; who writes there next clears away what was set aside
        elif case.name.startswith("live"):
            before = (folder / "before.raw").read_bytes() if (folder / "before.raw").exists() else b""
            kept = (live / "raw.csv").read_bytes() if (live / "raw.csv").exists() else b""
            rest = (before + case.stdin)[kept.rfind(b"\n") + 1 :]
            arguments = (*LIVE, *(("--resume", "live") if (live / "config.toml").exists() else ("--out", "live")))
        ended = run(folder, arguments, rest, self._patience_s)
        if ended.code:
            wrong.append(f"the next start ended with {ended.code}: {ended.said.strip()}")
        resumed = case.name.startswith("live") and arguments[0] != "record"
        if resumed and (not (live / "raw.csv").exists() or (live / "raw.csv").read_bytes() != before + case.stdin):
            wrong.append("resumed, but not to the byte")
        if not case.name.startswith("live") and (text := case.whole(folder, ended.code == 0)):
            wrong.append(f"after the next start: {text}")
        return wrong


def every_case(given: argparse.Namespace) -> int:
    """Let everything fail; 0 if all that must stay stayed."""
    import_everything()
    (given.work / "base").mkdir()
    all_cases, rng = cases(given.work / "base", tuple(given.case)), random.Random(given.seed)
    wrong: list[str] = []
    done, longest_s = 0, 0.0
    for number, case in enumerate(all_cases):
        trials = Trials(given.work, given.patience)
        count, found = trials.inject(case, None if given.part is None else rng, given.part or 0)
        print(f"{case.name}: {count} failing calls, {len(found)} times something was wrong", flush=True)
        for _ in range(number, given.kills, len(all_cases)):
            found += trials.kill(case, rng)
        done, wrong, longest_s = done + count, wrong + found, max(longest_s, trials.longest_s)
        print("".join(f"WRONG {text}\n" for text in found), end="", flush=True)
    print(f"a command that fails takes at most {longest_s:.1f} s longer than one that does not")
    print(f"{done} failing calls and {given.kills} kills, {len(wrong)} times something was wrong")
    return 1 if wrong else 0


def main() -> int:
    """Begin again with the failing disk before all else, in a folder that vanishes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", nargs="+", default=[""], help="only those that begin so: smooth, replay, live, …")
    parser.add_argument("--part", type=int, metavar="N", help="only so many failing calls of each command, drawn")
    parser.add_argument("--kills", type=int, default=200, metavar="N", help="kills at random moments")
    parser.add_argument("--patience", type=float, default=30.0, metavar="S", help="a command that takes longer hangs")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work is not None:
        return every_case(given)
    memory = Path("/dev/shm")  # whose syncs take no time; faults come from no disk
    with tempfile.TemporaryDirectory(prefix="crash-", dir=memory if memory.is_dir() else None) as folder:
        known = {**os.environ, "LD_PRELOAD": str(shim(Path(folder))), "OPENBLAS_NUM_THREADS": "1"}
        return subprocess.run(
            [sys.executable, __file__, *sys.argv[1:], "--work", folder], env=known, check=False
        ).returncode


if __name__ == "__main__":
    sys.exit(main())
