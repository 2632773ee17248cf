"""Logs whose head says how to scale what follows: gyroflow's ``.gcsv`` and M5stick-IMUtracker's ``ACCLOG.BIN``."""

from __future__ import annotations

import struct
from dataclasses import replace
from itertools import chain

import numpy as np

from fbgraph.core.errors import DataError
from fbgraph.core.geometry import FloatArray
from fbgraph.tables.fields import number
from fbgraph.tables.table import Column, Table

_GYROFLOW = "GYROFLOW IMU LOG"
_SCALES = {"t": ("tscale", "s"), "g": ("gscale", "rad/s"), "a": ("ascale", "g")}  # docs.gyroflow.xyz, "gcsv"
_HEAD_BYTES = 64
_COUNTS = 32768.0
_WITH_GYRO, _NEWEST = 0x0200, 0x0201


def with_gyroflow_scales(table: Table) -> Table:
    """The table in the units that the head of a ``.gcsv`` scales it to; any other table as it is."""
    if not any(_GYROFLOW in remark for remark in table.remarks):
        return table
    said = dict(line.split(",", 1) for line in table.remarks if "," in line)
    columns = []
    for column in table.columns:
        key, unit = _SCALES.get(column.name if column.name == "t" else column.name[:1], ("", ""))
        known = column.name == "t" or (len(column.name) == 2 and column.name[1] in "xyz")
        scale = number(said.get(key, "")) if known and not column.is_text else None
        if scale is not None:
            with np.errstate(over="ignore", invalid="ignore"):  # garbled numbers
                column = replace(column, unit=unit, values=column.values * float(scale))
        columns.append(column)
    return replace(table, columns=tuple(columns), how=f"{table.how}, gyroflow's scales")


def acclog_table(data: bytes, name: str, source: str) -> Table:
    """The samples of an ``ACCLOG.BIN``: 64 bytes little-endian, then big-endian int16, three a sample or six.

    ``ACCLOG``, version (uint16 at 8), device, start in ms, rate in Hz (26), range in g (28) and from version 2.0 in
    °/s (30); from 2.1 float32 counts per g (36) and per °/s (40). Source: ``LogHeader`` and ``pc_tools/decoder.py`` of
    ys4i/M5stick-IMUtracker.

    Raises:
        DataError: it is cut short, or of a version whose scales are not known.
    """
    if len(data) < _HEAD_BYTES:
        raise DataError(f"{source}: cut short in its head; copy it again")
    version, _, start_ms, rate_hz, range_g, range_dps = struct.unpack_from("<HQQHHH", data, 8)
    if version > _NEWEST or not rate_hz or not range_g:
        raise DataError(
            f"{source}: ACCLOG version {version >> 8}.{version & 255} at {rate_hz} Hz, ±{range_g} g: scales not known; "
            "convert it with the logger's own decoder.py --csv"
        )
    width = 6 if version >= _WITH_GYRO else 3
    whole = (len(data) - _HEAD_BYTES) // (2 * width) * width
    samples: FloatArray = np.frombuffer(data, ">i2", whole, _HEAD_BYTES).reshape(-1, width).astype(float)
    per_g, per_dps = struct.unpack_from("<ff", data, 36) if version == _NEWEST else (0.0, 0.0)
    scales = (
        (1.0 / per_g if per_g > 0.0 else range_g / _COUNTS, "g", "a"),
        (1.0 / per_dps if per_dps > 0.0 else range_dps / _COUNTS, "dps", "g"),
    )
    columns = [Column("t", "s", np.arange(len(samples)) / rate_hz)]
    for i, axis in enumerate(chain("xyz", "xyz")) if width == 6 else enumerate("xyz"):
        scale, unit, letter = scales[i // 3]
        columns.append(Column(f"{letter}{axis}", unit, samples[:, i] * scale))
    remarks = (f"started {start_ms} ms, {rate_hz} Hz, ±{range_g} g" + (f", ±{range_dps} °/s" if width == 6 else ""),)
    return Table(name, source, tuple(columns), True, "ACCLOG.BIN", None, remarks)
