"""A building's axis and field that a walk contradicts, in its verdict."""

import numpy as np
import pytest
from support.results_by_hand import hand_result

from fbgraph.core.aids import Told
from fbgraph.core.building import Building, BuildingAxis, BuildingField
from fbgraph.core.verdict import Reason
from fbgraph.integrity.aid_checks import aids_that_contradict, field_unlike_the_building
from fbgraph.run.walk_result import WalkResult

COUNT = 51


def inside(strength_ut: float, dip_deg: float, sigma_ut: float = 2.0, compass: int = COUNT) -> WalkResult:
    """A walk through a building of 45 ± 2 µT and 65 ± 2°."""
    field = BuildingField(strength_ut=45.0, sigma_strength_ut=sigma_ut, dip_deg=65.0, sigma_dip_deg=2.0)
    told = Told(building=Building(axis=BuildingAxis(heading_deg=0.0), field=field))
    heard = np.arange(COUNT) < compass
    steps = {
        "mag_norm_ut": np.where(heard, strength_ut, np.nan),
        "mag_dip_rad": np.where(heard, np.radians(dip_deg), np.nan),
    }
    return hand_result(steps=steps, told=told)


@pytest.mark.parametrize(("strength_ut", "dip_deg"), [(45.0, 65.0), (56.5, 65.0), (33.5, 76.5), (45.0, 53.5)])
def test_a_field_as_usual_is_none_to_tell(strength_ut: float, dip_deg: float) -> None:
    assert field_unlike_the_building(inside(strength_ut, dip_deg)) == []


@pytest.mark.parametrize(
    ("strength_ut", "dip_deg", "weight"), [(63.0, 65.0, 1.5), (27.0, 65.0, 1.5), (45.0, 29.0, 3.0), (46.0, 101.0, 3.0)]
)
def test_a_field_of_elsewhere_is_doubted(strength_ut: float, dip_deg: float, weight: float) -> None:
    (doubt,) = field_unlike_the_building(inside(strength_ut, dip_deg))
    assert doubt.reason.kind == "magnetometer"
    assert doubt.reason.weight == pytest.approx(weight)
    assert (
        f"{strength_ut:.0f} µT strong and dips by {dip_deg:.0f}°, in this building usually 45 µT" in doubt.reason.text
    )
    assert doubt.sigma_m is not None
    assert doubt.sigma_m[-1] == pytest.approx(25.0 * 0.1 * weight / np.sqrt(2.0))


def test_a_building_in_which_walks_differ_allows_more() -> None:
    assert field_unlike_the_building(inside(63.0, 65.0, sigma_ut=5.0)) == []


def test_few_readings_and_no_building_say_nothing() -> None:
    assert field_unlike_the_building(inside(90.0, 10.0, compass=19)) == []
    assert field_unlike_the_building(hand_result(steps={"mag_norm_ut": np.full(COUNT, 90.0)})) == []


def test_an_axis_that_was_refused_is_in_the_verdict() -> None:
    reason = Reason("axis", 2.0, "the building's axis was not used", "check it")
    (doubt,) = aids_that_contradict(hand_result(smoothed={"doubts": (reason,)}))
    assert doubt.reason is reason
