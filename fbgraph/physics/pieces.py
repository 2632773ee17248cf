"""Pieces of a long log by which its sensors are judged: an hour tells no more than ten minutes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fbgraph.core.geometry import IntArray
from fbgraph.core.nanoseconds import MAX_T_NS

_LONG_NS, _PIECES, _PIECE_NS = 600_000_000_000, 16, 10_000_000_000
_APART_NS = 2_000_000_000  # a hole, over which nothing is taken to go on


@dataclass(frozen=True)
class Pieces:
    """Pieces of ten seconds, as many in a row as in any other of the same length.

    Attributes:
        starts_ns: (P,) increasing.
    """

    starts_ns: IntArray

    @classmethod
    def of(cls, t_ns: IntArray) -> Pieces | None:
        """The pieces of a log; None if it is short, so that all of it is looked at.

        Args:
            t_ns: (N,) of its rows; a few may be garbled.
        """
        if not _grows(t_ns):
            t_ns = np.sort(t_ns[np.abs(t_ns) <= MAX_T_NS])
        rows = len(t_ns)
        if rows < _PIECES or t_ns[rows - 1 - rows // 100] - t_ns[rows // 100] <= _LONG_NS:
            return None
        starts_ns = t_ns[np.linspace(0, rows, _PIECES, endpoint=False).astype(np.int64)]
        kept = [int(starts_ns[0])]
        kept += [start for start in starts_ns.tolist() if start >= kept[-1] + _PIECE_NS]
        return cls(np.array(kept))

    def rows(self, t_ns: IntArray) -> tuple[IntArray, IntArray]:
        """Which rows of a table are in a piece, and their times (K,) with the pieces moved together.

        Args:
            t_ns: (N,) of its rows.
        """
        if _grows(t_ns):
            begin, end = np.searchsorted(t_ns, self.starts_ns), np.searchsorted(t_ns, self.starts_ns + _PIECE_NS)
            piece = np.repeat(np.arange(len(begin)), end - begin)
            rows = np.concatenate([np.arange(first, last) for first, last in zip(begin, end, strict=True)])
        else:
            piece = np.searchsorted(self.starts_ns, t_ns, side="right") - 1
            rows = np.flatnonzero((piece >= 0) & (t_ns - self.starts_ns[piece] < _PIECE_NS))
            piece = piece[rows]
        return rows, t_ns[rows] - self.starts_ns[piece] + piece * (_PIECE_NS + _APART_NS)


def _grows(t_ns: IntArray) -> bool:
    return bool((t_ns[1:] >= t_ns[:-1]).all())
