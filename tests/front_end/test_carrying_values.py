"""Corners and turns in the hand, told apart by the push of steps made by hand."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from support.by_hand import hand_step

from fbgraph.core.config import CarryingConfig
from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.carrying import Carrying, carried, start_belief, turn_belief, usual
from fbgraph.front_end.step_track import Step

CONFIG = CarryingConfig()
QUARTER = math.pi / 2


def steps(yaw: Sequence[float] | FloatArray, push: Sequence[float] | FloatArray, size: float = 0.8) -> list[Step]:
    """Steps half a second long: the device's heading, and the push as seen from it; the compass agrees."""
    made = [
        hand_step(
            t_s=0.5 * k,
            start_s=0.5 * (k - 1),
            yaw_gyro_rad=float(y),
            yaw_mag_rad=float(y) - 0.2,
            gait_yaw_rad=float(p),
            push_m_s2=size,
            side_forward_m_s2=0.1 * math.cos(p),
            side_left_m_s2=0.1 * math.sin(p),
            mount_up_rad=0.0,
            tilt_rate_rad_s=0.2,
        )
        for k, (y, p) in enumerate(zip(yaw, push, strict=True))
    ]
    return made


def after(count: int, at: int, angle: float, over: int = 2) -> FloatArray:
    """Zero up to step ``at``, ``angle`` from ``over`` steps later."""
    return angle * np.clip((np.arange(count) - at) / over, 0.0, 1.0)


def directions(told: Sequence[Step]) -> FloatArray:
    return np.array([step.yaw_gyro_rad for step in told])


def test_a_corner_is_a_corner() -> None:
    walk = steps(after(40, 20, QUARTER), np.zeros(40))
    assert carried(walk, CONFIG) == walk


@pytest.mark.parametrize("angle", [QUARTER, -QUARTER, 0.8, math.pi - 0.3, -2.0])
def test_a_turn_in_the_hand_is_none_of_the_walk(angle: float) -> None:
    told = carried(steps(0.3 + after(40, 20, angle), -after(40, 20, angle)), CONFIG)
    assert np.allclose(directions(told), 0.3, atol=1e-9)
    assert np.allclose([math.remainder(s.yaw_mag_rad - 0.1, math.tau) for s in told], 0.0, atol=1e-9)
    assert np.allclose([s.mount_rad for s in told], -after(40, 20, angle), atol=1e-9)
    changed = np.flatnonzero([s.sigma_turned_rad for s in told])
    assert len(changed) == 1
    assert 17 <= changed[0] <= 20
    assert 0.11 < told[changed[0]].sigma_turned_rad < 0.3


def test_partly_corner_partly_turn() -> None:
    heading, push = after(40, 20, 2.0), -after(40, 20, 1.2)
    told = carried(steps(heading, push), CONFIG)
    assert directions(told)[25:] == pytest.approx(0.8, abs=0.02)


def test_a_turn_that_a_corner_hides_is_seen_by_the_push() -> None:
    told = carried(steps(np.zeros(50), after(50, 20, QUARTER, 1)), CONFIG)
    assert np.allclose(directions(told)[:19], 0.0)
    assert directions(told)[26:] == pytest.approx(QUARTER, abs=0.02)


def test_turned_back_later() -> None:
    there = after(60, 15, QUARTER) - after(60, 40, QUARTER)
    told = carried(steps(there, -there), CONFIG)
    assert np.allclose(directions(told), 0.0, atol=0.02)
    assert np.count_nonzero([s.sigma_turned_rad for s in told]) == 2


def test_two_turns_close_to_each_other_are_told_together() -> None:
    hand, corner = after(40, 15, QUARTER, 1), after(40, 21, 1.2, 1)
    told = carried(steps(hand + corner, -hand), CONFIG)
    assert directions(told)[26:] == pytest.approx(1.2, abs=0.02)
    assert np.allclose(directions(told)[:21], 0.0, atol=0.02)


def test_a_curve_of_the_path_is_no_turn_of_the_device() -> None:
    curve = after(60, 20, 3.0, 18)
    walk = steps(curve, np.zeros(60))
    assert carried(walk, CONFIG) == walk


def test_noisy_pushes_say_nothing() -> None:
    rng = np.random.default_rng(3)
    turned = after(60, 30, QUARTER)
    walk = steps(turned, rng.uniform(-math.pi, math.pi, 60))
    assert carried(walk, CONFIG) == walk


def test_what_may_have_been_a_turn_widens_and_turns_nothing() -> None:
    turned = after(40, 20, QUARTER)
    rng = np.random.default_rng(1)
    doubtful = -turned * 0.5 + 0.3 * rng.standard_normal(40)  # the push is between both
    told = carried(steps(turned, doubtful), CONFIG)
    sigma = max(s.sigma_turned_rad for s in told)
    assert directions(told) == pytest.approx(turned) or sigma > 0.3


def test_stairs_push_otherwise() -> None:
    turned = after(40, 20, QUARTER)
    walk = [replace(s, slope=0.4 if k > 20 else 0.0) for k, s in enumerate(steps(turned, -turned))]
    assert carried(walk, CONFIG) == walk


