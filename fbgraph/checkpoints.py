"""Checkpoints: known places at known times. As truth they only score; as anchors they enter the graph.

CSV, with a header, on the log's own clock: ``t_s,x_m,y_m[,z_m][,floor][,sigma_m]``; the columns of the IPIN 2023
truth files (``t_app_s,checkpoint,…,floor,east_m,north_m``) are understood too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fbgraph.errors import DataError
from fbgraph.geometry import FloatArray

_ALIASES = {"t_app_s": "t_s", "east_m": "x_m", "north_m": "y_m", "up_m": "z_m"}


@dataclass(frozen=True)
class Checkpoints:
    """Places in a local frame (x East, y North, metres) and when the wearer was there.

    Attributes:
        t_s: (M,) non-decreasing; seconds on the clock of ``SensorLog.t0_s + t_s`` (the format's event clock).
        x_m, y_m: (M,).
        z_m: (M,) nan where unknown.
        floor: (M,) floor number as surveyed, nan where unknown; never metres.
        sigma_m: (M,) standard deviation of x and y, nan where not given.
        source: where they came from, for messages.
    """

    t_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    z_m: FloatArray
    floor: FloatArray
    sigma_m: FloatArray
    source: str = ""

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def xy_m(self) -> FloatArray:
        """(M, 2)."""
        return np.column_stack((self.x_m, self.y_m))

    def select(self, which: slice | FloatArray) -> Checkpoints:
        """The checkpoints at these indices."""
        fields = ("t_s", "x_m", "y_m", "z_m", "floor", "sigma_m")
        return replace(self, **{name: getattr(self, name)[which] for name in fields})


def checkpoints(
    t_s: FloatArray,
    x_m: FloatArray,
    y_m: FloatArray,
    z_m: FloatArray | None = None,
    floor: FloatArray | None = None,
    sigma_m: FloatArray | None = None,
    source: str = "",
) -> Checkpoints:
    """Checkpoints in order of time, with nan for what is not known."""
    order = np.argsort(t_s, kind="stable")

    def column(values: FloatArray | None) -> FloatArray:
        full = np.full(len(t_s), np.nan) if values is None else np.asarray(values, dtype=float)
        return full[order]

    return Checkpoints(column(t_s), column(x_m), column(y_m), column(z_m), column(floor), column(sigma_m), source)


def read_checkpoints(path: Path) -> Checkpoints:
    """Read a checkpoint CSV.

    Raises:
        DataError: the file cannot be read, lacks ``t_s``, ``x_m`` or ``y_m``, or holds a row that is not numbers.
    """
    import pandas as pd  # here, because it takes a second to import

    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True)
    except (OSError, ValueError) as error:  # pandas' parser and decoding errors are ValueErrors
        raise DataError(f"{path}: not a readable checkpoint CSV: {str(error).splitlines()[0]}") from error
    table = table.rename(columns={name: _ALIASES.get(name.strip(), name.strip()) for name in table.columns})
    missing = [name for name in ("t_s", "x_m", "y_m") if name not in table]
    if missing:
        raise DataError(
            f"{path}: no column {', '.join(missing)} (found {', '.join(map(str, table.columns))}); "
            "a checkpoint file needs t_s,x_m,y_m[,z_m][,floor][,sigma_m]"
        )
    columns: dict[str, FloatArray] = {}
    for name in ("t_s", "x_m", "y_m", "z_m", "floor", "sigma_m"):
        if name in table:
            values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float)
            if name in ("t_s", "x_m", "y_m") and not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0])
                raise DataError(f"{path}: row {row + 1} after the header: {name} is not a number")
            columns[name] = values
    if len(table) == 0:
        raise DataError(f"{path}: a header and no checkpoint")
    return checkpoints(**columns, source=str(path))
