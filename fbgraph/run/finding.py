"""Finding: a stretch of a walk that deserves a look."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """A stretch of a walk that deserves a look; ``start_s``, ``end_s`` since log start."""

    kind: str
    start_s: float
    end_s: float
    text: str
