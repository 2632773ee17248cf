"""What anchors, a closed end, closures and the building contradict."""

from __future__ import annotations

import numpy as np

from fbgraph.core.verdict import Reason
from fbgraph.integrity.evidence import Doubt, Evidence, turned_m

_DOUBTED_SHARE = 0.5
_FEW = 20  # steps with a compass; of fewer nothing is said
_FIELD_SIGMAS = 4.0
_FIELD_UT, _FIELD_DEG = 12.0, 12.0  # walks in one building differ by 9 µT and 12° where its walks tell of little
_HEADING_RAD = 0.1  # one sigma, just beyond


def aids_that_contradict(walk: Evidence) -> list[Doubt]:
    """Anchors, a closed end and an axis that the sensors contradict; the smoother has believed them less already."""
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


def field_unlike_the_building(walk: Evidence) -> list[Doubt]:
    """A magnetic field that is not what walks in this building see."""
    usual = None if walk.aids.axis is None else walk.aids.axis.field
    strength_ut, dip_rad = walk.track.mag_norm_ut, walk.track.mag_dip_rad
    known = np.isfinite(strength_ut) & np.isfinite(dip_rad)
    if usual is None or known.sum() < _FEW:
        return []
    here_ut, here_deg = float(np.median(strength_ut[known])), float(np.degrees(np.median(dip_rad[known])))
    weight = max(
        abs(here_ut - usual.strength_ut) / max(_FIELD_SIGMAS * usual.sigma_strength_ut, _FIELD_UT),
        abs(here_deg - usual.dip_deg) / max(_FIELD_SIGMAS * usual.sigma_dip_deg, _FIELD_DEG),
    )
    if weight <= 1.0:
        return []
    text = (
        f"the magnetic field is {here_ut:.0f} µT strong and dips by {here_deg:.0f}°, in this building usually "
        f"{usual.strength_ut:.0f} µT and {usual.dip_deg:.0f}°"
    )
    advice = "the magnetometer needs calibrating, iron went with it, or it was another building"
    return [Doubt(Reason("magnetometer", weight, text, advice), turned_m(walk.track, _HEADING_RAD * weight))]
