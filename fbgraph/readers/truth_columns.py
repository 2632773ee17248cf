"""Where somebody really was, where a log's own tables say so: for scoring only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fbgraph.columns.choosing import TRUTH
from fbgraph.columns.clock_times import clock_ns
from fbgraph.columns.clocks import find_clock
from fbgraph.columns.column_names import guess_columns
from fbgraph.columns.guesses import Chosen
from fbgraph.core.checkpoints import Checkpoints, checkpoints
from fbgraph.core.geometry import FloatArray
from fbgraph.tables.table import Table

_EVERY_NS = 500_000_000  # a score at every sample of a motion capture says no more than two a second


def truth_of(tables: Sequence[Table], chosen: Chosen, source: object) -> Checkpoints | None:
    """The places in columns such as ``pos_x``, ``pos_y`` as checkpoints on the log's clock; None if there are none.

    Args:
        tables: of the log.
        chosen: which columns are what.
        source: for messages.
    """
    picks = [chosen.picks[name] for name in TRUTH if name in chosen.picks]
    if len(picks) < 2:
        return None
    table = tables[picks[0].table]
    t_ns = clock_ns(table, find_clock(table, guess_columns(table, ())))
    places = table.numbers([pick.columns[0] for pick in picks])
    good = np.flatnonzero(np.isfinite(places).all(axis=1))
    good = good[np.argsort(t_ns[good], kind="stable")]
    _, first = np.unique(t_ns[good] // _EVERY_NS, return_index=True)
    rows = good[first]
    if len(rows) < 2:
        return None
    z_m = places[rows, 2] if len(picks) > 2 else None
    t_s: FloatArray = t_ns[rows] / 1e9
    return checkpoints(t_s, places[rows, 0], places[rows, 1], z_m=z_m, source=f"{source} (its own truth)")
