"""The layout of a data set of trials: what its columns are called and in which units they are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import BeforeValidator, Field

from fbgraph.core.bounded import CONFIG_BYTES, small_file
from fbgraph.core.config import STUDY_TABLE, Positive
from fbgraph.core.config_text import override, parse_toml, read_tables
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.sections import Section, validated

Names = Annotated[tuple[str, ...], BeforeValidator(lambda value: [value] if isinstance(value, str) else value)]
"""One name or a list of them."""


class ColumnsConfig(Section):
    """What the columns of a trial's table may be called; upper case, signs and a unit at the end do not matter.

    ``configs/forestback.toml`` names them all and says what each is.
    """

    time: Names = ()
    trial: Names = ()
    acc_x: Names = ()
    acc_y: Names = ()
    acc_z: Names = ()
    gyro_x: Names = ()
    gyro_y: Names = ()
    gyro_z: Names = ()
    mag_x: Names = ()
    mag_y: Names = ()
    mag_z: Names = ()
    pressure: Names = ()
    altitude: Names = ()
    step: Names = ()
    turn: Names = ()
    checkpoint: Names = ()
    truth_x: Names = ()
    truth_y: Names = ()
    truth_heading: Names = ()
    pdr_x: Names = ()
    pdr_y: Names = ()
    pdr_heading: Names = ()
    pdr_error: Names = ()
    forestback_x: Names = ()
    forestback_y: Names = ()
    forestback_heading: Names = ()
    forestback_error: Names = ()
    current: Names = ()


class UnitsConfig(Section):
    """Units that the columns' own names do not tell; "" leaves them to be judged by magnitude."""

    time: Literal["", "s", "ms", "us", "ns"] = ""
    acc: Literal["", "g", "mg", "ms2"] = ""
    gyro: Literal["", "dps", "rads"] = ""
    mag: Literal["", "ut", "nt", "mgauss", "gauss"] = ""
    pressure: Literal["", "hpa", "pa", "kpa"] = ""
    heading: Literal["", "deg", "rad"] = ""
    current: Literal["", "ma", "a"] = ""


class DatasetConfig(Section):
    """The layout of a data set of trials (``fbgraph study``)."""

    columns: ColumnsConfig = ColumnsConfig()
    units: UnitsConfig = UnitsConfig()
    rate_hz: Positive = 100.0
    """Rows a second, of tables without a time column."""
    map_yaw_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0
    """How far the ground truth's x axis is turned from magnetic East, counter-clockwise."""


class _StudyTables(Section):
    """What a study reads of a configuration or mapping file."""

    dataset: DatasetConfig = DatasetConfig()


def load_layout(source: str, overrides: Iterable[str] = (), mapping: Path | None = None) -> DatasetConfig:
    """The effective layout of a data set.

    Args:
        source: a preset's name or TOML file; one that names no columns gets those of ``configs/forestback.toml``.
        overrides: ``dataset.a=value`` strings.
        mapping: a file that says what some columns are called.

    Raises:
        ConfigError: as ``load_config``; of the mapping file: see ``load_mapping``.
    """
    layout = _parse(override({STUDY_TABLE: read_tables(source).get(STUDY_TABLE, {})}, overrides), source)
    if layout.columns == ColumnsConfig():
        layout = layout.model_copy(update={"columns": _parse(read_tables("forestback"), "forestback").columns})
    return layout if mapping is None else load_mapping(mapping, layout)


def load_mapping(path: Path, dataset: DatasetConfig) -> DatasetConfig:
    """A data set's layout with what a mapping file says otherwise; columns that the file does not name stay.

    Args:
        path: TOML with ``[dataset.columns]``, ``[dataset.units]`` and ``[dataset]``, as in ``configs/forestback.toml``.
        dataset: the layout to start from.

    Raises:
        ConfigError: unreadable, not TOML, no or another table than ``[dataset]``, an unknown key, an invalid value.
    """
    name = f"--mapping {path}"
    try:
        values = parse_toml(small_file(path, CONFIG_BYTES, "mapping").decode("utf-8"), name)
    except (DataError, UnicodeDecodeError) as error:
        raise ConfigError(f"{name}: not a readable file ({error})") from error
    if other := sorted(values.keys() - {STUDY_TABLE}):
        raise ConfigError(f"{name}: unknown key {other[0]!r}; only [dataset] tables here, all else in --config")
    given = _parse(values, name)
    if not given.model_fields_set:
        raise ConfigError(f"{name}: says nothing; it needs [dataset.columns], see configs/forestback.toml")
    tables = {
        name: getattr(dataset, name).model_copy(update=getattr(given, name).model_dump(exclude_unset=True))
        for name in ("columns", "units")
    }
    plain = {name: getattr(given, name) for name in given.model_fields_set - tables.keys()}
    return dataset.model_copy(update=tables | plain)


def dump_layout(layout: DatasetConfig) -> str:
    """The layout as TOML, every key; ``--config`` takes it back."""
    return tomli_w.dumps({STUDY_TABLE: layout.model_dump(mode="json")})


def _parse(values: Mapping[str, Any], source: str) -> DatasetConfig:
    """The layout in a nested mapping that may hold other tables too."""
    return validated(_StudyTables, {STUDY_TABLE: values.get(STUDY_TABLE, {})}, source).dataset
