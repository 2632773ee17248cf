"""What all readers share: cleaning, one clock, refusing what cannot be a walk."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.waves import check_sound, waves

from fbgraph.core.errors import DataError
from fbgraph.core.nanoseconds import to_ns
from fbgraph.readers.cleaning import LogFile, RawLog, RawStream, assemble

S = 1_000_000_000
N = 500
I = np.arange(N)  # noqa: E741
T_NS = 100 * S + I * 20_000_000
ACC, GYRO, MAG = waves(N)
HERE = Path("walk.log")


Number = TypeVar("Number", bound=np.generic)
Where = int | slice | tuple[int | slice, int]


def made(**changes: RawStream | None) -> LogFile:
    """A clean walk with some streams exchanged or, if None, removed; cleaned and assembled."""
    streams = {"acc": RawStream(T_NS, ACC), "gyro": RawStream(T_NS, GYRO), "mag": RawStream(T_NS, MAG)} | changes
    return assemble(RawLog({name: stream for name, stream in streams.items() if stream is not None}), HERE, "test")


def at(t_ns: npt.ArrayLike) -> dict[str, RawStream]:
    """The walk's streams on another clock."""
    t = np.asarray(t_ns, dtype=np.int64)
    return {"acc": RawStream(t, ACC), "gyro": RawStream(t, GYRO), "mag": RawStream(t, MAG)}


def changed(array: npt.NDArray[Number], where: Where, value: npt.ArrayLike) -> npt.NDArray[Number]:
    array = array.copy()
    array[where] = value
    return array


def test_a_clean_walk_passes_unchanged() -> None:
    file = made()
    check_sound(file.log)
    np.testing.assert_array_equal(file.log.acc.values, ACC)
    np.testing.assert_allclose(file.log.acc.t_s, 0.02 * I, atol=1e-12)
    assert file.log.t0_s == 100.0
    assert file.log.counts == {}
    assert file.log.notices == ("no barometer: altitude stays at 0",)


def test_bad_values_are_dropped_and_counted() -> None:
    acc = changed(changed(changed(ACC, 5, np.nan), (6, 0), np.inf), (7, 1), 1e4)
    log = made(acc=RawStream(T_NS, acc), pressure=RawStream(T_NS, np.linspace(200, 1000, N)[:, None])).log
    assert log.counts["acc_not_finite"] == 2
    assert log.counts["acc_out_of_range"] == 1
    assert log.counts["pressure_out_of_range"] == (np.linspace(200, 1000, N) < 300).sum()
    assert len(log.acc) == N - 3


@pytest.mark.parametrize("row", [0, 1, 2, 250, N - 2, N - 1])
@pytest.mark.parametrize("t_ns", [-(2**63), -5 * S, 0, 90 * S, 100 * S + 5, 200 * S, 10**15, 4 * 10**18, 2**63 - 1])
def test_one_garbled_time_costs_at_most_two_samples(row: int, t_ns: int) -> None:
    file = made(**at(changed(T_NS, row, t_ns)))
    check_sound(file.log)
    assert len(file.log.acc) >= N - 2
    assert file.log.duration_s < 20.0


def test_a_block_of_garbled_times_costs_only_itself() -> None:
    file = made(**at(changed(T_NS, slice(200, 203), [10**15, 10**15 + 1, 10**15 + 2])))
    assert len(file.log.acc) == N - 3
    assert file.log.counts["acc_not_later"] == 3


