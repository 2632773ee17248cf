"""Recordings read back."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

from fbgraph.core.geometry import FloatArray
from fbgraph.recording.tab_layout import question_tabs

TIMELINES = ("time", "step", "distance_cm")


def chunks_of(path: Path) -> dict[str, list[Chunk]]:
    """What a recording holds, by entity."""
    chunks: dict[str, list[Chunk]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        chunks.setdefault(chunk.entity_path.lstrip("/"), []).append(chunk)
    return chunks


def entities(path: Path) -> set[str]:
    return set(chunks_of(path))


def column(chunks: list[Chunk], name: str, static: bool = False) -> FloatArray:
    """(N, D) values of the component of this name; rows in order, rows that were cleared left out."""
    rows = [np.asarray(row, dtype=float).ravel() for row in cells(chunks, name, static)]
    return np.array([row for row in rows if len(row)])


def cells(chunks: list[Chunk], name: str, static: bool = False) -> list[object]:
    """What stands in the column of this name, a component or a timeline, row by row."""
    rows: list[object] = []
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if chunk.is_static == static and name in batch.schema.names:
            rows += batch.column(name).to_pylist()
    return rows


def tabs(found: set[str]) -> dict[str, rrb.Container]:
    """The tabs that these entities get, by name."""
    return {str(tab.name): tab for tab in question_tabs(found, None)}


def views(tab: rrb.Container | rrb.View) -> list[rrb.View]:
    """All views of a tab, however they are arranged."""
    return [tab] if isinstance(tab, rrb.View) else [view for part in tab.contents for view in views(part)]


def shown(view: rrb.View, found: Iterable[str]) -> set[str]:
    """Which of these entities a view shows."""
    contents = view.contents
    assert isinstance(contents, str | list)
    expressions = ["$origin/**"] if isinstance(contents, str) else [str(expression) for expression in contents]
    origin = str(view.origin).strip("/")
    chosen: set[str] = set()
    for expression in expressions:
        path = expression.removeprefix("-").strip().replace("$origin", origin).strip("/").removesuffix("/**")
        below = {entity for entity in found if path in ("", "**", entity) or entity.startswith(f"{path}/")}
        chosen = chosen - below if expression.startswith("-") else chosen | below
    return chosen
