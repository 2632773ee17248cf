"""Which field of a CSV line is what, in which unit: for files and for lines that arrive one at a time.

Columns may come in any order and under the names that sketches use: a word for the sensor (``a acc accel…``,
``g gyr gyro…``, ``m mag…``, ``p pres pressure baro…``), the axis, and perhaps the unit (``AccX_ms2``, ``gyro_z``,
``GX``, ``p_pa``); time is ``t…``, ``time…``, ``timestamp…``, ``seconds``, ``millis`` and the like. What a name leaves
open is judged by magnitude and said in a notice. Without a time column samples are taken to be 1/50 s apart, counted by
the sample counter (``SampleID``, ``n``, ``iterator``) if there is one.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from itertools import repeat
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.core.bounded import MOST_COLUMNS
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray, IntArray
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from fbgraph.readers.cleaning import LIMITS, MAX_T_NS, to_ns

ASSUMED_RATE_HZ = 50
CANONICAL = "t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa,temp_c,event"

UNITS: dict[str, dict[str, float]] = {  # to SI; time to nanoseconds; as plain names without "_"
    "acc": {"g": STANDARD_GRAVITY_M_S2, "mg": STANDARD_GRAVITY_M_S2 / 1000.0, "ms2": 1.0, "mss": 1.0, "mps2": 1.0},
    "gyro": {
        "dps": DEGREE_RAD,
        "degs": DEGREE_RAD,
        "degsec": DEGREE_RAD,
        "mdps": DEGREE_RAD / 1000.0,
        "rads": 1.0,
        "radsec": 1.0,
    },
    "mag": {"ut": 1.0, "nt": 1e-3, "mg": 0.1, "mgauss": 0.1, "gauss": 100.0},
    "pressure": {"hpa": 1.0, "mbar": 1.0, "pa": 0.01, "kpa": 10.0},
    "time": {"s": 1e9, "sec": 1e9, "secs": 1e9, "second": 1e9, "seconds": 1e9}
    | {"ms": 1e6, "msec": 1e6, "millis": 1e6, "milliseconds": 1e6}
    | {"us": 1e3, "usec": 1e3, "micros": 1e3, "microseconds": 1e3, "ns": 1.0, "nanoseconds": 1.0},
}
_NAMES = {
    sensor: re.compile(pattern)
    for sensor, pattern in {
        "acc": r"(?:a|acc(?:e|el|eleration|elerometer)?)_?(?P<axis>[xyz])(?:_(?P<unit>\w+))?",
        "gyro": r"(?:g|gy|gyr|gyro|gyroscope)_?(?P<axis>[xyz])(?:_(?P<unit>\w+))?",
        "mag": r"(?:m|mag(?:n|net|netic|netometer)?)_?(?P<axis>[xyz])(?:_(?P<unit>\w+))?",
        "pressure": r"(?:p|pres|press|pressure|baro|barometer|bmp280|qmp6988)(?:_(?P<unit>\w+))?",
        "time": rf"(?:time_?(?:stamp)?|ts|t|elapsed|uptime|epoch)?_?(?P<unit>{'|'.join(UNITS['time'])})?",
        "counter": r"n|i|idx|index|iterator|count|counter|seq|sample(?:_?(?:id|no))?",
        "event": r"event|button|btn|mark|marker",
    }.items()
}
_SENSORS = ("acc", "gyro", "mag", "pressure")
_LARGEST_TICK = 2**62
_BLOCK = 4000  # lines parsed at once: a garbled number makes its column slow for this many
_BLOCKS = 128  # of them are put together at a time
_Block = tuple[IntArray, NDArray[Any], FloatArray, list[tuple[int, str]]]  # good lines, their t, numbers, events


@dataclass(frozen=True)
class Rows:
    """Parsed lines.

    Attributes:
        t: (N,) int64 or float64; in the file's unit, or nanoseconds after ``Columns.convert``.
        values: by sensor (N, 3) or (N, 1); in the file's unit or SI; nan where a field was empty.
        events: row and text.
        counts: lines that are not here, by reason.
    """

    t: IntArray | FloatArray
    values: dict[str, FloatArray]
    events: list[tuple[int, str]]
    counts: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Columns:
    """Which field of a line is what. One line at a time or a whole file, the mapping is the same.

    ``from_header`` (or ``assumed``), then ``settled`` on the first rows, then ``convert(parse(lines))`` as they come.

    Attributes:
        names: the header's names, as written.
        where: fields by quantity: ``acc``, ``gyro``, ``mag`` (x, y, z), ``pressure``, ``time``, ``event``.
        scale: what to multiply by, for the quantities whose unit is known; time in ns.
        sampled: time is a count of samples, not a clock.
    """

    names: tuple[str, ...]
    where: Mapping[str, tuple[int, ...]]
    scale: Mapping[str, float]
    sampled: bool = False

    @classmethod
    def from_header(cls, line: str) -> Columns | None:
        """The columns that a header names; None if it names no accelerometer."""
        names, where, scale = cls._recognise(line)
        if "acc" not in where:
            return None
        counter = where.pop("counter", None)
        sampled = "time" not in where
        if sampled:
            scale["time"] = 1e9 / ASSUMED_RATE_HZ
            where |= {"time": counter} if counter else {}
        return cls(names, where, scale, sampled)

    @classmethod
    def names_gyroscope(cls, line: str) -> bool:
        """Whether a header names a gyroscope, accelerometer or not."""
        return "gyro" in cls._recognise(",".join(line.split(",", MOST_COLUMNS)[:MOST_COLUMNS]))[1]

    @staticmethod
    def _recognise(line: str) -> tuple[tuple[str, ...], dict[str, tuple[int, ...]], dict[str, float]]:
        """All names, which columns hold which quantity, and the scales that names tell; nothing of endless lines."""
        names = tuple(line.rstrip("\r\n").split(",", MOST_COLUMNS))
        names = names if len(names) <= MOST_COLUMNS else ()
        found: dict[str, dict[str, int]] = {}
        scale: dict[str, float] = {}
        for i, name in enumerate(names):
            plain = plain_name(name)
            for quantity, pattern in _NAMES.items():
                match = pattern.fullmatch(plain) if plain else None
                unit = (match.groupdict().get("unit") or "raw").replace("_", "") if match else ""
                if match and (unit == "raw" or unit in UNITS[quantity]):
                    found.setdefault(quantity, {}).setdefault(match.groupdict().get("axis") or "", i)
                    if unit != "raw":
                        scale.setdefault(quantity, UNITS[quantity][unit])
                    break
        where = {
            quantity: tuple(axes[axis] for axis in sorted(axes))
            for quantity, axes in found.items()
            if "" in axes or len(axes) == 3
        }
        return names, where, scale

    @classmethod
    def assumed(cls, line: str) -> Columns | None:
        """The canonical columns, if a line of data without a header has their number and likely values."""
        fields, names = line.split(","), CANONICAL.split(",")
        try:
            int(fields[0])
            numbers = [_number(text) for text in fields[1:11]]
        except ValueError:
            return None
        if not 11 <= len(fields) <= 13 or not np.isfinite(numbers[:6]).all() or numbers[9] < 300.0:
            return None
        if len(fields) == 12 and not re.fullmatch(r"\s*-?[\d.]+\s*", fields[11]):
            names.remove("temp_c")
        return cls.from_header(",".join(names[: len(fields)]))

    def parse(self, lines: Sequence[str], first_row: int = 0) -> Rows:
        """Numbers of the lines that have the right fields; the others are dropped and counted.

        Args:
            lines: data lines, with or without line ends. An ``event`` in the last column may be left out.
            first_row: lines that came before, for logs without any time or counter column.
        """
        return self.parse_pieces([lines], first_row)

    def parse_pieces(self, pieces: Iterable[Sequence[str]], first_row: int = 0) -> Rows:
        """The same of lines that come in pieces, of which no more than a block is held."""
        t, numbers = _Gathered(np.empty(0, dtype=np.int64)), _Gathered(np.empty((0, len(self._fields))))
        events: list[tuple[int, str]] = []
        done = seen = 0
        for block, at, lines in self._blocks(pieces):
            seen = lines
            try:
                parse = self._parse_many if len(block) > 100 else self._parse_few
                good, t_block, numbers_block, texts = parse(block)
            except OverflowError:  # pandas meets a number of hundreds of digits
                good, t_block, numbers_block, texts = self._parse_few(block)
            t.add(t_block if "time" in self.where else first_row + at[good])
            numbers.add(numbers_block)
            events += [(done + i, text.strip()) for i, text in texts if text.strip()]
            done += len(good)
        widths = np.cumsum([len(self.where[sensor]) for sensor in self._sensors])
        values = dict(zip(self._sensors, np.split(numbers.joined(), widths[:-1], axis=1), strict=True))
        bad = seen - done
        return Rows(t.joined(), values, events, {"lines_unreadable": bad} if bad else {})

    def _blocks(self, pieces: Iterable[Sequence[str]]) -> Iterator[tuple[list[str], IntArray, int]]:
        """Lines with the right number of fields, where they are among all lines, and how many were seen so far."""
        commas = {len(self.names) - 1}
        if self.where.get("event") == (len(self.names) - 1,):
            commas.add(len(self.names) - 2)
        held: list[str] = []
        held_at = np.empty(0, dtype=np.int64)
        seen = 0
        for lines in pieces:
            counts = np.fromiter(map(str.count, lines, repeat(",")), dtype=np.int64, count=len(lines))
            whole = np.flatnonzero(np.isin(counts, list(commas)))
            held += lines if len(whole) == len(lines) else [lines[i] for i in whole.tolist()]
            held_at = np.concatenate((held_at, seen + whole))
            seen += len(lines)
            done = len(held) // _BLOCK * _BLOCK
            for at in range(0, done, _BLOCK):
                yield held[at : at + _BLOCK], held_at[at : at + _BLOCK], seen
            held, held_at = held[done:], held_at[done:]
        yield held, held_at, seen

    def settled(self, rows: Rows) -> tuple[Columns, list[str]]:
        """These columns with every unit known, judging by the rows where names leave it open, and what was assumed.

        Raises:
            DataError: the accelerometer's unit cannot be guessed (without the file's name).
        """
        scale, notices = dict(self.scale), []

        def assume(quantity: str, seen: str, factor: float | None, verdict: str) -> None:
            notices.append(f"{self._name(quantity)} has no unit in its name: {seen}, {verdict}")
            if factor is not None:
                scale[quantity] = factor

        norms = {}
        needed = set(self._sensors) - scale.keys() | ({"acc"} if "gyro" not in scale else set())
        for sensor in needed:
            with np.errstate(over="ignore"):
                norm = np.linalg.norm(rows.values[sensor], axis=1)
            norms[sensor] = norm[np.isfinite(norm)]
        middle = {sensor: float(np.median(norm)) for sensor, norm in norms.items() if len(norm)}

        if self.sampled:
            how = f"{self._name('time')} counts samples" if "time" in self.where else "no time column"
            notices.append(f"{how}: {ASSUMED_RATE_HZ} Hz assumed; a wrong rate falsifies speed and turns")
        elif "time" not in scale:
            steps = np.diff(rows.t)
            ahead = steps[steps > 0]
            # Times the share of rows that move the clock, for clocks that show only whole seconds.
            step = float(np.median(ahead)) * len(ahead) / len(steps) if len(ahead) else 1e3 / ASSUMED_RATE_HZ
            power = int(np.clip(np.round(np.log10(step * ASSUMED_RATE_HZ) / 3), 0, 3))
            assume("time", f"step {step:.4g}", 10.0 ** (9 - 3 * power), f"taken as {('s', 'ms', 'µs', 'ns')[power]}")
        if "acc" in middle and "acc" not in scale:
            if not 0.3 < middle["acc"] < 30.0:
                name = self._name("acc")
                raise DataError(
                    f"{name} has no unit in its name and a median norm of {middle['acc']:.4g}, neither g nor m/s²; "
                    f"put the unit into the header ({name}_g, {name}_ms2) or log raw acceleration"
                )
            factor, unit = (STANDARD_GRAVITY_M_S2, "g") if middle["acc"] < 3.0 else (1.0, "m/s²")
            assume("acc", f"median norm {middle['acc']:.3g}", factor, f"taken as {unit}")
        if "gyro" in middle and "gyro" not in scale:
            # Nobody turns at 10 rad/s for a tenth of a walk, or walks below 10 °/s; at rest M5's °/s is likelier.
            fast = float(np.percentile(norms["gyro"], 90))
            spread = np.percentile(norms["acc"], [25, 75]) * scale["acc"] if "acc" in middle else np.zeros(2)
            factor, unit = (1.0, "rad/s") if fast < 10.0 and np.ptp(spread) > 1.0 else (DEGREE_RAD, "°/s")
            assume("gyro", f"a tenth of the norms above {fast:.3g}", factor, f"taken as {unit}")
        if "mag" in middle and "mag" not in scale:
            factor, unit = 1.0, "µT"
            if 0.1 < middle["mag"] < 1.5:
                factor, unit = 100.0, "gauss"
            elif not 8.0 < middle["mag"] < 160.0:
                factor, unit = 50.0 / max(middle["mag"], 1e-9), "raw counts, scaled to a median of 50 µT"
            assume("mag", f"median norm {middle['mag']:.3g}", factor, f"taken as {unit}")
        if "pressure" in middle and "pressure" not in scale:
            units = {unit: UNITS["pressure"][unit.lower()] for unit in ("hPa", "Pa", "kPa")}
            fits = [unit for unit, factor in units.items() if 300.0 < middle["pressure"] * factor < 1200.0]
            verdict = f"taken as {fits[0]}" if fits else "which is no air pressure: not used"
            assume("pressure", f"median {middle['pressure']:.6g}", units[fits[0]] if fits else None, verdict)
        return replace(self, scale=scale), notices

    def convert(self, rows: Rows) -> Rows:
        """The same rows in nanoseconds and SI units.

        A row with an acceleration or rate that no such sensor can give, or with an impossible time, is corrupted:
        its other numbers are not to be trusted either, so all of it is dropped.
        """
        t_ns = to_ns(rows.t, int(self.scale["time"]))
        with np.errstate(over="ignore"):
            values = {s: numbers * self.scale[s] for s, numbers in rows.values.items() if s in self.scale}
        good = np.abs(t_ns) <= MAX_T_NS
        for sensor in {"acc", "gyro"} & values.keys():
            good &= ~(np.abs(values[sensor]) > LIMITS[sensor]).any(axis=1)
        bad = int((~good).sum())
        row = np.cumsum(good) - 1
        return Rows(
            t_ns[good],
            {sensor: numbers[good] for sensor, numbers in values.items()},
            [(int(row[i]), text) for i, text in rows.events if good[i]],
            rows.counts | ({"rows_impossible": bad} if bad else {}),
        )

    def _name(self, quantity: str) -> str:
        return self.names[self.where[quantity][0]]

    @property
    def _sensors(self) -> list[str]:
        return [sensor for sensor in _SENSORS if sensor in self.where]

    @property
    def _fields(self) -> list[int]:
        return [i for sensor in self._sensors for i in self.where[sensor]]

    def _parse_many(self, lines: Sequence[str]) -> _Block:
        """Many lines, with pandas, which gives a column as text if anything in it is not a number."""
        import pandas as pd  # here, because it takes a second to import

        (time,), (event,) = self.where.get("time", (-1,)), self.where.get("event", (-1,))
        widest = max(map(str.count, lines, repeat(","))) + 1
        if event >= widest:  # no line of these has it
            event = -1
        table = pd.read_csv(
            StringIO("\n".join(lines).replace("\r", " ")),
            header=None,
            names=list(range(widest)),
            usecols=[*self._fields, *(i for i in (time, event) if i >= 0)],
            dtype={event: object} if event >= 0 else {},
            quoting=csv.QUOTE_NONE,
            keep_default_na=False,
            na_values=["", "nan", "NaN", "-nan"],
            skipinitialspace=True,
            low_memory=False,
        )
        good = np.ones(len(table), dtype=bool)
        for i in self._fields:
            if table[i].dtype not in (np.int64, np.float64):
                number = pd.to_numeric(table[i], errors="coerce")
                good &= (number.notna() | table[i].isna()).to_numpy()
                table[i] = number
        if time >= 0 and table[time].dtype != np.int64:
            number = pd.to_numeric(table[time], errors="coerce").astype(float)
            if number.abs().max() > 2**53:  # the good ones among them may have more digits than a float
                return self._parse_few(lines)
            good &= number.notna().to_numpy()
            table[time] = number
        table = table[good].reset_index(drop=True) if not good.all() else table
        t = table[time].to_numpy() if time >= 0 else np.zeros(len(table), dtype=np.int64)
        texts = table[event].dropna() if event >= 0 else pd.Series(dtype=object)
        pairs = list(zip(texts.index.tolist(), texts.tolist(), strict=True))
        return np.flatnonzero(good), t, table[self._fields].to_numpy(dtype=float), pairs

    def _parse_few(self, lines: Sequence[str]) -> _Block:
        """A few lines, without pandas."""
        (time,), (event,) = self.where.get("time", (-1,)), self.where.get("event", (-1,))
        good: list[int] = []
        t: list[int | float] = []
        numbers: list[list[float]] = []
        texts: list[tuple[int, str]] = []
        for i, line in enumerate(lines):
            fields = line.split(",")
            try:
                t_row = _tick(fields[time]) if time >= 0 else 0
                row = [_number(fields[j]) for j in self._fields]
            except ValueError:
                continue
            if 0 <= event < len(fields):
                texts.append((len(good), fields[event]))
            good.append(i)
            t.append(t_row)
            numbers.append(row)
        return np.array(good, dtype=np.int64), np.array(t), np.array(numbers).reshape(-1, len(self._fields)), texts


class _Gathered:
    """Arrays put together now and then: thousands of small ones among short-lived texts hold the memory of both."""

    def __init__(self, nothing: NDArray[Any]) -> None:
        self._many: list[NDArray[Any]] = [nothing]
        self._few: list[NDArray[Any]] = []

    def add(self, block: NDArray[Any]) -> None:
        self._few.append(block)
        if len(self._few) == _BLOCKS:
            self._many.append(np.concatenate(self._few))
            self._few = []

    def joined(self) -> NDArray[Any]:
        return np.concatenate((*self._many, *self._few))


def plain_name(name: str) -> str:
    """A column's name in small letters and digits, joined by ``_``: ``Acc X (m/s²)`` is ``acc_x_m_s2``."""
    plain = name.lower().replace("µ", "u").replace("μ", "u").replace("²", "2").replace("°", "deg")
    return re.sub(r"[^a-z0-9]+", "_", plain).strip("_")


def _number(text: str) -> float:
    """A field as a number; nan if it is empty. float() alone would also take ``1_000``."""
    text = text.strip()
    if "_" in text:
        raise ValueError(text)
    return float(text) if text else float("nan")


def _tick(text: str) -> int | float:
    """A time, kept an integer if it is one: Unix nanoseconds do not fit into a float."""
    t = int(text) if text.strip().lstrip("+-").isdecimal() else _number(text)
    if not abs(t) < _LARGEST_TICK:  # nan too
        raise ValueError(text)
    return t
