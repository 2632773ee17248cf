"""What is told of a clean log by a few looks is what a look at every sample tells."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fbgraph.columns.tick_counts import damage, distinct, step_of, unwrapped
from fbgraph.core.nanoseconds import MAX_T_NS, to_ns
from fbgraph.core.sampling import ENOUGH, runs_of
from fbgraph.readers.cleaning import LIMITS, MIN_PRESSURE_HPA, RawLog, RawStream, assemble, saturated

N = 400
T_NS = np.arange(N, dtype=np.int64) * 20_000_000
UP = np.array((0.0, 0.0, 9.8))
REST = np.random.default_rng(5).normal(0.0, 0.3, (N, 3))


def counts_of(name: str, values: NDArray[Any], t_ns: NDArray[Any] = T_NS) -> dict[str, int]:
    streams = {"acc": RawStream(T_NS, REST + UP), "gyro": RawStream(T_NS, REST)}
    log = assemble(RawLog(streams | {name: RawStream(t_ns, values)}), Path("walk.csv"), "m5stickc").log
    return dict(log.counts)


@pytest.mark.parametrize("name", ["acc", "gyro", "mag"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_largest_possible_value_is_kept_and_the_next_is_not(name: str, sign: float) -> None:
    values = REST + UP
    values[7, 1] = sign * LIMITS[name]
    assert counts_of(name, values) == {}
    values[7, 1] = sign * np.nextafter(LIMITS[name], np.inf)
    assert counts_of(name, values) == {f"{name}_out_of_range": 1}
    values[7, 1] = np.nan
    assert counts_of(name, values) == {f"{name}_not_finite": 1}


def test_the_lowest_pressure_and_the_latest_time() -> None:
    values = 1000.0 + REST[:, :1]
    values[3] = MIN_PRESSURE_HPA
    assert counts_of("pressure", values) == {}
    values[3] = np.nextafter(MIN_PRESSURE_HPA, 0.0)
    assert counts_of("pressure", values) == {"pressure_out_of_range": 1}
    late = T_NS.copy()
    late[-1] = MAX_T_NS + 1
    assert counts_of("mag", REST + 30.0, late) == {"mag_impossible_time": 1}
    late[-1] = late[-3]
    assert counts_of("mag", REST + 30.0, late) == {"mag_not_later": 1}


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rail_is_seen_on_every_side(axis: int, sign: float) -> None:
    values = REST.copy()
    values[5:25, axis] = sign * 4.36
    assert saturated("gyro", values) == (4.36, 20)
    values[5:25, axis] = sign * 4.1  # below the narrowest full scale
    assert saturated("gyro", values) == (0.0, 0)


def test_ticks_of_any_size_become_nanoseconds_exactly() -> None:
    most = MAX_T_NS // 1_000_000
    assert to_ns(np.array((0, -most, most)), 1_000_000).tolist() == [0, -most * 1_000_000, most * 1_000_000]
    for beyond in (most + 1, -most - 1):
        assert to_ns(np.array((5, beyond)), 1_000_000).tolist() == [5_000_000, MAX_T_NS + 1]


@pytest.mark.filterwarnings("error")
def test_the_least_whole_number_is_no_warning() -> None:
    ticks = np.array((5, np.iinfo(np.int64).min, 5, 6, 7))
    assert damage(ticks) == ""
    assert unwrapped(ticks, (2.0**16,))[1] == 0.0


def test_few_rows_tell_the_step_of_many() -> None:
    many = 8 * ENOUGH
    steps = np.tile((8, 12, 10), many // 3 + 1)[:many]
    assert step_of(np.cumsum(steps)) == 10.0
    assert step_of(np.cumsum(np.where(np.arange(many) % 7, 0, 70))) == pytest.approx(10.0, rel=1e-4)
    assert len(runs_of(steps)) == ENOUGH
    assert runs_of(steps[:ENOUGH]) is not steps
    np.testing.assert_array_equal(runs_of(steps[:ENOUGH]), steps[:ENOUGH])
    assert runs_of(np.arange(many)).tolist()[:: ENOUGH - 1] == [0, many - 1]


def test_a_counter_of_16_bits_goes_on_among_steps_of_any_size() -> None:
    ticks = np.cumsum(np.full(3000, 100)) % 2**16
    gone_on, span = unwrapped(ticks, (2.0**16, 2.0**32))
    assert span == 2.0**16
    assert (np.diff(gone_on) == 100).all()
    assert distinct(ticks) == len(set(ticks.tolist()))
    same, none = unwrapped(gone_on, (2.0**16, 2.0**32))
    assert none == 0.0
    np.testing.assert_array_equal(same, gone_on)
