"""What the words of one column's name may mean, with the name of its table and its unit."""

from __future__ import annotations

from collections.abc import Iterator

from fbgraph.columns.name_words import Words
from fbgraph.columns.units import quantities_of, unit_of

VECTORS = ("acc", "linear_acc", "gravity", "gyro", "mag")
"""Quantities with three axes."""
TRUTH = {"x": "truth_x", "y": "truth_y", "z": "truth_z"}
_SURE, _LETTER, _PLACE, _UNIT_ONLY = 0.9, 0.7, 0.8, 0.6


def contradicts(written: str, quantity: str) -> bool:
    """Whether a unit is of another sensor than this quantity's."""
    others = quantities_of(written)
    metres = bool(unit_of(written, "altitude"))
    return bool(others and quantity not in others) or (metres and quantity in ("pressure", *VECTORS))


def quantities(words: Words, written: str, place: tuple[str, str]) -> Iterator[tuple[str, float, str]]:
    """What the words of a name may mean: quantity, weight and why (``{name}`` stands for it)."""
    roles = set(words.roles)
    by_unit = quantities_of(written)
    said = "named {name}"
    lonely = 1.0 if not words.strange else 0.9
    if not roles:
        yield from _by_place(words, by_unit, place, written)
        return
    if words.axis and unit_of(written, "truth_x") and not roles & {"norm", "velocity", *VECTORS}:  # p_RS_R_x [m]
        yield TRUTH[words.axis], 0.8, said
        return
    absolute = "pressure" in roles and "norm" in roles and not words.letters  # an absolute pressure is one
    if roles & {"norm", "interval", "derived", "velocity"} and not roles & {"angular", "rate"} and not absolute:
        if "accuracy" in roles:
            yield "accuracy", 0.2, said
            return
        if "norm" not in roles or not words.axis:
            what = sorted(roles & {"norm", "interval", "derived", "velocity"})[0]
            yield "unknown", _SURE, f"{said}: {'a norm' if what == 'norm' else 'no measurement of a sensor'}"
            return
    if "accuracy" in roles:
        yield "accuracy", 0.2 if roles & {"vertical", "orientation"} else _SURE if "location" in roles else 0.7, said
    elif words.letters >= {"mag"} and len(roles & {"acc", "gyro", "mag"}) > 1 and len(words.letters) > 1:
        yield "unknown", _SURE, f"{said}: a bias"
    elif "time" in roles and not words.axis:
        letter = "time" in words.letters
        if letter and unit_of(written, "temperature"):
            yield "temperature", _SURE, said
        elif "location" in roles or (roles & {"lat", "lon"}):
            yield "time", 0.3, f"{said}: the time of another sensor"
        elif words.digits and letter:
            yield "unknown", 0.3, said
        else:
            sensors = roles & {"acc", "gyro", "mag", "pressure", "altitude", "orientation", "temperature", "event"}
            weight = {"acc": 0.86, "gyro": 0.82}.get(min(sensors, default=""), 0.5 if sensors else _SURE)
            yield "time", (_LETTER if letter else weight) * lonely, said
    else:
        yield from _sensors(words, roles, by_unit, written, place, lonely)


def _by_place(
    words: Words, by_unit: tuple[str, ...], place: tuple[str, str], written: str
) -> Iterator[tuple[str, float, str]]:
    """A name without a word for its sensor (``X (m/s^2)``): the table's name or the unit tells."""
    alone = words.axis or not words.strange
    if place[0] in VECTORS and words.axis:
        yield place[0], _PLACE, "{name} of the table of that sensor"
    elif place[0] == "pressure" and alone and (not written or "pressure" in by_unit):
        yield "pressure", _PLACE if by_unit else 0.5, "{name} of the table of that sensor"
    elif words.axis and by_unit:
        yield by_unit[0], _UNIT_ONLY, "the unit of {name}"
    elif unit_of(written, "temperature") and len(written) > 1 and not words.axis:
        yield "temperature", 0.5, "the unit of {name}"
    elif words.axis and unit_of(written, "truth_x"):
        yield TRUTH[words.axis], 0.4, "the unit of {name}"


