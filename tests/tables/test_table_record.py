"""The record of a table: rows, and words against numbers."""

from __future__ import annotations

import numpy as np

from fbgraph.tables.table import Column, Table


def test_rows_are_those_of_the_columns() -> None:
    table = Table("walk", "walk.csv", (Column("t", "ms", np.arange(3)), Column("ax", "", np.zeros(3))))
    assert len(table) == 3
    assert len(Table("empty", "empty.csv", ())) == 0


def test_words_are_told_from_numbers() -> None:
    assert Column("label", "", np.array(["a", None], dtype=object)).is_text
    assert not Column("ax", "", np.array([0.5, np.nan])).is_text
