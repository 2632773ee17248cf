"""Step length coefficients from legs that were made with known ones."""

import dataclasses

import numpy as np
import pytest

from fbgraph.calibration.legs import Legs
from fbgraph.calibration.wearer import WearerFit, fit_wearer
from fbgraph.core.config import StepLengthConfig, load_config
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.length_fit import TERMS, coefficients

PHONE = load_config("phone").step_length
PAPER = load_config("m5stickc").step_length
PLACE_M = 0.3


def made(
    config: StepLengthConfig,
    theta: FloatArray,
    seed: int,
    legs: int = 10,
    steps: int = 15,
    spread_hz: float = 0.0,
    slopes: bool = False,
    scale: float = 1.0,
    name: str = "",
) -> Legs:
    """Legs at paces of their own, between places known to ``PLACE_M``; ``scale`` is what all of this walk share."""
    rng = np.random.default_rng(seed)
    f = 1.75 + spread_hz * rng.uniform(-1.0, 1.0, legs)
    root = np.sqrt(0.15 + spread_hz * rng.uniform(-0.1, 0.05, legs))
    slope = np.where(np.arange(legs) % 3 == 0, rng.uniform(0.0, 0.3, legs), 0.0) if slopes else np.zeros(legs)
    sums = steps * np.column_stack((np.ones(legs), f, f**2, slope, root))
    noise_m2 = steps * (0.08 * 0.65) ** 2 + 2.0 * PLACE_M**2
    length_m = scale * (sums @ theta) + np.sqrt(noise_m2) * rng.normal(size=legs)
    steps_of = np.full(legs, float(steps))
    spans = tuple(f"leg {k}" for k in range(legs))
    each = np.repeat(f, steps), np.repeat(root**2, steps)
    return Legs(name or f"walk {seed}", sums, length_m, noise_m2 * np.eye(legs), steps_of, *each, spans)


def one_length(theta: FloatArray, count: int, length_m: float) -> Legs:
    terms = np.tile((1.0, 1.8, 1.8**2, 0.0, 0.4), (count, 1))
    each = np.full(count, 1.8), np.full(count, 0.16)
    return Legs(
        "one", terms.sum(axis=0)[None], np.array([length_m]), np.array([[0.6]]), np.array([count]), *each, ("",)
    )


def by_key(fit: WearerFit) -> dict[str, float]:
    return {one.key: one.value for one in fit.coefficients}


def test_the_papers_coefficients_are_recovered_within_their_intervals() -> None:
    inside = np.zeros(3)
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        theta = coefficients(PAPER) + np.array([0.0, rng.normal(0, 0.1), 0.0, rng.normal(0, 0.5), 0.0])
        theta[0] += 0.05 - 1.75 * (theta[1] - PAPER.beta_m_s)
        walks = [made(PAPER, theta, 10 * seed + k, legs=25, spread_hz=0.5, slopes=True) for k in range(4)]
        fit = fit_wearer(walks, PAPER)
        assert {one.key for one in fit.coefficients if one.fitted} == {"alpha_m", "beta_m_s", "gamma_m"}
        told = [one for one in fit.coefficients if one.fitted]
        true = [theta[TERMS.index(one.key)] for one in told]
        inside += [one.low <= value <= one.high for one, value in zip(told, true, strict=True)]
        assert by_key(fit)["kappa_surge"] == by_key(fit)["beta2_m_s2"] == 0.0
    assert (inside >= 17).all()  # 19 of 20 at 95 %


def test_one_distance_tells_the_scale_and_nothing_else() -> None:
    theta = coefficients(PHONE)
    each_m = float(np.array([1.0, 1.8, 1.8**2, 0.0, 0.4]) @ theta)
    fit = fit_wearer([one_length(theta, 200, 1.15 * 200 * each_m)], PHONE)
    assert not any(one.fitted for one in fit.coefficients)
    assert fit.scale == pytest.approx(1.15, abs=0.01)
    assert fit.scale_sigma < 0.05
    assert abs(fit.scale - 1.15) < 1.96 * fit.scale_sigma
    for one in fit.coefficients:
        assert one.value == pytest.approx(fit.scale * one.shipped)
    assert fit.cross_validation is None
    assert fit.constant_m == pytest.approx(1.15 * each_m)


def test_a_known_prior_and_errors_are_weighed_as_on_paper() -> None:
    theta = coefficients(PHONE)
    each_m = float(np.array([1.0, 1.8, 1.8**2, 0.0, 0.4]) @ theta)
    by_model_m = 50 * each_m
    fit = fit_wearer([one_length(theta, 50, 1.1 * by_model_m)], PHONE)
    variance = (0.6 + (0.03 * by_model_m) ** 2) / by_model_m**2  # 0.03: what all steps of a walk share
    told = 1.0 / (1.0 / variance + 1.0 / 0.15**2)
    assert fit.scale_sigma == pytest.approx(told**0.5)
    assert fit.scale - 1.0 == pytest.approx(0.1 * told / variance)


