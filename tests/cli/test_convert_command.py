"""Any log as a canonical CSV: smoothing either gives the same walk."""

from pathlib import Path

import numpy as np
import pytest
from support.commands import fbgraph

import fbgraph as package
from fbgraph.readers import preset_of, read_log
from fbgraph.readers.canonical_csv import noted_preset

LOGS = ["ipin2023/TrainingTrial01_repetition03.txt.gz", "formats/phyphox_ios_aymdi_MIT", "simulated"]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    fbgraph("simulate", folder / "walk.csv", "--route", "straight", "--seed", 4)
    return folder / "walk.csv"


@pytest.mark.parametrize("name", LOGS)
def test_a_converted_log_gives_the_same_walk(name: str, simulated: Path, request: pytest.FixtureRequest) -> None:
    log = simulated if name == "simulated" else request.getfixturevalue("shared_data") / name
    out = simulated.parent / f"{Path(name).stem}_converted.csv"
    assert f"written to {out}\n" in fbgraph("convert", log, out).stdout
    before, after = package.smooth(log), package.smooth(out)
    assert preset_of(read_log(out)) == ("m5stickc" if name == "simulated" else "phone")
    one, other = before.trajectories["smoothed"], after.trajectories["smoothed"]
    assert one.t_s + before.summary["log"]["t0_s"] == pytest.approx(other.t_s + after.summary["log"]["t0_s"], abs=1e-6)
    for axis in ("x_m", "y_m", "z_m"):
        assert getattr(one, axis) == pytest.approx(getattr(other, axis), abs=1e-3)


def test_its_truth_is_written_beside_it_in_the_same_places(shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "ipin2023" / "TrainingTrial01_repetition03.txt.gz"
    fbgraph("convert", log, tmp_path / "walk.csv")
    truth, known = read_log(log).truth, package.read_checkpoints(tmp_path / "walk_truth.csv")
    assert truth is not None
    assert known.xy_m == pytest.approx(truth.xy_m, abs=1e-4)
    assert np.array_equal(known.t_s, truth.t_s)
    assert np.array_equal(known.floor, truth.floor, equal_nan=True)
    assert known.georeference is not None
    assert truth.georeference is not None
    assert known.georeference.apart_m(truth.georeference) < 1e-3
    assert known.sigma_m == pytest.approx(truth.sigma_m)


def test_nothing_is_replaced_without_force(simulated: Path, tmp_path: Path) -> None:
    out = tmp_path / "walk.csv"
    out.write_text("mine")
    assert "--force replaces it" in fbgraph("convert", simulated, out, code=2).stderr
    assert out.read_text() == "mine"
    fbgraph("convert", simulated, out, "--force")
    assert out.read_text().startswith("# converted by fbgraph from m5stickc; preset m5stickc\nt_ms,ax_g,ay_g,az_g,")


def test_a_log_without_truth_is_not_put_beside_the_truth_of_another(simulated: Path, tmp_path: Path) -> None:
    out, truth = tmp_path / "walk.csv", tmp_path / "walk_truth.csv"
    truth.write_text("t_s,x_m,y_m\n1,2,3\n")
    for force in ((), ("--force",)):
        said = fbgraph("convert", simulated, out, *force, code=2).stderr
        assert "walk_truth.csv: is there, and this log carries no truth" in said
    assert list(tmp_path.iterdir()) == [truth]


def test_a_log_that_cannot_be_read_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t_ms,ax_g,ay_g,az_g\n" + "".join(f"{10 * i},0,0,1\n" for i in range(300)))
    assert "no gyroscope" in fbgraph("convert", tmp_path / "log.csv", tmp_path / "out.csv", code=3).stderr
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(
    ("remarks", "preset"),
    [
        ((), None),
        (("a walk", "converted by fbgraph from phyphox; preset phone"), "phone"),
        (("converted by fbgraph from x; preset m5stickc",), "m5stickc"),
        (("converted by fbgraph from x; preset ../../evil",), None),
        (("not converted by fbgraph from x; preset phone",), None),
    ],
)
def test_the_preset_is_what_a_remark_notes(remarks: tuple[str, ...], preset: str | None) -> None:
    assert noted_preset(remarks) == preset
