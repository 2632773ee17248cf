"""The commands that ``crash_tests`` breaks off, what is there before them, and what must hold afterwards."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from forked_command import run

from fbgraph.core.config import load_config
from fbgraph.core.sensor_log import SensorLog
from fbgraph.study.column_names import load_layout

STUDY = ("study", "simulated", "--trials", "1", "--out", "study", "--seed")
TIMED = ("summary.json", "report.html")  # these hold how long something took
RECORDINGS = (".rrd",)  # these hold a random number
ROUTE = ("--route", "square", "--scale", "0.15", "--seed")  # eight steps, and every file that a walk can have
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


def cases(base: Path, names: tuple[str, ...]) -> list[Case]:
    """Those whose name begins so, made in ``base``: two logs, their runs, a live walk broken off."""
    made = Base(base, names)
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
        *(made.of_files(*command) for command in COMMANDS if command[0].startswith(names)),
    ]
    return [case for case in known if case.name.startswith(names)]


COMMANDS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("simulate", ("simulate", "out.csv", *ROUTE, "1"), ("out.csv", "out_truth.csv")),
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

    def __init__(self, folder: Path, names: tuple[str, ...]) -> None:
        """Make in a folder what cases whose names begin so need."""
        self._folder = folder
        for seed in ("1", "2"):
            self._made("simulate", f"{seed}.csv", *ROUTE, seed)
            self._made("smooth", f"{seed}.csv", "--out", f"run{seed}")
        if any(name.startswith("study"[: len(name)]) for name in names):
            make_studies(folder)
        if any(name.startswith("replay"[: len(name)]) for name in names):
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


def make_studies(folder: Path) -> None:
    """Make ``study1`` and ``study2``. What a study computes and draws between its writes is from then on remembered.

    A study takes seconds for that, and would two hundred times; all that it reads and writes it does each time.
    """
    from fbgraph.study import figures, report, run_study

    def remembered(make: Callable[..., Any], log_of: Callable[[Any], SensorLog]) -> Callable[..., Any]:
        known: dict[bytes, Any] = {}

        def made(given: Any, *more: Any) -> Any:
            key = log_of(given).acc.values.tobytes()
            if key not in known:
                known[key] = make(given, *more)
            return known[key]

        return made

    run_study.__dict__["run_study"] = remembered(run_study.run_study, lambda dataset: dataset.trials[0].log)
    report.__dict__["draw"] = remembered(figures.draw, lambda result: result.trials[0].trial.log)
    for seed in (1, 2):
        config, layout = load_config("forestback"), load_layout("forestback")
        run_study.study_files(run_study.SIMULATED, folder / f"study{seed}", config, layout, seed, 1)


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
