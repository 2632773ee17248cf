"""Records: what a column may be, and which columns a log is read from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

ClockKind = Literal["ticks", "days", "stamps", "date_and_time", "time_of_day", "hms", "samples"]
"""How a clock is read: see ``columns.clock_times.Clock``."""


@dataclass(frozen=True)
class Guess:
    """What a column may be.

    Attributes:
        column: its place in the table.
        quantity: ``acc``, ``linear_acc`` (gravity removed), ``gravity``, ``gyro``, ``mag``, ``pressure``,
            ``temperature``, ``altitude``, ``event``, ``counter``, ``date``, ``time``, ``time_of_day``, ``lat``,
            ``lon``, ``height``, ``accuracy``, ``truth_x``, ``truth_y``, ``truth_z``, ``orientation``,
            ``device`` or ``unknown``.
        axis: ``x``, ``y``, ``z`` or ``""``.
        unit: a key of ``UNITS[quantity]``, from this column's own name, row of units or app; ``""`` if nothing says it.
        sensor: which of several devices; ``""`` is usual.
        weight: 0 to 1.
        why: for people.
        grade: ``""``, ``raw`` (counts), ``uncalibrated`` or ``filtered``.
    """

    column: int
    quantity: str
    axis: str
    unit: str
    sensor: str
    weight: float
    why: str
    grade: str = ""


@dataclass(frozen=True)
class Pick:
    """Columns that are used for a quantity.

    Attributes:
        quantity: as in a ``Guess``.
        table: place among the tables.
        columns: three, as x, y, z, or one.
        unit: a key of ``UNITS[quantity]``; ``""`` where none is named or the three name different ones.
        sensor: which of several devices.
        grade: as in a ``Guess``.
        signs: what to multiply the columns by, for the axes of the accelerometer and Android's sign of gravity; what
            the app is known to need, which physics may find otherwise.
        weight: of the least sure column.
        why: for people.
    """

    quantity: str
    table: int
    columns: tuple[int, ...]
    unit: str
    sensor: str
    grade: str
    signs: tuple[int, ...]
    weight: float
    why: str


@dataclass(frozen=True)
class Chosen:
    """What a log is read from.

    Attributes:
        picks: by quantity. ``linear_acc`` and ``gravity`` are here only where no accelerometer with gravity is: their
            sum is one, if both are here.
        passed_over: what could have been used, each with the reason.
        notes: what people should know of the choice.
        apps: that wrote the tables in use.
    """

    picks: Mapping[str, Pick]
    passed_over: tuple[tuple[Pick, str], ...] = ()
    notes: tuple[str, ...] = ()
    apps: tuple[str, ...] = ()