def _sensors(
    words: Words, roles: set[str], by_unit: tuple[str, ...], written: str, place: tuple[str, str], lonely: float
) -> Iterator[tuple[str, float, str]]:
    said = "named {name}"
    letter = _LETTER * lonely if words.letters else _SURE * lonely
    turning = (
        roles & {"gyro", "angular"} or {"rotation", "rate"} <= roles or ("rotation" in roles and "gyro" in by_unit)
    )
    if "truth" in roles or ("location" in roles and words.axis and not by_unit):
        if words.axis:
            yield TRUTH[words.axis], 0.8, said
        elif "altitude" in roles:
            yield "height", 0.6, said
        return
    if "altitude" in roles and "pressure" not in by_unit:
        yield ("height" if "location" in roles or place[0] == "location" else "altitude"), 0.8, said
    elif roles & {"lat", "lon"}:
        yield ("lat" if "lat" in roles else "lon"), _SURE, said
    elif "orientation" in roles and not (turning and words.axis and "orientation" not in words.letters):
        yield "orientation", _SURE, said
        if words.axis and "mag" in by_unit:
            yield "mag", 0.3, "the unit of {name}"
    elif "gravity" in roles and ("acc" not in roles or not roles & {"include", "exclude"}):
        yield "gravity", _SURE * lonely, said
    elif "linear" in roles or ("acc" in roles and {"exclude", "gravity"} <= roles) or {"acc", "exclude"} <= roles:
        yield "linear_acc", _SURE * lonely, said
    elif turning:
        yield from _gyro_or_gravity(words, letter, written)
    elif roles & {"acc", "gyro"} and "mag" in roles and not words.axis:
        yield "unknown", _SURE, f"{said}: a norm"
    elif "acc" in roles:
        yield "acc", letter, said
    elif "mag" in roles:
        yield "mag", letter * (0.9 if words.letters else 1.0), said
    elif "pressure" in roles:
        if "pressure" in words.letters and "pressure" not in by_unit:
            yield "orientation", 0.45, "named {name}, perhaps pitch"
            yield "pressure", 0.4, said
        else:
            yield "pressure", _SURE * lonely, said
    else:
        yield from _the_rest(words, roles, written, lonely)


def _gyro_or_gravity(words: Words, letter: float, written: str) -> Iterator[tuple[str, float, str]]:
    """``gx`` is the gyroscope's of an M5StickC, and gravity's of some phones."""
    if words.letters and unit_of(written, "acc"):
        yield "gravity", 0.5, "named {name}, with a unit of acceleration"
        yield "acc", 0.45, "named {name}, with a unit of acceleration"
        return
    yield "gyro", letter, "named {name}"
    if words.letters and words.roles == ("gyro",):
        yield "gravity", 0.2, "named {name}, perhaps gravity"


def _the_rest(words: Words, roles: set[str], written: str, lonely: float) -> Iterator[tuple[str, float, str]]:
    said = "named {name}"
    strange = bool(words.strange)
    if "temperature" in roles:
        yield "temperature", _SURE, said
    elif "event" in roles and not strange:
        yield "event", _SURE, said
    elif "second" in roles and not roles - {"second", "counter"} and not strange:
        yield "time", _SURE if "counter" not in roles else 0.6, said
    elif "counter" in roles and not roles - {"counter", "device", "second"} and not strange:
        yield ("device" if "device" in roles and "counter" in roles else "counter"), _SURE, said
    elif "date" in roles:
        yield "date", 0.5, said
    elif "device" in roles:
        yield "device", 0.8, said
    elif words.axis and (units := quantities_of(written)):
        yield units[0], _UNIT_ONLY * lonely, "the unit of {name}"
    else:
        yield "unknown", 0.5, said


def grade_of(words: Words, quantity: str) -> str:
    """Whether a name says ``raw``, ``uncalibrated`` or ``filtered``; ``""`` if not, or if that is no sensor's."""
    if quantity not in (*VECTORS, "pressure"):
        return ""
    roles = set(words.roles)
    if "raw" in roles or "counter" in roles:
        return "raw"
    return "uncalibrated" if "uncal" in roles else "filtered" if "filtered" in roles else ""


def sensor_of(words: Words, quantity: str) -> str:
    """Which device: the words and digits of a name that say nothing else."""
    return " ".join((*words.strange, *words.digits)) if quantity in VECTORS or quantity == "pressure" else ""
