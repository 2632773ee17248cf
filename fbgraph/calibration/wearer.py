"""A wearer's step length: coefficients fitted to legs of known length, drawn towards those that are shipped.

    L = s L₀(step) + Σ δ_i (x_i - x̄_i)

L₀ is the configured model, s how much longer this wearer's steps are, and δ_i what is different about the coefficient
of term x_i (cadence, its square, slope, surge), about the mean x̄ of the steps at hand: so a single distance tells s and
nothing else, and what legs of one pace cannot tell stays as it was. s and δ are found by least squares with a prior
(``front_end.length_fit``), s = 1 ± 0.15, δ = 0 ± ``_PRIOR``; a δ that the legs do not tell is left at nothing. Errors
of legs are those of their places and single steps, and one that all steps of a walk share. Walks and legs that
contradict all others are left out, and named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fbgraph.calibration.legs import Legs
from fbgraph.core.config import Config, StepLengthConfig
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import BoolArray, FloatArray
from fbgraph.front_end.length_fit import TERMS, coefficients, least_squares

_SCALE_PRIOR = 0.15
_PRIOR = {"beta_m_s": 0.1, "beta2_m_s2": 0.03, "gamma_m": 0.5, "kappa_surge": 0.2}
_TOLD = 0.7  # of the prior's sigma; what is told no better is kept
_SPREAD = 0.03  # a wearer's steps from one walk to the next, until three walks show it
_LEAST_SPREAD = 0.015
_LEAST_STEPS = 20
_SCALES = (0.6, 1.6)  # beyond, the distances are not those of these steps
_UNTOLD = 0.1  # a scale that is told no better is none
_OUTLYING, _MOST_OUTLYING = 3.0, 0.3  # sigmas of a leg that is left out, and the share of a walk's that may be
_ROUNDS = 3
_LEAST_WALKS, _LEAST_WALKS_TO_DOUBT = 3, 5
_UNLIKE = 0.05  # from walk to walk, beyond which one that is alone with it is doubted, by as many sigmas
_LEAST_LEGS = 4  # to leave one out
_BETTER = {"walk": 0.8, "leg": 0.95}  # of the error as shipped, on what was left out; else nothing is changed
_LEAST_SURE = 0.035  # of a wearer's scale on another day
_EDGE_PERCENT, _EDGE_HZ, _EDGE_M_S = 1.0, 0.05, 0.02  # of the steps at hand; what lies beyond is outside


@dataclass(frozen=True)
class Coefficient:
    """One coefficient of the step length.

    Attributes:
        key: of ``StepLengthConfig``.
        value, low, high: with its 95 % interval.
        shipped: as configured before.
        fitted: whether the legs tell it; else it was kept, in proportion to the others.
    """

    key: str
    value: float
    low: float
    high: float
    shipped: float
    fitted: bool


@dataclass(frozen=True)
class CrossValidation:
    """How far off the lengths of what was left out are, RMS, relative.

    Attributes:
        left_out: ``walk`` or ``leg``, one at a time.
        count: how many there are.
        shipped_rel, fitted_rel: by the coefficients as configured, and by those fitted to the others.
    """

    left_out: str
    count: int
    shipped_rel: float
    fitted_rel: float


@dataclass(frozen=True)
class WearerFit:
    """A wearer's step length.

    Attributes:
        coefficients: in the order of ``TERMS``; those that the configured model lacks stay 0.
        scale, scale_sigma: how much longer this wearer's steps are, and how well that is known.
        spread_rel: standard deviation of that from one walk to the next.
        constant_m: mean step length, L0 of the baseline.
        walks, legs, steps, walked_m: what it was fitted to.
        hz, surge_m_s: the lowest and highest of the steps it was fitted to.
        cross_validation: None where nothing can be left out.
        left_out: legs that were not used, and why.
    """

    coefficients: tuple[Coefficient, ...]
    scale: float
    scale_sigma: float
    spread_rel: float
    constant_m: float
    walks: int
    legs: int
    steps: int
    walked_m: float
    hz: tuple[float, float]
    surge_m_s: tuple[float, float]
    cross_validation: CrossValidation | None
    left_out: tuple[str, ...]

    @property
    def better(self) -> bool:
        """Whether it does clearly better than the step length as it was, on what was left out; else it is not used.

        Walks that were left out must come out a fifth closer: less is chance with the few that people have. Legs, which
        have errors of their own, a twentieth.
        """
        checked = self.cross_validation
        return checked is None or checked.fitted_rel < _BETTER[checked.left_out] * checked.shipped_rel

    def applied(self, config: Config) -> Config:
        """The configuration with this step length if it is better, and with what is still unsure about it."""
        if not self.better:
            return config
        values = {one.key: round(one.value, 5) for one in self.coefficients}
        sure = max(float(np.hypot(self.scale_sigma, self.spread_rel)), _LEAST_SURE)
        if (checked := self.cross_validation) is not None and checked.left_out == "walk":
            sure = max(sure, checked.fitted_rel)
        length = values | {
            "constant_m": round(self.constant_m, 4),
            "calibrated_hz": tuple(round(f, 2) for f in self.hz),
            "calibrated_surge_m_s": tuple(round(v, 3) for v in self.surge_m_s),
        }
        graph = {"sigma_length_scale": min(round(sure, 4), config.graph.sigma_length_scale)}
        return config.model_copy(
            update={
                "step_length": config.step_length.model_copy(update=length),
                "graph": config.graph.model_copy(update=graph),
            }
        )


def fit_wearer(walks: Sequence[Legs], config: StepLengthConfig) -> WearerFit:
    """Fit the coefficients to legs of walks of one wearer.

    Args:
        walks: with at least one leg together.
        config: where fitting starts and what it is drawn to; terms whose coefficient is 0 there stay so.

    Raises:
        DataError: too few steps, or distances that cannot be theirs.
    """
    known = _enough(walks, config)
    solution, used, left_out = _fitted(known, config)
    if solution.scale_sigma > _UNTOLD:
        raise DataError(
            f"{_metres(sum(walk.walked_m for walk in used))} of known length tell the steps' to "
            f"{100.0 * solution.scale_sigma:.0f} % only: walk further between the places, 50 m are enough"
        )
    half = 1.96 * np.sqrt(np.maximum(np.diag(solution.cov), 0.0))
    rows = zip(TERMS, solution.theta.tolist(), half.tolist(), coefficients(config).tolist(), strict=True)
    hz, surge = (np.concatenate([getattr(walk, name) for walk in used]) for name in ("frequency_hz", "surge_m_s"))
    steps, walked_m = sum(float(walk.steps.sum()) for walk in used), sum(walk.walked_m for walk in used)
    dropped = [f"{walk.name}, {text}" for walk in walks for text in walk.left_out]
    return WearerFit(
        coefficients=tuple(
            Coefficient(key, v, v - h, v + h, was, _is_told(key, solution.told)) for key, v, h, was in rows
        ),
        scale=solution.scale,
        scale_sigma=solution.scale_sigma,
        spread_rel=solution.spread_rel,
        constant_m=walked_m / steps,
        walks=len(used),
        legs=sum(len(walk) for walk in used),
        steps=round(steps),
        walked_m=walked_m,
        hz=_range(hz, _EDGE_HZ),
        surge_m_s=_range(surge, _EDGE_M_S),
        cross_validation=_cross_validated(used, config),
        left_out=(*dropped, *left_out),
    )


def _is_told(key: str, told: Sequence[str]) -> bool:
    """Whether the legs tell a coefficient; the constant follows from the scale and any other that they tell."""
    return key in told or (key == "alpha_m" and len(told) > 0)


def _enough(walks: Sequence[Legs], config: StepLengthConfig) -> list[Legs]:
    """The walks that have legs.

    Raises:
        DataError: there are too few steps on them, or distances that cannot be theirs.
    """
    known = [walk for walk in walks if len(walk)]
    steps = sum(float(walk.steps.sum()) for walk in known)
    if steps < _LEAST_STEPS:
        dropped = [f"{walk.name}, {text}" for walk in walks for text in walk.left_out]
        why = f"; left out: {'; '.join(dropped[:3])}" if dropped else ""
        raise DataError(
            f"{steps:.0f} steps between known places: a step length takes {_LEAST_STEPS} at least, and 100 to be of "
            f"use{why}"
        )
    for walk in known:
        each_m = walk.walked_m / float(walk.steps.sum())
        by_model_m = float((walk.sums @ coefficients(config)).sum())
        if not _SCALES[0] < walk.walked_m / by_model_m < _SCALES[1]:
            raise DataError(
                f"{walk.name}: {_metres(walk.walked_m)} in {walk.steps.sum():.0f} steps is {each_m:.2f} m each, where "
                f"they seem {by_model_m / float(walk.steps.sum()):.2f} m long: check the distance and its unit, and "
                "whether all of it was walked in this log"
            )
    return known


def _metres(length_m: float) -> str:
    return f"{length_m:.0f} m"


@dataclass(frozen=True)
class _Solution:
    """Coefficients (5,) with their covariance, scale and spread, and which terms the legs told."""

    theta: FloatArray
    cov: FloatArray
    scale: float
    scale_sigma: float
    spread_rel: float
    told: tuple[str, ...]


def _fitted(walks: Sequence[Legs], config: StepLengthConfig) -> tuple[_Solution, list[Legs], list[str]]:
    """The solution, the walks without the legs that contradict it, and what these are."""
    used, left_out = list(walks), []
    solution = _solved(used, config, _SPREAD)
    for _ in range(_ROUNDS):
        spread_rel, outlying = _between_walks(used, solution)
        for walk in (walk for walk, out in zip(used, outlying.tolist(), strict=True) if out):
            by = f"{100.0 * (float((walk.sums @ solution.theta).sum()) / walk.walked_m - 1.0):+.0f} %"
            left_out.append(f"{walk.name}: its steps come to {by} of the distance, unlike those of the other walks")
        kept = [walk for walk, out in zip(used, outlying.tolist(), strict=True) if not out]
        solution = _solved(kept, config, spread_rel)
        for k, walk in enumerate(kept):
            off_m = walk.sums @ solution.theta - walk.length_m
            sigma_m = np.sqrt(np.diag(walk.cov_m2) + (spread_rel * walk.length_m) ** 2)
            out = np.abs(off_m) > _OUTLYING * sigma_m
            if len(walk) < _LEAST_LEGS or out.mean() > _MOST_OUTLYING:
                continue
            for leg in np.flatnonzero(out).tolist():
                by = f"{100.0 * off_m[leg] / walk.length_m[leg]:+.0f} %"
                left_out.append(f"{walk.name}, {walk.spans[leg]}: its steps come to {by} of its length")
            kept[k] = walk.select(~out)
        done = sum(map(len, kept)) == sum(map(len, used))
        used = kept
        if done:
            break
    return _solved(used, config, spread_rel), used, left_out


def _solved(walks: Sequence[Legs], config: StepLengthConfig, spread_rel: float) -> _Solution:
    """First with every term that the model has, then with those that the legs tell."""
    possible = tuple(key for key in _PRIOR if getattr(config, key) != 0.0)
    _, sigma = _solved_with(walks, config, spread_rel, possible)
    told = tuple(key for key, one in zip(possible, sigma.tolist(), strict=True) if one < _TOLD * _PRIOR[key])
    return _solved_with(walks, config, spread_rel, told)[0]


def _solved_with(
    walks: Sequence[Legs], config: StepLengthConfig, spread_rel: float, terms: tuple[str, ...]
) -> tuple[_Solution, FloatArray]:
    """Scale and these terms; and the standard deviations of the latter."""
    sums = np.concatenate([walk.sums for walk in walks])
    mean = sums.sum(axis=0) / sums[:, 0].sum()
    to_theta = np.zeros((len(TERMS), 1 + len(terms)))
    to_theta[:, 0] = coefficients(config)
    for column, key in enumerate(terms, 1):
        to_theta[TERMS.index(key), column] = 1.0
        to_theta[0, column] = -mean[TERMS.index(key)]
    whitened = [_whitened(walk, spread_rel * (walk.sums @ coefficients(config))) for walk in walks]
    rows = np.concatenate([one for one, _ in whitened]) @ to_theta
    lengths = np.concatenate([one for _, one in whitened])
    prior = np.array([_SCALE_PRIOR, *(_PRIOR[key] for key in terms)])
    found, cov = least_squares(rows, lengths, np.eye(len(prior))[0], np.diag(1.0 / prior))
    free = len(lengths) - len(prior)
    if free >= _LEAST_LEGS:  # errors larger than thought (Birge, Phys. Rev. 40, 1932)
        cov = cov * max(1.0, float(((rows @ found - lengths) ** 2).sum()) / free)
    sigma = np.sqrt(np.diag(cov))
    solution = _Solution(
        to_theta @ found, to_theta @ cov @ to_theta.T, float(found[0]), float(sigma[0]), spread_rel, terms
    )
    return solution, sigma[1:]


def _whitened(walk: Legs, shared_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows and lengths of a walk, with errors of one that are independent; ``shared_m`` (S,) is an error of all."""
    root = np.linalg.cholesky(walk.cov_m2 + np.outer(shared_m, shared_m))
    both = np.linalg.solve(root, np.column_stack((walk.sums, walk.length_m)))
    return both[:, :-1], both[:, -1]


