"""The heading filter against the paper's equations, written out with 2x2 matrices."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest
from support.factors import NAN, Array, make_step, stand, walk_track

from fbgraph.core.config import EkfConfig
from fbgraph.estimators.ekf import EkfState, HeadingEkf, run_ekf
from fbgraph.front_end.step_track import Step

CONFIG = EkfConfig(
    sigma_yaw_step_rad=0.03,
    sigma_bias_walk_rad_s=0.004,
    sigma_bias_rad_s=0.05,
    sigma_mag_rad=0.2,
    norm_scale_ut=6.0,
    dip_scale_rad=0.15,
    gate_sigma=2.0,
    altitude_tau_s=3.0,
)
FIELD = {"mag_norm_ut": 48.0, "mag_dip_rad": 1.1}


@dataclass
class Reference:
    """The paper's filter, state [θ, b], with matrices; heading known from the first compass on."""

    x: Array = field(default_factory=lambda: np.zeros(2))
    p: Array = field(default_factory=lambda: np.diag([0.0, CONFIG.sigma_bias_rad_s**2]))
    known: bool = False
    gated: int = 0

    def predict(self, turn_rad: float, dt_s: float) -> None:
        """θ⁻ = θ + (ω - b) Δt, b⁻ = b (paper, prediction model); P⁻ = F P Fᵀ + Q."""
        f = np.array([[1.0, -dt_s], [0.0, 1.0]])
        q = np.diag([CONFIG.sigma_yaw_step_rad**2, CONFIG.sigma_bias_walk_rad_s**2 * dt_s])
        self.x = f @ self.x + [turn_rad, 0.0]
        self.p = f @ self.p @ f.T + q

    def correct(self, z_rad: float, variance: float) -> None:
        """K = P Hᵀ (H P Hᵀ + R)⁻¹ with H = [1, 0]; covariance in Joseph's form."""
        if not self.known:
            self.x[0], self.known = z_rad, True
            self.p = np.array([[variance, 0.0], [0.0, self.p[1, 1]]])
            return
        h = np.array([[1.0, 0.0]])
        innovation = math.remainder(z_rad - self.x[0], 2 * math.pi)
        total = self.p[0, 0] + variance
        excess = innovation**2 / (CONFIG.gate_sigma**2 * total)
        self.gated += excess > 1.0
        variance *= max(1.0, excess)  # disturbance reduces the correction
        gain = self.p @ h.T / (self.p[0, 0] + variance)
        self.x = self.x + gain[:, 0] * innovation
        rest = np.eye(2) - gain @ h
        self.p = rest @ self.p @ rest.T + variance * gain @ gain.T


def headings(steps: Sequence[Step]) -> list[EkfState]:
    ekf = HeadingEkf(CONFIG)
    return [ekf.update(step) for step in steps]


def random_steps(count: int, compass_error: float, seed: int) -> list[Step]:
    rng = np.random.default_rng(seed)
    yaw, t_s, steps = 0.0, 0.0, [stand(), make_step(yaw_s=0.0, yaw_mag_rad=0.3, **FIELD)]
    for _ in range(count):
        t_s += float(rng.uniform(0.4, 0.8))
        yaw += float(rng.normal(0.0, 0.5))
        compass = math.remainder(yaw + 0.3 + float(rng.normal(0.0, compass_error)), 2 * math.pi)
        gyro = yaw + 0.02 * t_s + float(rng.normal(0.0, 0.03))
        silent = rng.random() < 0.2
        steps.append(
            make_step(t_s=t_s + 0.2, yaw_s=t_s, yaw_gyro_rad=gyro, yaw_mag_rad=NAN if silent else compass, **FIELD)
        )
    return steps


@pytest.mark.parametrize("compass_error", [0.1, 0.8], ids=["steady", "beyond the gate"])
def test_every_step_follows_the_papers_equations(compass_error: float) -> None:
    steps = random_steps(200, compass_error, seed=4)
    states, reference = headings(steps), Reference()
    for k, (before, step) in enumerate(pairwise(steps), start=1):
        reference.predict(step.yaw_gyro_rad - before.yaw_gyro_rad, step.yaw_s - before.yaw_s)
        if math.isfinite(step.yaw_mag_rad):
            reference.correct(step.yaw_mag_rad, CONFIG.sigma_mag_rad**2)
        assert states[k].yaw_rad == pytest.approx(reference.x[0], abs=1e-9)
        assert states[k].bias_rad_s == pytest.approx(reference.x[1], abs=1e-9)
        assert states[k].var_yaw == pytest.approx(reference.p[0, 0], rel=1e-9)
    assert reference.gated > 20 if compass_error > 0.5 else reference.gated < 20
    assert states[-1].bias_rad_s == pytest.approx(0.02, abs=0.06)


