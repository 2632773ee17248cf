"""Logs that are DataFrames: read by the same rules as the table that they are as CSV."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from fbgraph.core.errors import DataError
from fbgraph.readers import read_table_log
from fbgraph.readers.cleaning import LogFile, assemble
from fbgraph.tables.log_text import text_of
from fbgraph.tables.text_table import read_table

if TYPE_CHECKING:
    import pandas as pd


def read_dataframe(frame: pd.DataFrame, name: str = "dataframe") -> LogFile:
    """Read a walk from a table; it gives the very walk that the same table written as CSV gives.

    Args:
        frame: a row a sample; columns named as in any log of one table, such as ``t_s``, ``acc_x_ms2``,
            ``gyro_z_rads``, ``mag_y_ut``, ``p_hpa``, ``event``. Time may also be the index, or dates.
        name: of the log.

    Raises:
        DataError: no accelerometer, no gyroscope, or nothing usable in them.
    """
    text = "\n".join(dataframe_lines(frame))
    source = Path(name)
    table = read_table(text_of([text.encode()], source), name, name)
    raw, reading = read_table_log([] if table is None else [table], source)
    return assemble(raw, source, reading.layout.app, reading)


def dataframe_lines(frame: pd.DataFrame) -> list[str]:
    """A table as lines of CSV, its header first; dates as nanoseconds since 1970.

    Raises:
        DataError: it has no rows or no columns.
    """
    import pandas as pd  # here, because it takes a second to import

    if frame.shape[0] == 0 or frame.shape[1] == 0:
        raise DataError(f"the DataFrame is empty: {frame.shape[0]} rows, {frame.shape[1]} columns")
    if frame.index.name is not None or isinstance(frame.index, pd.DatetimeIndex):
        frame = frame.reset_index(names=frame.index.name or "t")
    dates = [name for name in frame.columns if pd.api.types.is_datetime64_any_dtype(frame[name])]
    since_1970 = {name: frame[name].astype("datetime64[ns]").astype("int64") for name in dates}
    frame = frame.assign(**since_1970).rename(columns=dict.fromkeys(dates, "t_ns"))
    return str(frame.to_csv(index=False)).splitlines()
