"""Units in which sensors are logged: how people write them, and what they are in SI.

A unit belongs to a quantity: ``mg`` is a thousandth of g for an accelerometer and a milligauss for a magnetometer.
"""

from __future__ import annotations

import re
import unicodedata

from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2

_ACC = {"g": STANDARD_GRAVITY_M_S2, "mg": STANDARD_GRAVITY_M_S2 / 1000.0, "ms2": 1.0, "cms2": 0.01}
_METRES = {"m": 1.0, "ft": 0.3048}
UNITS: dict[str, dict[str, float]] = {
    "acc": _ACC,
    "linear_acc": _ACC,
    "gravity": _ACC,
    "gyro": {"dps": DEGREE_RAD, "mdps": DEGREE_RAD / 1000.0, "rads": 1.0, "mrads": 1e-3},
    "mag": {"ut": 1.0, "nt": 1e-3, "mt": 1e3, "t": 1e6, "mgauss": 0.1, "gauss": 100.0},
    "pressure": {"hpa": 1.0, "pa": 0.01, "kpa": 10.0, "bar": 1000.0, "mmhg": 1.33322387415, "inhg": 33.8638866667},
    "temperature": {"c": 1.0},
    "altitude": _METRES,
    "height": _METRES,
    "accuracy": _METRES,
    "truth_x": _METRES,
    "truth_y": _METRES,
    "truth_z": _METRES,
    "time": {"s": 1e9, "ms": 1e6, "100us": 1e5, "us": 1e3, "ns": 1.0, "min": 60e9, "h": 3600e9, "day": 86400e9},
}
"""Factors to SI by quantity and unit (magnetic field to µT, pressure to hPa, time to nanoseconds, temperature °C)."""

SHOWN = {
    **{"ms2": "m/s²", "cms2": "cm/s²", "dps": "°/s", "mdps": "m°/s", "rads": "rad/s", "mrads": "mrad/s"},
    **{"ut": "µT", "nt": "nT", "mt": "mT", "t": "T", "gauss": "gauss", "mgauss": "milligauss"},
    **{"hpa": "hPa", "pa": "Pa", "kpa": "kPa", "mmhg": "mmHg", "inhg": "inHg", "c": "°C"},
    **{"us": "µs", "100us": "0.1 ms"},
}
"""Units as people write them, where they are not written as in ``UNITS``."""

