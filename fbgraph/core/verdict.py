"""How far a run may be believed: a verdict and its reasons. Plain records, made by ``fbgraph.integrity``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

Verdict = Literal["sound", "doubtful", "withheld"]


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a run is doubted.

    Attributes:
        kind: what is doubted: a sensor, a kind of factor, the steps, the solver.
        weight: how many times beyond what undisturbed walks show; 1 is just beyond. The heaviest is told first.
        text: what was found, in one sentence without a full stop.
        advice: what to do next, the same.
        start_s, end_s: where, seconds since log start; None if it concerns the whole walk.
    """

    kind: str
    weight: float
    text: str
    advice: str
    start_s: float | None = None
    end_s: float | None = None

    @property
    def sentence(self) -> str:
        """What was found and what to do."""
        return f"{self.text}: {self.advice}"


@dataclass(frozen=True)
class Integrity:
    """What a run's own check says of it.

    Attributes:
        verdict: ``sound``, nothing contradicts it; ``doubtful``, its sigma is widened to what was found; ``withheld``,
            it is worth nothing, and no smoothed trajectory is written.
        reasons: the weightiest first; none if it is sound.
        widened: by what the longest sigma at the end of the walk was multiplied.
    """

    verdict: Verdict = "sound"
    reasons: tuple[Reason, ...] = ()
    widened: float = 1.0

    def as_dict(self) -> dict[str, Any]:
        """For ``summary.json``."""
        return {
            "verdict": self.verdict,
            "widened": round(self.widened, 3),
            "reasons": [{**asdict(one), "weight": round(one.weight, 3)} for one in self.reasons],
        }

    @staticmethod
    def from_dict(noted: Mapping[str, Any] | None) -> Integrity:
        """What ``as_dict`` gave, checked before (``run.summary_model``); nothing is known against a run without it."""
        if not noted:
            return Integrity()
        names = Reason.__slots__
        reasons = tuple(Reason(**{name: one.get(name) for name in names}) for one in noted["reasons"])
        return Integrity(noted["verdict"], reasons, noted["widened"])


MOST_TOLD = 3
"""Reasons told on a terminal; all of them are in ``summary.json``."""


def caution(integrity: Integrity, what: str) -> tuple[str, ...]:
    """What to know before relying on ``what``, in a sentence each; nothing where the run is sound."""
    if integrity.verdict == "sound":
        return ()
    reasons = (f"{reason.sentence}." for reason in integrity.reasons[:MOST_TOLD])
    return (f"Do not rely on this {what}: its position is {integrity.verdict}.", *reasons)


def verdict_lines(integrity: Integrity) -> list[str]:
    """The verdict in a line, and up to ``MOST_TOLD`` reasons in a line each."""
    if integrity.verdict == "sound":
        return ["sound: nothing in the log contradicts this walk"]
    told = {
        "doubtful": "doubtful: something in the log contradicts this walk",
        "withheld": "withheld: this is no walk to go by",
    }[integrity.verdict]
    if integrity.verdict == "doubtful" and integrity.widened >= 1.05:
        told += f"; its uncertainty is widened {integrity.widened:.1f} times"
    lines = [told, *(one.sentence for one in integrity.reasons[:MOST_TOLD])]
    more = len(integrity.reasons) - MOST_TOLD
    return [*lines, f"and {more} more, in summary.json"] if more > 0 else lines
