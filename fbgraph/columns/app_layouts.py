"""Apps and loggers whose columns mean something else than their names say: one entry an app.

Most apps need none: their names are plain. An entry is here where an app's ``Accelerometer`` has gravity removed, where
a tick has no unit in its name, where a chip's axes differ or where signs are those of iOS.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from fbgraph.columns.units import plain_text
from fbgraph.tables.table import Table

_ICM_20948 = (1, -1, -1)
_IOS = (-1, -1, -1)


@dataclass(frozen=True)
class Meaning:
    """What an app's column is.

    Attributes:
        name: a regular expression for the whole plain name; a group ``axis`` in it, if there are three.
        quantity: as in a ``Guess``.
        unit: a key of ``UNITS``; ``""`` if the app does not say.
        table: a regular expression that the table's plain name must match; ``""`` for any.
        grade, weight: as in a ``Guess``.
        axis: where the name has no letter for it.
    """

    name: str
    quantity: str
    unit: str = ""
    table: str = ""
    grade: str = ""
    weight: float = 0.95
    axis: str = ""


@dataclass(frozen=True)
class AppLayout:
    """How an app writes.

    Attributes:
        app: its name, for people.
        needs: regular expressions, each of which some column's plain name matches in whole.
        meanings: of the columns that the names do not tell.
        signs: of x, y, z, by quantity: what turns them into the axes of the accelerometer (a chip's magnetometer), or
            into Android's sign of gravity (an accelerometer at rest reads +1 g upwards).
    """

    app: str
    needs: tuple[str, ...]
    meanings: tuple[Meaning, ...] = ()
    signs: Mapping[str, tuple[int, int, int]] = field(default_factory=dict)


_AXIS = "(?P<axis>[xyz])"
LAYOUTS = (
    AppLayout(
        "Sensor Logger",
        needs=("time", "seconds_elapsed"),
        meanings=(
            Meaning("time", "time", "ns"),
            Meaning("seconds_elapsed", "time", "s"),
            Meaning(_AXIS, "linear_acc", "ms2", table="accelerometer"),
            Meaning(_AXIS, "acc", "ms2", table="totalacceleration"),
            Meaning(_AXIS, "acc", "", table="accelerometeruncalibrated", grade="uncalibrated"),  # g on iOS
            Meaning(_AXIS, "gravity", "ms2", table="gravity"),
            Meaning(_AXIS, "gyro", "rads", table="gyroscope"),
            Meaning(_AXIS, "gyro", "rads", table="gyroscopeuncalibrated", grade="uncalibrated"),
            Meaning(_AXIS, "mag", "ut", table="magnetometer"),
            Meaning(_AXIS, "mag", "ut", table="magnetometeruncalibrated", grade="uncalibrated"),
            Meaning("pressure", "pressure", "hpa"),
        ),
    ),
    AppLayout(
        "Physics Toolbox Sensor Suite",
        needs=("gfx", "gfy", "gfz"),
        meanings=(
            Meaning(f"gf{_AXIS}", "acc", "g"),
            Meaning(f"a{_AXIS}", "linear_acc", "ms2"),
            Meaning(f"w{_AXIS}", "gyro", "rads"),
            Meaning(f"b{_AXIS}", "mag", "ut"),
            Meaning("p", "pressure", "hpa"),
        ),
    ),
    AppLayout(
        "Physics Toolbox Sensor Suite",
        needs=("time", "a[xyz]", "at"),
        meanings=(Meaning(f"a{_AXIS}", "linear_acc", "ms2"),),
    ),
    AppLayout(
        "OpenLog Artemis",
        needs=("rtcdate|imu_degc|output_hz", "a[xyz]", "m[xyz]"),
        meanings=(
            Meaning(f"a{_AXIS}", "acc", "mg"),
            Meaning(f"g{_AXIS}", "gyro", "dps"),
            Meaning(f"m{_AXIS}", "mag", "ut"),
            Meaning("micros", "time", "us"),
        ),
        signs={"mag": _ICM_20948},
    ),
    AppLayout(
        "Xsens MT",
        needs=("packetcounter", "sampletimefine"),
        meanings=(
            Meaning("packetcounter", "counter"),
            Meaning("sampletimefine", "time", "100us"),
            Meaning(f"freeacc_{_AXIS}", "unknown"),  # in the world's frame
            Meaning(f"acc_{_AXIS}", "acc", "ms2"),
        ),
    ),
    AppLayout(
        "rostopic echo -p",
        needs=(r"(.*_)?linear_acceleration_x", r"(.*_)?angular_velocity_x"),
        meanings=(
            Meaning("time", "time", "ns"),
            Meaning(r"(.*_)?header_stamp", "time", "ns", weight=0.97),
            Meaning(rf"(.*_)?linear_acceleration_{_AXIS}", "acc", "ms2"),  # sensor_msgs/Imu keeps gravity
            Meaning(rf"(.*_)?angular_velocity_{_AXIS}", "gyro", "rads"),
        ),
    ),
    AppLayout(
        "rostopic echo -p",
        needs=(r"(.*_)?magnetic_field_x", r"(.*_)?header_stamp"),
        meanings=(
            Meaning("time", "time", "ns"),
            Meaning(r"(.*_)?header_stamp", "time", "ns", weight=0.97),
            Meaning(rf"(.*_)?magnetic_field_{_AXIS}", "mag", "t"),
        ),
    ),
    AppLayout(
        "a browser (DeviceMotion)",
        needs=("rotationrate_alpha|rotation_rate_alpha",),
        meanings=tuple(
            Meaning(f"rotation_?rate_{name}", "gyro", "dps", axis=axis)
            for name, axis in (("alpha", "x"), ("beta", "y"), ("gamma", "z"))
        ),
    ),
    AppLayout(
        "Core Motion (iOS)",
        needs=(r"rotation_?rate_?x", r"gravity_?x", r"user_?acc(eleration)?_?x"),
        signs=dict.fromkeys(("acc", "linear_acc", "gravity"), _IOS),
    ),
    AppLayout(
        "SensorLog (iOS)",
        needs=(r"accelerometeraccelerationx.*|motionuseraccelerationx.*", r"loggingtime.*|loggingsample.*"),
        signs=dict.fromkeys(("acc", "linear_acc", "gravity"), _IOS),
    ),
)
"""In the order in which they are tried."""

_SENSOR_LOGGER_SIGNED = ("acc", "linear_acc", "gravity")


def app_layout_of(table: Table) -> AppLayout | None:
    """The app that wrote a table with a header, by its columns; None if none of ``LAYOUTS`` did."""
    names = [flat_name(column.name) for column in table.columns]
    for layout in LAYOUTS:
        if all(any(re.fullmatch(need, name) for name in names) for need in layout.needs):
            return layout
    return None


def meaning_of(layout: AppLayout, table: str, name: str) -> tuple[Meaning, str] | None:
    """What a column of an app is, and its axis; None if its name says that itself.

    Args:
        layout: of the app.
        table: the table's name.
        name: the column's.
    """
    table, name = flat_name(table).replace("_", ""), flat_name(name)
    for meaning in layout.meanings:
        match = re.fullmatch(meaning.name, name)
        if match and re.fullmatch(meaning.table or ".*", table):
            return meaning, match.groupdict().get("axis") or ""
    return None


def signs_of(layout: AppLayout | None, quantity: str, tables: Sequence[Table]) -> tuple[int, int, int]:
    """What to multiply x, y, z by, so that an accelerometer at rest reads +1 g upwards and axes agree.

    Sensor Logger keeps the signs of the phone's system, which its ``Metadata`` names, unless it was told to
    standardise them.
    """
    if layout is None:
        return (1, 1, 1)
    if layout.app == "Sensor Logger" and quantity in _SENSOR_LOGGER_SIGNED:
        facts = metadata(tables)
        ios = facts.get("platform", "").lower() in ("ios", "ipados", "iphone", "watchos")
        return _IOS if ios and facts.get("standardisation", "false").lower() != "true" else (1, 1, 1)
    return layout.signs.get(quantity, (1, 1, 1))


def metadata(tables: Sequence[Table]) -> dict[str, str]:
    """What a table named ``Metadata`` says, in its first row, by its columns' names."""
    for table in tables:
        if table.name.lower() == "metadata" and len(table):
            return {column.name.strip().lower(): str(column.values[0]) for column in table.columns}
    return {}


def flat_name(name: str) -> str:
    """A name without units, in small letters and digits, joined by ``_``: ``AccX (m/s²)`` is ``accx``."""
    plain = re.sub(r"[(\[][^()\[\]]*[)\]]", " ", plain_text(name[:200])).lower()
    return re.sub(r"[^a-z0-9]+", "_", plain).strip("_")
