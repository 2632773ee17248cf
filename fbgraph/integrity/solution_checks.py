"""The solver's own account: whether it came to an end."""

from __future__ import annotations

from fbgraph.core.verdict import Reason
from fbgraph.integrity.evidence import Doubt, Evidence


def solver_failed(walk: Evidence) -> list[Doubt]:
    """The smoother gave no answer."""
    if "smoothed" not in walk.failed:
        return []
    text = f"the smoother gave no answer ({walk.failed['smoothed']})"
    return [Doubt(Reason("solver", 10.0, text, "the EKF's walk is there to look at"), withhold=True)]


def solver_at_its_limit(walk: Evidence) -> list[Doubt]:
    """The solver was stopped before it found the best answer."""
    done = walk.smoothed.iterations
    if done < walk.config.solver.max_iterations:
        return []
    text = f"the solver was stopped at its limit of {done} iterations, before it had found the best answer"
    advice = "what it was told contradicts itself; look at the recording's residuals, or raise solver.max_iterations"
    return [Doubt(Reason("solver", 1.0, text, advice))]