def test_one_prediction_and_one_correction_by_hand() -> None:
    steps = [
        stand(yaw_gyro_rad=1.0, yaw_s=0.5),
        make_step(yaw_gyro_rad=1.0, yaw_s=0.5, yaw_mag_rad=0.7, **FIELD),
        make_step(yaw_gyro_rad=1.4, yaw_s=1.5, yaw_mag_rad=1.2, **FIELD),
    ]
    first, second = headings(steps)[1:]
    assert (first.yaw_rad, first.bias_rad_s) == (0.7, 0.0)
    assert first.var_yaw == pytest.approx(0.04)
    # P⁻_θθ = 0.04 + 1² 0.05² + 0.03² = 0.0434, P⁻_θb = -0.0025; innovation 0.1, R = 0.04
    assert second.yaw_rad == pytest.approx(1.1 + 0.1 * 0.0434 / 0.0834)
    assert second.bias_rad_s == pytest.approx(0.1 * -0.0025 / 0.0834)
    assert second.var_yaw == pytest.approx(0.0434 * 0.04 / 0.0834)


def test_an_innovation_beyond_the_gate_is_weighted_down_by_its_square() -> None:
    steps = [
        stand(yaw_s=0.5),
        make_step(yaw_s=0.5, yaw_mag_rad=0.0, **FIELD),
        make_step(yaw_s=1.5, yaw_mag_rad=2.0, **FIELD),
    ]
    state = headings(steps)[2]
    # R = 0.04 · 2² / (2² · 0.0834), twelve times its usual
    assert state.yaw_rad == pytest.approx(2.0 * 0.0434 / (0.0434 + 0.04 / 0.0834))


def test_the_shorter_way_round_is_the_innovation() -> None:
    steps = [
        stand(),
        make_step(yaw_s=0.5, yaw_mag_rad=3.1, **FIELD),
        make_step(yaw_s=1.0, yaw_mag_rad=-3.1, **FIELD),
    ]
    assert 3.1 < headings(steps)[2].yaw_rad < 2 * math.pi - 3.1


def test_an_unusual_field_reduces_the_correction() -> None:
    before = [stand(), *[make_step(yaw_s=0.5 * k, yaw_mag_rad=0.0, **FIELD) for k in (1, 2, 3)]]
    p = headings(before)[3].var_yaw

    def drawn(**there: float) -> float:
        """Which share of an innovation of 0.2 rad is taken, as its R."""
        ekf = HeadingEkf(CONFIG)
        for step in before:
            ekf.update(step)
        share = ekf.update(make_step(yaw_s=1.5, yaw_mag_rad=0.2, **(FIELD | there))).yaw_rad / 0.2
        return (p + CONFIG.sigma_yaw_step_rad**2) * (1.0 / share - 1.0)

    assert drawn() == pytest.approx(0.04)
    assert drawn(mag_norm_ut=60.0) == pytest.approx(0.04 * 5.0)  # 1 + (12 / 6)²
    assert drawn(mag_norm_ut=36.0) == pytest.approx(0.04 * 5.0)
    assert drawn(mag_dip_rad=0.65) == pytest.approx(0.04 * 10.0)  # 1 + (0.45 / 0.15)²
    assert drawn(mag_dip_rad=0.65, mag_norm_ut=60.0) == pytest.approx(0.04 * 14.0)


def test_the_calibration_stage_is_the_rest_before_the_first_step() -> None:
    rest = {"rest_s": 4.0, "rest_rate_rad_s": 0.03, "rest_sigma_rad_s": 0.001}
    first = make_step(yaw_s=0.5, yaw_gyro_rad=0.2, yaw_mag_rad=0.0, **rest, **FIELD)
    state = headings(
        [stand(yaw_s=0.5, yaw_gyro_rad=0.2), first, make_step(yaw_s=2.5, yaw_gyro_rad=0.2, yaw_mag_rad=0.1, **FIELD)]
    )
    assert state[1].bias_rad_s == 0.03
    # P_bb = 0.001²; P⁻_θθ = 0.04 + 2² · 1e-6 + 0.0009; innovation 0.1 + 2 · 0.03
    p = 0.04 + 4e-6 + 0.0009
    assert state[2].yaw_rad == pytest.approx(-0.06 + 0.16 * p / (p + 0.04))
    assert state[2].bias_rad_s == pytest.approx(0.03 - 0.16 * 2e-6 / (p + 0.04))


def test_a_rest_later_on_is_no_calibration() -> None:
    rest = {"rest_s": 4.0, "rest_rate_rad_s": 0.03, "rest_sigma_rad_s": 0.001}
    states = headings([stand(), make_step(yaw_s=0.5), make_step(yaw_s=1.0, **rest)])
    assert [state.bias_rad_s for state in states] == [0.0, 0.0, 0.0]