def test_what_all_steps_of_a_walk_share_is_not_taken_for_certainty() -> None:
    theta = coefficients(PHONE)
    scales = [0.93, 0.95, 0.96, 0.98, 0.99, 1.0, 1.01, 1.02, 1.03, 1.05, 1.06, 1.08]
    walks = [made(PHONE, theta, k, legs=30, scale=scale) for k, scale in enumerate(scales)]
    fit = fit_wearer(walks, PHONE)
    assert fit.spread_rel == pytest.approx(np.std(scales), rel=0.2)
    assert fit.scale_sigma == pytest.approx(np.std(scales) / 12**0.5, rel=0.3)
    assert abs(fit.scale - np.mean(scales)) < 2.0 * fit.scale_sigma
    assert fit.cross_validation is not None
    assert (fit.cross_validation.left_out, fit.cross_validation.count) == ("walk", 12)
    assert fit.cross_validation.fitted_rel == pytest.approx(np.std(scales), rel=0.35)
    assert not fit.better
    assert fit.applied(load_config("phone")) == load_config("phone")  # what is no better is not used


def test_no_wearer_is_surer_than_their_walks_are_alike() -> None:
    theta = 1.15 * coefficients(PHONE)
    scales = [0.93, 0.95, 0.96, 0.98, 0.99, 1.0, 1.01, 1.02, 1.03, 1.05, 1.06, 1.08]
    fit = fit_wearer([made(PHONE, theta, k, legs=30, scale=scale) for k, scale in enumerate(scales)], PHONE)
    applied = fit.applied(load_config("phone"))
    assert fit.cross_validation is not None
    assert applied.graph.sigma_length_scale == pytest.approx(fit.cross_validation.fitted_rel, abs=1e-4)
    assert applied.step_length.calibrated_hz == (1.7, 1.8)
    alike = fit_wearer([made(PHONE, theta, k, legs=30) for k in range(12)], PHONE)
    assert alike.applied(load_config("phone")).graph.sigma_length_scale == 0.035  # on another day


def test_a_single_walk_is_checked_leg_by_leg() -> None:
    fit = fit_wearer([made(PHONE, 1.2 * coefficients(PHONE), 1, legs=12)], PHONE)
    checked = fit.cross_validation
    assert checked is not None
    assert (checked.left_out, checked.count) == ("leg", 12)
    assert checked.shipped_rel > 0.12
    assert checked.fitted_rel < 0.07
    assert fit.applied(load_config("phone")).graph.sigma_length_scale == pytest.approx(
        float(np.hypot(fit.scale_sigma, 0.03)), abs=1e-4
    )


def test_walks_and_legs_unlike_all_others_are_left_out_and_named() -> None:
    theta = coefficients(PHONE)
    walks = [made(PHONE, theta, k) for k in range(8)]
    clean = fit_wearer(walks, PHONE)
    wrong_m = walks[2].length_m.copy()
    wrong_m[4] *= 1.5
    walks[2] = dataclasses.replace(walks[2], length_m=wrong_m)
    walks[5] = made(PHONE, theta, 5, scale=1.4, name="the other one's")
    fit = fit_wearer(walks, PHONE)
    assert fit.walks == 7
    assert fit.legs == 69
    assert any(text.startswith("the other one's: its steps come to") for text in fit.left_out)
    assert any(text.startswith("walk 2, leg 4: its steps come to") for text in fit.left_out)
    assert abs(fit.scale - clean.scale) < 0.01


def test_lengths_that_cannot_be_are_refused() -> None:
    theta = coefficients(PHONE)
    with pytest.raises(DataError, match="12 steps between known places"):
        fit_wearer([made(PHONE, theta, 0, legs=2, steps=6)], PHONE)
    with pytest.raises(DataError, match=r"walk 0: .* m each, where they seem .*check the distance and its unit"):
        fit_wearer([made(PHONE, 3.28 * theta, 0)], PHONE)
    unsure = made(PHONE, theta, 0, legs=2)
    with pytest.raises(DataError, match="walk further"):
        fit_wearer([dataclasses.replace(unsure, cov_m2=16.0 * np.eye(2))], PHONE)
    none = dataclasses.replace(unsure.select(np.zeros(2, dtype=np.bool_)), left_out=("3 to 5 s: a gap",))
    with pytest.raises(DataError, match=r"0 steps between known places.*left out: walk 0, 3 to 5 s: a gap"):
        fit_wearer([none], PHONE)
