"""A data set whose names, remarks and labels would do something: what a study makes of it."""

import csv
import html.parser
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from rerun.chunk import RrdReader
from support.hostile import (
    CLEAR,
    CLIPBOARD,
    FORMULA,
    INPUT,
    MARKUP,
    RED_8BIT,
    RIGHT_TO_LEFT,
    SCRIPT,
    on_terminal,
    unseen,
)

from fbgraph.study.course import simulated_trials, write_trial

ONERROR = "<img src=x onerror=\"document.title='PWNED'\">"
HOW = f"{INPUT} {SCRIPT} {ONERROR} | `x` {CLIPBOARD} {MARKUP} {RED_8BIT} {RIGHT_TO_LEFT} $x$ ^^5c"
TRIALS = ("1²", f"{FORMULA.replace('/', '')}{CLEAR}{RIGHT_TO_LEFT}", "<script>document.title='PWNED'<|`[red]\udc9b")
LABELS = ("$\\frac{$", CLEAR, RED_8BIT, "<b>", "A" * 10_000)
ORDERED = (TRIALS[0], *sorted(TRIALS[1:]))
"""As names are counted: what begins with a number first. ``²`` is no number, though Python calls it a digit."""
TITLE = "Simulated: ForestBack evaluation, 3 trials"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A study's folder, and what a terminal saw of it."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "set").mkdir()
    walks = simulated_trials(1, len(TRIALS))
    for name, (_, walk, _remark) in zip(TRIALS, walks, strict=True):
        path = folder / "set" / f"{name}.csv"
        write_trial(walk, path, "-")
        _, header, *rows = path.read_text().splitlines()
        labels = dict(zip("ABCDE", LABELS, strict=True))
        place = header.split(",").index("checkpoint")
        cells = [row.split(",") for row in rows]
        for row in cells:
            row[place] = labels.get(row[place], row[place])
        text = "\n".join([f"# simulated {HOW}, trial 1", header, *map(",".join, cells)])
        path.write_text(f"{text}\n", "utf-8")
    return folder / "out", on_terminal("study", folder / "set", "--out", folder / "out")


def test_the_terminal_shows_it_all_and_obeys_nothing(study: tuple[Path, str]) -> None:
    _, seen = study
    assert unseen(seen) == set()
    shown = HOW
    for text in (CLIPBOARD, RED_8BIT, RIGHT_TO_LEFT):
        shown = shown.replace(text, text.encode("unicode_escape").decode())
    assert f"SIMULATED, nobody walked ({shown}). 3 trials: mean RMSE " in seen


def test_latex_has_no_command_but_its_own(study: tuple[Path, str]) -> None:
    text = (study[0] / "table.tex").read_text("utf-8")
    assert unseen(text) == set()
    assert text.splitlines()[2].startswith(
        r"\caption{Simulated trials, not a measurement (\textbackslash{}input\{/etc/passwd\} "
        r"\textless{}script\textgreater{}document.title='PWNED'\textless{}/script\textgreater{} "
    )
    assert r"\$x\$ \textasciicircum{}\textasciicircum{}5c). Overall performance" in text
    assert set(re.findall(r"\\([A-Za-z]+)", text)) == {
        *("begin", "end", "centering", "caption", "small", "setlength", "tabcolsep", "hline", "textbf", "quad", "circ"),
        *("textbackslash", "textless", "textgreater", "textbar", "textasciicircum"),
    }
    plain = re.sub(r"\\[{}]", "", text)
    assert plain.count("{") == plain.count("}")


def test_markdown_has_no_markup_but_its_own(study: tuple[Path, str]) -> None:
    caption, empty, head, *_ = (study[0] / "table.md").read_text("utf-8").split("\n")
    assert unseen(caption) == set()
    assert re.findall(r"(?<!\\)(?:\\\\)*[<>\[\]`|*]", caption) == []
    assert (empty, head.count("|")) == ("", 7)


def test_no_cell_of_the_tables_is_a_formula(study: tuple[Path, str]) -> None:
    with open(study[0] / "trials.csv", encoding="utf-8", newline="") as table:
        rows = list(csv.DictReader(table))
    names = {row["trial"] for row in rows}
    assert names == {
        "1²",
        "'=cmd|' C calc'!A0\\x1b[2J\\u202eRTL",
        r"<script>document.title='PWNED'<|`[red]\udc9b",
    }
    assert any(float(row["improvement_percent"]) < 0.0 for row in rows)  # negative numbers are left alone


def test_the_data_keep_the_true_text(study: tuple[Path, str]) -> None:
    summary = json.loads((study[0] / "summary.json").read_text("utf-8"))
    assert list(summary["by_trial"]) == list(ORDERED)
    assert summary["simulated"] == f"simulated {HOW}"
    assert tomllib.loads((study[0] / "config.toml").read_text("utf-8"))["dataset"]["rate_hz"] == 100.0


def test_a_trial_is_one_place_in_the_recording(study: tuple[Path, str]) -> None:
    entities = {chunk.entity_path for chunk in RrdReader(study[0] / "study.rrd").stream().to_chunks()}
    below = {path for path in entities if path.startswith("/map/truth/")}
    assert {path.count("/") for path in below} == {3}
    assert len(below) == 3
    assert unseen("".join(entities)) == set()


class _Elements(html.parser.HTMLParser):
    """Every element and attribute of a page, and its title."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: set[str] = set()
        self.sources: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        self.sources += [str(value) for name, value in attrs if name in ("src", "href")]


def test_the_report_has_no_element_from_the_data(study: tuple[Path, str]) -> None:
    page = (study[0] / "report.html").read_text("utf-8")
    assert unseen(page) == set()
    found = _Elements(page)
    assert found.tags <= {
        *("html", "head", "meta", "title", "style", "body", "h1", "h2", "p", "div", "table", "thead", "tbody", "tr"),
        *("th", "td", "figure", "img", "figcaption", "i", "code", "br", "details", "summary", "pre"),
        *("h3", "ul", "li"),  # of notes, where there are any
    }
    assert {"table", "figure", "pre"} <= found.tags
    assert found.attributes == {"lang", "charset", "name", "content", "class", "id", "alt", "src"}
    assert all(source.startswith("data:image/png;base64,") for source in found.sources)


@pytest.mark.skipif(
    shutil.which("chromium") is None, reason="no chromium: the report was only looked at by an HTML parser"
)
def test_a_browser_runs_nothing_of_the_report(study: tuple[Path, str], tmp_path: Path) -> None:
    def title(page: Path) -> str:
        command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
        command += ["--disable-background-networking", "--disable-component-update", "--disable-sync", "--dump-dom"]
        command += [f"--user-data-dir={tmp_path / 'profile'}", page.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        found = re.search(r"<title>(.*?)</title>", done.stdout, re.DOTALL)
        assert found, done.stderr[-2000:]
        return found[1]

    control = tmp_path / "control.html"
    control.write_text(f"<title>before</title><p>{ONERROR}</p>{SCRIPT}")
    assert title(control) == "PWNED"  # what is hostile would be noticed
    assert title(study[0] / "report.html") == TITLE