def test_after_a_gap_the_compass_is_taken_as_it_is() -> None:
    steps = [
        stand(),
        make_step(yaw_s=0.5, yaw_mag_rad=0.0, **FIELD),
        make_step(yaw_s=9.0, yaw_gyro_rad=0.4, yaw_mag_rad=2.0, chained=False, **FIELD),
        make_step(yaw_s=9.5, yaw_gyro_rad=0.4, yaw_mag_rad=2.1, **FIELD),
    ]
    states = headings(steps)
    assert (states[2].yaw_rad, states[2].bias_rad_s) == (2.0, 0.0)
    assert states[2].var_yaw == pytest.approx(0.04)
    # the gap cut the tie between heading and bias: P_bb = 0.0025 + 9 · 0.004²; P⁻_θθ = 0.04 + 0.25 P_bb + 0.0009
    p_bias = 0.0025 + 9.0 * 1.6e-5
    p = 0.04 + 0.25 * p_bias + 0.0009
    assert states[3].yaw_rad == pytest.approx(2.0 + 0.1 * p / (p + 0.04))
    assert states[3].bias_rad_s == pytest.approx(-0.1 * 0.5 * p_bias / (p + 0.04))


def test_the_first_compass_knows_nothing_of_the_bias() -> None:
    """From P_θθ = ∞ the update leaves P_θθ = R and P_θb = 0, however long the heading had been unknown."""
    steps = [stand(), *[make_step(yaw_s=0.5 * k) for k in range(1, 41)]]
    steps += [make_step(yaw_s=20.0, yaw_mag_rad=0.0, **FIELD), make_step(yaw_s=20.0, yaw_mag_rad=0.1, **FIELD)]
    assert headings(steps)[-1].bias_rad_s == pytest.approx(0.0, abs=1e-12)


def test_after_a_gap_without_a_compass_the_heading_goes_on_and_is_unknown() -> None:
    steps = [stand(), make_step(yaw_s=0.5, yaw_mag_rad=1.0, **FIELD), make_step(yaw_s=9.0, chained=False)]
    states = headings(steps)
    assert states[2].yaw_rad == 1.0
    assert math.isinf(states[2].var_yaw)


def test_the_altitude_is_a_first_order_low_pass_from_the_start() -> None:
    steps = [
        stand(altitude_m=300.0),
        make_step(t_s=1.5, altitude_m=303.0),
        make_step(t_s=2.0),
        make_step(t_s=5.0, altitude_m=303.0),
    ]
    z_m = [state.z_m for state in headings(steps)]
    # 3 (1 - exp(-Δt / 3 s)); a step without a barometer keeps it, and the time since is not made up for
    first = 3.0 * (1 - math.exp(-0.5))
    assert z_m == pytest.approx([0.0, first, first, first + (3.0 - first) * (1 - math.exp(-1.0))])


def test_a_barometer_that_comes_late_starts_the_count_itself() -> None:
    steps = [stand(), make_step(t_s=1.0, altitude_m=300.0), make_step(t_s=4.0, altitude_m=303.0)]
    assert [s.z_m for s in headings(steps)] == pytest.approx([0.0, 0.0, 3.0 * (1 - math.exp(-1.0))])


def test_positions_add_each_steps_own_length_along_the_corrected_heading() -> None:
    steps = [
        stand(),
        make_step(length_m=0.8, yaw_mag_rad=math.pi / 6, **FIELD),
        make_step(length_m=0.5, yaw_s=0.75, yaw_gyro_rad=math.pi / 3),
    ]
    states = headings(steps)
    expected = [(0.0, 0.0), (0.8 * math.cos(math.pi / 6), 0.4), (0.8 * math.cos(math.pi / 6), 0.9)]
    assert np.allclose([(s.x_m, s.y_m) for s in states], expected)


def test_a_whole_walk_begins_facing_its_first_step() -> None:
    yaw = np.full(6, 0.5)
    trajectory = run_ekf(walk_track(yaw, compass=yaw), CONFIG)
    assert np.allclose(trajectory.yaw_rad, 0.5)
    assert np.allclose(trajectory.xy_m, 0.7 * np.outer(np.arange(7), (math.cos(0.5), math.sin(0.5))))
    assert trajectory.cov_xy_yaw is None
    without = run_ekf(walk_track(yaw, start=2.0), CONFIG)
    assert np.allclose(without.yaw_rad, 0.0)  # no compass: the first direction is East


def test_a_whole_walk_reports_the_filters_bias_and_altitude() -> None:
    yaw, altitude = np.zeros(40), np.linspace(300.0, 310.0, 40)
    track = walk_track(yaw, compass=yaw, bias_rad_s=0.02, altitude_m=altitude)
    states, trajectory = headings(track.steps), run_ekf(track, CONFIG)
    assert list(trajectory.gyro_bias_rad_s[1:]) == [s.bias_rad_s for s in states[1:]]
    assert list(trajectory.z_m) == [s.z_m for s in states]
    assert trajectory.gyro_bias_rad_s[0] == trajectory.gyro_bias_rad_s[1]


def test_a_ride_lifts_the_filter_at_once_and_a_leap_of_pressure_never() -> None:
    ekf = HeadingEkf(EkfConfig(altitude_tau_s=3.0))
    ekf.update(stand(altitude_m=300.0))
    ridden = ekf.update(make_step(t_s=30.0, altitude_m=312.0, carried_m=12.0))
    assert ridden.z_m == pytest.approx(12.0)
    blown = ekf.update(make_step(t_s=30.5, altitude_m=320.0, blown_m=8.0))
    assert blown.z_m == pytest.approx(12.0)
