"""Any log as a canonical M5StickC CSV: nothing is resampled, so that smoothing either gives the same walk."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import numpy as np

from fbgraph.columns.column_names import CANONICAL
from fbgraph.core.checkpoints import Checkpoints
from fbgraph.core.errors import ConfigError
from fbgraph.core.geometry import IntArray
from fbgraph.core.sensor_log import SensorLog
from fbgraph.core.units import DEGREE_RAD, STANDARD_GRAVITY_M_S2
from fbgraph.core.whole_writes import whole_files

_COLUMNS = {"acc": (1, STANDARD_GRAVITY_M_S2), "gyro": (4, DEGREE_RAD), "mag": (7, 1.0), "pressure": (10, 1.0)}
_MS_NS = 1_000_000
_DIGITS = "%.9g"  # as many as a single-precision sensor value has


_NOTED = "converted by fbgraph from {format}; preset {preset}"
_PRESET = re.compile(r"^converted by fbgraph from \w+; preset (phone|m5stickc)$")


def remark_of(format_name: str, preset: str) -> str:
    """The remark by which a converted log is smoothed as the log itself would be."""
    return _NOTED.format(format=format_name, preset=preset)


def noted_preset(remarks: Iterable[str]) -> Literal["phone", "m5stickc"] | None:
    """The configuration for the device whose log was converted, as a remark of the table says it; None if none does."""
    noted = next((found[1] for remark in remarks if (found := _PRESET.match(remark))), None)
    return None if noted is None else "phone" if noted == "phone" else "m5stickc"


def convert_log(log: SensorLog, truth: Checkpoints | None, preset: str, out: Path, force: bool = False) -> list[Path]:
    """Write a log as a canonical CSV, and the truth that it carries beside it; each whole or not at all.

    Args:
        log: any.
        truth: of the log, on its clock; None if there is none.
        preset: of the configuration for the device that wrote it; noted, so that the CSV is smoothed alike.
        out: the file; the truth's is ``OUT_truth.csv``.
        force: replace what is there.

    Returns:
        The files that were written.

    Raises:
        ConfigError: one of them is there already, or cannot be written.
    """
    places = None if truth is None or not len(truth) else truth
    beside = out.with_name(f"{out.stem}_truth.csv")
    if places is None and beside.exists():
        raise ConfigError(f"{beside}: is there, and this log carries no truth: move it, or name another OUT.csv")
    files = [out] if places is None else [out, beside]
    for path in files:
        if path.exists() and not force:
            raise ConfigError(f"{path}: is there already; --force replaces it")
    with whole_files(files, make_parents=True) as (log_to_be, *truth_to_be):
        write_canonical_csv(log, log_to_be, remark_of(log.format, preset))
        if places is not None:
            write_places_csv(places, *truth_to_be)
    return files


def write_places_csv(places: Checkpoints, path: Path) -> None:
    """Write known places as ``readers.places`` reads them; latitudes and longitudes beside, where they are known.

    Raises:
        OSError: the file cannot be written.
    """
    import pandas as pd  # here, because it takes a second to import

    columns = {"t_s": places.t_s, "x_m": places.x_m, "y_m": places.y_m, "z_m": places.z_m}
    columns |= {"floor": places.floor, "sigma_m": places.sigma_m}
    if places.georeference is not None:
        columns["lat_deg"], columns["lon_deg"] = places.georeference.geodetic_deg(places.xy_m).T
    known = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    with open(path, "w", encoding="utf-8", newline="") as file:
        pd.DataFrame(known).to_csv(file, index=False, float_format="%.16g", lineterminator="\n")


def write_canonical_csv(log: SensorLog, path: Path, remark: str = "") -> int:
    """Write a log as CSV, one row for every moment at which any sensor was sampled; returns how many.

    A row holds what was sampled at that moment and leaves the rest empty. Times are the log's own clock, to the
    nanosecond as far as ``t0_s`` holds it; values have nine significant digits, in g, °/s, µT and hPa.

    Args:
        log: any log; its events go into the row nearest in time.
        path: the file.
        remark: of its first line; no line if empty.

    Raises:
        OSError: the file cannot be written.
    """
    import pandas as pd  # here, because it takes a second to import

    t0_ns = round(log.t0_s * 1e9)
    streams = {name: getattr(log, name) for name in _COLUMNS}
    stamps = {name: t0_ns + np.round(stream.t_s * 1e9).astype(np.int64) for name, stream in streams.items()}
    t_ns: IntArray = np.unique(np.concatenate(list(stamps.values())))
    names = CANONICAL.split(",")
    table = pd.DataFrame(np.full((len(t_ns), len(names)), np.nan), columns=names)
    for name, (first, unit) in _COLUMNS.items():
        rows, values = np.searchsorted(t_ns, stamps[name]), streams[name].values / unit
        for i in range(values.shape[1]):
            table.iloc[rows, first + i] = values[:, i]
    whole_ms = bool((t_ns % _MS_NS == 0).all())
    table[names[0]] = t_ns // _MS_NS if whole_ms else t_ns
    marks = np.full(len(t_ns), "", dtype=object)
    for event in log.events:
        nearest = int(np.abs(t_ns - (t0_ns + round(event.t_s * 1e9))).argmin())
        marks[nearest] = f"{marks[nearest]} {event.label}".strip()
    table["event"] = marks
    if not whole_ms:
        table = table.rename(columns={names[0]: "t_ns"})
    with open(path, "w", encoding="utf-8", newline="") as out:
        out.write(f"# {remark}\n" if remark else "")
        table.to_csv(out, index=False, float_format=_DIGITS, lineterminator="\n")
    return len(table)
