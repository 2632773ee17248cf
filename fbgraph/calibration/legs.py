"""Legs: stretches of a walk whose length is known, and what the steps on them add up to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.config import StepLengthConfig
from fbgraph.core.geometry import BoolArray, FloatArray, wrap_scalar
from fbgraph.front_end.length_fit import TERMS, coefficients, step_shares, step_terms
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.metrics import leg_ends

_LEG_M = 4.0  # from one place to the next that ends a leg, at least; a receiver's fixes must be further apart
_LEAST_STEPS = 4.0
_STRAIGHT = 0.7  # a leg whose ends are less of its path apart tells little of its length
_PLACE_M = 0.3  # of a place that tells no sigma
_STEP_REL = 0.08  # of a step about the model
_DISTANCE_REL, _DISTANCE_M = 0.005, 0.5  # of a distance that somebody paced off: the tape, and where it begins and ends


@dataclass(frozen=True)
class Legs:
    """Legs of one walk.

    Attributes:
        name: of the walk.
        sums: (S, 5) what the steps of each leg add up to along it, as ``length_fit.step_terms``: times the coefficients
            it is the length.
        length_m: (S,) known.
        cov_m2: (S, S) of the lengths' errors, places and single steps; not what all steps of the walk share.
        steps: (S,) how many there are on each.
        frequency_hz, surge_m_s: of every step on a leg.
        spans: when each leg was walked, for messages.
        left_out: legs that were not used, and why.
    """

    name: str
    sums: FloatArray
    length_m: FloatArray
    cov_m2: FloatArray
    steps: FloatArray
    frequency_hz: FloatArray
    surge_m_s: FloatArray
    spans: tuple[str, ...]
    left_out: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.length_m)

    def select(self, which: BoolArray) -> Legs:
        """Some of the legs; steps are not told apart by leg, those of all are kept."""
        spans = tuple(span for span, kept in zip(self.spans, which.tolist(), strict=True) if kept)
        columns = {name: getattr(self, name)[which] for name in ("sums", "length_m", "steps")}
        return replace(self, cov_m2=self.cov_m2[np.ix_(which, which)], spans=spans, **columns)

    @property
    def walked_m(self) -> float:
        """Length of all of them."""
        return float(self.length_m.sum())


@dataclass(frozen=True)
class _Leg:
    """One leg: what its steps add up to, how long it is, the variance of that, how many steps; when."""

    sums: FloatArray
    length_m: float
    variance_m2: float
    steps: float
    span: str


def legs_between(
    name: str, track: StepTrack, yaw_rad: FloatArray, places: Checkpoints, config: StepLengthConfig
) -> Legs:
    """Legs from each known place to the next that is far enough away.

    A leg is as long as its ends are apart. Its steps count by how far they go that way, so that a path that bends is
    no error; a heading error that all of a leg's steps share is none either.

    Args:
        name: of the walk.
        track: K steps.
        yaw_rad: (K+1,) in which direction each went.
        places: on the track's clock.
        config: with which the steps were measured.
    """
    terms = step_terms(track, config)
    lengths = terms @ coefficients(config)
    ahead = np.exp(1j * yaw_rad[1:])
    legs: list[_Leg] = []
    edges: list[tuple[int, int, float]] = []
    left_out: list[str] = []
    used = np.zeros(len(terms), dtype=np.bool_)
    for first, last in pairwise(leg_ends(places, None if places.gnss else _LEG_M)):
        share = step_shares(track, float(places.t_s[first]), float(places.t_s[last]))
        span = f"{places.t_s[first]:.0f} to {places.t_s[last]:.0f} s"
        way = complex((share * lengths * ahead).sum())
        if float(share.sum()) < _LEAST_STEPS:
            left_out.append(f"{span}: fewer than {_LEAST_STEPS:.0f} steps")
        elif (track.chained[1:][share > 0.0] == 0).any():
            left_out.append(f"{span}: a gap of the log in it")
        elif abs(way) < _STRAIGHT * float((share * lengths).sum()):
            left_out.append(f"{span}: its path is much longer than its ends are apart")
        else:
            along = share * np.real(ahead * np.conj(way)) / abs(way)
            apart_m = float(np.hypot(*(places.xy_m[last] - places.xy_m[first])))
            own_m2 = float(((_STEP_REL * along * lengths) ** 2 + (share * track.doubt_m[1:]) ** 2).sum())
            legs.append(_Leg(along @ terms, apart_m, own_m2, float(share.sum()), span))
            edges.append((first, last, float(np.angle(way))))
            used |= share > 0.0
    cov_m2 = _with_places(np.array([leg.variance_m2 for leg in legs]), edges, places)
    return _legs(name, legs, cov_m2, track, used, left_out)


def leg_of_distance(name: str, track: StepTrack, distance_m: float, config: StepLengthConfig) -> Legs:
    """A whole walk as one leg, along its path, from the first step to the last."""
    terms = step_terms(track, config)
    own_m2 = float(((_STEP_REL * track.length_m[1:]) ** 2 + track.doubt_m[1:] ** 2).sum())
    variance_m2 = own_m2 + (_DISTANCE_REL * distance_m) ** 2 + _DISTANCE_M**2
    leg = _Leg(terms.sum(axis=0), distance_m, variance_m2, float(terms[:, 0].sum()), "all of it")
    return _legs(name, [leg], np.array([[variance_m2]]), track, np.ones(len(terms), dtype=np.bool_), [])


def _legs(
    name: str, legs: Sequence[_Leg], cov_m2: FloatArray, track: StepTrack, used: BoolArray, left_out: Sequence[str]
) -> Legs:
    return Legs(
        name=name,
        sums=np.array([leg.sums for leg in legs]).reshape(-1, len(TERMS)),
        length_m=np.array([leg.length_m for leg in legs]),
        cov_m2=cov_m2,
        steps=np.array([leg.steps for leg in legs]),
        frequency_hz=track.frequency_hz[1:][used],
        surge_m_s=track.surge_m_s[1:][used],
        spans=tuple(leg.span for leg in legs),
        left_out=tuple(left_out),
    )


def _with_places(own_m2: FloatArray, edges: Sequence[tuple[int, int, float]], places: Checkpoints) -> FloatArray:
    """(S, S) covariance of lengths: their own, and that of the places; a place between two legs is in both."""
    sigma_m = np.nan_to_num(places.sigma_m, nan=_PLACE_M)
    cov = np.diag(own_m2) if len(own_m2) else np.empty((0, 0))
    for i, (first, last, yaw_rad) in enumerate(edges):
        cov[i, i] += sigma_m[first] ** 2 + sigma_m[last] ** 2
        if i and edges[i - 1][1] == first:  # what makes one longer makes the next shorter
            shared = -float(np.cos(wrap_scalar(yaw_rad - edges[i - 1][2]))) * float(sigma_m[first]) ** 2
            cov[i, i - 1] = cov[i - 1, i] = shared
    return np.asarray(cov)
