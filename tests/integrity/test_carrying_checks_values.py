"""What is told of a device that was not carried as ``device.mount`` says."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.by_hand import way_along
from support.results_by_hand import changed, hand_log, hand_result

from fbgraph.core.config import Config
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sensor_log import Stream
from fbgraph.integrity.carrying_checks import forward_b, mount_does_not_fit, turned_in_hand
from fbgraph.run.findings import walk_findings
from fbgraph.run.walk_result import WalkResult

WAY = way_along((0.0, 0.0), (25.0, 0.0), t0_s=1.0)


def walk(mount_rad: float | FloatArray = 0.0, sigma_rad: float = 0.0, at: Sequence[int] = (0,)) -> WalkResult:
    mount = np.array(np.broadcast_to(mount_rad, 51))
    return hand_result(WAY, steps={"mount_rad": mount, "sigma_turned_rad": changed(51, at, sigma_rad, 0.0)})


def test_a_device_held_as_it_should_be_is_not_spoken_of() -> None:
    assert mount_does_not_fit(walk()) == []
    assert turned_in_hand(walk()) == []
    assert not [f for f in walk_findings(walk()) if f.kind == "carrying"]


@pytest.mark.parametrize(("up", "forward"), [((0.0, 0.0, 9.8), (0.0, -1.0, 0.0)), ((0.0, 9.8, 0.0), (0.0, 0.0, 1.0))])
def test_a_mount_that_points_backwards_is_told_with_the_one_that_fits(up: Any, forward: Any) -> None:
    """Flat, one walks towards the lower edge; upright, towards the screen."""
    t_s = np.arange(0.0, 60.0, 0.01)
    log = replace(hand_log(), acc=Stream(t_s, np.tile(up, (len(t_s), 1))))
    result = replace(walk(math.pi, 0.2), log=log)
    assert forward_b(result, math.pi) == pytest.approx(forward, abs=1e-9)
    (doubt,) = mount_does_not_fit(result)
    assert "180° to the" in doubt.reason.text
    assert "device.mount = [" + ", ".join(f"{v:.2f}" for v in forward) + "]" in doubt.reason.advice.replace(
        "-0.00", "0.00"
    )
    assert doubt.reason.start_s is None


def test_left_of_the_mount_is_left_seen_from_above() -> None:
    t_s = np.arange(0.0, 60.0, 0.01)
    log = replace(hand_log(), acc=Stream(t_s, np.tile((0.0, 0.0, 9.8), (len(t_s), 1))))
    assert forward_b(replace(walk(), log=log), math.pi / 2) == pytest.approx((-1.0, 0.0, 0.0), abs=1e-9)


def test_a_push_that_may_not_fit_is_doubted() -> None:
    (doubt,) = mount_does_not_fit(walk(0.0, 0.5))
    assert "uncertain by 29°" in doubt.reason.text
    assert mount_does_not_fit(walk(0.0, Config().carrying.sigma_worn_rad)) == []


def test_a_device_worn_on_a_limb_is_told_without_a_doubt() -> None:
    result = walk(-0.2, 0.3)
    assert mount_does_not_fit(result) == []
    (found,) = [f for f in walk_findings(result) if f.kind == "carrying"]
    assert "11° to the right of it, uncertain by 17°" in found.text


def test_a_turn_in_the_hand_is_told_with_its_time_and_side() -> None:
    turned = np.where(np.arange(51) >= 22, -math.pi / 2, 0.0)
    turned[20:22] = -0.5, -1.0
    result = walk(turned, 0.2, at=[20])
    (doubt,) = turned_in_hand(result)
    assert "turned in the hand at 10 s by 90° to the left (± 11°)" in doubt.reason.text
    assert doubt.reason.start_s == pytest.approx(10.5)


def test_turned_and_turned_back_are_two() -> None:
    turned = np.where((np.arange(51) >= 20) & (np.arange(51) < 35), 1.0, 0.0)
    result = walk(turned, 0.2, at=[20, 35])
    there, back = (doubt.reason.text for doubt in turned_in_hand(result))
    assert "by 57° to the right" in there
    assert "by 57° to the left" in back


def test_what_may_have_been_a_turn_is_told_as_such() -> None:
    (doubt,) = turned_in_hand(walk(0.0, 0.7, at=[30]))
    assert "may have been turned in the hand" in doubt.reason.text
    assert "uncertain by 40°" in doubt.reason.text
