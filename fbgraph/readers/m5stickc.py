"""CSV logs of M5StickC-class wearables: one row a sample, from a card, a serial line or TCP.

Canonical header: ``t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa[,temp_c][,event]``; the other
names, units and orders that sketches use are understood too, see ``columns``.

A magnetometer or barometer slower than the rows may leave its fields empty, or repeat its last value. If most of its
values are repeats only the changes are kept, and one sample a second, so that a sample stands for one measurement.
Text in the ``event`` column marks that moment (``0`` does not, nor does the same text held over following rows).
When the device restarts its clock the rows go on one step after the last one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

import numpy as np

from fbgraph.core.bounded import MOST_COLUMNS
from fbgraph.core.errors import DataError
from fbgraph.core.geometry import IntArray
from fbgraph.readers.cleaning import RawLog, RawStream, drop_repeats
from fbgraph.readers.csv_columns import CANONICAL, Columns, Rows
from fbgraph.tables.log_text import LogText, log_text

NAME = "m5stickc"
PRESET = "m5stickc"
DESCRIPTION = "M5StickC and other IMU loggers, CSV (t_ms,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,mx_ut,my_ut,mz_ut,p_hpa)"
EXAMPLE = f"""\
{CANONICAL}
10250,0.012,-0.034,0.998,1.22,-0.61,0.31,21.4,-3.2,-40.1,1013.25,31.5,
10260,0.015,-0.031,1.002,1.10,-0.55,0.37,,,,,,button
"""
MOST_ROWS = 10_000_000
"""A day at 100 Hz: four sensors of a row take half a kilobyte while they are read, and as much again to be smoothed."""
_HEAD_LINES, _LATEST_HEADER = 50, 1000
_MOST_NAMES = 100_000  # looked at in search of a header; a thousand lines of a log hold a sixth of them
_RESTART_NS = 1_000_000_000


def detects(head: str) -> bool:
    """Whether the beginning of a file is of this format."""
    lines = _data_lines(head.split("\n"))
    # a header with a gyroscope only is of this kind too: reading it then says what it lacks
    return find_columns(lines) is not None or any(Columns.names_gyroscope(line) for line in lines[:_HEAD_LINES])


def find_columns(lines: list[str]) -> Columns | None:
    """The columns named by the first header, or else the canonical ones if the first lines fit them.

    Many devices print what they boot before they log, so that a header may come late.
    """
    looked_at = 0
    for line in lines[:_LATEST_HEADER]:
        looked_at += line.count(",")
        if looked_at > _MOST_NAMES:
            break
        if columns := Columns.from_header(line):
            return columns
    head = lines[:_HEAD_LINES]
    guesses = [guess for line in head if (guess := Columns.assumed(line))]
    names, votes = Counter(guess.names for guess in guesses).most_common(1)[0] if guesses else ((), 0)
    return Columns.from_header(",".join(names)) if votes > len(head) / 2 else None


def read(source: Path | LogText) -> RawLog:
    """Read one log.

    Raises:
        DataError: it cannot be read, has no header and no canonical rows, or units nobody can guess.
    """
    text = log_text(source)
    text.require_rows(MOST_ROWS)
    head = list(islice(chain.from_iterable(map(_data_lines, text.lines())), _LATEST_HEADER))
    columns = find_columns(head)
    if columns is None:
        widest = max((line.count(",") + 1 for line in head), default=0)
        if widest > MOST_COLUMNS:
            raise DataError(f"{text.source}: a line of {widest} columns, of which a log has {MOST_COLUMNS} at most")
        raise DataError(f"{text.source}: no line names accelerometer columns; the header should be like {CANONICAL}")
    header = ",".join(columns.names)
    headers: Counter[str] = Counter()
    rows = columns.parse_pieces(_without_header(text, header, headers))
    try:
        columns, assumed = columns.settled(rows)
    except DataError as error:
        raise DataError(f"{text.source}: {error}") from error
    rows = columns.convert(rows)
    raw = RawLog(notices=assumed, counts=dict(rows.counts))
    if not headers[header]:
        raw.notices.insert(0, f"no header: columns taken as {header}")
    elif headers[header] > 1:
        raw.counts["headers_repeated"] = headers[header] - 1
    t_ns, restarts = continue_restarts(rows.t.astype(np.int64))
    if restarts:
        raw.counts["clock_restarts"] = restarts
        raw.notices.append(f"the device's clock restarted {restarts} times; later times go on from the last row")
    for sensor, values in rows.values.items():
        there = ~np.isnan(values).all(axis=1)
        if not there.any():
            continue
        raw.streams[sensor] = RawStream(t_ns[there], values[there])
        if sensor in ("mag", "pressure"):
            raw.streams[sensor] = drop_repeats(raw.streams[sensor])
            if repeats := int(there.sum()) - len(raw.streams[sensor].t_ns):
                raw.counts[f"{sensor}_repeats"] = repeats
    raw.events += [(int(t_ns[row]), label) for row, label in _pressed(rows)]
    return raw


def read_text(text: str, source: str) -> RawLog:
    """Read the text of one log, from ``source``; as ``read``."""
    return read(LogText(Path(source), (text.encode("utf-8", "replace"),)))


def _data_lines(lines: list[str]) -> list[str]:
    """Those that are neither blank nor comments."""
    return [line for line in lines if line and line[0] != "#"]


def _without_header(text: LogText, header: str, headers: Counter[str]) -> Iterator[list[str]]:
    """The data lines, a piece at a time; the header, wherever it stands, is counted."""
    for lines in map(_data_lines, text.lines()):
        data = [line for line in lines if line != header]
        headers[header] += len(lines) - len(data)
        yield data


def continue_restarts(t_ns: IntArray) -> tuple[IntArray, int]:
    """Times that go on where a device started its clock again, and how often it did.

    A restart is a jump back by more than a second after which time runs on from there; a single garbled time is not,
    and a clock that runs backwards all the time is left as it is.

    Args:
        t_ns: (N,) in file order.
    """
    steps = np.diff(t_ns)
    back = np.flatnonzero(steps < -_RESTART_NS) + 1
    if len(back) == 0 or len(back) > max(10, len(t_ns) // 100):
        return t_ns, 0
    step_ns = int(np.median(steps[steps > 0])) if (steps > 0).any() else 0
    t_ns, restarts = t_ns.copy(), 0
    for i in back.tolist():
        before, after = t_ns[max(0, i - 5) : i], t_ns[i : i + 5]  # medians of these: any one time may be garbled
        middle = int(np.median(before))
        runs_on = min(len(before), len(after)) >= 3 and np.mean(np.diff(after) >= 0) > 0.5
        if runs_on and np.median(after) < middle - _RESTART_NS:
            last = min(max(int(t_ns[i - 1]), middle), middle + _RESTART_NS)
            t_ns[i:] += last + step_ns - t_ns[i]
            restarts += 1
    return t_ns, restarts


def _pressed(rows: Rows) -> list[tuple[int, str]]:
    """Events where they begin: a button held down fills many rows."""
    begun, last = [], (-2, "")
    for row, text in rows.events:
        if text != "0" and last != (row - 1, text):
            begun.append((row, text))
        last = (row, text)
    return begun
