"""Configuration: what is refused."""

import pytest

from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError


@pytest.mark.parametrize("at", ["soon", "-3", "nan", "inf", ""])
def test_a_wrong_time_is_refused(at: str) -> None:
    with pytest.raises(ConfigError, match=r"returning\.at"):
        load_config(None, [f'returning.at="{at}"'])
