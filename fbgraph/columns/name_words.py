"""The words of a column's name: what each of them says about what was measured.

Names are cut where people cut them (``AccX_ms2``, ``gyroRotationX(rad/s)``, ``xacc``, ``lineareBeschleunigung``) and
each word is looked up; a word that nobody knows stays as it is.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from fbgraph.columns.units import is_unit, plain_text, unit_of

AXES = "xyz"
_VOCABULARY = {
    "acc": "acc acce accs accel accels accelero acceleration accelerations accelerometer accelerometre acceler"
    " beschleunigung beschleunigungssensor beschleunigungen aceleracion acelerometro aceleracao accelerazione"
    " accelerometro versnelling versnellingsmeter acceleracio 加速度 加速度计 加速度センサ"
    " accl specificforce gforce gf adxl345 lis3dh bma400",
    "gyro": "gyr gyro gyros gyroscope gyroscopes gyroskop giroscopio giroscopo gyroscoop giro drehrate omega"
    " winkelgeschwindigkeit drehgeschwindigkeit rotationrate angularvelocity angularrate angvel angrate 角速度 陀螺仪"
    " gir gyrosc as",
    "mag": "mag magn magnet magneto magnetic magnetom magnetometer magnetometre magnetfeld magnetfeldsensor magnetisch"
    " magnetique magnetico magnetometro compass kompass bussola bmm150 ak8963 qmc5883l hmc5883l magf magfield"
    " 磁场 地磁 磁場 磁力计",
    "pressure": "pres press pressure baro barom bar barometer barometric barometre luftdruck druck drucksensor pression"
    " presion pressione pressao barometro luchtdruk 气压 気圧 bmp bmp180 bmp280 bmp380 bmp388 bmp390 qmp6988 bme280"
    " bme680 ms5611 lps22hb dps310 spl06 prs atmospheric atm",
    "temperature": "temp temperature temperatur temperatura tmp 温度",
    "gravity": "grav gravity gra schwerkraft gravitation erdbeschleunigung gravite gravedad gravita gravidade 重力",
    "linear": "linear lin lineare linearer lineal lineaire linacc linacce linaccel lacc lac laccel useracc user free"
    " linearacceleration linearaccelerometer dynamic userdata netacc",
    "include": "including includes include incl with mit avec con inkl",
    "exclude": "excluding exclude excl without ohne sans sin minus removed compensated no",
    "total": "total tot gesamt",
    "rotation": "rotation rot turn",
    "rate": "rate rates",
    "angular": "angular winkel angulaire angolare hoek",
    "velocity": "velocity vel speed velocite velocidad velocita vitesse geschwindigkeit shift snelheid"
    " displacement jerk",
    "orientation": "roll pitch yaw euler quat quaternion quaternions qw qx qy qz q0 q1 q2 q3 azimuth heading attitude"
    " orientation angle angles ang rv rotvec course bearing tilt inclination ori rpy game lage orientierung direction"
    " 角度 四元数 declination",
    "time": "time times timestamp timestamps timestampe ts stamp clock epoch epoc unix utc zeit zeitstempel temps"
    " tiempo tempo"
    " tijd 时间 時間 gpst tow uptime elapsed datetime rtc chiptime hora uhrzeit heure ora 片上时间 timecode",
    "second": "s sec secs seconds second millis millisecond milliseconds ms msec micros microsecond"
    " microseconds us usec"
    " nanos nanosecond nanoseconds ns nsec sekunden millisekunden sek since",
    "date": "date datum fecha 日期",
    "interval": "dt delta diff interval duration period deltat timedelta dauer lag latency offset",
    "counter": "i n idx index iterator iter count counter seq sequence sample sampleid packet packetcounter frame row"
    " no nr num number id line samples pkt nummer",
    "event": "event button btn mark marker annotation ereignis taste lap",
    "device": "device sensor mac address name addr node host child",
    "lat": "lat latitude breitengrad breite latitud latitudine",
    "lon": "lon lng long longitude langengrad laenge lange longitud longitudine",
    "altitude": "alt altitude height hohe hoehe altitud altezza hauteur elevation ele altimeter relativealtitude",
    "location": "location gps gnss loc position fix satellite satellites sats nmea horizontal hdop pdop vdop"
    " wifi wlan bluetooth cell",
    "accuracy": "accuracy genauigkeit uncertainty precision",
    "vertical": "vertical vertikal verticale",
    "derived": "bias drift var variance cov covariance std stddev stdev sigma noise error err confidence status flag"
    " mean average avg min max fft freq frequency hz khz range sensitivity scale gain median mode light lux"
    " proximity prox"
    " sound battery voltage humidity steps step activity label class segment trial session subject quality"
    " reset intensity strength power energy inertial calibration",
    "norm": "abs absolute norm magnitude resultant rms modulus sum svm vm length betrag at tgf gforces"
    " amplitude absolut"
    " magnitud modul valeur",
    "raw": "raw lsb counts adc unscaled rohdaten roh digit digits",
    "uncal": "uncal uncalibrated uncalib unkalibriert",
    "filtered": "filtered filt smooth smoothed lp hp lowpass highpass lpf hpf kalman gefiltert",
    "truth": "truth gt pos groundtruth vicon mocap pose utm east north easting northing vio tango",
    "filler": "value values data field champ campo realtime imu body measurement"
    " logging motion in of the from start value reading component"
    " axis rs cal calibrated corrected calib wert richtung achse dir along nach fine coarse android"
    " type get phone world sdk reboot boot local unit und and del de der du log m5 stick ahrs mpu chip",
}
_SINGLE = {
    **{"a": "acc", "g": "gyro", "w": "gyro", "m": "mag", "b": "mag", "h": "mag", "p": "pressure", "t": "time"},
    **{"r": "orientation", "q": "orientation", "v": "velocity", "e": "orientation"},
}
ROLES = {word: role for role, words in _VOCABULARY.items() for word in words.split()}
_SHORT = "as at no id in of ts dt sin con the mit user start long min bar ang rot game body"  # parts of other words
_NEVER_PART = frozenset(_SHORT.split())
_BRACKETS = re.compile(r"[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
_RAW_WORDS = re.compile(r"[^\W_]+")
_CAMEL = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|\d+|[^\WA-Za-z\d_]+")
_MOST_WORD = 40


@dataclass(frozen=True)
class Words:
    """A name, taken apart.

    Attributes:
        roles: what its words are about, in their order (``acc``, ``raw``); without its axis and without filling words.
        letters: the roles that a single letter gave.
        axis: ``x``, ``y``, ``z`` or ``""``.
        digits: numbers in it, by which axes or sensors are counted.
        strange: words that say nothing to anybody but who wrote them.
        unit: what stands in brackets or after the axis like a unit, as written; ``""`` if nothing.
    """

    roles: tuple[str, ...]
    letters: frozenset[str]
    axis: str
    digits: tuple[str, ...]
    strange: tuple[str, ...]
    unit: str


@lru_cache(maxsize=10_000)
def words_of(name: str) -> Words:
    """The words of a column's or table's name."""
    text = plain_text(name[:200])
    units: list[str] = []

    def bracket(match: re.Match[str]) -> str:
        if is_unit(match[1]):
            units.append(match[1])
            return " "
        return f" {match[1]} "

    text = _BRACKETS.sub(bracket, text)
    raw = _RAW_WORDS.findall(text)
    words = [part for word in raw for part in _parts(word[:_MOST_WORD], len(raw))]
    axes = [word for word in words if word in AXES]
    axis = axes[-1] if axes and len(set(axes)) == 1 else ""
    rest = [word for word in words if word not in AXES or not axis]
    known, unit = _without_unit(rest)
    roles, letters, digits, strange = [], set(), [], []
    for word in known:
        word = word.removesuffix("_")
        role = ROLES.get(word) or _SINGLE.get(word, "")
        if word.isdecimal():
            digits.append(word)
        elif role == "filler":
            continue
        elif role:
            roles.append(role)
            if len(word) == 1 and word in _SINGLE:
                letters.add(role)
        else:
            strange.append(word)
    return Words(tuple(roles), frozenset(letters), axis, tuple(digits), tuple(strange), units[0] if units else unit)


def _without_unit(words: list[str]) -> tuple[list[str], str]:
    """The words before those at the end that are a unit (``m s2``), and that unit."""
    for size in (3, 2, 1) if not words[-1:] or not words[-1].endswith("_") else ():
        unit = "".join(words[-size:])
        single = len(unit) == 1 and unit not in "gsmc"
        if len(words) > size and not unit.isdecimal() and not single and _names_unit(unit):
            return words[:-size], unit
    return words, ""


def _names_unit(unit: str) -> bool:
    quantities = ("acc", "gyro", "mag", "pressure", "time", "temperature", "altitude")
    return unit not in ("min", "day", "grad") and any(unit_of(unit, quantity) for quantity in quantities)


def _parts(word: str, among: int) -> list[str]:
    """The words that one without blanks is made of, in small letters."""
    lower = word.lower()
    if lower == "hz" and among > 1:  # alone it is the z of the field's strength H
        return ["freq"]
    if lower[:-1] == "gf" and lower[-1] in AXES:
        return ["gf", lower[-1]]
    if lower in ROLES or lower in AXES or lower.isdecimal() or is_unit(lower):
        return _pair(lower) if _LETTER_AXIS.fullmatch(lower) else [lower]
    camel = [part.lower() for part in _CAMEL.findall(word)]
    if len(camel) > 1 and all(_known(part) for part in camel):
        return [small for part in camel for small in _letter_axis(part, len(camel))]
    if cut := _cut(lower):
        return cut
    if re.fullmatch(r"[a-z]+\d\w*", lower) and not any(_known(part) for part in camel):  # the name of a chip
        return [lower]
    return [small for part in camel for small in (_cut(part) or [part])]


_LETTER_AXIS = re.compile(r"[agwmbhpqvrf][xyz]")


def _pair(word: str) -> list[str]:
    """The letter of a sensor, marked so that it is taken for no unit, and its axis."""
    return [f"{word[0]}_", word[1]]


def _letter_axis(word: str, among: int) -> list[str]:
    """``ax`` is the x of a; but the gy of ``GyX`` is a sensor, as another word is its axis."""
    if word == "gy" and among > 1:
        return ["gyro"]
    if word in ROLES or word in AXES or is_unit(word):
        return [word]
    return _cut(word) or [word]


def _known(part: str) -> bool:
    return part in ROLES or part in _SINGLE or part in AXES or part.isdecimal() or is_unit(part) or bool(_cut(part))


@lru_cache(maxsize=10_000)
def _cut(word: str) -> list[str]:
    """A word without blanks or capitals, cut into known ones: as few as possible; nothing if it cannot be."""
    if not word or len(word) > _MOST_WORD:
        return []
    if _LETTER_AXIS.fullmatch(word):
        return _pair(word)
    if match := re.fullmatch(r"([agwmbh])([xyz])_?(\d+)", word):
        return [*_pair(match[1] + match[2]), match[3]]
    if word == "ac":
        return ["acc"]
    best: dict[int, list[str]] = {0: []}
    for end in range(1, len(word) + 1):
        for start in sorted(best):
            piece = word[start:end]
            if end > start and _piece(piece, start == 0, end == len(word), word):
                found = [*best[start], piece]
                if end not in best or len(found) < len(best[end]):
                    best[end] = found
    parts = best.get(len(word), [])
    return parts if any(part in ROLES and len(part) > 2 for part in parts) else []


def _piece(piece: str, first: bool, last: bool, word: str) -> bool:
    if piece in AXES:
        return first or last
    if piece.isdecimal():
        return True
    if piece == "g":
        return last and not first
    if piece in _NEVER_PART:
        return False
    return (len(piece) > 2 and piece in ROLES) or (not first and last and len(piece) > 1 and _names_unit(piece))