def _between_walks(walks: Sequence[Legs], solution: _Solution) -> tuple[float, BoolArray]:
    """How much the scale varies from walk to walk beyond what their legs' own errors make, and which are outlying."""
    none = np.zeros(len(walks), dtype=np.bool_)
    if len(walks) < _LEAST_WALKS:
        return _SPREAD, none
    rows = []
    for walk in walks:
        by_model_m = walk.sums @ solution.theta
        weighted = np.linalg.solve(walk.cov_m2, by_model_m)
        variance = 1.0 / float(weighted @ by_model_m)
        rows.append((float(weighted @ (walk.length_m - by_model_m)) * variance, variance))
    off, variances = np.array(rows).T
    middle = float(np.median(off))
    outlying = none
    if len(walks) >= _LEAST_WALKS_TO_DOUBT:
        outlying = np.abs(off - middle) > _OUTLYING * np.sqrt(_UNLIKE**2 + variances)
    excess = float(np.square(off[~outlying]).mean() - variances[~outlying].mean())
    return float(np.sqrt(max(excess, _LEAST_SPREAD**2))), outlying


def _cross_validated(walks: Sequence[Legs], config: StepLengthConfig) -> CrossValidation | None:
    """Leave one walk out, or of a single walk one leg."""
    by_walk = len(walks) > 1
    if not by_walk and len(walks[0]) < _LEAST_LEGS:
        return None
    if by_walk:
        parts = [([other for other in walks if other is not walk], walk) for walk in walks]
    else:
        one = np.arange(len(walks[0]))
        parts = [([walks[0].select(one != k)], walks[0].select(one == k)) for k in one.tolist()]
    off: list[tuple[float, float]] = []
    for others, left in parts:
        thetas = coefficients(config), _fitted(others, config)[0].theta
        shipped, fitted = (float((left.sums @ theta).sum()) / left.walked_m - 1.0 for theta in thetas)
        off.append((shipped, fitted))
    shipped, fitted = np.sqrt(np.square(off).mean(axis=0)).tolist()
    return CrossValidation("walk" if by_walk else "leg", len(parts), shipped, fitted)


def _range(values: FloatArray, margin: float) -> tuple[float, float]:
    """Lowest and highest, but for one per cent of the steps and with a margin."""
    low, high = np.percentile(values, (_EDGE_PERCENT, 100.0 - _EDGE_PERCENT)).tolist()
    return max(low - margin, 0.0), high + margin
