"""Walks drawn by a seed, reconstructed and held against their truth; what ``integrity.py`` tells of many of them."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import drawn_body
import drawn_world
import numpy as np
from drawn import Case, Kind, drawn

from fbgraph.core.config import load_config
from fbgraph.core.errors import FbgraphError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.trajectory import Trajectory
from fbgraph.pipeline import reconstruct
from fbgraph.readers import read_log
from fbgraph.run.walk_result import WalkResult
from fbgraph.simulator.files import write_m5stickc_csv
from fbgraph.simulator.simulate import SimulatedWalk

KINDS = (*drawn_body.KINDS, *drawn_world.KINDS)
ALLOWED_M, ALLOWED_Z_M = 0.3, 0.1  # what a place of a step is, and a device's against its wearer's
FAR = 4.0  # sigma
E95 = 2.4477  # 95 % of an ellipse
SOUND, DOUBTFUL, WITHHELD = "sound", "doubtful", "withheld"


@dataclass(frozen=True)
class Judged:
    """One walk.

    Attributes:
        seed, kind, quiet, said: which, and what was wrong.
        verdict: sound, doubtful or withheld; withheld also where no walk came of it.
        reasons: the kinds of its reasons, weightiest first.
        worst_sigma, worst_z_sigma: the largest error in its own sigma, 0.3 m (0.1 m in altitude) allowed besides.
        inside, nearly, inside_z: shares of breadcrumbs within 95 %; ``nearly`` and in altitude with that allowance.
        error_m, sigma_m: the largest error on the plan, and the longest sigma anywhere.
        breadcrumbs: how many.
        seconds: CPU.
    """

    seed: int
    kind: str
    quiet: bool
    said: str
    verdict: str
    reasons: tuple[str, ...]
    worst_sigma: float = 0.0
    worst_z_sigma: float = 0.0
    inside: float = 1.0
    nearly: float = 1.0
    inside_z: float = 1.0
    error_m: float = 0.0
    sigma_m: float = 0.0
    breadcrumbs: int = 0
    seconds: float = 0.0

    @property
    def far(self) -> bool:
        """Whether it is anywhere beyond four of its own sigma."""
        return max(self.worst_sigma, self.worst_z_sigma) > FAR


def judged(seed: int, only: str = "") -> Judged:
    """Draw the walk of a seed, reconstruct it and hold it against its truth."""
    began = time.process_time()
    kind, case = drawn(KINDS, seed, only)
    try:
        result = reconstruct(log_of(case), load_config(case.preset), case.told)
    except FbgraphError as error:
        taken = time.process_time() - began
        return Judged(seed, kind.name, kind.quiet, case.said, WITHHELD, (f"refused: {error}"[:80],), seconds=taken)
    return compared(seed, kind, case, result, began)


def log_of(case: Case) -> SensorLog:
    """The log as the estimators get it; of sensor faults as a reader makes it of a file."""
    if not case.as_file:
        return case.walk.log
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "walk.csv"
        write_m5stickc_csv(case.walk.log, path)
        return read_log(path).log


def compared(seed: int, kind: Kind, case: Case, result: WalkResult, began: float) -> Judged:
    verdict, reasons = verdict_of(result)
    if verdict == WITHHELD:
        taken = time.process_time() - began
        return Judged(seed, kind.name, kind.quiet, case.said, verdict, reasons, seconds=taken)
    smoothed = result.smoothed.trajectory
    assert smoothed.sigma_z_m is not None
    off = errors_m(smoothed, case.walk, result.log.t0_s, absolute=case.told.anchors is not None)
    sigma, exact = (ellipse_sigmas(off[:, :2], smoothed, allowed_m) for allowed_m in (ALLOWED_M, 0.01))
    sigma_z = np.abs(off[:, 2]) / np.hypot(smoothed.sigma_z_m, ALLOWED_Z_M)
    return Judged(
        seed=seed,
        kind=kind.name,
        quiet=kind.quiet,
        said=case.said,
        verdict=verdict,
        reasons=reasons,
        worst_sigma=float(sigma.max()),
        worst_z_sigma=float(sigma_z.max()),
        inside=float((exact <= E95).mean()),
        nearly=float((sigma <= E95).mean()),
        inside_z=float((sigma_z <= 1.96).mean()),
        error_m=float(np.hypot(*off[:, :2].T).max()),
        sigma_m=longest_m(smoothed),
        breadcrumbs=len(smoothed),
        seconds=time.process_time() - began,
    )


def verdict_of(result: WalkResult) -> tuple[str, tuple[str, ...]]:
    return result.integrity.verdict, tuple(reason.kind for reason in result.integrity.reasons)


def errors_m(smoothed: Trajectory, walk: SimulatedWalk, t0_s: float, absolute: bool) -> FloatArray:
    """(K+1, 3) place less truth: in the anchors' frame where there are any, else both from the first breadcrumb on."""
    at_s = smoothed.t_s + t0_s - walk.log.t0_s
    truth = np.column_stack([np.interp(at_s, walk.t_s, axis) for axis in (walk.x_m, walk.y_m, walk.z_m)])
    off = np.column_stack((smoothed.xy_m, smoothed.z_m)) - truth
    return np.asarray(off - (off[0] * (0.0, 0.0, 1.0) if absolute else off[0]))


