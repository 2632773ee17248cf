"""The report of a batch, or of two side by side: one page with everything in it, and its tables for a terminal."""

from __future__ import annotations

import base64
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from fbgraph import __version__
from fbgraph.batches import report_tables as tables
from fbgraph.batches.changes import Changes, changes
from fbgraph.batches.index import read_index
from fbgraph.batches.index_row import ESTIMATORS
from fbgraph.batches.places import fetched, is_address, joined, last_name, settled, written_file
from fbgraph.batches.statistics import known, worst_of
from fbgraph.core.colors import LABELS
from fbgraph.core.errors import ConfigError, FbgraphError
from fbgraph.core.safe_text import in_template

if TYPE_CHECKING:
    import pandas as pd

_MOST_CHANGES = 100
_MOST_FAILED = 200

Draw = Callable[[Path], bytes]
"""Called with a run folder; its picture, a PNG."""


@dataclass(frozen=True)
class Report:
    """What is told of one batch, or of two.

    Attributes:
        places: of the batches; of two, before and after.
        indices: of each.
        changes: of the second from the first; None of one.
    """

    places: tuple[str, ...]
    indices: tuple[pd.DataFrame, ...]
    changes: Changes | None

    @property
    def index(self) -> pd.DataFrame:
        """Of the batch that is told of: of two, the second."""
        return self.indices[-1]


def read_report(batches: Sequence[str]) -> Report:
    """Read the indices of one batch or two.

    Raises:
        ConfigError: none, more than two, or one twice.
        DataError: a batch without an index, or two without a log in common.
    """
    places = tuple(settled(one) for one in batches)
    if len(places) not in (1, 2) or len(set(places)) < len(places):
        raise ConfigError("expected one batch, or two to compare: the first as before, the second as after")
    indices = tuple(read_index(place) for place in places)
    return Report(places, indices, changes(*indices) if len(indices) == 2 else None)


def write_report(report: Report, out: str, draw: Draw, pictures: int = 10) -> None:
    """Write the page: one HTML file that needs no other.

    Args:
        report: what to tell.
        out: the file.
        draw: as ``plots.walk_figure.run_png``.
        pictures: of how many of the worst runs.

    Raises:
        ConfigError: it cannot be written.
    """
    import jinja2

    template = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, finalize=in_template
    ).from_string((files("fbgraph.batches") / "report.html.j2").read_text("utf-8"))
    frame, found = report.index, report.changes
    failed = int((frame["status"] == "failed").sum())
    page = template.render(
        title="Two batches compared" if found else f"Batch {last_name(report.places[0])}",
        batches=[(place, tables.headline(one)) for place, one in zip(report.places, report.indices, strict=True)],
        compared=found is not None,
        **({} if found is None else _of_changes(found)),
        errors=tables.error_rows(frame),
        coverage=tables.coverage_text(frame),
        distribution=_distribution(report),
        verdicts=tables.verdict_rows(frame),
        failures=tables.failure_rows(frame),
        failed=tables.failed_rows(frame, _MOST_FAILED),
        more_failed=max(failed - _MOST_FAILED, 0),
        worst=tables.worst_rows(frame),
        pictures=[_picture(report.places[-1], row, out, draw) for row in _worst(frame, pictures)],
        links={str(row["name"]): f"#worst{k + 1}" for k, row in enumerate(_worst(frame, pictures))},
        provenance=_provenance(report),
    )
    with written_file(out) as partial:
        partial.write_text(page, "utf-8", "backslashreplace")


def _of_changes(found: Changes) -> dict[str, Any]:
    return {
        "changed": tables.changed_text(found),
        "paired": tables.paired_rows(found),
        "changes": tables.changed_rows(found, _MOST_CHANGES),
        "more_changes": max(len(found.walks) - _MOST_CHANGES, 0),
    }


def _worst(frame: pd.DataFrame, count: int) -> list[dict[str, Any]]:
    return [{str(k): value for k, value in row.items()} for row in worst_of(frame, count).to_dict("records")]


def _distribution(report: Report) -> str:
    """The figure of errors as base64; ``""`` without truth."""
    curves = []
    for number, frame in enumerate(report.indices):
        before = number + 1 < len(report.indices)
        for name in ESTIMATORS:
            rmse_m = known(frame[f"{name}_rmse_m"])
            if len(rmse_m):
                curves.append((f"{LABELS[name]}{', before' if before else ''}", rmse_m, name, before))
    if not curves:
        return ""
    from fbgraph.plots.error_distribution import distribution_png  # matplotlib takes a second to import

    return base64.b64encode(distribution_png(curves)).decode("ascii")


def _picture(batch: str, row: dict[str, Any], out: str, draw: Draw) -> tuple[str, str, str, str, str]:
    """Name, what is to be said, PNG as base64, the run folder and the link to its recording; of one run."""
    run, why = joined(batch, str(row["run"])), str(row["why"] or row["verdict"] or "")
    with TemporaryDirectory(prefix="fbgraph-") as scratch:
        try:
            folder = fetched(run, Path(scratch))
            png = base64.b64encode(draw(folder)).decode("ascii")
            recording = (folder / "recording.rrd").is_file()
        except (FbgraphError, OSError) as error:  # a run that was removed or damaged since
            return str(row["name"]), f"{why}; not drawn: {error}", "", run, ""
    return str(row["name"]), why, png, run, _link(joined(run, "recording.rrd"), out) if recording else ""


def _link(place: str, out: str) -> str:
    """What leads from the page to a file."""
    if is_address(place) or is_address(out):
        return quote(place, safe=":/")
    return quote(os.path.relpath(place, Path(out).parent), safe="/", errors="surrogateescape")


def _provenance(report: Report) -> list[str]:
    told = []
    for place, frame in zip(report.places, report.indices, strict=True):
        versions = [
            f"{name} {', '.join(sorted(set(frame[name].dropna()) - {''}))}"
            for name in ("fbgraph", "gtsam", "numpy", "scipy", "vqf")
        ]
        cpu_s, wall_s = (float(frame[name].sum()) for name in ("cpu_s", "wall_s"))
        told.append(f"{place}: {'; '.join(versions)}; {cpu_s:,.0f} s of processor, {wall_s:,.0f} s of workers")
    return [*told, f"report by fbgraph {__version__}"]
