#!/usr/bin/env python3
"""What is left when a disk fails or a process is killed.

.venv/bin/python scripts/crash_tests.py [--case NAME …] [--part N] [--kills N]

Every write, sync, rename, link and new folder of ``smooth``, ``online`` (replayed, live, resumed), ``record`` and
``study`` fails once with ENOSPC, once with EIO, and is once the last thing a process does (``faulty_disk.c``); then
commands are killed at random moments. Each time the old or the new run must stand whole, the lines of a live walk must
be there to the byte, and the next start must leave nothing beside them. Needs Linux and a C compiler.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
KINDS = ("ENOSPC", "EIO", "KILL")
_PATIENCE_S = 30.0  # a command on a two-core machine that does other things too; a hang would be for ever
STUDY = ("study", "simulated", "--seed", "1", "--trials", "1", "--out", "study")


@dataclass(frozen=True)
class Case:
    """A command, what is there before it, and what must hold whatever happens to it.

    Attributes:
        name: of the case.
        arguments: of ``fbgraph``, in the folder where it is run.
        prepare: makes that folder.
        stdin: what is sent to it.
        whole: says what is wrong with what is left, or nothing.
    """

    name: str
    arguments: tuple[str, ...]
    prepare: Callable[[Path], None]
    whole: Callable[[Path], str]
    stdin: bytes = b""


def run(folder: Path, arguments: tuple[str, ...], stdin: bytes = b"", **environment: str) -> tuple[int, str]:
    """Run the command; its exit code and what it said. RuntimeError if it hangs."""
    command = [sys.executable, "-m", "fbgraph", *arguments]
    known = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    try:
        done = subprocess.run(
            command, cwd=folder, input=stdin, capture_output=True, timeout=_PATIENCE_S, env=known, check=False
        )
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{' '.join(arguments)} hangs with {environment}") from None
    return done.returncode, done.stderr.decode("utf-8", "replace")


def leftovers(folder: Path) -> list[str]:
    """What was left beside or inside the places that are written."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob(".*fbgraph*"))


def cases(base: Path, names: tuple[str, ...]) -> list[Case]:
    """Those whose name begins so, made in ``base``: two logs, their runs, a live walk broken off."""
    made = Base(base, study=any("study".startswith(name) for name in names))
    live, raw, half = ("online", "--source", "stdin", "--no-recording"), made.raw, made.half
    over = ("--out", "run", "--force")
    known = [
        Case("smooth, nothing there", ("smooth", "1.csv", "--out", "run"), made.has(), made.one_of("run1", "")),
        Case("smooth over a run", ("smooth", "1.csv", *over), made.old_run, made.one_of("run1", "run2")),
        Case("replay over a run", ("online", "1.csv", *over), made.old_run, made.one_of("online1", "run2")),
        Case("live", (*live, "--out", "live"), made.has(), recorded(raw, b""), raw),
        Case("live, resumed", (*live, "--resume", "live"), made.begun, recorded(raw[half:], raw[:half]), raw[half:]),
        Case("record", ("record", "run1"), made.has("run1"), a_recording),
        Case("study", STUDY, made.has(), made.a_study),
    ]
    return [case for case in known if case.name.startswith(names)]


