"""Moments over a sliding window, against every window taken by itself."""

import itertools

import numpy as np
import pytest

from fbgraph.core.geometry import FloatArray
from fbgraph.front_end.levelled_signals import gaps
from fbgraph.front_end.running_sums import Latest, WindowMeans, WindowMoments


def one_by_one(values: FloatArray, window: int) -> tuple[FloatArray, FloatArray]:
    parts = [values[max(i - window + 1, 0) : i + 1] for i in range(len(values))]
    return np.array([p.mean(axis=0) for p in parts]), np.array([p.var(axis=0) for p in parts])


@pytest.mark.parametrize("window", [1, 7, 40])
def test_mean_and_variance_are_those_of_the_last_samples(window: int) -> None:
    values = np.random.default_rng(0).normal(5.0, 2.0, (100, 3))
    mean, variance, count = WindowMoments(3, window).push(values)
    expected = one_by_one(values, window)
    assert np.allclose(mean, expected[0])
    assert np.allclose(variance, expected[1])
    assert count.tolist() == [min(i + 1, window) for i in range(100)]


def test_any_chunks_give_the_same_bits() -> None:
    values = np.random.default_rng(1).normal(5.0, 2.0, (200, 2))
    whole = WindowMoments(2, 15).push(values)
    for size in (1, 4, 14, 15, 16, 90):
        window = WindowMoments(2, 15)
        parts = [window.push(values[at : at + size]) for at in range(0, 200, size)]
        for expected, found in zip(whole, zip(*parts, strict=True), strict=True):
            assert np.array_equal(expected, np.concatenate(found)), size


def test_nothing_in_nothing_out_and_nothing_remembered() -> None:
    window, values = WindowMoments(1, 3), np.array([[1.0], [2.0], [6.0]])
    for empty in window.push(np.empty((0, 1))):
        assert len(empty) == 0
    assert window.push(values)[0][:, 0].tolist() == [1.0, 1.5, 3.0]


def test_a_large_offset_costs_no_digits() -> None:
    values = np.random.default_rng(2).normal(0.0, 1e-3, (5000, 1))
    variance = WindowMoments(1, 50).push(values + 1e6)[1]
    assert np.allclose(variance, one_by_one(values, 50)[1], rtol=1e-3, atol=1e-10)
    assert (WindowMoments(1, 50).push(np.full((500, 1), 1e6 + 0.1))[1] == 0.0).all()


@pytest.mark.parametrize("keep", [0, 3, 7])
def test_the_latest_rows_are_those_that_a_copy_of_all_would_hold(keep: int) -> None:
    """In pieces of any size, of several arrays; and what was given away before is not written over."""
    rng, latest = np.random.default_rng(3), Latest()
    pieces = [rng.normal(size=(int(n), 2)) for n in rng.integers(0, 6, 60)]
    given: list[tuple[FloatArray, FloatArray]] = []
    known = np.empty((0, 2))
    for piece in pieces:
        known = np.concatenate((known[len(known) - min(len(known), keep) :], piece))
        rows, first = latest.extend((piece, piece[:, 0]), keep)
        np.testing.assert_array_equal(rows, known)
        np.testing.assert_array_equal(first, known[:, 0])
        given.append((rows, known))
    for rows, then in given:
        np.testing.assert_array_equal(rows, then)


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_means_over_several_windows_are_those_of_each(offset: float) -> None:
    values = np.random.default_rng(4).normal(size=(200, 2)) + offset
    together = WindowMeans(2, (7, 30))
    cuts = [0, 1, 5, 36, 37, 90, 200]
    means = np.concatenate([together.push(values[lo:hi]) for lo, hi in itertools.pairwise(cuts)])
    for columns, window in ((means[:, :2], 7), (means[:, 2:], 30)):
        by_hand = [(values - offset)[max(i - window + 1, 0) : i + 1].mean(axis=0) for i in range(200)]
        np.testing.assert_allclose(columns - offset, by_hand, rtol=0.0, atol=1e-9)
    assert (means == WindowMeans(2, (7, 30)).push(values)).all()


def test_gaps_are_where_an_index_goes_on() -> None:
    assert gaps(np.array([4, 5, 6])) == gaps(np.array([9])) == gaps(np.empty(0, dtype=np.int64)) == []
    assert gaps(np.array([4, 5, 7, 8, 20])) == [2, 4]
    assert gaps(np.array([4, 6])) == [1]
