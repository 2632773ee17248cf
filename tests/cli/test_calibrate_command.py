"""``fbgraph calibrate``: a simulated wearer whose legs are 15 % longer, from a distance and from places."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands import fbgraph as command

import fbgraph
from fbgraph.core.config import load_config
from fbgraph.core.errors import ConfigError
from fbgraph.readers import read_log
from fbgraph.simulator.files import write_m5stickc_csv, write_truth_csv
from fbgraph.simulator.gait import Walker
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate import SimulatedWalk, simulate
from fbgraph.simulator.simulate_options import SimulateOptions

LONG = Walker(alpha_m=1.15 * 0.35, beta_m_s=1.15 * 0.20, gamma_m=1.15 * -1.75, person_sigma=0.0)


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, SimulatedWalk]]:
    """There and back, and a square to try it on, of a wearer whose legs are 15 % longer."""
    folder = tmp_path_factory.mktemp("wearer")
    made = {}
    for name, seed in (("out-and-back", 3), ("square", 5)):
        made[name] = walk = simulate(load_route(name), SimulateOptions(walker=LONG), seed=seed)
        write_m5stickc_csv(walk.log, folder / f"{name}.csv")
        write_truth_csv(walk, folder / f"{name}_truth.csv", rate_hz=0.5)
    return folder, made


def walked_m(walk: SimulatedWalk) -> float:
    return float(walk.steps.length_m.sum())


def off(folder: Path, walk: SimulatedWalk, out: Path, *config: object) -> float:
    """By how much the distance of the square is wrong."""
    command("smooth", folder / "square.csv", "--out", out, "--no-recording", "--out-and-back", *config)
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    return float(summary["estimators"]["pdr" if "--pdr" in config else "ekf"]["distance_m"]) / walked_m(walk) - 1.0


def test_one_distance_makes_walks_as_long_as_they_are(
    walks: tuple[Path, dict[str, SimulatedWalk]], tmp_path: Path
) -> None:
    folder, made = walks
    wearer = tmp_path / "wearer.toml"
    metres = walked_m(made["out-and-back"])
    done = command("calibrate", folder / "out-and-back.csv", "--distance", f"{metres:.1f}", "--out", wearer)
    assert "fitted: their scale only" in done.stdout
    assert "one length only" in done.stdout
    assert f"written to {wearer}" in done.stdout
    text = wearer.read_text("utf-8")
    assert text.startswith("# A wearer and a device by `fbgraph calibrate`")
    config = load_config(wearer)
    shipped = load_config("m5stickc")
    assert config.step_length.alpha_m / shipped.step_length.alpha_m == pytest.approx(1.15, abs=0.04)
    assert config.step_length.beta2_m_s2 == config.step_length.kappa_surge == 0.0
    assert config.graph.sigma_mag_rad == shipped.graph.sigma_mag_rad  # the preset's own are kept
    assert config.graph.sigma_length_scale <= shipped.graph.sigma_length_scale
    before, after = (
        off(folder, made["square"], tmp_path / name, *given)
        for name, given in (("before", ()), ("after", ("--config", wearer)))
    )
    assert before < -0.09
    assert abs(after) < 0.04


def test_places_tell_more_and_python_says_the_same(
    walks: tuple[Path, dict[str, SimulatedWalk]], tmp_path: Path
) -> None:
    folder, made = walks
    logs = [folder / f"{name}.csv" for name in made]
    truths = [folder / f"{name}_truth.csv" for name in made]
    out = tmp_path / "wearer.toml"
    named = [part for truth in truths for part in ("--truth", truth)]
    told = json.loads(command("calibrate", *logs, *named, "--out", out, "--json").stdout)
    found = fbgraph.calibrate([read_log(log) for log in logs], anchors=truths)
    assert json.loads(json.dumps(found.as_dict())) == {key: value for key, value in told.items() if key != "out"}
    assert out.read_text("utf-8") == found.to_toml()
    fit = found.wearer
    assert abs(fit.scale - 1.15) < 3.0 * np.hypot(fit.scale_sigma, 0.01)
    assert fit.legs > 8
    assert fit.cross_validation is not None
    assert (fit.cross_validation.left_out, fit.cross_validation.count) == ("walk", 2)
    assert fit.cross_validation.fitted_rel < 0.5 * fit.cross_validation.shipped_rel
    assert len(found.device.notes) == 2


@pytest.mark.parametrize(
    ("given", "code", "said"),
    [
        ([], 3, "it carries no known places, so no length is known; say --distance METRES"),
        (["--distance", "200", "--truth", "t.csv"], 2, "name one kind of known length"),
        (["--distance", "3280"], 3, "check the distance and its unit"),
        (["--distance", "-5"], 2, "expected the metres walked in a log"),
        (["--distance", "10", "--distance", "20"], 2, "2 for 1 logs; name one a log"),
        (["--use-gnss", "all"], 3, "no GNSS fixes in the log"),
        (["--distance", "20", "--set", "step_length.nonsense=1"], 2, "unknown key"),
    ],
)
def test_what_cannot_be_is_one_line(
    walks: tuple[Path, dict[str, SimulatedWalk]], given: list[str], code: int, said: str
) -> None:
    folder, _ = walks
    done = command("calibrate", folder / "out-and-back.csv", *given, code=code)
    assert said in done.stderr
    assert done.stderr.count("\n") == 1


def test_who_stands_has_no_step_length(tmp_path: Path, walks: tuple[Path, dict[str, SimulatedWalk]]) -> None:
    log = walks[1]["square"].log
    still = log.between(-np.inf, 2.5)
    write_m5stickc_csv(still, tmp_path / "still.csv")
    done = command("calibrate", tmp_path / "still.csv", "--distance", "100", code=3)
    assert "no step found" in done.stderr


def test_devices_of_several_kinds_are_not_one(shared_data: Path, walks: tuple[Path, dict[str, SimulatedWalk]]) -> None:
    phone = next((shared_data / "indoor-location" / "site1" / "F1").glob("*.gz"))
    with pytest.raises(ConfigError, match="several kinds of device"):
        fbgraph.calibrate([phone, walks[0] / "square.csv"], distance_m=[30.0, 20.0])


def summary_texts(folder: Path) -> list[Any]:
    return [one["text"] for one in json.loads((folder / "summary.json").read_text("utf-8"))["findings"]]


def test_a_walk_at_another_pace_than_the_calibrated_one_is_told(
    walks: tuple[Path, dict[str, SimulatedWalk]], tmp_path: Path
) -> None:
    set_ = ("--set", "step_length.calibrated_hz=[1.2, 1.5]")
    command("smooth", walks[0] / "square.csv", "--out", tmp_path / "run", "--no-recording", *set_)
    (text,) = [text for text in summary_texts(tmp_path / "run") if "calibrated with" in text]
    assert "steps are quicker" in text
