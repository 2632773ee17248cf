"""How a log was read, and why: what ``fbgraph inspect`` shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from fbgraph.columns.clock_times import Clock
from fbgraph.columns.guesses import Chosen, Guess
from fbgraph.physics.judgement import Judged, Judgement
from fbgraph.readers.layout import Layout
from fbgraph.tables.table import Table

SENSOR_NAMES = {"acc": "accelerometer", "gyro": "gyroscope", "mag": "magnetometer", "pressure": "barometer"}
"""By quantity."""


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

    @property
    def assumed(self) -> tuple[str, ...]:
        """What neither names nor physics told, in a few words each."""
        found = []
        for name, stream in self.layout.streams.items():
            judgement: Judgement | None = getattr(self.judged, name)
            if judgement is None or judgement.sure:
                continue
            what = "unit" if judgement.straight and judgement.by == "assumed" else "axes"
            told = stream.unit if what == "unit" else " ".join(stream.axes)
            found.append(f"{SENSOR_NAMES[name]} {what} {told}")
        judged = (self.judged.acc, self.judged.gyro, self.judged.mag)
        if not self.judged.axes_told and any(one is not None and one.by != "name" for one in judged):
            found.append("axes as named")  # a log whose names say everything else is believed in that too
        return (*found, *(f"clock {clock.why}" for clock in self.clocks.values() if clock.text and not clock.columns))

    def noted(self) -> dict[str, Any]:
        """For ``summary.json``: of each sensor table, columns, unit and axes; the clocks; what was assumed."""
        judgements = {name: getattr(self.judged, name) for name in self.layout.streams}
        sensors = {
            name: {
                "table": stream.table,
                "columns": list(stream.columns),
                "unit": stream.unit,
                "scale": stream.scale,
                "axes": list(stream.axes),
                "by": "name" if judgements[name] is None else judgements[name].by,
                "sure": judgements[name] is None or judgements[name].sure,
            }
            for name, stream in self.layout.streams.items()
        }
        return {
            "sensors": sensors,
            "clocks": [clock.model_dump(mode="json") for clock in self.layout.clocks],
            "assumed": list(self.assumed),
            "notes": list(self.notices),
        }

    @classmethod
    def as_told(cls, tables: Sequence[Table], layout: Layout) -> Reading:
        """Nothing is decided where a layout says everything."""
        named = Judgement(1.0, "", "name", True)
        return cls(layout, tuple(() for _ in tables), Chosen({}), Judged(named, named))
