"""Parquet: the columns of ``breadcrumbs.csv`` for pandas, polars, DuckDB; units and provenance in its metadata."""

from __future__ import annotations

from typing import BinaryIO

import numpy as np

from fbgraph import __version__
from fbgraph.core.safe_text import visible
from fbgraph.exports.exported_walk import ExportedWalk
from fbgraph.run.folder import BREADCRUMB_HEADER, breadcrumb_columns

DESCRIPTION = "the breadcrumbs with covariance and units, for pandas, polars, DuckDB"
SUFFIX, BINARY, ON_EARTH = ".parquet", True, False
_UNITS = {"rad_s": "rad/s", "m2": "m^2", "rad": "rad", "s": "s", "m": "m"}


def write(walk: ExportedWalk, out: BinaryIO) -> list[str]:
    """Write it; what is not known is null."""
    import pyarrow as pa  # here, because only Parquet needs it
    from pyarrow import parquet

    names = BREADCRUMB_HEADER.split(",")
    columns = [np.asarray(column) for column in breadcrumb_columns(walk.trajectory, 0.0)]
    fields = [
        pa.field(name, pa.int64() if name == "k" else pa.float64(), metadata={"unit": _unit(name)}) for name in names
    ]
    about = {
        "fbgraph": __version__,
        "name": visible(walk.name),
        "estimator": walk.estimator,
        "frame": "x East, y North, z up; the origin is the first breadcrumb",
        "clock": "Unix time" if walk.dated else "the log's own",
        "caution": visible(" ".join(walk.caution)),
    }
    arrays = [pa.array(column, type=one.type, from_pandas=True) for column, one in zip(columns, fields, strict=True)]
    parquet.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=about)), out)
    return []


def _unit(name: str) -> str:
    """Of a column, which ends with it."""
    return next((unit for end, unit in _UNITS.items() if name.endswith(f"_{end}")), "1")
