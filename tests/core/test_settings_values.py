"""Configuration: precedence, dotted paths, what is refused and how that is said."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from fbgraph.core.config import Config, EkfConfig, StepsConfig, dump_toml, load_config
from fbgraph.core.config_text import override, parse_toml, preset_names
from fbgraph.core.errors import ConfigError
from fbgraph.core.sections import validated


def test_presets_differ_from_the_defaults_and_overrides_from_presets() -> None:
    assert load_config() == Config()
    assert load_config("m5stickc").step_length.alpha_m == 0.35
    assert load_config("m5stickc", ["step_length.alpha_m=0.4"]).step_length.alpha_m == 0.4
    assert load_config("m5stickc", ["steps.min_run=5"]).step_length.alpha_m == 0.35
    assert {"m5stickc", "phone"} <= set(preset_names())
    assert preset_names() == sorted(preset_names())
    for name in preset_names():
        assert load_config(name) != Config() or name == "phone"


def test_a_file_may_say_how_a_study_is_laid_out(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text('[steps]\nmin_run = 7\n[dataset]\nanything = "goes"\n')
    assert load_config(str(path)).steps.min_run == 7


def test_the_effective_configuration_reads_back_as_it_was(tmp_path: Path) -> None:
    config = load_config("m5stickc", ["returning.at=12.5", "device.mount=[0.0,1.0,0.0]"])
    (tmp_path / "config.toml").write_text(dump_toml(config))
    assert load_config(str(tmp_path / "config.toml")) == config
    assert tomllib.loads(dump_toml(config))["returning"]["at"] == "12.5"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a.b=1.5", 1.5),
        ("a.b = 2", 2),
        ("a.b=true", True),
        ("a.b=word", "word"),
        ('a.b="1.5"', "1.5"),
        ("a.b=[1, 2]", [1, 2]),
        ("a.b=x=y", "x=y"),
    ],
)
def test_a_value_is_toml_or_a_bare_word(text: str, value: object) -> None:
    assert override({}, [text]) == {"a": {"b": value}}


def test_overrides_reach_into_tables_in_order() -> None:
    values: dict[str, Any] = {"a": {"b": 1, "c": 2}}
    assert override(values, ["a.b=3", "a.d.e=4", "a.b=5", "top=6"]) is values
    assert values == {"a": {"b": 5, "c": 2, "d": {"e": 4}}, "top": 6}


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("steps.min_run", "expected key=value"),
        ("=5", "expected key=value"),
        ("steps.min_run.x=5", "'min_run' is a value, not a table"),
        ("steps.minrun=5", r"unknown key 'steps\.minrun'"),
        ("stps.min_run=5", r"unknown key 'stps'"),
        ("steps.min_run=1", r"steps\.min_run: .*greater than or equal to 2.* \(got 1\)"),
        ("ekf.gate_sigma=0", r"ekf\.gate_sigma: .*greater than or equal to 0\.000001"),
        ("steps.lambda_sigma=-0.1", r"steps\.lambda_sigma: .*greater than or equal to 0"),
        ("device.mount=[1.0, 2.0]", r"device\.mount\.2: Field required"),
        ("attitude.rate_hz=fast", r"attitude\.rate_hz: .*valid number"),
    ],
)
def test_what_is_wrong_is_said_with_its_dotted_path(text: str, cause: str) -> None:
    values = ["steps.min_run=4", text] if "x=5" in text else [text]
    with pytest.raises(ConfigError, match=cause):
        load_config(None, values)


def test_the_source_of_a_fault_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^own: unknown key 'x'; `fbgraph config` prints all keys$"):
        validated(StepsConfig, {"x": 1}, "own")
    with pytest.raises(ConfigError, match=r"^own: not TOML: "):
        parse_toml("a = ", "own")
    with pytest.raises(ConfigError, match=r"--config nowhere: neither a preset \(.*m5stickc.*\) nor a readable file"):
        load_config("nowhere")
    (tmp_path / "bad.toml").write_text("[steps\n")
    with pytest.raises(ConfigError, match=r"--config .*bad\.toml: not TOML"):
        load_config(str(tmp_path / "bad.toml"))


def test_a_table_is_frozen() -> None:
    with pytest.raises(ValueError, match="frozen"):
        EkfConfig().gate_sigma = 3.0


@pytest.mark.parametrize(
    ("at", "kept"), [("auto", "auto"), (" event ", "event"), ("0", "0"), (12, "12"), ("3.5", "3.5")]
)
def test_a_way_back_begins_when_told(at: object, kept: str) -> None:
    assert validated(Config, {"returning": {"at": at}}, "test").returning.at == kept