class Base:
    """What the cases are made of: two logs, a run of each, a replay, a study, the lines of a live walk.

    Attributes:
        raw: the first log.
        half: where its lines are broken off.
    """

    def __init__(self, folder: Path, *, study: bool) -> None:
        """Make it in a folder; the study only if asked for, as it takes long."""
        self._folder = folder
        for seed in (1, 2):
            run(folder, ("simulate", f"{seed}.csv", "--route", "square", "--seed", str(seed)))
            run(folder, ("smooth", f"{seed}.csv", "--out", f"run{seed}"))
        run(folder, ("online", "1.csv", "--out", "online1"))
        if study:
            run(folder, STUDY)
        self.raw = (folder / "1.csv").read_bytes()
        self.half = self.raw.rfind(b"\n", 0, len(self.raw) // 2) + 1
        run(folder, ("online", "--source", "stdin", "--out", "live", "--no-recording"), self.raw)

    def has(self, *names: str) -> Callable[[Path], None]:
        """Puts the logs, and what else is named, into a folder."""

        def prepare(folder: Path) -> None:
            for name in ("1.csv", "2.csv", *names):
                source = self._folder / name
                (shutil.copytree if source.is_dir() else shutil.copyfile)(source, folder / name)

        return prepare

    def old_run(self, folder: Path) -> None:
        """The run of the other log is there."""
        self.has()(folder)
        shutil.copytree(self._folder / "run2", folder / "run")

    def begun(self, folder: Path) -> None:
        """Half of a live walk is there."""
        self.has()(folder)
        (folder / "live").mkdir()
        (folder / "live" / "raw.csv").write_bytes(self.raw[: self.half])
        shutil.copyfile(self._folder / "live" / "config.toml", folder / "live" / "config.toml")

    def one_of(self, *runs: str) -> Callable[[Path], str]:
        """``run`` is one of these, byte for byte in what is not timed; "" for not there."""

        def whole(folder: Path) -> str:
            there = [name for name in runs if name and same_run(folder / "run", self._folder / name)]
            absent = "" in runs and not (folder / "run").exists()
            return "" if there or absent else f"run is neither of {runs}: {listing(folder / 'run')}"

        return whole

    def a_study(self, folder: Path) -> str:
        """The study is whole, or not there."""
        there, known = listing(folder / "study"), listing(self._folder / "study")
        return "" if there in (known, ["absent"]) else f"half a study: {there}"


def recorded(sent: bytes, before: bytes) -> Callable[[Path], str]:
    """The lines of the walk: what was there before is, and what more is there is what was sent, in order."""

    def whole(folder: Path) -> str:
        path = folder / "live" / "raw.csv"
        there = path.read_bytes() if path.exists() else b""
        return "" if there.startswith(before) and (before + sent).startswith(there) else "raw.csv is another walk"

    return whole


def a_recording(folder: Path) -> str:
    """The recording can be read."""
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(folder / "run1" / "recording.rrd")]
    return "" if subprocess.run(command, capture_output=True, check=False).returncode == 0 else "a broken recording"


def listing(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir()) if folder.is_dir() else ["absent"]


def same_run(a: Path, b: Path) -> bool:
    """Whether two run folders hold the same walk, whole."""
    names = listing(b)
    if listing(a) != names:
        return False
    timed = ("summary.json", "recording.rrd")
    if any((a / n).read_bytes() != (b / n).read_bytes() for n in names if n not in timed):
        return False
    return all((a / n).stat().st_size > 0.9 * (b / n).stat().st_size for n in timed if n in names)


def shim(folder: Path) -> Path:
    """The failing disk, compiled."""
    library = folder / "faulty_disk.so"
    source = str(ROOT / "scripts" / "faulty_disk.c")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(library), source, "-ldl"], check=True)
    return library


def checked(case: Case, folder: Path, code: int, said: str) -> list[str]:
    """What is wrong after a command met its fate: in what is left, in what it said, after the next start."""
    wrong = [text for text in (case.whole(folder),) if text]
    if "Traceback" in said or "unexpected" in said:
        wrong.append(f"exit {code}: {said.strip().splitlines()[-1]}")
    if case.name.startswith("live"):
        kept = (folder / "live" / "raw.csv").read_bytes() if (folder / "live" / "raw.csv").exists() else b""
        place = ("--resume", "live") if (folder / "live" / "config.toml").exists() else ("--out", "live")
        if not (folder / "live" / "summary.json").exists():
            before = b"" if case.name == "live" else (folder / "before.raw").read_bytes()
            rest = (before + case.stdin)[len(kept[: kept.rfind(b"\n") + 1]) :]
            code, said = run(folder, ("online", "--source", "stdin", "--no-recording", *place), rest)
            if code:
                wrong.append(f"the next start ended with {code}: {said.strip()}")
            raw = folder / "live" / "raw.csv"
            if not raw.exists() or raw.read_bytes() != before + case.stdin:
                wrong.append("resumed, but not to the byte")
        else:  # killed when all was in its place: who writes there next clears away what was set aside
            code, said = run(folder, ("record", "live"))
            if code:
                wrong.append(f"the next start ended with {code}: {said.strip()}")
    else:
        code, said = run(
            folder, (*case.arguments, *(["--force"] if case.name.startswith(("smooth", "replay")) else []))
        )
        if code:
            wrong.append(f"the next start ended with {code}: {said.strip()}")
    if left := leftovers(folder):
        wrong.append(f"left after the next start: {left}")
    return wrong


