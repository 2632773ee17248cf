"""Numbers that no sensor says decide nothing."""

import numpy as np
import pytest

from fbgraph.core.geometry import FloatArray
from fbgraph.physics.likely_samples import likely

GOOD = np.ones(200, dtype=bool)


def samples() -> FloatArray:
    return np.random.default_rng(3).normal((0.0, 0.0, 9.8), 3.0, (200, 3))


@pytest.mark.parametrize("name", ["acc", "gyro", "mag", "pressure", "linear_acc"])
@pytest.mark.parametrize("huge", [1e308, -1e308, 1.1e12])
def test_what_no_sensor_says_is_left_out_be_it_one_row_or_nearly_all(name: str, huge: float) -> None:
    for rows in (slice(50, 51), slice(20, 200)):
        values = samples()
        values[rows, 1] = huge
        with np.errstate(all="raise"):
            found = likely(name, values, GOOD)
        assert not found[rows].any()
        assert found.sum() == 200 - len(range(*rows.indices(200)))


def test_spikes_of_feet_stay_and_rows_that_are_not_there_are_not_asked() -> None:
    values = samples()
    values[10] *= 3.0
    values[20] = np.nan
    there = np.arange(200) != 20
    assert likely("acc", values, there)[there].all()
    values[30] = 1000.0
    assert not likely("acc", values, there)[30]
    assert likely("acc", np.zeros((5, 3)), GOOD[:5]).all()
