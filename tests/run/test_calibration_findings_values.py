"""Steps outside what a step length was calibrated with."""

import numpy as np
import pytest
from support.by_hand import steps_of, way_along

from fbgraph.core.config import load_config
from fbgraph.front_end.step_track import StepTrack
from fbgraph.run.calibration_findings import calibration_findings

WAY = way_along((0.0, 0.0), (20.0, 0.0))
PHONE = load_config("phone").step_length
CALIBRATED = PHONE.model_copy(update={"calibrated_hz": (1.6, 1.9), "calibrated_surge_m_s": (0.1, 0.3)})


def track(quick: int = 0, slow: int = 0, calm: int = 0) -> StepTrack:
    f, surge = np.full(41, 1.8), np.full(41, 0.25)
    f[10 : 10 + quick] = 2.2
    f[30 : 30 + slow] = 1.2
    surge[5 : 5 + calm] = 0.04
    return StepTrack(steps_of(WAY, frequency_hz=f, surge_m_s=surge))


def test_steps_at_another_pace_are_told_with_when_and_how_many() -> None:
    (found,) = calibration_findings(track(quick=8), CALIBRATED)
    assert found.text.startswith("8 of 40 steps are quicker (2.20 a second, median)")
    assert "(1.60 to 1.90)" in found.text
    assert (found.start_s, found.end_s) == (4.5, 8.5)
    slow, calm = calibration_findings(track(slow=9, calm=7), CALIBRATED)
    assert "9 of 40 steps are slower" in slow.text
    assert "7 of 40 steps are with less of a surge (0.04 m/s, median)" in calm.text


def test_a_few_are_chance_and_nothing_is_said_without_a_calibration() -> None:
    assert calibration_findings(track(quick=5), CALIBRATED) == []
    assert calibration_findings(track(quick=30), PHONE) == []


def test_a_surge_beyond_what_counts_is_none_outside_and_the_papers_model_has_none() -> None:
    much = CALIBRATED.model_copy(update={"calibrated_surge_m_s": (0.1, 0.21)})
    assert calibration_findings(track(), much) == []  # 0.25 counts as 0.2
    paper = CALIBRATED.model_copy(update={"kappa_surge": 0.0})
    assert calibration_findings(track(calm=20), paper) == []


def test_a_range_has_its_ends_in_order() -> None:
    from fbgraph.core.errors import ConfigError

    with pytest.raises(ConfigError, match="lowest and the highest"):
        load_config(None, ["step_length.calibrated_hz=[2.0, 1.5]"])