_SPELLINGS = {
    "acc": {
        "g": "g gs gn g0 gforce gforces gunit gunits standardgravity earthg",
        "mg": "mg mgs mgn millig milligs mgforce",
        "ms2": "ms2 mss mps2 mpss mpersec2 mpers2 msec2 msecsec metersec2 meterspersecondsquared meterpersecondsquared"
        " metrespersecondsquared metersecond2 meterssecond2 ms? msq metreperseconds2 mpersecondsquared",
        "cms2": "cms2 gal gals",
    },
    "gyro": {
        "dps": "dps degs degps degsec degsecond degpersec degpers degpersecond degreess degreessec degreessecond"
        " degreessecs degreespersecond degreepersecond degreespersec degrees_s degrees1 degs1 ?s grads gradsek grads1",
        "mdps": "mdps mdegs mdegsec millidps millidegs millidegreespersecond",
        "rads": "rads radps radsec radsecond radpersec radpers radpersecond radianss radianssec radianssecond"
        " radianspersecond radianpersecond radians1 rads1 radsek",
        "mrads": "mrads mradsec mradps milliradpersec",
    },
    "mag": {
        "ut": "ut utesla utes microt microtesla microteslas mikrotesla ?t",
        "nt": "nt ntesla nanot nanotesla nanoteslas",
        "mt": "mt mtesla millit millitesla milliteslas",
        "t": "t tesla teslas",
        "gauss": "g gs gauss ga gau",
        "mgauss": "mg mgs mgauss mga mgau milligauss",
    },
    "pressure": {
        "hpa": "hpa mbar mb millibar millibars hectopascal hectopascals",
        "pa": "pa pascal pascals",
        "kpa": "kpa kilopascal kilopascals",
        "bar": "bar bars",
        "mmhg": "mmhg torr",
        "inhg": "inhg",
    },
    "temperature": {"c": "c degc celsius degcelsius degreescelsius deg grad ?c ?"},
    "altitude": {"m": "m meter meters metre metres", "ft": "ft feet foot"},
    "time": {
        "s": "s sec secs second seconds sek sekunde sekunden seg segundos secondes secondi",
        "ms": "ms msec msecs millis millisec millisecs millisecond milliseconds millisekunden"
        " milisegundos millisecondes",
        "us": "us usec usecs micros microsec microsecs microsecond microseconds mikrosekunden microsegundos",
        "ns": "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds nanosekunden",
        "min": "min mins minute minutes minuten",
        "h": "h hr hrs hour hours stunden",
        "day": "day days tage",
    },
}
_KEYS = {
    quantity: {word: unit for unit, words in spellings.items() for word in words.split()}
    for quantity, spellings in _SPELLINGS.items()
}
_KEYS |= dict.fromkeys(("linear_acc", "gravity"), _KEYS["acc"])
_KEYS |= dict.fromkeys(("height", "accuracy", "truth_x", "truth_y", "truth_z"), _KEYS["altitude"])
_OTHER = (
    "txt text n r z wgs84 bool i lux lx % db cm mm km kmh kms km/h mps m/s ms-1 ms1 deg rad degrees radians v mv hz khz"
    " az azimuth° a.u. au w/m2 rpm cd j kg"
)
_NO_UNITS = frozenset(re.sub(r"[^a-z0-9%]", "", word) for word in _OTHER.split()) | {""}
_GREEK = str.maketrans({"μ": "u", "ʯ": "u", "ω": "w", "º": "°", "˚": "°", "′": "'"})


def plain_text(text: str) -> str:
    """Text without accents, superscripts, Greek letters and the damage of a wrong encoding, in the case it had.

    ``µ`` is ``u``, ``°`` is ``deg``, ``²`` is ``2``, ``é`` is ``e``.
    """
    if text.isascii():
        return text
    for damaged, whole in (("Â", ""), ("Î¼", "u"), ("Ã©", "e"), ("º", "°"), ("\ufffd", "?")):
        text = text.replace(damaged, whole)
    text = unicodedata.normalize("NFKD", unicodedata.normalize("NFKC", text).translate(_GREEK))
    text = "".join(c for c in text if not unicodedata.combining(c))
    return text.translate(_GREEK).replace("°", "deg").replace("−", "-").replace("ß", "ss")


def unit_of(text: str, quantity: str) -> str:
    """The unit of ``quantity`` that a text names, a key of ``UNITS[quantity]``; ``""`` if it names none of it."""
    squashed = _squashed(text)
    if quantity == "time" and "/" in text:  # m/s is no millisecond
        return ""
    return _KEYS.get(quantity, {}).get(squashed, "")


def is_unit(text: str) -> bool:
    """Whether a text names the unit of anything that people log, or says that there is none (``txt``, ``N``)."""
    squashed = _squashed(text)
    return squashed in _NO_UNITS or any(squashed in keys for keys in _KEYS.values())


def quantities_of(text: str) -> tuple[str, ...]:
    """The quantities of the inertial sensors, the magnetometer and the barometer that are measured in a unit."""
    return tuple(quantity for quantity in ("acc", "gyro", "mag", "pressure") if unit_of(text, quantity))


def shown(unit: str) -> str:
    """A unit as people write it."""
    return SHOWN.get(unit, unit)


def _squashed(text: str) -> str:
    plain = plain_text(text).lower().replace("**", "")
    return re.sub(r"[^\w%?]|_", "", plain)