def test_across_a_gap_nothing_is_compared() -> None:
    turned = after(40, 20, QUARTER, 1)
    walk = [replace(s, chained=k != 21) for k, s in enumerate(steps(turned, -turned))]
    assert all(s.sigma_turned_rad == 0.0 for s in carried(walk, CONFIG)[1:])


def test_what_is_known_changes_at_the_turn_and_not_before_its_steps_came() -> None:
    turned = after(40, 20, QUARTER)
    carrying = Carrying(CONFIG)
    changed = [carrying.add(step) for step in steps(turned, -turned)]
    late = [k for k, first in enumerate(changed) if first < k]
    assert len(late) == 1
    assert 26 <= late[0] <= 32
    assert 17 <= changed[late[0]] <= 20
    assert carrying.finish() == 40
    assert carrying.steps(38) == carrying.steps()[38:]


def test_nobody_walked() -> None:
    carrying = Carrying(CONFIG)
    assert carrying.finish() == 0
    assert carrying.steps() == []


@pytest.mark.parametrize(("angle", "within"), [(math.pi, 0.05), (QUARTER, 0.05), (-QUARTER, 0.05), (2.3, 0.1)])
def test_a_mount_that_points_elsewhere_turns_the_whole_walk(angle: float, within: float) -> None:
    told = carried(steps(np.zeros(40), np.full(40, angle)), CONFIG)
    turned = np.array([s.mount_rad for s in told])
    assert np.allclose(np.exp(1j * turned), cmath.rect(1.0, angle), atol=within)
    assert np.allclose(directions(told), turned)
    assert 0.1 < told[0].sigma_turned_rad < 0.8
    assert all(s.sigma_turned_rad == 0.0 for s in told[1:])


def test_a_push_a_little_off_turns_nothing_and_one_of_fifty_degrees_is_doubted() -> None:
    for angle, doubted in ((0.0, False), (0.4, False), (0.9, True)):
        told = carried(steps(np.zeros(40), np.full(40, angle)), CONFIG)
        assert (told[0].sigma_turned_rad > 0.3) == doubted
        assert told[0].mount_rad == 0.0


def test_of_a_device_worn_upright_or_on_a_limb_less_is_known_and_the_push_is_believed() -> None:
    upright = [replace(s, mount_up_rad=0.8) for s in steps(np.zeros(40), np.full(40, 0.5))]
    limb = [replace(s, tilt_rate_rad_s=1.5) for s in steps(np.zeros(40), np.full(40, 0.5))]
    for walk in (upright, limb):
        told = carried(walk, CONFIG)
        assert 0.3 < told[0].mount_rad < 0.5
        assert 0.2 < told[0].sigma_turned_rad < 0.4
    short = carried(upright[:8], CONFIG)
    assert (short[0].mount_rad, short[0].sigma_turned_rad) == (0.0, CONFIG.sigma_worn_rad)


def test_the_odds_of_a_turn_by_hand() -> None:
    before = np.full((10, 2), (1.0, 0.0), dtype=np.complex128)
    noise = 0.05**2
    variance = noise * (2.0 * (1 / 10 + 1 / 10) + 1.0) + 0.25 * 0.15**2 * 1.0
    belief = turn_belief(before, before * -1j, [QUARTER], CONFIG)
    hand = math.log(CONFIG.turned_in_hand) + 2.0 / (2.0 * variance)
    sigma = math.sqrt(variance)
    free = math.log(CONFIG.turned_in_corner) + 2.0 / (2.0 * variance) + math.log(sigma / math.sqrt(2.0 * math.pi))
    assert belief.odds == pytest.approx(np.logaddexp(hand, free))
    assert belief.angle_rad == pytest.approx(QUARTER)
    assert belief.sigma_rad == pytest.approx(0.12, abs=0.01)


def test_too_few_steps_tell_nothing() -> None:
    few = np.full((3, 2), (1.0, 0.0), dtype=np.complex128)
    assert turn_belief(few, np.repeat(few, 4, axis=0) * -1j, [QUARTER], CONFIG).odds == -math.inf


def test_odd_strides_are_left_out() -> None:
    pushes = np.full((9, 1), 1.0 + 0.0j)
    pushes[4] = -2.0
    assert len(usual(pushes)) == 8
    assert len(usual(np.empty((0, 2), dtype=np.complex128))) == 0


def test_the_odds_of_the_start_by_hand() -> None:
    walk = steps(np.zeros(12), np.zeros(12))
    belief = start_belief(np.full(12, -1.0 + 0.0j), walk, CONFIG)
    variance = 0.25**2 + (0.02 * 5.0) ** 2 + 0.05**2

    def fit(off: float, about: float) -> float:
        sharp = 1.0 / (variance + about**2)
        return sharp * math.cos(off) - math.log(np.i0(sharp))

    any_way = CONFIG.held_any_way
    logs = [math.log(any_way / 2) + fit(math.pi, CONFIG.sigma_worn_rad), math.log(any_way / 4)]
    logs += [math.log(any_way / 12) + fit(off, CONFIG.sigma_held_rad) for off in (QUARTER, 0.0, QUARTER)]
    as_told = math.log(1.0 - any_way) + fit(math.pi, CONFIG.sigma_held_rad)
    assert belief.odds == pytest.approx(np.logaddexp.reduce(logs) - as_told)
    assert abs(belief.angle_rad) == pytest.approx(math.pi)