def prepared(case: Case, folder: Path) -> Path:
    folder.mkdir()
    case.prepare(folder)
    if (folder / "live" / "raw.csv").exists():
        shutil.copyfile(folder / "live" / "raw.csv", folder / "before.raw")
    return folder


def inject(case: Case, work: Path, library: Path, part: random.Random | None, share: float) -> tuple[int, list[str]]:
    """Let every call fail, or a drawn share of them; how many did, and what was wrong."""
    folder = prepared(case, work / "count")
    faults = {"LD_PRELOAD": str(library), "FAULT_UNDER": str(folder), "FAULT_LOG": str(work / "calls")}
    run(folder, case.arguments, case.stdin, **faults, FAULT_AT="0")
    calls = (work / "calls").read_text("utf-8", "replace").splitlines()
    shutil.rmtree(folder)
    todo = [(at, kind) for at in range(1, len(calls) + 1) for kind in KINDS]
    if part is not None:
        todo = part.sample(todo, max(round(share), 1))
    wrong = []
    for at, kind in todo:
        folder = prepared(case, work / "failing")
        faults = {"LD_PRELOAD": str(library), "FAULT_UNDER": str(folder), "FAULT_AT": str(at), "FAULT_KIND": kind}
        code, said = run(folder, case.arguments, case.stdin, **faults)
        wrong += [f"{case.name}: call {calls[at - 1]} {kind}: {text}" for text in checked(case, folder, code, said)]
        shutil.rmtree(folder)
    return len(todo), wrong


def kill(case: Case, work: Path, rng: random.Random) -> list[str]:
    """Kill a command at a random moment; what was wrong."""
    folder = prepared(case, work / "killed")
    command = [sys.executable, "-m", "fbgraph", *case.arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=environment,
    )
    after_s, begin = rng.uniform(0.1, 1.6), time.monotonic()
    try:
        for at in range(0, len(case.stdin), 20_000):
            os.write(process.stdin.fileno() if process.stdin else -1, case.stdin[at : at + 20_000])
        if process.stdin:
            process.stdin.close()
        process.wait(max(after_s - (time.monotonic() - begin), 0.0))
    except (subprocess.TimeoutExpired, BrokenPipeError):
        process.send_signal(signal.SIGKILL)
    process.wait()
    wrong = [f"{case.name}: killed after {after_s:.2f} s: {text}" for text in checked(case, folder, 0, "")]
    shutil.rmtree(folder)
    return wrong


def main() -> int:
    """Let everything fail; 0 if all that must stay stayed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", nargs="+", default=[""], help="only those that begin so: smooth, replay, live, …")
    parser.add_argument("--part", type=int, metavar="N", help="only so many failing calls of each command, drawn")
    parser.add_argument("--kills", type=int, default=200, metavar="N", help="kills at random moments")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    wrong: list[str] = []
    done = 0
    with tempfile.TemporaryDirectory(prefix="crash-") as folder:
        work = Path(folder)
        (work / "base").mkdir()
        all_cases, library = cases(work / "base", tuple(given.case)), shim(work)
        rng = random.Random(given.seed)
        for case in all_cases:
            part = rng if given.part is not None else None
            count, found = inject(case, work, library, part, given.part or 0)
            done, wrong = done + count, wrong + found
            print(f"{case.name}: {count} failing calls, {len(found)} times something was wrong", flush=True)
        for number in range(given.kills):
            wrong += kill(all_cases[number % len(all_cases)], work, rng)
    print("".join(f"WRONG {text}\n" for text in wrong), end="")
    print(f"{done} failing calls and {given.kills} kills, {len(wrong)} times something was wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
