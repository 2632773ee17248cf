"""What is known of a building as text: on the command line, and as TOML."""

from __future__ import annotations

import math
from pathlib import Path

import tomli_w

from fbgraph.core.bounded import CONFIG_BYTES, small_file
from fbgraph.core.building import DEFAULT_SIGMA_DEG, SIGMAS_DEG, Building, BuildingAxis
from fbgraph.core.config_text import parse_toml
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.core.sections import validated
from fbgraph.core.whole_writes import whole_file

_KEYS = "`fbgraph learn-building` writes such a file"
_HEAD = "# What walks in a building tell of it, found by fbgraph learn-building; for fbgraph smooth --building.\n"


def parse_building_axis(text: str) -> Building:
    """Read ``DEG[,SIGMA]``: a corridor's heading and its standard deviation, degrees.

    Raises:
        ConfigError: anything else.
    """
    try:
        heading_deg, *sigma_deg = (float(part) for part in text.split(","))
        (sigma,) = sigma_deg or (DEFAULT_SIGMA_DEG,)
    except ValueError:
        heading_deg = sigma = math.nan
    if not (abs(heading_deg) <= 360.0 and SIGMAS_DEG[0] <= sigma <= SIGMAS_DEG[1]):
        low, high = SIGMAS_DEG
        raise ConfigError(
            f"--building-axis {text}: expected DEG[,SIGMA], a corridor's heading clockwise from North and how well it "
            f"is known, {low:g} to {high:g} degrees: for example --building-axis 70,2"
        )
    return Building(axis=BuildingAxis(heading_deg=heading_deg, sigma_deg=sigma))


def read_building(path: Path) -> Building:
    """Read what ``write_building`` wrote.

    Raises:
        ConfigError: the file cannot be read, or holds something else; names its dotted key.
    """
    try:
        text = small_file(path, CONFIG_BYTES, "building").decode("utf-8")
    except (DataError, UnicodeDecodeError) as error:
        raise ConfigError(f"--building {path}: not a readable file of a building ({error}); {_KEYS}") from error
    return validated(Building, parse_toml(text, f"--building {path}"), f"--building {path}", _KEYS)


def write_building(building: Building, path: Path) -> None:
    """Write it as TOML, whole or not at all.

    Raises:
        ConfigError: it cannot be written.
    """
    with whole_file(path) as partial:
        partial.write_text(_HEAD + tomli_w.dumps(building.model_dump(mode="json", exclude_none=True)), "utf-8")
