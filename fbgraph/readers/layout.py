"""How a log is laid out: which columns are which quantity, in which unit and along which axes, and what tells time.

A layout is what reading decides (``readers.decide``), what ``fbgraph inspect --write-layout`` writes as TOML, and what
``--layout FILE`` reads back for tables that explain themselves badly. Applied to tables it gives samples in SI.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tomli_w
from pydantic import Field, field_validator, model_validator

from fbgraph.columns.guesses import ClockKind
from fbgraph.core.bounded import CONFIG_BYTES, small_file
from fbgraph.core.config_text import parse_toml
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.core.sections import Section, validated
from fbgraph.core.whole_writes import whole_file

Name = Annotated[str, Field(max_length=300)]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
_CLOCK_COLUMNS = {"date_and_time": (2, 2), "hms": (3, 3), "samples": (0, 1)}
ANY = "*"
"""As the name of a table: the only one, whatever it is called."""
SAVED_LAYOUT = "layout.toml"
"""Beside the raw lines of a live walk: how they were read while it went on."""
AXES: tuple[Axis, Axis, Axis] = ("x", "y", "z")


class StreamLayout(Section):
    """Where the samples of one sensor are.

    Attributes:
        table: name of the table that holds them, ``*`` for the only one.
        columns: their names, x, y and z; ``#4`` is the fourth column, for tables without a header.
        unit: for people; what counts is ``scale``.
        scale: what a number is multiplied by: to m/s², rad/s, µT, hPa.
        axes: which of the columns, turned or not, points along the device's x, y and z: ``["x", "-y", "-z"]``.
        gravity: where gravity is, if it was taken out of these and is to be put back.
        repeats: whether it measures less often than there are rows, which repeat its last value; told by the values if
            nothing is said.
    """

    table: Name = ANY
    columns: Annotated[tuple[Name, ...], Field(min_length=1, max_length=3)]
    unit: Name = ""
    scale: Annotated[float, Field(gt=0.0, le=1e6)]
    axes: tuple[Axis, Axis, Axis] = AXES
    gravity: StreamLayout | None = None
    repeats: bool | None = None

    @field_validator("columns")
    @classmethod
    def _different(cls, columns: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(columns)) < len(columns):
            raise ValueError("one column for two axes")
        return columns

    @field_validator("axes")
    @classmethod
    def _each_once(cls, axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
        if {axis.removeprefix("-") for axis in axes} != set("xyz"):
            raise ValueError("each of x, y and z once, with or without a minus")
        return axes

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) signed permutation: what it makes of a column vector (x, y, z) is along the device's axes."""
        matrix = np.zeros((3, 3))
        for i, axis in enumerate(self.axes):
            matrix[i, "xyz".index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
        return matrix


class ClockLayout(Section):
    """What tells the time of a table's rows.

    Attributes:
        table: as of a stream.
        columns: names; one, or a date and a time of day. None for rows that are evenly spaced.
        kind: how they are to be read; ``samples`` counts rows or holds a sample counter.
        tick_ns: nanoseconds of one unit of a number.
        wrap: the counter starts again after so many ticks; 0 if it does not.
    """

    table: Name = ANY
    columns: Annotated[tuple[Name, ...], Field(max_length=3)] = ()
    kind: ClockKind = "ticks"
    tick_ns: Annotated[float, Field(gt=0.0, le=1e12)] = 1e9
    wrap: Annotated[int, Field(ge=0, le=2**62)] = 0

    @model_validator(mode="after")
    def _as_many_columns(self) -> ClockLayout:
        least, most = _CLOCK_COLUMNS.get(self.kind, (1, 1))
        if not least <= len(self.columns) <= most:
            raise ValueError(f"{self.kind} takes {least} columns, here are {len(self.columns)}")
        return self


class Layout(Section):
    """How a log is laid out; see the attributes of its parts.

    Attributes:
        app: what wrote it, if that is known: a name of ``fbgraph formats``.
        preset: of the configuration, for devices that are worn like this one.
        row_widths: numbers of fields that rows may have besides the header's, of a log whose rows leave out what a
            slow sensor did not measure anew.
        event: table and column of marks.
    """

    app: Name = "m5stickc"
    preset: Literal["phone", "m5stickc"] = "m5stickc"
    row_widths: tuple[int, ...] = ()
    acc: StreamLayout
    gyro: StreamLayout
    mag: StreamLayout | None = None
    pressure: StreamLayout | None = None
    event: tuple[Name, Name] | None = None
    clocks: Annotated[tuple[ClockLayout, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _three_axes(self) -> Layout:
        for name, stream in (("acc", self.acc), ("gyro", self.gyro), ("mag", self.mag), ("pressure", self.pressure)):
            wanted = 1 if name == "pressure" else 3
            if stream is not None and len(stream.columns) != wanted:
                raise ValueError(f"{name} takes {wanted} columns, here are {len(stream.columns)}")
        return self

    @property
    def streams(self) -> dict[str, StreamLayout]:
        """Those that are there, by quantity."""
        named = {"acc": self.acc, "gyro": self.gyro, "mag": self.mag, "pressure": self.pressure}
        return {name: stream for name, stream in named.items() if stream is not None}


def axes_of(rotation: FloatArray) -> tuple[Axis, Axis, Axis]:
    """Axes whose ``StreamLayout.rotation`` is this signed permutation (3, 3)."""
    names: dict[tuple[int, int], Axis] = {(i, s): a for s, some in ((1, _UP), (-1, _DOWN)) for i, a in enumerate(some)}
    x, y, z = (names[int(np.abs(row).argmax()), -1 if row.sum() < 0 else 1] for row in rotation)
    return x, y, z


_UP: tuple[Axis, Axis, Axis] = ("x", "y", "z")
_DOWN: tuple[Axis, Axis, Axis] = ("-x", "-y", "-z")


def read_layout(path: Path) -> Layout:
    """Read a layout file.

    Raises:
        ConfigError: it cannot be read, is not TOML, or says what no layout says, with its dotted path.
    """
    try:
        text = small_file(path, CONFIG_BYTES, "layout").decode("utf-8")
    except (DataError, UnicodeDecodeError) as error:
        raise ConfigError(f"--layout {path}: cannot be read ({error})") from error
    source = f"--layout {path}"
    keys = "`fbgraph inspect LOG --write-layout FILE` writes a layout with all keys"
    return validated(Layout, parse_toml(text, source), source, keys)


def layout_toml(layout: Layout) -> str:
    """A layout as TOML, as ``read_layout`` reads it."""
    return tomli_w.dumps(layout.model_dump(mode="json", exclude_none=True))


def keep_layout(layout: Layout, folder: Path) -> None:
    """Write a layout beside the raw lines that are read by it, whole or not at all."""
    with whole_file(folder / SAVED_LAYOUT) as partial:
        partial.write_text(layout_toml(layout), "utf-8")
