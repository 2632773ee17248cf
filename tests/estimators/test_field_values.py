"""The field's recent usual: medians of the last thirty steps, this one among them."""

import pytest
from support.factors import make_step

from fbgraph.estimators.magnetic_field import FieldMemory


def inflations(norms_ut: list[float], dips_rad: list[float]) -> list[float]:
    memory = FieldMemory(10.0, 0.2)
    steps = zip(norms_ut, dips_rad, strict=True)
    return [memory.inflation(make_step(mag_norm_ut=n, mag_dip_rad=d)) for n, d in steps]


def test_the_first_step_is_its_own_usual() -> None:
    assert inflations([48.0], [1.1]) == [1.0]


def test_each_deviation_counts_in_its_own_scale_and_squared() -> None:
    assert inflations([48.0] * 3 + [63.0], [1.1] * 4)[-1] == pytest.approx(1.0 + 1.5**2)
    assert inflations([48.0] * 4, [1.1] * 3 + [0.7])[-1] == pytest.approx(1.0 + 2.0**2)
    assert inflations([48.0] * 3 + [63.0], [1.1] * 3 + [0.7])[-1] == pytest.approx(1.0 + 1.5**2 + 2.0**2)


def test_the_usual_is_the_median_not_the_mean() -> None:
    assert inflations([40.0, 200.0, 41.0, 42.0, 43.0], [1.0] * 5)[-1] == pytest.approx(1.0 + 0.1**2)
    assert inflations([40.0, 200.0, 41.0, 42.0, 30.0], [1.0] * 5)[-1] == pytest.approx(1.0 + 1.1**2)


def test_of_an_even_number_the_upper_of_the_two_in_the_middle() -> None:
    assert inflations([40.0, 50.0], [1.0] * 2) == pytest.approx([1.0, 1.0])
    assert inflations([50.0, 40.0], [1.0] * 2) == pytest.approx([1.0, 2.0])


def test_thirty_steps_later_a_field_is_the_usual() -> None:
    norms = [48.0] * 30 + [68.0] * 30
    after = inflations(norms, [1.1] * 60)[30:]
    # until the new field is half of the last thirty it is unusual by 20 µT: 1 + 2²
    assert after[:14] == pytest.approx([5.0] * 14)
    assert after[14:] == pytest.approx([1.0] * 16)
