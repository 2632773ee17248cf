"""Some rows of very many, where an hour tells no more than a part of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

ENOUGH = 50_000
"""Rows for a median: eight minutes at 100 Hz."""
_RUNS = 50


def runs_of(values: NDArray[Any], most: int = ENOUGH) -> NDArray[Any]:
    """All rows of few, of many evenly spread runs of neighbours: a pattern from row to row is seen as it is.

    Args:
        values: (N, …).
        most: rows that are enough.
    """
    if len(values) <= most:
        return values
    run = most // _RUNS
    starts = np.linspace(0, len(values) - run, _RUNS).astype(np.int64)
    some: NDArray[Any] = values[(starts[:, None] + np.arange(run)).ravel()]
    return some
