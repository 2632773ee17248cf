import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest
from support.commands import fbgraph

from fbgraph.batches.batch import batch
from fbgraph.batches.report import read_report, write_report
from fbgraph.core.errors import ConfigError, DataError
from fbgraph.plots.walk_figure import run_png
from fbgraph.simulator.files import simulate_files
from fbgraph.simulator.routes import load_route
from fbgraph.simulator.simulate_options import SimulateOptions

HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def batches(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two batches of two walks and a broken log, the second with other steps, in a folder."""
    folder = tmp_path_factory.mktemp("batches")
    for seed in (1, 2):
        route = load_route("square", 0.4)
        simulate_files(folder / f"walk{seed}.csv", route, SimulateOptions(duration_s=12.0), seed)
    (folder / "walk2.csv").rename(folder / f"{HOSTILE}.csv")
    (folder / "walk2_truth.csv").rename(folder / f"{HOSTILE}_truth.csv")
    (folder / "<script>.csv").write_text("nothing\n")
    logs = [str(path) for path in folder.glob("*.csv") if "_truth" not in path.name]
    batch(logs, out=folder / "before", workers=0)
    batch(logs, out=folder / "after", workers=0, recording=False, overrides=["step_length.alpha_m=0.3"])
    return folder


class Page(HTMLParser):
    """What a browser would make of it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def test_the_page_needs_no_other_file_and_runs_nothing(batches: Path) -> None:
    out = batches / "before" / "report.html"
    write_report(read_report([str(batches / "before")]), str(out), run_png)
    page = Page(out)
    assert not {"script", "iframe", "link"} & {tag for tag, _ in page.tags}
    assert not [attributes for _, attributes in page.tags if any(name.startswith("on") for name in attributes)]
    pictures = [str(attributes["src"]) for tag, attributes in page.tags if tag == "img"]
    assert len(pictures) == 3  # the distribution and two walks
    assert all(src.startswith("data:image/png;base64,iVBOR") for src in pictures)
    links = [str(attributes["href"]) for tag, attributes in page.tags if tag == "a"]
    recordings = [link for link in links if link.endswith("recording.rrd")]
    assert "runs/walk1/recording.rrd" in recordings
    assert len(recordings) == 2
    assert len([link for link in links if link.startswith("#worst")]) == 2
    text = out.read_text("utf-8")
    assert "&lt;script&gt;.csv: no table in it" in text
    assert "<script>" not in text
    assert "3 logs: 2 done" in text


def test_of_two_the_differences_come_first(batches: Path) -> None:
    ended = fbgraph("report", batches / "before", batches / "after", "--pictures", 0)
    assert "2 of 3 walks changed" in ended.stdout
    assert re.search(r"smoothed\s+2\s", ended.stdout)
    page = batches / "after" / "compared.html"
    assert f"written to {page}" in ended.stdout
    text = page.read_text("utf-8")
    assert "What changed" in text
    assert text.index("What changed") < text.index("<h2>Errors")
    same = fbgraph("report", batches / "before", batches / "before", code=2)
    assert "expected one batch, or two to compare" in same.stderr


def test_tables_as_json_and_on_a_terminal(batches: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "r.html"
    said = json.loads(fbgraph("report", batches / "before", "--pictures", 0, "--out", out, "--json").stdout)
    assert said["out"] == str(out)
    assert [row["estimator"] for row in said["errors"]] == ["PDR", "EKF", "smoothed"]
    assert said["failures"][0]["cause"] == "data"
    monkeypatch.setenv("COLUMNS", "80")
    shown = fbgraph("report", batches / "before", "--pictures", 0, "--out", out).stdout
    assert max(map(len, shown.splitlines()[1:12])) <= 80
    assert "\x1b" not in shown


def test_what_is_no_batch(tmp_path: Path) -> None:
    assert "no batch" in fbgraph("report", tmp_path, code=3).stderr
    (tmp_path / "manifest.csv").touch()
    with pytest.raises(DataError, match="go on with --resume"):
        read_report([str(tmp_path)])
    with pytest.raises(ConfigError, match="expected one batch"):
        read_report([])


def test_a_run_that_is_gone_is_not_drawn(batches: Path, tmp_path: Path) -> None:
    shutil.copytree(batches / "after", tmp_path / "b")
    shutil.rmtree(tmp_path / "b" / "runs")
    write_report(read_report([str(tmp_path / "b")]), str(tmp_path / "r.html"), run_png)
    assert "not drawn: " in (tmp_path / "r.html").read_text("utf-8")
