"""Logs of the wearable as text."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.sensor_log import SensorLog
from fbgraph.readers import read_log, read_table_log
from fbgraph.readers.cleaning import RawLog
from fbgraph.tables import read_tables
from support.waves import waves

G = 9.80665
DEG = np.pi / 180.0
N = 300
I = np.arange(N)  # noqa: E741
T_S = 5.0 + 0.02 * I
ACC, GYRO, MAG = waves(N)
PRESSURE = 1013.0 + 0.1 * np.sin(I / 50)


def read_columns(tmp_path: Path, header: str, *columns: npt.ArrayLike) -> SensorLog:
    """Write rows of columns under a header and read them back."""
    path = tmp_path / "walk.csv"
    table = np.column_stack(columns)
    path.write_text("\n".join([header, *(",".join(f"{v:.10g}" for v in row) for row in table)]) + "\n")
    return read_log(path).log


def lines_of_a_walk(n: int = N) -> list[str]:
    """Canonical lines, header first, with an event every hundred rows."""
    rows = [CANONICAL]
    for i in range(n):
        numbers = [*ACC[i % N] / G, *GYRO[i % N] / DEG, *MAG[i % N], PRESSURE[i % N], 31.5]
        text = ",".join(f"{value:.4f}" for value in numbers)
        rows.append(f"{5000 + 20 * i},{text},{'button' if i % 100 == 50 else ''}")
    return rows


def read_lines(tmp_path: Path, lines: list[str]) -> SensorLog:
    """Write these lines, whatever is in them, and read them as the wearable's."""
    path = tmp_path / "walk.csv"
    path.write_bytes(("\n".join(lines) + "\n").encode("latin-1", "replace"))
    return read_log(path, "m5stickc").log


def read_rows(tmp_path: Path, lines: list[str]) -> RawLog:
    """The same before it is cleaned."""
    path = tmp_path / "walk.csv"
    path.write_bytes(("\n".join(lines) + "\n").encode("latin-1", "replace"))
    return read_table_log(list(read_tables(path).tables), path)[0]
