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
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from forked_command import Ended, import_everything, run

ROOT = Path(__file__).resolve().parents[1]
KINDS = ("ENOSPC", "EIO", "KILL")
STUDY = ("study", "simulated", "--trials", "1", "--out", "study", "--seed")
TIMED = ("summary.json", "report.html")  # these hold how long something took
RECORDINGS = (".rrd",)  # these hold a random number
LIVE = ("online", "--source", "stdin", "--no-recording")


@dataclass(frozen=True)
class Case:
    """A command, what is there before it, and what must hold whatever happens to it.

    Attributes:
        name: of the case.
        arguments: of ``fbgraph``, in the folder where it is run.
        prepare: makes that folder.
        whole: says what is wrong with what is left, or nothing; told whether the command said that it went well.
        stdin: what is sent to it.
    """

    name: str
    arguments: tuple[str, ...]
    prepare: Callable[[Path], None]
    whole: Callable[[Path, bool], str]
    stdin: bytes = b""


def leftovers(folder: Path) -> list[str]:
    """What was left beside or inside the places that are written."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob(".*fbgraph*"))


def cases(base: Path, names: tuple[str, ...]) -> list[Case]:
    """Those whose name begins so, made in ``base``: two logs, their runs, a live walk broken off."""
    made = Base(base, study=any("study".startswith(name) or name.startswith("study") for name in names))
    raw, half = made.raw, made.half
    over = ("--out", "run", "--force")
    known = [
        Case("smooth, nothing there", ("smooth", "1.csv", "--out", "run"), made.has(), made.run("run1", "")),
        Case("smooth over a run", ("smooth", "1.csv", *over), made.old("run2", "run"), made.run("run1", "run2")),
        Case("replay over a run", ("online", "1.csv", *over), made.old("run2", "run"), made.run("online1", "run2")),
        Case("live", (*LIVE, "--out", "live"), made.has(), recorded(raw, b""), raw),
        Case("live, resumed", (*LIVE, "--resume", "live"), made.begun, recorded(raw[half:], raw[:half]), raw[half:]),
        Case("record", ("record", "run1"), made.has("run1"), a_recording),
        Case("study", (*STUDY, "1"), made.has(), made.study("study1", "")),
        Case("study over a study", (*STUDY, "1"), made.old("study2", "study"), made.study("study1", "study2")),
        *(made.of_files(*command) for command in COMMANDS),
    ]
    return [case for case in known if case.name.startswith(names)]


COMMANDS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("simulate", ("simulate", "out.csv", "--route", "square", "--seed", "1"), ("out.csv", "out_truth.csv")),
    ("convert", ("convert", "truth.csv", "out.csv", "--force"), ("out.csv", "out_truth.csv")),
    ("export", ("export", "run1", "--to", "mcap", "--out", "out.mcap"), ("out.mcap",)),
    ("guide", ("guide", "run1", "--format", "csv", "--out", "out.csv"), ("out.csv",)),
    ("plot", ("plot", "run1", "--out", "out.png"), ("out.png",)),
    ("evaluate", ("evaluate", "run1", "--truth", "1_truth.csv", "--errors", "out.csv"), ("out.csv",)),
    ("inspect, plot", ("inspect", "1.csv", "--plot", "out.png"), ("out.png",)),
    ("inspect, layout", ("inspect", "1.csv", "--write-layout", "out.toml"), ("out.toml",)),
)
"""Commands that write files, and which; those after the first belong to it."""


class Base:
    """What the cases are made of: two logs, a run of each, a replay, studies, the lines of a live walk.

    Attributes:
        raw: the first log.
        half: where its lines are broken off.
    """

    def __init__(self, folder: Path, *, study: bool) -> None:
        """Make it in a folder; the studies only if asked for, as they take long."""
        self._folder = folder
        for seed in ("1", "2"):
            self._made("simulate", f"{seed}.csv", "--route", "square", "--seed", seed)
            self._made("smooth", f"{seed}.csv", "--out", f"run{seed}")
            if study:
                self._made(*STUDY, seed)
                (folder / "study").rename(folder / f"study{seed}")
        self._made("online", "1.csv", "--out", "online1")
        self.raw = (folder / "1.csv").read_bytes()
        self.half = self.raw.rfind(b"\n", 0, len(self.raw) // 2) + 1
        self._made(*LIVE, "--out", "live", stdin=self.raw)
        (folder / "truth.csv").write_bytes(log_with_truth(self.raw, (folder / "1_truth.csv").read_bytes()))

    def _made(self, *arguments: str, stdin: bytes = b"") -> None:
        ended = run(self._folder, arguments, stdin, 600.0)
        if ended.code:
            raise RuntimeError(f"{' '.join(arguments)}: {ended.said}")

    def has(self, *names: str) -> Callable[[Path], None]:
        """Puts the logs, and what else is named, into a folder."""

        def prepare(folder: Path) -> None:
            for name in ("1.csv", "2.csv", *names):
                source = self._folder / name
                (shutil.copytree if source.is_dir() else shutil.copyfile)(source, folder / name)

        return prepare

    def old(self, name: str, place: str) -> Callable[[Path], None]:
        """The run or study of something else is there."""

        def prepare(folder: Path) -> None:
            self.has()(folder)
            shutil.copytree(self._folder / name, folder / place)

        return prepare

    def begun(self, folder: Path) -> None:
        """Half of a live walk is there."""
        self.has()(folder)
        (folder / "live").mkdir()
        (folder / "live" / "raw.csv").write_bytes(self.raw[: self.half])
        shutil.copyfile(self._folder / "live" / "config.toml", folder / "live" / "config.toml")

    def run(self, new: str, old: str) -> Callable[[Path, bool], str]:
        """``run`` is one of these, "" for not there; the new one if the command said so."""
        return lambda folder, well: self._one_of(folder / "run", new, old, well)

    def study(self, new: str, old: str) -> Callable[[Path, bool], str]:
        """As ``run``, of ``study``."""
        return lambda folder, well: self._one_of(folder / "study", new, old, well)

    def _one_of(self, place: Path, new: str, old: str, well: bool) -> str:
        if same(place, self._folder / new) or (not well and not old and not place.exists()):
            return ""
        if old and same(place, self._folder / old):
            return "exit 0, and the old one stands" if well else ""
        return f"{place.name} is neither {new} nor {old or 'absent'}: {listing(place)}"

    def of_files(self, name: str, arguments: tuple[str, ...], outs: tuple[str, ...]) -> Case:
        """The case of a command that writes files: those of another walk are there before it."""
        of_other = [a.replace("1.csv", "2.csv").replace("run1", "run2").replace("1_", "2_") for a in arguments]
        of_other = [{"1": "2", "truth.csv": "2.csv"}.get(a, a) for a in of_other]
        for kind, command in (("new", arguments), ("old", tuple(of_other))):
            self._made(*command)
            (self._folder / f"{name}-{kind}").mkdir()
            for out in outs:
                if (self._folder / out).exists():
                    (self._folder / out).rename(self._folder / f"{name}-{kind}" / out)
        if name == "convert":  # of a log without truth
            shutil.copyfile(self._folder / "2_truth.csv", self._folder / f"{name}-old" / outs[1])

        def prepare(folder: Path) -> None:
            self.has("run1", "1_truth.csv", "truth.csv")(folder)
            for out in outs:
                shutil.copyfile(self._folder / f"{name}-old" / out, folder / out)

        def whole(folder: Path, well: bool) -> str:
            return one_walk(folder, self._folder / f"{name}-new", self._folder / f"{name}-old", outs, well)

        return Case(name, arguments, prepare, whole)


def log_with_truth(log: bytes, truth: bytes) -> bytes:
    """A log that carries its truth: where somebody was, in two columns of their own."""
    head, *lines = log.decode().splitlines()
    known = np.genfromtxt(truth.decode().splitlines(), delimiter=",", skip_header=1, usecols=(0, 1, 2))
    t_s = np.array([float(line.partition(",")[0]) for line in lines]) / 1e3
    x_m, y_m = (np.interp(t_s, known[:, 0], known[:, i]) for i in (1, 2))
    rows = [f"{line},{x:.3f},{y:.3f}" for line, x, y in zip(lines, x_m.tolist(), y_m.tolist(), strict=True)]
    return "\n".join((f"{head},pos_x,pos_y", *rows, "")).encode()


def one_walk(folder: Path, new: Path, old: Path, outs: tuple[str, ...], well: bool) -> str:
    """What is wrong with files of which each must be whole, and all of one walk; those after the first may lack."""
    there = {out: (folder / out).read_bytes() if (folder / out).exists() else None for out in outs}
    of = [[kind for kind, at in (("new", new), ("old", old)) if there[out] == (at / out).read_bytes()] for out in outs]
    kinds = [
        kind[0] if kind else "absent" if there[out] is None else "torn" for out, kind in zip(outs, of, strict=True)
    ]
    if "torn" in kinds or kinds[0] == "absent" or len(set(kinds) - {"absent"}) > 1:
        return f"{', '.join(outs)} are {', '.join(kinds)}"
    return f"exit 0, and they are {', '.join(kinds)}" if well and set(kinds) != {"new"} else ""


def recorded(sent: bytes, before: bytes) -> Callable[[Path, bool], str]:
    """The lines of the walk: what was there before is, and what more is there is what was sent, in order."""

    def whole(folder: Path, well: bool) -> str:
        path = folder / "live" / "raw.csv"
        there = path.read_bytes() if path.exists() else b""
        if not there.startswith(before) or not (before + sent).startswith(there):
            return "raw.csv is another walk"
        if not well:
            return ""
        return "" if (folder / "live" / "summary.json").exists() else "exit 0 without a run"

    return whole


def a_recording(folder: Path, well: bool) -> str:
    """The recording can be read."""
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(folder / "run1" / "recording.rrd")]
    return "" if subprocess.run(command, capture_output=True, check=False).returncode == 0 else "a broken recording"


def listing(folder: Path) -> list[str]:
    """Its files, and those of the folders in it."""
    if not folder.is_dir():
        return ["absent"]
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def same(a: Path, b: Path) -> bool:
    """Whether two folders hold the same, whole: byte for byte but for times taken and random numbers."""
    names = listing(b)
    if listing(a) != names:
        return False
    loose = [name for name in names if name in TIMED or name.endswith(RECORDINGS)]
    if any((a / name).read_bytes() != (b / name).read_bytes() for name in names if name not in loose):
        return False
    ends = [(a / name).read_bytes()[-8:] == (b / name).read_bytes()[-8:] for name in loose if name in TIMED]
    return all(ends) and all((a / n).stat().st_size > 0.99 * (b / n).stat().st_size for n in loose)


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
        for at, kind in todo:
            folder = self._prepared(case)
            ended = self._run(
                case, folder, {"FAULT_UNDER": str(folder), "FAULT_AT": str(at), "FAULT_KIND": kind, "FAULT_LOG": ""}
            )
            self.longest_s = max(self.longest_s, ended.took_s - self._took_s)
            wrong += [
                f"{case.name}: call {calls[at - 1]} {kind}: {text}" for text in self._checked(case, folder, ended)
            ]
            shutil.rmtree(folder)
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
        if rest and (not (live / "raw.csv").exists() or (live / "raw.csv").read_bytes() != before + case.stdin):
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
    with tempfile.TemporaryDirectory(prefix="crash-") as folder:
        known = {**os.environ, "LD_PRELOAD": str(shim(Path(folder)))}
        return subprocess.run(
            [sys.executable, __file__, *sys.argv[1:], "--work", folder], env=known, check=False
        ).returncode


if __name__ == "__main__":
    sys.exit(main())
