"""How a log was read, and why: what ``fbgraph inspect`` shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from fbgraph.columns.clock_times import Clock
from fbgraph.columns.guesses import Chosen, Guess
from fbgraph.physics.judgement import Judged, Judgement
from fbgraph.readers.layout import Layout
from fbgraph.tables.table import Table


@dataclass(frozen=True)
class Reading:
    """How a log was read, and why.

    Attributes:
        layout: what was decided.
        guesses: of each table, what its columns may be.
        chosen: which of them are used.
        judged: units, signs and axes by physics.
        clocks: of each table in use, by its place.
        notices: what people should know.
    """

    layout: Layout
    guesses: tuple[tuple[Guess, ...], ...]
    chosen: Chosen
    judged: Judged
    clocks: Mapping[int, Clock] = field(default_factory=dict)
    notices: tuple[str, ...] = ()

    @property
    def sure(self) -> bool:
        """Whether nothing was left to assume, so that more of the log would decide no otherwise."""
        found = (self.judged.acc, self.judged.gyro, self.judged.mag, self.judged.pressure)
        return self.judged.axes_told and all(judgement is None or judgement.sure for judgement in found)

    @classmethod
    def as_told(cls, tables: Sequence[Table], layout: Layout) -> Reading:
        """Nothing is decided where a layout says everything."""
        named = Judgement(1.0, "", "name", True)
        return cls(layout, tuple(() for _ in tables), Chosen({}), Judged(named, named))