def test_duplicates_and_shared_times() -> None:
    twice = np.repeat(np.arange(N), 2)
    t_ns = T_NS[twice]
    log = made(acc=RawStream(t_ns, ACC[twice]), gyro=RawStream(t_ns, GYRO[twice]), mag=None).log
    assert log.counts == {"acc_duplicate": N, "gyro_duplicate": N}
    np.testing.assert_array_equal(log.acc.values, ACC)

    pairs = at(T_NS[I // 2 * 2])  # two samples arrive at once
    log = made(**pairs).log
    assert len(log.acc) == N - 1  # nothing before the first pair to spread it over
    np.testing.assert_allclose(np.diff(log.acc.t_s), 0.02, atol=1e-9)
    assert any("time of another" in notice for notice in log.notices)


def test_backward_samples_are_dropped() -> None:
    order = I.copy()
    order[[100, 101]] = [101, 100]
    log = made(**at(T_NS[order])).log
    assert log.counts["acc_not_later"] == 1
    again = np.concatenate((I[:300], I[200:]))  # a piece sent twice
    log = made(acc=RawStream(T_NS[again], ACC[again])).log
    np.testing.assert_array_equal(log.acc.values, ACC)


def test_a_clock_set_during_the_log_leaves_the_longer_piece() -> None:
    t_ns = T_NS.copy()
    t_ns[120:] += 1_700_000_000 * S
    file = made(**at(t_ns))
    check_sound(file.log)
    assert len(file.log.acc) == N - 120
    assert file.log.counts["acc_stray_time"] == 120
    assert any("time jumps" in notice for notice in file.log.notices)
    assert file.log.t0_s == pytest.approx(1_700_000_102.4)


def test_saturation_is_counted_not_dropped() -> None:
    gyro = changed(GYRO, (slice(50, 60), 1), 34.906586)
    log = made(
        gyro=RawStream(T_NS, gyro), acc=RawStream(T_NS, np.array(np.clip(ACC * [1, 1, 3], -19.6133, 19.6133)))
    ).log
    assert len(log.gyro) == N
    assert log.counts["gyro_saturated"] == 10
    assert log.counts["acc_saturated"] > 100
    assert any("10 samples at the gyroscope's limit of 2000 °/s" in notice for notice in log.notices)
    assert "acc_saturated" not in made().log.counts


def test_stuck_sensors() -> None:
    log = made(
        gyro=RawStream(T_NS, GYRO * 0),
        mag=RawStream(T_NS, MAG * 0 + 30),
        pressure=RawStream(T_NS, np.full((N, 1), 1013.0)),
    ).log
    assert len(log.gyro) == N
    assert len(log.mag) == len(log.pressure) == 0
    text = "; ".join(log.notices)
    assert "gyroscope never changes" in text
    assert "magnetometer not used" in text
    assert "barometer not used" in text


def test_gaps_and_slow_rates_are_told() -> None:
    t_ns = T_NS * 5
    t_ns[300:] += 3 * S
    notices = "; ".join(made(**at(t_ns)).log.notices)
    assert "the accelerometer runs at 10.0 Hz; steps need 20 Hz" in notices
    assert "1 gaps of more than 1 s in the accelerometer, the longest 3.1 s at 29.9 s" in notices


SHORT = slice(0, 3)
REFUSED: dict[str, tuple[Mapping[str, RawStream | None], str]] = {
    "no accelerometer": ({"acc": None}, "no usable accelerometer"),
    "no gyroscope": ({"gyro": None}, "no usable gyroscope samples .none in the file.; a walk cannot"),
    "only nan": ({"acc": RawStream(T_NS, ACC * np.nan)}, "no usable accelerometer samples .500 acc_not_finite"),
    "three samples": ({"acc": RawStream(T_NS[SHORT], ACC[SHORT])}, "only 3 accelerometer samples over 0.04 s"),
    "three gyro samples": ({"gyro": RawStream(T_NS[SHORT], GYRO[SHORT])}, "only 3 gyroscope samples"),
    "constant": ({"acc": RawStream(T_NS, ACC * 0 + 5.66)}, "accelerometer never changes"),
    "in g": ({"acc": RawStream(T_NS, ACC / 9.8)}, "median magnitude is .* unit is wrong"),
    "apart": ({"gyro": RawStream(T_NS + 600 * S, GYRO)}, "only 0 gyroscope samples"),
    "backwards": (at(T_NS[::-1]), "time goes backwards"),
    "time stands still": (at(T_NS * 0), "time goes backwards or stands still"),
    "shuffled": (at(np.random.default_rng(0).permutation(T_NS)), "time goes backwards"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_a_walk_is_refused(case: str) -> None:
    changes, message = REFUSED[case]
    with pytest.raises(DataError, match=message) as error:
        made(**changes)
    assert str(error.value).startswith("walk.log: ")
    assert "\n" not in str(error.value)


@given(st.permutations(range(24)))
def test_of_samples_out_of_order_as_few_as_possible_are_dropped(order: list[int]) -> None:
    """Half a second of times in any order: what stays is a longest run of increasing ones, by its definition."""
    t_ns = T_NS.copy()
    t_ns[100:124] = T_NS[100 + np.array(order)]
    longest = [1] * len(order)
    for i, later in enumerate(order):
        longest[i] = 1 + max((longest[j] for j in range(i) if order[j] < later), default=0)
    file = made(acc=RawStream(t_ns, ACC))
    check_sound(file.log)
    assert len(file.log.acc) == N - len(order) + max(longest)


@given(
    st.lists(st.tuples(st.integers(0, N - 1), st.integers(-(2**63), 2**63 - 1)), max_size=30),
    st.lists(st.tuples(st.integers(0, N - 1), st.floats(allow_nan=True)), max_size=30),
)
@settings(max_examples=60, deadline=None)
def test_any_times_and_values_give_a_sound_log(times: list[tuple[int, int]], values: list[tuple[int, float]]) -> None:
    t_ns, acc = T_NS.copy(), ACC.copy()
    for i, t in times:
        t_ns[i] = t
    for i, value in values:
        acc[i, i % 3] = value
    file = made(**(at(t_ns) | {"acc": RawStream(t_ns, acc)}))
    check_sound(file.log)
    assert len(file.log.gyro) >= N - 2 * len(times)


@given(st.floats(), st.sampled_from([1, 1000, 10**6, 10**9]))
def test_to_ns_never_overflows(t: float, tick_ns: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (t_ns,) = to_ns(np.array([t]), tick_ns).tolist()
    if abs(t) <= 4e18 // tick_ns:
        assert abs(t_ns - t * tick_ns) <= max(512.0, abs(t * tick_ns) * 1e-15)
    else:
        assert t_ns == 4 * 10**18 + 1
