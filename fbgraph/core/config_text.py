"""Configuration as text: presets and TOML files as nested mappings, and ``a.b=value`` strings put into them.

What the keys mean, and which there are, is ``core.config``'s.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from fbgraph.core.bounded import CONFIG_BYTES, small_file
from fbgraph.core.errors import ConfigError, DataError


def preset_folder() -> Traversable:
    """Where the presets are: inside the package when installed, beside it in a checkout."""
    inside = files("fbgraph") / "configs"
    return inside if inside.is_dir() else Path(__file__).resolve().parents[2] / "configs"


def preset_names() -> list[str]:
    """Names that ``--config`` takes besides a path."""
    return sorted(
        entry.name.removesuffix(".toml") for entry in preset_folder().iterdir() if entry.name.endswith(".toml")
    )


def read_tables(source: str) -> dict[str, Any]:
    """The tables of a preset or TOML file, unchecked.

    Raises:
        ConfigError: no such preset or file, or not TOML.
    """
    try:
        if source in preset_names():
            text = (preset_folder() / f"{source}.toml").read_text("utf-8")
        else:
            text = small_file(Path(source), CONFIG_BYTES, "configuration").decode("utf-8")
    except (DataError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"--config {source}: neither a preset ({', '.join(preset_names())}) nor a readable file ({error})"
        ) from error
    return parse_toml(text, f"--config {source}")


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """TOML as a nested mapping.

    Raises:
        ConfigError: it is none, naming ``source``.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers of thousands of digits and endless brackets among them
        raise ConfigError(f"{source}: not TOML: {error}") from error


def override(values: dict[str, Any], overrides: Iterable[str]) -> dict[str, Any]:
    """Put ``a.b=value`` strings into a nested mapping, in place.

    Raises:
        ConfigError: not of this form, or a value where a table should be.
    """
    for text in overrides:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise ConfigError(f"--set {text!r}: expected key=value, for example --set steps.lambda_sigma=0.5")
        _put(values, path.strip(), _parse_value(value.strip()))
    return values


def _put(values: dict[str, Any], path: str, value: Any) -> None:
    *parents, last = path.split(".")
    table = values
    for parent in parents:
        table = table.setdefault(parent, {})
        if not isinstance(table, dict):
            raise ConfigError(f"--set {path}: {parent!r} is a value, not a table")
    table[last] = value


def _parse_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