def ellipse_sigmas(off_m: FloatArray, smoothed: Trajectory, allowed_m: float) -> FloatArray:
    """(K+1,) how many of its own sigma each breadcrumb is off."""
    assert smoothed.cov_xy_yaw is not None
    cov = smoothed.cov_xy_yaw[:, :2, :2] + allowed_m**2 * np.eye(2)
    return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", off_m, np.linalg.inv(cov), off_m)))


def longest_m(smoothed: Trajectory) -> float:
    assert smoothed.longest_sigma_m is not None
    return float(smoothed.longest_sigma_m.max())


def table(walks: Sequence[Judged]) -> str:
    """A line a kind; seeds of what was missed, to run again with ``--only``."""
    lines = [
        "| kind | walks | sound | doubtful | withheld | median, worst σ of the sound | worst σ_z | inside 95 % |"
        " nearly | in z | sound beyond 4σ: seeds | doubtful beyond 4σ: seeds |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in KINDS:
        of_it = [walk for walk in walks if walk.kind == kind.name]
        if of_it:
            name = f"{kind.name} *" if kind.quiet else kind.name
            lines.append(row(name, of_it))
    return "\n".join([*lines, row("all", walks)])


def row(name: str, walks: Sequence[Judged]) -> str:
    sound = [walk for walk in walks if walk.verdict == SOUND]
    counts = [sum(walk.verdict == verdict for walk in walks) for verdict in (SOUND, DOUBTFUL, WITHHELD)]
    cells = [name, len(walks), *counts]
    if sound:
        worst = np.array([walk.worst_sigma for walk in sound])
        cells += [f"{np.median(worst):.1f}, {worst.max():.1f}", f"{max(walk.worst_z_sigma for walk in sound):.1f}"]
        cells += [f"{share(sound, name):.1%}" for name in ("inside", "nearly", "inside_z")]
    else:
        cells += ["", "", "", "", ""]
    for verdict in (SOUND, DOUBTFUL):
        missed = [walk for walk in walks if walk.verdict == verdict and walk.far]
        missed.sort(key=lambda walk: -max(walk.worst_sigma, walk.worst_z_sigma))
        cells.append(f"{len(missed)}: " + " ".join(str(walk.seed) for walk in missed[:8]) if missed else "")
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def share(walks: Sequence[Judged], name: str) -> float:
    """Of all breadcrumbs of these walks."""
    counts = np.array([walk.breadcrumbs for walk in walks])
    return float(np.average([getattr(walk, name) for walk in walks], weights=counts)) if counts.sum() else float("nan")


def part(true: Sequence[bool]) -> float:
    """The share that is true; nan of none."""
    return float(np.mean(true)) if len(true) else float("nan")


def figures(walks: Sequence[Judged]) -> dict[str, float]:
    """What must be shown, as shares."""
    sound, doubtful = ([walk for walk in walks if walk.verdict == verdict] for verdict in (SOUND, DOUBTFUL))
    quiet = [walk for walk in walks if walk.quiet]
    return {
        "walks": len(walks),
        "sound": len(sound),
        "inside": share(sound, "inside"),
        "nearly": share(sound, "nearly"),
        "inside_z": share(sound, "inside_z"),
        "beyond": part([walk.far for walk in sound]),
        "alarms": part([walk.verdict != SOUND for walk in quiet]),
        "doubtful beyond": part([walk.far for walk in doubtful]),
        "seconds": sum(walk.seconds for walk in walks),
    }
