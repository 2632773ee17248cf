"""Sentences on the device's errors: when they are said, of when, and in which numbers."""

from typing import Any

import numpy as np
from support.magnetised import laps, magnetised

from fbgraph.estimators.estimates import DeviceErrors
from fbgraph.run.device_findings import device_findings

TRACK = magnetised(laps(1), jump=(31, 12.0, -5.0))
QUIET = magnetised(laps(1))


def device(**given: Any) -> DeviceErrors:
    """A faultless one but for what is given."""
    usual: dict[str, Any] = {"gyro_scale": 0.0, "gyro_scale_sigma": 0.005, "stretch_starts": np.array([0])}
    usual |= {"iron_ut": np.array([[0.5, 0.0, 20.0]]), "iron_sigma_ut": np.array([[1.0, 1.0, 0.5]])}
    return DeviceErrors(**(usual | given))


def test_of_a_faultless_device_nothing_is_said() -> None:
    assert device_findings(device(), QUIET) == []
    assert device_findings(None, QUIET) == []


def test_iron_is_told_once_it_matters_and_is_certain() -> None:
    iron_ut = np.array([[8.0, 6.0, 20.0]])
    (found,) = device_findings(device(iron_ut=iron_ut), QUIET)
    assert found.kind == "iron"
    assert "adds 10 µT (± 3, 2σ) to a horizontal field of 20 µT" in found.text
    assert "by up to 30°" in found.text  # asin(10 / 20)
    assert (found.start_s, found.end_s) == (0.0, 30.0)
    assert device_findings(device(iron_ut=np.array([[4.0, 2.9, 20.0]])), QUIET) == []  # 4.9 µT
    assert device_findings(device(iron_ut=iron_ut, iron_sigma_ut=np.array([[2.4, 2.4, 1.0]])), QUIET) == []


def test_iron_as_strong_as_the_field_turns_a_compass_right_round() -> None:
    (found,) = device_findings(device(iron_ut=np.array([[30.0, 0.0, 20.0]])), QUIET)
    assert "by up to 90°" in found.text


def test_the_iron_of_each_stretch_is_told_of_its_own_time() -> None:
    both = device(
        iron_ut=np.array([[0.0, 0.0, 20.0], [12.0, -5.0, 20.0]]),
        iron_sigma_ut=np.ones((2, 3)),
        stretch_starts=np.array([0, 31]),
    )
    jump, iron = device_findings(both, TRACK)
    assert (jump.kind, iron.kind) == ("recalibration", "iron")
    assert "jumped by 13 µT" in jump.text
    assert jump.text.endswith("taken out")
    assert "not taken out" not in jump.text
    assert (jump.start_s, jump.end_s) == (15.0, 15.5)
    assert (iron.start_s, iron.end_s) == (15.0, 30.0)


def test_a_jump_that_was_not_believed_says_so() -> None:
    for nobody in (device(), None):
        (found,) = device_findings(nobody, TRACK)
        assert found.kind == "recalibration"
        assert "not taken out" in found.text


def test_the_gyroscopes_scale_is_told_in_percent_and_which_way() -> None:
    for scale, said in ((0.03, "3.0 % too much"), (-0.025, "2.5 % too little")):
        (found,) = device_findings(device(gyro_scale=scale), QUIET)
        assert found.kind == "gyro_scale"
        assert f"{said} of every turn (± 1.0, 2σ)" in found.text
    assert device_findings(device(gyro_scale=0.019), QUIET) == []
    assert device_findings(device(gyro_scale=0.03, gyro_scale_sigma=0.013), QUIET) == []
