"""What anchors, a closed end and closures contradict."""

from __future__ import annotations

from fbgraph.core.verdict import Reason
from fbgraph.integrity.evidence import Doubt, Evidence

_DOUBTED_SHARE = 0.5


def aids_that_contradict(walk: Evidence) -> list[Doubt]:
    """Anchors and a closed end that the sensors contradict; the smoother has believed them less already."""
    return [Doubt(reason) for reason in walk.smoothed.doubts]


def closures_doubted(walk: Evidence) -> list[Doubt]:
    """A way back of which most closures were let go."""
    closures, doubted = walk.smoothed.closures, walk.smoothed.closures_doubted
    if doubted <= _DOUBTED_SHARE * len(closures):
        return []
    text = f"the way back was tied to the way out at {len(closures)} places, {doubted} of them doubted"
    start_s, end_s = (float(walk.track.t_s[k]) for k in (closures[0].j, closures[-1].j))
    advice = "look at both passes in the recording; --no-out-and-back leaves closures out"
    return [Doubt(Reason("closure", 1.0 + doubted / len(closures), text, advice, start_s, end_s))]
