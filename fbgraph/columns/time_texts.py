"""Dates and times of day as people write them, to nanoseconds.

ISO 8601 with and without a zone; ``05.11.2024 13:59:50,010``; ``11/05/2024 1:59:50 PM``; ``05-Nov-2024 13:59:50.010``;
``2024-10-27_03-33-20``; ``2014-07-18 15:40:54:543``; times of day; minutes and seconds as a spreadsheet shows them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fbgraph.core.geometry import IntArray

UNREAD = np.iinfo(np.int64).min
"""Stands for a text that is no time."""
DAY_NS = 86_400_000_000_000
HOUR_NS = 3_600_000_000_000

_ENGLISH = "jan feb mar apr may jun jul aug sep oct nov dec"
_MONTHS = {name: i + 1 for i, name in enumerate(_ENGLISH.split())}
_MONTHS |= {"mai": 5, "okt": 10, "dez": 12, "mär": 3, "mrz": 3, "ene": 1, "abr": 4, "ago": 8, "dic": 12, "mag": 5}
_DATE = r"""(?:
    (?P<year>(?:19|20)\d\d)(?P<dash>[-/._]?)(?P<month>\d\d?)(?P=dash)(?P<day>\d\d?)
    | (?P<first>\d\d?)(?P<slash>[-/.])(?P<second>\d\d?)(?P=slash)(?P<late_year>\d{4}|\d\d)
    | (?P<named_day>\d\d?)[-\ .]+(?P<name>[^\W\d_]{3})[^\W\d_]*\.?[-\ ,]+(?P<named_year>\d{4})
    | (?P<name_first>[^\W\d_]{3})[^\W\d_]*\.?\ (?P<name_day>\d\d?),?\ (?P<name_year>\d{4})
    )"""
_TIME = r"""(?:
    (?P<h>\d\d?)(?P<colon>[:.\-h])(?P<m>\d\d)(?:(?P=colon)(?P<s>\d\d)(?:(?P<point>[.,:_\-])(?P<fraction>\d{1,9})\d*)?)?
    | (?P<compact>\d{6})(?:[.,](?P<compact_fraction>\d{1,9})\d*)?
    )\s*(?P<half>[AaPp]\.?[Mm]\.?)?"""
_ZONE = r"\s*(?P<zone>Z|UTC|GMT|[+\-]\d\d:?\d\d|[+\-]\d\d)?"
_STAMP = re.compile(rf"\s*{_DATE}(?:\s*[T_,;\ -]\s*){_TIME}{_ZONE}\s*", re.VERBOSE)
_DATE_ONLY = re.compile(rf"\s*{_DATE}\s*", re.VERBOSE)
_TIME_ONLY = re.compile(rf"\s*{_TIME}{_ZONE}\s*", re.VERBOSE)
_MINUTES = re.compile(r"\s*(?P<m>\d\d?):(?P<s>\d\d)[.,](?P<fraction>\d{1,9})\s*")
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d{1,9})?(Z|[+-]\d\d:\d\d)?")
_LOOKED_AT, _MOST_TEXT = 20, 64


def kind_of_text(values: NDArray[Any]) -> str:
    """What the first texts of a column are: ``stamp``, ``date``, ``time_of_day`` or ``""``."""
    texts = [str(value)[:_MOST_TEXT] for value in values if value is not None and str(value).strip()][:_LOOKED_AT]
    if not texts:
        return ""
    for kind, patterns in {
        "stamp": (_STAMP,),
        "time_of_day": (_TIME_ONLY, _MINUTES),
        "date": (_DATE_ONLY,),
    }.items():
        good = sum(any(pattern.fullmatch(text) for pattern in patterns) for text in texts)
        if good > len(texts) / 2 and (kind != "time_of_day" or any(":" in text for text in texts)):
            return kind
    return ""


def stamps_ns(values: NDArray[Any]) -> IntArray:
    """Dates with times (N,) as nanoseconds since 1970, in UTC where they have a zone; ``UNREAD`` for other texts."""
    if (first := _first(values)) and _ISO.fullmatch(first):
        import pandas as pd

        read = pd.to_datetime(pd.Series(values), format="ISO8601", utc=True, errors="coerce")
        there = read.notna().to_numpy()
        ns = read.dt.tz_localize(None).to_numpy().astype("datetime64[ns]").astype(np.int64)
        return np.where(there, ns, UNREAD).astype(np.int64)
    matches = [_STAMP.fullmatch(str(value)[:_MOST_TEXT]) if value is not None else None for value in values]
    days = _days(matches)
    return _summed(days, [_of_day(match) - _zone(match) if match else UNREAD for match in matches])


def dates_ns(values: NDArray[Any]) -> IntArray:
    """Dates (N,) as nanoseconds since 1970; ``UNREAD`` for other texts."""
    matches = [_DATE_ONLY.fullmatch(str(value)[:_MOST_TEXT]) if value is not None else None for value in values]
    return _summed(_days(matches), [0 if match else UNREAD for match in matches])


def times_of_day_ns(values: NDArray[Any]) -> tuple[IntArray, int]:
    """Times of day (N,) as nanoseconds since midnight, and after how many they begin again.

    A spreadsheet shows a time without its hours (``59:50.0``): such times begin again every hour.
    """
    first = _first(values)
    if first and _MINUTES.fullmatch(first):
        return np.array([_minutes(value) for value in values], dtype=np.int64), HOUR_NS
    read: list[int] = []
    for value in values:
        match = _TIME_ONLY.fullmatch(str(value)[:_MOST_TEXT]) if value is not None else None
        read.append(_of_day(match) if match else UNREAD)
    return np.array(read, dtype=np.int64), DAY_NS


def _first(values: NDArray[Any]) -> str:
    return next((str(value).strip()[:_MOST_TEXT] for value in values if value is not None and str(value).strip()), "")


def _summed(days: Sequence[int | None], times: Sequence[int]) -> IntArray:
    pairs = zip(days, times, strict=True)
    read = [UNREAD if day is None or t == UNREAD else day * DAY_NS + t for day, t in pairs]
    return np.array(read, dtype=np.int64)


def _minutes(value: object) -> int:
    match = _MINUTES.fullmatch(str(value)[:_MOST_TEXT]) if value is not None else None
    if not match:
        return UNREAD
    return (int(match["m"]) * 60 + int(match["s"])) * 1_000_000_000 + int(match["fraction"].ljust(9, "0"))


def _of_day(match: re.Match[str]) -> int:
    if compact := match["compact"]:
        hours, minutes, seconds = int(compact[:2]), int(compact[2:4]), int(compact[4:])
        fraction = (match["compact_fraction"] or "").ljust(9, "0")
    else:
        hours, minutes, seconds = int(match["h"]), int(match["m"]), int(match["s"] or 0)
        digits = match["fraction"] or ""
        # after a point, digits are a decimal fraction; after a colon or a line they count milliseconds
        counts = match["point"] not in (None, ".", ",") and len(digits) <= 3
        fraction = (digits.rjust(3, "0") if counts else digits).ljust(9, "0")
    if half := (match["half"] or "").lower()[:1]:
        hours = hours % 12 + (12 if half == "p" else 0)
    if hours > 24 or minutes > 59 or seconds > 60:
        return UNREAD
    return ((hours * 60 + minutes) * 60 + seconds) * 1_000_000_000 + int(fraction)


def _zone(match: re.Match[str]) -> int:
    zone = match["zone"] or ""
    if zone[:1] not in ("+", "-"):
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    return (1 if zone[0] == "+" else -1) * (int(digits[:2]) * 60 + int(digits[2:])) * 60_000_000_000


def _days(matches: Sequence[re.Match[str] | None]) -> list[int | None]:
    """Days since 1970. Of ``03/04/2024`` the order is the one that fits all, and spans the fewer days."""
    known: dict[tuple[str, bool], int | None] = {}

    def day(match: re.Match[str], day_first: bool) -> int | None:
        key = (match[0][: match.end("h")] if match.re is _STAMP and match["h"] else match[0], day_first)
        if key not in known:
            known[key] = _day(match, day_first)
        return known[key]

    orders = [[day(match, first) if match else None for match in matches] for first in (True, False)]
    if orders[0] == orders[1]:
        return orders[0]
    slash = next((match["slash"] == "/" for match in matches if match and match["slash"]), False)
    scored = []
    for order, preferred in zip(orders, (not slash, slash), strict=True):
        there = [number for number in order if number is not None]
        scored.append((len(there), min(there, default=0) - max(there, default=0), preferred, order))
    return max(scored, key=lambda score: score[:3])[3]


def _day(match: re.Match[str], day_first: bool) -> int | None:
    if match["year"]:
        year, month, day = int(match["year"]), int(match["month"]), int(match["day"])
    elif match["late_year"]:
        day, month = (int(match[group]) for group in (("first", "second") if day_first else ("second", "first")))
        year = int(match["late_year"])
        year += 2000 if year < 100 else 0
    else:
        name = (match["name"] or match["name_first"]).lower()
        if name not in _MONTHS:
            return None
        month, day = _MONTHS[name], int(match["named_day"] or match["name_day"])
        year = int(match["named_year"] or match["name_year"])
    try:
        return date(year, month, day).toordinal() - date(1970, 1, 1).toordinal()
    except ValueError:
        return None
