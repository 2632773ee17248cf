"""``evaluate`` and ``plot`` as they are typed."""

import json
import re
from pathlib import Path

import pytest
from support.by_hand import way_along
from support.commands import fbgraph
from support.results_by_hand import with_cov
from support.runs_by_hand import hand_run

from fbgraph.cli.printing import print_summary, print_table

EL = with_cov(way_along((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), t0_s=1.0))
LONG = "a-run-with-a-name-that-is-longer-than-any-table-has-room-for-" * 3


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs, one with a hostile name, and truth that is turned by a right angle."""
    home = tmp_path_factory.mktemp("home")
    hand_run(home / "a", EL)
    hand_run(home / "b\x1b[2J$_", EL.turned(0.1))
    hand_run(home / LONG, EL)
    (home / "truth.csv").write_text("t_s,x_m,y_m\n1001,0,0\n1011,0,10\n1016,-5,10\n1021,-10,10\n")
    return home


def test_one_run_is_scored_as_before_and_with_more(home: Path) -> None:
    scores = json.loads(fbgraph("evaluate", "a", "--truth", "truth.csv", "--json", cwd=home).stdout)
    assert list(scores) == ["ekf", "smoothed"]
    entry = scores["smoothed"]
    assert entry["turned_deg"] == pytest.approx(-90.0)
    assert entry["aligned_rmse_m"] == pytest.approx(0.0, abs=1e-5)
    assert entry["final_m"] == pytest.approx(20.0, abs=1e-5)
    assert entry["final_percent"] == pytest.approx(100.0, abs=1e-3)
    assert entry["ce50_m"] == pytest.approx(250.0**0.5, abs=1e-5)
    printed = fbgraph("evaluate", "a", "--truth", "truth.csv", cwd=home).stdout
    assert printed.startswith("hand: 3 checkpoints scored\n")
    for word in ("CE50 m", "CE75 m", "CE95 m", "Q3 m", "growth", "m/s", "final %", "aligned", "-90", "0 of 3", "20.00"):
        assert word in printed


def test_several_runs_stand_in_one_table_and_their_errors_in_one_file(home: Path, tmp_path: Path) -> None:
    arguments = ("evaluate", "a", "b\x1b[2J$_", "--truth", "truth.csv", "--errors", tmp_path / "e.csv")
    printed = fbgraph(*arguments, cwd=home).stdout
    assert "\x1b" not in printed
    assert len(re.findall(r"^ (a|b\\x1b\[2J\$_) +(ekf|smoothed) ", printed, re.M)) == 4
    lines = (tmp_path / "e.csv").read_text("utf-8").splitlines()
    assert len(lines) == 1 + 2 * 2 * 4
    assert {line.split(",")[0] for line in lines[1:]} == {"a", r"b\x1b[2J$_"}
    scores = json.loads(fbgraph(*arguments, "--json", cwd=home).stdout)
    assert list(scores) == ["a", "b\x1b[2J$_"]
    assert scores["b\x1b[2J$_"]["ekf"]["turned_deg"] == pytest.approx(-84.27, abs=0.01)


@pytest.mark.parametrize("columns", [60, 80])
def test_tables_fit_and_no_digit_is_cut(home: Path, monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    wide = fbgraph("evaluate", "a", LONG, "--truth", "truth.csv", cwd=home).stdout
    monkeypatch.setenv("COLUMNS", str(columns))
    narrow = fbgraph("evaluate", "a", LONG, "--truth", "truth.csv", cwd=home).stdout
    table = narrow[narrow.index("\n\n") :] if "\n\n" in narrow else narrow[narrow.index("scored\n ") :]
    assert max(map(len, table.splitlines())) <= columns
    numbers = re.compile(r"(?<![\w.])[-+]?\d+\.\d+(?![\w.])|\d of \d")
    found = [numbers.findall(text.split("checkpoints scored\n")[-1]) for text in (wide, narrow)]
    assert sorted(found[0]) == sorted(found[1])
    assert len(found[0]) == 4 * 11 + 2
    assert narrow.count(" a ") > 2  # each part says whose it is


@pytest.mark.parametrize("columns", [60, 80])
def test_what_smooth_prints_fits_too(
    home: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], columns: int
) -> None:
    summary = json.loads((home / "a" / "summary.json").read_text())
    scores = json.loads(fbgraph("evaluate", "a", "--truth", "truth.csv", "--json", cwd=home).stdout)
    for name, entry in summary["estimators"].items():
        entry["score"] = scores[name]
    monkeypatch.setenv("COLUMNS", str(columns))
    print_summary(summary)
    printed = capfd.readouterr().out
    table = [line for line in printed.splitlines() if line.startswith(" ")]
    assert max(map(len, table)) <= columns
    for word in ("RMSE m", "aligned", "turned °", "-90", "0.00", "20.00", "unaided"):
        assert word in "\n".join(table)
    assert "…" not in printed


def test_a_table_is_parted_only_where_it_must_be(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    rows = [["one", *["1234.56"] * 4], ["two", *["7.00"] * 4]]
    heads = ["estimator", "a m", "b m", "c m", "d m"]
    for columns, tables in ((9 + 2 + 4 * 9, 1), (9 + 2 + 4 * 9 - 1, 2), (29, 2), (28, 4)):
        monkeypatch.setenv("COLUMNS", str(columns))
        print_table(heads, rows)
        printed = capfd.readouterr().out
        assert printed.count("estimator") == tables
        assert printed.count("1234.56") == 4
        assert max(map(len, printed.splitlines())) <= columns


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("evaluate", "a"), 3, "was made without truth; name it with --truth FILE"),
        (("evaluate", "a", "a", "--truth", "truth.csv"), 2, "named twice"),
        (("evaluate", "a", "--truth", "truth.csv", "--truth", "truth.csv"), 2, "2 --truth for 1 runs"),
        (("evaluate", "a", "--truth", "truth.csv", "--errors", "a/summary.json"), 2, "run's own file"),
        (("evaluate", "nothing", "--truth", "truth.csv"), 3, "not a run folder"),
        (("plot", "a", "--out", "a.jpeg"), 2, "expected a name that ends with .png, .pdf, .svg"),
        (("plot", "a", "--out", "x.png", "--estimator", "kalman"), 2, "unknown estimator 'kalman'"),
        (("plot", "a", "--out", "none/x.png"), 2, "cannot write there"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(home: Path, arguments: tuple[str, ...], code: int, said: str) -> None:
    done = fbgraph(*arguments, code=code, cwd=home)
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


def test_plot_writes_what_was_named(home: Path, tmp_path: Path) -> None:
    done = fbgraph(
        "plot", "a", "b\x1b[2J$_", "--out", tmp_path / "a.svg", "--truth", "truth.csv", "--width", 3.5, cwd=home
    )
    assert done.stdout == f"written to {tmp_path / 'a.svg'}\n"
    assert done.stderr == ""
    svg = (tmp_path / "a.svg").read_text("utf-8")
    assert r">b\x1b[2J$_</text>" in svg
    assert 'width="252pt"' in svg


@pytest.mark.parametrize("command", ["evaluate", "plot"])
def test_help_shows_an_example(command: str) -> None:
    assert f"Example: fbgraph {command} runs/a" in fbgraph(command, "--help").stdout
