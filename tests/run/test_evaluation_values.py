"""Runs compared: whose truth is whose, and every checkpoint's row."""

import csv
from pathlib import Path

import pytest
from support.by_hand import way_along
from support.results_by_hand import with_cov
from support.runs_by_hand import hand_run

from fbgraph.core.aids import Told
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.readers.places import read_checkpoints
from fbgraph.run.evaluation import ERRORS_HEADER, write_errors
from fbgraph.run.inputs import RunInputs
from fbgraph.run.named_runs import named_runs

EL = with_cov(way_along((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), t0_s=1.0), 0.3, 0.4)  # 1 m/s; 1 to 21 s
NORTH = way_along((0.0, 0.0), (0.0, 20.0), t0_s=1.0)


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    """The walk itself, 5 m East of it, its last place 2 m too far North: beyond the ellipse."""
    path = tmp_path / "truth.csv"
    path.write_text("t_s,x_m,y_m\n1001,5,0\n1011,15,0.5\n1021,15,12\n")
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as text:
        return list(csv.DictReader(text))


def test_a_row_a_checkpoint(tmp_path: Path, truth: Path) -> None:
    run = hand_run(tmp_path / "run", EL, NORTH)
    write_errors(tmp_path / "errors.csv", named_runs([run], [truth]))
    rows = rows_of(tmp_path / "errors.csv")
    assert tuple(rows[0]) == ERRORS_HEADER
    assert [(row["estimator"], row["t_s"], row["scored"]) for row in rows] == [
        (name, f"{t_s:.6f}", scored)
        for name in ("ekf", "smoothed")
        for t_s, scored in ((1001, "0"), (1011, "1"), (1021, "1"))
    ]
    last = {name: rows[5][name] for name in ERRORS_HEADER}
    assert last.pop("run") == "run"
    assert [last[name] for name in ("truth_x_m", "truth_y_m", "x_m", "y_m", "error_m")] == [
        *("15.000000", "12.000000", "15.000000", "10.000000", "2.000000")
    ]
    assert [row["in_ellipse_95"] for row in rows] == ["", "", "", "", "1", "0"]  # the EKF gives none
    assert rows[1]["error_m"] == f"{(10.0**2 + 9.5**2) ** 0.5:.6f}"
    scores = named_runs([run], [truth])[0].scores()
    for name in ("ekf", "smoothed"):
        mine = [row for row in rows if row["estimator"] == name]
        aligned = [float(row["aligned_error_m"]) for row in mine]
        assert (sum(e * e for e in aligned) / 3) ** 0.5 == pytest.approx(scores[name]["aligned_rmse_m"], abs=1e-6)
        off = [float(row["error_m"]) for row in mine if row["scored"] == "1"]
        assert (sum(e * e for e in off) / 2) ** 0.5 == pytest.approx(scores[name]["rmse_m"], abs=1e-6)
    inside = [row["in_ellipse_95"] for row in rows if row["estimator"] == "smoothed" and row["scored"] == "1"]
    assert inside.count("1") == scores["smoothed"]["coverage"]["inside_95"]


def test_one_truth_for_all_or_one_for_each(tmp_path: Path, truth: Path) -> None:
    runs = [hand_run(tmp_path / name, EL) for name in ("a", "b")]
    other = tmp_path / "other.csv"
    other.write_text("t_s,x_m,y_m\n1001,0,0\n1021,10,13\n")
    assert [run.scores()["ekf"]["final_m"] for run in named_runs(runs, [truth])] == pytest.approx([2.0, 2.0])
    assert [run.scores()["ekf"]["final_m"] for run in named_runs(runs, [truth, other])] == pytest.approx([2.0, 3.0])
    with pytest.raises(ConfigError, match="3 --truth for 2 runs"):
        named_runs(runs, [truth, other, truth])


def test_without_it_the_truth_each_was_made_with(tmp_path: Path, truth: Path) -> None:
    told, inputs = Told(truth=read_checkpoints(truth)), RunInputs(log="gone.csv", truth=str(truth))
    run = hand_run(tmp_path / "run", EL, told=told, inputs=inputs)
    bare = hand_run(tmp_path / "bare", EL)
    assert [named.truth is None for named in named_runs([run, bare])] == [False, True]
    with pytest.raises(DataError, match="bare: was made without truth; name it with --truth FILE"):
        named_runs([bare])[0].scores()
    truth.unlink()
    with pytest.raises(DataError, match=r"truth\.csv: .*: name it with --truth FILE"):
        named_runs([run])
    lost: list[str] = []
    assert named_runs([run], (), lost.append, lost_is_unknown=True)[0].truth is None
    assert lost[0].startswith("drawn without truth: ")


def test_runs_are_told_apart(tmp_path: Path, truth: Path) -> None:
    runs = [hand_run(tmp_path / where, EL) for where in ("x/run", "y/run", "z")]
    assert [run.name for run in named_runs(runs, [truth])] == [str(runs[0]), str(runs[1]), "z"]
    with pytest.raises(ConfigError, match="named twice"):
        named_runs([runs[0], runs[2], tmp_path / "y" / ".." / "x" / "run"], [truth])
