"""A run in other tools' formats. One module a format: adding one is a module here and its name in ``FORMATS``.

A module has ``DESCRIPTION`` (one line), ``SUFFIX`` (of its files), ``BINARY`` (not for a terminal), ``ON_EARTH`` (needs
to know where on Earth the walk was) and ``write(walk, out) -> list[str]``, which returns what the user should know.
Modules are imported only when asked for.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from fbgraph.core.errors import ConfigError

FORMATS = ("tum", "csv", "gpx", "geojson", "kml", "g2o", "mcap", "euroc", "parquet")
"""In the order in which help lists them."""


def exporter(name: str) -> ModuleType:
    """The module of this format.

    Raises:
        ConfigError: there is none.
    """
    if name not in FORMATS:
        raise ConfigError(f"--to {name}: no such format; there are {', '.join(FORMATS)}")
    return import_module(f"fbgraph.exports.{name}")
