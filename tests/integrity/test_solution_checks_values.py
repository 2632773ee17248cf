"""Residuals beyond their sigmas, and a smoother that leaves both others behind."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.by_hand import way_along
from support.results_by_hand import hand_result, with_cov

from fbgraph.core.config import Config
from fbgraph.estimators.estimates import Residuals
from fbgraph.integrity.solution_checks import LIMITS, factors_beyond_their_sigmas, smoother_against_others
from fbgraph.run.walk_result import WalkResult

WAY = with_cov(way_along((0.0, 0.0), (40.0, 0.0), t0_s=1.0), 0.3, 0.3)  # 80 steps
TURNED = way_along((0.0, 0.0), (0.0, 40.0), t0_s=1.0)


def of_kind(name: str, whitened: Any, doubted: float = 0.0) -> WalkResult:
    count = len(whitened)
    weight = np.where(np.arange(count) < doubted * count, 0.2, 1.0)
    residuals = Residuals(name, np.arange(1, count + 1), np.asarray(whitened, dtype=float), weight)
    return hand_result(WAY, smoothed={"residuals": (residuals,)})


@pytest.mark.parametrize("name", list(LIMITS))
def test_each_kind_is_told_beyond_its_limits_only(name: str) -> None:
    limits = LIMITS[name]
    assert factors_beyond_their_sigmas(of_kind(name, np.full(20, 0.95 * limits.rms))) == []
    (found,) = factors_beyond_their_sigmas(of_kind(name, np.full(20, 1.2 * limits.rms)))
    assert found.reason.kind == name
    assert found.reason.weight >= 1.2 * (1.0 - 1e-9)


def test_one_factor_far_off_is_enough() -> None:
    one = np.zeros(80)
    one[50] = LIMITS["bias_drift"].most * 2.0
    (found,) = factors_beyond_their_sigmas(of_kind("bias_drift", one))
    assert found.reason.weight == pytest.approx(2.0)
    assert found.reason.start_s == pytest.approx(26.0)  # of the 51st step
    assert "off by 7.0 sigma at worst" in found.reason.text


def test_factors_that_the_robust_loss_threw_away_are_counted() -> None:
    (found,) = factors_beyond_their_sigmas(of_kind("compass", np.full(20, 0.1), doubted=0.8))
    assert "80 % of it not believed" in found.reason.text
    assert factors_beyond_their_sigmas(of_kind("compass", np.full(20, 0.1), doubted=0.6)) == []
    assert factors_beyond_their_sigmas(of_kind("compass", np.full(5, 0.1), doubted=1.0)) == []


def test_a_barometer_in_doubt_widens_altitude_by_its_metres() -> None:
    whitened = np.zeros(20)
    whitened[9] = 30.0
    (found,) = factors_beyond_their_sigmas(of_kind("barometer", whitened))
    sigma_m = Config().graph.sigma_altitude_m
    assert found.sigma_m is not None
    assert found.sigma_m.max() == 0.0  # no step was shortened
    assert found.sigma_z_m is not None
    assert found.sigma_z_m[9] == 0.0
    assert found.sigma_z_m[[10, 80]].tolist() == pytest.approx([30.0 * sigma_m] * 2)
    (climbing,) = factors_beyond_their_sigmas(of_kind("climb", np.full(20, 5.0)))
    assert climbing.sigma_z_m is not None
    assert climbing.sigma_z_m[80] == pytest.approx(20 * 5.0 * Config().graph.sigma_climb_m)


def apart(ekf: Any, pdr: Any, **given: Any) -> list[Any]:
    return list(
        smoother_against_others(hand_result(WAY, trajectories={"pdr": pdr, "ekf": ekf, "smoothed": WAY}, **given))
    )


def test_a_smoother_that_leaves_both_others_is_doubted() -> None:
    """Both go North instead of East: 56.6 m at the end, where 0.3 ⊕ 4 ⊕ 0.26 √240 ⊕ 0.5 m may be."""
    (found,) = apart(TURNED, TURNED)
    allowed_m = math.sqrt(0.3**2 + 4.0**2 + 0.26**2 * 6.0 * 40.0 + 0.5**2)
    assert found.reason.weight == pytest.approx(40.0 * math.sqrt(2.0) / allowed_m / 2.5)
    assert found.sigma_m[-1] == pytest.approx(40.0 * math.sqrt(2.0))


def test_one_of_them_on_its_side_is_enough() -> None:
    assert apart(TURNED, WAY) == []
    assert apart(WAY, TURNED) == []
    near = replace(TURNED, x_m=WAY.x_m, y_m=0.25 * WAY.x_m)  # 10 m
    assert apart(near, TURNED) == []
