"""Tables of TOML as frozen records: a mistyped key, at any depth, is an error that names its dotted path."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from fbgraph.core.errors import ConfigError


class Section(BaseModel):
    """A table of the configuration: frozen, and a mistyped key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False)


SectionT = TypeVar("SectionT", bound=Section)
_SHOWN = reprlib.Repr()
_SHOWN.maxstring = _SHOWN.maxother = 80


def validated(
    model: type[SectionT], values: Mapping[str, Any], source: str, keys: str = "`fbgraph config` prints all keys"
) -> SectionT:
    """Validate a nested mapping as a table of the configuration, or as another one.

    Args:
        values: as TOML has them.
        source: for messages.
        keys: where all keys can be seen.

    Raises:
        ConfigError: naming ``source`` and the dotted path of what is wrong.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        path = ".".join(str(part) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            raise ConfigError(f"{source}: unknown key {path!r}; {keys}") from error
        if first["type"] == "missing":
            raise ConfigError(f"{source}: {path}: Field required; {keys}") from error
        if not path:  # of keys that do not go together
            raise ConfigError(f"{source}: {first['msg'].removeprefix('Value error, ')}") from error
        raise ConfigError(f"{source}: {path}: {first['msg']} (got {_SHOWN.repr(first['input'])})") from error
